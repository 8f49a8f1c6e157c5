"""Contract checks: gain laws are recovered, and violations of the contract are distinguished."""

import warnings
from dataclasses import asdict

import numpy as np
import pytest

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.contract_checks import check_degenerate_inputs, measure_gain_law, scale_view
from texclass.features.phase_view import PhaseView, TapSignal, TapView

RNG = np.random.default_rng(0)
VIEWS = [PhaseView(RNG.standard_normal(500) + 0.1, 1000.0) for _ in range(3)]


INVARIANT = Gain()


def feature_of(function, gain=INVARIANT):
    return Feature("feature", function, "movement", "1", "test", (), gain)


@pytest.mark.parametrize(
    ("function", "gain"),
    [
        (lambda view: view.samples.std(), Gain(power=1)),
        (lambda view: view.samples.var(), Gain(power=2)),
        (lambda view: 20 * np.log10(view.samples.std()), Gain(shift=20)),
        (lambda view: -(view.samples.max() ** -0.5), Gain(power=-0.5)),
        (lambda view: view.samples.argmax(), Gain()),
    ],
)
def test_the_true_gain_law_is_recovered_for_any_declaration(function, gain):
    law = measure_gain_law(feature_of(function, gain), VIEWS)
    assert law["holds"]
    assert law["measured"] == pytest.approx(asdict(gain), abs=1e-6)
    other = measure_gain_law(feature_of(function, Gain(power=3)), VIEWS)
    assert not other["holds"]
    assert other["measured"] == pytest.approx(asdict(gain), abs=1e-6)
    assert other["n_views"] == 3


def test_no_gain_law_holds_without_one_or_without_values():
    def never(view):
        raise UndefinedFeatureError("never")

    law = measure_gain_law(feature_of(lambda view: (np.abs(view.samples) > 1).mean()), VIEWS)
    assert not law["holds"]
    assert law["measured_deviation"] > 0.1
    assert measure_gain_law(feature_of(never), VIEWS) is None


def test_a_scaled_tap_scales_hand_impulse_and_noise():
    view = scale_view(TapView((TapSignal(np.ones(2), np.ones(3)),), 10.0, 0.5), 4.0)
    assert (view.taps[0].hand.max(), view.taps[0].impulse.max(), view.noise) == (4.0, 4.0, 2.0)


def test_each_violation_of_the_contract_has_its_own_outcome():
    def careless(view):
        x = view.samples
        if x.size == 0:
            raise UndefinedFeatureError("0 samples")
        if x.size == 1:
            return x[5]
        if x.size == 2:
            return [1.0, 2.0]
        with warnings.catch_warnings():
            if x.size == 10:
                warnings.warn("odd", RuntimeWarning, stacklevel=1)
        return x.max()

    results = {a["input"]: a for a in check_degenerate_inputs(feature_of(careless))}
    outcomes = {name: (a["outcome"], a["is_valid"]) for name, a in results.items()}
    assert outcomes["0 samples"] == ("reason", True)
    assert outcomes["1 samples"] == ("error", False)
    assert "IndexError" in results["1 samples"]["detail"]
    assert outcomes["2 samples"] == ("error", False)
    assert "shape (2,) instead of (1,)" in results["2 samples"]["detail"]
    assert outcomes["10 samples"] == ("value", False)
    assert "warns: odd" in results["10 samples"]["detail"]
    assert outcomes["100 samples"] == ("value", True)
    assert outcomes["one NaN"] == ("no reason", False)
    assert outcomes["silence"] == ("value", False)
