"""Where recordings and caches are on this machine."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs

from texclass import shipped
from texclass.whole_files import write_whole

if TYPE_CHECKING:
    from texclass.loaders.cards import StoredCard

APPLICATION = "texclass"


class DataNotFoundError(FileNotFoundError):
    """The recordings of a card are not on this machine; the message says where to get and to put them."""


def data_roots(card_path: Path | None = None) -> tuple[Path, ...]:
    """Return the folders in which a card's folder is looked for, in order.

    They are $TEXCLASS_DATA if it is set, the user's data folder, and the folder of the card itself.
    """
    stated = os.environ.get("TEXCLASS_DATA")
    roots = [Path(stated).expanduser()] if stated else []
    roots.append(platformdirs.user_data_path(APPLICATION))
    return (*roots, card_path.parent) if card_path else tuple(roots)


def cache_root() -> Path:
    """Return the folder for what can be computed again: $TEXCLASS_CACHE, else the user's cache folder."""
    stated = os.environ.get("TEXCLASS_CACHE")
    return Path(stated).expanduser() if stated else platformdirs.user_cache_path(APPLICATION)


def find_folder(card: "StoredCard") -> Path:
    """Return the folder that holds a card's recordings.

    Raises
    ------
    DataNotFoundError
        If it is in none of the places.
    """
    candidates = [root / card.folder for root in data_roots(card.path)]
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    way = f"Get them from {card.source or 'their owner'} and put them there"
    if card.published:
        name = card.name if card.name in shipped.names("datasets") else card.path
        way = f"`texclass datasets get {name}` fetches them"
    raise DataNotFoundError(
        f"{card.name}: its recordings are not on this machine. Looked for {', '.join(map(str, candidates))}. "
        f"{way}, or set TEXCLASS_DATA to the folder that holds them"
    )


def leaves(path: Path, roots: Iterable[Path]) -> bool:
    """Whether a name (with `..` in it, or absolute) is of none of some folders; links are not followed."""
    inside = Path(os.path.abspath(path))
    return not any(inside.is_relative_to(os.path.abspath(root)) for root in roots)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a cache file so that a reader sees all of it or nothing; a full or read-only disk is no error."""
    with contextlib.suppress(OSError):
        write_whole(path, content)
