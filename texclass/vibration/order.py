"""The order of an autoregressive model, chosen among 0 ... p from one fit at p, which holds them all."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from texclass.recording import Samples
from texclass.vibration import recursions
from texclass.vibration.autoregressive import Autoregression, fit
from texclass.vibration.scores import N_DFT, relative_error

Criterion = Literal["spectral_error", "aicc"]


@dataclass(frozen=True, eq=False)
class OrderSelection:
    """What `select_order` chose.

    Parameters
    ----------
    order : int
        The order chosen, one for all frames.
    met : bool
        Whether the error asked for was met; True where none was.
    values : ndarray of shape (largest + 1,)
        The criterion at the orders 0 ... largest.
    model : Autoregression
        The model of that order.
    """

    order: int
    met: bool
    values: Samples
    model: Autoregression


def select_order(
    x: ArrayLike,
    largest: int,
    *,
    criterion: Criterion = "spectral_error",
    at_most: float | None = None,
    method: Literal["burg", "autocorrelation"] = "burg",
) -> OrderSelection:
    """Choose an order from one fit at the largest.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        Any unit. Frames share one order: their criteria are averaged.
    largest : int
        Largest order looked at, at least 1.
    criterion : {"spectral_error", "aicc"}
        `spectral_error` or `aicc`.
    at_most : float, optional
        Take the smallest order with a spectral error of at most this. If none has, the one of the smallest
        error is taken and `met` is False. Without it, "spectral_error" takes the smallest order beyond which
        little is gained (5 % of the way from order 0 to the best), as the paper reads its figure 3.2,
        and "aicc" that of the smallest AICc.
    method : {"burg", "autocorrelation"}
        The methods whose fit at one order contains those at all lower ones.

    Returns
    -------
    OrderSelection
        Order 0 for silence.

    Raises
    ------
    ValueError
        For an unknown criterion or method, `at_most` with AICc or below 0, and for what `fit` refuses.
    """
    if criterion not in get_args(Criterion) or method not in ("burg", "autocorrelation"):
        raise ValueError(
            f"criterion is {criterion!r}, method {method!r}. "
            f"Expected one of {get_args(Criterion)} and of ('burg', 'autocorrelation')"
        )
    if at_most is not None and not (criterion == "spectral_error" and at_most >= 0):
        raise ValueError(f"at_most is {at_most} for {criterion}. Expected a spectral error, at least 0")
    model = fit(x, largest, method=method)
    curve = aicc(model, np.shape(x)[-1]) if criterion == "aicc" else spectral_error(x, model)
    values = curve if curve.ndim == 1 else curve.mean(axis=0)
    best = int(np.argmin(values))
    limit = values[best]
    if criterion == "spectral_error":
        limit = limit + 0.05 * (values[0] - limit) if at_most is None else max(at_most, limit)
    order = int(np.argmax(values <= limit))
    return OrderSelection(
        order, at_most is None or bool(values[order] <= at_most), values, model.truncated(order)
    )


def spectral_error(x: ArrayLike, model: Autoregression) -> Samples:
    """Return the RMS spectral error of the orders 0 ... p of a model, relative to the spectrum of the signal.

    C = RMS(|X| - |G|) / RMS(|X|), the RMS taken over the N = `N_DFT` bins of the DFT.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        The signal, in the unit of the model.
    model : Autoregression
        Fitted to it by Burg's or the autocorrelation method; one of the same leading shape.

    Returns
    -------
    ndarray of shape (..., p + 1)
        0 for silence.

    Raises
    ------
    ValueError
        If the leading shapes differ, or the signal is empty or holds NaN or infinity.

    Notes
    -----
    Printed is RMS(DFT{a} - DFT{a_g}) of the signal a and one synthesised sound a_g. With phases, two sounds
    of the same spectrum but different noise would differ by sqrt(2), so magnitudes are compared. |X| is the
    RMS over the signal's segments of N samples (the printed fft(x, N) takes the first; a shorter signal is
    padded), and |G| = residual_m sqrt(N) / |A_m| what all sounds of the model have on average, so that no
    noise is drawn.
    Even the true model keeps an error of about 0.5 / sqrt(number of segments), the variance of |X|.

    References
    ----------
    `oeztuerk2018`, eq. (3.11), (3.12), figure 3.2.
    """
    samples = np.asarray(x, dtype=np.float64)
    if samples.ndim not in (1, 2) or samples.shape[:-1] != model.gain.shape or samples.shape[-1] == 0:
        raise ValueError(
            f"signal {samples.shape} for models {model.gain.shape}. Expected equal leading shapes"
        )
    if not np.all(np.isfinite(samples)):
        raise ValueError("the signal holds NaN or infinity. Expected finite samples")
    omega, length = 2 * np.pi * fft.rfftfreq(N_DFT), min(N_DFT, samples.shape[-1])
    rows = np.atleast_2d(samples), np.atleast_2d(model.reflection), np.atleast_2d(model.residual)
    curves = np.zeros(rows[2].shape)
    for curve, row, k, residual in zip(curves, *rows, strict=True):
        if (peak := np.abs(row).max()) > 0:
            segments = (row / peak)[: row.size // length * length].reshape(-1, length)
            measured = np.sqrt(np.mean(np.abs(fft.rfft(segments, N_DFT, axis=1)) ** 2, axis=0))
            ln_a = recursions.log_magnitudes(np.ascontiguousarray(k), omega)
            modelled = (residual / peak * np.sqrt(length))[:, np.newaxis] * np.exp(-ln_a)
            curve[:] = relative_error(measured, modelled)
    return curves.reshape(model.residual.shape)


def aicc(model: Autoregression, n: int) -> Samples:
    """Return Akaike's information criterion, corrected for short signals, of the orders 0 ... p.

    AICc_m = n ln(residual_m^2) + 2 n (m + 1) / (n - m - 2)

    Parameters
    ----------
    model : Autoregression
        Fitted to `n` samples by Burg's or the autocorrelation method.
    n : int
        Samples of the signal or of each frame.

    Returns
    -------
    ndarray of shape (..., p + 1)
        -inf where nothing is left unpredicted, else inf where m > n - 3.

    References
    ----------
    Hurvich and Tsai, "Regression and time series model selection in small samples", 1989.
    """
    m = np.arange(model.order + 1)
    room = n - m - 2
    penalty = np.where(room > 0, 2.0 * n * (m + 1) / np.maximum(room, 1), np.inf)
    with np.errstate(divide="ignore"):
        fitted = 2.0 * n * np.log(model.residual)
    return np.where(np.isneginf(fitted), -np.inf, np.maximum(fitted, -np.finfo(np.float64).max) + penalty)
