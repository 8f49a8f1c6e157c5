"""Autoregressive model of the movement: one spectral envelope in five parametrisations.

One Burg fit per frame serves all of them. The movement is first resampled to twice `BAND_HZ`: the order of
the model then describes the band that humans perceive, at any sampling rate of the sensor. The models of the
frames are averaged as log-area ratios, because every average of them is a stable model. Loud and quiet frames
have the same weight.
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

Selected among 8, 12, 18 and 24, together with frames of 0.1 s, 1 s and the whole movement, and bands up to
700, 1000 and 1400 Hz: LDA on repetitions 1-10 against 11-20 of `biotac20`, and with ten folds and left-out
operators on `simulated69`. Higher orders do not improve the accuracy."""
FRAME_S = 0.25
"""Length of a frame in s."""
BAND_HZ = 1000.0
"""Upper end of the band in Hz."""
MIN_POWER = 1e-10
"""Smallest power of a frame relative to the strongest frame; less is rounding error of silence."""


@transform
def mean_model(view: PhaseView, order: int, frame_s: float, band_hz: float) -> tuple[Samples, float]:
    """Return the reflection coefficients of the mean model of a movement, and its sampling rate in Hz.

    1. Cut the band-limited movement into adjacent frames of at least four samples per coefficient. A shorter
       movement is one frame; it needs two samples per coefficient.
    2. Fit every non-silent frame by Burg's method.
    3. Average the log-area ratios.
    """
    x, fs = band_limited(view, band_hz)
    n = x.size
    if n < 2 * order:
        raise UndefinedFeatureError(f"{n} samples below {band_hz:g} Hz. Expected {2 * order} (2 x order)")
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
    """Return the line spectral frequencies of the movement; two close ones indicate a resonance.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    order : int
        Order of the model (default 18).
    frame_s : float
        Length of the frames whose models are averaged, in s (default 0.25).
    band_hz : float
        Upper end of the band in Hz (default 1000); if fs/2 is lower, fs/2, and the value then depends on fs.

    Returns
    -------
    ndarray of shape (order,)
        Frequencies in Hz, ascending.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 64 samples or two samples per coefficient in the band.

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
    """Return the log-area ratios ln((1 + k)/(1 - k)) of the movement, with reflection coefficients k.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (order,)
        Mean over frames.

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`.

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
    """Return the cepstral coefficients c_1 ... c_n of the autoregressive model; c_0, the level, is omitted.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    n_coefficients : int
        Number n of coefficients (default 18).
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (n_coefficients,)
        Coefficients c_1 ... c_n.

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`.

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

    The power of the movement over the power of the prediction error: 0 dB for white noise. The order at which
    it stops rising indicates the number of resonances.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    orders : tuple of int
        Orders from 1 to `order`.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (len(orders),)
        Gains in dB.

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`, and for orders above that of the model.

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
    """Return frequencies and bandwidths (decay rate / pi) of the main resonances, by ascending frequency.

    These are the poles of the model of order 2 `n_resonances`, which has exactly that many pole pairs. In a
    higher order, pole pairs that model the slope of the spectrum would compete with resonances. A real pole
    counts as a resonance at 0 or at the end of the band, after all pairs.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    n_resonances : int
        Number n of resonances (default 4); 2 n is at most `order`.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (2 n_resonances,)
        Frequencies in Hz, then bandwidths in Hz.

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`, and for more resonances than half the order.

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
    """Return `n` poles with Im z >= 0 by angle: pairs are preferred over real poles, slow decay over fast."""
    z = z[z.imag >= 0]
    z = np.where(np.abs(z) < 2.0**-52, 2.0**-52, z)  # avoid log(0) for a pole at 0
    first = np.lexsort((-np.abs(z), z.imag == 0))[:n]
    return np.asarray(z[first][np.argsort(np.angle(z[first]), kind="stable")])
