"""Novelty detection: scores, thresholds and the ranges of the training features."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples

Labels = NDArray[np.intp]
ScoreKind = Literal["decision", "distance"]
"""Novelty score: minus the largest decision, or the distance to the nearest class mean."""
TOLERANCE_CONFIDENCE = 0.95
"""Fraction of training sets for which a conservative threshold does not exceed its rate of false alarms."""
SHRINKAGE = 0.1
"""Shrinkage of the within-class covariance of `ClassDistance` towards a multiple of the identity."""
FAR_OUTSIDE = 0.5
"""Distance from the training range, in widths of this range, beyond which a value is reported."""


@dataclass(frozen=True, eq=False)
class ClassDistance:
    """Squared distance to the nearest class mean in discriminant space.

    Features are standardised and whitened by the within-class covariance, then projected onto the subspace of
    the class means, in which the trained surfaces differ. Variation between strokes in the other directions
    would hide an unknown surface.

    Attributes
    ----------
    mean : ndarray of shape (n_features,)
        Mean of the training samples.
    projection : ndarray of shape (n_features, n_directions)
        Matrix that standardises, whitens and projects.
    class_means : ndarray of shape (n_classes, n_directions)
        Projected class means.
    """

    mean: Samples
    projection: Samples
    class_means: Samples

    def __call__(self, rows: Samples) -> Samples:
        """Return the squared distance of rows (n, n_features) to the nearest class mean, shape (n,)."""
        projected = (rows - self.mean) @ self.projection
        return np.asarray(((projected[:, None] - self.class_means) ** 2).sum(axis=2).min(axis=1))


def fit_class_distance(X: Samples, labels: Labels) -> ClassDistance:
    """Fit the discriminant space of prepared features.

    With S = (1 - r) S_w + r tr(S_w)/p I and r = `SHRINKAGE`, features are multiplied by S^(-1/2) and
    projected onto the span of the whitened class means.

    Parameters
    ----------
    X : ndarray of shape (n, n_features)
        Prepared features.
    labels : ndarray of int, shape (n,)
        Class of each row, 0 ... n_classes - 1.
    """
    from scipy import linalg

    mean, std = X.mean(axis=0), X.std(axis=0)
    inverse = np.divide(1.0, std, out=np.zeros_like(std), where=std > 1e-12 * np.abs(mean))
    Z = (X - mean) * inverse
    counts = np.bincount(labels)
    means = np.eye(len(counts))[labels].T @ Z / counts[:, None]
    residual = Z - means[labels]
    S = residual.T @ residual / max(1, len(Z) - len(counts))
    eigenvalues, vectors = linalg.eigh(S, driver="evd")
    level = np.trace(S) / len(S) or 1.0
    root = vectors / np.sqrt((1 - SHRINKAGE) * np.maximum(eigenvalues, 0) + SHRINKAGE * level)
    M = means @ root
    _, sizes, directions = linalg.svd(M - M.mean(axis=0), full_matrices=False)
    is_spanned = sizes[: len(counts) - 1] > 1e-9 * (sizes[0] or 1.0)
    basis = directions[: len(counts) - 1][is_spanned].T
    return ClassDistance(mean, inverse[:, None] * (root @ basis), M @ basis)


def score_kind(classifier: Any) -> ScoreKind:
    """Return the novelty score that suits a classifier.

    Decisions of a kernel discriminant estimate class membership and fall to zero far from all training
    samples, so minus the largest decision is the better score. Decisions of linear and probabilistic
    classifiers only compare classes with each other.
    """
    from texclass.classifiers.kernel_discriminant import KernelDiscriminant
    from texclass.classifiers.segment_voting import SegmentVoting

    return "decision" if isinstance(classifier, KernelDiscriminant | SegmentVoting) else "distance"


def novelty_scores(
    kind: ScoreKind, decisions: Samples, prepared: Samples, class_distance: ClassDistance | None
) -> Samples:
    """Return the novelty score of each row, shape (n,); large if the row is unlike the training set.

    Parameters
    ----------
    kind : {"decision", "distance"}
        Score; see `score_kind`.
    decisions : ndarray of shape (n, n_classes)
        Decisions of the classifier.
    prepared : ndarray of shape (n, n_features)
        Prepared features, the input of the classifier.
    class_distance : ClassDistance or None
        Distance for the kind "distance".
    """
    if kind == "decision" or class_distance is None:
        return np.asarray(-decisions.max(axis=1))
    return class_distance(prepared)


def min_held_out(false_alarms: float) -> int:
    """Return the minimum number of held-out recordings for a rate of false alarms.

    Raises
    ------
    ValueError
        If the rate is not between 0 and 1.

    Examples
    --------
    >>> min_held_out(0.05)
    19
    """
    if not 0 < false_alarms < 1:
        raise ValueError(f"false_alarms must be between 0 and 1, got {false_alarms!r}")
    return int(np.ceil(1 / false_alarms - 1e-9)) - 1


def check_false_alarms(false_alarms: float, n_held_out: int) -> None:
    """Check that the number of held-out recordings suffices for a rate of false alarms.

    Raises
    ------
    ValueError
        If there are too few recordings, or the rate is not between 0 and 1.
    """
    if n_held_out < (n_needed := min_held_out(false_alarms)):
        raise ValueError(
            f"false_alarms = {false_alarms:g} requires at least {n_needed} held-out recordings, got "
            f"{n_held_out}. Record more, or accept a larger rate of false alarms"
        )


def conservative_rate(false_alarms: float, n_held_out: int, growth: float = 1.0) -> float:
    """Return a reduced rate that keeps the requested rate even with few held-out recordings.

    A conformal threshold keeps its rate of false alarms on average over many training sets. For a single
    training set with few held-out recordings, the rate may be twice as large. The tolerance limit is a
    threshold that keeps the rate for 95 % of training sets. It is the k-th largest score, with the largest k
    for which P[Binomial(n, rate) < k] <= 5 %. If n is too small for any k (below 59 at 5 %), the largest
    score is the threshold. As a consequence, fewer unknown surfaces are detected.

    Parameters
    ----------
    false_alarms : float
        Accepted share of trained surfaces that are reported as unknown.
    n_held_out : int
        Number of held-out recordings.
    growth : float
        Ratio of the rate of false alarms of later recordings to the rate of held-out ones (default 1).

    References
    ----------
    Wilks: Determination of sample sizes for setting tolerance limits, Annals of Mathematical Statistics 12,
    1941.

    Examples
    --------
    >>> round(conservative_rate(0.05, 100), 3)
    0.02
    """
    from scipy.stats import binom

    rate = false_alarms / growth
    k = int(np.count_nonzero(binom.cdf(np.arange(n_held_out), n_held_out, rate) <= 1 - TOLERANCE_CONFIDENCE))
    return min(false_alarms, max(k, 1) / (n_held_out + 1))


@dataclass(frozen=True, eq=False)
class NoveltyDetector:
    """Conformal test of whether a recording is of a trained surface.

    Attributes
    ----------
    kind : {"decision", "distance"}
        Novelty score; see `novelty_scores`.
    held_out : ndarray of shape (n,)
        Scores of held-out training recordings, ascending. If empty, no recording is reported as unknown.
    false_alarms : float
        Share of recordings of trained surfaces that may be reported as unknown.
    class_distance : ClassDistance, optional
        Distance for the kind "distance".

    Examples
    --------
    >>> import numpy as np
    >>> detector = NoveltyDetector("decision", held_out=np.linspace(-1.0, 0.0, 19), false_alarms=0.05)
    >>> detector.p_value(np.array([-0.5, 0.3])).tolist()
    [0.55, 0.05]
    """

    kind: ScoreKind
    held_out: Samples
    false_alarms: float
    class_distance: ClassDistance | None = None

    def __post_init__(self) -> None:
        if len(self.held_out):
            check_false_alarms(self.false_alarms, len(self.held_out))

    def p_value(self, scores: Samples) -> Samples:
        """Return the conformal p-value of "the surface is in the training set", shape (n,).

        The p-value is p = (1 + #{held-out scores >= score}) / (n + 1). If a recording of a trained surface is
        exchangeable with the held-out ones, the probability of p <= a is at most a.

        Parameters
        ----------
        scores : ndarray of shape (n,)
            Novelty scores.

        References
        ----------
        Vovk, Gammerman, Shafer: Algorithmic learning in a random world, 2005, chapter 2.
        """
        n_larger = len(self.held_out) - np.searchsorted(self.held_out, scores, side="left")
        return np.asarray((1 + n_larger) / (len(self.held_out) + 1))

    @property
    def threshold(self) -> float:
        """Novelty score above which a recording is reported as unknown."""
        n = len(self.held_out)
        if not n:
            return np.inf
        n_above = int(np.floor(self.false_alarms * (n + 1) + 1e-9)) - 1  # held-out scores above it
        return float(self.held_out[n - 1 - n_above])

    def document(self) -> dict[str, Any]:
        """Return the detector as plain data and arrays."""
        distance = {} if self.class_distance is None else dict(vars(self.class_distance))
        return {
            "kind": self.kind, "held_out": self.held_out, "false_alarms": self.false_alarms,
            "class_distance": distance,
        }  # fmt: skip

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "NoveltyDetector":
        """Return the detector that `document` describes.

        Raises
        ------
        ValueError
            If the kind is not a novelty score.
        """
        if document["kind"] not in ("decision", "distance"):
            raise ValueError(f"kind must be 'decision' or 'distance', got {document['kind']!r}")
        arrays = {
            name: np.asarray(values, dtype=np.float64) for name, values in document["class_distance"].items()
        }
        held_out = np.sort(np.asarray(document["held_out"], dtype=np.float64))
        return cls(
            document["kind"],
            held_out,
            float(document["false_alarms"]),
            ClassDistance(**arrays) if arrays else None,
        )


@dataclass(frozen=True, eq=False)
class FeatureRanges:
    """Smallest value, median and largest value of each column in the training set; NaN if undefined.

    Attributes
    ----------
    low, median, high : ndarray of shape (n_columns,)
        Smallest value, median and largest value.
    """

    low: Samples
    median: Samples
    high: Samples

    @classmethod
    def from_features(cls, X: Samples) -> "FeatureRanges":
        """Return the ranges of the columns of X (n, n_columns), NaN where undefined."""
        is_empty = np.isnan(X).all(axis=0)
        edges = np.nanquantile(np.where(is_empty, 0.0, X), [0, 0.5, 1], axis=0)
        return cls(*(np.where(is_empty, np.nan, edge) for edge in edges))

    def distance_outside(self, values: Samples) -> Samples:
        """Return the distance of values from the range in range widths, shape (n_columns,); 0 inside."""
        distance = np.fmax(np.fmax(self.low - values, values - self.high), 0.0)
        width = np.maximum(self.high - self.low, 1e-9 * np.maximum(np.abs(self.high), np.abs(self.low)))
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(distance > 0, distance / width, 0.0)
        return np.asarray(np.nan_to_num(relative))


class ClassMoments(NamedTuple):
    """Class means and within-class standard deviation of the training features, used for domain adaptation.

    Attributes
    ----------
    means : ndarray of shape (n_surfaces, n_columns)
        Mean of each surface; NaN where a column is undefined for it.
    within_std : ndarray of shape (n_columns,)
        Standard deviation of recordings from the mean of their surface.
    """

    means: Samples
    within_std: Samples

    @classmethod
    def from_features(cls, X: Samples, y: NDArray[Any]) -> "ClassMoments":
        """Return the moments of features X (n, n_columns), NaN where undefined, with surfaces y (n,)."""
        names, labels = np.unique(y, return_inverse=True)
        is_defined, one_hot = ~np.isnan(X), np.eye(len(names))[labels]
        with np.errstate(invalid="ignore"):
            means = one_hot.T @ np.where(is_defined, X, 0) / (one_hot.T @ is_defined)
            squares = np.where(is_defined, (X - means[labels]) ** 2, 0).sum(axis=0)
        freedom = np.maximum(is_defined.sum(axis=0) - np.isfinite(means).sum(axis=0), 1)
        return cls(means, np.sqrt(squares / freedom))
