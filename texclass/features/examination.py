"""What a feature keeps of its contract: the declared gain law, and an answer to degenerate input."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.phase_view import PhaseView, TapSignal, TapView
from texclass.recording import Samples

View = PhaseView | TapView
Answer = Literal["value", "reason", "no reason", "error"]
GAINS = (1e-2, 1e-1, 1e1, 1e2)
EXACT = 1e-5
"""Relative deviation up to which a gain law holds; rounding stays below it."""
REFUSED = ("silence", "0 samples", "one NaN", "one infinite sample")
"""Inputs that no feature may give a value for."""


@dataclass(frozen=True)
class GainLaw:
    """The gain law of a feature, as declared and as measured.

    Attributes
    ----------
    declared
        By the decorator.
    deviation
        Largest deviation of y(g x) from it, relative to the larger of the two magnitudes.
    measured
        The law of `Gain`'s form that fits best, and its deviation.
    measured_deviation
        The same for the measured law; a large one means that there is no such law.
    n_views
        Signals it was measured on.
    """

    declared: Gain
    deviation: float
    measured: Gain
    measured_deviation: float
    n_views: int

    @property
    def holds(self) -> bool:
        """Whether the declared law is what was measured."""
        return self.deviation <= EXACT


@dataclass(frozen=True)
class Behaviour:
    """What a feature answers to one degenerate input.

    Attributes
    ----------
    input
        Which.
    answer
        "value", "reason" (an `UndefinedFeatureError`: NaN with this reason), "no reason" (NaN or infinity
        without one), or "error".
    detail
        The value, the reason or the error; warnings.
    kept
        Whether the contract is kept: a finite value or a reason, no warning, and a reason for `REFUSED`.
    """

    input: str
    answer: Answer
    detail: str
    kept: bool


def scaled(view: View, gain: float) -> View:
    """Return the view of the signal multiplied by a gain, with nothing remembered."""
    if isinstance(view, PhaseView):
        return PhaseView(gain * view.samples, view.fs)
    taps = tuple(TapSignal(gain * tap.hand, gain * tap.impulse) for tap in view.taps)
    return TapView(taps, view.fs, gain * view.noise)


def gain_law(feature: Feature, views: Sequence[View]) -> GainLaw | None:
    """Measure how a feature follows the gain of real signals.

    Parameters
    ----------
    feature : Feature
        With its default parameters.
    views : sequence of PhaseView or TapView
        Of the phase that the feature reads.

    Returns
    -------
    GainLaw or None
        None when the feature has no finite value for any of the views at every gain.
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
    return GainLaw(
        feature.gain, _deviation(feature.gain, pairs), measured, _deviation(measured, pairs),
        len(pairs) // len(GAINS),
    )  # fmt: skip


def behaviour(feature: Feature, fs: float = 10_000.0) -> tuple[Behaviour, ...]:
    """Give a feature every degenerate input.

    Parameters
    ----------
    feature : Feature
        With its default parameters.
    fs : float
        Sampling rate in Hz.
    """
    n_outputs = len(feature.columns(feature.name, {}))
    found = [
        _answer(name, partial(feature.function, _view(feature, x, fs)), n_outputs)
        for name, x in degenerate_inputs().items()
    ]
    if feature.phase == "tap":
        found.append(_answer("no tap", partial(feature.function, TapView((), fs)), n_outputs))
    return tuple(found)


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


def _view(feature: Feature, samples: Samples, fs: float) -> View:
    """Return the samples as the phase that the feature reads; a tap has its contact after a quarter."""
    if feature.phase == "tap":
        contact = samples.size // 4
        return TapView((TapSignal(samples[:contact], samples[contact:]),), fs)
    return PhaseView(samples, fs)


def _answer(name: str, call: Callable[[], Any], n_outputs: int) -> Behaviour:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            values = np.atleast_1d(np.asarray(call(), dtype=np.float64))
        except UndefinedFeatureError as undefined:
            return Behaviour(name, "reason", str(undefined), kept=not caught)
        except Exception as error:
            what = " ".join(f"{type(error).__name__}: {error}".split())
            return Behaviour(name, "error", what, kept=False)
    if values.shape != (n_outputs,):
        return Behaviour(name, "error", f"shape {values.shape} instead of ({n_outputs},)", kept=False)
    detail = "; ".join([_listed(values), *dict.fromkeys(f"warns: {w.message}" for w in caught)])
    if not np.isfinite(values).all():
        return Behaviour(name, "no reason", detail, kept=False)
    return Behaviour(name, "value", detail, kept=not caught and name not in REFUSED)


def _listed(values: Samples) -> str:
    more = ", ..." if values.size > 3 else ""
    return ", ".join(f"{v:.4g}" for v in values[:3]) + more


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
