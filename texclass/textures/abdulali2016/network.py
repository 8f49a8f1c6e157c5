"""Radial basis function network with phi(r) = r and a linear polynomial: exact, smoothing or sparse.

f(u) = sum_j w_j |u - q_j| + d_0 + sum_k d_k u_k                                  [abdulali2016, eq. (4)]
"""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, spatial

from texclass.recording import Samples

Solver = Literal["exact", "sparse"]

SMOOTHING = np.concatenate([[0.0], np.geomspace(1e-2, 1e4, 13)])
"""Candidates of the smoothing, in units of phi for a point of mean weight."""
WORTH = 0.9
"""Part of the error of a constant that a network has to get below."""
SPARSITY = 0.03
"""tau over the smallest tau that leaves no centre."""


@dataclass(frozen=True, eq=False)
class RadialNetwork:
    """A function of several outputs, given by centres and weights.

    Attributes
    ----------
    centres : ndarray of shape (n_centres, n_inputs)
        q, normalised inputs.
    weights : ndarray of shape (n_centres, n_outputs)
        w.
    polynomial : ndarray of shape (n_inputs + 1, n_outputs)
        d: the constant, then one row per input.

    Raises
    ------
    ValueError
        If the shapes do not fit or a value is not finite.
    """

    centres: Samples
    weights: Samples
    polynomial: Samples

    def __post_init__(self) -> None:
        for name in ("centres", "weights", "polynomial"):
            array = np.array(getattr(self, name), dtype=np.float64, order="C")
            if array.ndim != 2 or not np.all(np.isfinite(array)):
                raise ValueError(f"{name} has shape {array.shape}; the rule is two axes, finite numbers")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        shapes = self.centres.shape, self.weights.shape, self.polynomial.shape
        (n, d), (n_w, m), (n_d, m_d) = shapes
        if n != n_w or m != m_d or n_d != d + 1 or m < 1:
            raise ValueError(
                f"centres, weights, polynomial have shapes {shapes}; the rule is (n, d), (n, m), (d + 1, m)"
            )

    def at(self, u: ArrayLike) -> Samples:
        """Return f at inputs (n, n_inputs), shape (n, n_outputs); every row by itself, bit for bit."""
        points = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty((len(points), self.weights.shape[1]))
        evaluate(points, self.centres, self.weights, self.polynomial, out)
        return out


@njit(cache=True, error_model="numpy")
def evaluate(u: Samples, q: Samples, w: Samples, d: Samples, out: Samples) -> None:
    """Write f(u) into `out`, row by row."""
    n_outputs = out.shape[1]
    for t in range(len(u)):
        for i in range(n_outputs):
            out[t, i] = d[0, i]
        for k in range(u.shape[1]):
            for i in range(n_outputs):
                out[t, i] += u[t, k] * d[k + 1, i]
        for j in range(len(q)):
            r = 0.0
            for k in range(u.shape[1]):
                r += (u[t, k] - q[j, k]) ** 2
            r = np.sqrt(r)
            for i in range(n_outputs):
                out[t, i] += r * w[j, i]


def fit_exact(u: Samples, f: Samples, smoothing: ArrayLike = 0.0) -> RadialNetwork:
    """Solve eq. (5): through every point, or, with smoothing, as near as it pays.

    ``[[Phi - S, G], [G^T, 0]] [w, d] = [f, 0]`` with S the diagonal of the smoothing: Phi of phi(r) = r is
    conditionally negative, so taking away is what makes it definite.

    Parameters
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs.
    f : ndarray of shape (n_points, n_outputs)
    smoothing : array_like of shape () or (n_points,)
        At least 0; for 0 the printed system.

    Notes
    -----
    Where the system is singular (points that coincide or lie in one plane) the solution of least norm is
    taken.

    References
    ----------
    `abdulali2016`, eq. (5); Wahba, "Spline models for observational data", 1990.
    """
    right = np.concatenate([f, np.zeros((u.shape[1] + 1, f.shape[1]))])
    solved = _solve(_system(u, smoothing), right)
    return RadialNetwork(u, solved[: len(u)], solved[len(u) :])


def fit_smooth(u: Samples, f: Samples, weight: Samples) -> RadialNetwork:
    """Solve eq. (5) with the smoothing that predicts left-out points best; a constant, if none is worth it.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
    weight : ndarray of shape (n_points,)
        Seconds behind each point: estimates scatter with 1 / weight, and so does the smoothing.
    """
    share = weight.mean() / weight
    errors = [np.mean((f - predict_left_out(u, f, s * share)) ** 2) for s in SMOOTHING]
    mean = np.average(f, axis=0, weights=weight)
    left_out = (mean - f) / (1 - weight / weight.sum())[:, np.newaxis] if len(u) > 1 else f
    if min(errors) > WORTH * np.mean(left_out**2) or len(u) < 2:
        polynomial = np.concatenate([mean[np.newaxis], np.zeros((u.shape[1], f.shape[1]))])
        return RadialNetwork(u, np.zeros(f.shape), polynomial)
    return fit_exact(u, f, SMOOTHING[int(np.argmin(errors))] * share)


def predict_left_out(u: Samples, f: Samples, smoothing: ArrayLike = 0.0) -> Samples:
    """Return what the network of all other points says of each point, shape (n_points, n_outputs).

    The error of point i is w_i / B_ii, with B the inverse of the system of all points: no fit is repeated.
    What the others do not determine is taken as their mean.
    """
    n = len(u)
    inverse = _solve(_system(u, smoothing), np.eye(n + u.shape[1] + 1))[:n, :n]
    diagonal = np.diag(inverse)[:, np.newaxis]
    determined = np.abs(diagonal) > 1e-9 * np.abs(inverse).max()
    error = (inverse @ f) / np.where(determined, diagonal, 1.0)
    return np.where(determined, f - error, f.mean(axis=0))


def fit_sparse(u: Samples, f: Samples, sparsity: float = SPARSITY) -> RadialNetwork:
    """Keep few centres: minimise ``1/2 |A x - y|^2 + tau |x|_1``, SpaRSA's objective, over the centres.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
    sparsity : float
        tau over the smallest tau that leaves no centre; above 0, below 1.

    Raises
    ------
    ValueError
        For a sparsity out of its range.

    Notes
    -----
    Readings. One set of centres serves all outputs (a centre costs its distance once): |x|_1 sums over
    centres the norm over outputs, each output brought to unit deviation. The polynomial is not penalised but
    projected out. The centres found are then fitted without penalty under G^T w = 0, SpaRSA's debiasing.

    References
    ----------
    `abdulali2016`, section 3.2; Wright, Nowak, Figueiredo, "Sparse reconstruction by separable
    approximation", 2009.
    """
    if not 0 < sparsity < 1:
        raise ValueError(f"sparsity is {sparsity}; the rule is above 0 and below 1")
    phi, g = spatial.distance.cdist(u, u), _polynomial(u)
    free = np.eye(len(u)) - g @ np.linalg.pinv(g)
    deviation = f.std(axis=0)
    kept = _centres(free @ phi, free @ (f / np.where(deviation > 0, deviation, 1.0)), sparsity)
    balanced = linalg.null_space(g[kept].T)
    solved = np.linalg.lstsq(np.hstack([phi[:, kept] @ balanced, g]), f)[0]
    n = balanced.shape[1]
    return RadialNetwork(u[kept], balanced @ solved[:n], np.asarray(solved[n:], dtype=np.float64))


def _centres(A: Samples, y: Samples, sparsity: float) -> NDArray[np.intp]:
    """Return the columns of A that the penalised solution uses."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import MultiTaskLasso

    tau = sparsity * float(np.linalg.norm(A.T @ y, axis=1).max())
    if tau == 0:
        return np.zeros(0, dtype=np.intp)
    lasso = MultiTaskLasso(alpha=tau / len(A), fit_intercept=False, max_iter=5000, tol=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # which centres matter is settled long before
        return np.flatnonzero(np.any(lasso.fit(A, y).coef_ != 0, axis=0))


def _polynomial(u: Samples) -> Samples:
    return np.column_stack([np.ones(len(u)), u])


def _system(u: Samples, smoothing: ArrayLike) -> Samples:
    n, g = len(u), _polynomial(u)
    system = np.zeros((n + g.shape[1], n + g.shape[1]))
    system[:n, :n] = spatial.distance.cdist(u, u) - np.diag(np.broadcast_to(np.asarray(smoothing), (n,)))
    system[:n, n:], system[n:, :n] = g, g.T
    return system


def _solve(system: Samples, right: Samples) -> Samples:
    """Solve; where the system is (nearly) singular, with the least norm."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", linalg.LinAlgWarning)
            return np.asarray(linalg.solve(system, right, assume_a="sym"))
    except (linalg.LinAlgError, linalg.LinAlgWarning):
        values, vectors = np.linalg.eigh(system)
    kept = np.abs(values) > 1e-10 * np.abs(values).max()
    return np.asarray((vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ right))
