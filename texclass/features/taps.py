"""How a tap rings: what texclass adds to hardness and damping, computable at any (even a nominal) rate."""

import numpy as np
from scipy import fft

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.hardness import per_tap, tap_level
from texclass.features.view import TapSignal, TapView, transform
from texclass.recording import Samples

SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
SHARE_NAMES = tuple(f"q{100 * share:.0f}" for share in SHARES)


@transform
def tap_spectra(view: TapView) -> tuple[tuple[Samples, Samples], ...]:
    """Return frequency (Hz) and power of impact and decay of each tap, zero-padded to twice its length."""

    def spectrum_of(tap: TapSignal) -> tuple[Samples, Samples]:
        n_fft = 2 * fft.next_fast_len(max(_energetic(tap).size, 32), real=True)
        spectrum = fft.rfft(tap.impulse, n_fft)
        power: Samples = np.asarray(spectrum.real**2 + spectrum.imag**2, dtype=np.float64)
        return np.linspace(0, view.fs / 2, n_fft // 2 + 1), power

    return tuple(per_tap(view, spectrum_of))


def _energetic(tap: TapSignal) -> Samples:
    """Impact and decay; refused if silent or too short."""
    if tap.impulse.size < 8:
        raise UndefinedFeatureError(f"{tap.impulse.size} samples after the contact; the rule is at least 8")
    if not np.any(tap.impulse):
        raise UndefinedFeatureError("silence: the tap has no impulse")
    return tap.impulse


def _quantiles(x: Samples, density: Samples) -> Samples:
    """Return where the running sum of `density` over `x` reaches each of `SHARES`."""
    running = np.cumsum(density)
    return np.interp(SHARES, running / running[-1], x)


@feature(phase="tap", unit="Hz", reference="strese2015, eq. 2, corrected")
def damping(view: TapView) -> float:
    """Spectral centroid of impact and decay in Hz over the full band; median over taps.

    sum f P(f) / sum P(f); inverse to damping. In cycles per sample where the rate is nominally 1 Hz.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    return float(np.median([float(f @ power) / float(power.sum()) for f, power in tap_spectra(view)]))


@feature(phase="tap", unit="Hz", reference="texclass, after strese2015, eq. 2", outputs=SHARE_NAMES)
def tap_band(view: TapView) -> Samples:
    """Frequencies below which 10, 25, 50, 75 and 90 % of a tap's energy lie; median over taps.

    Returns
    -------
    ndarray of shape (5,)

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    return np.asarray(np.median([_quantiles(f, power) for f, power in tap_spectra(view)], axis=0))


@feature(phase="tap", unit="s", reference="texclass, after strese2015, Fig. 7", outputs=SHARE_NAMES)
def tap_course(view: TapView) -> Samples:
    """Course of a tap: times after the contact by which 10 ... 90 % of its energy has come; median over taps.

    The last is the duration of the contact as far as it is felt.

    Returns
    -------
    ndarray of shape (5,)

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """

    def course_of(tap: TapSignal) -> Samples:
        i = _energetic(tap)
        return _quantiles(np.arange(1, i.size + 1) / view.fs, i**2)

    return np.asarray(np.median(per_tap(view, course_of), axis=0))


@feature(phase="tap", unit="1/s", reference="texclass, after okamura2001")
def tap_decay_rate(view: TapView) -> float:
    """Decay rate b of the envelope exp(-b t) of a tap; median over taps.

    Half the slope of the logarithm of the energy still to come (Schroeder's backward integral), fitted from
    where 90 % to where 5 % are left: one number even for a tap that bounces.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none that decays over 3 samples or more.
    """

    def rate_of(tap: TapSignal) -> float:
        i = _energetic(tap)
        left = np.cumsum(i[::-1] ** 2)[::-1]
        left = left / left[0]
        span = np.flatnonzero((left <= 0.9) & (left >= 0.05))
        if span.size < 3:
            raise UndefinedFeatureError(f"the tap decays within {span.size} samples; the rule is at least 3")
        t = (span - span.mean()) / view.fs
        return -float(t @ np.log(left[span])) / (2 * float(t @ t))

    return float(np.median(per_tap(view, rate_of)))


@feature(phase="tap", unit="log10(m/s^2)", reference="texclass", gain=Gain(shift=1))
def tap_strength(view: TapView) -> float:
    """Strength of a tap, log10 max|i|; median over taps.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """
    peaks = per_tap(view, lambda tap: float(np.log10(np.abs(_energetic(tap)).max())))
    return float(np.median(peaks) + np.log10(tap_level(view)))


@feature(phase="tap", unit="1", reference="texclass")
def tap_crest(view: TapView) -> float:
    """Crest factor of a tap, max|i| over the root mean square of impact and decay; median over taps.

    Raises
    ------
    UndefinedFeatureError
        If there is no tap, or none with an impulse of 8 samples or more.
    """

    def crest_of(tap: TapSignal) -> float:
        i = _energetic(tap)
        return float(np.abs(i).max() / np.sqrt(np.mean(i**2)))

    return float(np.median(per_tap(view, crest_of)))
