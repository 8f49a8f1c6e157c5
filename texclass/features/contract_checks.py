"""What a feature keeps of its contract: the declared gain law, and an answer to degenerate input."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.phase_view import PairView, Phase, PhaseView, TapSignal, TapView, View
from texclass.recording import Samples

GAINS = (1e-2, 1e-1, 1e1, 1e2)
EXACT = 1e-5
"""Relative deviation up to which a gain law holds; rounding stays below it."""
REFUSED = ("silence", "0 samples", "one NaN", "one infinite sample")
"""Inputs that no feature may give a value for."""


def scaled(view: View, gain: float) -> View:
    """Return the view of the signal multiplied by a gain, with nothing remembered."""
    if isinstance(view, PhaseView):
        return PhaseView(gain * view.samples, view.fs)
    if isinstance(view, PairView):
        one, other = (PhaseView(gain * side.samples, side.fs) for side in view.sides)
        return PairView((one, other))
    taps = tuple(TapSignal(gain * tap.hand, gain * tap.impulse, tap.quality) for tap in view.taps)
    return TapView(taps, view.fs, gain * view.noise)


def gain_law(feature: Feature, views: Sequence[View]) -> dict[str, Any] | None:
    """Measure how a feature follows the gain of real signals.

    Parameters
    ----------
    feature : Feature
        With its default parameters.
    views : sequence of PhaseView, TapView or PairView
        Of the phase that the feature reads.

    Returns
    -------
    dict or None
        None when the feature has no finite value for any of the views at every gain. Else `declared` and
        `measured`, the fields of the law as declared and of the `Gain` that fits best; `deviation` and
        `measured_deviation`, the largest of y(g x) from each, relative to the larger of the two magnitudes (a
        large one of the measured law means that there is none); `holds`, whether the declared law is what was
        measured; and `n_views`, the signals it was measured on.
    """
    pairs = []
    for view in views:
        try:
            y = np.atleast_1d(np.asarray(feature.function(scaled(view, 1.0)), dtype=np.float64))
            louder = {g: np.atleast_1d(feature.function(scaled(view, g))) for g in GAINS}
        except UndefinedFeatureError:
            continue
        if np.isfinite([y, *louder.values()]).all():
            pairs += [(g, y, np.asarray(y_g, dtype=np.float64)) for g, y_g in louder.items()]
    if not pairs:
        return None
    # y(g x) = g^power y(x): the median slope of log |y|; y(g x) = y(x) + shift log10 g: that of y.
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.concatenate([np.log10(np.abs(y_g / y)) / np.log10(g) for g, y, y_g in pairs])
    steps = np.concatenate([(y_g - y) / np.log10(g) for g, y, y_g in pairs])
    slopes = slopes[np.isfinite(slopes)]
    laws = (Gain(), Gain(power=_median(slopes)), Gain(shift=_median(steps)))
    measured = min(laws, key=lambda law: round(_deviation(law, pairs), 6))
    deviation = _deviation(feature.gain, pairs)
    return {
        "declared": asdict(feature.gain),
        "deviation": deviation,
        "measured": asdict(measured),
        "measured_deviation": _deviation(measured, pairs),
        "n_views": len(pairs) // len(GAINS),
        "holds": deviation <= EXACT,
    }


def behaviour(feature: Feature, fs: float = 10_000.0) -> list[dict[str, Any]]:
    """Give a feature every degenerate input.

    Parameters
    ----------
    feature : Feature
        With its default parameters.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    list of dict
        For each input its name, `input`; the `answer`: "value", "reason" (an `UndefinedFeatureError`: NaN
        with this reason), "no reason" (NaN or infinity without one) or "error"; the `detail`, that is the
        value, the reason or the error, and warnings; and whether the contract is `kept`: a finite value or a
        reason, no warning, and a reason for `REFUSED`.
    """
    views = {name: bare_view(feature.phase, x, fs) for name, x in degenerate_inputs().items()}
    if feature.phase == "tap":
        views["no tap"] = TapView((), fs)
    answers = {name: _answer(feature, name, view) for name, view in views.items()}
    return [
        {"input": name, "answer": answer, "detail": detail, "kept": kept}
        for name, (answer, detail, kept) in answers.items()
    ]


def degenerate_inputs() -> Mapping[str, Samples]:
    """Return name -> samples of signals that recordings contain sooner or later, 2 s at 10 kHz."""
    noise = np.random.default_rng(0).standard_normal(20_000)
    time = np.arange(20_000) / 10_000
    impulse = (np.arange(20_000) == 9_000).astype(np.float64)
    return {
        "silence": np.zeros(20_000),
        "constant": np.full(20_000, 0.1),
        "one impulse": impulse,
        "clipped": np.sign(np.sin(2 * np.pi * 50 * time) + 1e-9),
        "pure tone": np.sin(2 * np.pi * 123.4 * time),
        "half silent": np.where(time < 1, 0.0, noise),
        "quantised to one step": np.round(0.6 * noise),
        "ramp": np.linspace(-1, 1, 20_000),
        "1e-100 times noise": 1e-100 * noise,
        "1e100 times noise": 1e100 * noise,
        "one NaN": np.where(impulse == 1, np.nan, noise),
        "one infinite sample": np.where(impulse == 1, np.inf, noise),
        **{f"{n} samples": noise[:n] for n in (0, 1, 2, 10, 100)},
    }


def bare_view(phase: Phase, x: Samples, fs: float) -> View:
    """Return samples (n,) as a phase, without a recording that would refuse them.

    A tap has its contact after a quarter; the second channel of a pair is the first one backwards.
    """
    if phase == "tap":
        hand, impulse = np.split(x, [x.size // 4])
        return TapView((TapSignal(hand, impulse),), fs)
    one = PhaseView(x, fs)
    return PairView((one, PhaseView(x[::-1].copy(), fs))) if phase == "pair" else one


def _answer(feature: Feature, name: str, view: View) -> tuple[str, str, bool]:
    """Return kind of answer, detail and whether the contract is kept; see `behaviour`."""
    n_outputs = len(feature.columns(feature.name, {}))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            values = np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        except UndefinedFeatureError as undefined:
            return "reason", str(undefined), not caught
        except Exception as error:
            return "error", " ".join(f"{type(error).__name__}: {error}".split()), False
    if values.shape != (n_outputs,):
        return "error", f"shape {values.shape} instead of ({n_outputs},)", False
    shown = ", ".join(f"{v:.4g}" for v in values[:3]) + (", ..." if values.size > 3 else "")
    detail = "; ".join([shown, *dict.fromkeys(f"warns: {w.message}" for w in caught)])
    if not np.isfinite(values).all():
        return "no reason", detail, False
    return "value", detail, not caught and name not in REFUSED


def _median(values: Samples) -> float:
    return float(np.round(np.median(values), 9)) if values.size else 0.0


def _deviation(law: Gain, pairs: Sequence[tuple[float, Samples, Samples]]) -> float:
    """Return the largest deviation from a law, relative to the larger magnitude of expected and found."""
    worst = 0.0
    for g, y, y_g in pairs:
        expected = law.apply(y, g)
        scale = max(float(np.abs(expected).max()), float(np.abs(y_g).max()))
        if scale > 0:
            worst = max(worst, float(np.abs(y_g - expected).max()) / scale)
    return worst
