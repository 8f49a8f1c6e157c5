"""Feature tables: nothing lost by a kill, nothing computed twice, bad recordings named."""

import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

from texclass.experiment.feature_table import METADATA, cached_table, extract_table, read_table
from texclass.features.extractor import FeatureExtractor
from texclass.recording import RecordingError


def test_table_holds_metadata_features_and_reasons(toy_dataset, feature_set, tmp_path):
    dataset = toy_dataset()
    table = extract_table(dataset, feature_set, tmp_path / "t.parquet")
    direct = FeatureExtractor(feature_set).fit(dataset).extract(dataset)
    assert list(table.frame.columns) == [*METADATA, *feature_set.column_names]
    assert table.frame["recording_id"].tolist() == [entry.recording_id for entry in dataset.entries]
    np.testing.assert_array_equal(table.values, direct.values)
    assert table.reasons == direct.reasons
    assert table.flags[0] == ("m0_1", "clipped")


def test_table_survives_the_disk_and_is_plain_parquet(toy_dataset, feature_set, tmp_path):
    written = extract_table(toy_dataset(operators=0), feature_set, tmp_path / "t.parquet")
    read = read_table(tmp_path / "t.parquet")
    pd.testing.assert_frame_equal(read.frame, written.frame)
    assert (read.columns, read.reasons, read.flags, read.key) == (
        written.columns,
        written.reasons,
        written.flags,
        written.key,
    )
    assert pd.read_parquet(tmp_path / "t.parquet")["repetition"].tolist() == [1, 2, 3, 4] * 3
    assert list(tmp_path.glob("*.parts")) == []


def test_a_killed_run_continues_where_it_stopped(toy_dataset, feature_set, tmp_path):
    killed = toy_dataset(killed_at="m1_2")
    with pytest.raises(KeyboardInterrupt):
        extract_table(killed, feature_set, tmp_path / "t.parquet")
    resumed = toy_dataset()
    table = extract_table(resumed, feature_set, tmp_path / "t.parquet")
    done, rest = killed.load.loaded, resumed.load.loaded
    assert len(done) == 5
    assert sorted(done + rest) == sorted(entry.recording_id for entry in resumed.entries)
    whole = extract_table(toy_dataset(), feature_set, tmp_path / "other.parquet")
    pd.testing.assert_frame_equal(table.frame, whole.frame)


JOB = """
import os, time
import numpy as np
from texclass.experiment.feature_table import extract_table
from texclass.features import load_feature_set
from texclass.loaders.dataset import Dataset, Entry
from texclass.recording import Phases, Recording

def load(entry):
    with open("log", "a") as file:
        file.write(entry.recording_id + "\\n")
    time.sleep(0.02)
    signal = np.random.default_rng(entry.repetition).normal(size=300)
    return Recording(signal, 1000.0, "g", entry.recording_id, phases=Phases(movement=(0, 300)))

def run(path):
    entries = tuple(Entry(f"m_{i}", "m", repetition=i) for i in range(40))
    features = load_feature_set("strese2015").restricted_to(["variance"])
    return extract_table(Dataset("toy", entries, load, "hash"), features, path)
"""


def test_after_kill_9_nothing_is_lost_and_nothing_computed_twice(tmp_path, monkeypatch):
    (tmp_path / "job.py").write_text(JOB)
    (tmp_path / "log").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    process = subprocess.Popen([sys.executable, "-c", "import job; job.run('t.parquet')"])
    while len((tmp_path / "log").read_text().split()) < 10 and process.poll() is None:
        time.sleep(0.005)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    kept = {part: part.stat().st_mtime_ns for part in tmp_path.glob("t.parquet.parts/*/0*.json")}
    started = (tmp_path / "log").read_text().split()
    assert len(started) - 1 <= len(kept) <= len(started) < 40  # one may have been under way

    import job

    (tmp_path / "log").write_text("")
    table = job.run("t.parquet")
    again = (tmp_path / "log").read_text().split()
    assert len(again) == 40 - len(kept)
    assert not {f"m_{int(part.stem)}" for part in kept} & set(again)
    pd.testing.assert_frame_equal(table.frame, job.run("whole.parquet").frame)


def test_a_complete_table_is_only_read(toy_dataset, feature_set):
    first = cached_table(toy_dataset(), feature_set)
    again = toy_dataset()
    assert cached_table(again, feature_set).frame.equals(first.frame)
    assert again.load.loaded == []


@pytest.mark.parametrize("change", ["input", "features", "channels"])
def test_whatever_values_depend_on_makes_a_new_table(toy_dataset, feature_set, tmp_path, change):
    path = tmp_path / "t.parquet"
    extract_table(toy_dataset(), feature_set, path)
    dataset = toy_dataset(input_hash="other" if change == "input" else "toy")
    features = feature_set.restricted_to(["level"]) if change == "features" else feature_set
    extract_table(dataset, features, path, channels="each" if change == "channels" else "combine")
    assert len(dataset.load.loaded) >= len(dataset)


def test_a_bad_recording_stops_with_file_value_and_rule_and_keeps_the_rest(
    toy_dataset, feature_set, tmp_path
):
    dataset = toy_dataset(bad=("m1_1",))
    with pytest.raises(RecordingError, match=r"m1_1\.txt: value 'x' in line 3; the rule is numbers"):
        extract_table(dataset, feature_set, tmp_path / "t.parquet")
    repaired = toy_dataset()
    extract_table(repaired, feature_set, tmp_path / "t.parquet")
    assert not set(dataset.load.loaded) & set(repaired.load.loaded)


def test_skip_bad_lists_what_was_left_out(toy_dataset, feature_set, tmp_path):
    dataset = toy_dataset(bad=("m1_1", "m2_2"))
    table = extract_table(dataset, feature_set, tmp_path / "t.parquet", skip_bad=True)
    assert table.n_recordings == len(dataset) - 2
    assert [bad.recording_id for bad in table.left_out] == ["m1_1", "m2_2"]
    with pytest.raises(RecordingError, match="m1_1"):
        extract_table(dataset, feature_set, tmp_path / "t.parquet")


@pytest.mark.parametrize("channels", ["combine", "auto"])
def test_nothing_usable_is_an_error(toy_dataset, feature_set, tmp_path, channels):
    dataset = toy_dataset(1, 2, bad=("m0_1", "m0_2"))
    with pytest.raises(RecordingError, match="toy: no recording can be used"):
        extract_table(dataset, feature_set, tmp_path / "t.parquet", channels=channels, skip_bad=True)


def test_progress_counts_to_the_total(toy_dataset, feature_set, tmp_path):
    calls = []
    extract_table(
        toy_dataset(), feature_set, tmp_path / "t.parquet", progress=lambda *call: calls.append(call)
    )
    assert calls == [(done, 12, "features") for done in range(13)]


def test_a_file_that_is_no_table_is_named(tmp_path):
    pd.DataFrame({"a": [1]}).to_parquet(tmp_path / "a.parquet")
    (tmp_path / "b.parquet").write_text("rubbish")
    for name in ("a", "b"):
        with pytest.raises(ValueError, match=rf"{name}\.parquet: not a feature table"):
            read_table(tmp_path / f"{name}.parquet")


@pytest.fixture
def parts(feature_set):
    return feature_set.restricted_to(["level", "knock", "rarely"]), feature_set.restricted_to(["peaks"])


def test_joined_tables_hold_what_one_table_holds(toy_dataset, feature_set, parts):
    whole, joined = cached_table(toy_dataset(), feature_set), cached_table(toy_dataset(), *parts)
    assert joined.columns == ("level", "knock", "rarely", "peaks.second", "peaks.first")
    np.testing.assert_array_equal(joined.frame[list(whole.columns)], whole.values)
    assert list(joined.frame["recording_id"]) == list(whole.frame["recording_id"])
    assert sorted(joined.reasons) == sorted(whole.reasons)
    assert joined.flags == whole.flags
    assert joined.ms.shape == whole.ms.shape


def test_only_the_part_that_is_new_is_computed(toy_dataset, parts):
    cached_table(toy_dataset(), parts[0])
    dataset = toy_dataset()
    cached_table(dataset, *parts)
    assert len(dataset.load.loaded) == len(dataset)
    cached_table(dataset, *parts)
    assert len(dataset.load.loaded) == len(dataset)


def test_a_bad_recording_is_left_out_once(toy_dataset, parts):
    joined = cached_table(toy_dataset(bad=("m1_3",)), *parts, skip_bad=True)
    assert [item.recording_id for item in joined.left_out] == ["m1_3"]
    assert joined.n_recordings == 11
