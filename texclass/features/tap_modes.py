"""Taps as decaying modes: what rings, how long, and how strongly for a given velocity of the hand."""

import functools

import numpy as np

from texclass.features.contract import feature
from texclass.features.hardness import median_over_taps, per_tap, unit_taps
from texclass.features.phase_view import TapSignal, TapView, transform, undefined_if
from texclass.recording import Samples
from texclass.vibration.decaying_modes import DecayingModes, fit_matrix_pencil

ORDER = 4
"""Poles of a tap: two modes.

Of 4, 8, 12 and the rank of the noise, with LDA: best beside the other features of taps on left-out operators
of `simulated69`, and on `taps5` (3 recordings of each plate train). More poles only spread what a tap says.
"""
TAP_RATE = 2800.0
"""Least rate in Hz that a tap is decimated to: twice the band of the sensor of strese2015."""


@functools.lru_cache(maxsize=32)
def _low_pass(q: int) -> Samples:
    """Return a low-pass of 4 q + 1 taps to a q-th of the band: a sinc under a Hamming window, 1 at 0 Hz."""
    h = np.sinc(np.arange(-2 * q, 2 * q + 1) / q) * np.hamming(4 * q + 1)
    return np.asarray(h / h.sum())


def decimated(x: Samples, fs: float) -> tuple[Samples, float]:
    """Return a tap at the lowest rate of `TAP_RATE` or more that is a whole part of its own.

    A symmetric FIR low-pass is applied, and only outputs that it computes from samples after the contact are
    kept: filtered that way a decaying mode is the same mode with another amplitude.
    """
    q = int(fs // TAP_RATE)
    if q < 2:
        return x, fs
    h = _low_pass(q)
    return np.asarray(np.convolve(x, h, "valid")[::q] if x.size >= h.size else x[:0]), fs / q


def modes_of(tap: TapSignal, fs: float, n_modes: int, order: int) -> DecayingModes:
    """Return the strongest modes of impact and decay by rising frequency; one that is alone is given again.

    Raises
    ------
    UndefinedFeatureError
        If the tap is silent, or shorter than the fit needs.
    """
    x, rate = decimated(tap.impulse, fs)
    x = x[:64]  # 23 ms at most, after decimation at known rates
    undefined_if(
        x.size < max(2 * order, 8),
        f"{x.size} samples of a tap. Expected at least {max(2 * order, 8)} at {rate:g} Hz",
    )
    found = fit_matrix_pencil(x, rate, order=order)
    undefined_if(found.n_modes == 0, "silence: the tap has no impulse")
    rank = np.resize(np.arange(min(n_modes, found.n_modes)), n_modes)
    rank = rank[np.argsort(found.frequency_hz[rank], kind="stable")]
    return DecayingModes(*found.table[rank].T)


@transform
def tap_modes(view: TapView, n_modes: int, order: int) -> tuple[Samples, Samples]:
    """Return frequencies (Hz) and decay rates (1/s) of the strongest modes of each tap, (n_taps, n_modes)."""
    undefined_if(
        not 1 <= n_modes <= order // 2, f"{n_modes} modes of order {order}. Expected 1 ... half the order"
    )
    fits = per_tap(unit_taps(view), lambda tap: modes_of(tap, view.fs, n_modes, order))
    return np.array([m.frequency_hz for m in fits]), np.array([m.decay_per_s for m in fits])


@feature("tap", "Hz", "guruswamy2011, section IV-A, by the matrix pencil", outputs="f{n_modes}")
def tap_mode_frequency(view: TapView, *, n_modes: int = 2, order: int = ORDER) -> Samples:
    """Frequencies of the strongest decaying modes of a tap, rising; median over taps.

    Fitted to the first 64 samples after the contact, at 2.8 to 5.6 kHz (its own rate, if that is lower).

    Parameters
    ----------
    view : TapView
        Taps.
    n_modes : int
        How many, at most half the order. A tap that has only one gives it for each.
    order : int
        Number of poles of the fit.

    Returns
    -------
    ndarray of shape (n_modes,)

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of two samples per pole.
    """
    return median_over_taps(tap_modes(view, n_modes, order)[0])


@feature("tap", "log10(1/s)", "guruswamy2011, section IV-A, by the matrix pencil", outputs="b{n_modes}")
def tap_mode_decay(view: TapView, *, n_modes: int = 2, order: int = ORDER) -> Samples:
    """Decay rates log10 B of the strongest decaying modes of a tap, by rising frequency; median over taps.

    Parameters
    ----------
    view : TapView
        Taps.
    n_modes, order
        As in `tap_mode_frequency`.

    Returns
    -------
    ndarray of shape (n_modes,)

    Raises
    ------
    UndefinedFeatureError
        As `tap_mode_frequency`.
    """
    return median_over_taps(np.log10(tap_modes(view, n_modes, order)[1]))


@feature("tap", "log10(1/s)", "okamura2001, eq. 1 and section II-B")
def tap_amplitude_slope(view: TapView) -> float:
    """Amplitude of a tap per velocity of the hand at the contact, log10 of the slope over the taps.

    A = sum v a / sum v^2, the regression through the origin of the largest magnitudes a on the velocities
    v = |integral of the hand's acceleration before the contact|.

    Parameters
    ----------
    view : TapView
        Taps.

    Raises
    ------
    UndefinedFeatureError
        If there are fewer than three taps with a moving hand and an impulse, or their velocities differ by
        less than a tenth of their mean: a slope needs slow and fast ones.
    """

    def velocity_and_amplitude(tap: TapSignal) -> tuple[float, float]:
        v = abs(float(tap.hand.sum())) / view.fs
        undefined_if(
            v == 0 or not tap.impulse.any(),
            "the hand's velocity or the impulse is 0. Expected a positive number",
        )
        return v, float(np.abs(tap.impulse).max())

    v, a = np.array(per_tap(unit_taps(view), velocity_and_amplitude)).T
    undefined_if(v.size < 3, f"{v.size} taps with a velocity. Expected at least 3 for a slope")
    undefined_if(
        np.ptp(v) < 0.1 * v.mean(),
        f"the velocities differ by {np.ptp(v) / v.mean():.2g} of their mean. Expected at least 0.1",
    )
    return float(np.log10(v @ a / (v @ v)))
