"""Interpolation between autoregressive models. The result is always a stable model.

Line spectral frequencies and log gains are mixed linearly::

    theta = sum_i w_i theta_i,    ln gain = sum_i w_i ln gain_i,    w_i >= 0, sum_i w_i = 1

The mean of increasing sequences is increasing, and every increasing sequence in (0, pi) is a stable model.
"""

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.reflection import log_cosines

Loudness = Literal["gain", "level"]
Models = Sequence[Autoregression] | Autoregression


class ModelBlend:
    """Weighted mixture of several models of the same order. The line spectra are computed only once.

    Parameters
    ----------
    models : sequence of Autoregression of leading shape (), or one of leading shape (n_models,)
        Models of the same order, at least 1, and the same unit.
    loudness : {"gain", "level"}
        Quantity whose logarithm is mixed: the gain (default, as in the papers), or the RMS level of the
        vibration. If two models have sharp resonances at different frequencies, their mixture has no sharp
        resonance, and the gain does not compensate for it. For example, the middle between two tones in noise
        (60 dB, order 6) is 49 dB too quiet. Mixing the level avoids this.

    Attributes
    ----------
    frequencies : ndarray of shape (n_models, p)
        Line spectral frequencies in rad per sample.
    amplitude : ndarray of shape (n_models,)
        Gain or level of each model, according to `loudness`.

    Raises
    ------
    ValueError
        If there is no model, the orders differ or are 0, a model is a stack, or a gain or level is not
        finite.

    Notes
    -----
    Frequencies that are closer than `line_spectrum.MIN_GAP` are moved apart. This also applies to the
    frequencies of the models, so that the mixture is continuous up to weights of 0 and 1. A model of silence
    (gain 0) has no spectrum. It reduces the amplitude linearly with its weight and does not affect the
    frequencies.

    References
    ----------
    `abdulali2016`, section 3.2; `oeztuerk2018`, section 3.1.

    Examples
    --------
    >>> blend = ModelBlend([Autoregression([-0.9, 0.5], 1.0), Autoregression([0.2, 0.5], 4.0)])
    >>> float(blend.at([0.5, 0.5]).gain), blend.at([[1, 0], [0.2, 0.8]]).reflection.shape
    (2.0, (2, 2))
    """

    def __init__(self, models: Models, *, loudness: Loudness = "gain") -> None:
        if loudness not in get_args(Loudness):
            raise ValueError(f"loudness must be one of {get_args(Loudness)}, got {loudness!r}")
        rows = [models] if isinstance(models, Autoregression) else list(models)
        shapes = [m.reflection.shape for m in rows]
        n_axes = 2 if isinstance(models, Autoregression) else 1
        if len(set(shapes)) != 1 or len(shapes[0]) != n_axes or 0 in shapes[0]:
            raise ValueError(
                "models must be single AR models of the same order p >= 1, got reflection coefficients of "
                f"shapes {shapes}"
            )
        k = np.concatenate([np.atleast_2d(m.reflection) for m in rows])
        self.amplitude = np.concatenate([np.atleast_1d(getattr(m, loudness)) for m in rows])
        if not np.all(np.isfinite(self.amplitude)):
            raise ValueError(f"the {loudness} of each model must be finite, got {self.amplitude.max()}")
        self.loudness = loudness
        self.frequencies = line_spectrum.spread(line_spectrum.from_reflection(k))

    def at(self, weights: ArrayLike) -> Autoregression:
        """Return the mixture for given weights.

        Parameters
        ----------
        weights : array_like of shape (..., n_models)
            Non-negative weights whose sum is 1. Extrapolation is not possible.

        Returns
        -------
        Autoregression
            Stable model with the leading shape (...).

        Raises
        ------
        ValueError
            If a weight is negative or NaN, the sum is not 1 (both within 1e-9), or the shape does not match.
        """
        w, n = np.asarray(weights, dtype=np.float64), len(self.amplitude)
        if w.ndim < 1 or w.shape[-1] != n:
            raise ValueError(f"weights must have the shape (..., {n}), one per model, got {w.shape}")
        total = w.sum(axis=-1, keepdims=True)
        rounding = 1e-9  # barycentric coordinates are rounded to about this
        if not (np.all(w >= -rounding) and np.all(np.abs(total - 1) <= rounding)):
            raise ValueError(f"weights must not be negative and their sum must be 1, got {w}")
        w = np.maximum(w, 0.0)
        w = w / w.sum(axis=-1, keepdims=True)
        is_audible = self.amplitude > 0
        share = np.sum(w, axis=-1, where=is_audible, keepdims=True)
        v = np.where(share > 0, np.where(is_audible, w, 0.0) / np.where(share > 0, share, 1.0), w)
        mean = np.prod(np.where(is_audible, self.amplitude, 1.0) ** v, axis=-1)
        mixed = np.einsum("...i,ij->...j", v, self.frequencies)  # same bits for one row and many rows
        theta = line_spectrum.spread(mixed)
        k, amplitude = line_spectrum.to_reflection(theta), np.asarray(share[..., 0] * mean)
        if self.loudness == "level":  # gain = level prod sqrt(1 - k^2)
            amplitude = amplitude * np.exp(log_cosines(k).sum(axis=-1))
        return Autoregression(k, amplitude)


def interpolate(
    a: Autoregression, b: Autoregression, weight: ArrayLike, *, loudness: Loudness = "gain"
) -> Autoregression:
    """Interpolate between two models of the same order.

    Line spectral frequencies and log gain are interpolated linearly: theta = (1 - w) theta_a + w theta_b.

    Parameters
    ----------
    a, b : Autoregression
        Models of leading shape (), of the same order and unit.
    weight : array_like of shape (...)
        Weight of `b` in [0, 1]: 0 gives `a`, 1 gives `b`.
    loudness : {"gain", "level"}
        Quantity whose logarithm is mixed (default "gain"), as in `ModelBlend`. That class is faster for many
        calls with the same models.

    Returns
    -------
    Autoregression
        Stable model with the leading shape (...).

    Raises
    ------
    ValueError
        If `ModelBlend` rejects the models, or a weight lies outside [0, 1].

    Examples
    --------
    >>> slow, fast = Autoregression([-0.9, 0.5], 1.0), Autoregression([0.2, 0.5], 4.0)
    >>> float(interpolate(slow, fast, 0.25).gain.round(4))
    1.4142
    """
    w = np.asarray(weight, dtype=np.float64)
    if not np.all((w >= 0) & (w <= 1)):
        raise ValueError(f"weight must lie between 0 and 1, got {w[~((w >= 0) & (w <= 1))][0]}")
    return ModelBlend([a, b], loudness=loudness).at(np.stack([1 - w, w], axis=-1))
