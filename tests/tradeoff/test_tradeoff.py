"""The trade-off study: nested, within limits, and the pipeline it saves is the one it describes."""

import json

import numpy as np
import pytest

from texclass.features import load_feature_set
from texclass.tradeoff.front import Limits, estimate, knee
from texclass.tradeoff.recogniser import load_recogniser
from texclass.tradeoff.trading import trade_off

SET = load_feature_set("strese2015").restricted_to(["variance", "mean_magnitude", "spikiness"])


@pytest.fixture
def noises(toy_dataset):
    """Toy recordings (300 samples at 1 kHz) whose level names the material."""
    return toy_dataset(3, 6)


def study(dataset, limits=None, **options):
    return trade_off(dataset, SET, limits, n_folds=3, n_repeats=2, with_curves=False, **options).data


def test_the_pipeline_that_is_saved_is_the_one_that_was_chosen(noises, tmp_path):
    result = study(noises, model_file=tmp_path / "r.skops")
    recogniser = load_recogniser(tmp_path / "r.skops")
    assert list(recogniser.columns) == result["chosen"]["columns"]
    truth = [entry.material for entry in noises.entries]
    assert np.mean(recogniser.predict(list(noises)) == truth) > 0.8
    assert result["chosen"]["measured_ms"] > 0


def test_budgets_and_numbers_of_columns_are_kept(noises):
    result = study(noises, Limits(max_ms=1e6, max_features=2))
    assert len(result["chosen"]["columns"]) <= 2
    assert all(point["ms"] <= point["budget_ms"] * (1 + 1e-9) for point in result["front"])


def test_a_scene_needs_only_what_separates_its_materials(noises, tmp_path):
    limits = Limits(materials=("m0", "m2"))
    result = trade_off(noises, SET, limits, n_folds=3, n_repeats=2, with_curves=False)
    assert result.data["dataset"]["n_materials"] == 2
    assert len(result.data["chosen"]["columns"]) == 1
    assert [n for n, _ in result.data["fewest"]] == [1, 2, 3]
    paths = result.save(tmp_path)
    assert {path.suffix for path in paths} == {".json", ".md", ".png"}
    assert json.loads(paths[0].read_text()) == json.loads(result.to_json())
    assert "chosen inside each training part, for m0, m2" in paths[1].read_text(encoding="utf-8")


def test_curves_are_measured_where_the_dataset_allows(noises):
    result = trade_off(noises, SET, n_folds=3, n_repeats=1)
    curves = json.loads(result.to_json())["curves"]
    names = {curve["name"] for curve in curves}
    assert {"touch", "training recordings per material", "bit depth", "order of the movement model"} <= names
    for curve in curves:
        assert len(curve["x"]) == len(curve["accuracy"]) == len(curve["labels"])
        assert all(0 <= a["low"] <= a["mean"] <= a["high"] <= 1 for a in curve["accuracy"])
    assert result.data["knee"] in result.data["front"]
    assert result.data["at_half_cost"]["budget_ms"] <= result.data["total_ms"] / 2 * (1 + 1e-9)


def test_the_knee_is_the_cheapest_point_within_one_per_cent_of_the_best():
    for means, best in (((0.5, 0.95, 0.955, 0.96), 2), ((0.5, 0.9, 0.96), 3)):
        front = [{"budget_ms": n, "accuracy": {"mean": mean}} for n, mean in enumerate(means, start=1)]
        assert knee(front)["budget_ms"] == best


def test_intervals_hold_the_mean_and_do_not_collapse():
    splits = [(range(20), range(10))] * 3
    assert estimate([1.0, 1.0, 1.0], splits)["low"] < 0.95
    some = estimate([0.8, 0.9, 0.7], splits)
    assert some["low"] < some["mean"] < some["high"]
