"""The shipped cards on the recordings they describe (skipped where those are absent)."""

from collections import Counter

import numpy as np
import pytest

from texclass import shipped
from texclass.loaders import fetch_recordings, open_dataset, read_card

PUBLISHED = [name for name in shipped.names("datasets") if getattr(read_card(name), "published", None)]


@pytest.mark.parametrize(
    ("name", "size", "facts"),
    [
        ("biotac20", (800, 20), (2200, "counts", 1, "movement only")),
        ("taps5", (103, 5), (1, "counts", 4, "taps only")),
        ("borealtc", (68, 5), (100, "m/s^2", 3, "movement only")),
        ("lmt_excerpts", (11, 10), (10_000, "arbitrary", 1, "movement only")),
        ("stylus6", (6, 6), (1000, "m/s^2", 1, "movement only")),
        ("knocks30", (30, 3), (48_000, "arbitrary", 1, "taps only")),
        ("dogsurf", (45, 5), (50, "counts", 3, "movement only")),
        ("fabric_speeds", (16, 4), (10_000, "arbitrary", 1, "movement only")),
    ],
)
@pytest.mark.usefixtures("data_root")
def test_a_card_opens_its_recordings(name, size, facts):
    dataset = open_dataset(name)
    assert (len(dataset), len(dataset.materials)) == size
    for index in range(0, len(dataset), max(1, len(dataset) // 20)):
        recording = dataset[index]
        channels = recording.acceleration.reshape(recording.n_samples, -1).shape[1]
        assert (recording.fs, recording.unit, channels, recording.phases.kind) == facts


@pytest.mark.usefixtures("data_root")
def test_biotac_repetitions_are_1_to_40_of_every_material():
    repetitions = Counter((entry.material, entry.repetition) for entry in open_dataset("biotac20").entries)
    assert set(repetitions.values()) == {1}
    assert {repetition for _, repetition in repetitions} == set(range(1, 41))
    assert {"carpet net", "metal"} < {material for material, _ in repetitions}


@pytest.mark.usefixtures("data_root")
def test_no_resting_level_is_left_in_the_taps():
    dataset = open_dataset("taps5")
    assert any("sampling rate unknown" in note for note in dataset.notes)
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
def test_these_recordings_are_what_fetching_makes_of_the_published_ones(name, data_root, monkeypatch):
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")  # no file lacks, so nothing is asked for
    assert fetch_recordings(name) == data_root / read_card(name).folder
