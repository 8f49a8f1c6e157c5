"""Cost: parts counted once, shares that add up, and selection that knows what is free."""

import numpy as np
import pytest

from texclass.experiment import cost as cost_module
from texclass.experiment.cost import CostMeter, CostModel, classifier_cost
from texclass.features.contract import Feature
from texclass.features.extractor import Plan
from texclass.features.phase_view import transform
from texclass.features.sets import FeatureSet, Member

MODEL = CostModel(
    columns=("a", "b.1", "b.2", "c"),
    features=("a", "b", "b", "c"),
    parts=("shared", "a", "b", "c"),
    ms=np.array([6.0, 1.0, 2.0, 4.0]),
    needs=np.array([[1, 1, 0, 0], [1, 0, 1, 0], [1, 0, 1, 0], [0, 0, 0, 1]], dtype=bool),
)


def test_a_shared_part_is_paid_once_and_columns_of_a_feature_share_its_cost():
    assert MODEL.cost(["a"]) == 7
    assert MODEL.cost(["a", "b.1"]) == 9
    assert MODEL.marginal("b.2", ["b.1"]) == 0
    assert MODEL.marginal("b.1", ["a"]) == 2
    assert MODEL.cost([]) == 0
    assert MODEL.total == 13


def test_shares_are_the_mean_marginal_cost_over_all_orders():
    orders = [
        ("a", "b", "c"),
        ("a", "c", "b"),
        ("b", "a", "c"),
        ("b", "c", "a"),
        ("c", "a", "b"),
        ("c", "b", "a"),
    ]
    column = {"a": "a", "b": "b.1", "c": "c"}
    for feature, share in MODEL.shares().items():
        marginal = [
            MODEL.marginal(column[feature], [column[f] for f in order[: order.index(feature)]])
            for order in orders
        ]
        assert share == pytest.approx(np.mean(marginal))
    assert sum(MODEL.shares().values()) == pytest.approx(MODEL.total)
    assert MODEL.alone()["a"] == 7
    assert MODEL.last()["a"] == 1


def test_an_unknown_column_is_refused():
    with pytest.raises(ValueError, match="'z' has no cost"):
        MODEL.cost(["z"])


def test_a_restricted_model_costs_the_same():
    assert MODEL.restricted_to(["b.2", "a"]).cost(["a", "b.2"]) == 9


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
    meter = CostMeter.on(dataset, [e.recording_id for e in dataset.entries], "combine")
    model = meter.model(ticks)
    parts = dict(zip(model.parts, model.ms, strict=True))
    assert parts["outer()"] == pytest.approx(5)
    assert parts["inner(2)"] == pytest.approx(20)
    assert parts["second"] == pytest.approx(2)
    assert model.alone() == pytest.approx({"first": 36, "second": 67})
    assert model.total == pytest.approx(68)
    assert meter.measured(Plan.of(ticks))[0] == pytest.approx(model.total)


def test_predicts_the_cost_of_what_is_left_out(ticks, toy_dataset):
    dataset = toy_dataset()
    meter = CostMeter.on(dataset, [dataset.entries[0].recording_id], "combine")
    model, plan = meter.model(ticks), Plan.of(ticks)
    for column in model.columns:
        assert model.cost([column]) == pytest.approx(meter.measured(plan.restricted_to([column]))[0])


def test_timing_does_not_change_values(ticks, toy_dataset):
    recording = toy_dataset()[0]
    before = Plan.of(ticks).compute(recording).values
    CostMeter((recording,)).model(ticks)
    np.testing.assert_array_equal(Plan.of(ticks).compute(recording).values, before)


def test_classifiers_cost_time_to_fit_and_to_predict():
    from sklearn.naive_bayes import GaussianNB

    X = np.random.default_rng(0).normal(size=(40, 3))
    cost = classifier_cost("nb", GaussianNB(), X, np.arange(40) % 4)
    assert cost.fit_ms > 0
    assert cost.predict_ms > 0
