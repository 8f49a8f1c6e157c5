"""Simulated datasets: recordings made when they are asked for, and remembered on disk."""

import hashlib
import io
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.places import cache_root, write_atomically
from texclass.recording import AUXILIARY_UNITS, Recording
from texclass.simulate.recipe import Recipe

SIGNALS = ("acceleration", *AUXILIARY_UNITS)
FACTS = ("fs", "unit", "recording_id", "material", "operator", "repetition", "source", "channels", "flags")
MIN_FREE_BYTES = 5_000_000_000
"""Nothing is remembered when the disk has less space than this."""


@dataclass(frozen=True)
class SimulatedLoader:
    """Makes the recordings of a recipe; a `Dataset`'s `load`, picklable.

    The true phases are withheld, so that segmentation has to find them as in a real recording.

    Parameters
    ----------
    recipe : Recipe
        What to make.
    cache : Path or None
        Folder in which recordings are remembered; None: nowhere.
    """

    recipe: Recipe
    cache: Path | None = None

    def __call__(self, entry: Entry) -> Recording:
        """Return one recording, from the cache or freshly made: the same to the last bit."""
        path = self.cache / f"{entry.recording_id}.npz" if self.cache else None
        if path is not None and (remembered := recall(path)) is not None:
            return remembered
        surface_index = [surface.name for surface in self.recipe.surfaces].index(entry.material)
        recording = self.recipe.record(surface_index, entry.repetition or 0).with_(phases=None)
        if path is not None:
            remember(path, recording)
        return recording


def open_simulated(recipe: Recipe, **about: Any) -> Dataset:
    """Return the dataset of a recipe; nothing is made yet. `about` is what else a `Dataset` holds."""
    input_hash = recipe.fingerprint()
    made_by = hashlib.sha256(f"{input_hash} numpy {np.__version__}".encode()).hexdigest()[:16]
    return Dataset(
        entries=tuple(
            Entry(id_, surface, operator, repetition=k) for id_, surface, operator, k in recipe.entries()
        ),
        load=SimulatedLoader(recipe, cache_root() / "simulated" / made_by),
        input_hash=input_hash,
        **about,
    )


def remember(path: Path, recording: Recording) -> None:
    """Write a recording to the cache, unless the disk is nearly full."""
    if shutil.disk_usage(next(folder for folder in path.parents if folder.exists())).free < MIN_FREE_BYTES:
        return
    arrays = {name: signal for name in SIGNALS if (signal := getattr(recording, name)) is not None}
    facts = {name: getattr(recording, name) for name in FACTS}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, facts=np.array(json.dumps(facts)), **arrays)
    write_atomically(path, buffer.getvalue())


def recall(path: Path) -> Recording | None:
    """Read a recording from the cache; None if it is not there or not intact."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        facts = json.loads(str(arrays.pop("facts")))
        facts |= {name: tuple(facts[name]) for name in ("channels", "flags")}
        return Recording(**facts, **arrays)
    except Exception:  # absent or damaged, however: it is made again
        return None
