"""Subjects: the filters of texclass, and what comes in a stream of 10^8 samples."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from texclass import filters
from texclass.recording import Samples
from texclass.stability import exact, exact_models, rules
from texclass.stability.signals import (
    FORMS,
    RATES_HZ,
    VALUES,
    Case,
    in_families,
    lengths,
    noise,
    rates,
    samples_of,
)
from texclass.stability.verdict import Check, Finding, Subject, Unchecked
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis

SHORT = 400
"""Samples that are filtered: as many as 60-digit arithmetic does in reasonable time."""
BLOCK = 1_000_000
FULL_STREAM, QUICK_STREAM = 100_000_000, 2_000_000
BANDS: dict[str, float | tuple[float, float]] = {
    "lowpass": 100.0,
    "highpass": 20.0,
    "bandpass": (50.0, 200.0),
}


def subjects() -> list[Subject]:
    """Return the designs, the filters forwards, both ways and FIR, and the streams."""
    both_ways = [_zero_phase_subject(kind) for kind in BANDS]
    return [
        _subject("butterworth", _designs, _design, _design_checks),
        *both_ways,
        _subject("causal", _signals, _causal, _causal_checks),
        _subject("highpass_fir", _signals, _fir, _fir_checks),
        _subject("stream: causal", _streams, _stream_causal, _stream_checks),
        _subject("stream: lattice synthesis, p = 18", _streams, _stream_lattice, _stream_checks),
        _subject("stream: lattice inverse, p = 18", _streams, _stream_inverse, _stream_checks),
    ]


def _subject(name: str, cases: Any, run: Any, checks: Any) -> Subject:
    return Subject(name, "filters", "texclass", cases, run, checks)


def _signals(quick: bool) -> tuple[Case, ...]:
    return (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick), *rates(quick))


# Designs ----------------------------------------------------------------------------------------------------


def _designs(quick: bool) -> tuple[Case, ...]:
    """Return cut-offs from 1e-5 to 0.4999 of fs, orders 1 to 16, and parameters that must be refused."""
    shares = (1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.4, 0.4999)
    cases = [
        Case(f"{kind} at {share:g} fs, fs = {fs:g} Hz, order {order}", "rate", _given(share, kind), fs, order)
        for fs in (RATES_HZ[0], RATES_HZ[-1])
        for kind in ("lowpass", "highpass")
        for share in (shares[::3] if quick else shares)
        for order in ((2, 8) if quick else (1, 2, 4, 8, 16))
    ]
    bad = [0.0, -0.1, 0.5, 0.7, np.nan, np.inf]
    cases += [Case(f"cut-off {share:g} fs", "broken", _given(share, "lowpass"), order=4) for share in bad]
    cases += [Case(f"order {order}", "broken", _given(0.1, "lowpass"), order=order) for order in (0, -1)]
    broken_rates = (np.nan, np.inf, 0.0, -1.0)
    return (*cases, *(Case(f"fs {fs:g}", "broken", _given(0.1, "lowpass"), fs, 4) for fs in broken_rates))


def _given(share: float, kind: str) -> Any:
    return lambda: np.array([share, float(kind == "highpass")])


def _design(x: Samples, case: Case) -> Samples:
    kind: Any = "highpass" if x[1] else "lowpass"
    return filters.butterworth(kind, float(x[0] * case.fs), case.fs, order=case.order)


def _design_checks(x: Samples, case: Case, sos: Samples) -> Iterator[Finding]:
    """Check that it is stable, and has the closed form of the Butterworth response around the cut-off."""
    yield rules.finite("sections", sos)
    stable = (np.abs(sos[:, 5]) < 1) & (np.abs(sos[:, 4]) < 1 + sos[:, 5])
    yield Check("sections that are not stable", float(np.sum(~stable)), 0.0)
    if not exact.available():
        yield Unchecked(exact.MISSING)
        return
    f = np.array([0.5, 0.9, 1.0, 1.1, 2.0]) * x[0] * case.fs
    f = f[f < case.fs / 2]
    kind = "highpass" if x[1] else "lowpass"
    right = exact_models.butterworth_gain(kind, (float(x[0] * case.fs),), case.fs, case.order, f)
    given = exact_models.sections_gain(sos, f / case.fs)
    # a pole 2 pi share from z = 1 is rounded by 1e-16: in second-order sections, squared
    limit = 1e-12 + 1e-15 * case.order / min(float(x[0]), 0.5 - float(x[0])) ** 2
    yield rules.close("response, against 60 digits", given, right, limit)


# Filters ----------------------------------------------------------------------------------------------------


def sections_of(kind: Any, fs: float) -> Samples:
    """Return the filter of a kind that is tried, its band moved down where fs is low."""
    scale = min(1.0, fs / 1000)
    band = BANDS[kind]
    cut = band * scale if isinstance(band, float) else (band[0] * scale, band[1] * scale)
    return filters.butterworth(kind, cut, fs)


def _referenced(case: Case) -> bool:
    """Whether 60 digits are spent on a case: of the lengths on all up to 40, then on every twentieth."""
    n = len(case.signal())
    return case.family != "length" or n <= 40 or n % 20 == 0


def _zero_phase_subject(kind: Any) -> Subject:
    def run(x: Any, case: Case) -> Samples:
        return filters.zero_phase(sections_of(kind, case.fs), x[:SHORT])

    def checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
        signal = samples_of(x[:SHORT])
        yield rules.finite("output", out)
        sos = sections_of(kind, case.fs)
        padding = min(3 * (2 * len(sos) + 1), signal.size - 1)
        if not _referenced(case):
            return
        if exact.available():
            right = exact_models.zero_phase(sos, signal, padding)
            scale = float(np.max(np.abs(signal)))
            yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=scale)
        else:
            yield Unchecked(exact.MISSING)

    return _subject(f"zero phase, {kind}", _signals, run, checks)


def _causal(x: Any, case: Case) -> tuple[Samples, Samples]:
    sos = sections_of("bandpass", case.fs)
    whole, _ = filters.causal(sos, x[:SHORT])
    first, state = filters.causal(sos, x[: min(7, SHORT)])
    none, state = filters.causal(sos, x[:0], state)
    rest, _ = filters.causal(sos, x[7:SHORT], state)
    return whole, np.concatenate([first, none, rest])


def _causal_checks(x: Any, case: Case, out: tuple[Samples, Samples]) -> Iterator[Finding]:
    signal = samples_of(x[:SHORT])
    yield rules.finite("output", out[0])
    yield rules.close("pieces = whole", out[1], out[0], 0.0)
    if signal.size == 0 or not _referenced(case):
        return
    if exact.available():
        right = exact_models.causal(sections_of("bandpass", case.fs), signal)
        scale = float(np.max(np.abs(signal)))
        yield rules.close("output, against 60 digits", out[0], right, rules.RESPONSE, scale=scale)
    else:
        yield Unchecked(exact.MISSING)


def _fir(x: Any, case: Case) -> Samples:
    return filters.highpass_fir(x[:SHORT], 0.01 * case.fs, case.fs)


def _fir_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    """Compare with the same filter in 80-bit floats, on the signal continued by hand."""
    signal = samples_of(x[:SHORT])
    yield rules.finite("output", out)
    half = int(np.ceil(3.3 * case.fs / (0.01 * case.fs) / 2))
    mirrored = min(half, signal.size - 1)
    before = 2 * signal[0] - signal[1 : mirrored + 1][::-1]
    after = 2 * signal[-1] - signal[-mirrored - 1 : -1][::-1]
    ends = [np.full(half - mirrored, (before if mirrored else signal)[0])]
    tail = [np.full(half - mirrored, (after if mirrored else signal)[-1])]
    wide = np.concatenate([*ends, before, signal, after, *tail]).astype(np.longdouble)
    n = np.arange(-half, half + 1, dtype=np.longdouble)
    smooth = np.sinc(0.02 * n) * (0.54 + 0.46 * np.cos(np.pi * n / half))
    right = signal - np.convolve(wide, smooth / smooth.sum(), "valid")
    scale = float(np.max(np.abs(signal)))
    yield rules.close("output, in 80-bit floats", out, right.astype(np.float64), 1e-9, scale=scale)


# Streams ----------------------------------------------------------------------------------------------------


def _streams(quick: bool) -> tuple[Case, ...]:
    n = QUICK_STREAM if quick else FULL_STREAM
    return (Case(f"{n:.0e} samples in a stream", "stream", lambda: noise(BLOCK, 8), order=n),)


def _stream_causal(x: Samples, case: Case) -> list[tuple[float, float]]:
    """Filter noise, block after block, and at the end the same block that a fresh filter is given."""
    sos, state, out = sections_of("bandpass", case.fs), None, x
    for _ in range(case.order // BLOCK):
        out, state = filters.causal(sos, x, state)
    fresh, _ = filters.causal(sos, x)
    tail = slice(BLOCK // 2, None)  # by then a filter that started differently has forgotten it
    return [_compared(out[tail], fresh[tail])]


STREAM_MODEL = Autoregression(np.linspace(0.9, -0.5, 18), np.asarray(1.0))


def _stream_lattice(x: Samples, case: Case) -> list[tuple[float, float]]:
    lattice, out = LatticeSynthesis(STREAM_MODEL), x
    for _ in range(case.order // BLOCK):
        out = np.asarray(lattice.process(x))
    fresh = LatticeSynthesis(STREAM_MODEL).process(x)
    tail = slice(BLOCK // 2, None)
    return [_compared(out[tail], fresh[tail])]


def _stream_inverse(x: Samples, case: Case) -> list[tuple[float, float]]:
    lattice, inverse, back = LatticeSynthesis(STREAM_MODEL), LatticeInverse(STREAM_MODEL), x
    for _ in range(case.order // BLOCK):
        back = np.asarray(inverse.process(lattice.process(x)))
    return [_compared(back, x)]


def _compared(out: Any, right: Any) -> tuple[float, float]:
    return float(np.max(np.abs(out - right))), float(np.max(np.abs(right)))


def _stream_checks(x: Samples, case: Case, results: list[tuple[float, float]]) -> Iterator[Finding]:
    """Check that nothing drifts: the last block is what a fresh start makes of it."""
    for difference, size in results:
        yield Check("the last block, against a fresh start", difference / size, 1e-9)
