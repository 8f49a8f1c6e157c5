"""float64 arrays as `.npy` (format 1.0), read without evaluating their header."""

import io
import math

import numpy as np
from numpy.typing import NDArray

DTYPE = "<f8"


def dump(array: NDArray[np.float64]) -> bytes:
    """Return the bytes of an array, in C order."""
    return _header(array.shape) + np.ascontiguousarray(array, dtype=DTYPE).tobytes()


def parse(data: bytes, shape: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Return the array of the announced shape; read-only.

    The header is compared with the one such an array has: nothing in it is evaluated or unpickled, and
    nothing is allocated for a shape that the data do not fill.

    Raises
    ------
    ValueError
        If the data are not such an array, or one holds NaN or infinity.
    """
    start = 10 + int.from_bytes(data[8:10], "little")
    if data[:8] != b"\x93NUMPY\x01\x00" or data[10:start].split() != _header(shape)[10:].split():
        raise ValueError(f"{where}: its header is not that of {DTYPE}, shape {shape}; the rule is the same")
    if len(data) - start != 8 * math.prod(shape):
        raise ValueError(f"{where}: holds {len(data) - start} bytes; the rule is {8 * math.prod(shape)}")
    array = np.frombuffer(data, dtype=DTYPE, offset=start).reshape(shape)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{where}: holds NaN or infinity; the rule is finite values")
    return array.astype(np.float64, copy=False)


def _header(shape: tuple[int, ...]) -> bytes:
    buffer = io.BytesIO()
    fields = {"descr": DTYPE, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, fields)
    return buffer.getvalue()
