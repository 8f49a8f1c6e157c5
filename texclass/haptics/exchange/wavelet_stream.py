"""Encode and decode blocks of samples with the wavelet coding of MPEG haptics.

1. A block is transformed with biorthogonal 9/7 wavelets, with mirrored boundaries.
2. The coefficients are quantised relative to the largest coefficient.
3. The bit planes of the coefficients are coded from the highest to the lowest with zero trees (SPIHT).
4. Each bit is coded by an adaptive arithmetic coder with 10 bits and seven contexts.

Encoding and decoding use the same traversal of the planes: the coder writes each bit or returns the next bit.

References
----------
ISO/IEC 23090-31, wavelet encoding; A. Said, W. Pearlman, "A new, fast, and efficient image codec based on set
partitioning in hierarchical trees", 1996.
"""

import math
from collections import deque
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
import pywt
from numpy.typing import NDArray
from scipy import ndimage

from texclass.recording import Samples

COARSEST = 4
"""Number of coefficients of the lowest band."""
PLANES = 10
"""Default number of bits of the largest coefficient."""
MAX_PLANES = 15
MAX_COEFFICIENT = 16.875
"""Largest coefficient that a stream can represent."""
_RANGE = 1024
"""Range of the arithmetic coder: 10 bits."""
_PLANES_BITS, _LARGEST_BITS = 4, 7
# pywt pads all four filters with zeros to equal length; the filters are symmetric without this padding
_LOW, _HIGH, _LOW_BACK, _HIGH_BACK = (np.trim_zeros(taps) for taps in pywt.Wavelet("bior4.4").filter_bank)


class _Context(IntEnum):
    """Contexts of the coder: header, sign, single coefficient, sets of descendants, refinement."""

    HEAD, SIGN, SINGLE, CHILDREN, CHILD, GRANDCHILDREN, REFINE = range(7)


def transform(block: Samples) -> Samples:
    """Return the wavelet coefficients (n,) of a block (n,), coarsest first; n is a power of two >= 16."""
    rest, bands = np.asarray(block, dtype=np.float64), []
    while rest.size > COARSEST:
        bands.append(ndimage.correlate1d(rest, _HIGH, mode="mirror")[1::2])
        rest = ndimage.correlate1d(rest, _LOW, mode="mirror")[::2]
    return np.concatenate([rest, *bands[::-1]])


def inverse(coefficients: Samples) -> Samples:
    """Reconstruct a block (n,) from its wavelet coefficients (n,); inverse of `transform`."""
    rest = np.asarray(coefficients[:COARSEST], dtype=np.float64)
    while rest.size < coefficients.size:
        low, high = np.zeros((2, 2 * rest.size))
        low[::2], high[1::2] = rest, coefficients[rest.size : 2 * rest.size]
        rest = ndimage.correlate1d(low, _LOW_BACK, mode="mirror")
        rest += ndimage.correlate1d(high, _HIGH_BACK, mode="mirror")
    return np.asarray(rest)


def encode(coefficients: Samples, planes: int = PLANES) -> bytes:
    """Encode coefficients (n,) of at most `MAX_COEFFICIENT` as a stream; return b"" for silence."""
    largest = float(np.abs(coefficients).max())
    steps = math.ceil(largest * 2**_LARGEST_BITS)
    above_1 = steps >= 2**_LARGEST_BITS
    if above_1:
        steps = math.ceil((largest - 1) * 8)
    scale = steps / 8 + 1 if above_1 else steps / 2**_LARGEST_BITS
    whole = np.rint(coefficients * (2.0**planes / (scale or 1.0))).astype(np.int64)
    if not whole.any():
        return b""
    coder = _Coder()
    _write_number(coder, planes, _PLANES_BITS)
    coder.code(above_1, _Context.HEAD)
    _write_number(coder, steps, _LARGEST_BITS)
    _code_planes(whole, planes, coder)
    return coder.finish()


def decode(stream: bytes, n: int) -> Samples:
    """Decode a stream to wavelet coefficients (n,); arbitrary bytes decode to finite numbers."""
    if not stream:
        return np.zeros(n)
    coder = _Coder(np.unpackbits(np.frombuffer(stream, dtype=np.uint8)).tolist())
    planes = _read_number(coder, _PLANES_BITS)
    above_1 = coder.code(False, _Context.HEAD)
    steps = _read_number(coder, _LARGEST_BITS)
    scale = steps / 8 + 1 if above_1 else steps / 2**_LARGEST_BITS
    return _code_planes(np.zeros(n, dtype=np.int64), planes, coder) * (scale / 2.0**planes)


def _write_number(coder: "_Coder", value: int, n_bits: int) -> None:
    for i in range(n_bits):
        coder.code(bool(value >> i & 1), _Context.HEAD)


def _read_number(coder: "_Coder", n_bits: int) -> int:
    return sum(coder.code(False, _Context.HEAD) << i for i in range(n_bits))


def _code_planes(values: NDArray[np.int64], top: int, coder: "_Coder") -> NDArray[np.int64]:
    """Code the bit planes of integers (n,); return the integers that a decoder reconstructs.

    The children of coefficient i are 2i and 2i + 1, at the same position one scale finer.
    """
    n, size = values.size, np.abs(values)
    max_descendant, max_grandchild = _largest_descendants(size)
    decoded, significant = np.zeros(n, dtype=np.int64), list[int]()
    singles = list(range(2 * COARSEST))
    sets = [
        (i, False) for i in range(COARSEST, 2 * COARSEST)
    ]  # root coefficient, and whether the set starts at its grandchildren

    def is_significant(i: int, context: int) -> bool:
        if not coder.code(bool(size[i] >= level), context):
            return False
        decoded[i] = level if coder.code(bool(values[i] >= 0), _Context.SIGN) else -level
        significant.append(i)
        return True

    for plane in range(top, -1, -1):
        level, n_before_plane = 1 << plane, len(significant)
        singles = [i for i in singles if not is_significant(i, _Context.SINGLE)]
        queue, sets = deque(sets), []
        while queue:
            i, skips_children = queue.popleft()
            if skips_children:
                largest, context = max_grandchild, _Context.GRANDCHILDREN
            else:
                largest, context = max_descendant, _Context.CHILDREN
            if not coder.code(bool(largest[i] >= level), context):
                sets.append((i, skips_children))
            elif skips_children:
                queue.extend([(2 * i, False), (2 * i + 1, False)])
            else:
                children = (2 * i, 2 * i + 1)
                singles.extend([child for child in children if not is_significant(child, _Context.CHILD)])
                if 4 * i + 3 < n:
                    queue.append((i, True))
        for i in significant[:n_before_plane]:
            if coder.code(bool(size[i] >> plane & 1), _Context.REFINE):
                decoded[i] += level if decoded[i] > 0 else -level
    return decoded


def _largest_descendants(size: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return, per coefficient, the largest magnitude of all descendants, and of those beyond its children."""
    n = size.size
    descendant, grandchild = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    first = n // 4
    while first >= COARSEST:
        children = slice(2 * first, 4 * first)
        grandchild[first : 2 * first] = descendant[children].reshape(-1, 2).max(axis=1)
        family = np.maximum(size[children], descendant[children])
        descendant[first : 2 * first] = family.reshape(-1, 2).max(axis=1)
        first //= 2
    return descendant, grandchild


class _Coder:
    """Adaptive arithmetic coder that encodes bits, or decodes them from a sequence of zeros and ones.

    The interval [low, high) is split in proportion to the frequency of zeros in the context. It is doubled
    whenever it fits into one half, or into the middle half (the bit is then pending until it is determined).
    """

    def __init__(self, source: Sequence[int] | None = None) -> None:
        self._low, self._high, self._pending = 0, _RANGE, 0
        self._zeros, self._total = [8] * len(_Context), [16] * len(_Context)
        self._source, self._position, self._value = source, 0, 0
        self._bits: list[int] = []
        for _ in range(10 if source is not None else 0):
            self._value = 2 * self._value + self._next()

    def code(self, bit: bool, context: int) -> bool:
        """Write a bit and return it, or return the next decoded bit."""
        zeros, total = self._zeros[context], self._total[context]
        p = (2 * _RANGE * zeros + total) // (2 * total)  # rounded, of _RANGE
        width = self._high - self._low
        border = self._low + min(max(width * p // _RANGE, 1), width - 1)
        if self._source is not None:
            bit = self._value >= border
        if bit:
            self._low = border
        else:
            self._high = border
            self._zeros[context] += 1
        self._total[context] += 1
        while True:
            if self._high <= _RANGE // 2:
                shift = 0
                self._put(0)
            elif self._low >= _RANGE // 2:
                shift = _RANGE // 2
                self._put(1)
            elif self._low >= _RANGE // 4 and self._high <= 3 * _RANGE // 4:
                shift = _RANGE // 4
                self._pending += 1
            else:
                return bit
            self._low, self._high = 2 * (self._low - shift), 2 * (self._high - shift)
            if self._source is not None:
                self._value = 2 * (self._value - shift) + self._next()

    def _put(self, bit: int) -> None:
        self._bits += [bit] + [1 - bit] * self._pending
        self._pending = 0

    def _next(self) -> int:
        """Return the next bit of the input; the input is padded with zeros."""
        source, position = self._source or (), self._position
        self._position += 1
        return source[position] if position < len(source) else 0

    def finish(self) -> bytes:
        """Return the encoded bytes. A final bit of 1 selects the middle of the interval; zeros may follow."""
        return np.packbits([*self._bits, 1]).tobytes()
