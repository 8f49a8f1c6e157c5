"""What a trained recogniser does after the features, as arrays and a few kinds of steps.

Every estimator that shipped pipelines name is described once here, as a mapping that says what it `does` with
which arrays: it is answered from, kept in model files (JSON beside arrays, so that an answer needs neither
scikit-learn nor skops), and other programs may be told it. Whatever has no such form is asked itself.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from texclass.features.cepstrum import Banks, with_banks
from texclass.features.plan import Computed, Plan
from texclass.phases import segment
from texclass.recognition.probabilities import class_scores, log_of, softmax
from texclass.recording import Recording, Samples

if TYPE_CHECKING:
    from texclass.tradeoff.recogniser import Recogniser

Part = Mapping[str, Any]
Function = Callable[[Samples], Samples]
Columns = NDArray[np.intp] | slice
Learnt = tuple[Samples, NDArray[Any]]
"""Prepared rows (n, n_columns) and their labels (n,)."""
MOST_AT_ONCE = 1 << 20
"""Differences of rows and points that are held at a time."""


class Deployed:
    """A recogniser as it answers: rows of features in, prepared rows and decisions out.

    Parameters
    ----------
    plan : Plan
        What is computed of a recording.
    classes : sequence of str
        The materials, in the order of the decisions.
    steps : sequence of mapping
        What prepares rows; see `described_steps`.
    decide : mapping
        What decides; see `described_classifier`.
    load : callable
        Returns the recogniser of scikit-learn.
    banks : dict, optional
        Mel filters that the features need; see `texclass.features.cepstrum.with_banks`.
    """

    def __init__(
        self,
        plan: Plan,
        classes: Sequence[str],
        steps: Sequence[Part],
        decide: Part,
        load: "Callable[[], Recogniser]",
        banks: "Banks | None" = None,
    ) -> None:
        self.banks: Banks = {} if banks is None else banks
        self.plan, self.classes, self.steps, self.decide = plan, tuple(classes), tuple(steps), decide
        self._load, self._functions = load, [function_of(part) for part in (*self.steps, decide)]

    @classmethod
    def of(cls, recogniser: "Recogniser", learnt: Learnt | None = None) -> "Deployed":
        """Return a fitted recogniser as it answers; `learnt` as `described_classifier` takes it."""
        steps = [part for _, step in recogniser.steps[1:-1] for part in described_steps(step)]
        classes = [str(name) for name in recogniser[-1].classes_]
        decide = described_classifier(recogniser[-1], learnt)
        return cls(recogniser[0].plan_, classes, steps, decide, lambda: recogniser)

    def document(self) -> dict[str, Any]:
        """Return it as plain data and arrays."""
        return {
            "plan": self.plan.to_json(),
            "channels": list(self.plan.channels),
            "classes": list(self.classes),
            "steps": list(self.steps),
            "decide": self.decide,
            "banks": [{"of": key, "weights": weights} for key, weights in self.banks.items()],
        }

    @classmethod
    def of_document(
        cls, stated: Mapping[str, Any], load: "Callable[[], Recogniser]"
    ) -> "tuple[Deployed, bool]":
        """Return what `document` described, and whether the code of its features is still the same."""
        plan, same_code = Plan.of_json(stated["plan"], stated["channels"])
        banks = {tuple(bank["of"]): bank["weights"] for bank in stated["banks"]}
        return cls(plan, stated["classes"], stated["steps"], stated["decide"], load, banks), same_code

    @cached_property
    def recogniser(self) -> "Recogniser":
        """The same as a pipeline of scikit-learn."""
        return self._load()

    def compute(self, recording: Recording) -> Computed:
        """Compute the features of a recording; its phases are found unless it declares them."""
        with with_banks(dict(self.banks)):  # those of other rates are not the model's
            return self.plan.compute(recording.with_(phases=segment(recording)))

    @cached_property
    def asked(self) -> tuple[str, ...]:
        """The classes of scikit-learn that have no array form."""
        return tuple(type(one).__name__ for one in _estimators((*self.steps, self.decide)))

    def decided(self, X: Samples) -> tuple[Samples, Samples]:
        """Return what becomes of rows (n, n_columns): prepared rows, and decisions (n, n_classes).

        Raises
        ------
        ValueError
            If a prepared value is not finite.
        """
        *steps, decide = self._functions
        for step in steps:
            X = step(X)
        if not np.isfinite(X).all():
            raise ValueError("features are undefined; the rule is a pipeline with a step that fills them")
        return X, decide(X)


def prepared_by(recogniser: "Recogniser", rows: Samples) -> Samples:
    """Return what the steps between features and classifier make of rows of features (n, n_columns)."""
    for _, step in recogniser.steps[1:-1]:
        rows = rows if step in (None, "passthrough") else step.transform(rows)
    return rows


def described_steps(step: Any) -> list[Part]:  # noqa: PLR0911  (one for each kind)
    """Return what a fitted transformer does, as steps one after the other.

    "take" columns; "fill" undefined values; "standardise", (X - center) / scale; "affine", X scale + shift;
    "clip" to low ... high; "ask" an estimator.
    """
    from sklearn.feature_selection import SelectorMixin
    from sklearn.impute import SimpleImputer
    from sklearn.pipeline import Pipeline
    from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

    match step:
        case None | "passthrough":
            return []
        case Pipeline():
            return [part for _, inner in step.steps for part in described_steps(inner)]
        case SelectorMixin():
            return [_does("take", columns=np.flatnonzero(step.get_support()))]
        case SimpleImputer(add_indicator=False, missing_values=gap) if np.isnan(gap):
            values, taken = np.asarray(step.statistics_, dtype=np.float64), []
            if not step.keep_empty_features and np.isnan(values).any():
                kept = np.flatnonzero(~np.isnan(values))
                values, taken = values[kept], [_does("take", columns=kept)]
            return [*taken, _does("fill", values=values)]
        case MinMaxScaler():
            low, high = step.feature_range
            clipped = [_does("clip", low=low, high=high)] * step.clip
            return [_does("affine", scale=step.scale_, shift=step.min_), *clipped]
        case StandardScaler():
            return [_standardised(step.mean_ if step.with_mean else None, step.scale_)]
        case RobustScaler():
            return [_standardised(step.center_, step.scale_)]
        case MaxAbsScaler() if not getattr(step, "clip", False):
            return [_standardised(None, step.scale_)]
    return [_does("ask", estimator=step)]


def _does(what: str, **held: Any) -> Part:
    """Return the description of a step: the arguments of its function in `FUNCTIONS`."""
    return {"does": what, **held}


def _standardised(center: Samples | None, scale: Samples | None) -> Part:
    known = {"center": 0.0 if center is None else center, "scale": 1.0 if scale is None else scale}
    return _does("standardise", **known)


def described_classifier(  # noqa: PLR0911
    classifier: Any, learnt: Learnt | None = None, *, votes: bool = False
) -> Part:
    """Return what a fitted classifier does with prepared rows, one decision a class: as `class_scores`.

    "linear", X weights + intercept; "kernel", the mean of Matern kernels between rows and prototypes in each
    view, times dual; "gauss", log posteriors; "centroids", and "neighbours", the shares of the nearest;
    "vote" of pieces of the columns; "chain" of steps and what decides after them; "ask" an estimator.

    Parameters
    ----------
    classifier : classifier
        Fitted.
    learnt : tuple of (X, y), optional
        What it was fitted on. Nearest neighbours keep that to themselves: without it they are asked.
    votes : bool
        Whether it is a voter: what has probabilities alone gives these, of two classes about 0.
    """
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.linear_model import LogisticRegression, RidgeClassifier
    from sklearn.naive_bayes import GaussianNB
    from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
    from sklearn.pipeline import Pipeline

    from texclass.classifiers.kernel_discriminant import KernelDiscriminant
    from texclass.classifiers.segment_voting import SegmentVoting

    n_classes = len(classifier.classes_)
    match classifier:
        case Pipeline():
            steps = [part for _, step in classifier.steps[:-1] for part in described_steps(step)]
            return _does("chain", steps=steps, decide=described_classifier(classifier[-1], votes=votes))
        case LinearDiscriminantAnalysis() | LogisticRegression() | RidgeClassifier():
            weights = _of_both(np.ascontiguousarray(np.atleast_2d(classifier.coef_).T), n_classes)
            return _does("linear", weights=weights, intercept=_of_both(classifier.intercept_, n_classes))
        case KernelDiscriminant():
            kernel = _does(
                "kernel",
                views=[dict(vars(view)) for view in classifier.views_],
                prototypes=list(classifier.prototypes_),
                dual=_of_both(classifier.dual_, n_classes),
                length=float(classifier.length),
            )
            if classifier.limit is None:
                return kernel
            limits = _does("clip", low=classifier.low_, high=classifier.high_)
            return _does("chain", steps=[limits], decide=kernel)
        case GaussianNB():
            prior = classifier.class_prior_
            return _does("gauss", mean=classifier.theta_, variance=classifier.var_, prior=prior, votes=votes)
        case NearestCentroid(metric="euclidean"):
            deviation = classifier.within_class_std_dev_
            scale, prior = np.where(deviation != 0, deviation, 1.0), classifier.class_prior_
            return _does("centroids", points=classifier.centroids_, scale=scale, prior=prior)
        case KNeighborsClassifier(weights="uniform", effective_metric_="euclidean") if learnt is not None:
            known = {"points": learnt[0], "classes": np.searchsorted(classifier.classes_, learnt[1])}
            return _does("neighbours", **known, n=classifier.n_neighbors, n_classes=n_classes, votes=votes)
        case SegmentVoting():
            whole, (divided, n_pieces) = classifier.whole_, classifier.columns_
            return _does(
                "vote",
                n_pieces=n_pieces,
                piece=described_classifier(classifier.estimator_, votes=True),
                whole=None if whole is None else described_classifier(whole, votes=True),
                **({"divided": divided} if classifier.undivided else {}),
                whole_weight=classifier.weight_,
                n_columns=int(classifier.n_features_in_),
                n_classes=n_classes,
            )
    return _does("ask", estimator=classifier, votes=votes)


def _of_both(values: Samples, n_classes: int) -> Samples:
    """Return the last axis as it is; of two classes, what the second has, minus and plus."""
    values = np.asarray(values, dtype=np.float64)
    return np.concatenate([-values[..., -1:], values[..., -1:]], axis=-1) if n_classes == 2 else values


def _estimators(parts: Sequence[Any]) -> list[Any]:
    """Return the estimators in descriptions, however deep."""
    found = []
    for part in parts:
        if isinstance(part, Mapping):
            found += [part["estimator"]] if "estimator" in part else _estimators(list(part.values()))
        elif isinstance(part, list | tuple):
            found += _estimators(part)
    return found


def function_of(part: Part) -> Function:
    """Return what a description does, as a function of rows (n, n_columns).

    Raises
    ------
    KeyError, ValueError
        If it is no such description.
    """
    held = {name: value for name, value in part.items() if name != "does"}
    return FUNCTIONS[part["does"]](**held)


def _chain(steps: Sequence[Part], decide: Part) -> Function:
    functions = [function_of(part) for part in (*steps, decide)]

    def decided(X: Samples) -> Samples:
        for function in functions:
            X = function(X)
        return X

    return decided


def _kernel(
    views: Sequence[Mapping[str, Samples]], prototypes: Sequence[Samples], dual: Samples, length: float
) -> Function:
    """(1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2."""
    known = [
        (v["mean"], v["scale"], v["weights"], np.ascontiguousarray(-2 * b.T), np.einsum("ij,ij->i", b, b))
        for v, b in zip(views, prototypes, strict=True)
    ]
    coefficients = dual / len(known)

    def decided(X: Samples) -> Samples:
        kernel: Samples = np.zeros((len(X), len(dual)))
        for mean, scale, weights, doubled, squares in known:
            Z = (X - mean) / scale
            seen = Z * weights if weights.ndim == 1 else Z @ weights
            s = seen @ doubled
            s += squares
            s += np.einsum("ij,ij->i", seen, seen)[:, None]
            np.maximum(s, 0, out=s)
            s *= 3 / length**2
            np.sqrt(s, out=s)
            kernel += (1 + s) * np.exp(-s)
        return np.asarray(kernel @ coefficients)

    return decided


def _squares(X: Samples, points: Samples, weight: Samples | float = 1.0) -> Samples:
    """Return the sums of (x - point)^2 weight of rows (n, p) and points (m, p), shape (n, m)."""
    size = max(1, MOST_AT_ONCE // max(1, points.size))
    blocks = (X[k : k + size, None] - points for k in range(0, max(1, len(X)), size))
    return np.concatenate([(d * d * weight).sum(axis=2) for d in blocks])


def _as_decisions(p: Samples, votes: bool) -> Samples:
    """Return probabilities (n, n_classes) as decisions; a voter's as they are, of two classes about 0."""
    if not votes:
        return log_of(p)
    return np.column_stack([0.5 - p[:, 1], p[:, 1] - 0.5]) if p.shape[1] == 2 else p


def _gauss(mean: Samples, variance: Samples, prior: Samples, votes: bool) -> Function:
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    inverse = 1 / variance

    def decided(X: Samples) -> Samples:
        return _as_decisions(softmax(level - 0.5 * _squares(X, mean, inverse)), votes)

    return decided


def _centroids(points: Samples, scale: Samples, prior: Samples) -> Function:
    """-|x/s - c/s|^2 + 2 log prior; of two classes, minus the difference and the difference."""
    scaled, level = points / scale, 2 * np.log(prior)

    def decided(X: Samples) -> Samples:
        scores = level - _squares(X / scale, scaled)
        return scores if len(points) > 2 else (scores[:, 1] - scores[:, 0])[:, None] * [-1.0, 1.0]

    return decided


def _neighbours(points: Samples, classes: Samples, n: int, n_classes: int, votes: bool) -> Function:
    right = np.eye(n_classes)[classes]

    def decided(X: Samples) -> Samples:
        nearest = np.argsort(_squares(X, points), axis=1, kind="stable")[:, :n]
        return _as_decisions(right[nearest].mean(axis=1), votes)

    return decided


def _vote(
    n_pieces: int,
    piece: Part,
    whole: Part | None,
    whole_weight: float,
    divided: Columns = slice(None),
    seen: Columns = slice(None),
    **_: int,
) -> Function:
    """Average over the pieces, then that and the whole; pieces that are all the same need no other rule."""
    of_piece, of_whole = function_of(piece), None if whole is None else function_of(whole)

    def decided(X: Samples) -> Samples:
        n = len(X)
        pieces = X[:, divided].reshape(n, -1, n_pieces).swapaxes(1, 2).reshape(n * n_pieces, -1)
        mean = of_piece(pieces).reshape(n, n_pieces, -1).mean(axis=1)
        if of_whole is None:
            return np.asarray(mean)
        return np.asarray((mean + whole_weight * of_whole(X[:, seen])) / (1 + whole_weight))

    return decided


def _ask(estimator: Any, votes: bool | None = None) -> Function:
    """Ask an estimator on one thread: starting more takes longer than the work that they would share."""

    def asked(X: Samples) -> Samples:
        from sklearn import config_context

        from texclass.classifiers.segment_voting import decisions_of
        from texclass.evaluation.workers import one_thread

        with one_thread(), config_context(assume_finite=True, skip_parameter_validation=True):
            if votes is None:
                return np.asarray(estimator.transform(X))
            if not votes:
                return class_scores(estimator, X)
            found = decisions_of(estimator, X)
            return found if found.ndim == 2 else np.column_stack([-found, found])

    return asked


FUNCTIONS: Mapping[str, Callable[..., Function]] = {
    "take": lambda columns: lambda X: X[:, columns],
    "fill": lambda values: lambda X: np.where(np.isnan(X), values, X),
    "standardise": lambda center, scale: lambda X: (X - center) / scale,
    "affine": lambda scale, shift: lambda X: X * scale + shift,
    "clip": lambda low, high: lambda X: np.clip(X, low, high),
    "linear": lambda weights, intercept: lambda X: X @ weights + intercept,
    "kernel": _kernel,
    "gauss": _gauss,
    "centroids": _centroids,
    "neighbours": _neighbours,
    "vote": _vote,
    "chain": _chain,
    "ask": _ask,
}
"""What is done -> what makes a function of rows, of what else the description holds."""
