"""Find the recordings of dataset cards, download published recordings, and compute hashes of files."""

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
    """The recordings of a card are missing; the message names their source and the expected folder."""


def data_roots(card_path: Path | None = None) -> tuple[Path, ...]:
    """Return the folders that may contain a card's folder, in order of preference.

    These are $TEXCLASS_DATA if it is set, the user's data folder, and the folder of the card itself.
    """
    environment_root = os.environ.get("TEXCLASS_DATA")
    roots = [Path(environment_root).expanduser()] if environment_root else []
    roots.append(platformdirs.user_data_path("texclass"))
    return (*roots, card_path.parent) if card_path else tuple(roots)


def find_folder(card: StoredCard) -> Path:
    """Return the folder with the recordings of a card.

    The recordings of a card without the key `folder` are in the folder of the card itself.

    Raises
    ------
    DataNotFoundError
        If no data root contains the folder.
    """
    if not card.folder:
        return card.path.parent
    candidates = [root / card.folder for root in data_roots(card.path)]
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    advice = f"Get them from {card.source or 'their owner'} and put them into this folder"
    if card.download:
        name = card.name if card.name in shipped.names("datasets") else card.path
        advice = f"Download them with `texclass datasets get {name}`"
    raise DataNotFoundError(
        f"{card.name}: its recordings are not on this machine. Expected {' or '.join(map(str, candidates))}. "
        f"{advice}, or set TEXCLASS_DATA to the folder that contains them"
    )


def is_outside(path: Path, roots: Iterable[Path]) -> bool:
    """Return whether a path is outside all of the given folders; symbolic links are not followed."""
    absolute = Path(os.path.abspath(path))
    return not any(absolute.is_relative_to(os.path.abspath(root)) for root in roots)


def fetch_recordings(
    name_or_path: str | Path, progress: Callable[[int, int, str], None] = lambda n_done, n_total, label: None
) -> Path:
    """Download the published recordings of a card into the data folder.

    Files that already exist are kept, so an interrupted download can be continued by calling the function
    again. If all files exist, no network access is needed.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped card, or path of a card with the table `[download]`. A file NAME.sha256 in the same
        folder lists the files.
    progress : callable, optional
        Callback `progress(n_done, n_total, name)`: numbers of finished and of all files, name of the card.

    Returns
    -------
    Path
        Folder of the recordings.

    Raises
    ------
    CardError
        If the card has no table `[download]`, or its list of files is invalid.
    ValueError
        If the SHA-256 of a file differs from the list, or the SHA-256 of all converted files differs from the
        card.
    OSError
        If a file cannot be downloaded or written.
    """
    card = read_card(name_or_path)
    if not isinstance(card, StoredCard) or card.download is None:
        advice = f"Get them from {card.source}" if card.source else "Ask their owner"
        problem = "cannot download its recordings, because the card has no table [download]"
        raise CardError(f"{card.path}: {problem}. {advice}")
    download, root = card.download, data_roots()[0] / card.folder
    partial_root = root if root.is_dir() else root.with_name(f"{root.name}.unfinished")
    files = _read_checksums(card.path.with_suffix(".sha256"), partial_root)
    missing = {name: sources for name, sources in files.items() if not (partial_root / name).is_file()}
    cache = cache_root() / "published" / card.name
    try:
        for n_done, (name, sources) in enumerate(missing.items(), len(files) - len(missing)):
            progress(n_done, len(files), card.name)
            paths = [_fetch_file(download.url, source, sha256, cache) for source, sha256 in sources]
            write_atomic(partial_root / name, convert_files(paths, download.convert, card.fs_hz))
        sha256 = digest_files(partial_root, files, "")
    except OSError:
        if partial_root != root and root.is_dir():  # another process has finished the download
            shutil.rmtree(partial_root, ignore_errors=True)
            return fetch_recordings(name_or_path, progress)
        raise
    if sha256 != download.sha256:
        raise ValueError(
            f"{partial_root}: the SHA-256 of the {len(files)} files is {sha256}. Expected {download.sha256}, "
            "as in the card. Remove the folder and download the recordings again"
        )
    if partial_root != root:
        try:
            partial_root.rename(root)
        except OSError:
            if not root.is_dir():
                raise
            shutil.rmtree(partial_root, ignore_errors=True)
    shutil.rmtree(cache, ignore_errors=True)
    return root


def _read_checksums(path: Path, root: Path) -> dict[str, list[tuple[str, str]]]:
    """Return the published files (name, SHA-256) from which each file of the dataset is converted.

    Each line contains the SHA-256, the published name and, if it differs, the name in the dataset, separated
    by tabs.
    """
    files: dict[str, list[tuple[str, str]]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        sha256, *names = line.split("\t")
        is_inside = not any(is_outside(root / name, (root,)) for name in names)
        if not (re.fullmatch("[0-9a-f]{64}", sha256) and len(names) in {1, 2} and is_inside):
            raise CardError(
                f"{path}: line {number} is {line!r:.99}. Expected SHA-256, published file and "
                "file in the dataset, separated by tabs"
            )
        files.setdefault(names[-1], []).append((names[0], sha256))
    return files


def _fetch_file(url: str, source: str, sha256: str, folder: Path) -> Path:
    """Return the path of a published file in a folder; download it first if it is missing."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    (folder / source).parent.mkdir(parents=True, exist_ok=True)  # pooch fails if another process creates it
    files = pooch.create(folder, url, registry={source: f"sha256:{sha256}"}, retry_if_failed=2)
    try:
        return Path(files.fetch(source, downloader=pooch.HTTPDownloader(timeout=60)))
    except OSError as error:
        raise OSError(
            f"{url}{source}: cannot be downloaded ({error}). Finished files are kept: run the same command "
            "again to continue"
        ) from error


def convert_files(paths: list[Path], convert: Convert, fs: float) -> bytes:
    """Convert published files to one file of the dataset.

    Parameters
    ----------
    paths : list of Path
        Published files.
    convert : {"", "frames", "rounded", "counts", "sheets"}
        "" copies the file. "frames" writes columns 5 to 26 of a table, row by row, as WAV: 22 samples per
        frame (BioTac). "rounded" rounds a table to five decimals. "counts" takes the first six of ten
        unnamed columns at 50 Hz, where the last column is the time in ms. "sheets" joins workbooks with one
        column each into a table.
    fs : float
        Sampling rate in Hz of a WAV file.

    Returns
    -------
    bytes
        Content of the converted file.
    """
    import pandas as pd
    from scipy.io import wavfile  # slow import, only needed for downloads

    match convert:
        case "":
            return paths[0].read_bytes()
        case "frames":
            frames = np.loadtxt(paths[0], delimiter=",", skiprows=1, usecols=range(4, 26))
            sound = io.BytesIO()
            wavfile.write(sound, round(fs), np.rint(frames).astype(np.int16).ravel())
            return sound.getvalue()
        case "rounded":
            table, number_format = pd.read_csv(paths[0]).round(5), None
        case "counts":
            log = pd.read_csv(paths[0], header=None)
            step = round(20 / log[9].diff().median())
            counts = log.iloc[::step, :6].set_axis(["ax", "ay", "az", "wx", "wy", "wz"], axis=1)
            table, number_format = counts.astype(float), "%.0f"  # one value, 1e26, exceeds integers
        case "sheets":
            columns = []
            for path in paths:
                with zipfile.ZipFile(path) as book:
                    cells = re.findall(rb"<v>([^<]*)</v>", book.read("xl/worksheets/sheet1.xml"))
                columns.append(np.array(cells, dtype=float))
            names = ("acceleration", "normal_force", "speed")
            table, number_format = pd.DataFrame(dict(zip(names, columns, strict=True))), None
    return table.to_csv(index=False, lineterminator="\n", float_format=number_format).encode()


def digest_files(root: Path, names: Iterable[str], settings: str) -> str:
    """Return the SHA-256 hex digest of settings and of the names and contents of files."""
    return combine_digests(file_digests(root, names), settings)


def combine_digests(digests: Mapping[str, str], settings: str) -> str:
    """Return the SHA-256 hex digest of settings and of the names and digests of files."""
    digest = hashlib.sha256(settings.encode())
    for name, file_digest in digests.items():
        digest.update(f"\0{name}\0{file_digest}".encode())
    return digest.hexdigest()


def file_digests(root: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 hex digest of each file, sorted by name.

    Digests are cached by name, size and modification time, because reading gigabytes takes seconds. A change
    that preserves size and modification time is not detected.
    """
    names = sorted(set(names))
    states = hashlib.sha256(str(root.resolve()).encode())
    for name in names:
        state = (root / name).stat()
        states.update(f"\0{name}\0{state.st_size}\0{state.st_mtime_ns}".encode())
    cache_file = cache_root() / "digests" / states.hexdigest()
    try:
        digests = cache_file.read_text(encoding="ascii").split()
    except (OSError, UnicodeDecodeError):
        digests = []
    if len(digests) != len(names):
        digests = []
        for name in names:
            with (root / name).open("rb") as file:
                digests.append(hashlib.file_digest(file, "sha256").hexdigest())
        write_if_possible(cache_file, "\n".join(digests).encode("ascii"))
    return dict(zip(names, digests, strict=True))
