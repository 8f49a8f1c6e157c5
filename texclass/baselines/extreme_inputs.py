"""Adapters that test public libraries with extreme inputs, applying the same checks as to texclass.

Each adapter calls a library as its documentation recommends.
"""

import importlib.util
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy import linalg, ndimage, signal

from texclass.recording import Samples
from texclass.stability import checks, references
from texclass.stability.checks import Check, Findings, Subject, largest
from texclass.stability.inputs import FORMS, VALUES, Case, cases_of, lengths, to_float64
from texclass.stability.subjects_features import cases as feature_cases
from texclass.stability.subjects_features import library_trial
from texclass.stability.subjects_models import (
    EXCITATION,
    case_reflection,
    model_cases,
    signals_at_orders,
    unit_model,
)
from texclass.stability.subjects_signals import SHORT

LIBRARIES = ("librosa", "scipy", "spectrum", "statsmodels", "pysptk", "tsfel", "tsfresh", "pycatch22")
"""Public libraries to test if they are installed."""
CORE = ("librosa", "scipy")
"""Dependencies of texclass. A quick run tests only these, because importing other libraries takes seconds."""
BURG, AUTOCORRELATION = "Burg", "the autocorrelation method"
MAX_ORDER = 400
"""Largest order passed to public libraries. At higher orders, some of them take minutes."""


def installed(quick: bool = False) -> tuple[dict[str, str], list[str]]:
    """Return the import path of the subjects of each library, and the untested libraries with reasons."""
    skipped = {name: "not installed" for name in LIBRARIES if importlib.util.find_spec(name) is None}
    if quick:
        skipped |= {name: "not in a quick run" for name in LIBRARIES if name not in {*CORE, *skipped}}
    places = {name: f"{__name__}:{name}" for name in LIBRARIES if name not in skipped}
    return places, [f"{name}: {why}" for name, why in skipped.items()]


# Linear prediction ------------------------------------------------------------------------------------------


def spectrum() -> list[Subject]:
    """Return the tested functions of spectrum: Burg, Yule-Walker, LPC and line spectral frequencies."""
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
    """Return the tested functions of statsmodels: Burg and Yule-Walker."""
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
    """Return the tested functions of pysptk: LPC and line spectral pairs."""
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


def _one_first(a: Any) -> Samples:
    return np.concatenate([[1.0], np.asarray(a, dtype=np.float64).reshape(-1)])


def _step_up(k: Samples) -> Samples:
    """Convert reflection coefficients to direct-form coefficients in float64, like these libraries."""
    a = np.ones(1)
    for k_m in k:
        a = np.append(a, 0.0) + k_m * np.append(a, 0.0)[::-1]
    return a


def _predictor(library: str, name: str, method: str, fit: Callable[[Any, int], Any]) -> Subject:
    def cases(quick: bool) -> Iterable[Case]:
        return (
            case for case in signals_at_orders(quick, 18 if quick else MAX_ORDER) if case.order <= MAX_ORDER
        )

    def attempt(x: Any, case: Case) -> Findings:
        a = np.asarray(fit(x, case.order))
        yield a
        a, p, samples = np.asarray(a, dtype=np.float64), case.order, to_float64(x)
        yield Check("p + 1 coefficients", abs(a.size - p - 1), 0.0)
        if np.any(samples) and samples.size > p and references.EXTENDED:
            padding = 0 if method == BURG else p
            energy = references.direct_energy(samples, a, padding)
            optimum = references.burg_energies(samples, p, padding)[-1]
            limit = (
                1e-3 if x.dtype in (np.float32, np.float16) else checks.MAX_EXCESS_ENERGY
            )  # single precision
            yield checks.excess_energy(f"{method}'s optimum", energy, optimum, limit)
        yield from checks.stable_coefficients(a)

    return Subject(name, "baselines", cases, attempt, library)


def _models(quick: bool) -> tuple[Case, ...]:
    return model_cases(quick, 18 if quick else MAX_ORDER)


def _line_spectrum(library: str, name: str, convert: Callable[[Samples], tuple[Samples, Samples]]) -> Subject:
    def attempt(x: Any, case: Case) -> Findings:
        lsf, a = convert(case_reflection(x, case))
        yield lsf, a
        is_valid = a.size == case.order + 1 and np.all(np.isfinite(a))
        yield from checks.line_spectrum(
            case_reflection(x, case), lsf, references.step_down(a) if is_valid else None
        )

    return Subject(name, "baselines", _models, attempt, library)


# Filters ----------------------------------------------------------------------------------------------------


def scipy() -> list[Subject]:
    """Return the tested functions of SciPy: `solve_toeplitz` for LPC, two filters and a moving average."""

    def toeplitz(x: Any, p: int) -> Samples:
        samples = np.asarray(x, dtype=np.float64)
        r = np.array([samples[i:] @ samples[: max(samples.size - i, 0)] for i in range(p + 1)])
        return np.concatenate([[1.0], linalg.solve_toeplitz(r[:-1], -r[1:])])

    def with_lengths(quick: bool) -> tuple[Case, ...]:
        return (*cases_of(*VALUES, *FORMS, quick=quick), *lengths(True))

    def with_windows(quick: bool) -> list[Case]:
        return [c.at_order(n) for c in cases_of(*VALUES, *FORMS, quick=quick) for n in (3, 101)]

    return [
        _predictor("scipy", "solve_toeplitz (LPC)", AUTOCORRELATION, toeplitz),
        Subject("lfilter (all-pole synthesis)", "baselines", _models, _direct_form, "scipy"),
        Subject("butter + filtfilt, (b, a) form", "baselines", with_lengths, _filtfilt, "scipy"),
        Subject("ndimage.uniform_filter1d", "baselines", with_windows, _uniform_filter, "scipy"),
    ]


def _direct_form(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    out = np.asarray(signal.lfilter([1.0], _step_up(k), EXCITATION))
    yield checks.finite("synthesis", out)
    if case.order <= 50:
        yield checks.response("synthesis", out, k, EXCITATION)
        return
    level = float(unit_model(k).level)
    if np.isfinite(level):
        bound = level * float(np.linalg.norm(EXCITATION))
        yield Check("output over its bound", largest(out) / bound, 1.0)


def _filtfilt(x: Any, case: Case) -> Findings:
    """Compare with the same band-pass, as second-order sections computed with 60 significant digits."""
    band: Any = {"N": 4, "Wn": (50.0, 200.0), "btype": "bandpass", "fs": case.fs}
    b, a = signal.butter(**band)
    out = np.asarray(signal.filtfilt(b, a, x[:SHORT]))
    yield out
    samples = to_float64(x[:SHORT])
    yield checks.finite("output", out)
    sections: Any = signal.butter(**band, output="sos")
    reference = references.zero_phase(sections, samples, 27)
    yield checks.close(
        "output, against 60 digits", out, reference, checks.MAX_RESPONSE_ERROR, scale=largest(samples)
    )


def _uniform_filter(x: Any, case: Case) -> Findings:
    """Compare only the interior of the signal, where the boundary mode has no effect."""
    out = np.asarray(ndimage.uniform_filter1d(x, case.order, mode="nearest", output=np.float64))
    yield out
    samples, half = to_float64(x), case.order // 2
    yield checks.finite("output", out)
    reference = references.moving_average(samples, case.order)[half:-half]
    yield checks.close("means, against exact sums", out[half:-half], reference, 1e-13, scale=largest(samples))


# Features ---------------------------------------------------------------------------------------------------

Named = tuple[dict[str, Any], dict[str, str]]


def librosa() -> list[Subject]:
    """Return the tested functions of librosa: Burg's method and commonly used features."""
    import librosa as library

    def extract(x: Any, case: Case) -> Named:
        spectral, sr = library.feature, case.fs
        rows = {
            "mfcc": spectral.mfcc(y=x, sr=sr, n_mfcc=13, n_fft=512, n_mels=20),
            "centroid": spectral.spectral_centroid(y=x, sr=sr, n_fft=512),
            "bandwidth": spectral.spectral_bandwidth(y=x, sr=sr, n_fft=512),
            "flatness": spectral.spectral_flatness(y=x, n_fft=512),
            "rolloff": spectral.spectral_rolloff(y=x, sr=sr, n_fft=512),
            "zero crossings": spectral.zero_crossing_rate(x),
            "rms": spectral.rms(y=x),
        }
        return {
            f"{name} {i}": row.mean() for name, values in rows.items() for i, row in enumerate(values)
        }, {}

    burg = _predictor("librosa", "lpc (Burg)", BURG, lambda x, p: library.lpc(x, order=p))
    return [
        burg,
        Subject("features (19 means)", "baselines", feature_cases, library_trial(extract), "librosa"),
    ]


def tsfel() -> list[Subject]:
    """Return the test of all 156 TSFEL features. To limit run time, it uses every tenth signal length."""
    import tsfel as library

    configuration = library.get_features_by_domain()

    def extract(x: Any, case: Case) -> Named:
        table = library.time_series_features_extractor(configuration, x, fs=case.fs, verbose=0)
        return {str(name): table[name].iloc[0] for name in table.columns}, {}

    def thinned(quick: bool) -> list[Case]:
        every = enumerate(feature_cases(False))
        return _short_battery(True) if quick else [c for i, c in every if c.family != "length" or i % 10 == 0]

    return [Subject("features (all 156)", "baselines", thinned, library_trial(extract), "tsfel")]


def pycatch22() -> list[Subject]:
    """Return the test of pycatch22: the 22 features of catch22, mean and standard deviation."""
    import pycatch22 as library

    def extract(x: Any, case: Case) -> Named:
        result = library.catch22_all(x, catch24=True)
        return dict(zip(result["names"], result["values"], strict=True)), {}

    return [Subject("catch24", "baselines", feature_cases, library_trial(extract), "pycatch22")]


def tsfresh() -> list[Subject]:
    """Return the test of the 777 efficient tsfresh features, on at most 512 samples to limit run time."""
    import pandas as pd
    from tsfresh.feature_extraction import EfficientFCParameters, extract_features

    settings = EfficientFCParameters()

    def extract(x: Any, case: Case) -> Named:
        n = len(x) if case.family == "length" else min(len(x), 512)
        frame = pd.DataFrame({"id": np.zeros(n, dtype=int), "t": np.arange(n), "x": x[:n]})
        table = extract_features(
            frame,
            column_id="id",
            column_sort="t",
            default_fc_parameters=settings,
            n_jobs=0,
            disable_progressbar=True,
        )
        return {name: table[name].iloc[0] for name in table.columns}, {}

    return [
        Subject("features (efficient, 777)", "baselines", _short_battery, library_trial(extract), "tsfresh")
    ]


def _short_battery(quick: bool) -> list[Case]:
    """Return the test inputs with fewer signal lengths, or only six inputs for a quick run."""
    if quick:
        return [*cases_of("plain", "silent", "broken", "gain", quick=True)[:6]]
    return [case for case in feature_cases(False) if case.family != "length"] + list(lengths(True))
