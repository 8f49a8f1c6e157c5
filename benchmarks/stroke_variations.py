"""Simulated variations of strokes (faster, stronger, brighter) and their effect on the set `surfaces`.

`python benchmarks/stroke_variations.py` (a minute) writes texclass/classifiers/stroke_variations.csv. It
changes recordings of simulated surfaces that no dataset card has (another seed), and keeps the principal
changes.
"""

import csv
from collections.abc import Callable

import numpy as np
from scipy import signal
from study import command_line

from texclass.classifiers.segment_voting import VARIATIONS_FILE
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set
from texclass.loaders.simulated import open_simulated
from texclass.recording import Recording, Samples
from texclass.simulate.recipe import Recipe

RECIPE = Recipe(n_surfaces=24, n_recordings=4, n_operators=4, duration_s=4.0, fs=10_000, seed=77)
N_CHANGES, N_SEGMENTS = 24, 4


def speed_up(x: Samples) -> Samples:
    return signal.resample_poly(x, 10, 11, axis=0, padtype="line")


def amplify(x: Samples) -> Samples:
    mean = x.mean(axis=0)
    return mean + 1.3 * (x - mean)


def tilt(x: Samples) -> Samples:
    """Tilt the spectrum by 1.5 dB per octave around a tenth of the sampling rate, without its mean."""
    spectrum, f = np.fft.rfft(x, axis=0), np.fft.rfftfreq(len(x))
    slope = np.append(1.0, (f[1:] / 0.1) ** 0.25)
    return np.fft.irfft((spectrum.T * slope).T, len(x), axis=0)


def vary(recording: Recording, change: Callable[[Samples], Samples]) -> Recording:
    """Return a recording with a varied acceleration, and with a faster friction signal for `speed_up`."""
    friction = recording.friction
    if change is speed_up and friction is not None:
        friction = speed_up(friction)
    names = ("normal_force", "speed", "sound", "turn_rate")
    return recording.with_(
        acceleration=change(recording.acceleration), friction=friction, **dict.fromkeys(names)
    )


def main() -> None:
    command_line(__doc__)
    plan = Plan.of(load_feature_set("surfaces"))
    column_index = {column: i for i, column in enumerate(plan.columns)}
    names = list(dict.fromkeys(column.partition(".segment")[0] for column in plan.columns))
    segment_columns = [
        [column_index.get(f"{name}.segment{segment}", column_index.get(name)) for name in names]
        for segment in range(1, N_SEGMENTS + 1)
    ]
    rows = []
    for recording in open_simulated(RECIPE, name="known changes"):
        original = plan.compute(recording).values
        for change in (speed_up, amplify, tilt):
            varied = plan.compute(vary(recording, change)).values
            rows += [np.nan_to_num(varied - original)[columns] for columns in segment_columns]
    differences = np.array(rows)
    differences *= np.sqrt(3.0)  # the three at once
    size = np.sqrt(np.mean(differences**2, axis=0)) + 1e-12
    _, values, vectors = np.linalg.svd(differences / size, full_matrices=False)
    components = np.sqrt(N_CHANGES / len(differences)) * values[:N_CHANGES, None] * vectors[:N_CHANGES] * size
    with VARIATIONS_FILE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(
            [name, *(f"{v:.4g}" for v in column)] for name, column in zip(names, components.T, strict=True)
        )


if __name__ == "__main__":
    main()
