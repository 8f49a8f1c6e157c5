"""Checks of the feature contract.

A feature must follow its declared gain law. For degenerate input, it must return a finite value, or state why
it is undefined.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.phase_view import PairView, Phase, PhaseView, TapSignal, TapView, View
from texclass.recording import Samples

GAINS = (1e-2, 1e-1, 1e1, 1e2)
"""Gains by which signals are multiplied to measure the gain law."""
MAX_LAW_DEVIATION = 1e-5
"""Largest relative deviation from a gain law that is attributed to rounding."""
UNDEFINED_INPUTS = ("silence", "0 samples", "one NaN", "one infinite sample")
"""Degenerate inputs for which every feature must be undefined."""


def scale_view(view: View, gain: float) -> View:
    """Return a view of the signal multiplied by a gain, with an empty cache."""
    if isinstance(view, PhaseView):
        return PhaseView(gain * view.samples, view.fs)
    if isinstance(view, PairView):
        first, second = (PhaseView(gain * side.samples, side.fs) for side in view.sides)
        return PairView((first, second))
    taps = tuple(TapSignal(gain * tap.hand, gain * tap.impulse, tap.quality) for tap in view.taps)
    return TapView(taps, view.fs, gain * view.noise)


def measure_gain_law(feature: Feature, views: Sequence[View]) -> dict[str, Any] | None:
    """Measure how a feature changes with the gain of real signals, and compare it with the declared law.

    Parameters
    ----------
    feature : Feature
        Feature with its default parameters.
    views : sequence of PhaseView, TapView or PairView
        Views of the phase that the feature reads.

    Returns
    -------
    dict or None
        None if there is no view for which the feature is finite at all gains. Otherwise:

        - `declared`, `measured`: fields of the declared `Gain` and of the `Gain` that fits best;
        - `deviation`, `measured_deviation`: largest deviation of y(g x) from the declared and from the
          measured law, relative to the larger of the expected and the actual magnitude. If
          `measured_deviation` is large, the feature follows no gain law;
        - `holds`: whether `deviation` is at most `MAX_LAW_DEVIATION`;
        - `n_views`: number of views for which the feature is finite at all gains.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.features.contract import list_features
    >>> law = measure_gain_law(list_features()["variance"], [PhaseView(np.sin(np.arange(100.0)), fs=1000)])
    >>> law["measured"], law["holds"]
    ({'power': 2.0, 'shift': 0.0}, True)
    """
    pairs = []
    for view in views:
        try:
            y = np.atleast_1d(np.asarray(feature.function(scale_view(view, 1.0)), dtype=np.float64))
            y_of_gain = {g: np.atleast_1d(feature.function(scale_view(view, g))) for g in GAINS}
        except UndefinedFeatureError:
            continue
        if np.isfinite([y, *y_of_gain.values()]).all():
            pairs += [(g, y, np.asarray(y_g, dtype=np.float64)) for g, y_g in y_of_gain.items()]
    if not pairs:
        return None
    # power = median of log |y(g x)/y(x)| / log g; shift = median of (y(g x) - y(x)) / log10 g.
    with np.errstate(divide="ignore", invalid="ignore"):
        powers = np.concatenate([np.log10(np.abs(y_g / y)) / np.log10(g) for g, y, y_g in pairs])
    shifts = np.concatenate([(y_g - y) / np.log10(g) for g, y, y_g in pairs])
    powers = powers[np.isfinite(powers)]
    laws = (Gain(), Gain(power=_median(powers)), Gain(shift=_median(shifts)))
    measured = min(laws, key=lambda law: round(_deviation(law, pairs), 6))
    deviation = _deviation(feature.gain, pairs)
    return {
        "declared": asdict(feature.gain),
        "deviation": deviation,
        "measured": asdict(measured),
        "measured_deviation": _deviation(measured, pairs),
        "n_views": len(pairs) // len(GAINS),
        "holds": deviation <= MAX_LAW_DEVIATION,
    }


def check_degenerate_inputs(feature: Feature, fs: float = 10_000.0) -> list[dict[str, Any]]:
    """Compute a feature for every degenerate input, and check the results against the contract.

    Parameters
    ----------
    feature : Feature
        Feature with its default parameters.
    fs : float
        Sampling rate in Hz (default 10,000).

    Returns
    -------
    list of dict
        For each input:

        - `input`: its name;
        - `outcome`: "value", "reason" (undefined, with a reason), "no reason" (NaN or infinity without one)
          or "error";
        - `detail`: the value, the reason or the error, and warnings;
        - `is_valid`: whether the feature obeys the contract: a finite value or a reason, no warning, and
          always a reason for `UNDEFINED_INPUTS`.

    Examples
    --------
    >>> from texclass.features.contract import list_features
    >>> for result in check_degenerate_inputs(list_features()["friction"])[:2]:
    ...     print(result["input"], "|", result["outcome"], "|", result["detail"])
    silence | reason | silence: all 20000 samples are 0
    constant | value | 0.1
    """
    views = {name: view_without_recording(feature.phase, x, fs) for name, x in degenerate_inputs().items()}
    if feature.phase == "tap":
        views["no tap"] = TapView((), fs)
    results = {name: _check_input(feature, name, view) for name, view in views.items()}
    return [
        {"input": name, "outcome": outcome, "detail": detail, "is_valid": is_valid}
        for name, (outcome, detail, is_valid) in results.items()
    ]


def degenerate_inputs() -> Mapping[str, Samples]:
    """Return a mapping from names to degenerate signals that occur in practice. Most last 2 s at 10 kHz."""
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


def view_without_recording(phase: Phase, x: Samples, fs: float) -> View:
    """Return samples of shape (n,) as a view of a phase.

    The view is created without a `Recording`, which would reject some of the samples. The contact of a tap is
    after a quarter of the samples. The second channel of a pair is the time-reversed first channel.
    """
    if phase == "tap":
        hand, impulse = np.split(x, [x.size // 4])
        return TapView((TapSignal(hand, impulse),), fs)
    movement = PhaseView(x, fs)
    return PairView((movement, PhaseView(x[::-1].copy(), fs))) if phase == "pair" else movement


def _check_input(feature: Feature, name: str, view: View) -> tuple[str, str, bool]:
    """Return `outcome`, `detail` and `is_valid` for one input; see `check_degenerate_inputs`."""
    n_outputs = len(feature.columns(feature.name, {}))
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        try:
            values = np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        except UndefinedFeatureError as undefined:
            return "reason", str(undefined), not messages
        except Exception as error:
            return "error", " ".join(f"{type(error).__name__}: {error}".split()), False
    if values.shape != (n_outputs,):
        return "error", f"shape {values.shape} instead of ({n_outputs},)", False
    first_values = ", ".join(f"{v:.4g}" for v in values[:3]) + (", ..." if values.size > 3 else "")
    detail = "; ".join([first_values, *dict.fromkeys(f"warns: {w.message}" for w in messages)])
    if not np.isfinite(values).all():
        return "no reason", detail, False
    return "value", detail, not messages and name not in UNDEFINED_INPUTS


def _median(values: Samples) -> float:
    return float(np.round(np.median(values), 9)) if values.size else 0.0


def _deviation(law: Gain, pairs: Sequence[tuple[float, Samples, Samples]]) -> float:
    """Return the largest deviation from a law, relative to the larger of expected and actual magnitude."""
    largest = 0.0
    for g, y, y_g in pairs:
        expected = law.apply(y, g)
        scale = max(float(np.abs(expected).max()), float(np.abs(y_g).max()))
        if scale > 0:
            largest = max(largest, float(np.abs(y_g - expected).max()) / scale)
    return largest
