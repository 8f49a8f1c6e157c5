"""Phases that a user marked replace the detection, in every way to load a recording."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texclass.loaders import find_recording, load_recording, open_dataset
from texclass.loaders.phases_files import PhasesFile, find_phases_file, is_marked, phases_path, split_part
from texclass.phases import find_phases
from texclass.recording import Phases, RecordingError, Tap
from texclass.simulate.recipe import Recipe

FS = 1000.0
READING = {"fs": FS, "unit": "m/s^2"}
MARKED = {
    "format": "texclass phases", "version": 1, "recording": "oak_1.txt", "duration_s": 4.0, "fs_hz": FS,
    "taps": [{"start_s": 0.1, "impact_s": 0.2, "end_s": 0.3}],
    "movement": [{"start_s": 1.0, "end_s": 3.5}],
}  # fmt: skip
PHASES = Phases((Tap(100, 200, 300),), (1000, 3500), 1000)
TWO = [{"start_s": 0.0, "end_s": 2.0, "surface": "oak"}, {"start_s": 2.0, "end_s": 4.0, "surface": "cork"}]


@pytest.fixture
def folder(tmp_path):
    """Give a folder with two surfaces, and a phases file for the first recording."""
    rng = np.random.default_rng(0)
    for surface in ("oak", "cork"):
        (tmp_path / "recs" / surface).mkdir(parents=True)
        for k in (1, 2):
            np.savetxt(tmp_path / "recs" / surface / f"{surface}_{k}.txt", rng.standard_normal(4000))
    mark(tmp_path / "recs/oak/oak_1.phases.json")
    return tmp_path / "recs"


def mark(path, **changes):
    path.write_text(json.dumps(MARKED | changes), encoding="utf-8")


def phases_of(recording):
    assert is_marked(recording)
    return replace(find_phases(recording), notes=())


def test_files_folders_and_cards_use_the_phases_and_say_so(folder):
    file = folder / "oak/oak_1.txt"
    assert phases_of(load_recording(file, **READING)) == PHASES
    assert load_recording(file, **READING).phases.notes == ("phases from oak_1.phases.json, not detected",)
    assert not is_marked(load_recording(folder / "oak/oak_2.txt", **READING))
    dataset = open_dataset(folder, **READING)
    assert len(dataset) == 4
    assert dataset.notes == ("phases of 1 file from NAME.phases.json, not detected",)
    assert [is_marked(one) for one in dataset] == [False, False, True, False]
    card = folder / "card.toml"
    card.write_text(
        f'fs_hz = {FS}\nunit = "m/s^2"\nphases = "movement"\nfiles = "(?P<surface>[a-z]+)/.+"\n',
        encoding="utf-8",
    )
    assert phases_of(find_recording(f"{card}:oak/oak_1")) == PHASES
    assert find_recording(f"{card}:oak/oak_2").phases.movement == (0, 4000)
    assert phases_of(load_recording(file, **READING, resample=500.0)).movement == (500, 1750)


def test_the_hash_of_a_dataset_depends_on_the_phases(folder):
    first = open_dataset(folder, **READING).input_hash
    mark(folder / "oak/oak_1.phases.json", movement=[{"start_s": 1.0, "end_s": 3.4}])
    second = open_dataset(folder, **READING).input_hash
    (folder / "oak/oak_1.phases.json").unlink()
    assert len({first, second, open_dataset(folder, **READING).input_hash}) == 3


def test_a_detected_segmentation_survives_a_round_trip(tmp_path):
    from texclass.loaders.simulated import open_simulated

    recipe = Recipe(n_surfaces=2, n_recordings=2, n_operators=1, duration_s=4.0, fs=10_000.0, seed=3)
    for recording in open_simulated(recipe, name="tiny"):
        path = tmp_path / f"{recording.recording_id}.npy"
        np.save(path, recording.acceleration)
        loaded = load_recording(path, fs=recording.fs, unit="m/s^2")
        phases = find_phases(loaded)
        assert phases.taps
        phases_path(path).write_text(PhasesFile.from_phases(phases, loaded, path).to_json(), encoding="utf-8")
        assert phases_of(load_recording(path, fs=recording.fs, unit="m/s^2")) == replace(phases, notes=())


@pytest.mark.parametrize(
    ("changes", "messages"),
    [
        ({"surface": "oak", "tap": []}, ["unknown key surface", "did you mean surfaces?", "unknown key tap"]),
        ({"version": 2}, ["version is 2"]),
        ({"taps": [{"start_s": 0.1, "impact_s": 0.4, "end_s": 0.3}]}, ["taps.1.impact_s is 0.4", "0.3 s"]),
        ({"taps": [{"start_s": 0.1, "end_s": 0.3}]}, ["missing key taps.1.impact_s"]),
        ({"movement": [{"start_s": 2.0, "end_s": 1.0}]}, ["movement.1.end_s is 1", "after start_s, 2 s"]),
        ({"movement": [{"start_s": -1.0, "end_s": 1.0}]}, ["movement.1.start_s is -1.0"]),
        ({"movement": [{"start_s": 1.0, "end_s": 4.5}]}, ["movement.1.end_s is 4.5", "recording, 4 s"]),
        ({"movement": [{"start_s": 1.0, "end_s": "2"}]}, ["movement.1.end_s is '2'. Expected a number"]),
        (
            {"taps": 2 * [{"start_s": 0.1, "impact_s": 0.2, "end_s": 0.3}]},
            ["taps.2.start_s is 0.1", "end of taps.1, 0.3 s"],
        ),
        (
            {"movement": [{"start_s": 1.0, "end_s": 2.0}, {"start_s": 3.0, "end_s": 4.0}]},
            ["movement has 2 intervals, but surfaces is empty"],
        ),
        (
            {
                "movement": [{"start_s": 0.0, "end_s": 0.5}, {"start_s": 1.0, "end_s": 1.5}],
                "surfaces": TWO,
            },
            ["surfaces.1 contains 2 intervals of movement"],
        ),
        ({"surfaces": [TWO[0] | {"surface": " "}]}, ["surfaces.1.surface is ' '. Expected a name"]),
        (
            {"duration_s": 3.6},
            ["was saved for a recording of 3.6 s at 1000 Hz", "oak_1.txt has 4 s at 1000 Hz"],
        ),
        ({"recording": "ash.txt"}, ["recording is 'ash.txt'", "Expected 'oak_1.txt'"]),
        ({"sha256": 64 * "0"}, ["saved before 'oak_1.txt' changed"]),
    ],
)
def test_invalid_phases_are_an_error_that_names_file_key_and_value(folder, changes, messages):
    mark(folder / "oak/oak_1.phases.json", **changes)
    with pytest.raises(RecordingError) as error:
        load_recording(folder / "oak/oak_1.txt", **READING)
    for message in ["oak_1.phases.json", "Correct or remove this file", *messages]:
        assert message in str(error.value)


def test_skip_bad_leaves_out_a_recording_with_invalid_phases(folder):
    mark(folder / "oak/oak_1.phases.json", version=2)
    with pytest.raises(RecordingError, match="version is 2"):
        open_dataset(folder, **READING)
    dataset = open_dataset(folder, **READING, skip_bad=True)
    assert len(dataset) == 3
    assert any("oak_1.phases.json: version is 2" in note for note in dataset.notes)


def test_garbage_is_an_error(folder):
    file = folder / "oak/oak_1.phases.json"
    for content in (b"", b"[]", b"\xff\xfe", b"[" * 100_000, b"{" + b" " * (1 << 24)):
        file.write_bytes(content)
        with pytest.raises(RecordingError, match=r"oak_1\.phases\.json"):
            find_phases_file(folder / "oak/oak_1.txt")


def test_of_two_recordings_of_one_name_the_phases_belong_to_the_one_they_name(folder):
    file = folder / "oak/oak_1.txt"
    np.savetxt(folder / "oak/oak_1.csv", np.loadtxt(file))
    assert is_marked(load_recording(file, **READING))
    assert not is_marked(load_recording(folder / "oak/oak_1.csv", **READING))


def test_phases_follow_a_renamed_recording_but_not_another_one(folder):
    file, phases = folder / "oak/oak_1.txt", folder / "oak/oak_1.phases.json"
    recording = load_recording(file, **READING)
    phases.write_text(PhasesFile.from_phases(PHASES, recording, file).to_json(), encoding="utf-8")
    file.rename(folder / "oak/oak_9.txt")
    phases.rename(folder / "oak/oak_9.phases.json")
    assert phases_of(load_recording(folder / "oak/oak_9.txt", **READING)) == PHASES
    shutil.copy(folder / "oak/oak_9.phases.json", folder / "cork/cork_1.phases.json")
    with pytest.raises(RecordingError, match=r"saved for 'oak_1.txt': the content of .*cork_1.txt differs"):
        load_recording(folder / "cork/cork_1.txt", **READING)


def test_files_of_axes_and_folders_of_apps_have_one_phases_file(tmp_path):
    samples = np.random.default_rng(0).standard_normal((1000, 3))
    for axis, column in zip("XYZ", samples.T, strict=True):
        np.savetxt(tmp_path / f"oak_{axis}_1.txt", column)
    assert phases_path(tmp_path / "oak_Y_1.txt") == tmp_path / "oak_1.phases.json"
    app = tmp_path / "2024-01-31"
    app.mkdir()
    time = np.arange(1000) / 100
    for name in ("TotalAcceleration", "Gyroscope"):
        table = np.column_stack([time, samples])
        np.savetxt(app / f"{name}.csv", table, delimiter=",", header="seconds_elapsed,x,y,z", comments="")
    for path in (app, app / "TotalAcceleration.csv"):
        assert phases_path(path) == tmp_path / "2024-01-31.phases.json"
    mark(tmp_path / "2024-01-31.phases.json", recording="2024-01-31", duration_s=10.0, fs_hz=100.0)
    recording = load_recording(app, unit="m/s^2", time_column="seconds_elapsed")
    assert phases_of(recording).movement == (100, 350)


def test_marked_surfaces_become_recordings(folder):
    file = folder / "oak/oak_1.txt"
    mark(folder / "oak/oak_1.phases.json", surfaces=TWO)
    dataset = open_dataset(folder, **READING)
    assert dataset.table["surface"].to_dict() == {
        "cork/cork_1": "cork", "cork/cork_2": "cork", "oak/oak_1#1": "oak", "oak/oak_1#2": "cork",
        "oak/oak_2": "oak",
    }  # fmt: skip
    first, second = dataset[2], dataset[3]
    assert phases_of(first) == Phases((Tap(100, 200, 300),), (1000, 2000), 1000)
    assert phases_of(second) == Phases((), (0, 1500))
    assert (first.surface, second.surface) == ("oak", "cork")
    assert second.recording_id == "oak/oak_1#2"
    np.testing.assert_array_equal(second.acceleration, np.loadtxt(file)[2000:])
    part = load_recording(f"{file}#2", **READING)
    assert (part.recording_id, part.surface, phases_of(part)) == ("oak_1#2", "cork", Phases((), (0, 1500)))
    whole = find_recording(f"{folder}:oak/oak_1", **READING)
    assert (whole.n_samples, phases_of(whole)) == (4000, PHASES)
    with pytest.raises(
        RecordingError, match=r"no part 3: 2 surfaces marked .* Expected a number from 1 to 2"
    ):
        load_recording(f"{file}#3", **READING)
    with pytest.raises(
        RecordingError, match=r"no part 1: 0 surfaces marked .* Expected .*oak_2.txt without #"
    ):
        load_recording(folder / "oak/oak_2.txt#1", **READING)


def test_marked_files_need_no_folder_and_no_label(folder, tmp_path):
    flat = tmp_path / "flat"
    flat.mkdir()
    shutil.copy(folder / "oak/oak_1.txt", flat)
    shutil.copy(folder / "oak/oak_2.txt", flat)
    mark(flat / "oak_1.phases.json", surfaces=TWO)
    dataset = open_dataset(flat, **READING)
    assert dataset.table["surface"].to_dict() == {"oak_1#1": "oak", "oak_1#2": "cork"}
    labels = flat / "labels.csv"
    labels.write_text("file,surface,operator\noak_2.txt,slate,ann\n", encoding="utf-8")
    dataset = open_dataset(flat, **READING, labels=labels)
    assert dataset.table["surface"].tolist() == ["oak", "cork", "slate"]


def test_a_card_needs_no_surface_for_marked_files(folder):
    card = folder / "card.toml"
    card.write_text(
        f'fs_hz = {FS}\nunit = "m/s^2"\nfiles = "oak/(?P<surface>x)?oak_(?P<session>1|2)[.]txt"\n',
        encoding="utf-8",
    )
    with pytest.raises(RecordingError, match=r"oak_1.txt: no surface. Expected .* or oak_1.phases.json"):
        open_dataset(card)
    for k in (1, 2):
        mark(folder / f"oak/oak_{k}.phases.json", recording=f"oak_{k}.txt", surfaces=TWO)
    table = open_dataset(card).table
    assert table["surface"].tolist() == ["oak", "cork", "oak", "cork"]
    assert table["session"].tolist() == ["1", "1", "2", "2"]


def test_the_phases_of_the_export_of_an_app_may_be_outside_of_the_folder(tmp_path):
    app = tmp_path / "2024-01-31"
    app.mkdir()
    table = np.column_stack([np.arange(1000) / 100, np.random.default_rng(0).standard_normal((1000, 3))])
    for name in ("TotalAcceleration", "Gyroscope"):
        np.savetxt(app / f"{name}.csv", table, delimiter=",", header="seconds_elapsed,x,y,z", comments="")
    mark(tmp_path / "2024-01-31.phases.json", recording="2024-01-31", duration_s=10.0, fs_hz=100.0)
    (tmp_path / "card.toml").write_text(
        f'folder = "{app.name}"\nfs_hz = 100\nunit = "m/s^2"\nfiles = "(?P<surface>Total)A.+[.]csv"\n',
        encoding="utf-8",
    )
    (recording,) = open_dataset(tmp_path / "card.toml")
    assert phases_of(recording).movement == (100, 350)


def test_copies_of_a_marked_file_are_found_as_a_whole(folder):
    mark(folder / "oak/oak_1.phases.json", surfaces=TWO)
    shutil.copy(folder / "oak/oak_1.txt", folder / "oak/oak_3.txt")
    (copies,) = open_dataset(folder, **READING).copies
    assert [entry.recording_id for entry in copies] == ["oak/oak_1", "oak/oak_3"]


def test_a_file_whose_name_ends_with_a_number_sign_is_not_a_part(folder):
    (folder / "oak/oak_2.txt").rename(folder / "oak/a#2")
    assert split_part(folder / "oak/a#2") == (str(folder / "oak/a#2"), 0)
    assert split_part("a.txt#12") == ("a.txt", 12)
    assert split_part("a.txt#0") == ("a.txt#0", 0)


def test_the_documented_file_is_valid(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "recordings.md"
    (text,) = re.findall(r"```json\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    (tmp_path / "session.phases.json").write_text(text, encoding="utf-8")
    content = PhasesFile.read(tmp_path / "session.phases.json")
    assert [part.surface for part in content.surfaces] == ["oak", "cork"]
