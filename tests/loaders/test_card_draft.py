"""A drafted card opens its folder; facts that the files do not state become questions."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from texclass.loaders import CardError, draft_card, open_dataset
from texclass.loaders.card_draft import QUESTION
from texclass.recording import RecordingError

RNG_SEED = 7
FOUR = {("oak", 1), ("oak", 2), ("wool", 1), ("wool", 2)}


def write(path, n=400, level=(0.0,), header="", times_s=None):
    """Write a CSV of noise about a level, with a column of times if there are any."""
    rng = np.random.default_rng([RNG_SEED, *path.name.encode()])
    columns = rng.normal(level, 0.01, (n, len(level)))
    if times_s is not None:
        columns = np.column_stack([times_s, columns])
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.6f")


def draft_and_open(folder, card, **options):
    """Write a card of a folder; return the dataset of the card, and its questions."""
    text = draft_card(folder, card.parent, **options)
    card.write_text(text, encoding="utf-8")
    questions = [line for line in text.splitlines() if line.startswith(QUESTION)]
    return open_dataset(card), questions


def groups(dataset):
    return {(entry.surface, entry.session, entry.repetition) for entry in dataset.entries}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["oak/oak_01", "oak/oak_02", "wool/w_1", "wool/w_2"], FOUR),
        (["oak_01", "oak_02", "wool_01", "wool_02"], FOUR),
        (["oak1", "oak2", "wool1", "wool2"], FOUR),
        (["soft wool-run1", "soft wool-run2", "p80-run1", "p80-run2"],
         {("soft wool", 1), ("soft wool", 2), ("p80", 1), ("p80", 2)}),
        (["data/oak/a", "data/oak/b", "data/wool/c", "data/wool/d"], {("oak", None), ("wool", None)}),
    ],
)  # fmt: skip
def test_surfaces_and_repetitions_are_read_from_subfolders_and_names(tmp_path, names, expected):
    for name in names:
        write(tmp_path / "own" / f"{name}.csv")
    dataset, questions = draft_and_open(tmp_path / "own", tmp_path / "own.toml", fs=1000.0, unit="g")
    assert {(surface, repetition) for surface, _, repetition in groups(dataset)} == expected
    assert (len(dataset), dataset[0].n_samples, dataset[0].fs, dataset[0].unit) == (4, 400, 1000.0, "m/s^2")
    assert questions == []
    assert "folder = 'own'" in (tmp_path / "own.toml").read_text()


@pytest.mark.parametrize(
    "name",
    [
        "{surface}/day{session}/{n}.csv",
        "session{session}/{surface}/{n}.csv",
        "{surface}_s{session}_{n}.csv",
    ],
)
def test_sessions_are_read_from_folders_and_names(tmp_path, name):
    for surface in ("oak", "wool"):
        for session in (1, 2):
            for n in (1, 2):
                write(tmp_path / "own" / name.format(surface=surface, session=session, n=n))
    dataset, questions = draft_and_open(tmp_path / "own", tmp_path / "own.toml", fs=1000.0, unit="g")
    assert dataset.surfaces == ("oak", "wool")
    assert len({session for _, session, _ in groups(dataset)}) == 2
    assert {repetition for *_, repetition in groups(dataset)} == {1, 2}
    assert (len(dataset), questions) == (8, [])


def test_a_card_inside_its_folder_names_no_folder(tmp_path):
    for name in ("oak_1", "oak_2", "wool_1", "wool_2"):
        write(tmp_path / f"{name}.csv")
    dataset, _ = draft_and_open(tmp_path, tmp_path / "card.toml", fs=1000.0, unit="g")
    assert dataset.surfaces == ("oak", "wool")
    assert "\nfolder" not in (tmp_path / "card.toml").read_text()


def test_columns_rate_and_unit_are_read_from_the_files(tmp_path):
    times = np.arange(400) / 200
    for surface in ("oak", "wool"):
        for n in (1, 2):
            path = tmp_path / "own" / f"{surface}_{n}.csv"
            write(path, level=(0, 0, 9.81, 0, 0, 0), header="time,ax,ay,az,gx,gy,gz", times_s=times)
    dataset, questions = draft_and_open(tmp_path / "own", tmp_path / "own.toml")
    recording = dataset[0]
    assert (recording.fs, recording.unit, recording.channels) == (200.0, "m/s^2", ("ax", "ay", "az"))
    assert recording.turn_rate.shape == (400, 3)
    assert questions == []


def test_whole_numbers_are_counts_and_one_file_per_axis_is_one_recording(tmp_path):
    for surface in ("oak", "wool"):
        for n in (1, 2):
            for axis in "XYZ":
                codes = np.random.default_rng([n, ord(axis)]).integers(-900, 900, 400)
                np.savetxt(tmp_path / f"{surface}_{n}_{axis}.txt", codes, fmt="%d")
    dataset, questions = draft_and_open(tmp_path, tmp_path / "card.toml", fs=500.0)
    assert (len(dataset), dataset[0].unit, dataset[0].acceleration.shape) == (4, "counts", (400, 3))
    assert questions == []


def test_unknown_rate_unit_and_columns_are_questions(tmp_path):
    for name in ("oak/1", "oak/2", "wool/1", "wool/2"):
        write(tmp_path / "own" / f"{name}.csv", level=(0.0, 1.0, 2.0), header="p,q,r")
    write(tmp_path / "own" / "labels.csv")
    text = draft_card(tmp_path / "own", tmp_path)
    questions = " ".join(line for line in text.splitlines() if line.startswith(QUESTION))
    for subject in ("sampling rate", "unit of the acceleration", "which columns"):
        assert subject in questions
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(CardError, match="missing key fs_hz"):
        open_dataset(tmp_path / "own.toml")
    (tmp_path / "own.toml").write_text(text.replace("# fs_hz", "fs_hz"))
    assert open_dataset(tmp_path / "own.toml")[0].acceleration.shape == (400, 3)


def test_left_out_unreadable_and_single_files_are_questions(tmp_path):
    for name in ("oak_1", "oak_2", "wool_1", "reference"):
        write(tmp_path / f"{name}.csv")
    (tmp_path / "wool_2.csv").write_text("x,y,z\n1,oops,3\n")
    text = draft_card(tmp_path, tmp_path, fs=1000.0, unit="g")
    questions = " ".join(line for line in text.splitlines() if line.startswith(QUESTION))
    assert "1 file left out, for example reference.csv" in questions
    assert "1 of 4 files cannot be read" in questions
    assert "wool_2.csv" in questions


def test_files_of_several_rates_are_resampled_to_the_lowest_and_reported(tmp_path):
    for k, name in enumerate(("oak_1", "oak_2", "wool_1", "wool_2")):
        soundfile.write(tmp_path / f"{name}.wav", 0.1 * np.sin(np.arange(4000) / 9), (8000, 16000)[k == 3])
    dataset, questions = draft_and_open(tmp_path, tmp_path / "card.toml")
    assert {recording.fs for recording in dataset} == {8000.0}
    assert "several rates (8000, 16000 Hz)" in " ".join(questions)


def test_one_folder_per_recording_with_a_file_per_sensor_takes_the_accelerometer(tmp_path):
    for surface in ("oak", "wool"):
        for n in (1, 2):
            for sensor in ("Accelerometer", "Gyroscope"):
                path = tmp_path / "own" / surface / f"rec{n}" / f"{sensor}.csv"
                write(path, level=(0, 0, 1.0), header="seconds_elapsed,x,y,z", times_s=np.arange(400) / 100)
    dataset, _ = draft_and_open(tmp_path / "own", tmp_path / "own.toml")
    assert (len(dataset), dataset.surfaces) == (4, ("oak", "wool"))
    assert all(entry.paths[0].endswith("Accelerometer.csv") for entry in dataset.entries)


def test_names_with_quotes_and_patterns_stay_valid_toml(tmp_path):
    for name in ("it's [1]/a_1", "it's [1]/a_2", "b+/a_1", "b+/a_2"):
        write(tmp_path / "o'wn" / f"{name}.csv", header="a'c")
    dataset, _ = draft_and_open(tmp_path / "o'wn", tmp_path / "own.toml", fs=1000.0, unit="g")
    assert dataset.surfaces == ("b+", "it's [1]")
    assert dataset[0].n_samples == 400


def test_a_folder_without_recordings_and_a_file_are_refused(tmp_path):
    (tmp_path / "notes.md").write_text("")
    with pytest.raises(RecordingError, match="contains no file of a known format"):
        draft_card(tmp_path, tmp_path)
    with pytest.raises(RecordingError, match="is not a folder"):
        draft_card(tmp_path / "notes.md", tmp_path)


def test_the_command_writes_a_card_that_benchmark_reads(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for surface in ("oak", "wool"):
        for n in range(6):
            write(tmp_path / "own" / f"{surface}_{n}.csv", n=3000)
    code, _, err = command("benchmark", "own", "--fs", "1000", "--unit", "g")
    assert code == 1
    assert "texclass card own -o card.toml" in err
    (tmp_path / "rateless" / "oak").mkdir(parents=True)
    write(tmp_path / "rateless" / "oak" / "1.csv")
    code, _, err = command("benchmark", "rateless", "--unit", "g")
    assert "fs is missing" in err
    assert "texclass card rateless -o card.toml" in err
    code, out, err = command("card", "own", "--unit", "g", "-o", "own.toml")
    assert (code, err) == (0, "")
    assert "question: what is the sampling rate" in out
    code, _, err = command("card", "own", "-o", "own.toml")
    assert code == 1
    assert "own.toml already exists" in err
    code, out, err = command("card", "own", "--unit", "g", "--fs", "1000", "-o", "new.toml")
    assert (code, err, "question" in out) == (0, "", False)
    arguments = (
        "benchmark new.toml --folds 2 --jobs 1 -o results --json result.json --confusion confusion.csv"
    )
    code, _, err = command(*arguments.split())
    assert code == 0, err
    assert json.loads(Path("result.json").read_text(encoding="utf-8"))["dataset"]["n_recordings"] == 12
    assert Path("confusion.csv").read_text(encoding="utf-8").startswith("true label,oak,wool\n")


@pytest.mark.parametrize(
    ("name", "options", "n_recordings", "n_surfaces"),
    [
        ("knocks30", {}, 30, 3), ("biotac20", {"unit": "counts"}, 800, 20), ("borealtc", {}, 68, 5),
        ("dogsurf", {"fs": 50.0}, 45, 5), ("floors10", {"fs": 100.0, "unit": "m/s^2"}, 349, 10),
        ("fabric_speeds", {}, 16, 4), ("lmt_excerpts", {}, 10, 9),
        ("stylus6", {"fs": 1000.0, "unit": "m/s^2"}, 6, 6),
    ],
)  # fmt: skip
def test_public_folders_get_a_card_that_opens(tmp_path, data_root, name, options, n_recordings, n_surfaces):
    if not (data_root / name).is_dir():
        pytest.skip(f"no recordings of {name} in {data_root}")
    dataset, _ = draft_and_open(data_root / name, tmp_path / "card.toml", **options)
    assert (len(dataset), len(dataset.surfaces)) == (n_recordings, n_surfaces)
    assert dataset[0].n_samples > 100
    assert dataset[-1].fs == dataset[0].fs
