"""A toy dataset, feature set and pipeline: noise whose level names the surface."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import pytest
import soundfile

from texclass.evaluation.pipeline import FoldSettings, PipelineDefinition, RowDefinition, Use
from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.sets import FeatureSet, Member
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import Phases, Recording, RecordingError

FS = 1000.0
TINY = """
title = "Three simulated surfaces"
format = "simulated"
[recipe]
n_surfaces = 3
n_recordings = 4
n_operators = 3
duration_s = 4.0
fs = 10000
seed = 11
"""


def a_table(n_surfaces=3, n_repetitions=10, **columns):
    """What is known of recordings before they are loaded."""
    rows = [(f"m{m}", r) for m in range(n_surfaces) for r in range(1, n_repetitions + 1)]
    table = pd.DataFrame(rows, columns=["surface", "repetition"])
    table["recording_id"] = table["surface"] + "_" + table["repetition"].astype(str)
    table["operator"] = [f"o{r % 5}" for r in table["repetition"]]
    return table.assign(session=None, **columns)


@dataclass
class ToyLoader:
    """Noise whose level and offset name the surface; counts what it loads."""

    bad: tuple[str, ...] = ()
    killed_at: str = ""
    loaded: list[str] = field(default_factory=list)

    def __call__(self, entry: Entry) -> Recording:
        if entry.recording_id == self.killed_at:
            raise KeyboardInterrupt
        if entry.recording_id in self.bad:
            raise RecordingError(f"{entry.recording_id}.txt: value 'x' in line 3. Expected numbers")
        self.loaded.append(entry.recording_id)
        rng = np.random.default_rng([int(entry.surface[1:]), entry.repetition])
        signal = (1 + int(entry.surface[1:])) * rng.normal(size=300)
        return Recording(
            signal, fs=FS, unit="g", recording_id=entry.recording_id, phases=Phases(movement=(0, 300)),
            flags=("clipped",) if entry.repetition == 1 else (),
        )  # fmt: skip


def level(view):
    return np.log(view.samples.std())


def peaks(view):
    return np.sort(np.abs(view.samples))[-2:]


def hardness_of_taps(view):
    return 1.0


def rarely(view):
    if view.samples[0] > 0:
        raise UndefinedFeatureError("starts above 0")
    return 0.0


STEPS = (
    Use(use="sklearn.impute.SimpleImputer", strategy="median", keep_empty_features=True),
    Use(use="sklearn.preprocessing.MinMaxScaler"),
)
CLASSIFIERS = {
    "naive_bayes": Use(use="sklearn.naive_bayes.GaussianNB"),
    "euclidean": Use(use="sklearn.neighbors.NearestCentroid"),
}


def row(name, *features, **facts):
    return RowDefinition(name=name, features=features, **facts)


@pytest.fixture(scope="session")
def pipeline(feature_set):
    """Make a pipeline of some rows, in four folds."""

    def make(*rows, **changes):
        facts = {"features": feature_set, "steps": STEPS, "classifiers": CLASSIFIERS, "rows": rows, "seed": 0}
        return PipelineDefinition(**{"name": "toy", "protocol": FoldSettings(folds=4), **facts, **changes})

    return make


@pytest.fixture(scope="session")
def feature_set():
    return FeatureSet(
        "toy",
        (
            Member("level", Feature("level", level, "movement", "1", "test")),
            Member("peaks", Feature("peaks", peaks, "movement", "1", "test", ("second", "first"))),
            Member("knock", Feature("knock", hardness_of_taps, "tap", "1", "test")),
            Member("rarely", Feature("rarely", rarely, "movement", "1", "test")),
        ),
    )


@pytest.fixture(scope="session")
def toy_dataset():
    def make(n_surfaces=3, n_repetitions=4, *, input_hash="toy", operators=2, **loader):
        entries = tuple(
            Entry(f"m{m}_{r}", f"m{m}", operator=f"o{r % operators}" if operators else None, repetition=r)
            for m in range(n_surfaces)
            for r in range(1, n_repetitions + 1)
        )
        return Dataset("toy", entries, ToyLoader(**loader), input_hash)

    return make


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))


def write_plates(folder, fs, louder):
    """Write three surfaces, each so much louder than the one before: six WAV files of 1200 samples each."""
    for m, name in enumerate(("cork", "felt", "oak")):
        (folder / name).mkdir(parents=True)
        for i in range(6):
            white = np.random.default_rng([m, i]).normal(size=1203)  # alone, it would be taken for rest
            noise = 0.02 * louder**m * np.convolve(white, np.ones(4), "valid")
            soundfile.write(folder / name / f"{name}_{i}.wav", noise.clip(-0.99, 0.99), fs)
