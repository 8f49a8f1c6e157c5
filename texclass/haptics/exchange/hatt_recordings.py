"""Create datasets from folders of HaTT textures, which are rendered at random speeds and forces."""

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

RANGE_FRACTIONS = (0.1, 0.9)
"""Limits of speed and force in the recordings, as fractions of the largest values of a texture."""


def open_models(card: ModelsCard, root: Path, **about: Any) -> Dataset:
    """Open a folder of textures as a dataset. Each recording is rendered when it is loaded.

    Parameters
    ----------
    card : ModelsCard
        Card with the file pattern and the properties of the recordings.
    root : Path
        Folder of the files.
    **about
        Further fields of `Dataset`.

    Raises
    ------
    RecordingError
        If no file matches, or two files have the same surface name.
    """
    files: dict[str, str] = {}
    for path in data_files(root):
        name = path.relative_to(root).as_posix()
        if match := match_name(card.files, name):
            surface = match[0]["surface"]
            if other := files.get(surface):
                raise RecordingError(
                    f"{root}: {other} and {name} both define surface {surface!r}. "
                    "Expected one file per surface"
                )
            files[surface] = name
    if not files:
        raise RecordingError(f"{root} contains no models. Expected file names like {card.files[0]!r}")
    return Dataset(
        entries=tuple(
            Entry(f"{surface}_{k:02d}", surface, repetition=k, paths=(name,))
            for surface, name in files.items()
            for k in range(1, card.n_recordings + 1)
        ),
        load=partial(render_recording, card, root),
        input_hash=digest_files(root, files.values(), card.hash_input),
        **about,
    )


def render_recording(card: ModelsCard, root: Path, entry: Entry) -> Recording:
    """Render one recording of a texture; the result depends only on the file, the card and the entry.

    Parameters
    ----------
    card : ModelsCard
        Card with sampling rate, duration and seed.
    root : Path
        Folder of the files.
    entry : Entry
        Entry of the dataset; its path is relative to `root`.

    Raises
    ------
    RecordingError
        If the file is not a texture, has another sampling rate, or is silent.
    """
    path = root / entry.paths[0]
    try:
        texture = read_hatt(path)
    except (ValueError, OSError) as error:
        raise RecordingError(f"{error}" if str(path) in str(error) else f"{path}: {error}") from error
    if texture.fs != card.fs_hz:
        raise RecordingError(
            f"{path}: SampleRate is {texture.fs:g} Hz, but the card has fs_hz = {card.fs_hz:g}. "
            "Change fs_hz in the card"
        )
    rng = np.random.default_rng([card.seed, *entry.recording_id.encode()])
    n = max(2, round(card.duration_s * texture.fs))
    speed, force = (largest * random_walk(n, texture.fs, rng) for largest in texture.mesh.largest)
    renderer = texture.renderer(seed=int(rng.integers(2**32)))
    vibration = renderer.process(np.column_stack([speed, np.zeros(n)]), force)
    recording = Recording(
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
    return condition_recording(recording, 1.0, card.phases, remove_resting_level=False)


def random_walk(n: int, fs: float, rng: Generator) -> Samples:
    """Return a smooth random signal (n,) between the two `RANGE_FRACTIONS`.

    Slow and fast noise of equal power are added, and the sum is mapped to a uniform distribution.
    """
    from scipy.special import ndtr

    n_knots = int(np.ceil(n / fs * CONTROL_RATE)) + 2
    # a slow movement and a tremor, with their bandwidths in Hz
    walk = (smooth_noise(n_knots, 0.2, rng) + smooth_noise(n_knots, 1.5, rng)) / np.sqrt(2)
    uniform = np.interp(np.arange(n) / fs * CONTROL_RATE, np.arange(n_knots), ndtr(walk))
    low, high = RANGE_FRACTIONS
    return np.asarray(low + (high - low) * uniform)
