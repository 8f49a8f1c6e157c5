"""The shipped cards: on their recordings (skipped where absent), or on files laid out as documents say."""

from collections import Counter

import numpy as np
import pytest

from texclass import shipped
from texclass.evaluation import find_protocol
from texclass.evaluation.feature_table import metadata
from texclass.loaders import DataNotFoundError, fetch_recordings, open_dataset, read_card
from texclass.phases import find_phases


def open_dataset_or_skip(name):
    try:
        return open_dataset(name)
    except DataNotFoundError as error:
        pytest.skip(str(error))


PUBLISHED = [name for name in shipped.names("datasets") if getattr(read_card(name), "download", None)]


@pytest.mark.parametrize(
    ("name", "size", "facts"),
    [
        ("biotac20", (800, 20), (2200, "counts", 1, "movement only")),
        ("taps5", (103, 5), (1, "counts", 4, "taps only")),
        ("borealtc", (68, 5), (100, "m/s^2", 3, "movement only")),
        ("lmt_excerpts", (11, 10), (10_000, "arbitrary", 1, "movement only")),
        ("stylus6", (6, 6), (1000, "m/s^2", 1, "movement only")),
        ("knocks30", (30, 3), (48_000, "arbitrary", 1, "taps only")),
        ("knocks9", (9, 3), (48_000, "arbitrary", 1, "taps only")),
        ("floors10", (349, 10), (100, "m/s^2", 3, "movement only")),
        ("dogsurf", (45, 5), (50, "counts", 3, "movement only")),
        ("fabric_speeds", (16, 4), (10_000, "arbitrary", 1, "movement only")),
    ],
)
@pytest.mark.usefixtures("data_root")
def test_a_card_opens_its_recordings(name, size, facts):
    dataset = open_dataset(name)
    assert (len(dataset), len(dataset.surfaces)) == size
    for index in range(0, len(dataset), max(1, len(dataset) // 20)):
        recording = dataset[index]
        channels = recording.acceleration.reshape(recording.n_samples, -1).shape[1]
        assert (recording.fs, recording.unit, channels, find_phases(recording).kind) == facts


SPLIT_CARDS = [name for name in shipped.names("datasets") if read_card(name).protocols]


@pytest.mark.parametrize("name", SPLIT_CARDS)
def test_the_protocols_of_a_card_split_its_recordings(name, data_root):
    dataset = open_dataset_or_skip(name)
    for one in read_card(name).protocols:
        protocol = find_protocol(one.protocol)
        table = metadata(dataset.entries)
        if one.window_s is not None:
            table = table.loc[table.index.repeat(2)].rename(columns={"recording_id": "parent"})
            table = table.assign(recording_id=[f"w{i}" for i in range(len(table))]).reset_index(drop=True)
        else:
            assert protocol.separates_recordings, "shuffled windows need the key window_s"
        splits = protocol.split(table, one.folds, 0)
        assert all(train.size and test.size for train, test in splits)


@pytest.mark.usefixtures("data_root")
def test_biotac_repetitions_are_1_to_40_of_every_surface():
    repetitions = Counter((entry.surface, entry.repetition) for entry in open_dataset("biotac20").entries)
    assert set(repetitions.values()) == {1}
    assert {repetition for _, repetition in repetitions} == set(range(1, 41))
    assert {"carpet net", "metal"} < {surface for surface, _ in repetitions}


@pytest.mark.usefixtures("data_root")
def test_no_resting_level_is_left_in_the_taps():
    dataset = open_dataset("taps5")
    assert any("sampling rate is unknown" in note for note in dataset.notes)
    for recording in dataset:
        np.testing.assert_array_equal(np.median(recording.acceleration, axis=0), 0)
        assert recording.phases.taps[0].impact < 22


@pytest.mark.usefixtures("data_root")
def test_borealtc_has_turn_rate_no_gravity_and_one_session_per_run():
    dataset = open_dataset("borealtc")
    assert len({entry.session for entry in dataset.entries}) == 68
    recording = dataset[0]
    np.testing.assert_allclose(np.median(recording.acceleration, axis=0), 0, atol=1e-12)
    assert recording.turn_rate.shape == recording.acceleration.shape


@pytest.mark.parametrize("name", PUBLISHED)
def test_local_recordings_equal_the_converted_published_ones(name, data_root, monkeypatch):
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")  # all files are there, so no request is sent
    assert fetch_recordings(name) == data_root / read_card(name).folder


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return what writes columns to a file in the folder of a card."""
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path))

    def write(card, name, columns, **how):
        path = tmp_path / read_card(card).folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, columns, **{"fmt": "%.6f", "comments": ""} | how)

    return write


def parts(dataset, label):
    """Return what `--leave-out LABEL` trains and tests on, in turn, as two lists of ids each."""
    table = dataset.table.reset_index()
    split = find_protocol(f"leave-out {label}").split(table, 5, 0)
    return [[set(table["recording_id"].iloc[rows]) for rows in fold] for fold in split]


def test_cluster118_is_split_by_speed_and_not_by_repetition(place):
    rng = np.random.default_rng(0)
    t = np.arange(6000) / 6000 + rng.uniform(-4e-5, 4e-5, 6000)
    for surface, inside in ((0, ""), (1, "1/")):
        for speed, repetition in ((20, 0), (20, 1), (60, 0), (60, 1)):
            axes = np.sin(2 * np.pi * 50 * t), 0.1 * rng.standard_normal(6000), 0.01 * t - 0.96
            name = f"sensor_data/accel/{inside}{surface}_135_{speed}_500_{repetition}.csv"
            place("cluster118", name, np.column_stack([t, *axes]), delimiter=",", header="time,X,Y,Z")
    place("cluster118", "sensor_data/force/0_135_20_500_0.csv", t, header="force")
    dataset = open_dataset("cluster118")
    assert (len(dataset), dataset.surfaces) == (8, ("0", "1"))
    for train, test in parts(dataset, "session"):
        speeds = [{recording.split("_")[2] for recording in ids} for ids in (train, test)]
        assert sorted(map(sorted, speeds)) == [["20"], ["60"]]
    recording = dataset[0]
    assert (recording.fs, recording.unit, recording.phases.kind) == (6000, "m/s^2", "movement only")
    true = np.sin(2 * np.pi * 50 * np.arange(recording.n_samples) / 6000)
    assert np.corrcoef(recording.acceleration[:, 0], true)[0, 1] > 0.999
    np.testing.assert_allclose(np.median(recording.acceleration, axis=0), 0, atol=1e-12)


def test_lmt108_joins_axes_and_friction_and_keeps_its_own_training_set(place):
    rng = np.random.default_rng(0)
    for surface in ("G1EpoxyRasterPlate", "G2Paper"):
        for folder, part in (("Training", "train"), ("Testing", "test")):
            for k in (1, 2):
                for axis in "XYZ":
                    name = f"AccelScansComponents/Movement/{folder}/{surface}_Movement_{axis}_{part}{k}.txt"
                    place("lmt108", name, rng.standard_normal(1000 + k))
                name = f"FricScans/FSR1/{folder}/{surface}_FrictionFSR1_Movement_{part}{k}.txt"
                place("lmt108", name, rng.uniform(1, 2, 1000))
    dataset = open_dataset("lmt108")
    assert len(dataset) == 8
    assert dataset.surfaces == ("G1EpoxyRasterPlate", "G2Paper")
    assert dataset[0].acceleration.shape == (1000, 3)
    assert dataset[0].friction.shape == (1000,)
    table = dataset.table.reset_index()
    ((train, test),) = find_protocol("session=train -> session=test").split(table, 5, 0)
    assert (set(table["session"].iloc[train]), set(table["session"].iloc[test])) == ({"train"}, {"test"})


def test_lmt69_contains_queries_operators_and_friction(place):
    rng = np.random.default_rng(0)
    for surface in ("Brick", "Cork"):
        for k in (1, 2):
            place("lmt69", f"Training/Accel/{surface}_query{k}.txt", rng.standard_normal(2000))
        for who in ("1", "Anna"):
            place("lmt69", f"Testing/AccelScansDFT321/{surface}_{who}.txt", rng.standard_normal(2000))
            place("lmt69", f"Testing/FricScans/{surface}_Friction_{who}.txt", rng.uniform(1, 2, 1900))
    dataset = open_dataset("lmt69")
    assert dataset.table["session"].value_counts().to_dict() == {"Training": 4, "Testing": 4}
    assert set(dataset.table["operator"].dropna()) == {"Anna"}
    for entry, recording in zip(dataset.entries, dataset, strict=True):
        assert (recording.friction is not None) == (entry.session == "Testing")
        assert len(recording.acceleration) == (2000 if recording.friction is None else 1900)
