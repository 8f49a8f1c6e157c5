"""SpaRSA, the solver of `abdulali2016` for sparse networks, and a comparison with MultiTaskLasso.

Both minimise |A W - Y|^2 / 2 + tau sum_j |W_j|, where row W_j contains the weights of centre j for all
outputs.
`fit_sparse` uses MultiTaskLasso of scikit-learn.
"""

import warnings
from time import process_time

import numpy as np
from scipy import spatial
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import MultiTaskLasso

from texclass.haptics.textures.abdulali2016 import model_scan

STEP_LIMITS = 1e-30, 1e30
"""Limits of alpha, the inverse of a step, as in the paper of Wright et al."""
GROWTH, DECREASE, MEMORY = 2.0, 1e-2, 5
"""Factor by which alpha grows if a step is rejected, required decrease sigma, and number M + 1 of previous
objectives; a step may exceed the last of them, but not all. Values of Wright et al."""
CONTINUATION = 0.8
"""The penalty of each stage is at least this fraction of the largest gradient, as in Wright et al."""
SPARSITIES = (0.3, 0.1, 0.03)
GAP = 1e-4
"""Largest duality gap relative to |Y|^2 / 2. The tolerance of MultiTaskLasso is relative to |Y|^2."""


def shrink(rows, threshold):
    """Return the rows with their norms reduced by a threshold; shorter rows become 0."""
    norm = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows * np.maximum(1 - threshold / np.maximum(norm, np.finfo(float).tiny), 0)


def objective(A, Y, W, tau):
    """Return |A W - Y|^2 / 2 + tau sum_j |W_j|."""
    return 0.5 * np.sum((A @ W - Y) ** 2) + tau * np.linalg.norm(W, axis=1).sum()


def duality_gap(A, Y, W, tau):
    """Return an upper bound of the distance of the objective from its minimum.

    The residual, scaled so that no gradient exceeds tau, is a feasible point of the dual problem.
    """
    residual = Y - A @ W
    largest = np.linalg.norm(A.T @ residual, axis=1).max()
    dual = residual * min(1.0, tau / largest)
    return objective(A, Y, W, tau) - 0.5 * (np.sum(Y**2) - np.sum((dual - Y) ** 2))


def sparsa(A, Y, tau, *, gap=GAP, max_steps=100_000, continuation=True):
    """Minimise the objective by separable approximation, with decreasing penalties.

    A step minimises a quadratic model whose curvature alpha is that of the last step (Barzilai and Borwein).
    With continuation, a sequence of penalties decreases to tau, and each solution starts the next stage.

    Parameters
    ----------
    A : ndarray of shape (n_points, n_centres)
    Y : ndarray of shape (n_points, n_outputs)
    tau : float
        Penalty.
    gap : float
        Largest duality gap at the end, relative to |Y|^2 / 2.
    max_steps : int
        Largest number of steps.
    continuation : bool
        Whether to decrease the penalty in stages (default True).

    Returns
    -------
    W : ndarray of shape (n_centres, n_outputs)
    n_steps : int

    References
    ----------
    Wright, Nowak, Figueiredo, "Sparse reconstruction by separable approximation", 2009.
    """
    W, n_steps, scale = np.zeros((A.shape[1], Y.shape[1])), 0, 0.5 * np.sum(Y**2)
    while n_steps < max_steps:
        largest = np.linalg.norm(A.T @ (Y - A @ W), axis=1).max()
        penalty = max(CONTINUATION * largest, tau) if continuation else tau
        is_last = penalty == tau
        W, n = _stage(A, Y, W, penalty, (gap if is_last else 1e-2) * scale, max_steps - n_steps)
        n_steps += n
        if is_last:
            break
    return W, n_steps


def _stage(A, Y, W, tau, gap, max_steps):
    """Take steps at one penalty until the duality gap is small; return weights and number of steps."""
    alpha, history = 1.0, [objective(A, Y, W, tau)]
    gradient = A.T @ (A @ W - Y)
    for n in range(max_steps):
        if n % 10 == 0 and duality_gap(A, Y, W, tau) <= gap:
            return W, n
        while True:
            new = shrink(W - gradient / alpha, tau / alpha)
            change, value = new - W, objective(A, Y, new, tau)
            limit = max(history[-MEMORY:]) - DECREASE / 2 * alpha * np.sum(change**2)
            if value <= limit or alpha >= STEP_LIMITS[1]:
                break
            alpha *= GROWTH
        squared = np.sum(change**2)
        if squared == 0:
            return W, n
        alpha = float(np.clip(np.sum((A @ change) ** 2) / squared, *STEP_LIMITS))
        W, gradient = new, A.T @ (A @ new - Y)
        history.append(value)
    return W, max_steps


def lasso(A, Y, tau, *, tolerance=1e-3, max_iter=5000):
    """Minimise the objective by coordinate descent, with the settings of `fit_sparse` by default."""
    model = MultiTaskLasso(alpha=tau / len(A), fit_intercept=False, max_iter=max_iter, tol=tolerance)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(A, Y).coef_.T, model.n_iter_


def sparse_problem(scan, *, isotropic=False):
    """Return A and Y of `fit_sparse` for a conditioned scan, without the polynomial, and the largest tau."""
    modelled = model_scan(scan, isotropic=isotropic, pooling="none", mirror="none")
    points = modelled.points.concatenate(modelled.silent)
    u, f = points.u, np.column_stack([points.lsf, points.loudness])
    g = np.column_stack([np.ones(len(u)), u])
    projector = np.eye(len(u)) - g @ np.linalg.pinv(g)
    A, Y = projector @ spatial.distance.cdist(u, u), projector @ (f / f.std(axis=0))
    return A, Y, float(np.linalg.norm(A.T @ Y, axis=1).max())


def compare_solvers(scan, *, isotropic=False):
    """Return one row per penalty and solver: objective, duality gap, centres, steps and CPU time in ms.

    Gap and objective are relative to |Y|^2 / 2, the objective without centres. The reference is coordinate
    descent with a tolerance of 1e-9. `agreement` is the overlap of the sets of centres with the reference
    (intersection over union).
    """
    A, Y, largest = sparse_problem(scan, isotropic=isotropic)
    solvers = {
        "SpaRSA": lambda tau: sparsa(A, Y, tau),
        "SpaRSA, one stage": lambda tau: sparsa(A, Y, tau, continuation=False),
        "MultiTaskLasso": lambda tau: lasso(A, Y, tau, tolerance=GAP / 2, max_iter=100_000),
        "MultiTaskLasso as in fit_sparse": lambda tau: lasso(A, Y, tau),
    }
    scale, rows = 0.5 * np.sum(Y**2), []
    for sparsity in SPARSITIES:
        tau = sparsity * largest
        reference, _ = lasso(A, Y, tau, tolerance=1e-9, max_iter=200_000)
        best, centres = objective(A, Y, reference, tau), np.any(reference != 0, axis=1)
        for name, solve in solvers.items():
            start = process_time()
            W, n_steps = solve(tau)
            ms = 1e3 * (process_time() - start)
            selected = np.any(W != 0, axis=1)
            rows.append(
                {
                    "surface": scan.name,
                    "sparsity": sparsity,
                    "solver": name,
                    "points": len(A),
                    "excess": (objective(A, Y, W, tau) - best) / scale,
                    "gap": duality_gap(A, Y, W, tau) / scale,
                    "centres": int(selected.sum()),
                    "agreement": float(np.sum(selected & centres) / max(np.sum(selected | centres), 1)),
                    "steps": int(n_steps),
                    "ms": ms,
                }
            )
    return rows
