"""The wavelet bands of MPEG haptics: a block of samples as a few bytes, and back.

A block is transformed (biorthogonal wavelets of 9 and 7 taps, mirrored at both ends), its coefficients are
rounded against the largest, and their bit planes written from the highest on, zero trees first (SPIHT); each
bit passes an adaptive arithmetic coder of 10 bits with seven contexts. One walk through the planes serves
writing and reading: the coder returns the bit that is to be believed.

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
"""Coefficients left of the lowest band."""
PLANES = 10
"""Bits of the largest coefficient, by default."""
MOST_PLANES = 15
LARGEST = 16.875
"""What a stream can state as the largest coefficient."""
_RANGE = 1024
"""Of the arithmetic coder: 10 bits."""
_PLANES_BITS, _LARGEST_BITS = 4, 7
# pywt pads all four with zeros to one length; without them they are symmetric
_LOW, _HIGH, _LOW_BACK, _HIGH_BACK = (np.trim_zeros(taps) for taps in pywt.Wavelet("bior4.4").filter_bank)


class _Context(IntEnum):
    """Of the head, a sign, a single coefficient, a set's first generation, one of it, those beyond, a bit."""

    HEAD, SIGN, LOOSE, CHILDREN, CHILD, BEYOND, REFINE = range(7)


def transform(block: Samples) -> Samples:
    """Return the wavelet coefficients (n,) of a block (n,), coarsest first; n a power of two, 16 at least."""
    rest, bands = np.asarray(block, dtype=np.float64), []
    while rest.size > COARSEST:
        bands.append(ndimage.correlate1d(rest, _HIGH, mode="mirror")[1::2])
        rest = ndimage.correlate1d(rest, _LOW, mode="mirror")[::2]
    return np.concatenate([rest, *bands[::-1]])


def inverse(coefficients: Samples) -> Samples:
    """Return the block (n,) of wavelet coefficients (n,)."""
    rest = np.asarray(coefficients[:COARSEST], dtype=np.float64)
    while rest.size < coefficients.size:
        low, high = np.zeros((2, 2 * rest.size))
        low[::2], high[1::2] = rest, coefficients[rest.size : 2 * rest.size]
        rest = ndimage.correlate1d(low, _LOW_BACK, mode="mirror")
        rest += ndimage.correlate1d(high, _HIGH_BACK, mode="mirror")
    return np.asarray(rest)


def encode(coefficients: Samples, planes: int = PLANES) -> bytes:
    """Return the stream of wavelet coefficients (n,) none of which exceeds `LARGEST`; b"" of silence."""
    largest = float(np.abs(coefficients).max())
    steps = math.ceil(largest * 2**_LARGEST_BITS)
    above_1 = steps >= 2**_LARGEST_BITS
    if above_1:
        steps = math.ceil((largest - 1) * 8)
    stated = steps / 8 + 1 if above_1 else steps / 2**_LARGEST_BITS
    whole = np.rint(coefficients * (2.0**planes / (stated or 1.0))).astype(np.int64)
    if not whole.any():
        return b""
    coder = _Coder()
    _write_number(coder, planes, _PLANES_BITS)
    coder.code(above_1, _Context.HEAD)
    _write_number(coder, steps, _LARGEST_BITS)
    _walk(whole, planes, coder)
    return coder.closed()


def decode(stream: bytes, n: int) -> Samples:
    """Return the wavelet coefficients (n,) of a stream; any bytes mean something, at most n numbers."""
    if not stream:
        return np.zeros(n)
    coder = _Coder(np.unpackbits(np.frombuffer(stream, dtype=np.uint8)).tolist())
    planes = _read_number(coder, _PLANES_BITS)
    above_1 = coder.code(False, _Context.HEAD)
    steps = _read_number(coder, _LARGEST_BITS)
    stated = steps / 8 + 1 if above_1 else steps / 2**_LARGEST_BITS
    return _walk(np.zeros(n, dtype=np.int64), planes, coder) * (stated / 2.0**planes)


def _write_number(coder: "_Coder", value: int, n_bits: int) -> None:
    for i in range(n_bits):
        coder.code(bool(value >> i & 1), _Context.HEAD)


def _read_number(coder: "_Coder", n_bits: int) -> int:
    return sum(coder.code(False, _Context.HEAD) << i for i in range(n_bits))


def _walk(true: NDArray[np.int64], top: int, coder: "_Coder") -> NDArray[np.int64]:
    """Pass the bit planes of numbers (n,) to the coder, and return what it takes them for.

    The children of coefficient i are 2i and 2i + 1, one scale finer at the same place.
    """
    n, size = true.size, np.abs(true)
    below, beyond = _largest_descendants(size)
    found, known = np.zeros(n, dtype=np.int64), list[int]()
    loose = list(range(2 * COARSEST))
    sets = [(i, False) for i in range(COARSEST, 2 * COARSEST)]  # root, whether only grandchildren on

    def is_found(i: int, context: int) -> bool:
        if not coder.code(bool(size[i] >= level), context):
            return False
        found[i] = level if coder.code(bool(true[i] >= 0), _Context.SIGN) else -level
        known.append(i)
        return True

    for plane in range(top, -1, -1):
        level, n_known = 1 << plane, len(known)
        loose = [i for i in loose if not is_found(i, _Context.LOOSE)]
        queue, sets = deque(sets), []
        while queue:
            i, far = queue.popleft()
            largest, context = (beyond, _Context.BEYOND) if far else (below, _Context.CHILDREN)
            if not coder.code(bool(largest[i] >= level), context):
                sets.append((i, far))
            elif far:
                queue.extend([(2 * i, False), (2 * i + 1, False)])
            else:
                loose.extend([child for child in (2 * i, 2 * i + 1) if not is_found(child, _Context.CHILD)])
                if 4 * i + 3 < n:
                    queue.append((i, True))
        for i in known[:n_known]:
            if coder.code(bool(size[i] >> plane & 1), _Context.REFINE):
                found[i] += level if found[i] > 0 else -level
    return found


def _largest_descendants(size: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the largest of all descendants, and of grandchildren on, of each coefficient that has them."""
    n = size.size
    below, beyond = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    first = n // 4
    while first >= COARSEST:
        children = slice(2 * first, 4 * first)
        beyond[first : 2 * first] = below[children].reshape(-1, 2).max(axis=1)
        family = np.maximum(size[children], below[children])
        below[first : 2 * first] = family.reshape(-1, 2).max(axis=1)
        first //= 2
    return below, beyond


class _Coder:
    """An adaptive arithmetic coder: writes bits, or reads them where it is given some (0 and 1).

    The interval [low, high) is split by how often a 0 came in the context; it doubles as often as it fits
    into a half, or into the middle half (a bit is then pending until it is clear which).
    """

    def __init__(self, given: Sequence[int] | None = None) -> None:
        self._low, self._high, self._pending = 0, _RANGE, 0
        self._zeros, self._total = [8] * len(_Context), [16] * len(_Context)
        self._given, self._place, self._value = given, 0, 0
        self._bits: list[int] = []
        for _ in range(10 if given is not None else 0):
            self._value = 2 * self._value + self._next()

    def code(self, bit: bool, context: int) -> bool:
        """Write a bit and return it, or return the one that is read."""
        zeros, total = self._zeros[context], self._total[context]
        p = (2 * _RANGE * zeros + total) // (2 * total)  # rounded, of _RANGE
        width = self._high - self._low
        border = self._low + min(max(width * p // _RANGE, 1), width - 1)
        if self._given is not None:
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
            if self._given is not None:
                self._value = 2 * (self._value - shift) + self._next()

    def _put(self, bit: int) -> None:
        self._bits += [bit] + [1 - bit] * self._pending
        self._pending = 0

    def _next(self) -> int:
        """Return the next bit that was given; beyond the end there are zeros."""
        given, place = self._given or (), self._place
        self._place += 1
        return given[place] if place < len(given) else 0

    def closed(self) -> bytes:
        """Return what was written: the middle always lies in the interval, and its further bits are zeros."""
        return np.packbits([*self._bits, 1]).tobytes()
