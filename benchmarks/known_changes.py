"""Measure what a quicker, stronger or brighter stroke does to the features of the set `surfaces`.

`python benchmarks/known_changes.py` (a minute) writes texclass/classifiers/stroke_variations.csv. It changes
recordings of simulated surfaces that no dataset card has (another seed), and keeps the principal changes.
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


def quicker(x: Samples) -> Samples:
    return signal.resample_poly(x, 10, 11, axis=0, padtype="line")


def stronger(x: Samples) -> Samples:
    mean = x.mean(axis=0)
    return mean + 1.3 * (x - mean)


def brighter(x: Samples) -> Samples:
    """Raise the spectrum by 1.5 dB an octave, about a tenth of the sampling rate; the mean stays."""
    spectrum, f = np.fft.rfft(x, axis=0), np.fft.rfftfreq(len(x))
    slope = np.append(1.0, (f[1:] / 0.1) ** 0.25)
    return np.fft.irfft((spectrum.T * slope).T, len(x), axis=0)


def changed(recording: Recording, change: Callable[[Samples], Samples]) -> Recording:
    """Return a recording felt in another way; its friction goes along where that is another time."""
    friction = recording.friction
    if change is quicker and friction is not None:
        friction = quicker(friction)
    names = ("normal_force", "speed", "sound", "turn_rate")
    return recording.with_(
        acceleration=change(recording.acceleration), friction=friction, **dict.fromkeys(names)
    )


def main() -> None:
    command_line(__doc__)
    plan = Plan.of(load_feature_set("surfaces"))
    place = {column: i for i, column in enumerate(plan.columns)}
    names = list(dict.fromkeys(column.partition(".segment")[0] for column in plan.columns))
    of_pieces = [
        [place.get(f"{name}.segment{piece}", place.get(name)) for name in names]
        for piece in range(1, N_SEGMENTS + 1)
    ]
    rows = []
    for recording in open_simulated(RECIPE, name="known changes"):
        plain = plan.compute(recording).values
        for change in (quicker, stronger, brighter):
            other = plan.compute(changed(recording, change)).values
            rows += [np.nan_to_num(other - plain)[columns] for columns in of_pieces]
    moves = np.array(rows)
    moves *= np.sqrt(3.0)  # the three at once
    size = np.sqrt(np.mean(moves**2, axis=0)) + 1e-12
    _, values, vectors = np.linalg.svd(moves / size, full_matrices=False)
    some = np.sqrt(N_CHANGES / len(moves)) * values[:N_CHANGES, None] * vectors[:N_CHANGES] * size
    with VARIATIONS_FILE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(
            [name, *(f"{v:.4g}" for v in column)] for name, column in zip(names, some.T, strict=True)
        )


if __name__ == "__main__":
    main()
