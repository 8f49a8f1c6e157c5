"""Parity check: an exported graph must give the same labels and probabilities as its model.

The graph and the model classify the same rows of features, which are ordinary, extreme, undefined, or close
to decision boundaries. A difference is an error unless rounding explains it.
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
"""Largest difference of probabilities, and largest relative difference of other numbers, due to rounding."""


Outputs = dict[str, NDArray[Any]]
"""Name of an output of a graph -> its values for all classified rows."""


class ParityError(OnnxExportError):
    """Error for a graph whose answers differ from those of its model; the message gives the first difference.

    Examples
    --------
    >>> issubclass(ParityError, OnnxExportError)
    True
    """


@dataclass(frozen=True)
class Parity:
    """Result of the comparison of a graph with its model.

    Attributes
    ----------
    rows
        Kind of row -> number of rows; see `check_rows`.
    n_predicted, n_surfaces : int
        Number of surfaces that were predicted at least once, and total number of surfaces.
    n_unknown : int
        Number of rows with the answer "unknown".
    n_ties : int
        Number of rows for which rounding causes a different answer.
    difference : float
        Largest difference of a probability.
    tolerance : float
        Largest difference allowed, in addition to the change of the probabilities that a relative change of
        the features by 1e-13 causes.
    """

    rows: dict[str, int]
    n_predicted: int
    n_surfaces: int
    n_unknown: int
    n_ties: int
    difference: float
    tolerance: float = TOLERANCE

    def __str__(self) -> str:
        kinds = ", ".join(f"{n} {kind}" for kind, n in self.rows.items())
        return (
            f"same labels as texclass for {sum(self.rows.values())} rows ({kinds}), probabilities within "
            f"{self.difference:.1e} (tolerance {self.tolerance:g}), {self.n_ties} ties; "
            f"{self.n_predicted} of {self.n_surfaces} surfaces predicted, {self.n_unknown} rows unknown"
        )


def check_parity(model: Model, graph: bytes, *, seed: int = SEED) -> Parity:
    """Compare the answers of a graph with those of its model.

    Parameters
    ----------
    model : Model
        Trained model.
    graph : bytes
        ONNX model.
    seed : int
        Seed of the random rows.

    Returns
    -------
    parity : Parity
        Numbers of rows and largest difference of a probability.

    Raises
    ------
    ParityError
        If a label, a verdict or a probability differs by more than rounding explains. Rounding can swap
        labels with equal probabilities and neighbours at equal distances, and can change the p-value of a
        novelty score that equals a held-out score. It also explains any difference that a relative change of
        the features by 1e-13 can cause.
    OnnxExportError
        If onnxruntime cannot run the graph.

    Examples
    --------
    >>> graph = Path("surfaces.onnx").read_bytes()  # doctest: +SKIP
    >>> print(check_parity(load_model("surfaces.skops"), graph))  # doctest: +SKIP
    """
    X, kinds = check_rows(model, seed)
    expected, outputs = reference(model, X), run(graph, X)
    tolerance = TOLERANCE + _sensitivity(model, X, expected["probabilities"], np.random.default_rng(seed))
    tolerance[expected["tied"]] = np.inf
    # Kernel decisions are at most about 1: scores below 1e-3 have the same tolerance as a score of 1e-3.
    score_tolerance = TOLERANCE * np.maximum(np.abs(expected["novelty_score"]), 1e-3)
    names = [f"row {i} ({kind})" for i, kind in enumerate(kinds)]
    difference = check_same(
        model, X, outputs, expected, tolerance=tolerance, score_tolerance=score_tolerance,
        against="texclass", names=names, stated_tolerance=TOLERANCE,
    )  # fmt: skip
    is_tie = (outputs["label"] != expected["label"]) | (difference > TOLERANCE)
    is_tie |= (expected["label"] != UNDEFINED) & (outputs["p_known"] != expected["p_known"])
    unique_kinds, counts = np.unique(kinds, return_counts=True)
    return Parity(
        rows=dict(zip(unique_kinds.tolist(), counts.tolist(), strict=True)),
        n_predicted=len(set(expected["label"].tolist()) - {UNDEFINED}),
        n_surfaces=len(model.surfaces),
        n_unknown=int(expected["unknown"].sum()),
        n_ties=int(is_tie.sum()),
        difference=float(difference[difference <= TOLERANCE].max(initial=0.0)),
    )


def check_same(
    model: Model,
    X: Samples,
    outputs: Mapping[str, NDArray[Any]],
    expected: Outputs,
    *,
    tolerance: Samples,
    score_tolerance: Samples,
    against: str,
    names: Sequence[str],
    stated_tolerance: float,
) -> Samples:
    """Raise an error if the outputs of a graph differ from the expected ones by more than the tolerance.

    Parameters
    ----------
    model : Model
        Trained model.
    X : ndarray of shape (n, n_columns)
        Features of the classified rows.
    outputs, expected : mapping of str to ndarray
        Outputs of the graph, and outputs of the model as returned by `reference`.
    tolerance, score_tolerance : ndarray of shape (n,)
        Largest differences allowed between probabilities and between novelty scores.
    against, names, stated_tolerance
        Texts for the error message: what the graph is compared with, name of each row, and tolerance.

    Returns
    -------
    ndarray of shape (n,)
        Largest difference of a probability in each row.

    Raises
    ------
    ParityError
        If the outputs differ; the message states the first difference and the number of differences.
    """
    is_defined = expected["label"] != UNDEFINED
    p, expected_p = outputs["probabilities"], expected["probabilities"]
    differences = np.nan_to_num(np.abs(p - expected_p), nan=np.inf)
    differences[~is_defined & np.isnan(p).all(axis=1)] = 0.0
    rows = np.arange(len(X))
    largest, column = differences.max(axis=1), differences.argmax(axis=1)
    # The label must have the largest probability of the graph, and, except for ties, of the model.
    class_index = {surface: k for k, surface in enumerate(model.surfaces)}
    k = np.array([class_index.get(label, -1) for label in outputs["label"].tolist()])
    label_p, expected_label_p = (np.where(k >= 0, values[rows, k], np.nan) for values in (p, expected_p))
    is_best = (label_p == p.max(axis=1)) & (expected_label_p >= expected_p.max(axis=1) - 2 * tolerance)
    # The p-value must be that of the expected novelty score, within its tolerance.
    p_known, score = outputs["p_known"], expected["novelty_score"]
    low, high = (model.novelty.p_value(score + sign * score_tolerance) for sign in (1, -1))
    is_between = (low <= p_known) & (p_known <= high)
    verdict = _is_unknown(model, X, np.nan_to_num(p_known))
    labels = outputs["label"]
    for name, is_same, values, expected_values in (
        ("label", np.where(is_defined, is_best, labels == UNDEFINED), labels, expected["label"]),
        ("probability", largest <= tolerance, p[rows, column], expected_p[rows, column]),
        ("p_known", np.where(is_defined, is_between, np.isnan(p_known)), p_known, expected["p_known"]),
        ("unknown =", outputs["unknown"] == verdict, outputs["unknown"], verdict),
    ):
        if not is_same.all():
            i = int(np.argmin(is_same))
            raise ParityError(
                f"ONNX differs from {against} in {int((~is_same).sum())} of {len(names)} "
                f"{names[i].partition(' ')[0]}s; {names[i]} has {name} {values[i]} in ONNX, "
                f"{expected_values[i]} in {against}. Expected the same label and verdict, and probabilities "
                f"within {stated_tolerance:g}"
            )
    return np.asarray(largest)


def reference(model: Model, X: Samples) -> Outputs:
    """Return the answers of a model for rows of features (n, n_columns), named like the outputs of a graph.

    Returns
    -------
    dict of str to ndarray
        Arrays with one row per row of features: the outputs of a graph, "novelty_score", and "tied" (whether
        rounding decides which neighbours count). Rows without a defined answer have the label "" and NaN.
    """
    prepared = model.prepare(X)
    is_defined = np.isfinite(prepared).all(axis=1)
    rows = prepared[is_defined]
    decisions = apply(model.classifier, rows)
    scores = novelty_scores(model.novelty.kind, decisions, rows, model.novelty.class_distance)
    p = model.calibration(decisions)
    outputs: Outputs = {}
    for name, values, undefined in (
        ("label", np.array(model.surfaces)[p.argmax(axis=1)], UNDEFINED),
        ("probabilities", p, np.nan),
        ("novelty_score", scores, np.nan),
        ("p_known", model.novelty.p_value(scores), np.nan),
        ("tied", _has_tied_neighbours(model.classifier, rows), False),
    ):
        outputs[name] = np.full((len(X), *values.shape[1:]), undefined, dtype=values.dtype)
        outputs[name][is_defined] = values
    return outputs | {"unknown": _is_unknown(model, X, np.nan_to_num(outputs["p_known"]))}


def _has_tied_neighbours(classifier: ArrayStep, rows: Samples) -> NDArray[np.bool_]:
    """Return a mask of prepared rows whose n-th nearest neighbour and the next are at equal distances."""
    is_tied, estimator = np.zeros(len(rows), dtype=bool), classifier.get("estimator")
    if classifier["operation"] == "neighbours":
        n, squares = classifier["n"], np.sort(squared_distances(rows, classifier["points"]), axis=1)
    elif isinstance(estimator, KNeighborsClassifier) and len(rows):
        n, n_points = estimator.n_neighbors, estimator.n_samples_fit_
        squares = estimator.kneighbors(rows, min(n + 1, n_points))[0] ** 2
    else:
        return is_tied
    if n == squares.shape[1]:
        return is_tied
    # The graph computes squared distances as |a|^2 - 2 a b + |b|^2, which rounds differently.
    rounding = TOLERANCE * squares[:, n] + 1e-13 * np.square(rows).sum(axis=1)
    return np.asarray(squares[:, n] - squares[:, n - 1] <= rounding)


def answer_check(outputs: Outputs, i: int) -> dict[str, Any]:
    """Return the answer for row `i` in a form that JSON can store, for the self-check of a program."""
    return {
        "label": str(outputs["label"][i]),
        "probabilities": outputs["probabilities"][i].tolist(),
        "p_known": float(outputs["p_known"][i]),
        "unknown": bool(outputs["unknown"][i]),
    }


def _sensitivity(model: Model, X: Samples, p: Samples, rng: np.random.Generator) -> Samples:
    """Return the largest change of a probability if the features change by a factor of 1 +- 1e-13."""
    changes = np.zeros(len(X))
    for _ in range(3):
        changed_p = reference(model, X * (1 + 1e-13 * rng.choice([-1.0, 1.0], X.shape)))["probabilities"]
        changes = np.maximum(changes, np.nan_to_num(np.abs(changed_p - p)).max(axis=1))
    return changes


def run(graph: bytes, X: NDArray[Any], entry: str = FEATURES, outputs: Sequence[str] = OUTPUTS) -> Outputs:
    """Run a graph in onnxruntime and return its outputs.

    Parameters
    ----------
    graph : bytes
        ONNX model.
    X : ndarray of shape (n, ...)
        Rows of features, or windows.
    entry : str
        Name of the input.
    outputs : sequence of str
        Names of the outputs to return.

    Raises
    ------
    OnnxExportError
        If onnxruntime cannot run the graph.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        # Batches of 64 rows or windows limit the memory for distances and spectra.
        batches = (np.ascontiguousarray(X[k : k + 64]) for k in range(0, len(X), 64))
        results = [session.run(list(outputs), {entry: batch}) for batch in batches]
    except Exception as error:  # the exceptions of onnxruntime have no common base class
        raise OnnxExportError(
            f"onnxruntime {onnxruntime.__version__} cannot run the graph ({error}). Install a newer "
            "version, which supports the operators of the graph in double precision"
        ) from error
    arrays = {name: np.concatenate(batches) for name, *batches in zip(outputs, *results, strict=True)}
    return {name: values.astype(str) if name == "label" else values for name, values in arrays.items()}


def check_rows(model: Model, seed: int = SEED) -> tuple[Samples, NDArray[np.str_]]:
    """Return the rows of features for which a model and its graph are compared.

    Parameters
    ----------
    model : Model
        Trained model with the ranges of its features. Columns that were never defined in training are
        undefined in all rows.
    seed : int
        Seed of the random rows.

    Returns
    -------
    X : ndarray of shape (n, n_columns)
        Rows of features, with NaN for undefined features.
    kinds : ndarray of str, shape (n,)
        Kind of each row: "ordinary", "extreme", "undefined" or "boundary".
    """
    rng, order = np.random.default_rng(seed), (UNDEFINED, *sorted(model.surfaces))
    low, median, high = model.ranges.low, model.ranges.median, model.ranges.high
    n_columns = len(median)

    def answer_number(X: Samples) -> NDArray[np.intp]:
        outputs = reference(model, X)
        return np.asarray(2 * np.searchsorted(order, outputs["label"]) + outputs["unknown"])

    # Within the ranges of training, at random distances from the median.
    u = rng.uniform(-1, 1, (100, n_columns)) * rng.uniform(0, 1, (100, 1))
    ordinary = median + u * np.where(u < 0, median - low, high - median)
    # Stored rows, and mixtures of them with each other and with random rows.
    stored = stored_rows(model)
    if len(stored):
        all_rows, n = np.concatenate([stored, ordinary]), 150
        A, B = (rows[rng.integers(len(rows), size=n)] for rows in (stored, all_rows))
        selected = stored[rng.permutation(len(stored))[:n]]
        ordinary = np.concatenate([ordinary, selected, _mix(A, B, rng.uniform(0, 1, n) ** 2)])
    # Limits and corners of the ranges, and rows twice as far from the median.
    corners = np.where(rng.random((64, n_columns)) < 0.5, low, high)
    extreme = np.concatenate([[low, median, high], corners, corners + (corners - median)])
    # Rows in which a fifth of the values is undefined, or one value, or all.
    is_undefined = rng.random(ordinary.shape) < 0.2
    is_undefined[::2] = np.arange(n_columns) == rng.integers(n_columns, size=(len(is_undefined[::2]), 1))
    undefined = np.concatenate([np.where(is_undefined, np.nan, ordinary), np.full((1, n_columns), np.nan)])
    boundary = _near_boundaries(ordinary, answer_number, rng)
    rows = {"ordinary": ordinary, "extreme": extreme, "undefined": undefined, "boundary": boundary}
    return np.concatenate(list(rows.values())), np.repeat(list(rows), [len(X) for X in rows.values()])


def stored_rows(model: Model) -> Samples:
    """Return the rows of features that a model stores: training samples or class means.

    The shape is (0, n_columns) if the model stores no rows, or if a step cannot be inverted.
    """
    distance, no_rows = model.novelty.class_distance, np.empty((0, len(model.columns)))
    prepared = _rows_in_classifier(model.classifier)
    if distance is not None:  # class means in the space of features, as close to the total mean as possible
        prepared.append(distance.mean + distance.class_means @ np.linalg.pinv(distance.projection))
    if not prepared:
        return no_rows
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
                return no_rows
    return rows


def self_checks(model: Model) -> list[dict[str, Any]]:
    """Return rows of features with their answers, for JSON: medians, medians with gaps, and stored rows."""
    median = model.ranges.median
    with_gaps = np.where(np.arange(len(median)) % 2, median, np.nan)
    stored = stored_rows(model)
    selected = np.linspace(0, len(stored) - 1, min(3, len(stored)), dtype=int)
    X = np.concatenate([[median, with_gaps], stored[selected]])
    outputs = reference(model, X)
    indices = np.flatnonzero(outputs["label"] != UNDEFINED).tolist()
    return [{"features": to_json(X[i]), **answer_check(outputs, i)} for i in indices]


def to_json(values: Samples) -> list[float | None]:
    """Return values as a list in which None (null in JSON) replaces NaN."""
    return [None if np.isnan(value) else value for value in values.tolist()]


def _rows_in_classifier(part: ArrayStep) -> list[Samples]:  # noqa: PLR0911  (one for each kind)
    """Return the prepared rows that a classifier stores."""
    match part:
        case {"operation": "vote", "whole": dict(whole)}:
            return _rows_in_classifier(whole)
        case {"operation": "chain", "steps": [{"operation": "clip"}], "classifier": dict(kernel)}:
            return _rows_in_classifier(kernel)
        case {"operation": "kernel", "views": [{"mean": mean, "scale": scale, "weights": weights}, *_]}:
            if weights.ndim > 1:
                return []
            is_constant = np.isinf(scale)
            size = np.where(is_constant, 0.0, np.where(is_constant, 1.0, scale) / weights)
            return [mean + part["prototypes"][0] * size]
        case {"operation": "gauss", "mean": rows} | {"operation": "centroids" | "neighbours", "points": rows}:
            return [rows]
        case {"operation": "estimator", "estimator": classifier}:
            names = ("means_", "theta_", "centroids_")  # class means of scikit-learn estimators
            return [np.asarray(getattr(classifier, name)) for name in names if hasattr(classifier, name)]
    return []


def _is_unknown(model: Model, X: Samples, p_known: Samples) -> NDArray[np.bool_]:
    return np.asarray((p_known <= model.novelty.false_alarms) | np.isnan(X).all(axis=1))


def _near_boundaries(
    rows: Samples, answer_number: Callable[[Samples], NDArray[np.intp]], rng: np.random.Generator
) -> Samples:
    """Return mixtures of two rows with different answers that are close to the boundary (by bisection)."""
    answers, n_pairs = answer_number(rows), 64
    i, j = rng.integers(len(rows), size=(2, 50 * n_pairs))
    pairs = np.flatnonzero(answers[i] != answers[j])[:n_pairs]
    A, B, answers_of_A = rows[i[pairs]], rows[j[pairs]], answers[i[pairs]]
    low, high = np.zeros(len(pairs)), np.ones(len(pairs))
    for _ in range(30 if len(pairs) else 0):
        middle = (low + high) / 2
        is_same = answer_number(_mix(A, B, middle)) == answers_of_A
        low, high = np.where(is_same, middle, low), np.where(is_same, high, middle)
    # Distances from the boundary as fractions of the distance between the two rows.
    margins = (0.0, 1e-9, 1e-6, 1e-3)
    return np.concatenate([_mix(A, B, t) for m in margins for t in (low - m, high + m)])


def _mix(A: Samples, B: Samples, t: Samples) -> Samples:
    return np.asarray(A + t[:, None] * (B - A))
