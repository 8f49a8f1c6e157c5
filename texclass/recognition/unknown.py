"""Surfaces that were never trained: where training lay, a score of strangeness, a chosen false-alarm rate."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples

Labels = NDArray[np.intp]
Kind = Literal["decision", "distance"]
CONFIDENCE = 0.95
SHRINKAGE = 0.1
"""Of the within-class covariance in `Nearness`."""


@dataclass(frozen=True, eq=False)
class Nearness:
    """Distance to the nearest class mean in the discriminant's view.

    Features are standardised and whitened by their within-class covariance, then seen in the subspace that
    the class means span: directions in which known surfaces differ. Others hold what varies from stroke to
    stroke, and hide a stranger.

    Attributes
    ----------
    mean : ndarray of shape (n_features,)
        Of the training samples.
    view : ndarray of shape (n_features, n_directions)
        Standardises, whitens and projects.
    means : ndarray of shape (n_classes, n_directions)
        Class means in the view.
    """

    mean: Samples
    view: Samples
    means: Samples

    def __call__(self, rows: Samples) -> Samples:
        """Return the squared distance of rows (n, n_features) to the nearest mean, shape (n,)."""
        seen = (rows - self.mean) @ self.view
        return np.asarray(((seen[:, None] - self.means) ** 2).sum(axis=2).min(axis=1))


def fit_nearness(X: Samples, labels: Labels) -> Nearness:
    """Learn the discriminant's view of prepared features (n, n_features) and labels 0 ... K - 1 (n,).

    With S = (1 - r) S_w + r tr(S_w)/p I and r = `SHRINKAGE`, the view is S^(-1/2) followed by the directions
    that the whitened class means span.
    """
    from scipy import linalg

    mean, deviation = X.mean(axis=0), X.std(axis=0)
    inverse = np.divide(1.0, deviation, out=np.zeros_like(deviation), where=deviation > 1e-12 * np.abs(mean))
    Z = (X - mean) * inverse
    counts = np.bincount(labels)
    means = np.eye(len(counts))[labels].T @ Z / counts[:, None]
    within = Z - means[labels]
    S = within.T @ within / max(1, len(Z) - len(counts))
    values, vectors = linalg.eigh(S, driver="evd")
    level = np.trace(S) / len(S) or 1.0
    root = vectors / np.sqrt((1 - SHRINKAGE) * np.maximum(values, 0) + SHRINKAGE * level)
    M = means @ root
    _, sizes, directions = linalg.svd(M - M.mean(axis=0), full_matrices=False)
    kept = directions[: len(counts) - 1][sizes[: len(counts) - 1] > 1e-9 * (sizes[0] or 1.0)].T
    return Nearness(mean, inverse[:, None] * (root @ kept), M @ kept)


def kind_for(classifier: Any) -> Kind:
    """Return which score suits a classifier.

    The decision of a kernel discriminant estimates membership and falls to nothing away from all training
    samples, so the largest of them is the better score. Those of a linear or probabilistic classifier only
    compare classes with each other.
    """
    from texclass.classifiers.kernel_discriminant import KernelDiscriminant
    from texclass.classifiers.segment_voting import SegmentVoting

    return "decision" if isinstance(classifier, KernelDiscriminant | SegmentVoting) else "distance"


def strangeness(kind: Kind, decisions: Samples, prepared: Samples, nearness: Nearness | None) -> Samples:
    """Return how strange recordings are, shape (n,): minus the largest decision, or the distance."""
    if kind == "decision" or nearness is None:
        return np.asarray(-decisions.max(axis=1))
    return nearness(prepared)


def least_held_out(false_alarms: float) -> int:
    """Return how many held-out recordings it takes for such a rate of false alarms.

    Raises
    ------
    ValueError
        If it is no rate.
    """
    if not 0 < false_alarms < 1:
        raise ValueError(f"false_alarms is {false_alarms!r}. Expected a number between 0 and 1")
    return int(np.ceil(1 / false_alarms - 1e-9)) - 1


def check_false_alarms(false_alarms: float, n_held_out: int) -> None:
    """Check that so many held-out recordings can give such a rate.

    Raises
    ------
    ValueError
        If not.
    """
    if n_held_out < (least := least_held_out(false_alarms)):
        raise ValueError(
            f"false_alarms is {false_alarms:g}, {n_held_out} recordings are held out. "
            f"Expected at least {least} of them"
        )


def cautious(false_alarms: float, n_held_out: int, growth: float = 1.0) -> float:
    """Return a smaller rate of false alarms, at which so many recordings vouch for the one that is asked for.

    A conformal threshold keeps its rate in the mean over many trainings; in one of them, with few recordings
    held out, it may be twice that. The k-th largest score keeps it in 95 of 100 trainings, for the largest k
    with P[Binomial(n, rate) < k] <= 5 % (a tolerance limit). Where n is too small for any (below 59 at 5 %),
    the largest score is the threshold: the widest margin there is. It is paid for in strangers: fewer of
    them are found.

    Parameters
    ----------
    false_alarms : float
        Share of known surfaces that may be called unknown.
    n_held_out : int
        Held-out recordings.
    growth : float
        How many times as often recordings to come are called unknown as those held out; that much less is
        asked of these.

    References
    ----------
    Wilks: Determination of sample sizes for setting tolerance limits, Annals of Mathematical Statistics 12,
    1941.
    """
    from scipy.stats import binom

    rate = false_alarms / growth
    k = int(np.count_nonzero(binom.cdf(np.arange(n_held_out), n_held_out, rate) <= 1 - CONFIDENCE))
    return min(false_alarms, max(k, 1) / (n_held_out + 1))


@dataclass(frozen=True, eq=False)
class Novelty:
    """When a recording is of no known surface.

    Attributes
    ----------
    kind
        Which score; see `strangeness`.
    held_out : ndarray of shape (n,)
        Scores of training recordings by recognisers that had not seen them, ascending. Without any, nothing
        is judged: every recording counts as of a known surface.
    false_alarms
        Share of recordings of known surfaces that may be called unknown.
    nearness
        For the kind "distance".
    """

    kind: Kind
    held_out: Samples
    false_alarms: float
    nearness: Nearness | None = None

    def __post_init__(self) -> None:
        if len(self.held_out):
            check_false_alarms(self.false_alarms, len(self.held_out))

    def p_value(self, scores: Samples) -> Samples:
        """Return the conformal p-value of "this surface is known", shape (n,).

        p = (1 + #{held-out scores >= score}) / (n + 1): uniform for recordings exchangeable with those held
        out, so p <= a happens to a share a of them at most (up to the larger training set).

        References
        ----------
        Vovk, Gammerman, Shafer: Algorithmic learning in a random world, 2005, chapter 2.
        """
        at_least = len(self.held_out) - np.searchsorted(self.held_out, scores, side="left")
        return np.asarray((1 + at_least) / (len(self.held_out) + 1))

    @property
    def threshold(self) -> float:
        """Scores above it are called unknown."""
        n = len(self.held_out)
        if not n:
            return np.inf
        n_above = int(np.floor(self.false_alarms * (n + 1) + 1e-9)) - 1  # held-out scores that may be larger
        return float(self.held_out[n - 1 - n_above])

    def document(self) -> dict[str, Any]:
        """Return it as plain data."""
        near = {} if self.nearness is None else dict(vars(self.nearness))
        return {
            "kind": self.kind, "held_out": self.held_out, "false_alarms": self.false_alarms, "nearness": near,
        }  # fmt: skip

    @classmethod
    def of_document(cls, stated: Mapping[str, Any]) -> "Novelty":
        """Return what `document` described.

        Raises
        ------
        ValueError
            If it is not such a description.
        """
        if stated["kind"] not in ("decision", "distance"):
            raise ValueError(f"kind is {stated['kind']!r}. Expected 'decision' or 'distance'")
        near = {name: np.asarray(array, dtype=np.float64) for name, array in stated["nearness"].items()}
        held_out = np.sort(np.asarray(stated["held_out"], dtype=np.float64))
        return cls(
            stated["kind"], held_out, float(stated["false_alarms"]), Nearness(**near) if near else None
        )


@dataclass(frozen=True, eq=False)
class Ranges:
    """Between which values each column lay in training, and its median; NaN for a column without values."""

    low: Samples
    median: Samples
    high: Samples

    @classmethod
    def of(cls, X: Samples) -> "Ranges":
        """Return the ranges of the columns of X (n, n_columns), NaN where undefined."""
        empty = np.isnan(X).all(axis=0)
        edges = np.nanquantile(np.where(empty, 0.0, X), [0, 0.5, 1], axis=0)
        return cls(*(np.where(empty, np.nan, edge) for edge in edges))

    def far(self, values: Samples) -> Samples:
        """Return how far values lie outside, in widths of the range, shape (n_columns,); 0 inside."""
        beyond = np.fmax(np.fmax(self.low - values, values - self.high), 0.0)
        width = np.maximum(self.high - self.low, 1e-9 * np.maximum(np.abs(self.high), np.abs(self.low)))
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.where(beyond > 0, beyond / width, 0.0)
        return np.asarray(np.nan_to_num(far))


class ClassMoments(NamedTuple):
    """Where surfaces lay in training: what a model needs in order to follow another sensor.

    Attributes
    ----------
    means : ndarray of shape (n_surfaces, n_columns)
        NaN where a column has no value for a surface.
    within : ndarray of shape (n_columns,)
        Deviation of recordings from the means of their surfaces.
    """

    means: Samples
    within: Samples

    @classmethod
    def of(cls, X: Samples, y: NDArray[Any]) -> "ClassMoments":
        """Return them for features X (n, n_columns), NaN where undefined, of surfaces y (n,)."""
        names, labels = np.unique(y, return_inverse=True)
        there, one_hot = ~np.isnan(X), np.eye(len(names))[labels]
        with np.errstate(invalid="ignore"):
            means = one_hot.T @ np.where(there, X, 0) / (one_hot.T @ there)
            squares = np.where(there, (X - means[labels]) ** 2, 0).sum(axis=0)
        freedom = np.maximum(there.sum(axis=0) - np.isfinite(means).sum(axis=0), 1)
        return cls(means, np.sqrt(squares / freedom))
