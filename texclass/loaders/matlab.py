"""Read numeric arrays, also those in structs, from MATLAB files of versions 5 to 7.2; objects are not read.

A file is a sequence of elements. Each element is a tag with type and size (eight or four bytes), followed by
data padded to a multiple of eight bytes (MathWorks, "MAT-File Format"). This module exists for two reasons:
scipy stops at variables of object classes (datetime, table), and scipy up to 1.17 uses the type of numbers as
an unchecked index in compiled code, so one corrupt byte can crash the process.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.readers import check_announced_size

MAX_DEPTH, MAX_MEMBERS = 32, 10_000
"""Largest depth of nested groups or structs, and largest number of members of one."""
NUMERIC = ("double", "single", *(f"{sign}int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "u")))
"""MATLAB classes of arrays of numbers."""
_CLASSES = (
    *("", "cell", "struct", "object", "char", "sparse", *NUMERIC),
    *("function_handle", "opaque", "object"),
)
"""MATLAB classes by code."""
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy types of numbers by code."""
_MATRIX, _COMPRESSED = 14, 15
Bytes = NDArray[np.uint8]


class StoredArray(NamedTuple):
    """Array or other object stored in a file."""

    name: str
    kind: str
    """Class of an object; "" for an array of real numbers."""
    size: int = 0
    values: Callable[[], Any] = lambda: None
    """Function that reads the values of an array of real numbers."""
    is_attribute: bool = False


def matlab_5_arrays(path: Path) -> Iterator[StoredArray]:
    """Yield the variables of a file, and the fields of single structs as `struct.field`.

    Raises
    ------
    ValueError
        If the file is damaged.
    zlib.error
        If a compressed variable is damaged.
    RecordingError
        If a variable announces more values than the size of the file allows.
    """
    data: Bytes = np.memmap(path, np.uint8, "r")
    order, at = "<" if bytes(data[126:128]) == b"IM" else ">", 128  # after the header
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}2I", data.data, at)
        stored = data[at + 8 : at + 8 + size]
        if len(stored) < size or kind not in {_MATRIX, _COMPRESSED}:
            problem = f"type {kind}, {len(stored)} of {size} bytes"
            raise ValueError(f"the variable at byte {at} is damaged or truncated: {problem}")
        at += 8 + size
        read_all = (
            partial(_inflate, stored, order, path) if kind == _COMPRESSED else partial(np.asarray, stored)
        )
        # Flags, dimensions and name of an array take up a few hundred bytes.
        head = _inflate(stored, order, path, 4096) if kind == _COMPRESSED else stored
        yield from _find_arrays(head, read_all, order)


def _inflate(stored: Bytes, order: str, path: Path, max_bytes: int = 0) -> Bytes:
    """Return a decompressed variable, or its first `max_bytes` bytes, without its tag."""
    inflater = zlib.decompressobj()
    tag = inflater.decompress(stored.data, 8)
    kind, size = struct.unpack(f"{order}2I", tag)
    if kind != _MATRIX:
        raise ValueError(f"a compressed element has type {kind}. Expected {_MATRIX}, an array")
    check_announced_size(size // 8, path)
    inflated = inflater.decompress(inflater.unconsumed_tail, min(max_bytes, size) or size)
    if not max_bytes and len(inflated) < size:
        raise ValueError(f"a compressed variable is truncated: {len(inflated)} of {size} bytes")
    return np.frombuffer(inflated, np.uint8)


def _find_arrays(
    head: Bytes, read_all: Callable[[], Bytes], order: str, name: str = "", depth: int = 1
) -> Iterator[StoredArray]:
    """Yield the array in a variable, or the arrays in a struct, from the first bytes of the variable."""
    _, flags_at, _, at = _element(head, order, 0)
    (flags,) = struct.unpack_from(f"{order}I", head.data, flags_at)
    matlab_class = dict(enumerate(_CLASSES)).get(flags & 0xFF, "unknown")
    if matlab_class == "opaque":  # has name, type system and class instead of dimensions
        texts = []
        for _ in range(3):
            _, start, size, at = _element(head, order, at)
            texts.append(_text(head[start : start + size]))
        if texts[1] == "MCOS" or texts[0]:
            yield StoredArray(name or texts[0], texts[2] or "object")
        return
    kind, start, size, at = _element(head, order, at)
    if kind not in {5, 6} or size % 4:  # 32-bit integers
        raise ValueError(f"the dimensions of an array are of type {kind}")
    shape = tuple(map(int, head[start : start + size].view(f"{order}i4")))
    _, start, size, at = _element(head, order, at)
    name = name or _text(head[start : start + size])
    if min(shape, default=0) < 0:
        raise ValueError(f"{name} has shape {shape}")
    if not name:
        return  # internal variable of MATLAB
    if matlab_class == "struct" and math.prod(shape) == 1:
        yield from _fields(read_all(), at, order, name, depth)
        return
    is_complex, is_logical = flags & 0x800, flags & 0x200
    if matlab_class in NUMERIC:
        matlab_class = "complex" if is_complex else "logical" if is_logical else ""
    size = math.prod(shape)
    yield StoredArray(name, matlab_class, size, lambda: _numbers(read_all(), at, order, name, shape))


def _fields(data: Bytes, at: int, order: str, name: str, depth: int) -> Iterator[StoredArray]:
    """Yield the fields of a struct, which contains names of equal length, then one array per field."""
    _, start, _, at = _element(data, order, at)
    (length,) = struct.unpack_from(f"{order}i", data.data, start)
    _, start, size, at = _element(data, order, at)
    n_fields = size // length if length > 0 else 0
    if depth > MAX_DEPTH or n_fields > MAX_MEMBERS:
        raise ValueError(
            f"a struct at nesting level {depth} has {n_fields} fields. Expected at most {MAX_DEPTH} levels "
            f"and {MAX_MEMBERS} fields per struct"
        )
    for i in range(n_fields):
        field = _text(data[start + i * length : start + (i + 1) * length])
        kind, begin, size, at = _element(data, order, at)
        if kind != _MATRIX:
            raise ValueError(f"{name}.{field} is an element of type {kind}. Expected {_MATRIX}, an array")
        if size:
            stored = data[begin : begin + size]
            yield from _find_arrays(stored, partial(np.asarray, stored), order, f"{name}.{field}", depth + 1)


def _numbers(data: Bytes, at: int, order: str, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the values of an array; they may be stored in a smaller type than its class."""
    kind, start, size, _ = _element(data, order, at)
    if kind not in _TYPES:
        raise ValueError(f"the numbers of {name} are of type {kind}. Expected one of {sorted(_TYPES)}")
    values = data[start : start + size]
    if size != math.prod(shape) * np.dtype(_TYPES[kind]).itemsize:
        raise ValueError(f"{name} has shape {shape}, which does not match its size of {size} bytes")
    return values.view(f"{order}{_TYPES[kind]}").astype(np.float64).reshape(shape, order="F")


def _element(data: Bytes, order: str, at: int) -> tuple[int, int, int, int]:
    """Return type, start and size of the data of an element, and the start of the next element."""
    if at + 8 > len(data):
        raise ValueError("a variable ends within an element")
    kind, size = struct.unpack_from(f"{order}2I", data.data, at)
    start, following = at + 8, at + 8 + size + -size % 8
    if kind >> 16:
        kind, size, start, following = kind & 0xFFFF, kind >> 16, at + 4, at + 8
    if start + size > len(data) or (start == at + 4 and size > 4):
        raise ValueError("a variable ends within an element")
    return kind, start, size, following


def _text(data: Bytes) -> str:
    return bytes(data).partition(b"\0")[0].decode("latin1")
