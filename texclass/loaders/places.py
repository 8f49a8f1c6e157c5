"""Where the recordings of cards are on this machine, how they get there, and a digest that tells a change."""

import hashlib
import io
import os
import re
import shutil
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import platformdirs

from texclass import shipped
from texclass.atomic_write import cache_root, write_atomic, write_if_possible
from texclass.loaders.cards import CardError, Convert, StoredCard, read_card


class DataNotFoundError(FileNotFoundError):
    """The recordings of a card are not on this machine; the message says where to get and to put them."""


def data_roots(card_path: Path | None = None) -> tuple[Path, ...]:
    """Return the folders in which a card's folder is looked for, in order.

    They are $TEXCLASS_DATA if it is set, the user's data folder, and the folder of the card itself.
    """
    stated = os.environ.get("TEXCLASS_DATA")
    roots = [Path(stated).expanduser()] if stated else []
    roots.append(platformdirs.user_data_path("texclass"))
    return (*roots, card_path.parent) if card_path else tuple(roots)


def find_folder(card: StoredCard) -> Path:
    """Return the folder that holds a card's recordings: its own where it names none.

    Raises
    ------
    DataNotFoundError
        If it is in none of the places.
    """
    if not card.folder:
        return card.path.parent
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


def is_outside(path: Path, roots: Iterable[Path]) -> bool:
    """Whether a name (with `..` in it, or absolute) is of none of some folders; links are not followed."""
    inside = Path(os.path.abspath(path))
    return not any(inside.is_relative_to(os.path.abspath(root)) for root in roots)


def fetch_recordings(
    name_or_path: str | Path, progress: Callable[[int, int, str], None] = lambda done, total, what: None
) -> Path:
    """Fetch the recordings of a card into the user's folder of data, file by file; those that are there stay.

    What was broken off goes on when it is asked for again; what is complete needs no network.

    Parameters
    ----------
    name_or_path : str or Path
        A shipped card, or the path of one's own, whose `[published]` says where the files are; beside it,
        NAME.sha256 lists them.
    progress : callable, optional
        Given the number of files that are done, of all files, and what is fetched.

    Returns
    -------
    Path
        The folder of the recordings.

    Raises
    ------
    CardError
        If the card does not say where its files are, or its list breaks a rule.
    ValueError
        If a file is not the one that was published (its SHA-256), or what was made of them not what the card
        says.
    OSError
        If a file cannot be fetched or written.
    """
    card = read_card(name_or_path)
    if not isinstance(card, StoredCard) or card.published is None:
        where = f"they are at {card.source}" if card.source else "ask their owner"
        raise CardError(f"{card.path}: its recordings cannot be fetched, as it has no [published]; {where}")
    published, root = card.published, data_roots()[0] / card.folder
    begun = root if root.is_dir() else root.with_name(f"{root.name}.unfinished")
    files = _read_checksums(card.path.with_suffix(".sha256"), begun)
    lacking = {made: sources for made, sources in files.items() if not (begun / made).is_file()}
    fetched = cache_root() / "published" / card.name
    try:
        for done, (made, sources) in enumerate(lacking.items(), len(files) - len(lacking)):
            progress(done, len(files), card.name)
            paths = [_fetch_file(published.url, source, sha256, fetched) for source, sha256 in sources]
            write_atomic(begun / made, convert_files(paths, published.convert, card.fs_hz))
        found = digest_files(begun, files, "")
    except OSError:
        if begun != root and root.is_dir():  # another process has finished, and removed what this one fetched
            shutil.rmtree(begun, ignore_errors=True)
            return fetch_recordings(name_or_path, progress)
        raise
    if found != published.sha256:
        raise ValueError(
            f"{begun}: the SHA-256 over {len(files)} files is {found}. Expected {published.sha256}, as "
            "the card says: remove the folder and get it again"
        )
    if begun != root:
        try:
            begun.rename(root)
        except OSError:
            if not root.is_dir():
                raise
            shutil.rmtree(begun, ignore_errors=True)
    shutil.rmtree(fetched, ignore_errors=True)
    return root


def _read_checksums(path: Path, root: Path) -> dict[str, list[tuple[str, str]]]:
    """Return file of the card's layout -> the published files that it is made of, and their SHA-256.

    A line is the digest, the file as it is published and, where that has another name here, the name here;
    tabs are between them.
    """
    files: dict[str, list[tuple[str, str]]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        sha256, *names = line.split("\t")
        is_inside = not any(is_outside(root / name, (root,)) for name in names)
        if not (re.fullmatch("[0-9a-f]{64}", sha256) and len(names) in {1, 2} and is_inside):
            raise CardError(f"{path}: line {number} is {line!r:.99}. Expected SHA-256, file, file here")
        files.setdefault(names[-1], []).append((names[0], sha256))
    return files


def _fetch_file(url: str, source: str, sha256: str, folder: Path) -> Path:
    """Return a published file, fetched unless it is there."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    (folder / source).parent.mkdir(parents=True, exist_ok=True)  # pooch fails if another process makes it
    files = pooch.create(folder, url, registry={source: f"sha256:{sha256}"}, retry_if_failed=2)
    try:
        return Path(files.fetch(source, downloader=pooch.HTTPDownloader(timeout=60)))
    except OSError as error:
        told = f"{url}{source}: cannot be fetched ({error})"
        raise OSError(f"{told}; what was fetched is kept, the same command goes on") from error


def convert_files(paths: list[Path], convert: Convert, fs: float) -> bytes:
    """Return the file that a card reads, made of published ones as its `convert` says.

    "frames": what stands in columns 5 to 26 of a table, row by row, as sound: 22 samples a frame (BioTac).
    "rounded": a table with five decimals. "counts": the first six of ten columns without names, at 50 Hz; the
    last is the time in ms. "sheets": workbooks of one column each as a table.
    """
    import pandas as pd
    from scipy.io import wavfile  # a second, which only fetching waits for

    match convert:
        case "":
            return paths[0].read_bytes()
        case "frames":
            frames = np.loadtxt(paths[0], delimiter=",", skiprows=1, usecols=range(4, 26))
            sound = io.BytesIO()
            wavfile.write(sound, round(fs), np.rint(frames).astype(np.int16).ravel())
            return sound.getvalue()
        case "rounded":
            table, form = pd.read_csv(paths[0]).round(5), None
        case "counts":
            felt = pd.read_csv(paths[0], header=None)
            step = round(20 / felt[9].diff().median())
            counts = felt.iloc[::step, :6].set_axis(["ax", "ay", "az", "wx", "wy", "wz"], axis=1)
            table, form = counts.astype(float), "%.0f"  # one is 1e26, beyond whole numbers
        case "sheets":
            columns = []
            for path in paths:
                with zipfile.ZipFile(path) as book:
                    cells = re.findall(rb"<v>([^<]*)</v>", book.read("xl/worksheets/sheet1.xml"))
                columns.append(np.array(cells, dtype=float))
            names = ("acceleration", "normal_force", "speed")
            table, form = pd.DataFrame(dict(zip(names, columns, strict=True))), None
    return table.to_csv(index=False, lineterminator="\n", float_format=form).encode()


def digest_files(root: Path, relative: Iterable[str], facts: str) -> str:
    """Return the SHA-256 hex digest of facts, names and contents of files."""
    return combine_digests(file_digests(root, relative), facts)


def combine_digests(digests: Mapping[str, str], facts: str) -> str:
    """Return the SHA-256 hex digest of facts, and of names and digests of files."""
    digest = hashlib.sha256(facts.encode())
    for name, of_file in digests.items():
        digest.update(f"\0{name}\0{of_file}".encode())
    return digest.hexdigest()


def file_digests(root: Path, relative: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 hex digest of each file, sorted by name.

    Reading gigabytes takes seconds, so digests are kept in the cache under names, sizes and times of
    modification: a file that was changed without changing its size and time goes unnoticed.
    """
    paths = sorted(set(relative))
    states = hashlib.sha256(str(root.resolve()).encode())
    for name in paths:
        state = (root / name).stat()
        states.update(f"\0{name}\0{state.st_size}\0{state.st_mtime_ns}".encode())
    memo = cache_root() / "digests" / states.hexdigest()
    try:
        known = memo.read_text(encoding="ascii").split()
    except (OSError, UnicodeDecodeError):
        known = []
    if len(known) != len(paths):
        known = []
        for name in paths:
            with (root / name).open("rb") as file:
                known.append(hashlib.file_digest(file, "sha256").hexdigest())
        write_if_possible(memo, "\n".join(known).encode("ascii"))
    return dict(zip(paths, known, strict=True))
