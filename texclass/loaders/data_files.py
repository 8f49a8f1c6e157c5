"""Which files of a folder can be data, and how their names are compared."""

import unicodedata
from pathlib import Path


def data_files(folder: Path) -> list[Path]:
    """Return the files in a folder and below it, sorted, without hidden and system files."""
    return [
        path
        for path in sorted(folder.rglob("*"))
        if not any(map(is_hidden, path.relative_to(folder).parts)) and path.is_file()
    ]


def is_hidden(name: str) -> bool:
    """Whether the name of a file or folder begins with a dot or is one of the operating system."""
    of_systems = ("__macosx", "thumbs.db", "desktop.ini")
    return name.startswith(".") or name.lower() in of_systems


def normalize_name(name: str) -> str:
    """Return a name in Unicode normal form C: macOS stores "ü" as two characters, others as one."""
    return unicodedata.normalize("NFC", name)
