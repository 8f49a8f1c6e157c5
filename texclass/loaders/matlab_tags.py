"""Tags of MATLAB 5 files, looked at before scipy follows them.

scipy (1.17 and before) takes the type of an array's numbers for an index into a table of its own, in compiled
code that does not check it: one changed byte ends the process. Elements are laid out as in MathWorks,
"MAT-File Format", level 5: a tag of type and size, or of both in four bytes, and data padded to eight.
"""

import struct
import zlib
from collections.abc import Collection
from pathlib import Path

LONGEST_HEAD = 4096
"""Bytes of flags, dimensions and name of an array; they take some hundred."""
NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13))
"""Types of numbers: integers of 8 to 64 bits, single, double."""
_MATRIX, _COMPRESSED, _OPAQUE = 14, 15, 17
_CLASSES = range(6, 16)
"""Classes of arrays of numbers: double, single, integers."""


def check_tags(path: Path, wanted: Collection[str]) -> None:
    """Check all arrays of the wanted names, as far as scipy goes through the file.

    Raises
    ------
    ValueError
        If one is not of real numbers of a known type.
    zlib.error
        If a compressed one is damaged.
    """
    with path.open("rb") as file:
        file.seek(126)
        order = "<" if file.read(2) == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}2I", tag)
            after = file.tell() + size
            head = file.read(LONGEST_HEAD)
            if kind == _COMPRESSED:
                head = zlib.decompressobj().decompress(head, LONGEST_HEAD)
                (kind,) = struct.unpack_from(f"{order}I", head.ljust(4, b"\0"))
                head = head[8:]
            if kind != _MATRIX:
                return  # scipy refuses it
            _check_array(head.ljust(LONGEST_HEAD, b"\0"), order, wanted)
            file.seek(after)


def _check_array(head: bytes, order: str, wanted: Collection[str]) -> None:
    (flags,) = struct.unpack_from(f"{order}I", head, 8)
    if flags & 0xFF == _OPAQUE:
        return  # bears no name
    _, _, at = _element(head, order, 16)
    _, name, at = _element(head, order, at)
    shown = name.decode("latin1")
    if shown not in wanted:
        return
    if flags & 0xFF not in _CLASSES or flags >> 11 & 1:
        raise ValueError(f"{shown} is another array; the rule is real numbers")
    kind, _, _ = _element(head, order, at)
    if kind not in NUMBERS:
        raise ValueError(f"the numbers of {shown} are of type {kind}; the rule is one of {sorted(NUMBERS)}")


def _element(head: bytes, order: str, at: int) -> tuple[int, bytes, int]:
    """Return type and data of an element, and where the next one begins."""
    if at + 8 > len(head):
        raise ValueError(f"the head of an array is longer than {LONGEST_HEAD} bytes")
    first, size = struct.unpack_from(f"{order}2I", head, at)
    if first >> 16:
        return first & 0xFFFF, head[at + 4 : at + 4 + (first >> 16)], at + 8
    return first, head[at + 8 : at + 8 + size], at + 8 + size + -size % 8
