"""Named members in one file: a ZIP archive of which only the harmless part is read.

Members are stored, not compressed, so that none is larger than the file and no archive grows when it is read;
no member is ever written to disk. Everything else that ZIP offers (compression, encryption, ZIP64, comments,
folders, one name twice) is refused before a member is read.
"""

import io
import re
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path

from texclass.exchange.limited import read_limited

LARGEST_FILE = 64 << 20
"""Bytes of the largest archive that is read."""
MOST_MEMBERS = 256
_DIRECTORY_BYTES = 64 << 10
_NAME = re.compile(r"(arrays/)?[A-Za-z][A-Za-z0-9_-]{0,63}\.(json|npy)")
_EPOCH = (1980, 1, 1, 0, 0, 0)
_END = struct.Struct("<4s4H2LH")
_FAULTS = (
    zipfile.BadZipFile,
    NotImplementedError,
    RuntimeError,
    EOFError,
    struct.error,
    OverflowError,
    UnicodeError,
)


def pack(members: Mapping[str, bytes]) -> bytes:
    """Return the archive; the same members make the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, data in members.items():
            _check_name(name, "archive")
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), data)
    return buffer.getvalue()


def unpack(path: Path) -> dict[str, bytes]:
    """Return the members of an archive by name.

    Raises
    ------
    ValueError
        If it is not a ZIP archive, damaged, or uses what is refused; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    data = read_limited(path, LARGEST_FILE)
    _check_directory(data, path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_members(archive.infolist(), len(data), path)
            return {info.filename: archive.read(info) for info in archive.infolist()}
    except _FAULTS as error:
        raise ValueError(f"{path}: is damaged ({error}); the rule is a whole ZIP archive") from error


def _check_directory(data: bytes, path: Path) -> None:
    """Refuse, before anything is parsed, a directory that is not the small one at the end of the file."""
    if len(data) < _END.size or data[-_END.size :][:4] != b"PK\x05\x06":
        raise ValueError(f"{path}: does not end as a ZIP archive; the rule is a whole one without a comment")
    *_, count, size, offset, comment = _END.unpack(data[-_END.size :])
    if count > MOST_MEMBERS or size > _DIRECTORY_BYTES:
        raise ValueError(
            f"{path}: announces {count} members in a directory of {size} bytes; "
            f"the rule is at most {MOST_MEMBERS} and {_DIRECTORY_BYTES}"
        )
    if comment or offset + size + _END.size != len(data) or data[-_END.size - 20 :][:4] == b"PK\x06\x07":
        raise ValueError(f"{path}: its directory is not at its end; the rule is a plain archive, no ZIP64")


def _check_members(infos: list[zipfile.ZipInfo], size: int, path: Path) -> None:
    names = [info.filename for info in infos]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{path}: holds {twice!r:.80} twice; the rule is one member a name")
    for info in infos:
        _check_name(info.filename, path)
        if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
            raise ValueError(f"{path}: member {info.filename} is compressed; the rule is stored members")
    total = sum(info.file_size for info in infos)
    if total > size:
        raise ValueError(f"{path}: members of {total} bytes in a file of {size}; the rule is no overlap")


def _check_name(name: str, where: object) -> None:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{where}: holds {name!r:.80}; the rule is NAME.json and arrays/NAME.npy")
