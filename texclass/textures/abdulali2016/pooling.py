"""Spectra of segments that help each other out where the input hardly matters: more than the paper does.

A segment of 75 ms gives a poor spectrum, and a network through many poor ones wavers. Autocorrelations add
up like the data behind them, so that segments near each other in input can share:

    r_i = sum_j n_j exp(-|u_i - u_j|^2 / (2 h^2)) r_j

with r_j those of the models of the segments, at power 1. (Autocorrelations counted from 75 samples would
bring the ends of the segments along: in our simulations a floor 10 dB too high.) How near, h, and whether at
all, is decided by what predicts a segment that was left out.
"""

from dataclasses import replace

import numpy as np
from scipy import linalg, spatial

from texclass.recording import Samples
from texclass.textures.abdulali2016.network import predict_left_out
from texclass.textures.abdulali2016.points import ModelPoints
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation

REACHES = (0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 4.0, 100.0)
"""Candidates of h, in deviations of the input; the last one is a single spectrum for all."""
ORDER = 20
"""Of the models that are compared: enough to tell, and cheap."""
MARGIN = 0.03
"""By how much sharing has to predict better, in the logarithm of power: it blurs what does change."""


def pool_spectra(points: ModelPoints) -> tuple[ModelPoints, float]:
    """Return the points with pooled spectra, and the reach h; as they were, and 0, where that predicts worse.

    Parameters
    ----------
    points : ModelPoints
        Of the segments, without silent ones.

    Notes
    -----
    Compared is sum_i n_i ln(a^T T_i a) / sum_i n_i, the log power of the error with which the model from the
    others predicts segment i (T_i: Toeplitz matrix of its autocorrelation). Unpooled, the model from the
    others is that of the network. A mean of autocorrelations is one: always a stable model.
    """
    if len(points) < 3:
        return points, 0.0
    k = line_spectrum.to_reflection(points.lsf)
    R = autocorrelation_of(k)
    distance = spatial.distance.cdist(points.u, points.u)
    T = np.array([linalg.toeplitz(r[: ORDER + 1]) for r in R])
    errors = [
        _error(
            from_autocorrelation(_shares(distance, points.weight, h, alone=False) @ R).reflection, T, points
        )
        for h in REACHES
    ]
    apart = line_spectrum.to_reflection(line_spectrum.spread(predict_left_out(points.u, points.lsf)))
    if _error(apart, T, points) <= min(errors) + MARGIN:
        return points, 0.0
    reach = REACHES[int(np.argmin(errors))]
    pooled = from_autocorrelation(_shares(distance, points.weight, reach, alone=True) @ R).reflection
    return replace(points, lsf=line_spectrum.spread(line_spectrum.from_reflection(pooled))), reach


def autocorrelation_of(k: Samples) -> Samples:
    """Return r_0 = 1, r_1 ... r_p of the models with reflection coefficients (n, p), shape (n, p + 1).

    Levinson's recursion backwards: r_m = -k_m E_{m-1} - sum_{i<m} a_i r_{m-i}, with a of order m - 1 and
    E_m = prod_{i<=m} (1 - k_i^2).
    """
    n, p = k.shape
    a, r, E = np.zeros((n, p + 1)), np.zeros((n, p + 1)), np.ones(n)
    a[:, 0] = r[:, 0] = 1.0
    for m in range(1, p + 1):
        r[:, m] = -k[:, m - 1] * E - np.einsum("ni,ni->n", a[:, 1:m], r[:, m - 1 : 0 : -1])
        a[:, 1 : m + 1] += k[:, m - 1 : m] * a[:, m - 1 :: -1]
        E = E * (1 - k[:, m - 1] ** 2)
    return r


def _shares(distance: Samples, weight: Samples, reach: float, *, alone: bool) -> Samples:
    """Return what each segment contributes to each, rows of sum 1; without itself, if not `alone`."""
    exponent = -(distance**2) / (2 * reach**2)
    if not alone:
        np.fill_diagonal(exponent, -np.inf)
    share = weight * np.exp(exponent - exponent.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _error(k: Samples, T: Samples, points: ModelPoints) -> float:
    """Return sum_i n_i ln(a^T T_i a) / sum_i n_i of the models with reflection coefficients (n, p)."""
    order = T.shape[1] - 1
    a = np.zeros((len(k), order + 1))
    a[:, 0] = 1.0
    for m in range(order):
        a[:, 1 : m + 2] += k[:, m : m + 1] * a[:, m::-1]
    error = np.maximum(np.einsum("ni,nij,nj->n", a, T, a), np.finfo(np.float64).tiny)
    return float(points.weight @ np.log(error) / points.weight.sum())
