"""The movement as an autoregressive model: the same spectral envelope, said in five ways.

One Burg fit per frame serves all of them. The movement is first brought to a rate of twice `BAND_HZ`, so that
the model spends its order on what is felt and does not depend on the rate of the sensor. The models of the
frames are averaged as log-area ratios, where every average is a stable model: loud frames weigh no more than
quiet ones.
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

Of 8, 12, 18 and 24, of frames of 0.1 s, 1 s and the whole movement, and of bands up to 700, 1000 and 1400 Hz,
chosen with LDA by repetitions 1-10 against 11-20 of `biotac20` and by ten folds and left-out operators of
`simulated69`: the accuracy no longer rises beyond it.
"""
FRAME_S = 0.25
BAND_HZ = 1000.0
SILENT = 1e-10
"""Power of a frame, in powers of the loudest one, below which it is what rounding left of silence."""


@transform
def mean_model(view: PhaseView, order: int, frame_s: float, band_hz: float) -> tuple[Samples, float]:
    """Return the reflection coefficients of the average model of a movement, and the rate in Hz it runs at.

    Every frame is fitted by Burg's method, and the log-area ratios of those that are not silent are averaged.
    Frames follow each other without overlap; they hold four samples per coefficient at least, and a shorter
    movement is one frame, down to two samples per coefficient.
    """
    x, fs = band_limited(view, band_hz)
    n = x.size
    if n < 2 * order:
        raise UndefinedFeatureError(f"{n} samples below {band_hz:g} Hz. Expected 2 x the order of {order}")
    length = min(n, max(round(frame_s * fs), 4 * order))
    frames = x[: n // length * length].reshape(-1, length)
    power = np.einsum("kt,kt->k", frames, frames)
    heard = frames[power > SILENT * power.max()]
    undefined_if(not heard.size, f"silence: no energy below {band_hz:g} Hz")
    lar = autoregressive.fit(heard, order).log_area_ratios.mean(axis=0)
    return np.clip(np.tanh(lar / 2), -1 + 2**-53, 1 - 2**-53), fs


@feature("movement", "Hz", "abdulali2016, section 4.1", outputs="f{order}")
def line_spectral_frequencies(
    view: PhaseView, *, order: int = ORDER, frame_s: float = FRAME_S, band_hz: float = BAND_HZ
) -> Samples:
    """Line spectral frequencies of the movement's autoregressive model: two close ones are a resonance.

    Parameters
    ----------
    view : PhaseView
        Movement.
    order : int
        Of the model, one frequency per coefficient.
    frame_s : float
        Length of the frames whose models are averaged, in s.
    band_hz : float
        Upper end of the band that is modelled, in Hz; fs/2 if that is lower: the value then depends on fs.

    Returns
    -------
    ndarray of shape (order,)

    Raises
    ------
    UndefinedFeatureError
        For silence, or a movement that holds fewer than 64 samples or than two per coefficient in the band.
    """
    k, fs = mean_model(view, order, frame_s, band_hz)
    return line_spectrum.from_reflection(k) * (fs / (2 * np.pi))


@feature("movement", "1", "oeztuerk2018, eq. 3.1-3.7", outputs="g{order}")
def log_area_ratios(
    view: PhaseView, *, order: int = ORDER, frame_s: float = FRAME_S, band_hz: float = BAND_HZ
) -> Samples:
    """Log-area ratios ln((1 + k)/(1 - k)) of the movement's autoregressive model, mean over frames.

    Parameters
    ----------
    view : PhaseView
        Movement.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (order,)

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`.
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
    """Cepstrum c_1 ... c_n of the movement's autoregressive model; c_0, the level, is left out.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_coefficients : int
        n.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (n_coefficients,)

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`.
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
    """Prediction gain of the movement: its power over what models of a few orders leave unpredicted, in dB.

    0 for white noise; the order at which it stops rising tells how many resonances there are.

    Parameters
    ----------
    view : PhaseView
        Movement.
    orders : tuple of int
        Which, each from 1 to `order`.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (len(orders),)

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`, and for orders beyond the model's.
    """
    if wrong := [p for p in orders if not 1 <= p <= order]:
        raise UndefinedFeatureError(f"prediction gain of order {wrong[0]}. Expected 1 ... {order}")
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
    """Frequencies and bandwidths (decay rate / pi) of the movement's main resonances, by rising frequency.

    They are the poles of the model of order 2 `n_resonances`, which has just as many pairs: of a higher
    order, those that stand for a slope of the spectrum would compete, and which ones are returned be chance.
    A real pole counts as a resonance at 0 or at the end of the band, after all pairs.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_resonances : int
        n; 2 n is at most `order`.
    order, frame_s, band_hz
        As in `line_spectral_frequencies`.

    Returns
    -------
    ndarray of shape (2 n_resonances,)
        Frequencies, then bandwidths.

    Raises
    ------
    UndefinedFeatureError
        As `line_spectral_frequencies`, and for more resonances than the order has.
    """
    undefined_if(
        not 1 <= n_resonances <= order // 2,
        f"{n_resonances} resonances. Expected 1 ... {order // 2} (half the order)",
    )
    k, fs = mean_model(view, order, frame_s, band_hz)
    z = upper_poles(Autoregression(k[: 2 * n_resonances], np.ones(())).poles(), n_resonances)
    frequency, decay = np.angle(z) * fs / (2 * np.pi), -np.log(np.abs(z)) * fs
    return np.concatenate([frequency, decay / np.pi])


def upper_poles(z: NDArray[np.complex128], n: int) -> NDArray[np.complex128]:
    """Return `n` of the poles with Im z >= 0, pairs before real ones and slow before fast ones, by angle."""
    z = z[z.imag >= 0]
    z = np.where(np.abs(z) < 2.0**-52, 2.0**-52, z)  # a pole at 0 decays at once: log still gives a number
    first = np.lexsort((-np.abs(z), z.imag == 0))[:n]
    return np.asarray(z[first][np.argsort(np.angle(z[first]), kind="stable")])
