"""Listing of the data files in a folder, and normalisation of their names."""

import unicodedata
from pathlib import Path

PHASES_SUFFIX = ".phases.json"
"""End of the names of files with the phases that a user marked."""


def data_files(folder: Path) -> list[Path]:
    """Return the files in a folder and its subfolders, sorted, without hidden, system and phases files."""
    return [
        path
        for path in sorted(folder.rglob("*"))
        if not any(map(is_hidden, path.relative_to(folder).parts))
        and not path.name.endswith(PHASES_SUFFIX)
        and path.is_file()
    ]


def is_hidden(name: str) -> bool:
    """Return whether the name of a file or folder is that of a hidden or operating-system file."""
    system_names = ("__macosx", "thumbs.db", "desktop.ini")
    return name.startswith(".") or name.lower() in system_names


def normalize_name(name: str) -> str:
    """Return a name in Unicode normal form C; macOS stores "ü" as two characters, other systems as one."""
    return unicodedata.normalize("NFC", name)
