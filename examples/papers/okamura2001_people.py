"""Simulate people for `okamura2001`: raters of eight models, and users who identify surfaces.

The ratings and answers of the paper are not public. The simulated people follow fixed rules, so their results
validate the analysis, not human perception.
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
"""Published factor with the largest effect, section III-B."""
GROUPS = [group for size in (1, 2, 3) for group in combinations(range(3), size)]
EFFECTS = tuple(" x ".join(FACTORS[i] for i in group) for group in GROUPS)
"""Three main effects, three interactions of two factors, and one interaction of all factors."""
DESIGN: Samples = np.array([[2 * (i >> j & 1) - 1 for j in range(3)] for i in range(8)], dtype=np.float64)
"""Shape (8, 3): low (-1) or high (1) value of each factor in each run of the 2^3 factorial design."""


def runs(low: TapModel, high: TapModel) -> list[TapModel]:
    """Return the eight combinations of low and high parameters as models, in the order of `DESIGN`."""
    ends = TapLibrary(("low", "high"), (low, high)).table
    return [TapModel(*map(float, row)) for row in np.where(DESIGN > 0, ends[1], ends[0])]


def normalized_ratings(ratings: ArrayLike) -> Samples:
    """Normalise the ratings (n_users, n_runs) of each user to mean 0 and standard deviation 1.

    Raises
    ------
    ValueError
        If the ratings are not two-dimensional and finite, or all ratings of a user are equal.
    """
    r = np.asarray(ratings, dtype=np.float64)
    if r.ndim != 2 or not r.size or not np.all(np.isfinite(r)):
        raise ValueError(f"ratings must have shape (n_users, n_runs) and finite values, got shape {r.shape}")
    constant = np.flatnonzero(np.ptp(r, axis=1) == 0)
    if constant.size:
        raise ValueError(
            f"the ratings of each user must differ, but all ratings of user {constant[0]} are equal"
        )
    return np.asarray((r - r.mean(axis=1, keepdims=True)) / r.std(axis=1, keepdims=True))


def analyse(ratings: ArrayLike) -> pd.DataFrame:
    """Analyse ratings of the eight runs: main effects, interactions and analysis of variance.

    With n users and contrasts c (-1 or 1), an effect is 2 mean(c y), and its sum of squares is 2 n effect^2
    for 8 n ratings. Users are blocks: normalisation removes their differences and n - 1 degrees of freedom.
    The residual therefore has 8 n - 1 - 7 - (n - 1) = 7 (n - 1) degrees of freedom.

    Parameters
    ----------
    ratings : array_like of shape (n_users, 8)
        Ratings in the order of `DESIGN`, on any scale; at least two users.

    Returns
    -------
    DataFrame
        One row per item of `EFFECTS`, with the columns effect (mean rating at the high level minus the low
        level, in standard deviations of a user's ratings), and F and p with 1 and 7 (n_users - 1) degrees of
        freedom.

    References
    ----------
    `okamura2001`, section III-B; Box and Bisgaard, 1988.
    """
    y = normalized_ratings(ratings)
    n = y.shape[0]
    if y.shape[1] != len(DESIGN) or n < 2:
        raise ValueError(f"ratings must have shape (n_users, {len(DESIGN)}), n_users >= 2, got {y.shape}")
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
    """Simulate ratings (n_users, 8) from 1 to 10 of the eight runs by users who are sensitive to one factor.

    Each user has a mean rating (4 to 7) and a spread (0.8 to 1.6). The low or high level of a factor changes
    the rating by the spread times `strong` or `weak`, with a random sign. Noise of the same scale is added,
    and the result is rounded and clipped to 1 ... 10. The paper does not state the number of users; 10 is our
    choice.
    """
    size = np.array([strong if name == factor else weak for name in FACTORS])
    utility = DESIGN @ (size * rng.choice([-1.0, 1.0], 3))
    spread, mean = rng.uniform(0.8, 1.6, (n_users, 1)), rng.uniform(4.0, 7.0, (n_users, 1))
    rating = mean + spread * (utility + noise * rng.standard_normal((n_users, len(DESIGN))))
    return np.asarray(np.clip(np.round(rating), 1.0, 10.0))


# Identification test: three surfaces, three names, and the confusion matrix ---------------------------------


def simulate_answers(
    library: TapLibrary,
    noise: float | Sequence[float],
    rng: np.random.Generator,
    *,
    n_experiments: int = 42,
) -> NDArray[np.int64]:
    """Simulate users who identify the surfaces of a library.

    Users perceive ln A, ln B and ln w of each surface with independent Gaussian noise (nepers). They know the
    true values and use every name once, in the order with the smallest sum of squared distances.

    Parameters
    ----------
    library : TapLibrary
        Library rendered by the device.
    noise : float or sequence of float of length n_experiments
        Standard deviation of each cue in nepers.
    rng : numpy.random.Generator
        Random generator for the users.
    n_experiments : int
        Number of experiments (default 42: 14 users, 3 times each).

    Returns
    -------
    ndarray of int, shape (n_experiments, n_materials)
        Predicted material of each surface; every material occurs once per experiment.

    References
    ----------
    `okamura2001`, section IV, for the test; the decision rule is our choice.
    """
    true = np.log(np.abs(library.table))
    n = len(true)
    deviation = np.broadcast_to(np.asarray(noise, dtype=np.float64), (n_experiments,))
    cues = true + deviation[:, np.newaxis, np.newaxis] * rng.standard_normal((n_experiments, *true.shape))
    cost = np.sum((cues[:, :, np.newaxis, :] - true) ** 2, axis=-1)
    orders = np.array(list(permutations(range(n))))
    total = np.stack([cost[:, np.arange(n), order].sum(axis=1) for order in orders], axis=1)
    return np.asarray(orders[np.argmin(total, axis=1)])


def confusion(answers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the confusion matrix, shape (n_materials, n_materials): rows true, columns predicted."""
    n = answers.shape[1]
    return np.stack([np.bincount(answers[:, i], minlength=n) for i in range(n)])


def are_all_correct(answers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether all surfaces of an experiment are identified correctly, as counted in the paper."""
    return np.asarray(np.all(answers == np.arange(answers.shape[1]), axis=1))


def find_noise(library: TapLibrary, correct: float, *, seed: int = 0, n_experiments: int = 20_000) -> float:
    """Return the noise (nepers) at which simulated users reach a given fraction of correct experiments.

    Raises
    ------
    ValueError
        If the fraction is not between the chance level and 1.
    """
    chance = 1 / len(list(permutations(range(len(library)))))
    if not chance < correct < 1:
        raise ValueError(f"correct must be between {chance:.3f}, the chance level, and 1, got {correct}")
    low, high = 1e-3, 1e3
    for _ in range(20):
        middle = float(np.sqrt(low * high))
        rng = np.random.default_rng(seed)
        answers = simulate_answers(library, middle, rng, n_experiments=n_experiments)
        low, high = (middle, high) if are_all_correct(answers).mean() > correct else (low, middle)
    return float(np.sqrt(low * high))
