"""Four simulated surfaces (filtered noise) and a pipeline with few features, for tests of recognition."""

import numpy as np
from scipy.signal import lfilter

from texclass.evaluation.pipeline import PipelineDefinition, RowDefinition, Use
from texclass.features import load_feature_set
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import train
from texclass.recording import Phases, Recording, RecordingError

FS, N = 4000.0, 2000
SURFACES = {"cork": 60.0, "felt": 200.0, "oak": 450.0, "slate": 800.0}
"""Surface -> frequency of its resonance in Hz."""
STRANGER = 1250.0
"""Resonance in Hz of surfaces that are not in the training set."""


def signal(resonance_hz, seed, n=N):
    """Return noise through a resonance with a slightly varying frequency, plus white noise."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * resonance_hz * (1 + 0.03 * rng.standard_normal()) / FS
    filtered = lfilter([1], [1, -2 * 0.95 * np.cos(angle), 0.95**2], rng.standard_normal(n))
    return filtered / filtered.std() + 0.2 * rng.standard_normal(n)


def recording(name, seed, **changes):
    fields = {"fs": FS, "unit": "m/s^2", "recording_id": f"{name}-{seed}", "surface": name}
    samples = signal(SURFACES.get(name, STRANGER), [*map(ord, name), seed])
    return Recording(samples, phases=Phases(movement=(0, len(samples))), **fields | changes)


class Loader:
    """Make the recording of an entry; those in `bad` are invalid."""

    def __init__(self, bad=()):
        self.bad = bad

    def __call__(self, entry):
        if entry.recording_id in self.bad:
            raise RecordingError(f"{entry.recording_id}: is empty (0 bytes). Expected at least two samples")
        return recording(entry.surface, entry.repetition)


def surfaces(n_repetitions=10, *, bad=(), names=tuple(SURFACES)):
    entries = tuple(Entry(f"{m}-{r}", m, repetition=r) for m in names for r in range(1, n_repetitions + 1))
    return Dataset("toy", entries, Loader(bad), f"toy{n_repetitions}{bad}{names}")


def pipeline(**changes):
    features = load_feature_set("texclass").restricted_to(["mfcc", "fineness", "temporal_roughness"])
    fields = {
        "name": "few",
        "features": features,
        "steps": (
            Use(use="sklearn.impute.SimpleImputer", strategy="median", keep_empty_features=True),
            Use(use="sklearn.preprocessing.StandardScaler"),
        ),
        "classifiers": {
            "lda": Use(
                use="sklearn.discriminant_analysis.LinearDiscriminantAnalysis", solver="lsqr", shrinkage=0.1
            ),
            "kernel": Use(use="texclass.classifiers.kernel_discriminant.KernelDiscriminant"),
        },
        "rows": (
            RowDefinition(name="Roughness", features=("fineness", "temporal_roughness")),
            RowDefinition(name="Spectrum", features=("mfcc",)),
        ),
        "seed": 0,
    }
    return PipelineDefinition(**fields | changes)


def spectrum_model(classifier, **options):
    return train(surfaces(), pipeline(), row="Spectrum", classifier=classifier, **options)
