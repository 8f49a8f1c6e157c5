"""Decaying modes of taps: frequencies, decay rates, and amplitude per hand velocity."""

import functools

import numpy as np

from texclass.features.contract import feature
from texclass.features.hardness import map_taps, median_over_taps, unit_taps
from texclass.features.phase_view import TapSignal, TapView, transform, undefined_if
from texclass.recording import Samples
from texclass.vibration.decaying_modes import DecayingModes, fit_matrix_pencil

ORDER = 4
"""Number of poles of a tap, which corresponds to two modes.

Selected among 4, 8, 12 and the rank above the noise. With this order, adding the modes to the other tap
features improved the accuracy of LDA most, on left-out operators of `simulated69` and on `taps5` (3 training
recordings per plate)."""
TAP_RATE = 2800.0
"""Lowest sampling rate in Hz after decimation of a tap: twice the bandwidth of the sensor in strese2015."""


@functools.lru_cache(maxsize=32)
def _low_pass(q: int) -> Samples:
    """Return a FIR low-pass of length 4 q + 1 with the cut-off frequency fs/(2q) and gain 1 at 0 Hz."""
    h = np.sinc(np.arange(-2 * q, 2 * q + 1) / q) * np.hamming(4 * q + 1)
    return np.asarray(h / h.sum())


def decimated(x: Samples, fs: float) -> tuple[Samples, float]:
    """Return a tap decimated to the lowest possible rate of at least `TAP_RATE`, and this rate in Hz.

    Outputs of the symmetric FIR low-pass that depend on samples before the contact are dropped. The
    decimation then changes the amplitude of a decaying mode, but not its frequency or decay rate.
    """
    q = int(fs // TAP_RATE)
    if q < 2:
        return x, fs
    h = _low_pass(q)
    return np.asarray(np.convolve(x, h, "valid")[::q] if x.size >= h.size else x[:0]), fs / q


def modes_of(tap: TapSignal, fs: float, n_modes: int, order: int) -> DecayingModes:
    """Return the `n_modes` strongest modes of a tap in ascending order of frequency.

    If the tap has fewer modes, modes are repeated.

    Raises
    ------
    UndefinedFeatureError
        If the tap is silent, or too short for the fit.
    """
    x, rate = decimated(tap.impulse, fs)
    x = x[:64]  # at most 23 ms after decimation
    undefined_if(
        x.size < max(2 * order, 8),
        f"{x.size} samples of a tap. Expected at least {max(2 * order, 8)} at {rate:g} Hz",
    )
    modes = fit_matrix_pencil(x, rate, order=order)
    undefined_if(modes.n_modes == 0, "silence: the tap has no impulse")
    rank = np.resize(np.arange(min(n_modes, modes.n_modes)), n_modes)
    rank = rank[np.argsort(modes.frequency_hz[rank], kind="stable")]
    return DecayingModes(*modes.table[rank].T)


@transform
def tap_modes(view: TapView, n_modes: int, order: int) -> tuple[Samples, Samples]:
    """Return frequencies (Hz) and decay rates (1/s) of the strongest modes of each tap, (n_taps, n_modes)."""
    undefined_if(
        not 1 <= n_modes <= order // 2, f"n_modes must be 1 ... {order // 2} (half the order), got {n_modes}"
    )
    fits = map_taps(lambda tap: modes_of(tap, view.fs, n_modes, order), unit_taps(view))
    return np.array([m.frequency_hz for m in fits]), np.array([m.decay_per_s for m in fits])


@feature("tap", "Hz", "guruswamy2011, section IV-A, by the matrix pencil", outputs="f{n_modes}")
def tap_mode_frequency(view: TapView, *, n_modes: int = 2, order: int = ORDER) -> Samples:
    """Return the frequencies of the strongest decaying modes of a tap in ascending order.

    Each frequency is the median over taps. The modes are fitted to the first 64 samples after the contact, at
    a sampling rate of 2.8 to 5.6 kHz (or at fs if that is lower).

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.
    n_modes : int
        Number of modes (default 2), at most half the order. If a tap has fewer modes, they are repeated.
    order : int
        Number of poles of the fit (default 4).

    Returns
    -------
    ndarray of shape (n_modes,)
        Frequencies in Hz.

    Raises
    ------
    UndefinedFeatureError
        If there are no taps, or no tap has an impulse of at least two samples per pole.

    References
    ----------
    `guruswamy2011`, section IV-A, with the matrix pencil in place of Prony's method.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> tap_mode_frequency(x, fs=10_000, n_modes=1).round(-1).tolist()
    [300.0]
    """
    return median_over_taps(tap_modes(view, n_modes, order)[0])


@feature("tap", "log10(1/s)", "guruswamy2011, section IV-A, by the matrix pencil", outputs="b{n_modes}")
def tap_mode_decay(view: TapView, *, n_modes: int = 2, order: int = ORDER) -> Samples:
    """Return the decay rates log10 B of the strongest modes of a tap, as medians over taps.

    The modes are in ascending order of frequency.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.
    n_modes, order : int
        See `tap_mode_frequency`.

    Returns
    -------
    ndarray of shape (n_modes,)
        Decay rates in log10(1/s).

    Raises
    ------
    UndefinedFeatureError
        If `tap_mode_frequency` is undefined.

    References
    ----------
    `guruswamy2011`, section IV-A, with the matrix pencil in place of Prony's method.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):  # three taps that ring at 300 Hz
    ...     x += 20 * (t >= start) * np.exp(-100 * (t - start).clip(0)) * np.sin(1885 * (t - start))
    >>> tap_mode_decay(x, fs=10_000, n_modes=1).round(1).tolist()  # log10(100 per s)
    [2.0]
    """
    return median_over_taps(np.log10(tap_modes(view, n_modes, order)[1]))


@feature("tap", "log10(1/s)", "okamura2001, eq. 1 and section II-B")
def tap_amplitude_slope(view: TapView) -> float:
    """Return the amplitude of a tap per velocity of the hand at the contact, in log10.

    The slope A = sum v a / sum v^2 is a regression through the origin over the taps. Here a is the largest
    magnitude of a tap, and the velocity v is the magnitude of the integral of the hand acceleration before
    the contact.

    Parameters
    ----------
    view : TapView or array_like of shape (n,)
        Taps. For an array, also pass `fs` in Hz; the taps are located first.

    Returns
    -------
    float
        Slope in log10(1/s).

    Raises
    ------
    UndefinedFeatureError
        If fewer than three taps have a hand velocity and an impulse, or the velocities differ by less than a
        tenth of their mean. The slope can only be estimated from both slow and fast taps.

    References
    ----------
    `okamura2001`, eq. 1 and section II-B.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.features.phase_view import TapSignal
    >>> taps = [TapSignal(np.full(10, v), 50 * v * np.array([0.0, 1.0, -0.5])) for v in (1.0, 2.0, 3.0)]
    >>> round(tap_amplitude_slope(TapView(tuple(taps), fs=1000)), 2)  # velocity 10 v / fs
    3.7
    """

    def velocity_and_amplitude(tap: TapSignal) -> tuple[float, float]:
        v = abs(float(tap.hand.sum())) / view.fs
        undefined_if(
            v == 0 or not tap.impulse.any(),
            "the velocity of the hand or the impulse is 0. Expected a positive value for both",
        )
        return v, float(np.abs(tap.impulse).max())

    v, a = np.array(map_taps(velocity_and_amplitude, unit_taps(view))).T
    undefined_if(v.size < 3, f"{v.size} taps have a hand velocity. Expected at least 3 to estimate a slope")
    undefined_if(
        np.ptp(v) < 0.1 * v.mean(),
        f"hand velocities differ by {np.ptp(v) / v.mean():.2g} of their mean. Expected at least 0.1",
    )
    return float(np.log10(v @ a / (v @ v)))
