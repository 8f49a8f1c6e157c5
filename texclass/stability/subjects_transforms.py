"""Subjects: the transforms of texclass, those of `signals` and those that features share."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import fft
from scipy.signal import get_window

from texclass import signals
from texclass.features import filtered, frames, transforms
from texclass.features.view import PhaseView
from texclass.recording import Samples
from texclass.stability import exact, rules
from texclass.stability.signals import FORMS, VALUES, Case, in_families, lengths, noise, rates, samples_of
from texclass.stability.verdict import Check, Finding, Subject

WINDOWS = (1, 2, 3, 100, 5000)
LONG = 5_000_000
SINGLE = 5e-6
"""Error of what is computed in single precision, over its largest value."""


def subjects() -> list[Subject]:
    """Return the conditioning of signals and the shared transforms of a movement."""
    return [
        _subject("dft321", _signals, _dft321, _dft321_checks),
        _subject("moving_average", _windows, _average, _average_checks),
        _subject("remove_hand_motion", _signals, _hand, _hand_checks),
        _subject("rms", _long_too, lambda x, case: signals.rms(x), _rms_checks),
        _subject("frame", _signals, lambda x, case: signals.frame(x, 64, 16), _frame_checks),
        _shared("spectrum", transforms.spectrum, _right_spectrum),
        _shared("low_spectrum", transforms.low_spectrum, _right_low_spectrum),
        _shared("autocorrelation", transforms.autocorrelation, _right_autocorrelation),
        _shared("spectral_changes (DCT)", lambda v: frames.spectral_changes(v, 256, 64), _right_changes),
        _shared("power_frames", _power, _right_power),
        _shared("mean_spectrum", lambda v: transforms.mean_spectrum(v)[1], _right_mean_spectrum),
        _shared("high_passed", lambda v: filtered.high_passed(v, _cutoff(v)), None),
        _shared("low_passed", lambda v: filtered.low_passed(v, _cutoff(v)).samples, None),
        _shared("band_passed", lambda v: filtered.band_passed(v, _cutoff(v), 2 * _cutoff(v), v.fs), None),
        _shared("details", _details, None),
    ]


def _subject(name: str, cases: Any, run: Any, checks: Any) -> Subject:
    return Subject(name, "transforms", "texclass", cases, run, checks)


def _signals(quick: bool) -> tuple[Case, ...]:
    return (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick), *rates(quick))


def _windows(quick: bool) -> tuple[Case, ...]:
    few = [case for case in _signals(quick) if case.family != "rate"]
    wide = [case for case in few if case.family != "length"]
    every = [case.at_order(n) for case in wide for n in WINDOWS]
    return (*every, *(case.at_order(100) for case in few if case.family == "length"))


def _long_too(quick: bool) -> tuple[Case, ...]:
    if quick:
        return _signals(quick)
    long = Case(f"{LONG:.0e} samples", "stream", lambda: 1e3 + noise(LONG, 9))
    return (*_signals(quick), long)


# Conditioning -----------------------------------------------------------------------------------------------


def _axes(x: Any) -> Any:
    """Return three axes made of one signal, of its dtype."""
    return np.stack([x, x[::-1], np.roll(x, 3)], axis=1)


def _dft321(x: Any, case: Case) -> Samples:
    return signals.dft321(_axes(x))


def _dft321_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    """Check that the energy of each bin is that of all axes together, in 80-bit floats."""
    axes = samples_of(_axes(x))
    yield rules.finite("output", out)
    scale = float(np.max(np.abs(axes)))
    if scale == 0 or np.ptp(axes, axis=0).max() == 0:
        yield Check("output for constants, over them", float(np.max(np.abs(out))) / (scale or 1.0), 1e-15)
        return
    wide = (axes / scale).astype(np.longdouble)
    wide -= wide.mean(axis=0)
    energy = np.sum(np.abs(fft.rfft(wide, axis=0)) ** 2, axis=1)
    energy[0] = 0
    given = np.abs(fft.rfft((out / scale).astype(np.longdouble)))
    right, given = np.sqrt(energy).astype(np.float64), given.astype(np.float64)
    if out.size % 2 == 0 and energy.size > 1:  # at fs/2 a real signal has a sign for a phase
        right, given = right[:-1], given[:-1]
    yield rules.close("magnitude of each bin", given, right, 1e-12, scale=1e-3 * axes.shape[0] ** 0.5)


def _average(x: Any, case: Case) -> Samples:
    return signals.moving_average(x, case.order)


def _average_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    right = exact.moving_average(samples_of(x), case.order)
    scale = float(np.max(np.abs(samples_of(x))))
    yield rules.finite("output", out)
    yield rules.close("means, against exact sums", out, right, 1e-15 * 4, scale=scale)


def _hand(x: Any, case: Case) -> Samples:
    return signals.remove_hand_motion(x, case.fs)


def _hand_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    signal = samples_of(x)
    window = max(2 * round(signals.HAND_SPAN_S * case.fs / 2) + 1, 3)
    right = signal - exact.moving_average(signal, window)
    yield rules.finite("output", out)
    yield rules.close(
        "output, against exact sums", out, right, 1e-15 * 4, scale=float(np.max(np.abs(signal)))
    )


def _rms_checks(x: Any, case: Case, value: float) -> Iterator[Finding]:
    yield rules.finite("rms", value)
    yield rules.close("rms, against exact sums", value, exact.root(exact.mean_square(samples_of(x))), 1e-14)


def _frame_checks(x: Any, case: Case, frames: Samples) -> Iterator[Finding]:
    signal = samples_of(x)
    rows = 1 + (signal.size - 64) // 16
    right = np.stack([signal[16 * i : 16 * i + 64] for i in range(rows)])
    same = frames.shape == right.shape and np.array_equal(frames, right, equal_nan=True)
    yield Check("the samples themselves", 0.0 if same else np.inf, 0.0)
    yield Check("a view that can be written to", float(frames.flags.writeable), 0.0)


# Shared by features -----------------------------------------------------------------------------------------


def _shared(name: str, transform: Any, right: Any) -> Subject:
    """Return a transform of a movement: against 80-bit floats where `right` gives them, else by its gain."""

    def run(x: Any, case: Case) -> Samples:
        return np.asarray(transform(_view(x, case)))

    def checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
        yield rules.finite("output", np.abs(out))
        signal = samples_of(x)
        if right is not None:
            unit = signal / np.max(np.abs(signal))
            expected = right(unit.astype(np.longdouble), case)
            yield rules.close(
                "in 80-bit floats", np.abs(out), np.abs(expected).astype(np.float64), SINGLE, scale=1e-6
            )
        unit = np.ldexp(signal, -int(np.frexp(np.max(np.abs(signal)))[1]))
        other = np.asarray(transform(PhaseView(unit * 1.1, case.fs)))
        scale = 1e-3 if name == "band_passed" else 1e-2  # of the movement, whose largest magnitude is 1
        yield rules.close("free of gain", np.abs(other), np.abs(out), 1e-5, scale=scale)

    return _subject(f"shared, {name}", _signals, run, checks)


def _view(x: Any, case: Case) -> PhaseView:
    return PhaseView(np.asarray(x, dtype=np.float64), case.fs)


def _cutoff(view: PhaseView) -> float:
    return min(100.0, 0.1 * view.fs)


def _details(view: PhaseView) -> Samples:
    return np.concatenate(filtered.details(view, _cutoff(view), "coif3", 3))


def _power(view: PhaseView) -> Samples:
    return np.asarray(frames.power_frames(view, 128 / view.fs, 64 / view.fs, "hann").power)


def _right_spectrum(x: Any, case: Case) -> Any:
    n = transforms.FINEST * fft.next_fast_len(-(-x.size // transforms.FINEST))
    return fft.rfft(x, n)


def _right_low_spectrum(x: Any, case: Case) -> Any:
    spectrum = _right_spectrum(x, case)
    return spectrum[: (spectrum.size + 1) // 2]


def _right_autocorrelation(x: Any, case: Case) -> Any:
    spectrum = fft.rfft(x, 2 * x.size)
    return fft.irfft(spectrum.real**2 + spectrum.imag**2)[: x.size]


def _right_changes(x: Any, case: Case) -> Any:
    starts = range(0, x.size - 256 + 1, 64)
    frames = np.stack([x[i : i + 256] for i in starts])
    change = np.diff(np.abs(fft.dct(frames, axis=1, norm="ortho")), axis=0)
    return np.mean(change**2, axis=1)


def _right_power(x: Any, case: Case) -> Any:
    w = get_window("hann", 128).astype(np.longdouble)
    frames = np.stack([x[i : i + 128] for i in range(0, x.size - 128 + 1, 64)])
    power = np.abs(fft.rfft(frames * w, axis=1)) ** 2 * 2 / (case.fs * (w @ w))
    power[:, 0] /= 2
    power[:, -1] /= 2
    return power


def _right_mean_spectrum(x: Any, case: Case) -> Any:
    spectrum = _right_spectrum(x, case)
    step = case.fs / (2 * (spectrum.size - 1))
    width = max(1.0, step)
    n_bins = int(min(transforms.BAND_HZ, case.fs / 2) / width)
    edges = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(int)
    power = np.abs(spectrum) ** 2
    means = [power[i:j].mean() for i, j in pairwise(edges)]
    return np.array(means) * 2 / (case.fs * x.size)
