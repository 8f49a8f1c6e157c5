"""Cost models: shared parts count once, and shares add up to the total."""

from dataclasses import replace
from datetime import date
from itertools import permutations

import numpy as np
import pytest
from sklearn.neighbors import NearestCentroid

from texclass.evaluation import cost as cost_module
from texclass.evaluation.cost import CostMeter, CostModel, classifier_cost
from texclass.features.contract import Feature
from texclass.features.phase_view import transform
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, Member

MODEL = CostModel(
    columns=("a", "b.1", "b.2", "c"),
    features=("a", "b", "b", "c"),
    parts=("shared", "a", "b", "c"),
    ms=np.array([6.0, 1.0, 2.0, 4.0]),
    needs=np.array([[1, 1, 0, 0], [1, 0, 1, 0], [1, 0, 1, 0], [0, 0, 0, 1]], dtype=bool),
)


def test_a_shared_part_is_paid_once_and_columns_of_a_feature_share_its_cost():
    for columns, ms in (([], 0), (["a"], 7), (["a", "b.1"], 9), (["b.1"], 8), (["b.1", "b.2"], 8)):
        assert MODEL.cost(columns) == ms
    assert MODEL.total == 13
    assert MODEL.restricted_to(["b.2", "a"]).cost(["a", "b.2"]) == 9
    with pytest.raises(ValueError, match="the cost model has no column 'z'"):
        MODEL.cost(["z"])


def test_a_cost_is_the_whole_path_and_finding_the_phases_is_paid_once():
    whole = replace(MODEL, segmentation_ms=5.0)
    assert [whole.cost(columns) for columns in ([], ["a"], ["a", "b.1"])] == [0, 12, 14]
    assert (whole.total, whole.features_ms, whole.cheapest) == (18, 13, 9)
    assert whole.by_feature().equals(MODEL.by_feature())


def test_shares_are_the_mean_marginal_cost_over_all_orders():
    column, cost_table = {"a": "a", "b": "b.1", "c": "c"}, MODEL.by_feature()
    marginal = {feature: [] for feature in column}
    for order in permutations(column):
        costs = [MODEL.cost([column[f] for f in order[:n]]) for n in range(4)]
        for feature, added in zip(order, np.diff(costs), strict=True):
            marginal[feature].append(added)
    expected = {feature: np.mean(added) for feature, added in marginal.items()}
    assert cost_table["share"].to_dict() == pytest.approx(expected)
    assert cost_table["share"].sum() == pytest.approx(MODEL.total)
    assert cost_table["alone"].to_dict() == {"a": 7, "b": 8, "c": 4}
    assert cost_table["last"].to_dict() == {"a": 1, "b": 2, "c": 4}


class Ticks:
    """A clock that moves only when work is done."""

    now = 0.0

    def __call__(self):
        return self.now

    def work(self, ms):
        self.now += 1e-3 * ms


@pytest.fixture
def ticks(monkeypatch):
    clock = Ticks()
    monkeypatch.setattr(cost_module, "clock", clock)

    @transform
    def inner(view, k):
        clock.work(10 * k)
        return k

    @transform
    def outer(view):
        clock.work(5)
        return inner(view, 1) + inner(view, 2)

    def first(view):
        clock.work(1)
        return float(outer(view))

    def second(view):
        clock.work(2)
        return float(outer(view) + inner(view, 2) + inner(view, 3))

    members = (Member(f.__name__, Feature(f.__name__, f, "movement", "1", "")) for f in (first, second))
    return FeatureSet("toy", tuple(members))


def test_measures_every_transform_once_without_what_is_inside_it(ticks, toy_dataset):
    dataset = toy_dataset()
    meter = CostMeter.from_dataset(dataset, [e.recording_id for e in dataset.entries], "combine")
    model = meter.model(ticks)
    parts = dict(zip(model.parts, model.ms, strict=True))
    assert parts["outer()"] == pytest.approx(5)
    assert parts["inner(2)"] == pytest.approx(20)
    assert parts["second"] == pytest.approx(2)
    assert model.by_feature()["alone"].to_dict() == pytest.approx({"first": 36, "second": 67})
    assert model.total == pytest.approx(68)
    assert meter.measure(Plan.of(ticks))[0] == pytest.approx(model.total)


def test_the_cost_model_predicts_the_cost_of_pruned_plans(ticks, toy_dataset):
    dataset = toy_dataset()
    plan = Plan.of(ticks)
    before = plan.compute(dataset[0]).values
    meter = CostMeter.from_dataset(dataset, [dataset.entries[0].recording_id], "combine")
    model = meter.model(ticks)
    for column in model.columns:
        assert model.cost([column]) == pytest.approx(meter.measure(plan.restricted_to([column]))[0])
    np.testing.assert_array_equal(plan.compute(dataset[0]).values, before)


def test_the_cached_cost_model_is_measured_once(ticks, toy_dataset, monkeypatch, tmp_path):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path))
    dataset = toy_dataset()
    meter = CostMeter.from_dataset(dataset, [dataset.entries[0].recording_id], "combine")
    first = meter.cached_model(ticks)
    with monkeypatch.context() as patched:
        patched.setattr(CostMeter, "model", None)  # not asked again
        second_model = meter.cached_model(ticks)
    assert second_model.machine == first.machine
    assert second_model.machine.endswith(str(date.today()))
    assert (second_model.columns, second_model.features, second_model.parts) == (
        first.columns,
        first.features,
        first.parts,
    )
    np.testing.assert_array_equal(second_model.ms, first.ms)
    np.testing.assert_array_equal(second_model.needs, first.needs)
    (kept,) = (tmp_path / "costs").iterdir()
    kept.write_bytes(kept.read_bytes()[:-9])  # damaged: measured anew
    assert meter.cached_model(ticks).columns == first.columns


def test_columns_that_are_constant_within_classes_are_no_warning():
    X = np.column_stack([np.repeat([0.0, 2.0], 5), np.random.default_rng(0).standard_normal(10)])
    assert classifier_cost(NearestCentroid(), X, np.repeat(["oak", "slate"], 5))["fit_ms"] > 0
