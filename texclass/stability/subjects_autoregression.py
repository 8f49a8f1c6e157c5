"""Subjects: what texclass derives from reflection coefficients: spectra, poles, sound."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact, exact_models, rules
from texclass.stability.signals import VALUES, Case, in_families, noise, samples_of, with_orders
from texclass.stability.verdict import Check, Documented, Finding, Subject, Unchecked
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis, line_spectrum

EXCITATION = noise(192, 7)


def subjects() -> list[Subject]:
    """Return the line spectrum, the lattice and everything read from reflection coefficients."""
    return [
        _derived("line spectrum, there and back", _line_spectrum, _line_spectrum_checks, 1000),
        _derived("lattice synthesis", _lattice, _lattice_checks, 1000),
        _derived("lattice inverse filter", _inverse, _inverse_checks, 400),
        _derived("log spectrum", _log_spectrum, _log_spectrum_checks, 1000),
        _derived("poles", _poles, _poles_checks, 256),
        _derived("cepstrum", _cepstrum, _cepstrum_checks, 128),
        _derived("direct form, or its refusal", _direct, _direct_checks, 256),
        _derived("log area ratios", _areas, _areas_checks, 1000),
    ]


@lru_cache(maxsize=4096)
def _fitted(samples: bytes, order: int) -> Autoregression:
    x = np.frombuffer(samples)
    return vibration.fit(x, order)


def model_of(x: Any, order: int) -> Autoregression:
    """Return Burg's model; all checks of what is derived from it share it."""
    return _fitted(samples_of(x).tobytes(), order)


def handmade(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return models that no fit gives: every reflection coefficient of one size, or next to 1."""
    orders = (1, 2, 18, 128) if quick else (1, 2, 10, 18, 50, 100, 128, 256, 400, 1000)
    cases = []
    for p in (p for p in orders if p <= largest):
        sign = np.where(np.arange(p) % 2, -1.0, 1.0)
        random = np.random.default_rng(p).choice([-1.0, 1.0], p)
        for name, k in {
            "all k = 0.9": np.full(p, 0.9),
            "all k = -0.9": np.full(p, -0.9),
            "k = 0.999, alternating": 0.999 * sign,
            "k = 1 - 1e-12, random sign": (1 - 1e-12) * random,
            "k = 1 - 2^-53": np.full(p, 1 - 2.0**-53),
        }.items():
            cases.append(Case(name, "poles", lambda k=k: k).at_order(p))  # type: ignore[misc]
    return tuple(cases)


def k_of(x: Any, case: Case) -> Samples:
    """Return the reflection coefficients a case stands for: those given by hand, or Burg's of its signal."""
    if case.name.startswith(("k =", "all k =")):
        return samples_of(x)
    return model_of(x, case.order).reflection


def unit_model(k: Samples) -> Autoregression:
    """Return the model of reflection coefficients at unit gain."""
    return Autoregression(k, np.asarray(1.0))


def derived_cases(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return the models by hand, and one at each order for each signal."""
    signals = with_orders(in_families(*VALUES, quick=quick), quick, largest)
    return (*signals, *handmade(quick, largest))


def _derived(name: str, run: Any, checks: Any, largest: int) -> Subject:
    def of(quick: bool) -> tuple[Case, ...]:
        return derived_cases(quick, min(largest, 400 if largest == 1000 else 128) if quick else largest)

    return Subject(name, "models", "texclass", of, run, checks)


def _line_spectrum(x: Any, case: Case) -> tuple[Samples, Samples]:
    lsf = line_spectrum.from_reflection(k_of(x, case))
    return lsf, line_spectrum.to_reflection(lsf)


def _line_spectrum_checks(x: Any, case: Case, result: tuple[Samples, Samples]) -> Iterator[Finding]:
    k = k_of(x, case)
    yield from rules.line_spectrum(k, *result)
    if line_spectrum.conditioning(result[0]) >= 1:
        yield Documented("conditioning >= 1: two frequencies that float64 cannot tell apart")
    if case.order <= 50:
        if exact.available():
            yield Check(
                "frequencies, against 60 digits", exact_models.line_spectrum_error(k, result[0]), 1e-12
            )
        else:
            yield Unchecked(exact.MISSING)


def _lattice(x: Any, case: Case) -> dict[str, Samples]:
    model = unit_model(k_of(x, case))
    level = None if np.isfinite(model.level) else 1.0
    one = LatticeSynthesis(model, level=level)
    pieces = LatticeSynthesis(model, level=level)
    single = LatticeSynthesis(model, level=1.0, dtype=np.float32)
    cut = [EXCITATION[:50], EXCITATION[50:51], EXCITATION[51:51], EXCITATION[51:]]
    return {
        "float64": np.asarray(one.process(EXCITATION)),
        "pieces": np.concatenate([pieces.process(piece) for piece in cut]),
        "float32": np.asarray(single.process(EXCITATION)),
    }


def _lattice_checks(x: Any, case: Case, out: dict[str, Samples]) -> Iterator[Finding]:
    k = k_of(x, case)
    model = unit_model(k)
    level = float(model.level) if np.isfinite(model.level) else 1.0
    size = float(np.linalg.norm(EXCITATION))  # rotations: no state exceeds the energy that went in
    yield rules.holds("bounded in float64", np.max(np.abs(out["float64"])) <= level * size)
    yield rules.holds("bounded in float32", np.max(np.abs(out["float32"])) <= size)
    yield rules.close("pieces = whole", out["pieces"], out["float64"], 0.0)
    if case.order <= 50 and np.isfinite(model.level):
        yield from rules.response("synthesis", out["float64"], k, 1.0, EXCITATION)
    else:
        yield rules.finite("synthesis", out["float64"])
    if float(model.prediction_gain_db) < 60:
        limit = 1e-6 * case.order + 1e-4
        yield rules.close("float32 against float64", out["float32"] * level, out["float64"], limit)


def _inverse(x: Any, case: Case) -> Samples:
    model = unit_model(k_of(x, case))
    level = None if np.isfinite(model.level) else 1.0
    out = LatticeSynthesis(model, level=level).process(EXCITATION)
    return np.asarray(LatticeInverse(model, level=level).process(out))


def _inverse_checks(x: Any, case: Case, back: Samples) -> Iterator[Finding]:
    """Check that undoing the synthesis loses the prediction gain (level / gain) in digits, and no more."""
    gain_db = float(unit_model(k_of(x, case)).prediction_gain_db)
    lost = 1e-15 * case.order * 10 ** (min(gain_db, 400.0) / 20)
    if lost > 1e-4:
        yield Check("a prediction gain beyond what float64 can undo", 0.0, 0.0)
    else:
        yield rules.close("the excitation comes back", back, EXCITATION, 1000 * lost + 1e-12)


def _log_spectrum(x: Any, case: Case) -> Samples:
    return unit_model(k_of(x, case)).log_spectrum_db(OMEGA_FEW)


OMEGA_FEW = np.array([1e-6, 0.05, 0.3, 0.7, 1.5, 2.9, np.pi])


def _log_spectrum_checks(x: Any, case: Case, db: Samples) -> Iterator[Finding]:
    yield rules.finite("log spectrum", db)
    if exact.available():
        right = exact_models.log_spectrum_db(k_of(x, case), OMEGA_FEW)
        yield rules.close("log spectrum, against 60 digits", db, right, 1e-9, scale=10.0)
    else:
        yield Unchecked(exact.MISSING)


def _poles(x: Any, case: Case) -> Any:
    return unit_model(k_of(x, case)).poles()


def _poles_checks(x: Any, case: Case, poles: Any) -> Iterator[Finding]:
    """Check that they lie inside the unit circle, and that their product has the spectrum of the model."""
    yield rules.finite("poles", np.abs(poles))
    yield rules.holds("poles inside the unit circle", np.max(np.abs(poles)) < 1)
    at = rules.OMEGA[:, np.newaxis]
    product = -20 * np.log10(np.abs(1 - poles * np.exp(-1j * at))).sum(axis=1)
    k = k_of(x, case)
    yield Check("dB RMS of the spectrum of their product", _rms_db(product, k), 1e-6)


def _rms_db(spectrum_db: Samples, k: Samples) -> float:
    return float(np.sqrt(np.mean((spectrum_db - line_spectrum.log_spectrum(k, rules.OMEGA)) ** 2)))


def _cepstrum(x: Any, case: Case) -> Samples:
    return unit_model(k_of(x, case)).cepstrum(20)[1:]


def _cepstrum_checks(x: Any, case: Case, c: Samples) -> Iterator[Finding]:
    yield rules.finite("cepstrum", c)
    if exact.available():
        right = exact_models.cepstrum(k_of(x, case), 20)
        yield rules.close("cepstrum, against 60 digits", c, right, 1e-9, scale=1.0)
    else:
        yield Unchecked(exact.MISSING)


def _direct(x: Any, case: Case) -> Samples:
    return unit_model(k_of(x, case)).direct_form()


def _direct_checks(x: Any, case: Case, a: Samples) -> Iterator[Finding]:
    yield from rules.stable_coefficients(a)
    if exact.available() and case.order <= 128:
        yield rules.close("k of the coefficients", exact_models.step_down(a), k_of(x, case), 2e-6, scale=1.0)


def _areas(x: Any, case: Case) -> Samples:
    return unit_model(k_of(x, case)).log_area_ratios


def _areas_checks(x: Any, case: Case, areas: Samples) -> Iterator[Finding]:
    yield rules.finite("log area ratios", areas)
    k = k_of(x, case)
    right = np.log((1 + k.astype(np.longdouble)) / (1 - k.astype(np.longdouble)))
    error = np.max(np.abs(areas - right) / np.maximum(np.abs(right), 1e-300), initial=0.0)
    yield Check("log area ratios, relative", float(error), 1e-14)
