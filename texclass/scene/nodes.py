"""Spectra at the nodes of a grid of speeds and forces, from spectra anywhere between them."""

import numpy as np

from texclass.recording import Samples
from texclass.scene.models import weights
from texclass.scene.observed import Points

N_STEPS = 12
"""Of the scoring; it has settled to 1e-3 after about 8."""
LARGEST_STEP = 2.0
TIE = 1e-3
"""Weight that ties powers of nodes to their neighbours: it decides only where no point does."""
SHARPNESS = 12.0
"""Weights of spectra fall with exp(-12 octaves^2) of speed and force: to half at 0.24 octaves."""


def axis(values: Samples, n: int, within: tuple[float, float]) -> Samples:
    """Return n nodes at equal ratios between the ends of what is expected, as far as `values` reach."""
    low, high = max(within[0], values.min()), min(within[1], values.max())
    if n == 1 or low >= high:
        return np.array([np.sqrt(values.min() * values.max())])
    return np.geomspace(low, high, n)


def node_spectra(points: Points, power: Samples, speeds: Samples, forces: Samples) -> Samples:
    """Return the spectra at the nodes: shapes from the nearest points, powers from all.

    Resonances that move with speed are lost in a mean of distant spectra, while reflection coefficients
    between two nodes let them move: hence shapes of few points. Powers scatter more and follow simple laws:
    hence `node_powers`.

    Parameters
    ----------
    points : Points
        Of n_bins each.
    power : ndarray of shape (n_points,)
        Of each spectrum within the band.
    speeds, forces : ndarray of shape (n_speeds,), (n_forces,)
        Of the nodes.

    Returns
    -------
    ndarray of shape (n_speeds * n_forces, n_bins)
    """
    felt = power > 0
    if not felt.any():
        return np.zeros((speeds.size * forces.size, points.spectra.shape[1]))
    v, f = (grid.ravel()[:, np.newaxis] for grid in np.meshgrid(speeds, forces, indexing="ij"))
    octaves = np.log2(points.speed[felt] / v) ** 2 + np.log2(points.force[felt] / f) ** 2
    near = np.exp(-SHARPNESS * (octaves - octaves.min(axis=1, keepdims=True)))
    shape = (near / near.sum(axis=1, keepdims=True)) @ (points.spectra[felt] / power[felt, np.newaxis])
    shares = weights(speeds, forces, points.speed[felt], points.force[felt])
    return np.asarray(node_powers(shares, power[felt], speeds.size, forces.size)[:, np.newaxis] * shape)


def line_powers(points: Points, tonal: Samples, speeds: Samples, forces: Samples) -> Samples:
    """Return the powers of lines at the nodes, (n_nodes, n_lines), from (n_points, n_lines)."""
    shares = weights(speeds, forces, points.speed, points.force)
    least = 1e-6 * max(float(tonal.max(initial=0.0)), 1e-200)
    columns = [node_powers(shares, np.maximum(one, least), speeds.size, forces.size) for one in tonal.T]
    return np.column_stack(columns) if columns else np.zeros((speeds.size * forces.size, 0))


def node_powers(shares: Samples, power: Samples, n_speeds: int, n_forces: int) -> Samples:
    """Return the powers of the nodes that make the powers P_i of the points likeliest.

    Between the nodes ln powers mix linearly, ln M_i = sum_n H_in theta_n, and estimates of a power scatter
    about it as gamma variables: a regression with logarithmic link, by scoring::

        theta <- theta + (H'H + tie D'D)^-1 (H' (P / M - 1) - tie D'D theta)

    with D the differences between neighbouring nodes.

    References
    ----------
    McCullagh, Nelder, "Generalized linear models", 1989, chapter 8.
    """
    H, tie = shares, TIE * _differences(n_speeds, n_forces)
    solve = np.linalg.pinv(H.T @ H + tie)
    theta = solve @ (H.T @ np.log(power))
    for _ in range(N_STEPS):
        step = np.minimum(power * np.exp(-H @ theta) - 1, LARGEST_STEP)
        theta = theta + solve @ (H.T @ step - tie @ theta)
    return np.asarray(np.exp(theta))


def _differences(n_speeds: int, n_forces: int) -> Samples:
    """Return D'D of the differences between neighbours on the grid."""
    along = [np.diff(np.eye(n), axis=0) for n in (n_speeds, n_forces)]
    steps = [one.T @ one for one in along]
    return np.asarray(np.kron(steps[0], np.eye(n_forces)) + np.kron(np.eye(n_speeds), steps[1]))
