"""Whether a graph gives the answers of its model: label by label, probability by probability.

Both are asked about rows of features that are ordinary, extreme, undefined, and on either side of boundaries
between answers. What differs is an error, unless rounding alone decides.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.neighbors import KNeighborsClassifier

from texclass.recognition.array_form import ArrayStep, apply, squared_distances
from texclass.recognition.model import Model
from texclass.recognition.novelty import novelty_scores
from texclass.recording import Samples
from texclass.robot.export.answers_graph import FEATURES, OUTPUTS, UNDEFINED
from texclass.robot.export.graph import OnnxExportError

SEED = 2015
TOLERANCE = 1e-9
"""Largest difference of a probability, and relative difference of other numbers, that counts as none."""


Said = dict[str, NDArray[Any]]
"""What is said of rows, by output."""


class ParityError(OnnxExportError):
    """A graph gives other answers than its model; the message says where and by how much."""


@dataclass(frozen=True)
class Parity:
    """How a graph was compared with its model, and found the same.

    Attributes
    ----------
    rows
        How many were compared, of each kind; see `check_rows`.
    n_answered, n_surfaces : int
        Surfaces that were answered at least once, of how many there are.
    n_unknown : int
        Rows called unknown.
    n_ties : int
        Rows where rounding decides, and decided differently.
    difference : float
        Largest difference of a probability.
    tolerance : float
        What it may be, beside what a probability changes when its features do by 1e-13 of themselves.
    """

    rows: dict[str, int]
    n_answered: int
    n_surfaces: int
    n_unknown: int
    n_ties: int
    difference: float
    tolerance: float = TOLERANCE

    def __str__(self) -> str:
        kinds = ", ".join(f"{n} {kind}" for kind, n in self.rows.items())
        return (
            f"as texclass on {sum(self.rows.values())} rows ({kinds}): no label differs, probabilities "
            f"by at most {self.difference:.1e} (tolerance {self.tolerance:g}), {self.n_ties} ties; "
            f"{self.n_answered} of {self.n_surfaces} surfaces were answered, {self.n_unknown} rows unknown"
        )


def check_parity(model: Model, graph: bytes, *, seed: int = SEED) -> Parity:
    """Compare a graph with the model it was made of.

    Parameters
    ----------
    model : Model
        What the graph was made of.
    graph : bytes
        The ONNX model.
    seed : int
        Of the rows.

    Raises
    ------
    ParityError
        If a label, a verdict or a probability differs by more than rounding explains: of two labels whose
        probabilities are equal within the tolerance, of neighbours equally far, of a novelty score equal to
        one that was held out, and where features changed by 1e-13 of themselves give other probabilities.
    OnnxExportError
        If onnxruntime cannot run it.
    """
    X, kinds = check_rows(model, seed)
    expected, found = reference(model, X), run(graph, X)
    allowed = TOLERANCE + _rounding(model, X, expected["probabilities"], np.random.default_rng(seed))
    allowed[expected["tied"]] = np.inf
    # Decisions of a kernel reach 1: below 1e-3, differences of the novelty score count as there.
    rounding = TOLERANCE * np.maximum(np.abs(expected["strange"]), 1e-3)
    names = [f"row {i} ({kind})" for i, kind in enumerate(kinds)]
    gap = check_same(
        model, X, found, expected, allowed=allowed, rounding=rounding,
        against="texclass", names=names, tolerance=TOLERANCE,
    )  # fmt: skip
    decided = (found["label"] != expected["label"]) | (gap > TOLERANCE)
    decided |= (expected["label"] != UNDEFINED) & (found["p_known"] != expected["p_known"])
    kinds_of, counts = np.unique(kinds, return_counts=True)
    return Parity(
        rows=dict(zip(kinds_of.tolist(), counts.tolist(), strict=True)),
        n_answered=len(set(expected["label"].tolist()) - {UNDEFINED}),
        n_surfaces=len(model.surfaces),
        n_unknown=int(expected["unknown"].sum()),
        n_ties=int(decided.sum()),
        difference=float(gap[gap <= TOLERANCE].max(initial=0.0)),
    )


def check_same(
    model: Model,
    X: Samples,
    found: Mapping[str, NDArray[Any]],
    expected: Said,
    *,
    allowed: Samples,
    rounding: Samples,
    against: str,
    names: Sequence[str],
    tolerance: float,
) -> Samples:
    """Refuse answers of a graph that differ from those of a model by more than rounding explains.

    Parameters
    ----------
    model : Model
        What the graph was made of.
    X : ndarray of shape (n, n_columns)
        Features of what both were asked.
    found, expected : mapping of str to ndarray
        What the graph says, and what it has to, as `reference` returns it.
    allowed, rounding : ndarray of shape (n,)
        By how much probabilities may differ, and how strange what is asked is.
    against, names, tolerance
        For the message: what the graph is compared with, what each row is called, and the tolerance.

    Returns
    -------
    ndarray of shape (n,)
        Largest difference of a probability.

    Raises
    ------
    ParityError
        Naming the first that differs, and how many do.
    """
    defined = expected["label"] != UNDEFINED
    p, other = found["probabilities"], expected["probabilities"]
    gap = np.nan_to_num(np.abs(p - other), nan=np.inf)
    gap[~defined & np.isnan(p).all(axis=1)] = 0.0
    largest, at = gap.max(axis=1), (np.arange(len(X)), gap.argmax(axis=1))
    # A label is the largest of its own probabilities, and of the expected ones but for a tie.
    place = {surface: k for k, surface in enumerate(model.surfaces)}
    k = np.array([place.get(label, -1) for label in found["label"].tolist()])
    own, chosen = (np.where(k >= 0, one[at[0], k], np.nan) for one in (p, other))
    right = (own == p.max(axis=1)) & (chosen >= other.max(axis=1) - 2 * allowed)
    # A p-value is that of the expected novelty score, within its rounding.
    p_known = found["p_known"]
    low, high = (model.novelty.p_value(expected["strange"] + side * rounding) for side in (1, -1))
    between = (low <= p_known) & (p_known <= high)
    verdict = _verdict(model, X, np.nan_to_num(p_known))
    for what, agree, one, reference_ in (
        ("label", np.where(defined, right, found["label"] == UNDEFINED), found["label"], expected["label"]),
        ("probability", largest <= allowed, p[at], other[at]),
        ("p_known", np.where(defined, between, np.isnan(p_known)), p_known, expected["p_known"]),
        ("unknown =", found["unknown"] == verdict, found["unknown"], verdict),
    ):
        if not agree.all():
            i = int(np.argmin(agree))
            raise ParityError(
                f"ONNX differs from {against} in {int((~agree).sum())} of {len(names)} "
                f"{names[i].partition(' ')[0]}s; {names[i]} has {what} {one[i]} in ONNX, {reference_[i]} in "
                f"{against}. Expected the same label and verdict, and probabilities within {tolerance:g}"
            )
    return np.asarray(largest)


def reference(model: Model, X: Samples) -> Said:
    """Return what a model says of rows of features (n, n_columns), as a graph has to.

    Returns
    -------
    dict of str to ndarray of shape (n, ...)
        The outputs of a graph; how strange the rows are, as "strange"; and as "tied" where neighbours are so
        equally far that rounding says which of them count. Of rows of which nothing can be said: "", NaN.
    """
    prepared = model.prepare(X)
    defined = np.isfinite(prepared).all(axis=1)
    seen = prepared[defined]
    decisions = apply(model.classifier, seen)
    strange = novelty_scores(model.novelty.kind, decisions, seen, model.novelty.class_distance)
    p = model.calibration(decisions)
    said: Said = {}
    for name, values, undefined in (
        ("label", np.array(model.surfaces)[p.argmax(axis=1)], UNDEFINED),
        ("probabilities", p, np.nan),
        ("strange", strange, np.nan),
        ("p_known", model.novelty.p_value(strange), np.nan),
        ("tied", _tied(model.classifier, seen), False),
    ):
        said[name] = np.full((len(X), *values.shape[1:]), undefined, dtype=values.dtype)
        said[name][defined] = values
    return said | {"unknown": _verdict(model, X, np.nan_to_num(said["p_known"]))}


def _tied(classifier: ArrayStep, rows: Samples) -> NDArray[np.bool_]:
    """Return of which prepared rows the last neighbour that counts and the next one are equally far."""
    tied, estimator = np.zeros(len(rows), dtype=bool), classifier.get("estimator")
    if classifier["operation"] == "neighbours":
        n, squares = classifier["n"], np.sort(squared_distances(rows, classifier["points"]), axis=1)
    elif isinstance(estimator, KNeighborsClassifier) and len(rows):
        n, most = estimator.n_neighbors, estimator.n_samples_fit_
        squares = estimator.kneighbors(rows, min(n + 1, most))[0] ** 2
    else:
        return tied
    if n == squares.shape[1]:
        return tied
    # A squared distance may come from |a|^2 - 2 a b + |b|^2.
    rounding = TOLERANCE * squares[:, n] + 1e-13 * np.square(rows).sum(axis=1)
    return np.asarray(squares[:, n] - squares[:, n - 1] <= rounding)


def check_of(said: Said, i: int) -> dict[str, Any]:
    """Return the answer for row i, with which a program can check its own."""
    return {
        "label": str(said["label"][i]),
        "probabilities": said["probabilities"][i].tolist(),
        "p_known": float(said["p_known"][i]),
        "unknown": bool(said["unknown"][i]),
    }


def _rounding(model: Model, X: Samples, p: Samples, rng: np.random.Generator) -> Samples:
    """Return by how much probabilities change with features changed by 1e-13 of themselves, shape (n,)."""
    changes = np.zeros(len(X))
    for _ in range(3):
        nudged = reference(model, X * (1 + 1e-13 * rng.choice([-1.0, 1.0], X.shape)))["probabilities"]
        changes = np.maximum(changes, np.nan_to_num(np.abs(nudged - p)).max(axis=1))
    return changes


def run(graph: bytes, X: NDArray[Any], entry: str = FEATURES, outputs: Sequence[str] = OUTPUTS) -> Said:
    """Return what onnxruntime answers, by output.

    Parameters
    ----------
    graph : bytes
        The ONNX model.
    X : ndarray of shape (n, ...)
        Rows of features, or windows.
    entry : str
        Input that takes them.
    outputs : sequence of str
        What is asked for.

    Raises
    ------
    OnnxExportError
        If it cannot.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        # Distances and spectra take memory: 64 rows or windows at a time.
        batches = (np.ascontiguousarray(X[k : k + 64]) for k in range(0, len(X), 64))
        found = [session.run(list(outputs), {entry: batch}) for batch in batches]
    except Exception as error:  # its exceptions have no class in common
        said = f"onnxruntime {onnxruntime.__version__} cannot run the graph ({error})"
        raise OnnxExportError(f"{said}. Expected operators that it has in double precision") from error
    whole = {name: np.concatenate(parts) for name, *parts in zip(outputs, *found, strict=True)}
    return {name: said.astype(str) if name == "label" else said for name, said in whole.items()}


def check_rows(model: Model, seed: int = SEED) -> tuple[Samples, NDArray[np.str_]]:
    """Return rows on which a model and its graph are compared.

    Parameters
    ----------
    model : Model
        Its ranges say what values the columns had in training; a column without any stays undefined.
    seed : int
        Of everything random.

    Returns
    -------
    X : ndarray of shape (n, n_columns)
        NaN where undefined.
    kinds : ndarray of str, shape (n,)
        "ordinary", "extreme", "undefined" or "boundary".
    """
    rng, order = np.random.default_rng(seed), (UNDEFINED, *sorted(model.surfaces))
    low, median, high = model.ranges.low, model.ranges.median, model.ranges.high
    n_columns = len(median)

    def numbered(X: Samples) -> NDArray[np.intp]:
        said = reference(model, X)
        return np.asarray(2 * np.searchsorted(order, said["label"]) + said["unknown"])

    # Between the ends of the ranges; how far a row strays from the median is drawn as well.
    u = rng.uniform(-1, 1, (100, n_columns)) * rng.uniform(0, 1, (100, 1))
    ordinary = median + u * np.where(u < 0, median - low, high - median)
    # What the model remembers, and rows on the way from there to each other and to others.
    known = remembered(model)
    if len(known):
        every, n = np.concatenate([known, ordinary]), 150
        A, B = (rows[rng.integers(len(rows), size=n)] for rows in (known, every))
        some = known[rng.permutation(len(known))[:n]]
        ordinary = np.concatenate([ordinary, some, _mixed(A, B, rng.uniform(0, 1, n) ** 2)])
    # The ends, corners of the ranges, and as far outside again.
    corners = np.where(rng.random((64, n_columns)) < 0.5, low, high)
    extreme = np.concatenate([[low, median, high], corners, corners + (corners - median)])
    # Without a fifth of their values, or without one; and a row without any.
    gaps = rng.random(ordinary.shape) < 0.2
    gaps[::2] = np.arange(n_columns) == rng.integers(n_columns, size=(len(gaps[::2]), 1))
    undefined = np.concatenate([np.where(gaps, np.nan, ordinary), np.full((1, n_columns), np.nan)])
    boundary = _near_boundaries(ordinary, numbered, rng)
    rows = {"ordinary": ordinary, "extreme": extreme, "undefined": undefined, "boundary": boundary}
    return np.concatenate(list(rows.values())), np.repeat(list(rows), [len(X) for X in rows.values()])


def remembered(model: Model) -> Samples:
    """Return rows of features that a model remembers of its surfaces: training samples, or means of classes.

    None, shape (0, n_columns), where nothing is remembered, or a step cannot be undone.
    """
    distance, nothing = model.novelty.class_distance, np.empty((0, len(model.columns)))
    prepared = _in_classifier(model.classifier)
    if distance is not None:  # the features of the class means that are closest to the mean of all
        prepared.append(distance.mean + distance.class_means @ np.linalg.pinv(distance.projection))
    if not prepared:
        return nothing
    rows = np.concatenate(prepared)
    for part in reversed(model.steps):
        match part:
            case {"operation": "fill" | "clip"}:
                pass
            case {"operation": "standardise", "center": center, "scale": scale}:
                rows = rows * scale + center
            case {"operation": "affine", "scale": scale, "shift": shift}:
                rows = (rows - shift) / scale
            case {"operation": "estimator", "estimator": step} if hasattr(step, "inverse_transform"):
                rows = step.inverse_transform(rows)
            case _:
                return nothing
    return rows


def self_checks(model: Model) -> list[dict[str, Any]]:
    """Return rows of features with the answers they have: medians, with gaps, and what training was like.

    null stands for NaN.
    """
    median = model.ranges.median
    gaps = np.where(np.arange(len(median)) % 2, median, np.nan)
    known = remembered(model)
    some = np.linspace(0, len(known) - 1, min(3, len(known)), dtype=int)
    X = np.concatenate([[median, gaps], known[some]])
    said = reference(model, X)
    answered = np.flatnonzero(said["label"] != UNDEFINED).tolist()
    return [{"features": listed(X[i]), **check_of(said, i)} for i in answered]


def listed(values: Samples) -> list[float | None]:
    """Return values as JSON has them: null for NaN."""
    return [None if np.isnan(value) else value for value in values.tolist()]


def _in_classifier(part: ArrayStep) -> list[Samples]:  # noqa: PLR0911  (one for each kind)
    """Return the prepared rows that a classifier remembers."""
    match part:
        case {"operation": "vote", "whole": dict(whole)}:
            return _in_classifier(whole)
        case {"operation": "chain", "steps": [{"operation": "clip"}], "classifier": dict(kernel)}:
            return _in_classifier(kernel)
        case {"operation": "kernel", "views": [{"mean": mean, "scale": scale, "weights": weights}, *_]}:
            if weights.ndim > 1:
                return []
            is_constant = np.isinf(scale)
            size = np.where(is_constant, 0.0, np.where(is_constant, 1.0, scale) / weights)
            return [mean + part["prototypes"][0] * size]
        case {"operation": "gauss", "mean": rows} | {"operation": "centroids" | "neighbours", "points": rows}:
            return [rows]
        case {"operation": "estimator", "estimator": classifier}:
            names = ("means_", "theta_", "centroids_")  # in which scikit-learn keeps means of classes
            return [np.asarray(getattr(classifier, name)) for name in names if hasattr(classifier, name)]
    return []


def _verdict(model: Model, X: Samples, p_known: Samples) -> NDArray[np.bool_]:
    """Return which rows are unknown, of their p-values."""
    return np.asarray((p_known <= model.novelty.false_alarms) | np.isnan(X).all(axis=1))


def _near_boundaries(
    rows: Samples, name: Callable[[Samples], NDArray[np.intp]], rng: np.random.Generator
) -> Samples:
    """Return mixtures of two rows with different answers, close to where the answer changes, if it does."""
    names, n_pairs = name(rows), 64
    i, j = rng.integers(len(rows), size=(2, 50 * n_pairs))
    pairs = np.flatnonzero(names[i] != names[j])[:n_pairs]
    A, B, named = rows[i[pairs]], rows[j[pairs]], names[i[pairs]]
    low, high = np.zeros(len(pairs)), np.ones(len(pairs))
    for _ in range(30 if len(pairs) else 0):
        middle = (low + high) / 2
        same = name(_mixed(A, B, middle)) == named
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    # So far from the boundary, in parts of the way between the two rows.
    margins = (0.0, 1e-9, 1e-6, 1e-3)
    return np.concatenate([_mixed(A, B, t) for m in margins for t in (low - m, high + m)])


def _mixed(A: Samples, B: Samples, t: Samples) -> Samples:
    return np.asarray(A + t[:, None] * (B - A))
