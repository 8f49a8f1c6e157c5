"""Datasets from cards of files, cards of rows and folders, with errors for files that do not match."""

import os
import pickle
import re
import shutil
import time

import numpy as np
import pandas as pd
import pytest
import scipy.io

from texclass.atomic_write import cache_root
from texclass.features import FeatureExtractor, load_feature_set
from texclass.loaders import CardError, DataNotFoundError, find_recording, open_dataset
from texclass.loaders.filesets import find_contact
from texclass.loaders.places import data_roots
from texclass.recording import RecordingError

FS = 10_000.0
CARD = r"""
title = "mine"
source = "https://example.org/mine"
licence = "CC0"
format = "files"
folder = "mine"
fs_hz = 10000
unit = "counts"
files = '(?P<recording>(?P<surface>[a-z]+)_(?P<operator>[A-Z]+)_(?P<repetition>\d+))\.csv'
phases = "movement"
"""
LABELS = '[labels]\nfile = "l.csv"\nrecording = "id"\nsurface = "what"\n'
COMPANIONS = '[companions]\nfriction = "{surface}_Friction_{repetition}.txt"'
ROWS = """
title = "taps"
source = "nowhere"
licence = "CC0"
format = "rows"
folder = "taps"
fs_hz = 1
unit = "counts"
files = ["one.csv", "two.csv"]
label_column = "plate"
phases = "tap"
"""


@pytest.fixture
def mine(tmp_path, monkeypatch, axes, write):
    """Return a function that writes the card with further lines and opens it."""
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "data"))
    root = tmp_path / "data" / "mine"
    root.mkdir(parents=True)
    for number, surface in enumerate(("wood", "steel")):
        write(root / f"{surface}_AB_2.csv", axes + 50 + number)

    def open_card(more="", card=CARD, **options):
        (tmp_path / "card.toml").write_text(card + more)
        return open_dataset(tmp_path / "card.toml", **options)

    open_card.root = root
    return open_card


def test_surface_and_groups_are_read_from_file_names(mine):
    dataset = mine()
    for item in (dataset.entries[0], dataset[0]):
        labels = (item.recording_id, item.surface, item.operator, item.repetition)
        assert labels == ("steel_AB_2", "steel", "AB", 2)
    assert dataset[0].phases.movement == (0, 500)
    assert repr(dataset) == "<Dataset 'card': 2 recordings, 2 surfaces, 1 operator>"


def test_the_table_has_labels_and_groups_for_scikit_learn(mine):
    (mine.root / "wood_AB_2.csv").rename(mine.root / "wood_CD_1.csv")
    dataset = mine(card=CARD.replace('"mine"', '"mine <1>"', 1))
    assert dataset.table.index.tolist() == ["steel_AB_2", "wood_CD_1"]
    assert dataset.table["operator"].tolist() == ["AB", "CD"]
    assert dataset.table["repetition"].tolist() == [2, 1]
    assert dataset.table["session"].isna().all()
    assert dataset.labels.to_dict() == {"steel_AB_2": "steel", "wood_CD_1": "wood"}
    html = dataset._repr_html_()
    assert "mine &lt;1&gt;" in html
    assert "wood_CD_1" in html


def test_a_label_table_states_labels_that_file_names_lack(mine):
    (mine.root / "l.csv").write_text("id,what\nwood_AB_2,oak\nsteel_AB_2,brushed\nglass_AB_1,glass\n")
    dataset = mine(LABELS)
    assert [entry.surface for entry in dataset.entries] == ["brushed", "oak"]
    assert dataset.notes == ("glass_AB_1 is in the label table, but has no file",)


def test_an_invalid_label_table_is_an_error(mine):
    with pytest.raises(CardError, match=r"l\.csv.*cannot be read"):
        mine(LABELS)
    for table, message in (
        ("id,what\nwood_AB_2,oak\n", r"no row for 'steel_AB_2' \(steel_AB_2.csv\), the closest is"),
        ("id,name\nwood_AB_2,oak\n", r"missing columns \['what'\]"),
        ("", "no rows. Expected a header"),
        ("id,what\nwood_AB_2,oak\nwood_AB_2,oak\n", "rows 2 and 3 both describe 'wood_AB_2'"),
        ("id,what\nwood_AB_2,\n", "row 2 has a blank 'what'"),
        ("id,what\n,oak\n", "row 2 has a blank 'id'"),
        ("id,what\nwood_AB_2,oak,1\n", "row 2 has 3 cells. Expected 2"),
    ):
        (mine.root / "l.csv").write_text(table)
        with pytest.raises(ValueError, match=rf"l\.csv.*{message}"):
            mine(LABELS)


def test_the_resting_level_is_removed_from_every_channel_and_scale_applied(mine, axes):
    acceleration = mine("scale = 0.5\nremove_resting_level = true")[0].acceleration
    np.testing.assert_allclose(acceleration, (axes - np.median(axes, axis=0)) / 2)


WHEELS = """
title = "A rover"
format = "files"
folder = "rover"
fs_hz = 50
unit = "arbitrary"
files = '(?P<surface>[a-z]+)_(?P<repetition>[0-9]+)[.]csv'
phases = "movement"
turn_rate_scale = 0.0174532925
[channels]
acceleration = ["ax", "ay", "az", "current_left", "current_right"]
turn_rate = ["gx", "gy", "gz"]
"""


def test_currents_of_wheels_are_channels_and_degrees_per_second_become_radians(tmp_path, monkeypatch):
    names = ["ax", "ay", "az", "current_left", "current_right", "gx", "gy", "gz"]
    rows = np.random.default_rng(0).standard_normal((2, 200, len(names))).round(4)
    (tmp_path / "rover").mkdir()
    for surface, values in zip(("grass", "sand"), rows, strict=True):
        lines = [",".join(names), *(",".join(map(str, row)) for row in values.tolist())]
        (tmp_path / f"rover/{surface}_1.csv").write_text("\n".join(lines))
    (tmp_path / "rover.toml").write_text(WHEELS)
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path))
    rover = open_dataset(tmp_path / "rover.toml")
    np.testing.assert_allclose(rover[1].turn_rate, np.radians(rows[1, :, 5:]))
    (tmp_path / "stored.toml").write_text(WHEELS.replace("turn_rate_scale = 0.0174532925\n", ""))
    stored = open_dataset(tmp_path / "stored.toml")
    np.testing.assert_array_equal(stored[1].turn_rate, rows[1, :, 5:])
    assert stored.input_hash != rover.input_hash
    pairs = load_feature_set("coarse").restricted_to(["vibration_level", "lag_correlation"])
    extractor = FeatureExtractor(pairs, channels="all").set_output(transform="pandas")
    features = extractor.fit_transform(rover)
    expected = np.corrcoef(rows[0, :, 3], rows[0, :, 5])[0, 1]
    assert features["current_left*turn_x/lag_correlation.lag0"].iloc[0] == pytest.approx(expected)
    assert features["current_right/vibration_level.rms"].iloc[1] == pytest.approx(
        np.log10(rows[1, :, 4].std())
    )


def test_companions_join_change_the_hash_and_missing_ones_are_flagged(mine):
    hash_without = mine(COMPANIONS).input_hash
    np.savetxt(mine.root / "wood_Friction_2.txt", np.arange(500.0))
    steel, wood = mine(COMPANIONS)
    assert steel.friction is None
    assert steel.flags == ("missing: no file with the friction",)
    np.testing.assert_array_equal(wood.friction, np.arange(500.0))
    assert mine(COMPANIONS).input_hash != hash_without


def test_signals_of_different_length_are_refused_unless_the_card_trims(mine):
    np.savetxt(mine.root / "wood_Friction_2.txt", np.arange(490.0))
    with pytest.raises(RecordingError, match="friction has 490 samples, but acceleration has 500"):
        mine(COMPANIONS)[1]
    trimmed = mine("trim = true\n" + COMPANIONS)[1]
    assert trimmed.n_samples == len(trimmed.friction) == 490
    assert trimmed.flags[0].startswith("trimmed")


def test_a_companion_keeps_the_rate_that_its_file_or_the_card_states(mine):
    slow = np.sin(np.arange(50) / 5)  # 1 kHz; the acceleration has 500 samples at 10 kHz
    np.savetxt(mine.root / "wood_Friction_2.txt", slow)
    card = COMPANIONS + "\n[auxiliary_fs_hz]\nfriction = 1000\n"
    wood = mine(card)[1]
    assert (wood.fs, wood.auxiliary_fs) == (FS, {"friction": 1000})
    np.testing.assert_array_equal(wood.friction, slow)
    assert "joined: friction of wood_Friction_2.txt, at its own rate, 1000 Hz" in wood.flags
    np.savez(mine.root / "wood_Friction_2.npz", friction=slow, fs=1000)
    stated = COMPANIONS.replace(".txt", ".npz")
    np.testing.assert_array_equal(mine(stated)[1].friction, slow)
    assert mine(stated)[1].auxiliary_fs == {"friction": 1000}
    with pytest.raises(RecordingError, match=r"wood_Friction_2\.npz: fs is 1000 Hz, but 500 Hz"):
        mine(stated + "\n[auxiliary_fs_hz]\nfriction = 500\n")[1]
    with pytest.raises(RecordingError, match="friction has 50 samples at 900 Hz, but acceleration has 500"):
        mine(card.replace("1000", "900"))[1]
    trimmed = mine("trim = true\n" + card.replace("1000", "2000"))[1]
    assert (trimmed.n_samples, len(trimmed.friction)) == (250, 50)
    with pytest.raises(CardError, match=r"auxiliary_fs_hz.*rotation"):
        mine(card.replace("friction = 1000", "rotation = 1000"))
    resampled = mine("resample_hz = 2000\n" + card)[1]
    assert (resampled.fs, resampled.auxiliary_fs) == (2000, {})
    np.testing.assert_allclose(resampled.friction[10:-10:2], slow[5:-5], atol=0.02)


def test_arrays_of_one_file_have_the_rate_of_their_group(mine):
    fast, slow = np.random.default_rng(0).standard_normal(5000), np.sin(np.arange(500) / 5)
    tool, sensor = {"acc": fast, "fs": 10_000.0}, {"force": slow, "fs": 1000.0}
    scipy.io.savemat(mine.root / "tin_AB_1.mat", {"tool": tool, "sensor": sensor})
    channels = '[channels]\nacceleration = "tool.acc"\nfriction = "sensor.force"\n'
    card = CARD.replace(".csv", ".mat")
    (tin,) = mine(channels, card=card)
    assert (tin.fs, tin.auxiliary_fs) == (FS, {"friction": 1000})
    np.testing.assert_array_equal(tin.acceleration, fast)
    np.testing.assert_array_equal(tin.friction, slow)
    with pytest.raises(RecordingError, match="1000 Hz for the friction, but 500 Hz in auxiliary_fs_hz"):
        mine(channels + "[auxiliary_fs_hz]\nfriction = 500\n", card=card)[0]
    np.savez(mine.root / "tin_AB_1.npz", acceleration=fast, force=slow)
    channels = '[channels]\nfriction = "force"\n[auxiliary_fs_hz]\nfriction = 1000\n'
    channels = channels.replace("[channels]\n", '[channels]\nacceleration = "acceleration"\n')
    (tin,) = mine(channels, card=CARD.replace(".csv", ".npz"))
    assert tin.auxiliary_fs == {"friction": 1000}


def test_a_rate_or_unit_that_contradicts_a_card_is_refused(mine):
    for options, message in (
        ({"fs": 8000}, "fs is 10000 Hz, but 8000 Hz was given"),
        ({"unit": "g"}, "'g' was given"),
    ):
        with pytest.raises(RecordingError, match=message):
            mine(**options)
        with pytest.raises(RecordingError, match=message):
            open_dataset("simulated", **options)
    assert mine(fs=10_000, unit="counts")[0].fs == 10_000


@pytest.mark.parametrize("level", [0.0, 300.0])
@pytest.mark.parametrize("impact", [1, 40])
def test_the_contact_is_found_whatever_the_channel_reads_at_rest(impact, level):
    rng = np.random.default_rng(0)
    t = np.arange(200 - impact)
    tap = rng.normal(scale=0.5, size=(200, 2)) + level
    tap[impact:] += np.outer(100 * np.exp(-t / 30) * np.cos(t / 2), [1, -0.4])
    assert find_contact(tap) == impact


@pytest.fixture
def taps(tmp_path):
    """Return a function that writes two channels of three taps with the card, and opens it."""
    (tmp_path / "taps").mkdir()
    (tmp_path / "card.toml").write_text(ROWS)
    values = np.random.default_rng(0).normal(size=(2, 3, 50))

    def open_card(plates=(("oak", "oak", "tin"),) * 2, values=values, **options):
        for name, labels, channel in zip(("one", "two"), plates, values, strict=True):
            pd.DataFrame(channel).assign(plate=labels).to_csv(tmp_path / "taps" / f"{name}.csv", index=False)
        return open_dataset(tmp_path / "card.toml", **options)

    open_card.root = tmp_path / "taps"
    open_card.channels = values
    return open_card


def test_a_row_of_each_file_is_a_recording(taps):
    dataset = taps()
    assert dataset.table.index.tolist() == ["oak_01", "oak_02", "tin_01"]
    np.testing.assert_allclose(dataset[1].acceleration, taps.channels[:, 1].T)
    assert dataset[1].channels == ("c1", "c2")
    (tap,) = dataset[1].phases.taps
    assert (tap.start, tap.end) == (0, 50)


def test_a_gap_in_a_row_spoils_that_row_only(taps):
    values = taps.channels.copy()
    values[1, 2, 7] = np.nan
    dataset = taps(values=values, skip_bad=True)
    results = [dataset.attempt(entry) for entry in dataset.entries]
    assert [isinstance(result, RecordingError) for result in results] == [False, False, True]
    assert "row 3" in str(results[2])


def test_rows_that_do_not_fit_are_refused(taps):
    with pytest.raises(RecordingError, match=r"two\.csv.*the same rows and labels"):
        taps(plates=(("oak", "oak", "tin"), ("oak", "tin", "tin")))
    for content, message in (
        ("a,b\n1,2\n", "no column 'plate'"),
        ("a,plate\nx,oak\n", "cannot be read as a table"),
    ):
        (taps.root / "one.csv").write_text(content)
        with pytest.raises(RecordingError, match=message):
            open_dataset(taps.root.parent / "card.toml")
    (taps.root / "one.csv").unlink()
    with pytest.raises(RecordingError, match=r"one\.csv: the file is missing"):
        open_dataset(taps.root.parent / "card.toml")


@pytest.fixture
def folder(tmp_path, axes, write):
    """Two surfaces, recordings 1, 2 and 10 of each."""
    for number, surface in enumerate(("wood", "steel"), start=1):
        (tmp_path / "mine" / surface).mkdir(parents=True)
        shift = 0.5 * (surface == "wood")  # no file has the content of another
        for repetition in (1, 2, 10):
            write(tmp_path / "mine" / surface / f"r{repetition}.csv", axes + number * repetition + shift)
    return tmp_path / "mine"


def test_subfolders_are_surfaces_and_files_recordings(folder, axes):
    (folder / "wood" / "photo.jpg").touch()
    dataset = open_dataset(folder, fs=FS, unit="g")
    assert (dataset.name, len(dataset), dataset.surfaces) == ("mine", 6, ("steel", "wood"))
    assert [entry.recording_id for entry in dataset.entries[:3]] == ["steel/r1", "steel/r2", "steel/r10"]
    assert dataset.notes == ("1 file of other formats ignored",)
    for copy in (dataset, pickle.loads(pickle.dumps(dataset))):
        recording = copy[1]
        assert (recording.surface, recording.fs, recording.phases) == ("steel", FS, None)
        np.testing.assert_allclose(recording.acceleration, (axes + 4) * 9.80665)


def test_an_invalid_recording_is_an_error_on_access_and_can_be_left_out(folder):
    (folder / "wood" / "r2.csv").write_text("ax,ay,az\n1,2,x\n")
    dataset = open_dataset(folder, fs=FS, unit="g")
    assert len(dataset) == 6
    for load in (lambda: list(dataset), lambda: list(map(dataset.attempt, dataset.entries))):
        with pytest.raises(RecordingError, match=r"wood/r2\.csv"):
            load()
    tolerant = open_dataset(folder, fs=FS, unit="g", skip_bad=True)
    results = {entry.recording_id: tolerant.attempt(entry) for entry in tolerant.entries}
    errors = {name: error for name, error in results.items() if isinstance(error, RecordingError)}
    assert (list(errors), len(results)) == (["wood/r2"], 6)
    assert "line 2 is '1,2,x'" in str(errors["wood/r2"])


def test_a_missing_rate_or_unit_is_an_error(folder):
    with pytest.raises(RecordingError, match="unit is missing"):
        open_dataset(folder, fs=FS)
    with pytest.raises(RecordingError, match="fs is missing"):
        open_dataset(folder, unit="g")


def test_a_rate_stated_by_the_files_is_used_and_must_be_one(tmp_path, axes):
    for surface, fs in (("a", 1000), ("b", 1000), ("c", 2000)):
        (tmp_path / surface).mkdir()
        np.savez(tmp_path / surface / "r.npz", acceleration=axes, fs=fs)
    dataset = open_dataset(tmp_path, unit="g")
    assert dataset[1].fs == 1000
    with pytest.raises(
        RecordingError, match=r"c/r\.npz: fs is 2000 Hz, but 1000 Hz in .*a/r\.npz.*--resample HZ"
    ):
        dataset[2]
    dataset = open_dataset(tmp_path, unit="g", resample=500)
    assert [(r.fs, r.n_samples) for r in dataset] == [(500, 250), (500, 250), (500, 125)]
    assert dataset[2].flags[-1] == "resampled: from 2000 Hz to 500 Hz, band-limited"


def test_a_folder_without_recordings_or_with_one_twice_is_refused(tmp_path, folder, axes, write):
    write(folder / "wood" / "r1.npz", axes)
    with pytest.raises(RecordingError, match=r"'wood/r1' occurs twice \(wood/r1.csv, wood/r1.npz\)"):
        open_dataset(folder, fs=FS, unit="g")
    (tmp_path / "none" / "wood").mkdir(parents=True)
    for content in (None, "wood/readme.md", "r.csv"):
        if content:
            (tmp_path / "none" / content).write_text("a\n1\n")
        with pytest.raises(
            RecordingError, match=r"none contains no recordings\. Expected one subfolder per surface"
        ):
            open_dataset(tmp_path / "none", fs=FS, unit="g")


def test_axes_join_and_stay_apart_from_recordings_without_axes(tmp_path, axes):
    (tmp_path / "wood").mkdir()
    for axis, column in zip("XYZ", axes.T, strict=True):
        np.savetxt(tmp_path / "wood" / f"one_{axis}_train.txt", column)
    np.savetxt(tmp_path / "wood" / "two.txt", axes[:, 0])
    dataset = open_dataset(tmp_path, fs=FS, unit="counts")
    assert [entry.recording_id for entry in dataset.entries] == ["wood/one_train", "wood/two"]
    np.testing.assert_array_equal(dataset[0].acceleration, axes)
    assert dataset[1].acceleration.ndim == 1


def test_the_hash_changes_with_content_names_and_facts_only(folder, tmp_path, axes, write):
    first = open_dataset(folder, fs=FS, unit="g").input_hash
    shutil.copytree(folder, tmp_path / "elsewhere" / "mine")
    assert open_dataset(tmp_path / "elsewhere" / "mine", fs=FS, unit="g").input_hash == first
    assert open_dataset(folder, fs=FS, unit="mg").input_hash != first
    write(folder / "wood" / "r1.csv", axes + 100)
    second = open_dataset(folder, fs=FS, unit="g").input_hash
    (folder / "wood" / "r1.csv").rename(folder / "wood" / "r7.csv")
    assert len({first, second, open_dataset(folder, fs=FS, unit="g").input_hash}) == 3


def test_a_folder_named_from_here_is_found_from_elsewhere(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dataset = open_dataset("mine", fs=FS, unit="g")
    monkeypatch.chdir(folder)
    assert dataset[0].surface == "steel"


def test_a_shipped_name_wins_over_a_folder_and_a_wrong_one_lists_them(tmp_path, monkeypatch):
    (tmp_path / "simulated").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(open_dataset("simulated")) == 240
    with pytest.raises(FileNotFoundError, match=r"nothing is neither a TOML file.*biotac20, borealtc"):
        open_dataset("nothing")


def test_a_recording_is_found_by_dataset_and_id(folder):
    assert find_recording(f"{folder}:wood/r1", fs=1000, unit="g").surface == "wood"
    assert find_recording(folder / "wood" / "r1.csv", fs=1000, unit="g").n_samples == 500
    with pytest.raises(RecordingError, match="wood/r1"):
        find_recording(f"{folder}:wood/r3", fs=1000, unit="g")
    with pytest.raises(RecordingError, match="no such file"):
        find_recording(r"C:\wood\r3.csv", fs=1000, unit="g")


def test_data_and_caches_are_where_the_variables_say(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "stated"))
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    assert cache_root() == tmp_path / "cache"
    roots = data_roots(tmp_path / "cards" / "mine.toml")
    assert (roots[0], roots[-1], len(roots)) == (tmp_path / "stated", tmp_path / "cards", 3)
    monkeypatch.delenv("TEXCLASS_DATA")
    assert data_roots() == roots[1:2]


def patterned(pattern, card=CARD):
    return re.sub("(?m)^files = .*$", lambda _: f"files = '{pattern}'", card)


def test_a_pattern_that_takes_too_long_is_an_error_within_seconds(mine):
    (mine.root / f"{'a' * 60}!.csv").touch()
    start_s = time.process_time()
    with pytest.raises(CardError, match=r"takes more than 0.2 s for 'aaa.*without nested repetitions"):
        mine(card=patterned(r"(?P<surface>(\w|\w)+)\.csv"))
    assert time.process_time() - start_s < 2


def test_a_card_that_does_not_match_its_folder_is_an_error_with_an_example(mine, axes, write):
    (mine.root / "copy").mkdir()
    write(mine.root / "copy" / "wood_AB_2.csv", axes)
    unmatched = r"contains no recordings: 'copy/wood_AB_2.csv' does not match '\(\?P<surface>x\)"
    missing = r"(?s)data/elsewhere.*https://example\.org/mine.*TEXCLASS_DATA"
    for error, message, card in (
        (RecordingError, "'wood_AB_2' occurs twice", CARD.replace("files = '", "files = '(?:.*/)?")),
        (RecordingError, unmatched, patterned(r"(?P<surface>x)\.csv")),
        (DataNotFoundError, missing, CARD.replace('folder = "mine"', 'folder = "elsewhere"')),
    ):
        with pytest.raises(error, match=message):
            mine(card=card)


def test_unmatched_files_of_the_same_format_are_counted(mine, folder, axes, write):
    for k, name in enumerate(("wood-AB-9.csv", "b.csv", "notes.md")):
        write(mine.root / name, axes + k)
    (note,) = mine().notes
    assert note.startswith("2 files left out, for example 'b.csv': change `files`, '(?P<recording>")
    write(folder / "stray.csv", axes)
    (note,) = open_dataset(folder, fs=FS, unit="g").notes
    assert (
        note == "1 file left out, for example 'stray.csv': move it to the folder of a surface to include it"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fs": 0}, "fs is 0 Hz"),
        ({"resample": -1}, "resample is -1 Hz"),
        ({"resample": np.inf}, "resample is inf Hz"),
        ({"delimiter": ";;"}, "delimiter is ';;'. Expected one character"),
        ({"unit": "furlong"}, "unknown unit 'furlong'"),
    ],
)
def test_invalid_options_are_refused_in_one_line_for_a_folder_and_a_file(folder, options, message):
    for find, path in ((open_dataset, folder), (find_recording, folder / "wood" / "r1.csv")):
        with pytest.raises(RecordingError, match=rf"^{re.escape(str(path))}: {message}") as error:
            find(path, **({"fs": FS, "unit": "g"} | options))
        assert "\n" not in str(error.value)


def test_a_folder_or_label_table_outside_the_folder_of_the_card_is_noted(mine, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "oak.csv").write_text("ax\n1\n2\n")
    card = patterned(r"(?P<surface>oak)\.csv")
    for folder in (str(elsewhere), os.path.relpath(elsewhere, mine.root.parent)):
        (note,) = mine(card=card.replace('folder = "mine"', f"folder = '{folder}'")).notes
        assert note.startswith(f"the folder {folder!r} of the card is outside the card's own folder")
    (elsewhere / "l.csv").write_text("id,what\nwood_AB_2,oak\nsteel_AB_2,brushed\n")
    labels = LABELS.replace("l.csv", f"{elsewhere}/l.csv")
    (note,) = mine(labels, patterned(r"(?P<recording>\w+)\.csv")).notes
    assert note.endswith("is outside the folder of the recordings")
    assert mine().notes == ()
