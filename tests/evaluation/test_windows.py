"""Windows of movements stay with their recording, and each file is read once."""

import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from toy_noises import CLASSIFIERS, row

from texclass.evaluation import windows
from texclass.evaluation.benchmark import run_benchmark
from texclass.evaluation.feature_table import cached_table, extract_table, metadata
from texclass.evaluation.pipeline import FoldSettings
from texclass.evaluation.protocols import PROTOCOLS
from texclass.evaluation.windows import add_overlapping_windows, cut_windows
from texclass.features.extractor import FeatureExtractor
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import Phases, Recording, RecordingError, Tap

FS = 100.0
TAPPED = Phases((Tap(5, 10, 20),), movement=(40, 205))


def tapped(entry):
    """Two seconds: a tap, then 1.65 s of movement; samples count themselves."""
    n = np.arange(210.0)
    return Recording(n, fs=FS, unit="V", recording_id=entry.recording_id, phases=TAPPED, friction=2 * n)


@pytest.fixture
def counting():
    entries = tuple(Entry(f"m{m}_{r}", f"m{m}", "o", f"s{r}", r) for m in (0, 1) for r in (1, 2, 3))
    return Dataset("counting", entries, tapped, "x")


def test_windows_follow_each_other_within_the_movement_with_all_signals_and_facts(counting):
    dataset = pickle.loads(pickle.dumps(cut_windows(counting, 0.5)))  # as it travels to other processes
    overlapping_windows = [w.acceleration for w in dataset]
    assert len(overlapping_windows) == 6 * 3
    np.testing.assert_array_equal(np.concatenate(overlapping_windows[:3]), np.arange(40.0, 190.0))
    entry, window = dataset.entries[4], dataset[4]
    assert (entry.recording_id, entry.parent.recording_id, entry.repetition) == ("m0_2#2", "m0_2", 2)
    assert (entry.surface, entry.operator, entry.session) == ("m0", "o", "s2")
    assert window.phases == Phases(movement=(0, 50))
    assert window.recording_id == "m0_2#2"
    np.testing.assert_array_equal(window.friction, 2 * window.acceleration)


def test_windows_and_tables_keep_further_labels(counting, tmp_path):
    speeds = {1: (("speed", "20"),), 2: (("speed", "50"), ("tool", "steel")), 3: ()}
    entries = tuple(replace(entry, labels=speeds[entry.repetition]) for entry in counting.entries)
    dataset = replace(counting, entries=entries)
    assert dataset.table["speed"].isna().sum() == 2
    assert "speed (2)" in repr(dataset)
    assert "tool" not in repr(dataset)  # one value
    cut = pickle.loads(pickle.dumps(add_overlapping_windows(cut_windows(dataset, 0.5), 2)))
    assert {dict(w.labels).get("tool") for w in cut.entries if w.repetition == 2} == {"steel"}
    frame = metadata(cut.entries)
    assert frame.groupby("repetition")["speed"].unique().map(list).to_dict()[2] == ["50"]
    assert frame["speed"].isna().groupby(frame["repetition"]).all().to_dict() == {1: False, 2: False, 3: True}
    ((train, test),) = PROTOCOLS["recording"].split(frame, 3, 0)[:1]
    assert set(frame["parent"][train]).isdisjoint(frame["parent"][test])


def test_windows_may_be_one_a_recording_or_overlap(counting):
    first = cut_windows(counting, 1.2, per_recording=1)
    assert len(first) == len(counting)
    np.testing.assert_array_equal(first[0].acceleration, np.arange(40.0, 160.0))
    closer = cut_windows(counting, 0.5, step=0.25, per_recording=4)
    assert [entry.start for entry in closer.entries[:4]] == [40, 65, 90, 115]


def test_short_adjacent_windows_get_overlapping_training_windows(counting, monkeypatch):
    windows_of_recordings = cut_windows(counting, 0.4)  # of 40 samples, 4 a recording
    overlapping_windows = add_overlapping_windows(windows_of_recordings, 4)
    assert [entry.start for entry in overlapping_windows.entries[:13]] == list(range(40, 170, 10))
    assert [entry.recording_id for entry in overlapping_windows.entries[:3]] == [
        "m0_1#1",
        "m0_1#1.1",
        "m0_1#1.2",
    ]
    assert (
        tuple(entry for entry in overlapping_windows.entries if not entry.is_train_only)
        == windows_of_recordings.entries
    )
    np.testing.assert_array_equal(overlapping_windows[1].acceleration, np.arange(50.0, 90.0))
    for alone in (
        counting,
        cut_windows(counting, 0.4, per_recording=1),
        cut_windows(counting, 0.4, step=0.6),
    ):
        assert add_overlapping_windows(alone, 4).entries == alone.entries
    monkeypatch.setattr(windows, "MAX_WINDOWS", len(windows_of_recordings) + 6 * 3)  # one between, not three
    assert [entry.start for entry in add_overlapping_windows(windows_of_recordings, 4).entries[:3]] == [
        40,
        60,
        80,
    ]
    monkeypatch.setattr(windows, "MAX_WINDOWS", len(windows_of_recordings))
    assert add_overlapping_windows(windows_of_recordings, 4).entries == windows_of_recordings.entries
    monkeypatch.undo()
    monkeypatch.setattr(windows, "SHORT_WINDOW", 40)
    assert add_overlapping_windows(windows_of_recordings, 4).entries == windows_of_recordings.entries


def test_overlapping_windows_are_in_training_sets_only(toy_dataset):
    windows_of_recordings = cut_windows(toy_dataset(3, 6), 0.1)
    alone, closer = (
        metadata(windows_of_recordings.entries),
        metadata(add_overlapping_windows(windows_of_recordings, 2).entries),
    )
    for protocol in filter(lambda one: one.separates_recordings, PROTOCOLS.values()):
        splits = zip(protocol.split(alone, 3, 0), protocol.split(closer, 3, 0), strict=True)
        for (train, test), (more, same) in splits:
            assert alone["recording_id"][test].tolist() == closer["recording_id"][same].tolist()
            assert set(closer["parent"][more]) == set(alone["parent"][train])
            assert (closer.iloc[more].groupby("parent").size() == 3 + 2).all()


def test_short_movements_and_bad_recordings_raise_an_error_when_loaded(toy_dataset, feature_set, tmp_path):
    bad = toy_dataset(bad=("m1_1",))
    with pytest.raises(RecordingError, match="value 'x' in line 3"):
        extract_table(cut_windows(bad, 0.1), feature_set, tmp_path / "t.npz")
    table = extract_table(cut_windows(bad, 0.1), feature_set, tmp_path / "t.npz", skip_bad=True)
    assert (table.n_recordings, [b.recording_id for b in table.left_out]) == (11 * 3, ["m1_1"])
    with pytest.raises(RecordingError, match=r"m0_1: the movement lasts 0\.3 s, but a window lasts 0\.4 s"):
        extract_table(cut_windows(toy_dataset(), 0.4), feature_set, tmp_path / "t.npz")


def test_lengths_are_above_0_and_windows_are_not_cut_again(counting):
    for arguments in ({"seconds": 0}, {"seconds": 1, "step": -1}, {"seconds": 1, "per_recording": 0}):
        with pytest.raises(ValueError, match="must be positive and finite"):
            cut_windows(counting, **arguments)
    with pytest.raises(ValueError, match="whole recordings"):
        cut_windows(cut_windows(counting, 1), 0.5)


def test_each_file_is_read_once_and_movements_are_remembered(toy_dataset, feature_set):
    dataset = toy_dataset(1, 4)
    cached_table(cut_windows(dataset, 0.1), feature_set)
    assert dataset.load.loaded == 2 * [
        f"m0_{r}" for r in (1, 2, 3, 4)
    ]  # once for movements, once for all windows
    second_dataset = toy_dataset(1, 4)
    table = cached_table(cut_windows(second_dataset, 0.1), feature_set)
    assert second_dataset.load.loaded == []
    assert table.frame["parent"].tolist() == [f"m0_{r}" for r in (1, 2, 3, 4) for _ in range(3)]
    cached_table(
        cut_windows(second_dataset, 0.05), feature_set
    )  # another length is another table, with known movements
    assert second_dataset.load.loaded == [f"m0_{r}" for r in (1, 2, 3, 4)]


def test_extraction_gives_what_the_extractor_gives_for_each_window(toy_dataset, feature_set, tmp_path):
    dataset = cut_windows(toy_dataset(), 0.1)
    table = extract_table(dataset, feature_set, tmp_path / "t.npz")
    direct = FeatureExtractor(feature_set).fit(dataset).extract(dataset)
    np.testing.assert_array_equal(table.values, direct.values)
    assert table.frame["recording_id"].tolist() == list(direct.recording_ids)
    assert len(table.flags) == 3  # once a recording, not once a window


def test_only_shuffled_windows_divide_a_recording_and_they_are_split_as_recordings_are(toy_dataset):
    dataset = toy_dataset(3, 6)
    whole, cut = metadata(dataset.entries), metadata(cut_windows(dataset, 0.1).entries)
    shuffled = cut.sample(frac=1, random_state=1, ignore_index=True)
    for name, protocol in PROTOCOLS.items():
        for train, test in protocol.split(shuffled, 3, 0):
            if not protocol.separates_recordings:
                assert set(shuffled["parent"][train]) & set(shuffled["parent"][test])
                continue
            assert not set(shuffled["parent"][train]) & set(shuffled["parent"][test])
            for rows in (train, test):  # all windows of a recording, or none
                assert (shuffled.iloc[rows].groupby("parent").size() == 3).all()
        if name in ("recording", "chronological", "few-shot"):
            pairs = zip(protocol.split(whole, 3, 0), protocol.split(cut, 3, 0), strict=True)
            for (_, test), (_, of_windows) in pairs:
                assert set(whole["recording_id"][test]) == set(cut["parent"][of_windows])
    assert "parent" not in whole
    assert whole.dtypes["repetition"] == pd.Int64Dtype()


def test_the_benchmark_of_windows_reports_them_their_interval_and_their_vote(toy_dataset, pipeline):
    euclidean = {"euclidean": CLASSIFIERS["euclidean"]}
    few = pipeline(row("Level", "level"), classifiers=euclidean, steps=(), protocol=FoldSettings(folds=3))
    result = run_benchmark(cut_windows(toy_dataset(3, 6), 0.02), few, protocol="grouped")
    facts = result.data["dataset"]
    assert (facts["n_windows"], facts["n_recordings"]) == (3 * 6 * 15, 3 * 6)
    calls = result.data["rows"][0]["accuracy"]["euclidean"]
    assert (calls["interval"], calls["n_clusters"]) == ("t over runs", 18)
    assert calls["low"] < calls["mean"] < calls["high"]
    assert calls["per_run"]["interval"] == "Wilson"
    assert calls["per_run"]["mean"] > calls["mean"]
    assert calls["balanced"] == pytest.approx(calls["mean"])
    windows_of_recordings, closer = (
        cut_windows(toy_dataset(3, 6), 0.02),
        few.model_copy(update={"overlap": 2}),
    )
    overlapping_windows = run_benchmark(windows_of_recordings, closer, protocol="grouped").data
    assert overlapping_windows["dataset"] == facts
    assert np.sum(overlapping_windows["confusion"]["counts"]) == facts["n_windows"]


def test_the_benchmark_of_shuffled_windows_counts_windows_and_never_trains_on_overlapping_ones(
    toy_dataset, pipeline, monkeypatch
):
    monkeypatch.setattr(
        "texclass.evaluation.benchmark.add_overlapping_windows", None
    )  # their cost is avoided
    two = {name: CLASSIFIERS[name] for name in list(CLASSIFIERS)[:2]}
    settings = {"classifiers": two, "steps": (), "protocol": FoldSettings(folds=3)}
    closer = pipeline(row("Level", "level"), **settings).model_copy(update={"overlap": 2})
    windows_of_recordings = cut_windows(toy_dataset(3, 6), 0.02)
    result = run_benchmark(windows_of_recordings, closer, protocol="shuffled-windows", nested_cv=True)
    assert "optimistic" in result.data["protocol_description"]
    accuracy = result.data["rows"][0]["accuracy"][next(iter(two))]
    assert (accuracy["clusters"], accuracy["n_clusters"]) == ("recording", 18)
    assert not any(key.startswith("per_") for key in accuracy)  # no recording is tested by itself
    assert result.data["nested_cv"]["inner_protocols"] == ["shuffled-windows"]
    assert np.sum(result.data["confusion"]["counts"]) == result.data["dataset"]["n_windows"]
    assert "optimistic" in " ".join(map(str, result.document().blocks))


def test_movements_are_detected_again_when_the_code_of_the_phases_changes(counting, monkeypatch):
    n_loaded = []

    def load(entry):
        n_loaded.append(entry.recording_id)
        return tapped(entry)

    dataset = replace(counting, load=load, input_hash="movements")
    cut_windows(dataset, 0.5)
    cut_windows(dataset, 0.6)
    assert len(n_loaded) == len(dataset)  # read from the cache
    monkeypatch.setattr(windows, "code_hash", lambda *places: "edited")
    cut_windows(dataset, 0.5)
    assert len(n_loaded) == 2 * len(dataset)
