"""Three terrains that shake alike and turn differently: what a model without turn rate cannot tell apart."""

import numpy as np
from scipy.signal import lfilter
from toy_surfaces import pipeline

from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import train
from texclass.recording import Phases, Recording

FS, N = 200.0, 400
TERRAINS = {"gravel": 8.0, "grass": 30.0, "sand": 70.0}
"""Terrain -> frequency (Hz) at which the platform turns to and fro."""


def values(terrain, seed):
    """Return (N, 6): white accelerations with gravity, turn rates that hum."""
    rng = np.random.default_rng([*map(ord, terrain), seed])
    angle = 2 * np.pi * TERRAINS[terrain] / FS
    hum = lfilter([1], [1, -2 * 0.95 * np.cos(angle), 0.95**2], rng.standard_normal((N, 3)), axis=0)
    shaken = rng.standard_normal((N, 3)) + np.array([0, 0, 9.81])
    return np.column_stack([shaken, 0.1 * hum])


def recording(terrain, seed):
    both = values(terrain, seed)
    return Recording(
        both[:, :3] - np.median(both[:, :3], axis=0),
        FS,
        "m/s^2",
        f"{terrain}-{seed}",
        terrain,
        repetition=seed,
        turn_rate=both[:, 3:],
        channels=("ax", "ay", "az"),
        phases=Phases(movement=(0, N)),
    )


def terrains():
    entries = tuple(Entry(f"{t}-{k}", t, repetition=k) for t in TERRAINS for k in range(1, 7))
    return Dataset("terrains", entries, lambda e: recording(e.surface, e.repetition), "terrains")


def turning_model(dataset=None):
    names = ("band_level", "lag_correlation")
    features = load_feature_set("coarse").restricted_to(names)
    made = pipeline(
        channels="all", features=features, rows=(RowDefinition(name="Bands and pairs", features=names),)
    )
    return train(dataset or terrains(), made, row="Bands and pairs", classifier="lda", false_alarms=0.2)
