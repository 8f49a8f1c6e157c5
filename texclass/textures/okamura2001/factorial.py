"""The 2^3 factorial design: eight models of a material, rated, and which parameter matters most."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from texclass.recording import Samples
from texclass.vibration import TapModel

FACTORS = ("amplitude", "decay", "frequency")
EFFECTS = tuple(" x ".join(names) for n in (1, 2, 3) for names in combinations(FACTORS, n))
"""Three main effects, three of pairs, one of all."""
DESIGN: Samples = np.array([[2 * (i >> j & 1) - 1 for j in range(3)] for i in range(8)], dtype=np.float64)
"""Shape (8, 3): low (-1) or high (1) value of each factor in each run."""
DESIGN.flags.writeable = False


@dataclass(frozen=True, eq=False)
class FactorialResult:
    """Effects of the parameters on normalised ratings.

    Attributes
    ----------
    effect : dict of str to float
        Mean rating at high minus that at low, in deviations of a user's ratings; of products likewise.
    f_value, p_value : dict of str to float
        Analysis of variance, 1 and 7 (n_users - 1) degrees of freedom.
    mean_rating : ndarray of shape (8,)
        Of each run over the users.
    n_users : int
        Who rated.
    """

    effect: dict[str, float]
    f_value: dict[str, float]
    p_value: dict[str, float]
    mean_rating: Samples
    n_users: int

    @property
    def most_sensitive(self) -> str:
        """The factor with the largest main effect."""
        return max(FACTORS, key=lambda name: abs(self.effect[name]))

    @property
    def best_run(self) -> int:
        """The run with the highest mean rating."""
        return int(np.argmax(self.mean_rating))


def runs(low: TapModel, high: TapModel) -> list[TapModel]:
    """Return the eight models between a low and a high value of each parameter, in the order of `DESIGN`."""
    columns = (
        (low.amplitude_slope, high.amplitude_slope),
        (low.decay_per_s, high.decay_per_s),
        (low.frequency_hz, high.frequency_hz),
    )
    return [
        TapModel(*(pair[int(level > 0)] for pair, level in zip(columns, row, strict=True))) for row in DESIGN
    ]


def normalized_ratings(ratings: ArrayLike) -> Samples:
    """Return the ratings of each user with mean 0 and standard deviation 1, shape (n_users, n_runs).

    Raises
    ------
    ValueError
        If the ratings are not two-dimensional and finite, or a user rates all runs alike.
    """
    r = np.asarray(ratings, dtype=np.float64)
    if r.ndim != 2 or not r.size or not np.all(np.isfinite(r)):
        raise ValueError(f"ratings have shape {r.shape}; the rule is (n_users, n_runs), finite")
    alike = np.flatnonzero(np.ptp(r, axis=1) == 0)
    if alike.size:
        raise ValueError(f"user {alike[0]} rates all runs alike; the rule is ratings that differ")
    return np.asarray((r - r.mean(axis=1, keepdims=True)) / r.std(axis=1, keepdims=True))


def analyse(ratings: ArrayLike) -> FactorialResult:
    """Analyse ratings of the eight runs by all users: main effects, interactions and their variance.

    With n users and contrasts c (-1 or 1) the effect is mean(c y) * 2, its sum of squares 2 n effect^2 of 8 n
    ratings. Users are blocks: what they differ in was taken out by normalising, and n - 1 degrees of freedom
    with it; the residual has 8 n - 1 - 7 - (n - 1) = 7 (n - 1).

    Parameters
    ----------
    ratings : array_like of shape (n_users, 8)
        In the order of `DESIGN`, any scale; two users at least.

    References
    ----------
    `okamura2001`, section III-B; Box and Bisgaard, 1988.
    """
    y = normalized_ratings(ratings)
    n = y.shape[0]
    if y.shape[1] != len(DESIGN) or n < 2:
        raise ValueError(
            f"ratings have shape {y.shape}; the rule is (n_users, {len(DESIGN)}), 2 users at least"
        )
    groups = [g for size in (1, 2, 3) for g in combinations(range(3), size)]
    contrasts = np.stack([DESIGN[:, g].prod(axis=1) for g in groups])
    effect = 2 * (contrasts @ y.mean(axis=0)) / len(DESIGN)
    squares = 2 * n * effect**2
    freedom = 7 * (n - 1)
    total = float(np.sum(y**2))
    residual = max(total - float(squares.sum()), np.finfo(float).eps * total)
    f_value = squares / (residual / freedom)
    p_value = stats.f.sf(f_value, 1, freedom)
    named = [dict(zip(EFFECTS, map(float, values), strict=True)) for values in (effect, f_value, p_value)]
    return FactorialResult(named[0], named[1], named[2], y.mean(axis=0), n)
