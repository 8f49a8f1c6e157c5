"""Between autoregressive models: a model for every point between those that were fitted, always stable.

Line spectral frequencies and log gain are mixed linearly::

    theta = sum_i w_i theta_i,    ln gain = sum_i w_i ln gain_i,    w_i >= 0, sum_i w_i = 1

A mean of increasing sequences increases, and every increasing sequence in (0, pi) is a stable model.
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
    """Models of one order, ready to be mixed with any weights: their line spectra are computed once.

    Parameters
    ----------
    models : sequence of Autoregression of leading shape (), or one of leading shape (n_models,)
        Of one order, at least 1, and one unit.
    loudness : {"gain", "level"}
        Whose logarithm is mixed: the gain's, as in the papers, or that of the RMS of the vibration. Sharp
        resonances of two models lie between different frequencies, so that none remains halfway, and the
        gain alone does not make up for it: between two tones in noise (60 dB, order 6) the middle is 49 dB
        too quiet. The level stays that of the models.

    Attributes
    ----------
    frequencies : ndarray of shape (n_models, p)
        Line spectral frequencies, rad per sample.
    amplitude : ndarray of shape (n_models,)
        Gain or level of each model, as `loudness` says.

    Raises
    ------
    ValueError
        If there is no model, orders differ or are 0, a model is a stack, or a level is not finite.

    Notes
    -----
    Frequencies that come closer than `line_spectrum.MIN_GAP` are moved apart, those of the models too, so
    that the path is continuous up to its ends. A model of silence (gain 0) has no spectrum: it takes its
    share of the amplitude, linearly, and leaves the frequencies to the others.

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
            raise ValueError(f"loudness is {loudness!r}. Expected one of {get_args(Loudness)}")
        rows = [models] if isinstance(models, Autoregression) else list(models)
        shapes = [m.reflection.shape for m in rows]
        n_axes = 2 if isinstance(models, Autoregression) else 1
        if len(set(shapes)) != 1 or len(shapes[0]) != n_axes or 0 in shapes[0]:
            raise ValueError(f"models have reflection {shapes}. Expected single models of one order, p >= 1")
        k = np.concatenate([np.atleast_2d(m.reflection) for m in rows])
        self.amplitude = np.concatenate([np.atleast_1d(getattr(m, loudness)) for m in rows])
        if not np.all(np.isfinite(self.amplitude)):
            raise ValueError(f"{loudness} of a model is {self.amplitude.max()}. Expected a finite one")
        self.loudness = loudness
        self.frequencies = line_spectrum.spread(line_spectrum.from_reflection(k))

    def at(self, weights: ArrayLike) -> Autoregression:
        """Return the model at the weights.

        Parameters
        ----------
        weights : array_like of shape (..., n_models)
            Each at least 0, their sum 1: nothing is extrapolated.

        Returns
        -------
        Autoregression
            Of leading shape (...), stable for every weight.

        Raises
        ------
        ValueError
            If a weight is negative, NaN, the sum is not 1 (both within 1e-9), or the shape is wrong.
        """
        w, n = np.asarray(weights, dtype=np.float64), len(self.amplitude)
        if w.ndim < 1 or w.shape[-1] != n:
            raise ValueError(f"weights have shape {w.shape}. Expected (..., {n}), one for each model")
        total = w.sum(axis=-1, keepdims=True)
        rounding = 1e-9  # as of barycentric coordinates
        if not (np.all(w >= -rounding) and np.all(np.abs(total - 1) <= rounding)):
            raise ValueError(f"weights are {w}. Expected at least 0 each, and 1 in sum: no extrapolation")
        w = np.maximum(w, 0.0)
        w = w / w.sum(axis=-1, keepdims=True)
        sounding = self.amplitude > 0
        share = np.sum(w, axis=-1, where=sounding, keepdims=True)
        v = np.where(share > 0, np.where(sounding, w, 0.0) / np.where(share > 0, share, 1.0), w)
        mean = np.prod(np.where(sounding, self.amplitude, 1.0) ** v, axis=-1)
        mixed = np.einsum("...i,ij->...j", v, self.frequencies)  # bit for bit alike for one row and for many
        theta = line_spectrum.spread(mixed)
        k, amplitude = line_spectrum.to_reflection(theta), np.asarray(share[..., 0] * mean)
        if self.loudness == "level":  # gain = level prod sqrt(1 - k^2)
            amplitude = amplitude * np.exp(log_cosines(k).sum(axis=-1))
        return Autoregression(k, amplitude)


def interpolate(
    a: Autoregression, b: Autoregression, weight: ArrayLike, *, loudness: Loudness = "gain"
) -> Autoregression:
    """Return the model between two of one order: theta = (1 - w) theta_a + w theta_b, and so the log gain.

    Parameters
    ----------
    a, b : Autoregression
        Of leading shape (), of one order and unit.
    weight : array_like of shape (...)
        0 gives `a`, 1 gives `b`; in [0, 1], nothing is extrapolated.
    loudness
        As for `ModelBlend`, which is faster for many weights one after the other.

    Returns
    -------
    Autoregression
        Of leading shape (...), stable for every weight.

    Raises
    ------
    ValueError
        As `ModelBlend`, and for a weight outside [0, 1].

    Examples
    --------
    >>> slow, fast = Autoregression([-0.9, 0.5], 1.0), Autoregression([0.2, 0.5], 4.0)
    >>> float(interpolate(slow, fast, 0.25).gain.round(4))
    1.4142
    """
    w = np.asarray(weight, dtype=np.float64)
    if not np.all((w >= 0) & (w <= 1)):
        raise ValueError(f"weight is {w[~((w >= 0) & (w <= 1))][0]}. Expected 0 to 1")
    return ModelBlend([a, b], loudness=loudness).at(np.stack([1 - w, w], axis=-1))
