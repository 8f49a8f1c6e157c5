"""The people of `okamura2001`: who rates eight models of a material, and who names what is tapped.

Its ratings and answers are not public; the people here follow rules that are stated, so that what they do
shows that the analysis works, not what people feel.
"""

from collections.abc import Sequence
from itertools import combinations, permutations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel

Samples = NDArray[np.float64]
FACTORS = ("amplitude", "decay", "frequency")
MOST_SENSITIVE = {"rubber": "decay", "wood": "frequency", "aluminum": "amplitude"}
"""Published, section III-B."""
GROUPS = [group for size in (1, 2, 3) for group in combinations(range(3), size)]
EFFECTS = tuple(" x ".join(FACTORS[i] for i in group) for group in GROUPS)
"""Three main effects, three of pairs, one of all."""
DESIGN: Samples = np.array([[2 * (i >> j & 1) - 1 for j in range(3)] for i in range(8)], dtype=np.float64)
"""Shape (8, 3): low (-1) or high (1) value of each factor in each run of the 2^3 factorial design."""


def runs(low: TapModel, high: TapModel) -> list[TapModel]:
    """Return the eight models between a low and a high value of each parameter, in the order of `DESIGN`."""
    ends = TapLibrary(("low", "high"), (low, high)).table
    return [TapModel(*map(float, row)) for row in np.where(DESIGN > 0, ends[1], ends[0])]


def normalized_ratings(ratings: ArrayLike) -> Samples:
    """Return the ratings of each user with mean 0 and standard deviation 1, shape (n_users, n_runs).

    Raises
    ------
    ValueError
        If the ratings are not two-dimensional and finite, or a user rates all runs alike.
    """
    r = np.asarray(ratings, dtype=np.float64)
    if r.ndim != 2 or not r.size or not np.all(np.isfinite(r)):
        raise ValueError(f"ratings have shape {r.shape}. Expected (n_users, n_runs), finite")
    alike = np.flatnonzero(np.ptp(r, axis=1) == 0)
    if alike.size:
        raise ValueError(f"user {alike[0]} rates all runs alike. Expected ratings that differ")
    return np.asarray((r - r.mean(axis=1, keepdims=True)) / r.std(axis=1, keepdims=True))


def analyse(ratings: ArrayLike) -> pd.DataFrame:
    """Analyse ratings of the eight runs by all users: main effects, interactions and their variance.

    With n users and contrasts c (-1 or 1) the effect is mean(c y) * 2, its sum of squares 2 n effect^2 of 8 n
    ratings. Users are blocks: what they differ in was taken out by normalising, and n - 1 degrees of freedom
    with it; the residual has 8 n - 1 - 7 - (n - 1) = 7 (n - 1).

    Parameters
    ----------
    ratings : array_like of shape (n_users, 8)
        In the order of `DESIGN`, any scale; two users at least.

    Returns
    -------
    DataFrame
        By `EFFECTS`: effect (mean rating at high minus that at low, in deviations of a user's ratings; of
        products likewise), F and p with 1 and 7 (n_users - 1) degrees of freedom.

    References
    ----------
    `okamura2001`, section III-B; Box and Bisgaard, 1988.
    """
    y = normalized_ratings(ratings)
    n = y.shape[0]
    if y.shape[1] != len(DESIGN) or n < 2:
        raise ValueError(f"ratings have shape {y.shape}. Expected (n_users, {len(DESIGN)}), 2 users at least")
    contrasts = np.stack([DESIGN[:, group].prod(axis=1) for group in GROUPS])
    effect = 2 * (contrasts @ y.mean(axis=0)) / len(DESIGN)
    squares = 2 * n * effect**2
    freedom = 7 * (n - 1)
    total = float(np.sum(y**2))
    residual = max(total - float(squares.sum()), np.finfo(float).eps * total)
    f_value = squares / (residual / freedom)
    table = {"effect": effect, "F": f_value, "p": stats.f.sf(f_value, 1, freedom)}
    return pd.DataFrame(table, index=pd.Index(EFFECTS))


def most_sensitive(analysis: pd.DataFrame) -> str:
    """Return the factor with the largest main effect."""
    return str(analysis.loc[list(FACTORS), "effect"].abs().idxmax())


def simulate_ratings(
    factor: str,
    rng: np.random.Generator,
    *,
    n_users: int = 10,
    strong: float = 1.0,
    weak: float = 0.4,
    noise: float = 1.0,
) -> Samples:
    """Simulate ratings from 1 to 10 of the eight runs, shape (n_users, 8), by users sensitive to a factor.

    Each user has a mean (4 to 7) and a spread (0.8 to 1.6) of ratings. A factor moves them by the spread
    times `strong` or `weak` from low to middle and again to high, with a sign of its own; noise of the same
    measure is added, and the result rounded and cut to 1 ... 10. The number of users is not printed; 10 is
    ours.
    """
    size = np.array([strong if name == factor else weak for name in FACTORS])
    utility = DESIGN @ (size * rng.choice([-1.0, 1.0], 3))
    spread, mean = rng.uniform(0.8, 1.6, (n_users, 1)), rng.uniform(4.0, 7.0, (n_users, 1))
    felt = mean + spread * (utility + noise * rng.standard_normal((n_users, len(DESIGN))))
    return np.asarray(np.clip(np.round(felt), 1.0, 10.0))


# The identification test: three surfaces, three names, and who is taken for whom ----------------------------


def simulate_answers(
    library: TapLibrary,
    noise: float | Sequence[float],
    rng: np.random.Generator,
    *,
    n_experiments: int = 42,
) -> NDArray[np.int64]:
    """Let simulated users name the surfaces of a library.

    The rule: each surface is felt as ln A, ln B, ln w plus Gaussian noise of one deviation (nepers) in each.
    The user knows the true values and gives every name once, so that the sum of squared distances is least.

    Parameters
    ----------
    library : TapLibrary
        As displayed.
    noise : float or sequence of float of length n_experiments
        Deviation of each cue, nepers.
    rng : numpy.random.Generator
        Of the users.
    n_experiments : int
        14 users, 3 times each.

    Returns
    -------
    ndarray of int, shape (n_experiments, n_materials)
        Which material each surface was taken for; every name is given once in an experiment.

    References
    ----------
    `okamura2001`, section IV, for the test; the rule of the users is ours.
    """
    true = np.log(np.abs(library.table))
    n = len(true)
    deviation = np.broadcast_to(np.asarray(noise, dtype=np.float64), (n_experiments,))
    felt = true + deviation[:, np.newaxis, np.newaxis] * rng.standard_normal((n_experiments, *true.shape))
    cost = np.sum((felt[:, :, np.newaxis, :] - true) ** 2, axis=-1)
    orders = np.array(list(permutations(range(n))))
    total = np.stack([cost[:, np.arange(n), order].sum(axis=1) for order in orders], axis=1)
    return np.asarray(orders[np.argmin(total, axis=1)])


def confusion(answers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return counts, shape (n_materials, n_materials): row displayed, column named."""
    n = answers.shape[1]
    return np.stack([np.bincount(answers[:, i], minlength=n) for i in range(n)])


def all_right(answers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return in which experiments all surfaces were named right, the paper's rule."""
    return np.asarray(np.all(answers == np.arange(answers.shape[1]), axis=1))


def noise_for(library: TapLibrary, correct: float, *, seed: int = 0, n_experiments: int = 20_000) -> float:
    """Return the noise (nepers) at which simulated users are right in this share of experiments.

    Raises
    ------
    ValueError
        If the share is not between guessing and 1.
    """
    guess = 1 / len(list(permutations(range(len(library)))))
    if not guess < correct < 1:
        raise ValueError(f"correct is {correct}. Expected above {guess:.3f}, guessing, and below 1")
    low, high = 1e-3, 1e3
    for _ in range(20):
        middle = float(np.sqrt(low * high))
        rng = np.random.default_rng(seed)
        right = all_right(simulate_answers(library, middle, rng, n_experiments=n_experiments)).mean()
        low, high = (middle, high) if right > correct else (low, middle)
    return float(np.sqrt(low * high))
