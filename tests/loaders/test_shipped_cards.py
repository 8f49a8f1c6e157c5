"""The shipped cards: on their recordings (skipped where absent), or on files laid out as documents say."""

import itertools
from collections import Counter

import numpy as np
import pytest

from texclass import shipped
from texclass.evaluation import find_protocol
from texclass.evaluation.benchmark import run_benchmark
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


@pytest.mark.usefixtures("data_root")
def test_speeds_of_fabrics_are_left_out_in_turn():
    table = metadata(open_dataset("fabric_speeds").entries)
    folds = find_protocol("leave-out speed").split(table, 10, 0)
    assert [set(table["speed"][test]) for _, test in folds] == [{"v1"}, {"v2"}, {"v3"}, {"v4"}]


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


PIPELINE = """
features = "strese2015"
seed = 1
[[steps]]
use = "sklearn.preprocessing.StandardScaler"
[classifiers.lda]
use = "sklearn.discriminant_analysis.LinearDiscriminantAnalysis"
[[rows]]
name = "MFCC"
features = ["mfcc_constant"]
"""


@pytest.fixture
def folds_of(tmp_path):
    """Return what runs each protocol of a card, and gives the labels of both sets of each fold."""
    (tmp_path / "small.toml").write_text(PIPELINE)

    def run(name):
        dataset, folds = open_dataset(name), {}
        for one in read_card(name).protocols:
            result = run_benchmark(dataset, tmp_path / "small.toml", protocol=one.protocol, n_folds=one.folds)
            table = metadata(dataset.entries)
            splits = find_protocol(one.protocol).split(table, one.folds, 1)
            assert result.data["n_folds"] == len(splits)
            assert result.best == ("MFCC", "lda")
            folds[one.protocol] = [(table.iloc[train], table.iloc[test]) for train, test in splits]
        return folds

    return run


def values_of(folds, label):
    """Return the values of a label in the training set and the test set of each fold."""
    return [(set(train[label]), set(test[label])) for train, test in folds]


def test_cluster118_is_split_by_speed_direction_and_force_and_not_by_repetition(place, folds_of):
    rng, n = np.random.default_rng(0), 1500
    t = np.arange(n) / 6000 + rng.uniform(-4e-5, 4e-5, n)
    conditions = list(itertools.product((0, 135), (20, 40, 60), (500, 1000), (0, 1)))
    for surface, inside in ((0, ""), (1, "1/")):
        for direction, speed, force, repetition in conditions:
            axes = np.sin(2 * np.pi * 50 * t), 0.1 * rng.standard_normal(n), 0.01 * t - 0.96
            name = f"sensor_data/accel/{inside}{surface}_{direction}_{speed}_{force}_{repetition}.csv"
            place("cluster118", name, np.column_stack([t, *axes]), delimiter=",", header="time,X,Y,Z")
    place("cluster118", "sensor_data/force/0_135_20_500_0.csv", t, header="force")
    dataset = open_dataset("cluster118")
    assert (len(dataset), dataset.surfaces) == (48, ("0", "1"))
    assert dict(dataset.entries[0].labels) == {"direction": "0", "speed": "20", "force": "500"}
    assert dataset.table["session"].isna().all()
    folds = folds_of("cluster118")
    speeds = {"20", "40", "60"}
    assert values_of(folds["leave-out speed"], "speed") == [
        (speeds - {speed}, {speed}) for speed in sorted(speeds)
    ]
    assert values_of(folds["leave-out direction"], "speed") == [(speeds, speeds)] * 2
    assert values_of(folds["leave-out direction"], "direction") == [({"135"}, {"0"}), ({"0"}, {"135"})]
    assert values_of(folds["leave-out force"], "force") == [({"500"}, {"1000"}), ({"1000"}, {"500"})]
    assert len(folds["recording"]) == 5
    recording = dataset[0]
    assert (recording.fs, recording.unit, recording.phases.kind) == (6000, "m/s^2", "movement only")
    true = np.sin(2 * np.pi * 50 * np.arange(recording.n_samples) / 6000)
    assert np.corrcoef(recording.acceleration[:, 0], true)[0, 1] > 0.999
    np.testing.assert_allclose(np.median(recording.acceleration, axis=0), 0, atol=1e-12)


def test_lmt108_joins_axes_and_friction_and_keeps_its_own_training_set(place, folds_of):
    rng = np.random.default_rng(0)
    for surface in ("G1EpoxyRasterPlate", "G2Paper"):
        for folder, part in (("Training", "train"), ("Testing", "test")):
            for k in range(1, 6):
                for axis in "XYZ":
                    name = f"AccelScansComponents/Movement/{folder}/{surface}_Movement_{axis}_{part}{k}.txt"
                    place("lmt108", name, rng.standard_normal(1000 + k))
                name = f"FricScans/FSR1/{folder}/{surface}_FrictionFSR1_Movement_{part}{k}.txt"
                place("lmt108", name, rng.uniform(1, 2, 1000))
    dataset = open_dataset("lmt108")
    assert len(dataset) == 20
    assert dataset.surfaces == ("G1EpoxyRasterPlate", "G2Paper")
    assert dataset[0].acceleration.shape == (1000, 3)
    assert dataset[0].friction.shape == (1000,)
    folds = folds_of("lmt108")
    assert values_of(folds["session=train -> session=test"], "session") == [({"train"}, {"test"})]
    assert values_of(folds["leave-out session"], "session") == [
        ({"train"}, {"test"}),
        ({"test"}, {"train"}),
    ]
    assert len(folds["recording"]) == 10


def test_lmt69_contains_queries_operators_and_friction(place, folds_of):
    rng = np.random.default_rng(0)
    for surface in ("Brick", "Cork"):
        for k in range(1, 7):
            place("lmt69", f"Training/Accel/{surface}_query{k}.txt", rng.standard_normal(2000))
        for who in ("1", "2", "3", "Anna"):
            place("lmt69", f"Testing/AccelScansDFT321/{surface}_{who}.txt", rng.standard_normal(2000))
            place("lmt69", f"Testing/FricScans/{surface}_Friction_{who}.txt", rng.uniform(1, 2, 1900))
    dataset = open_dataset("lmt69")
    assert dataset.table["session"].value_counts().to_dict() == {"Training": 12, "Testing": 8}
    assert set(dataset.table["operator"].dropna()) == {"Anna"}
    for entry, recording in zip(dataset.entries, dataset, strict=True):
        assert (recording.friction is not None) == (entry.session == "Testing")
        assert len(recording.acceleration) == (2000 if recording.friction is None else 1900)
    folds = folds_of("lmt69")
    assert values_of(folds["session=Training -> session=Testing"], "session") == [({"Training"}, {"Testing"})]
    assert len(folds["recording"]) == 10
