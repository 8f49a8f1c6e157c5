"""Feature tables: interrupted runs resume, nothing is computed twice, bad recordings are named."""

import os
import signal
from dataclasses import replace
from importlib.util import find_spec
from multiprocessing import get_context

import numpy as np
import pandas as pd
import pytest

from texclass.atomic_write import cache_root
from texclass.evaluation import feature_table as tables
from texclass.evaluation.feature_table import (
    METADATA,
    FeatureTable,
    cached_table,
    extract_table,
    read_table,
    table_key,
)
from texclass.evaluation.windows import cut_windows
from texclass.features import load_feature_set
from texclass.features.extractor import FeatureExtractor
from texclass.features.reasons import Reason
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import Phases, Recording, RecordingError

LOADED, KILLED_AT = [], ["m_7"]


def load(entry):
    """Read a recording of noise; at one of them the process is killed."""
    if entry.recording_id in KILLED_AT:
        os.kill(os.getpid(), signal.SIGKILL)
    LOADED.append(entry.recording_id)
    noise = np.random.default_rng(entry.repetition).normal(size=300)
    return Recording(noise, 1000.0, "g", entry.recording_id, phases=Phases(movement=(0, 300)))


def run(path):
    entries = tuple(Entry(f"m_{i}", "m", repetition=i) for i in range(12))
    features = load_feature_set("strese2015").restricted_to(["variance"])
    return extract_table(Dataset("toy", entries, load, "hash"), features, path)


@pytest.fixture
def extract(feature_set, tmp_path):
    """Extract a dataset into a file of this test."""

    def call(dataset, features=feature_set, **options):
        return extract_table(dataset, features, tmp_path / "t.npz", **options)

    return call


def test_table_holds_metadata_features_and_reasons_on_disk_too(toy_dataset, feature_set, extract, tmp_path):
    dataset, calls = toy_dataset(operators=0), []
    table = extract(dataset, progress=lambda *call: calls.append(call))
    assert calls == [(done, 12, "features") for done in range(13)]
    direct = FeatureExtractor(feature_set).fit(dataset).extract(dataset)
    assert list(table.frame.columns) == [*METADATA, *feature_set.column_names]
    assert table.frame["recording_id"].tolist() == [entry.recording_id for entry in dataset.entries]
    np.testing.assert_array_equal(table.values, direct.values)
    assert table.reasons == direct.reasons
    assert table.flags[0] == ("m0_1", "clipped")
    read = read_table(tmp_path / "t.npz")
    pd.testing.assert_frame_equal(read.frame, table.frame)
    for fact in ("columns", "reasons", "flags", "key"):
        assert getattr(read, fact) == getattr(table, fact)
    assert read.frame["repetition"].tolist() == [1, 2, 3, 4] * 3
    assert list(tmp_path.glob("*.parts")) == []


def test_labels_stand_between_metadata_and_features_and_cannot_have_their_names(
    toy_dataset, extract, tmp_path
):
    def with_label(name):
        dataset = toy_dataset()
        entries = (replace(one, labels=((name, f"{one.repetition % 2}"),)) for one in dataset.entries)
        return replace(dataset, entries=tuple(entries))

    table = extract(with_label("speed"))
    assert list(table.frame.columns[: len(METADATA) + 1]) == [*METADATA, "speed"]
    assert read_table(tmp_path / "t.npz").frame["speed"].tolist() == ["1", "0"] * 6
    assert "speed" not in table.columns
    with pytest.raises(ValueError, match=r"toy.*: the label 'level' has the name of a feature"):
        extract(with_label("level"))


def test_every_partition_has_the_column_of_a_label_that_few_recordings_have(
    toy_dataset, feature_set, tmp_path
):
    dataset = toy_dataset()
    tools = {f"m2_{r}": "steel" for r in (1, 2)}
    entries = (replace(one, labels=(("tool", tools.get(one.recording_id, "")),)) for one in dataset.entries)
    tables.extract_partitions(replace(dataset, entries=tuple(entries)), feature_set, tmp_path / "parts", 4)
    parts = [pd.read_csv(path) for path in sorted((tmp_path / "parts").iterdir())]
    assert len({tuple(part.columns) for part in parts}) == 1
    table = pd.concat(parts).set_index("recording_id")
    assert len(table) == 12
    assert table["tool"].dropna().to_dict() == tools


def _with_axes(numbers):
    """Return a dataset of recordings with such numbers of axes."""

    def load_axes(entry):
        shape = (300, numbers[entry.repetition])
        noise = np.random.default_rng(entry.repetition).normal(size=shape)
        return Recording(noise, 1000.0, "g", entry.recording_id, phases=Phases(movement=(0, 200)))

    entries = tuple(Entry(f"m_{i}", "m", repetition=i) for i in range(len(numbers)))
    return Dataset("toy", entries, load_axes, f"hash {numbers}")


def test_recordings_with_other_axes_are_refused_or_left_out(extract):
    of_variance = load_feature_set("strese2015").restricted_to(["variance"])
    message = r"m_1: 1 axis, but 3 of 4 have 3 axes \(x, y, z\)\. Expected .*--column"
    with pytest.raises(RecordingError, match=message):
        extract(_with_axes([3, 1, 3, 3]), of_variance)
    table = extract(_with_axes([3, 1, 3, 3]), of_variance, skip_bad=True)
    assert table.frame["recording_id"].tolist() == ["m_0", "m_2", "m_3"]
    assert [bad.recording_id for bad in table.left_out] == ["m_1"]
    assert not extract(_with_axes([3, 3]), of_variance).left_out


def _with_copies(labels):
    """Return a dataset whose second recording is a copy of the first."""
    entries = tuple(Entry(f"{m}_{i}", m, repetition=i) for i, m in enumerate(labels))
    whole = _with_axes([1] * len(labels))
    return replace(whole, entries=entries, copies=(entries[:2],), input_hash=f"copies {labels}")


def test_copies_of_a_recording_never_train_and_test():
    of_variance = load_feature_set("strese2015").restricted_to(["variance"])
    for dataset in (_with_copies("aaab"), cut_windows(_with_copies("aaab"), 0.05)):
        table = cached_table(dataset, of_variance)
        assert set(table.frame["recording_id"].str[:3]) == {"a_0", "a_2", "b_3"}
        assert [str(bad) for bad in table.left_out] == ["a_1: same content as 'a_0'"]


def test_copies_with_different_labels_are_an_error_or_left_out():
    of_variance = load_feature_set("strese2015").restricted_to(["variance"])
    message = "different surfaces have the same content: 'a_0' of 'a', 'b_1' of 'b'"
    with pytest.raises(RecordingError, match=message):
        cached_table(_with_copies("abab"), of_variance)
    table = cached_table(_with_copies("abab"), of_variance, skip_bad=True)
    assert table.frame["recording_id"].tolist() == ["a_2", "b_3"]
    assert [bad.recording_id for bad in table.left_out] == ["a_0", "b_1"]


def test_one_line_counts_phases_and_undefined_columns(extract, tmp_path):
    features = load_feature_set("strese2015").restricted_to(["variance", "hardness"])
    table = extract(_with_axes([1, 1, 1]), features)
    assert table.summary == (
        "movement in 0.6 of 0.9 s, taps in 0 of 3 recordings; 1 of 2 columns without any value: no tap found"
    )
    assert read_table(tmp_path / "t.npz").summary == table.summary


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_after_kill_9_nothing_is_lost_and_nothing_computed_twice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    killed = get_context("fork").Process(target=run, args=("t.npz",))
    killed.start()
    killed.join()
    assert killed.exitcode == -signal.SIGKILL
    assert len(list(tmp_path.glob("t.npz.parts/*/*.json"))) == 7
    KILLED_AT.clear()
    table = run("t.npz")
    assert [f"m_{i}" for i in range(7, 12)] == LOADED
    pd.testing.assert_frame_equal(table.frame, run("whole.npz").frame)


def test_a_complete_table_is_only_read(toy_dataset, feature_set):
    first, second_table = cached_table(toy_dataset(), feature_set), toy_dataset()
    assert cached_table(second_table, feature_set).frame.equals(first.frame)
    assert second_table.load.loaded == []


def test_whatever_values_depend_on_makes_a_new_table(toy_dataset, feature_set, extract):
    few = feature_set.restricted_to(["level"])
    for other, options in (
        (toy_dataset(input_hash="other"), {}),
        (toy_dataset(), {"features": few}),
        (toy_dataset(), {"channels": "each"}),
    ):
        extract(toy_dataset())
        extract(other, **options)
        assert len(other.load.loaded) >= len(other)


def test_a_bad_recording_raises_an_error_with_file_and_value_or_is_left_out(toy_dataset, extract):
    dataset = toy_dataset(bad=("m1_1", "m2_2"))
    with pytest.raises(RecordingError, match=r"m1_1\.txt: value 'x' in line 3. Expected numbers"):
        extract(dataset)
    table = extract(dataset, skip_bad=True)
    assert len(dataset.load.loaded) == table.n_recordings == 10  # what was done before is kept
    assert [bad.recording_id for bad in table.left_out] == ["m1_1", "m2_2"]
    with pytest.raises(RecordingError, match="m1_1"):
        extract(dataset)


def test_nothing_usable_is_an_error(toy_dataset, extract):
    for channels in ("combine", "auto"):
        with pytest.raises(RecordingError, match="toy: no recording can be used"):
            extract(toy_dataset(1, 2, bad=("m0_1", "m0_2")), channels=channels, skip_bad=True)


def test_a_file_that_is_no_table_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", values=np.zeros((1, 1)))
    (tmp_path / "b.npz").write_text("rubbish")
    for name in ("a", "b"):
        with pytest.raises(ValueError, match=rf"{name}\.npz: not a feature table"):
            read_table(tmp_path / f"{name}.npz")


def test_separate_tables_are_merged_and_only_the_new_one_is_computed(toy_dataset, feature_set):
    old, new = feature_set.restricted_to(["level", "knock", "rarely"]), feature_set.restricted_to(["peaks"])
    whole, dataset = cached_table(toy_dataset(), feature_set), toy_dataset()
    cached_table(toy_dataset(), old)
    merged_table = cached_table(dataset, old, new)
    assert len(dataset.load.loaded) == len(dataset)
    assert merged_table.columns == ("level", "knock", "rarely", "peaks.second", "peaks.first")
    np.testing.assert_array_equal(merged_table.select(whole.columns), whole.values)
    assert list(merged_table.frame["recording_id"]) == list(whole.frame["recording_id"])
    assert sorted(merged_table.reasons) == sorted(whole.reasons)
    assert merged_table.flags == whole.flags
    assert merged_table.ms.shape == whole.ms.shape
    spoilt = cached_table(toy_dataset(bad=("m1_3",), input_hash="spoilt"), old, new, skip_bad=True)
    assert ([item.recording_id for item in spoilt.left_out], spoilt.n_recordings) == (["m1_3"], 11)


def test_a_channel_with_a_slash_in_its_name_keeps_its_features_and_reasons():
    reason = Reason("r", "force/left/hardness", "no tap")
    frame = pd.DataFrame({"force/left/mfcc.m1": [1.0], "mfcc.m1": [2.0]})
    table = FeatureTable(frame, tuple(frame.columns), np.zeros(1), (reason,))
    assert table.match_columns(["mfcc.m1"]) == ("force/left/mfcc.m1", "mfcc.m1")
    assert table.reason_of("hardness") == "no tap"
    columns = tuple(f"{channel}/level.segment{i}" for channel in "xy" for i in (1, 2))
    pieces = FeatureTable(pd.DataFrame([[1.0] * 4], columns=columns), columns, np.zeros(1))
    assert (
        pieces.match_columns(["level.segment1", "level.segment2"]) == columns
    )  # those of a channel together


def test_parts_that_a_second_process_took_away_cost_no_recording(toy_dataset, tmp_path, monkeypatch):
    data, path = toy_dataset(2, 3), tmp_path / "t.npz"
    features = load_feature_set("strese2015").restricted_to(["variance"])
    whole = extract_table(data, features, path)
    path.unlink()
    merged_table = tables._join

    def after_the_other(dataset, plan, folder, *others):
        finished = path.is_file()
        for part in () if finished else sorted(folder.iterdir())[::2]:  # the other took half of the parts
            part.unlink()
        columns_of_table = merged_table(dataset, plan, folder, *others)
        if not finished:
            tables.write_table(whole, path)
        return columns_of_table

    monkeypatch.setattr(tables, "_join", after_the_other)
    pd.testing.assert_frame_equal(extract_table(data, features, path).frame, whole.frame)


def test_partitions_hold_together_what_one_table_holds_and_go_on_where_a_run_ended(
    toy_dataset, feature_set, extract, tmp_path
):
    whole, dataset, folder = extract(toy_dataset()), toy_dataset(), tmp_path / "parts"
    messages = tables.extract_partitions(dataset, feature_set, folder, 5)
    assert messages["recordings"].to_dict() == {f"{i:09d}.csv": n for i, n in ((0, 5), (5, 5), (10, 2))}
    parts = pd.concat([pd.read_csv(folder / name) for name in messages.index], ignore_index=True)
    np.testing.assert_array_equal(parts[list(whole.columns)], whole.values)
    assert sorted(p.name for p in folder.iterdir()) == list(messages.index)

    (folder / "000000005.csv").unlink()
    next(cache_root().glob("features/*.npz")).unlink()
    second_table = toy_dataset()
    pd.testing.assert_frame_equal(tables.extract_partitions(second_table, feature_set, folder, 5), messages)
    assert len(second_table.load.loaded) in {2, 5}  # the recordings of one file

    if find_spec("pyarrow"):  # the extra `parquet`
        tables.extract_partitions(dataset, feature_set, tmp_path / "other", 5, suffix=".parquet")
        pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "other")[list(whole.frame)], whole.frame)
    with pytest.raises(ValueError, match=r"the suffix is '\.txt'\. Expected \.csv or \.parquet"):
        tables.extract_partitions(dataset, feature_set, folder, 5, suffix=".txt")

    bad = toy_dataset(bad=("m2_4",), input_hash="other")
    with pytest.raises(RecordingError, match=r"m2_4\.txt"):
        tables.extract_partitions(bad, feature_set, folder, 5)
    left_out = tables.extract_partitions(bad, feature_set, folder, 5, skip_bad=True)["left_out"]
    assert [item.recording_id for items in left_out for item in items] == ["m2_4"]
    with pytest.raises(ValueError, match=r"size must be at least 1 recording, got 0"):
        tables.extract_partitions(bad, feature_set, folder, 0)


def test_notes_of_a_dataset_are_told_whether_it_becomes_one_file_or_several(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for name in ("wood", "steel"):
        (tmp_path / "felt" / name).mkdir(parents=True)
        np.savetxt(tmp_path / "felt" / name / "0.csv", rng.standard_normal(1000))
    (tmp_path / "felt" / "wood" / "0.exe").touch()
    read = ("felt", "--fs", 1000, "--unit", "g", "--jobs", 1, "--features", "coarse")
    for options in (("-o", "table.csv"), ("-o", "parts", "--partition", 1)):
        code, out, err = command("extract", *read, *options)
        assert code == 0, err
        assert out.count("note: 1 file of other formats ignored") == 1


@pytest.mark.parametrize(
    "changed",
    [
        {"code_hash": lambda feature_set: "edited"},
        {"__version__": "0.0.0"},
    ],
    ids=list,
)
def test_edited_code_and_another_version_make_a_new_table(toy_dataset, feature_set, monkeypatch, changed):
    cached_table(toy_dataset(), feature_set)
    for name, value in changed.items():
        monkeypatch.setattr(tables, name, value)
    second_table = toy_dataset()
    cached_table(second_table, feature_set)
    assert len(second_table.load.loaded) >= len(second_table)


def test_the_key_depends_on_each_fact_of_an_entry_and_of_the_set(toy_dataset, feature_set):
    dataset = toy_dataset()
    first, *rest = dataset.entries
    relabelled = replace(dataset, entries=(replace(first, surface="other"), *rest))
    keys = [
        table_key(dataset, feature_set, "combine"),
        table_key(relabelled, feature_set, "combine"),
        table_key(replace(dataset, entries=tuple(rest)), feature_set, "combine"),
        table_key(dataset, feature_set.restricted_to(["level"]), "combine"),
        table_key(dataset, feature_set, "each"),
    ]
    assert len(set(keys)) == len(keys)
    assert table_key(toy_dataset(), feature_set, "combine") == keys[0]
