"""Examination: laws are recovered, and each way to break the contract is told from the others."""

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


def made(function, gain=INVARIANT):
    return Feature("made", function, "movement", "1", "test", (), gain)


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
def test_the_true_law_is_recovered_whatever_is_declared(function, gain):
    told = measure_gain_law(made(function, gain), VIEWS)
    assert told["holds"]
    assert told["measured"] == pytest.approx(asdict(gain), abs=1e-6)
    wrong = measure_gain_law(made(function, Gain(power=3)), VIEWS)
    assert not wrong["holds"]
    assert wrong["measured"] == pytest.approx(asdict(gain), abs=1e-6)
    assert wrong["n_views"] == 3


def test_no_law_is_found_where_there_is_none_or_no_value():
    def never(view):
        raise UndefinedFeatureError("never")

    law = measure_gain_law(made(lambda view: (np.abs(view.samples) > 1).mean()), VIEWS)
    assert not law["holds"]
    assert law["measured_deviation"] > 0.1
    assert measure_gain_law(made(never), VIEWS) is None


def test_a_scaled_tap_scales_hand_impulse_and_noise():
    view = scale_view(TapView((TapSignal(np.ones(2), np.ones(3)),), 10.0, 0.5), 4.0)
    assert (view.taps[0].hand.max(), view.taps[0].impulse.max(), view.noise) == (4.0, 4.0, 2.0)


def test_each_way_to_break_the_contract_has_its_name():
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

    found = {a["input"]: a for a in check_degenerate_inputs(made(careless))}
    told = {name: (a["outcome"], a["is_valid"]) for name, a in found.items()}
    assert told["0 samples"] == ("reason", True)
    assert told["1 samples"] == ("error", False)
    assert "IndexError" in found["1 samples"]["detail"]
    assert told["2 samples"] == ("error", False)
    assert "shape (2,) instead of (1,)" in found["2 samples"]["detail"]
    assert told["10 samples"] == ("value", False)
    assert "warns: odd" in found["10 samples"]["detail"]
    assert told["100 samples"] == ("value", True)
    assert told["one NaN"] == ("no reason", False)
    assert told["silence"] == ("value", False)
