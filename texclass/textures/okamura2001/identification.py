"""The identification test: three surfaces, three names, and who is taken for whom."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from texclass.recording import Samples
from texclass.textures.okamura2001.library import TapLibrary


@dataclass(frozen=True, eq=False)
class IdentificationTest:
    """What users answered.

    Attributes
    ----------
    materials : tuple of str
        In the order of rows and columns.
    answers : ndarray of int, shape (n_experiments, n_materials)
        Which material each surface was taken for, in each experiment; every name is given once.
    """

    materials: tuple[str, ...]
    answers: NDArray[np.int64]

    @property
    def confusion(self) -> NDArray[np.int64]:
        """Counts, shape (n_materials, n_materials): row displayed, column named."""
        n = len(self.materials)
        table = np.zeros((n, n), dtype=np.int64)
        for i in range(n):
            table[i] = np.bincount(self.answers[:, i], minlength=n)
        return table

    @property
    def n_correct(self) -> int:
        """Experiments in which all surfaces were named right, the paper's rule."""
        return int(np.all(self.answers == np.arange(len(self.materials)), axis=1).sum())

    @property
    def correct(self) -> float:
        """Share of the experiments that were correct."""
        return self.n_correct / len(self.answers)

    @property
    def interval(self) -> tuple[float, float]:
        """Exact 95 % interval of that share (Clopper and Pearson)."""
        found = stats.binomtest(self.n_correct, len(self.answers)).proportion_ci(0.95)
        return float(found.low), float(found.high)


def cues(library: TapLibrary) -> Samples:
    """Return what our users compare, shape (n_materials, 3): ln A, ln B and ln w."""
    return np.column_stack([np.log(np.abs(column)) for column in library.arrays().values()])


def simulate_test(
    library: TapLibrary,
    noise: float | Sequence[float],
    rng: np.random.Generator,
    *,
    n_experiments: int = 42,
) -> IdentificationTest:
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

    References
    ----------
    `okamura2001`, section IV, for the test; the rule of the users is ours.
    """
    true = cues(library)
    n, m = len(true), n_experiments
    deviation = np.broadcast_to(np.asarray(noise, dtype=np.float64), (m,))
    felt = true + deviation[:, np.newaxis, np.newaxis] * rng.standard_normal((m, n, true.shape[1]))
    cost = np.sum((felt[:, :, np.newaxis, :] - true) ** 2, axis=-1)
    orders = np.array(list(permutations(range(n))))
    total = np.stack([cost[:, np.arange(n), order].sum(axis=1) for order in orders], axis=1)
    return IdentificationTest(library.materials, orders[np.argmin(total, axis=1)])


def noise_for(library: TapLibrary, correct: float, *, seed: int = 0, n_experiments: int = 20_000) -> float:
    """Return the noise (nepers) at which simulated users are right in this share of experiments.

    Raises
    ------
    ValueError
        If the share is not between guessing and 1.
    """
    guess = 1 / len(list(permutations(range(len(library)))))
    if not guess < correct < 1:
        raise ValueError(f"correct is {correct}; the rule is above {guess:.3f}, guessing, and below 1")
    low, high = 1e-3, 1e3
    for _ in range(20):
        middle = float(np.sqrt(low * high))
        test = simulate_test(library, middle, np.random.default_rng(seed), n_experiments=n_experiments)
        low, high = (middle, high) if test.correct > correct else (low, middle)
    return float(np.sqrt(low * high))
