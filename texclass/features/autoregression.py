"""Autoregressive model of the movement: one spectral envelope in five parametrisations.

All five are computed from one Burg fit per frame. The movement is first resampled to twice `BAND_HZ`, so that
the model covers the band that humans perceive, whatever the sampling rate of the sensor. The models of the
frames are averaged as log-area ratios, because any average of log-area ratios corresponds to a stable model.
Loud and quiet frames have the same weight.
"""

import numpy as np
from numpy.typing import NDArray

from texclass.features.contract import UndefinedFeatureError, feature
from texclass.features.movement_filters import band_limited
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.recording import Samples
from texclass.vibration import autoregressive, line_spectrum
from texclass.vibration.autoregressive import Autoregression

ORDER = 18
"""Order of the model.

Selected among 8, 12, 18 and 24 by a grid search, which also varied the frame length (0.1 s, 1 s, whole
movement) and the band (up to 700, 1000 and 1400 Hz). The score was the accuracy of LDA. On `biotac20`, LDA
was trained on repetitions 1-10 and tested on 11-20. On `simulated69`, it was tested in ten folds and on
left-out operators. Higher orders do not improve the accuracy."""
FRAME_S = 0.25
"""Length of a frame in s."""
BAND_HZ = 1000.0
"""Upper end of the band in Hz."""
MIN_POWER = 1e-10
"""Smallest power of a frame, relative to the strongest frame. A weaker frame counts as silent: it contains
only rounding errors."""


@transform
def mean_model(view: PhaseView, order: int, frame_s: float, band_hz: float) -> tuple[Samples, float]:
    """Return the reflection coefficients of the mean autoregressive model, and its sampling rate in Hz.

    1. Cut the band-limited movement into adjacent frames of at least four samples per coefficient. A shorter
       movement forms a single frame, which must have at least two samples per coefficient.
    2. Fit a model to every non-silent frame by Burg's method.
    3. Average the log-area ratios.
    """
    x, fs = band_limited(view, band_hz)
    n = x.size
    if n < 2 * order:
        raise UndefinedFeatureError(
            f"{n} samples at twice {band_hz:g} Hz. Expected at least {2 * order} (2 x order)"
        )
    length = min(n, max(round(frame_s * fs), 4 * order))
    frames = x[: n // length * length].reshape(-1, length)
    power = np.einsum("kt,kt->k", frames, frames)
    audible = frames[power > MIN_POWER * power.max()]
    undefined_if(not audible.size, f"silence: no energy below {band_hz:g} Hz")
    lar = autoregressive.fit(audible, order).log_area_ratios.mean(axis=0)
    return np.clip(np.tanh(lar / 2), -1 + 2**-53, 1 - 2**-53), fs


@feature("movement", "Hz", "abdulali2016, section 4.1", outputs="f{order}")
def line_spectral_frequencies(
    view: PhaseView, *, order: int = ORDER, frame_s: float = FRAME_S, band_hz: float = BAND_HZ
) -> Samples:
    """Return the line spectral frequencies of the movement.

    Two line spectral frequencies that are close together indicate a resonance.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    order : int
        Order of the model (default 18).
    frame_s : float
        Length of the frames whose models are averaged, in s (default 0.25).
    band_hz : float
        Upper end of the band in Hz (default 1000). If fs/2 is lower, the band ends at fs/2, and the values
        depend on fs.

    Returns
    -------
    ndarray of shape (order,)
        Frequencies in Hz, ascending.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, has fewer than 64 samples, or has fewer than two samples per coefficient
        after resampling.

    References
    ----------
    `abdulali2016`, section 4.1.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> line_spectral_frequencies(x, fs=2000, order=4).round(-2).tolist()  # white noise: evenly spaced
    [200.0, 400.0, 600.0, 800.0]
    """
    k, fs = mean_model(view, order, frame_s, band_hz)
    return line_spectrum.from_reflection(k) * (fs / (2 * np.pi))


@feature("movement", "1", "oeztuerk2018, eq. 3.1-3.7", outputs="g{order}")
def log_area_ratios(
    view: PhaseView, *, order: int = ORDER, frame_s: float = FRAME_S, band_hz: float = BAND_HZ
) -> Samples:
    """Return the log-area ratios of the movement, ln((1 + k)/(1 - k)) for each reflection coefficient k.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    order, frame_s, band_hz
        See `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (order,)
        Log-area ratios, averaged over frames.

    Raises
    ------
    UndefinedFeatureError
        If `line_spectral_frequencies` is undefined.

    References
    ----------
    `oeztuerk2018`, eq. 3.1-3.7, for the model.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> x[1:] += 0.9 * x[:-1]
    >>> log_area_ratios(x, fs=2000, order=2).round(1).tolist()
    [-1.1, 0.7]
    """
    k, _ = mean_model(view, order, frame_s, band_hz)
    return Autoregression(k, np.ones(())).log_area_ratios


@feature("movement", "1", "oeztuerk2018, eq. 3.1-3.7", outputs="c{n_coefficients}")
def lpc_cepstrum(
    view: PhaseView,
    *,
    n_coefficients: int = ORDER,
    order: int = ORDER,
    frame_s: float = FRAME_S,
    band_hz: float = BAND_HZ,
) -> Samples:
    """Return the cepstral coefficients c_1 ... c_n of the autoregressive model, without the level c_0.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_coefficients : int
        Number n of coefficients (default 18).
    order, frame_s, band_hz
        See `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (n_coefficients,)
        Coefficients c_1 ... c_n.

    Raises
    ------
    UndefinedFeatureError
        If `line_spectral_frequencies` is undefined.

    References
    ----------
    `oeztuerk2018`, eq. 3.1-3.7, for the model.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> x[1:] += 0.9 * x[:-1]
    >>> lpc_cepstrum(x, fs=2000, n_coefficients=2).round(1).tolist()
    [0.9, -0.4]
    """
    k, _ = mean_model(view, order, frame_s, band_hz)
    return Autoregression(k, np.ones(())).cepstrum(n_coefficients + 1)[1:]


@feature("movement", "dB", "oeztuerk2018, section 3.1", outputs="p{orders}")
def prediction_gain(
    view: PhaseView,
    *,
    orders: tuple[int, ...] = (1, 2, 4, 8, 16),
    order: int = ORDER,
    frame_s: float = FRAME_S,
    band_hz: float = BAND_HZ,
) -> Samples:
    """Return the prediction gain of the movement at several model orders, in dB.

    The prediction gain is the power of the movement divided by the power of the prediction error. It is 0 dB
    for white noise. The order at which it stops rising indicates the number of resonances.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    orders : tuple of int
        Model orders at which the gain is evaluated, each from 1 to `order`.
    order, frame_s, band_hz
        See `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (len(orders),)
        Gains in dB.

    Raises
    ------
    UndefinedFeatureError
        If `line_spectral_frequencies` is undefined, or one of `orders` exceeds `order`.

    References
    ----------
    `oeztuerk2018`, section 3.1.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> x[1:] += 0.9 * x[:-1]
    >>> prediction_gain(x, fs=2000, orders=(1, 2, 4)).round(1).tolist()
    [1.3, 1.7, 2.2]
    """
    if invalid := [p for p in orders if not 1 <= p <= order]:
        raise UndefinedFeatureError(f"orders must be 1 ... {order} (order of the model), got {invalid[0]}")
    k, _ = mean_model(view, order, frame_s, band_hz)
    gain = -10 * np.cumsum(np.log10((1 - k) * (1 + k)))  # of orders 1, 2, ...
    return np.asarray(gain[np.array(orders) - 1])


@feature(
    "movement", "Hz", "oeztuerk2018, section 3.1", outputs=("f{n_resonances}", "bandwidth{n_resonances}")
)
def resonances(
    view: PhaseView,
    *,
    n_resonances: int = 4,
    order: int = ORDER,
    frame_s: float = FRAME_S,
    band_hz: float = BAND_HZ,
) -> Samples:
    """Return the frequencies and bandwidths (decay rate / pi) of the main resonances, in order of frequency.

    The resonances are the pole pairs of the model of order 2 `n_resonances`. A model of higher order would
    contain further pole pairs that describe the slope of the spectrum instead of resonances. If the model has
    fewer pole pairs, real poles are used as well, as resonances at 0 Hz or at the end of the band.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_resonances : int
        Number n of resonances (default 4), at most half of `order`.
    order, frame_s, band_hz
        See `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (2 n_resonances,)
        Frequencies in Hz, then bandwidths in Hz.

    Raises
    ------
    UndefinedFeatureError
        If `line_spectral_frequencies` is undefined, or `n_resonances` exceeds half of `order`.

    References
    ----------
    `oeztuerk2018`, section 3.1.

    Examples
    --------
    >>> import numpy as np
    >>> t, rng = np.arange(10_000) / 2000, np.random.default_rng(0)
    >>> ringing = np.exp(-60 * t[:200]) * np.sin(2 * np.pi * 300 * t[:200])
    >>> x = np.convolve(rng.standard_normal(10_000), ringing)
    >>> resonances(x, fs=2000, n_resonances=1).round(-1).tolist()  # 300 Hz, bandwidth 60 / pi
    [300.0, 20.0]
    """
    undefined_if(
        not 1 <= n_resonances <= order // 2,
        f"n_resonances must be 1 ... {order // 2} (half the order), got {n_resonances}",
    )
    k, fs = mean_model(view, order, frame_s, band_hz)
    z = upper_poles(Autoregression(k[: 2 * n_resonances], np.ones(())).poles(), n_resonances)
    frequency, decay = np.angle(z) * fs / (2 * np.pi), -np.log(np.abs(z)) * fs
    return np.concatenate([frequency, decay / np.pi])


def upper_poles(z: NDArray[np.complex128], n: int) -> NDArray[np.complex128]:
    """Select `n` poles with Im z >= 0 and return them in order of angle.

    Complex poles are preferred to real ones, and slowly decaying poles to fast ones.
    """
    z = z[z.imag >= 0]
    z = np.where(np.abs(z) < 2.0**-52, 2.0**-52, z)  # avoid log(0) for a pole at 0
    first = np.lexsort((-np.abs(z), z.imag == 0))[:n]
    return np.asarray(z[first][np.argsort(np.angle(z[first]), kind="stable")])
