"""Simulated datasets: recordings are simulated on access and cached on disk."""

import hashlib
import io
import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from texclass.atomic_write import cache_root, write_atomic, write_if_possible
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import AUXILIARY_UNITS, Recording
from texclass.simulate.recipe import Recipe

SIGNALS = ("acceleration", *AUXILIARY_UNITS)
"""Fields of `Recording` that are stored as arrays in a cached file."""
ATTRIBUTES = (
    "fs",
    "unit",
    "recording_id",
    "surface",
    "operator",
    "repetition",
    "source",
    "channels",
    "flags",
)
"""Fields of `Recording` that are stored as JSON in a cached file."""


def load_simulated(recipe: Recipe, cache: Path, entry: Entry) -> Recording:
    """Return a simulated recording, from the cache if possible.

    A cached recording is identical, bit for bit, to a newly simulated one.

    The true phases are removed, so that they are detected as in a measured recording.

    Parameters
    ----------
    recipe : Recipe
        Settings of the simulation.
    cache : Path
        Folder of the cached recordings.
    entry : Entry
        Labels of the recording.
    """
    path = cache / f"{entry.recording_id}.npz"
    if (cached := read_cached(path)) is not None:
        return cached
    surface_index = [surface.name for surface in recipe.surfaces].index(entry.surface)
    recording = recipe.record(surface_index, entry.repetition or 0).with_(phases=None)
    write_cached(path, recording)
    return recording


def open_simulated(recipe: Recipe, **attributes: Any) -> Dataset:
    """Return the dataset of a recipe without simulating its recordings.

    Parameters
    ----------
    recipe : Recipe
        Settings of the simulation.
    **attributes
        Attributes of the `Dataset`, such as name and title.
    """
    input_hash = recipe.fingerprint()
    cache_key = hashlib.sha256(f"{input_hash} numpy {np.__version__}".encode()).hexdigest()[:16]
    return Dataset(
        entries=_entries(recipe),
        load=partial(load_simulated, recipe, cache_root() / "simulated" / cache_key),
        input_hash=input_hash,
        **attributes,
    )


def open_gestures(recipe: Recipe, gesture: str) -> Dataset:
    """Return a dataset with one gesture per recording and the surfaces and operators of a recipe.

    Parameters
    ----------
    recipe : Recipe
        Settings of the simulation; its duration is ignored, because each gesture has its own duration.
    gesture : str
        One of `texclass.simulate.GESTURES`.
    """
    input_hash = hashlib.sha256(f"{recipe.fingerprint()} {gesture}".encode()).hexdigest()
    return Dataset(gesture, _entries(recipe), partial(_simulate_gesture, recipe, gesture), input_hash)


def _entries(recipe: Recipe) -> tuple[Entry, ...]:
    return tuple(
        Entry(recording_id, surface, operator, repetition=k)
        for recording_id, surface, operator, k in recipe.entries()
    )


def _simulate_gesture(recipe: Recipe, gesture: str, entry: Entry) -> Recording:
    """Return a simulated gesture without its true phases."""
    from texclass.simulate.controlled import GESTURES, record_gesture  # numba: slow import

    i = [surface.name for surface in recipe.surfaces].index(entry.surface)
    j = [operator.name for operator in recipe.operators].index(entry.operator or "")
    seed = (recipe.seed, i, j, entry.repetition or 0, 1 + list(GESTURES).index(gesture))
    recording = record_gesture(gesture, recipe.surfaces[i], recipe.operators[j], seed=seed, fs=recipe.fs)
    return recording.with_(phases=None, recording_id=entry.recording_id, repetition=entry.repetition)


def write_sample(folder: str | Path, first: int = 1) -> tuple[Path, ...]:
    """Write a small folder of simulated recordings, to try the commands.

    There are four surfaces with six recordings each, of 4 s at 10 kHz: taps, then strokes. Each file contains
    the acceleration along the tool in m/s^2, one value per line: `folder/oak/oak_01.txt`.

    Parameters
    ----------
    folder : str or Path
        Folder to write into; created if it does not exist.
    first : int
        Number of the first recording of each surface (default 1). With 7, the recordings are numbered 7 to
        12 and continue the first six.

    Returns
    -------
    tuple of Path
        Files of all recordings.

    Raises
    ------
    ValueError
        If a file exists with other content; it is not overwritten.
    IndexError
        If `first` is not from 1 to 995.

    Examples
    --------
    >>> files = write_sample("recordings")
    >>> len(files), files[0].as_posix()
    (24, 'recordings/slate/slate_01.txt')
    """
    recipe = Recipe(n_surfaces=5, n_recordings=1000, n_operators=3, duration_s=4.0, fs=10_000, seed=2015)
    paths = []
    for name, surface_index in {"slate": 0, "oak": 2, "foam": 3, "mesh": 4}.items():
        for k in range(first, first + 6):
            along_tool = recipe.record(surface_index, k).acceleration[:, 2]
            text = "%.6g\n" * len(along_tool) % tuple(along_tool)
            path = Path(folder) / name / f"{name}_{k:02d}.txt"
            if path.exists() and path.read_bytes() != text.encode():
                raise ValueError(f"{path} exists with different content. Expected a new or empty folder")
            write_atomic(path, text)
            paths.append(path)
    return tuple(paths)


def write_cached(path: Path, recording: Recording) -> None:
    """Write a recording to the cache, unless less than 5 GB of the disk are free."""
    if shutil.disk_usage(next(folder for folder in path.parents if folder.exists())).free < 5_000_000_000:
        return
    arrays = {name: signal for name in SIGNALS if (signal := getattr(recording, name)) is not None}
    attributes = {name: getattr(recording, name) for name in ATTRIBUTES}
    buffer = io.BytesIO()
    np.savez(buffer, facts=np.array(json.dumps(attributes)), **arrays)
    write_if_possible(path, buffer.getvalue())


def read_cached(path: Path) -> Recording | None:
    """Return a cached recording; None if it is missing or damaged."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        attributes = json.loads(str(arrays.pop("facts")))
        attributes |= {name: tuple(attributes[name]) for name in ("channels", "flags")}
        return Recording(**attributes, **arrays)
    except Exception:  # whatever the damage, the recording is simulated again
        return None
