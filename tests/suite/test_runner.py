"""A run of the suite: folds, resumption, failures, methods of users."""

import json
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest

from texclass.evaluation import find_protocol
from texclass.leaderboard import summarize
from texclass.loaders import open_dataset
from texclass.loaders.cards import read_card
from texclass.suite import DEFAULT_METHODS, available_datasets, cells, find_method, run_suite
from texclass.suite.runner import join_rows, list_cells, read_table

needs_no_aeon = pytest.mark.skipif(find_spec("aeon") is not None, reason="aeon is installed here")


def test_one_row_per_fold_of_each_protocol_and_method(table):
    done = table[table["status"] == "done"]
    counts = done.groupby(["method", "question"])["fold"].nunique().to_dict()
    assert counts == {
        (method, question): n
        for method in ("bands", "coarse")
        for question, n in (("published", 3), ("same operator", 3), ("later", 1))
    }
    for score in ("accuracy", "balanced_accuracy", "macro_f1", "auroc_unknown", "ece", "coverage"):
        assert done[score].between(0, 1).all(), score
    assert (done[["ms", "kb"]] > 0).all(axis=None)
    assert set(done["author"]) == {"texclass"}
    assert set(done["licence"]) == {"CC0-1.0"}


def test_every_method_has_the_same_stored_folds(table, settings):
    for _, rows in table[table["status"] == "done"].groupby("question"):
        assert rows["folds_hash"].nunique() == rows["n_units"].nunique() == 1
        assert rows.groupby("fold")["n_test"].nunique().eq(1).all()
    files = sorted((settings.folder / "folds" / "noises").glob("*.json"))
    assert len(files) == 3
    for path in files:
        folds = json.loads(path.read_text())
        tests = np.concatenate([fold["test"] for fold in folds["folds"]])
        assert len(set(tests)) == len(tests)
        for fold in folds["folds"]:
            assert not set(fold["train"]) & set(fold["test"])


def test_only_the_published_split_divides_recordings(settings, table):
    for question, is_divided in (("published", True), ("same-operator", False)):
        (path,) = (settings.folder / "folds" / "noises").glob(f"{question}*.json")
        folds = json.loads(path.read_text())
        parent = [name.split("#")[0] for name in folds["recordings"]]
        for fold in folds["folds"]:
            shared = {parent[i] for i in fold["train"]} & {parent[i] for i in fold["test"]}
            assert bool(shared) == is_divided


@needs_no_aeon
def test_a_failure_is_kept_with_its_message(table):
    failed = table[table["method"] == "minirocket"]
    assert set(failed["status"]) == {"failed"}
    assert failed["message"].str.contains("not installed: needs aeon").all()
    assert summarize(table).query("method == 'minirocket'")["accuracy"].isna().all()


def test_overlapping_training_windows_are_not_used_when_windows_are_shuffled(card):
    """They would contain parts of the test windows."""
    dataset = cells.prepare_dataset(str(card), read_card(card).protocols[0])
    frame = cells.metadata(dataset.entries)
    overlapping = cells.metadata(cells.add_overlapping_windows(dataset, 4).entries)
    assert overlapping["is_train_only"].any()
    for protocol, is_used in (("shuffled-windows", False), ("recording", True)):
        folds = cells.load_folds(frame, protocol, 3, card.parent / f"{protocol}.json")
        for train, test in folds.splits_of(overlapping):
            assert overlapping["is_train_only"].iloc[train].any() == is_used
            assert not overlapping["is_train_only"].iloc[test].any()


def test_accuracy_agrees_with_the_stored_hits_of_the_units(table):
    for row in table[table["status"] == "done"].to_dict("records"):
        counts = [part.split(":")[1].split("/") for part in row["unit_hits"].split()]
        n_hits, n_tests = np.sum(np.array(counts, dtype=int), axis=0)
        assert row["accuracy"] == pytest.approx(n_hits / n_tests)
        assert row["n_test"] == n_tests


def test_the_pipeline_has_the_accuracy_of_the_benchmark(table, card):
    """The same folds and the same single choice give the same accuracy as `run_benchmark`."""
    from texclass.evaluation import load_pipeline, run_benchmark
    from texclass.suite.stored_folds import SEED

    pipeline = load_pipeline("surfaces").model_copy(update={"seed": SEED})
    result = run_benchmark(open_dataset(card), pipeline, protocol="chronological")
    rows = run_suite([str(card)], [find_method("surfaces")], cells_settings(card))
    later = rows[rows["question"] == "later"]
    assert later["accuracy"].tolist() == [result.data["rows"][0]["accuracy"]["vote"]["mean"]]


def cells_settings(card):
    import sys
    from pathlib import Path

    return cells.SuiteSettings(card.parent / "own-suite", Path(sys.executable), 300.0)


def test_a_finished_cell_is_not_evaluated_again(table, card, settings, monkeypatch):
    def refuse(*args):
        raise AssertionError("a finished cell is evaluated again")

    monkeypatch.setattr(cells, "_evaluate_pipeline", refuse)
    again = run_suite([str(card)], [find_method("coarse")], settings)
    pd.testing.assert_frame_equal(
        again, table[table["method"] == "coarse"].reset_index(drop=True), check_dtype=False
    )


@pytest.mark.parametrize("change", ["code", "method"])
def test_a_change_of_code_or_method_evaluates_again(table, card, settings, monkeypatch, change):
    method = find_method("coarse")
    (cell, *_) = list_cells([str(card)], [method])
    path = cell.path(cell.protocols[0], settings.folder)
    dataset = cells.prepare_dataset(cell.card, cell.protocols[0])
    assert cells.is_current(path, method, dataset)
    if change == "code":
        monkeypatch.setattr(cells, "suite_code_hash", lambda: "other")
    else:
        pipeline = method.pipeline.model_copy()
        pipeline._hash = "other"
        method = replace(method, pipeline=pipeline)
    assert not cells.is_current(path, method, dataset)
    assert not cells.is_current(path, find_method("coarse"), replace(dataset, input_hash="0" * 64))


def test_folds_of_other_recordings_are_refused(card, tmp_path, settings, table):
    source = settings.folder / "folds" / "noises"
    target = tmp_path / "folds" / "noises"
    target.mkdir(parents=True)
    for path in source.glob("*.json"):
        content = json.loads(path.read_text())
        content["recordings"][0] = "other"
        (target / path.name).write_text(json.dumps(content))
    rows = run_suite([str(card)], [find_method("coarse")], replace(settings, folder=tmp_path))
    assert set(rows["status"]) == {"failed"}
    assert rows["message"].str.contains("the folds belong to other recordings").all()


def test_a_new_feature_is_added_to_the_default_pipeline(card, tmp_path):
    (tmp_path / "crest.py").write_text(
        "import numpy as np\n"
        "from texclass.features import feature\n\n\n"
        '@feature(phase="movement", unit="", reference="own", outputs=("crest",))\n'
        "def crest(view):\n"
        "    return np.array([np.abs(view.samples).max() / view.samples.std()])\n"
    )
    method = find_method(f"{tmp_path / 'crest.py'}:crest", author="Ada")
    assert method.name == "surfaces+crest"
    assert all("crest" in row.features for row in method.pipeline.rows)
    assert method.author == "Ada"
    rows = run_suite([str(card)], [method], cells_settings(card))
    assert set(rows["status"]) == {"done"}
    assert set(rows["author"]) == {"Ada"}
    assert method.hash != find_method("surfaces").hash


def test_methods_of_texclass_and_baselines_keep_their_author():
    assert {find_method(name, author="Ada").author for name in ("surfaces", "mfcc")} == {"texclass"}


@pytest.mark.parametrize("name", ["nothing", "missing.toml"])
def test_an_unknown_method_is_refused_with_the_choices(name):
    with pytest.raises(ValueError, match=r"unknown method .*minirocket"):
        find_method(name)


def test_default_methods_exist():
    assert [find_method(name).name for name in DEFAULT_METHODS] == list(DEFAULT_METHODS)


def test_protocols_of_shipped_cards_are_known():
    available, unavailable = available_datasets()
    assert "simulated6" in available
    assert "simulated69" in unavailable
    for name in available:
        for protocol in read_card(name).protocols:
            find_protocol(protocol.protocol)


def test_a_card_without_protocols_is_refused(card, tmp_path):
    path = tmp_path / "none.toml"
    path.write_text(card.read_text().split("[[protocols]]")[0])
    with pytest.raises(ValueError, match="declares no protocol"):
        list_cells([str(path)], [find_method("coarse")])


def test_joined_tables_keep_the_first_result_of_a_cell(table):
    other = table.assign(accuracy=0.0)
    extra = table[table["method"] == "coarse"].assign(method="mine", author="Ada")
    joined = join_rows([table, other, extra])
    assert len(joined) == len(table) + len(extra)
    assert joined[joined["method"] == "coarse"]["accuracy"].gt(0).all()


def test_a_table_that_is_none_is_refused(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match=r"missing columns dataset, .*texclass suite"):
        read_table(path)
