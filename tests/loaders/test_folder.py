import pickle

import numpy as np
import pytest

from texclass.loaders import open_dataset
from texclass.recording import RecordingError

FS = 10_000.0


@pytest.fixture
def folder(tmp_path, axes, write):
    """Two materials, recordings 1, 2 and 10 of each."""
    for number, material in enumerate(("wood", "steel"), start=1):
        (tmp_path / "mine" / material).mkdir(parents=True)
        for repetition in (1, 2, 10):
            write(tmp_path / "mine" / material / f"r{repetition}.csv", axes + number * repetition)
    return tmp_path / "mine"


def test_subfolders_are_materials_and_files_recordings(folder, axes):
    dataset = open_dataset(folder, fs=FS, unit="g")
    assert (dataset.name, len(dataset), dataset.materials) == ("mine", 6, ("steel", "wood"))
    assert [entry.recording_id for entry in dataset.entries[:3]] == ["steel/r1", "steel/r2", "steel/r10"]
    recording = dataset[1]
    assert (recording.material, recording.fs, recording.phases) == ("steel", FS, None)
    np.testing.assert_allclose(recording.acceleration, (axes + 4) * 9.80665)


def test_opening_reads_no_recording_and_a_bad_one_is_bad_only_when_loaded(folder):
    (folder / "wood" / "r2.csv").write_text("ax,ay,az\n1,2,x\n")
    dataset = open_dataset(folder, fs=FS, unit="g")
    assert len(dataset) == 6
    with pytest.raises(RecordingError, match=r"wood/r2\.csv"):
        list(dataset)


def test_skip_bad_goes_on_and_says_what_was_left_out(folder):
    (folder / "wood" / "r2.csv").write_text("ax,ay,az\n1,2,x\n")
    results = dict(open_dataset(folder, fs=FS, unit="g", skip_bad=True).attempts())
    bad = {entry.recording_id: error for entry, error in results.items() if isinstance(error, RecordingError)}
    assert list(bad) == ["wood/r2"]
    assert "Row #2" in str(bad["wood/r2"])
    assert len(results) == 6


def test_without_skip_bad_an_attempt_raises(folder):
    (folder / "wood" / "r2.csv").write_text("")
    with pytest.raises(RecordingError, match="is empty"):
        list(open_dataset(folder, fs=FS, unit="g").attempts())


def test_missing_facts_are_asked_for(folder):
    with pytest.raises(RecordingError, match="unit is missing"):
        open_dataset(folder, fs=FS)
    with pytest.raises(RecordingError, match="fs is missing"):
        open_dataset(folder, unit="g")


def test_a_rate_stated_by_the_files_is_used_and_must_be_one(tmp_path, axes):
    for material, fs in (("a", 1000), ("b", 1000), ("c", 2000)):
        (tmp_path / material).mkdir()
        np.savez(tmp_path / material / "r.npz", acceleration=axes, fs=fs)
    dataset = open_dataset(tmp_path, unit="g")
    assert dataset[1].fs == 1000
    with pytest.raises(RecordingError, match=r"c/r\.npz: fs is 2000 Hz there, 1000 Hz was given"):
        dataset[2]


def test_the_same_recording_in_two_formats_is_a_duplicate_id(folder, axes, write):
    write(folder / "wood" / "r1.npz", axes)
    with pytest.raises(RecordingError, match=r"'wood/r1' occurs twice \(wood/r1.csv, wood/r1.npz\)"):
        open_dataset(folder, fs=FS, unit="g")


@pytest.mark.parametrize("content", [None, "wood/readme.md", "r.csv"])
def test_a_folder_without_recordings_is_refused(tmp_path, content):
    if content:
        (tmp_path / "wood").mkdir()
        (tmp_path / content).write_text("a\n1\n")
    with pytest.raises(RecordingError, match="holds no recording; the rule is one subfolder per material"):
        open_dataset(tmp_path, fs=FS, unit="g")


def test_axes_join_and_stay_apart_from_recordings_without_axes(tmp_path, axes):
    (tmp_path / "wood").mkdir()
    for axis, column in zip("XYZ", axes.T, strict=True):
        np.savetxt(tmp_path / "wood" / f"one_{axis}_train.txt", column)
    np.savetxt(tmp_path / "wood" / "two.txt", axes[:, 0])
    dataset = open_dataset(tmp_path, fs=FS, unit="counts")
    assert [entry.recording_id for entry in dataset.entries] == ["wood/one_train", "wood/two"]
    np.testing.assert_array_equal(dataset[0].acceleration, axes)
    assert dataset[1].acceleration.ndim == 1


def test_files_that_are_no_recordings_are_counted(folder):
    (folder / "wood" / "photo.jpg").touch()
    assert open_dataset(folder, fs=FS, unit="g").notes == ("1 files of other kinds are ignored",)


def test_a_dataset_survives_pickling_for_parallel_work(folder):
    dataset = open_dataset(folder, fs=FS, unit="g")
    again = pickle.loads(pickle.dumps(dataset))
    np.testing.assert_array_equal(again[3].acceleration, dataset[3].acceleration)


def test_the_hash_changes_with_content_names_and_facts_only(folder, axes, write):
    first = open_dataset(folder, fs=FS, unit="g").input_hash
    assert open_dataset(folder, fs=FS, unit="g").input_hash == first
    assert open_dataset(folder, fs=FS, unit="mg").input_hash != first
    write(folder / "wood" / "r1.csv", axes + 100)
    second = open_dataset(folder, fs=FS, unit="g").input_hash
    (folder / "wood" / "r1.csv").rename(folder / "wood" / "r7.csv")
    assert len({first, second, open_dataset(folder, fs=FS, unit="g").input_hash}) == 3


def test_a_folder_named_from_here_is_found_from_elsewhere(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dataset = open_dataset("mine", fs=FS, unit="g")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert dataset[0].material == "steel"
