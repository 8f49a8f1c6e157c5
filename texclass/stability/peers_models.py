"""Public libraries that fit and render linear models, filter or average: their adapters, judged by our rules.

Each is called as its documentation says, with what a user would write.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy import linalg, ndimage, signal

from texclass.recording import Samples
from texclass.stability import exact, exact_models, rules
from texclass.stability.signals import (
    FORMS,
    VALUES,
    Case,
    beyond,
    in_families,
    lengths,
    samples_of,
    with_orders,
)
from texclass.stability.subjects_autoregression import (
    EXCITATION,
    derived_cases,
    k_of,
    unit_model,
)
from texclass.stability.subjects_features import cases as feature_cases
from texclass.stability.subjects_features import extraction
from texclass.stability.subjects_filters import SHORT
from texclass.stability.verdict import Check, Finding, Subject, Unchecked

BURG, AUTOCORRELATION = "Burg", "the autocorrelation method"
LARGEST = 400
"""Largest order the public libraries are asked for: beyond it some of them take minutes."""


def librosa() -> list[Subject]:
    """Return Burg's method, and the features users take from librosa."""
    import librosa as library

    def extract(x: Any, case: Case) -> tuple[dict[str, float], dict[str, str]]:
        spectral = library.feature
        rows = {
            "mfcc": spectral.mfcc(y=x, sr=case.fs, n_mfcc=13, n_fft=512, n_mels=20),
            "centroid": spectral.spectral_centroid(y=x, sr=case.fs, n_fft=512),
            "bandwidth": spectral.spectral_bandwidth(y=x, sr=case.fs, n_fft=512),
            "flatness": spectral.spectral_flatness(y=x, n_fft=512),
            "rolloff": spectral.spectral_rolloff(y=x, sr=case.fs, n_fft=512),
            "zero crossings": spectral.zero_crossing_rate(x),
            "rms": spectral.rms(y=x),
        }
        named = {f"{name} {i}": row.mean() for name, rows_ in rows.items() for i, row in enumerate(rows_)}
        return named, {}

    features = extraction("features (19 means)", "librosa", extract, "peers", given=feature_cases)
    return [_predictor("librosa", "lpc (Burg)", BURG, lambda x, p: library.lpc(x, order=p)), features]


def scipy() -> list[Subject]:
    """Return normal equations by `solve_toeplitz`, direct-form filters, moving averages."""

    def toeplitz(x: Any, p: int) -> Samples:
        samples = np.asarray(x, dtype=np.float64)
        r = np.array([samples[i:] @ samples[: max(samples.size - i, 0)] for i in range(p + 1)])
        return np.concatenate([[1.0], linalg.solve_toeplitz(r[:-1], -r[1:])])

    def averaged(x: Any, case: Case) -> Samples:
        return np.asarray(ndimage.uniform_filter1d(x, case.order, mode="nearest", output=np.float64))

    return [
        _predictor("scipy", "solve_toeplitz (LPC)", AUTOCORRELATION, toeplitz),
        Subject(
            "lfilter (all-pole synthesis)",
            "peers",
            "scipy",
            _synthesis_cases,
            _direct_form,
            _direct_form_checks,
        ),
        Subject(
            "butter + filtfilt, (b, a) form", "peers", "scipy", _short_cases, _filtfilt, _filtfilt_checks
        ),
        Subject("ndimage.uniform_filter1d", "peers", "scipy", _window_cases, averaged, _average_checks),
    ]


def spectrum() -> list[Subject]:
    """Return Burg, Yule-Walker, LPC, and line spectral frequencies."""
    import spectrum as library

    def lsf(k: Samples) -> tuple[Samples, Samples]:
        frequencies = np.asarray(library.poly2lsf(_step_up(k)), dtype=np.float64)
        return frequencies, np.asarray(library.lsf2poly(frequencies), dtype=np.float64)

    return [
        _predictor("spectrum", "arburg", BURG, lambda x, p: _one_first(library.arburg(x, p)[0])),
        _predictor("spectrum", "aryule", AUTOCORRELATION, lambda x, p: _one_first(library.aryule(x, p)[0])),
        _predictor("spectrum", "lpc", AUTOCORRELATION, lambda x, p: _one_first(library.lpc(x, p)[0])),
        _line_spectrum("spectrum", "poly2lsf, lsf2poly", lsf),
    ]


def statsmodels() -> list[Subject]:
    """Return Burg and Yule-Walker."""
    from statsmodels.regression import linear_model as library

    def burg(x: Any, p: int) -> Samples:
        return _one_first(-np.asarray(library.burg(x, order=p, demean=False)[0]))

    def yule_walker(x: Any, p: int) -> Samples:
        return _one_first(-np.asarray(library.yule_walker(x, order=p, method="mle", demean=False)[0]))

    return [
        _predictor("statsmodels", "burg", BURG, burg),
        _predictor("statsmodels", "yule_walker", AUTOCORRELATION, yule_walker),
    ]


def pysptk() -> list[Subject]:
    """Return LPC and line spectral pairs."""
    import pysptk as library

    def lpc(x: Any, p: int) -> Samples:
        return _one_first(np.asarray(library.lpc(np.ascontiguousarray(x, dtype=np.float64), p))[1:])

    def lsf(k: Samples) -> tuple[Samples, Samples]:
        pairs = library.lpc2lsp(_step_up(k), numsp=8192, maxiter=64, eps=1e-14)
        return np.asarray(pairs[1:]), np.concatenate([[1.0], np.asarray(library.lsp2lpc(pairs))[1:]])

    return [
        _predictor("pysptk", "lpc", AUTOCORRELATION, lpc),
        _line_spectrum("pysptk", "lpc2lsp, lsp2lpc", lsf),
    ]


# Linear prediction ------------------------------------------------------------------------------------------


def _one_first(a: Any) -> Samples:
    return np.concatenate([[1.0], np.asarray(a, dtype=np.float64).reshape(-1)])


def _step_up(k: Samples) -> Samples:
    """Return direct-form coefficients in float64, as every library that needs them computes them."""
    a = np.ones(1)
    for k_m in k:
        a = np.append(a, 0.0) + k_m * np.append(a, 0.0)[::-1]
    return a


def _predictor(library: str, name: str, method: str, fit: Callable[[Any, int], Any]) -> Subject:
    def cases(quick: bool) -> tuple[Case, ...]:
        chosen = in_families(*VALUES, *FORMS, quick=quick)
        orders = with_orders((*chosen, *lengths(quick)), quick, 18 if quick else LARGEST)
        return tuple(case for case in (*orders, *beyond(quick)) if case.order <= LARGEST)

    def run(x: Any, case: Case) -> Samples:
        return np.asarray(fit(x, case.order))

    def checks(x: Any, case: Case, a: Any) -> Iterator[Finding]:
        coefficients = np.asarray(a, dtype=np.float64)
        yield Check("p + 1 coefficients", abs(coefficients.size - case.order - 1), 0.0)
        if case.order > 128:  # 60 digits would take minutes for all inputs: finite, and the residual
            yield rules.finite("coefficients", coefficients)
        else:
            yield from rules.stable_coefficients(coefficients)
        signal = samples_of(x)
        if np.any(signal) and signal.size > case.order and exact.EXTENDED:
            above = rules.excess(signal, case.order, method, a=coefficients)
            limit = rules.EXCESS_SINGLE if x.dtype in (np.float32, np.float16) else rules.EXCESS
            yield Check(f"residual energy above {method}'s optimum", above, limit)

    return Subject(name, "peers", library, cases, run, checks)


def _line_spectrum(library: str, name: str, convert: Callable[[Samples], tuple[Samples, Samples]]) -> Subject:
    def cases(quick: bool) -> tuple[Case, ...]:
        return derived_cases(quick, 18 if quick else LARGEST)

    def run(x: Any, case: Case) -> tuple[Samples, Samples]:
        return convert(k_of(x, case))

    def checks(x: Any, case: Case, result: tuple[Samples, Samples]) -> Iterator[Finding]:
        lsf, a = result
        back = None
        if a.size == case.order + 1 and np.all(np.isfinite(a)):
            if not exact.available():
                yield Unchecked(exact.MISSING)
                return
            back = exact_models.step_down(a)
        yield from rules.line_spectrum(k_of(x, case), lsf, back)

    return Subject(name, "peers", library, cases, run, checks)


# Filters ----------------------------------------------------------------------------------------------------


def _synthesis_cases(quick: bool) -> tuple[Case, ...]:
    return derived_cases(quick, 18 if quick else LARGEST)


def _direct_form(x: Any, case: Case) -> Samples:
    return np.asarray(signal.lfilter([1.0], _step_up(k_of(x, case)), EXCITATION))


def _direct_form_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    if case.order <= 50:
        yield from rules.response("synthesis", out, k_of(x, case), 1.0, EXCITATION)
        return
    yield rules.finite("synthesis", out)
    level = float(unit_model(k_of(x, case)).level)
    if np.isfinite(level):
        bound = level * float(np.linalg.norm(EXCITATION))
        yield Check("output over its bound", float(np.max(np.abs(out))) / bound, 1.0)


def _short_cases(quick: bool) -> tuple[Case, ...]:
    return (*in_families(*VALUES, *FORMS, quick=quick), *lengths(True))


def _filtfilt(x: Any, case: Case) -> Samples:
    return np.asarray(signal.filtfilt(*signal.butter(4, (50.0, 200.0), "bandpass", fs=case.fs), x[:SHORT]))


def _filtfilt_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    """Compare with the same Butterworth band-pass in sections, in 60 digits."""
    samples = samples_of(x[:SHORT])
    yield rules.finite("output", out)
    if exact.available():
        sos = signal.butter(4, (50.0, 200.0), "bandpass", fs=case.fs, output="sos")
        right = exact_models.zero_phase(sos, samples, 27)
        scale = float(np.max(np.abs(samples)))
        yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=scale)
    else:
        yield Unchecked(exact.MISSING)


def _window_cases(quick: bool) -> tuple[Case, ...]:
    few = in_families(*VALUES, *FORMS, quick=quick)
    return tuple(case.at_order(n) for case in few for n in (3, 101))


def _average_checks(x: Any, case: Case, out: Samples) -> Iterator[Finding]:
    """Compare inside the signal, where no rule for the ends matters."""
    samples, half = samples_of(x), case.order // 2
    right = exact.moving_average(samples, case.order)[half:-half]
    scale = float(np.max(np.abs(samples)))
    yield rules.finite("output", out)
    yield rules.close("means, against exact sums", out[half:-half], right, 1e-13, scale=scale)
