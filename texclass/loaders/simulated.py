"""Simulated datasets: recordings made when they are asked for, and remembered on disk."""

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
FACTS = ("fs", "unit", "recording_id", "surface", "operator", "repetition", "source", "channels", "flags")


def load_simulated(recipe: Recipe, cache: Path, entry: Entry) -> Recording:
    """Return one recording, from the cache or freshly made: the same to the last bit.

    The true phases are withheld, so that segmentation has to find them as in a real recording.

    Parameters
    ----------
    recipe : Recipe
        What to make.
    cache : Path
        Folder in which recordings are remembered.
    entry : Entry
        Which recording.
    """
    path = cache / f"{entry.recording_id}.npz"
    if (remembered := read_cached(path)) is not None:
        return remembered
    surface_index = [surface.name for surface in recipe.surfaces].index(entry.surface)
    recording = recipe.record(surface_index, entry.repetition or 0).with_(phases=None)
    write_cached(path, recording)
    return recording


def open_simulated(recipe: Recipe, **about: Any) -> Dataset:
    """Return the dataset of a recipe; nothing is made yet. `about` is what else a `Dataset` holds."""
    input_hash = recipe.fingerprint()
    made_by = hashlib.sha256(f"{input_hash} numpy {np.__version__}".encode()).hexdigest()[:16]
    return Dataset(
        entries=_entries(recipe),
        load=partial(load_simulated, recipe, cache_root() / "simulated" / made_by),
        input_hash=input_hash,
        **about,
    )


def open_gestures(recipe: Recipe, gesture: str) -> Dataset:
    """Return as many recordings as a recipe has, by the same people on the same surfaces: one gesture each.

    Parameters
    ----------
    recipe : Recipe
        Its duration is not used: a gesture has its own.
    gesture : str
        One of `texclass.simulate.GESTURES`.
    """
    made_by = hashlib.sha256(f"{recipe.fingerprint()} {gesture}".encode()).hexdigest()
    return Dataset(gesture, _entries(recipe), partial(_simulate_gesture, recipe, gesture), made_by)


def _entries(recipe: Recipe) -> tuple[Entry, ...]:
    return tuple(Entry(id_, surface, who, repetition=k) for id_, surface, who, k in recipe.entries())


def _simulate_gesture(recipe: Recipe, gesture: str, entry: Entry) -> Recording:
    """Return one gesture, its phases to be found."""
    from texclass.simulate.controlled import GESTURES, record_gesture  # numba: as in `Recipe.record`

    place = [surface.name for surface in recipe.surfaces].index(entry.surface)
    who = [operator.name for operator in recipe.operators].index(entry.operator or "")
    seed = (recipe.seed, place, who, entry.repetition or 0, 1 + list(GESTURES).index(gesture))
    made = record_gesture(gesture, recipe.surfaces[place], recipe.operators[who], seed=seed, fs=recipe.fs)
    return made.with_(phases=None, recording_id=entry.recording_id, repetition=entry.repetition)


def write_sample(folder: str | Path, first: int = 1) -> tuple[Path, ...]:
    """Write a small folder of simulated recordings, laid out as one's own would be, to try things on.

    Four surfaces, six recordings of each, 4 s at 10 kHz: taps, then strokes. `folder/oak/oak_01.txt` holds
    the acceleration along the tool in m/s^2, one value a line.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.
    first : int
        Number of the first recording of each surface; 7 gives recordings that go on after the first six.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    ValueError
        If a file of such a name holds something else; it is left as it is.
    IndexError
        If `first` is not 1 to 995.
    """
    recipe = Recipe(n_surfaces=5, n_recordings=1000, n_operators=3, duration_s=4.0, fs=10_000, seed=2015)
    written = []
    for name, place in {"slate": 0, "oak": 2, "foam": 3, "mesh": 4}.items():
        for k in range(first, first + 6):
            along_tool = recipe.record(place, k).acceleration[:, 2]
            text = "%.6g\n" * len(along_tool) % tuple(along_tool)
            path = Path(folder) / name / f"{name}_{k:02d}.txt"
            if path.exists() and path.read_bytes() != text.encode():
                raise ValueError(f"{path}: contains something else. Expected a new folder")
            write_atomic(path, text)
            written.append(path)
    return tuple(written)


def write_cached(path: Path, recording: Recording) -> None:
    """Write a recording to the cache, unless the disk has less than 5 GB left."""
    if shutil.disk_usage(next(folder for folder in path.parents if folder.exists())).free < 5_000_000_000:
        return
    arrays = {name: signal for name in SIGNALS if (signal := getattr(recording, name)) is not None}
    facts = {name: getattr(recording, name) for name in FACTS}
    buffer = io.BytesIO()
    np.savez(buffer, facts=np.array(json.dumps(facts)), **arrays)
    write_if_possible(path, buffer.getvalue())


def read_cached(path: Path) -> Recording | None:
    """Read a recording from the cache; None if it is not there or not intact."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        facts = json.loads(str(arrays.pop("facts")))
        facts |= {name: tuple(facts[name]) for name in ("channels", "flags")}
        return Recording(**facts, **arrays)
    except Exception:  # absent or damaged, however: it is made again
        return None
