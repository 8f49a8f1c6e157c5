"""Whether a graph of samples gives the answers of texclass: on windows made by a formula, or on real ones.

Features are computed in single precision in places, and in another order in a graph, so that they differ by
about 1e-7 of their range. Labels and verdicts are compared where they do not hang on that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.recognition.model import Model
from texclass.recording import STANDARD_GRAVITY, Samples
from texclass.robot.export.answers_graph import OUTPUTS, UNDEFINED
from texclass.robot.export.parity import check_of, check_same, reference, run
from texclass.robot.export.sample_graph import SAMPLES, channels_of, recording_of

TOLERANCE = 1e-5
"""Largest difference of a probability that counts as none."""
MARGIN = 1e-4
"""Between two labels (of probability), or to the threshold of the unknown (in parts of it).

Closer answers may be the other one.
"""
FORMULA = (
    "s = seed; for each channel c: y = 0; for each sample: s = (1664525 s + 1013904223) mod 2^32, "
    "y = smooth y + s / 2^32 - 1/2, sample = float32(offset[c] + gain y); in double precision"
)


@dataclass(frozen=True)
class SampleParity:
    """How a graph of samples was compared with texclass, and found the same.

    Attributes
    ----------
    n_windows, n_unknown : int
        Windows that were compared, and those called unknown.
    n_answered, n_surfaces : int
        Surfaces that were answered at least once, of how many there are.
    n_close : int
        Windows whose label or verdict lies within `margin`.
    difference : float
        Largest difference of a probability, of windows inside the range of training.
    feature_difference : float
        Largest difference of a feature, in widths of its range in training.
    tolerance, margin : float
        See the module; both grow with the widths that a window lies outside the range of training.
    """

    n_windows: int
    n_unknown: int
    n_answered: int
    n_surfaces: int
    n_close: int
    difference: float
    feature_difference: float
    tolerance: float = TOLERANCE
    margin: float = MARGIN

    def __str__(self) -> str:
        return (
            f"as texclass on {self.n_windows} windows: no label or verdict differs, {self.n_close} within "
            f"{self.margin:g} of another; probabilities by at most {self.difference:.1e} (tolerance "
            f"{self.tolerance:g}), features by {self.feature_difference:.1e} of their range; "
            f"{self.n_answered} of {self.n_surfaces} surfaces were answered, {self.n_unknown} windows "
            "unknown"
        )


def check_sample_parity(model: Model, graph: bytes, windows: NDArray[np.float32], X: Samples) -> SampleParity:
    """Compare a graph of samples with the model it was made of.

    Parameters
    ----------
    model : Model
        What texclass answers.
    graph : bytes
        The ONNX model, with its features as an output.
    windows : ndarray of float32, shape (n, n_channels, n_samples)
        What the graph is asked.
    X : ndarray of shape (n, n_columns)
        The `features_of_windows`: what texclass is asked.

    Raises
    ------
    ParityError
        If a label or verdict differs that lies outside the margin, or a probability by more than is allowed.
    OnnxExportError
        If onnxruntime cannot run it.
    """
    found = run(graph, windows, SAMPLES, (*OUTPUTS, "features"))
    expected, far, limit = reference(model, X), outside(model, X), model.novelty.threshold
    strange = np.nan_to_num(expected["strange"])
    near = MARGIN * far * np.maximum(np.abs(strange), np.abs(limit))
    gap = check_same(
        model, X, found, expected, allowed=TOLERANCE * far, rounding=near,
        against="texclass", names=[f"window {i}" for i in range(len(X))], tolerance=TOLERANCE,
    )  # fmt: skip
    ordered = np.sort(np.nan_to_num(expected["probabilities"], nan=-1.0), axis=1)
    close = (ordered[:, -1] - ordered[:, -2] <= MARGIN * far) | (np.abs(strange - limit) <= near)
    width = np.where(model.ranges.high > model.ranges.low, model.ranges.high - model.ranges.low, np.inf)
    apart = np.abs(found["features"] - X) / np.nan_to_num(width, nan=np.inf) / far[:, None]
    inside = far <= 1
    return SampleParity(
        n_windows=len(X),
        n_unknown=int(expected["unknown"].sum()),
        n_answered=len(set(expected["label"].tolist()) - {UNDEFINED}),
        n_surfaces=len(model.surfaces),
        n_close=int(close.sum()),
        difference=float(gap[inside].max(initial=0.0)),
        feature_difference=float(np.nan_to_num(apart).max(initial=0.0)),
    )


def features_of_windows(model: Model, windows: NDArray[np.float32]) -> Samples:
    """Return what texclass computes of windows (n, n_channels, n_samples), shape (n, n_columns)."""
    return np.array([model.plan.compute(recording_of(model, window)).values for window in windows])


def outside(model: Model, X: Samples) -> Samples:
    """Return how many widths features lie outside the range of training at most, shape (n,), at least 1."""
    return np.maximum(1.0, [model.ranges.distance_outside(row).max(initial=0.0) for row in X])


def recipes(model: Model) -> list[dict[str, Any]]:
    """Return what to make windows of by `FORMULA`: noise of several colours and levels, and silence."""
    channels = channels_of(model)
    peak = model.manifest.peak_acceleration or 1.0
    tilt = STANDARD_GRAVITY if model.manifest.unit == "m/s^2" else 0.0
    rest, seeds = [0.0] * len(channels), (1, 2, 3)
    colours = (-0.7, 0.0, 0.6, 0.9, 0.98, 0.998)
    found = [
        {"seed": seed, "smooth": smooth, "gain": peak * gain, "offset": rest}
        for smooth, gain, seed in product(colours, (1.0, 0.3, 0.03), seeds)
    ]
    tilted = [one | {"offset": [*rest[1:], tilt]} for one in found[:: len(seeds)]] if tilt else []
    return [*found, *tilted, found[0] | {"gain": 0.0}]


def made(recipe: Mapping[str, Any], n_channels: int, n_samples: int) -> NDArray[np.float32]:
    """Return the window that `FORMULA` makes, shape (n_channels, n_samples)."""
    s, window = int(recipe["seed"]), np.empty((n_channels, n_samples), dtype=np.float32)
    smooth, gain = float(recipe["smooth"]), float(recipe["gain"])
    for c, offset in enumerate(recipe["offset"]):
        y = 0.0
        for t in range(n_samples):
            s = (1664525 * s + 1013904223) % 2**32
            y = smooth * y + s / 2**32 - 0.5
            window[c, t] = np.float32(offset + gain * y)
    return window


def self_checks(model: Model, some: Sequence[Mapping[str, Any]], X: Samples) -> list[dict[str, Any]]:
    """Return some recipes with the answers that they have to get: different labels and verdicts first.

    Parameters
    ----------
    model : Model
        What answers.
    some : sequence of mapping
        What windows were made of, see `recipes`.
    X : ndarray of shape (n, n_columns)
        The `features_of_windows`.
    """
    said, far = reference(model, X), outside(model, X)
    p = np.sort(said["probabilities"], axis=1)
    kinds = list(zip(said["label"].tolist(), said["unknown"].tolist(), strict=True))
    sure = [i for i in np.argsort(far, kind="stable").tolist() if p[i, -1] - p[i, -2] > MARGIN * 10 * far[i]]
    first = {kinds[i]: i for i in reversed(sure)}
    order = dict.fromkeys([*first.values(), *sure])
    return [{**some[i], **check_of(said, i), "tolerance": TOLERANCE * float(far[i])} for i in list(order)[:8]]
