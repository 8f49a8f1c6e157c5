"""Study of a new feature: one that helps, one that repeats another, one that exists already."""

import json
from types import FunctionType

import numpy as np
import pandas as pd
import pytest
from toy_noises import CLASSIFIERS, row

from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.new_feature import redundancy, study_feature
from texclass.features.contract import Feature, Gain


def loud(view):
    return view.samples.std()


LOUD = Feature("loud", loud, "movement", "g", "test", gain=Gain(power=1))


@pytest.fixture(scope="module")
def few(pipeline):
    euclidean = {"euclidean": CLASSIFIERS["euclidean"]}
    return pipeline(row("Chance", "rarely"), row("Peaks", "peaks"), classifiers=euclidean, seed=5)


@pytest.fixture(scope="module")
def study(toy_dataset, few):
    return study_feature(toy_dataset(n_surfaces=4, n_repetitions=8), few, LOUD)


def test_the_table_stands_as_it_was_with_a_row_for_the_feature_alone(study):
    names = [line["name"] for line in study.data["rows"]]
    assert names == ["Chance", "Peaks", "New: loud"]
    assert study.data["rows"][-1]["accuracy"]["euclidean"]["mean"] > 0.9
    assert study.data["ablation"]["row"] == "Peaks"
    assert [group["name"] for group in study.data["ablation"]["groups"]] == ["loud"]


def test_law_cost_and_repetition_are_measured(study):
    study_data = json.loads(study.to_json())["new_feature"]
    assert study_data["gain_law"]["holds"] is True
    assert study_data["ms_alone"] > 0
    assert 0 <= study_data["ms_added"] <= study_data["ms_alone"] * 1.5
    (column,) = study_data["redundancy"]
    assert column["nearest"][0]["column"].startswith("peaks")
    assert column["nearest"][0]["rank_correlation"] > 0.9
    assert column["explained"] > 0.9
    assert {a["input"]: a["outcome"] for a in study_data["degenerate_inputs"]}["one NaN"] == "no reason"


def test_a_study_is_written_beside_its_benchmark_without_pictures_of_its_own(study, tmp_path):
    written = {path.name for path in study.save(tmp_path)}
    assert {path.name for path in tmp_path.iterdir()} == written
    assert {name.rpartition(".")[2] for name in written if "feature" in name} == {"json", "md"}
    assert any(name.endswith(".png") for name in written)
    (report,) = tmp_path.glob("*-feature.md")
    nested = 100 * study.data["nested_cv"]["accuracy"]["mean"]
    assert f"Table with the new feature: {nested:.1f} % [" in report.read_text()


def test_an_existing_feature_name_is_rejected_and_a_new_feature_changes_the_hash(few):
    assert few.with_feature(LOUD).hash != few.hash
    with pytest.raises(ValueError, match=r"'toy' already contains a feature or column 'level'. Rename"):
        few.with_feature(Feature("level", loud, "movement", "g", "test"))


def test_a_feature_of_a_notebook_has_the_hash_of_its_cell(few):
    def in_cell(name):
        code = loud.__code__.replace(co_filename=f"/tmp/ipykernel_1/{name}.py")
        return Feature("cell", FunctionType(code, {}), "movement", "g", "test")

    first, same, other = (few.with_feature(in_cell(name)).hash for name in ("11", "11", "22"))
    assert first == same != other


def test_a_missing_phase_is_reported(toy_dataset, few):
    tap = Feature("knuckle", lambda view: 1.0, "tap", "1", "test")
    study_data = json.loads(study_feature(toy_dataset(n_repetitions=8), few, tap).to_json())
    assert study_data["rows"][-1]["missing"] == "no tap found (knuckle)"
    new = study_data["new_feature"]
    assert (new["gain_law"], new["redundancy"], new["ms_added"]) == (None, [], None)


def test_redundancy_is_high_for_a_copy_and_low_for_noise():
    rng = np.random.default_rng(0)
    a, b, noise = rng.normal(size=(3, 200))
    columns = {"a": a, "b": b, "copy": np.exp(a), "sum": a + b, "noise": noise, "same": np.ones(200)}
    table = FeatureTable(pd.DataFrame(columns), tuple(columns), np.zeros(200))
    study_data = {r["column"]: r for r in redundancy(table, ["copy", "sum", "noise", "same"])}
    assert study_data["copy"]["nearest"][0] == {"column": "a", "rank_correlation": pytest.approx(1.0)}
    assert study_data["sum"]["explained"] == pytest.approx(1.0, abs=1e-3)
    assert study_data["noise"]["explained"] < 0.1
    assert "same" not in study_data
