"""Tests of the trade-off study: nested selection, limits, curves and the saved pipeline."""

import json
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from matplotlib.figure import Figure
from sklearn.model_selection import StratifiedGroupKFold

from texclass.evaluation import cost
from texclass.evaluation.accuracy import wilson_interval
from texclass.evaluation.cost import CostModel
from texclass.evaluation.windows import cut_windows
from texclass.features import load_feature_set
from texclass.recording import Phases, Recording, Tap
from texclass.tradeoff import cost_curves, cost_selection, pareto_front
from texclass.tradeoff.cost_curves import cross_validate, degrade, full_scale_of, quantise, resample
from texclass.tradeoff.pareto_front import (
    LabelledData,
    Limits,
    discriminant,
    knee_point,
    latency_budgets,
    nested_front,
    nested_smallest_subsets,
)
from texclass.tradeoff.study import trade_off
from texclass.tradeoff.tradeoff_document import _panel

SET = load_feature_set("strese2015").restricted_to(["variance", "mean_magnitude", "spikiness"])


@pytest.fixture
def noises(toy_dataset):
    """Toy recordings (300 samples at 1 kHz) whose level depends on the surface."""
    return toy_dataset(3, 6)


def study(dataset, limits, **options):
    return trade_off(dataset, SET, limits, n_folds=3, n_repeats=2, with_curves=False, **options)


def test_a_scene_gets_the_smallest_subset_that_separates_its_surfaces(noises, tmp_path):
    result = study(noises, Limits(surfaces=("m0", "m2")))
    assert result.data["dataset"]["n_surfaces"] == 2
    assert len(result.data["selection"]["columns"]) == 1
    assert [n for n, _ in result.data["smallest_subsets"]] == [1, 2, 3]
    paths = result.save(tmp_path)
    assert {path.suffix for path in paths} == {".json", ".md", ".png"}
    assert json.loads(paths[0].read_text()) == json.loads(result.to_json())
    assert "Accuracy for m0, m2 with the best columns, selected inside each training set" in paths[
        1
    ].read_text(encoding="utf-8")


def test_curves_are_measured_as_far_as_the_dataset_allows(noises):
    result = trade_off(noises, SET, n_folds=3, n_repeats=1)
    curves = json.loads(result.to_json())["curves"]
    names = {curve["name"] for curve in curves}
    assert {
        "signal length",
        "training recordings per surface",
        "bit depth",
        "order of the movement model",
    } <= names
    for curve in curves:
        assert len(curve["x"]) == len(curve["accuracy"]) == len(curve["labels"])
        assert all(0 <= a["low"] <= a["mean"] <= a["high"] <= 1 for a in curve["accuracy"])
    assert all(c["fit_ms"] > 0 and c["predict_ms"] > 0 for c in result.data["classifiers"])
    assert result.data["knee"] in result.data["front"]
    assert all(point["ms"] <= point["budget_ms"] * (1 + 1e-9) for point in result.data["front"])
    assert result.data["selection"]["measured_ms"] > 0
    saved = result.data["total_ms"] - result.data["at_half_cost"]["budget_ms"]
    features_ms = result.data["total_ms"] - result.data["segmentation_ms"]
    assert saved >= features_ms / 2 * (1 - 1e-9)


def test_budgets_lie_between_the_cheapest_feature_and_all_features():
    names = tuple("abcd")
    costs = CostModel(names, names, names, np.array([1.0, 2.0, 3.0, 4.0]), np.eye(4, dtype=bool))
    assert latency_budgets(costs) == pytest.approx([1, 2, 3, 4, 5, 6.5, 8, 10])
    assert latency_budgets(costs, 1e9) == latency_budgets(costs)
    assert set(latency_budgets(costs, 3.3)) - set(latency_budgets(costs)) == {3.3}
    with pytest.raises(ValueError, match=r"max_ms must be at least 1"):
        latency_budgets(costs, 0.5)
    whole = replace(costs, segmentation_ms=5.0)
    assert latency_budgets(whole) == pytest.approx([5 + ms for ms in latency_budgets(costs)])
    with pytest.raises(
        ValueError, match=r"at least 6 ms .the cheapest feature, including 5 ms for the segmentation"
    ):
        latency_budgets(whole, 5.5)


def test_the_knee_point_is_the_cheapest_within_one_percent_of_the_best():
    for means, best in (((0.5, 0.95, 0.955, 0.96), 2), ((0.5, 0.9, 0.96), 3)):
        front = [{"budget_ms": n, "accuracy": {"mean": mean}} for n, mean in enumerate(means, start=1)]
        assert knee_point(front)["budget_ms"] == best


def test_permuted_labels_give_chance_level_at_every_budget():
    """Each recording has three similar windows: separating them, or selecting on test data, is better."""
    every = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        groups, y = np.arange(180) // 3, rng.permutation(np.arange(60) % 3).repeat(3)
        X = rng.normal(size=(60, 8)).repeat(3, axis=0) + 0.01 * rng.normal(size=(180, 8))
        splits = list(StratifiedGroupKFold(3, shuffle=True, random_state=seed).split(X, y, groups))
        data, names = LabelledData(X, y, groups, groups), tuple("abcdefgh")
        costs = CostModel(names, names, names, np.ones(8), np.eye(8, dtype=bool))
        points, full = nested_front(data, splits, costs, (2.0, 4.0), max_features=3)
        smallest = [accuracy for _, accuracy in nested_smallest_subsets(data, splits, 2)]
        curve = cross_validate(data, splits, discriminant())
        assert full == curve
        accuracies = [*(p[of] for p in points for of in ("accuracy", "plain")), full, *smallest, curve]
        every.append([accuracy["mean"] for accuracy in accuracies])
    np.testing.assert_allclose(np.mean(every, axis=0), 1 / 3, atol=0.1)


def test_inner_folds_never_separate_windows_of_one_recording(noises, monkeypatch):
    divided = []

    def record_groups(y, groups, cv):
        divided.append(None if groups is None else (len(groups), len(set(groups))))
        return inner_splits(y, groups, cv)

    inner_splits = cost_selection.inner_splits
    for module in (cost_selection, pareto_front):
        monkeypatch.setattr(module, "inner_splits", record_groups)
    windows = cut_windows(noises, 0.15)
    for limits in (Limits(max_features=1), Limits(surfaces=("m0", "m2"))):
        trade_off(windows, SET, limits, n_folds=2, n_repeats=1, with_curves=False)
    assert None not in divided
    assert {n_windows / n_recordings for n_windows, n_recordings in divided} == {2.0}


@pytest.mark.parametrize(("protocol", "n"), [("operator", 6), ("recording", 36)])
def test_confidence_intervals_are_over_independent_units(toy_dataset, protocol, n):
    scene = Limits(surfaces=("m0", "m1", "m2"))
    data = study(toy_dataset(3, 12, operators=6), scene, protocol=protocol).data
    assert data["n_clusters"] == n
    for accuracy in (
        data["full"],
        data["knee"]["accuracy"],
        data["knee"]["plain"],
        data["smallest_subsets"][0][1],
    ):
        assert (accuracy["low"], accuracy["high"]) == wilson_interval(n, n)  # all agree


def test_a_repeated_study_selects_the_same_features_on_a_busy_machine(noises, tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    first = study(noises, Limits(max_ms=1e6), model_file=tmp_path / "first.skops").data
    ticks = count(1)
    monkeypatch.setattr(cost, "clock", lambda: 1e3 * next(ticks) ** 2)  # ever slower
    second = study(noises, Limits(max_ms=1e6), model_file=tmp_path / "second.skops").data
    for key in ("front", "knee", "costs", "total_ms", "costs_of"):
        assert second[key] == first[key]
    assert first["costs_of"] in first["selection"]["reason"]
    assert second["selection"]["measured_ms"] != first["selection"]["measured_ms"]
    assert (tmp_path / "second.skops").read_bytes() == (tmp_path / "first.skops").read_bytes()


# Simulation of cheaper sensors ------------------------------------------------------------------------------

FS = 1000.0


def sine(hz, n=2000, fs=FS):
    return np.cos(np.pi * (np.arange(n) + 0.5) * 2 * hz / fs)


def recording(x, **facts):
    return Recording(x, fs=FS, unit="m/s^2", recording_id="r", **facts)


def test_resample_preserves_a_tone_below_the_new_nyquist_frequency_and_removes_one_above():
    slow = resample(recording(sine(40.0)), 250.0)
    assert slow.fs == 250
    np.testing.assert_allclose(slow.acceleration, sine(40.0, 500, 250.0), atol=1e-9)
    assert np.abs(resample(recording(sine(200.0)), 250.0).acceleration).max() < 1e-9
    axes = np.stack([sine(40.0), sine(60.0)], axis=1)
    np.testing.assert_allclose(resample(recording(axes), 250.0).acceleration[:, 0], slow.acceleration)


def test_resample_converts_phases_and_other_signals():
    phases = Phases((Tap(100, 200, 400),), (800, 2000), 900)
    slow = resample(recording(sine(10.0), phases=phases, friction=np.ones(2000)), 500.0)
    assert slow.phases == Phases((Tap(50, 100, 200),), (400, 1000), 450)
    np.testing.assert_allclose(slow.friction, 1.0)


def test_quantise_rounds_by_at_most_half_a_step_and_clips():
    x = np.linspace(-1, 1, 10_001)
    for bits in (2, 8, 12):
        q, y = 2 / 2**bits, quantise(x, bits, 1.0)
        assert np.abs(y - x)[x < 1 - q].max() <= q / 2 + 1e-12
        assert np.unique(y).size == 2**bits
        assert (y.min(), y.max()) == (-1, pytest.approx(1 - q))


def test_a_degraded_dataset_is_another_input(toy_dataset):
    dataset = toy_dataset()
    scale = full_scale_of(dataset)
    coarse = degrade(dataset, bits=3, full_scale=scale)
    assert coarse.input_hash != dataset.input_hash
    assert np.unique(coarse[0].acceleration).size <= 8
    assert degrade(dataset, fs=500.0)[0].n_samples == 150
    np.testing.assert_array_equal(degrade(dataset, fs=5000.0)[0].acceleration, dataset[0].acceleration)
    with pytest.raises(ValueError, match=r"fs.*-1"):
        degrade(dataset, fs=-1)


def test_slow_curves_use_a_limited_number_of_recordings_per_surface(toy_dataset, monkeypatch):
    for n_recordings, per_surface in ((1000, 6), (15, 5), (3, 4)):  # at least four
        monkeypatch.setattr(cost_curves, "CURVES", cost_curves.CurveSettings(n_recordings=n_recordings))
        fewer, note = cost_curves._limit_recordings(toy_dataset(3, 6))
        assert len(fewer) == 3 * per_surface
        assert note == ("" if per_surface == 6 else f"from {3 * per_surface} of the recordings")


@pytest.mark.parametrize(
    ("x", "scale"), [([1, 2, 7.9], "linear"), ([1, 3, 8], "log"), ([0, 3, 80], "linear")]
)
def test_an_axis_is_logarithmic_if_its_values_span_a_factor_of_eight(x, scale):
    accuracies = [{"mean": 0.5, "low": 0.4, "high": 0.6}] * len(x)
    curve = {
        "name": "signal length",
        "unit": "s",
        "series": "all",
        "note": "",
        "x": x,
        "accuracy": accuracies,
    }
    axes = Figure().subplots()
    _panel(axes, "signal length", [{**curve, "labels": [f"{value:g}" for value in x]}], 0.25)
    assert axes.get_xscale() == scale
    assert next(label.get_text() for label in axes.get_xticklabels()).startswith(f"{x[0]:g}")
    assert axes.get_title() == "Signal length"
