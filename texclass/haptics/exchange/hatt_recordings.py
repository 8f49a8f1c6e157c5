"""A folder of HaTT models as a dataset: each texture felt at random speeds and forces."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from texclass.haptics.exchange.hatt_xml import read_hatt
from texclass.loaders.cards import ModelsCard
from texclass.loaders.data_files import data_files
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.filesets import condition_recording, match_name
from texclass.loaders.places import digest_files
from texclass.recording import Recording, RecordingError, Samples
from texclass.simulate.hand import CONTROL_RATE, smooth_noise

SHARES = (0.1, 0.9)
"""Of the largest speed and force of a texture's models, between which it is felt."""


def open_models(card: ModelsCard, root: Path, **about: Any) -> Dataset:
    """Return the dataset of a card of models; nothing is rendered yet.

    Parameters
    ----------
    card : ModelsCard
        Which files there are, and what is made of each.
    root : Path
        Folder of the files.
    **about
        What else a `Dataset` holds.

    Raises
    ------
    RecordingError
        If no file matches, or two are of one surface.
    """
    found: dict[str, str] = {}
    for path in data_files(root):
        name = path.relative_to(root).as_posix()
        if matched := match_name(card.files, name):
            surface = matched[0]["surface"]
            if other := found.get(surface):
                raise RecordingError(
                    f"{root}: {other} and {name} are both of {surface!r}. Expected one file each"
                )
            found[surface] = name
    if not found:
        raise RecordingError(f"{root}: holds no model. Expected files named as {card.files[0]!r}")
    return Dataset(
        entries=tuple(
            Entry(f"{surface}_{k:02d}", surface, repetition=k, paths=(name,))
            for surface, name in found.items()
            for k in range(1, card.n_recordings + 1)
        ),
        load=partial(load_made, card, root),
        input_hash=digest_files(root, found.values(), card.hash_input),
        **about,
    )


def load_made(card: ModelsCard, root: Path, entry: Entry) -> Recording:
    """Return one recording of a texture: the same for the same file, card and number.

    Parameters
    ----------
    card : ModelsCard
        Rate, duration and seed.
    root : Path
        Folder to which the entry's path is relative.
    entry : Entry
        Which recording.

    Raises
    ------
    RecordingError
        If the file is no texture, of another rate, or silent; the message names it.
    """
    path = root / entry.paths[0]
    try:
        texture = read_hatt(path)
    except (ValueError, OSError) as error:
        raise RecordingError(f"{error}" if str(path) in str(error) else f"{path}: {error}") from error
    if texture.fs != card.fs_hz:
        raise RecordingError(
            f"{path}: SampleRate is {texture.fs:g} Hz, the card says {card.fs_hz:g}. Expected one"
        )
    rng = np.random.default_rng([card.seed, *entry.recording_id.encode()])
    n = max(2, round(card.duration_s * texture.fs))
    speed, force = (largest * felt_share(n, texture.fs, rng) for largest in texture.mesh.largest)
    renderer = texture.renderer(seed=int(rng.integers(2**32)))
    vibration = renderer.process(np.column_stack([speed, np.zeros(n)]), force)
    made = Recording(
        vibration,
        fs=texture.fs,
        unit="m/s^2",
        recording_id=entry.recording_id,
        surface=entry.surface,
        repetition=entry.repetition,
        source=str(path),
        speed=speed,
        normal_force=force,
    )
    return condition_recording(made, 1.0, card.phases, remove_resting_level=False)


def felt_share(n: int, fs: float, rng: Generator) -> Samples:
    """Return n samples of a path between the `SHARES` of what models know: a smooth walk, new each time.

    Two smooth noises of half the power each, one slow, one restless, are brought to a uniform distribution.
    """
    from scipy.special import ndtr

    n_knots = int(np.ceil(n / fs * CONTROL_RATE)) + 2
    # a slow walk, Hz, and a tremble about it
    walk = (smooth_noise(n_knots, 0.2, rng) + smooth_noise(n_knots, 1.5, rng)) / np.sqrt(2)
    at = np.interp(np.arange(n) / fs * CONTROL_RATE, np.arange(n_knots), ndtr(walk))
    low, high = SHARES
    return np.asarray(low + (high - low) * at)
