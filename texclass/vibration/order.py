"""Selection of the order of an autoregressive model. One fit yields the models of all lower orders."""

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
    """Result of `select_order`.

    Parameters
    ----------
    order : int
        Selected order, the same for all frames.
    is_met : bool
        Whether the error is at most `max_error`; True if there is no limit.
    values : ndarray of shape (max_order + 1,)
        Criterion at the orders 0 ... max_order.
    model : Autoregression
        Model of the selected order.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(2000)
    >>> selection = select_order(np.convolve(x, [1.0, 0.9])[:-1], 12, criterion="aicc")
    >>> selection.order, selection.is_met, selection.values.shape
    (12, True, (13,))
    """

    order: int
    is_met: bool
    values: Samples
    model: Autoregression


def select_order(
    x: ArrayLike,
    max_order: int,
    *,
    criterion: Criterion = "spectral_error",
    max_error: float | None = None,
    method: Literal["burg", "autocorrelation"] = "burg",
) -> OrderSelection:
    """Select an order between 0 and `max_order` from one fit at `max_order`.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        Signal or frames in any unit. One order is selected for all frames, from the mean of the criterion
        over the frames.
    max_order : int
        Largest order, at least 1.
    criterion : {"spectral_error", "aicc"}
        Criterion (default "spectral_error"). Without `max_error`, "spectral_error" selects the smallest order
        whose error exceeds the smallest error by at most 5 % of the difference between the error at order 0
        and the smallest error, as in figure 3.2 of the thesis. "aicc" selects the order with the smallest
        AICc.
    max_error : float, optional
        Largest spectral error. The smallest order with at most this error is selected. If no order reaches
        it, the order with the smallest error is selected, and `is_met` is False.
    method : {"burg", "autocorrelation"}
        Method of the fit (default "burg"). With both methods, one fit yields the models of all lower orders.

    Returns
    -------
    OrderSelection
        Selected order and its model; order 0 for silence.

    Raises
    ------
    ValueError
        If the criterion or method is unknown, `max_error` is negative or combined with "aicc", or `fit`
        rejects the signal or the order.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(4000)
    >>> for i in range(2, x.size):  # an autoregressive process of order 2
    ...     x[i] += 1.35 * x[i - 1] - 0.5 * x[i - 2]
    >>> select_order(x, 20).order, select_order(x, 20, criterion="aicc").order
    (2, 2)
    """
    if criterion not in get_args(Criterion):
        raise ValueError(f"criterion must be one of {get_args(Criterion)}, got {criterion!r}")
    if method not in ("burg", "autocorrelation"):
        raise ValueError(f"method must be 'burg' or 'autocorrelation', got {method!r}")
    if max_error is not None and criterion != "spectral_error":
        raise ValueError(f"max_error must be used with criterion='spectral_error', got {criterion!r}")
    if max_error is not None and not max_error >= 0:
        raise ValueError(f"max_error must not be negative, got {max_error}")
    model = fit(x, max_order, method=method)
    curve = aicc(model, np.shape(x)[-1]) if criterion == "aicc" else spectral_error(x, model)
    values = curve if curve.ndim == 1 else curve.mean(axis=0)
    best = int(np.argmin(values))
    limit = values[best]
    if criterion == "spectral_error":
        limit = limit + 0.05 * (values[0] - limit) if max_error is None else max(max_error, limit)
    order = int(np.argmax(values <= limit))
    return OrderSelection(
        order, max_error is None or bool(values[order] <= max_error), values, model.truncate(order)
    )


def spectral_error(x: ArrayLike, model: Autoregression) -> Samples:
    """Return the relative RMS error of the magnitude spectrum of a model at each order 0 ... p.

    C = RMS(|X| - |G|) / RMS(|X|), with the RMS over the N = `N_DFT` bins of the DFT.

    Parameters
    ----------
    x : array_like of shape (n,) or (n_frames, n)
        Signal or frames, in the unit of the model.
    model : Autoregression
        Model of the same leading shape, fitted to `x` by Burg's or the autocorrelation method.

    Returns
    -------
    ndarray of shape (..., p + 1)
        Error of each order; 0 for silence.

    Raises
    ------
    ValueError
        If the leading shapes differ, or the signal is empty or contains NaN or infinity.

    Notes
    -----
    The printed formula is RMS(DFT{a} - DFT{a_g}) for the signal a and one synthesised signal a_g. If phases
    were included, two realisations of the same process would differ by sqrt(2), so only magnitudes are
    compared. |X| is the RMS over all segments of N samples of the signal; the printed fft(x, N) uses only the
    first segment. A shorter signal is padded with zeros. |G| = residual_m sqrt(N) / |A_m| is the expected
    magnitude of the model, so no noise is drawn. Even the true model has an error of about 0.5 / sqrt(number
    of segments), because of the variance of |X|.

    References
    ----------
    `oeztuerk2018`, eq. (3.11), (3.12), figure 3.2.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(28_000)
    >>> spectral_error(x, fit(x, 2)).round(2)
    array([0.16, 0.16, 0.16])
    """
    samples = np.asarray(x, dtype=np.float64)
    if samples.ndim not in (1, 2) or samples.shape[:-1] != model.gain.shape or samples.shape[-1] == 0:
        raise ValueError(
            f"x and model must have equal leading shapes, got x of the shape {samples.shape} and models of "
            f"the shape {model.gain.shape}"
        )
    if not np.all(np.isfinite(samples)):
        raise ValueError("x must contain finite samples, got NaN or infinity")
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
    """Return Akaike's information criterion, corrected for short signals (AICc), at each order 0 ... p.

    AICc_m = n ln(residual_m^2) + 2 n (m + 1) / (n - m - 2)

    Parameters
    ----------
    model : Autoregression
        Model fitted to `n` samples by Burg's or the autocorrelation method.
    n : int
        Number of samples of the signal or of each frame.

    Returns
    -------
    ndarray of shape (..., p + 1)
        Criterion of each order: -inf if the residual is 0, otherwise inf for m > n - 3.

    References
    ----------
    Hurvich and Tsai, "Regression and time series model selection in small samples", 1989.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(100)
    >>> aicc(fit(x, 2), 100).round(1)
    array([-5. , -4.2, -2.5])
    """
    m = np.arange(model.order + 1)
    n_free = n - m - 2
    penalty = np.where(n_free > 0, 2.0 * n * (m + 1) / np.maximum(n_free, 1), np.inf)
    with np.errstate(divide="ignore"):
        fitted = 2.0 * n * np.log(model.residual)
    return np.where(np.isneginf(fitted), -np.inf, np.maximum(fitted, -np.finfo(np.float64).max) + penalty)
