"""Which files of a folder can be data, and how their names are compared."""

import unicodedata
from pathlib import Path

SYSTEM_NAMES = ("__macosx", "thumbs.db", "desktop.ini")
"""Names of files and folders of macOS and Windows, in lower case, that do not begin with a dot."""


def data_files(folder: Path) -> list[Path]:
    """Return the files in a folder and below it, sorted, without hidden and system files."""
    return [
        path
        for path in sorted(folder.rglob("*"))
        if not any(map(is_hidden, path.relative_to(folder).parts)) and path.is_file()
    ]


def is_hidden(name: str) -> bool:
    """Whether the name of a file or folder begins with a dot or is one of the operating system."""
    return name.startswith(".") or name.lower() in SYSTEM_NAMES


def composed(name: str) -> str:
    """Return a name in Unicode normal form C: macOS stores "ü" as two characters, others as one."""
    return unicodedata.normalize("NFC", name)
