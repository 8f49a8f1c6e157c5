from functools import cache

import numpy as np
import pytest

from texclass.loaders import open_dataset, write_sample
from texclass.loaders.simulated import ATTRIBUTES, SIGNALS, load_simulated, read_cached
from texclass.phases import find_phases
from texclass.recording import Recording
from texclass.simulate.recipe import Recipe

CARD = """
title = "small"
source = "here"
licence = "MIT"
format = "simulated"
recipe = {{ n_surfaces = {}, n_recordings = 2, n_operators = 2, duration_s = 4.0, fs = 2000, seed = 3 }}
"""


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(CARD.format(2))
    return open_dataset(tmp_path / "small.toml")


def assert_same(one: Recording, other: Recording):
    for name in SIGNALS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a, b)
    for name in (*ATTRIBUTES, "session"):
        assert getattr(one, name) == getattr(other, name)


def test_entries_have_the_labels_of_the_recordings_and_true_phases_are_removed(small):
    assert len(small) == 4
    for entry, recording in zip(small.entries, small, strict=True):
        for name in ("recording_id", "surface", "operator", "repetition"):
            assert getattr(entry, name) == getattr(recording, name)
        assert recording.phases is None
    assert small.load.args[0].record(0, 1).phases is not None
    assert small[0].phases is None, "nor are they in the cache"


def test_a_cached_recording_equals_a_new_one_to_the_last_bit(small, tmp_path):
    recipe, remembered = small.load.args
    fresh = load_simulated(recipe, tmp_path / "elsewhere", small.entries[1])
    assert_same(small[1], fresh)
    assert_same(read_cached(remembered / f"{small.entries[1].recording_id}.npz"), fresh)


def test_a_damaged_cache_file_is_simulated_again(small):
    expected = small[0]
    path = small.load.args[1] / f"{small.entries[0].recording_id}.npz"
    for damaged in (path.read_bytes()[:1000], b"", b"rubbish" * 99):
        path.write_bytes(damaged)
        assert read_cached(path) is None
        assert_same(small[0], expected)
        assert read_cached(path) is not None


def test_a_cache_that_cannot_be_written_is_no_error(small, tmp_path):
    (tmp_path / "file").touch()
    made = load_simulated(small.load.args[0], tmp_path / "file" / "below", small.entries[0])
    assert_same(made, small[0])


def test_the_hash_follows_the_recipe(small, tmp_path):
    (tmp_path / "other.toml").write_text(CARD.format(3))
    other = open_dataset(tmp_path / "other.toml")
    assert other.input_hash != small.input_hash
    assert other.load.args[1] != small.load.args[1]


@pytest.mark.parametrize(("name", "n", "duration_s"), [("simulated", 240, 6.0), ("simulated69", 690, 25.0)])
def test_the_shipped_recipes_have_the_documented_size(name, n, duration_s):
    dataset = open_dataset(name)
    assert len(dataset) == n
    assert dataset.load.args[0].duration_s == duration_s
    assert len({entry.operator for entry in dataset.entries}) == 5


def test_a_sample_continues_with_further_recordings_and_overwrites_no_other_file(tmp_path, monkeypatch):
    monkeypatch.setattr(Recipe, "record", cache(Recipe.record))
    *_, last = write_sample(tmp_path)
    assert write_sample(tmp_path)[-1] == last
    write_sample(tmp_path, first=7)
    dataset = open_dataset(tmp_path, fs=10_000, unit="m/s^2")
    assert dataset.labels.value_counts().to_dict() == dict.fromkeys(("foam", "mesh", "oak", "slate"), 12)
    assert len({recording.acceleration.tobytes() for recording in dataset}) == 48
    assert {find_phases(recording).kind for recording in map(dataset.__getitem__, range(0, 48, 7))} == {
        "taps and movement"
    }
    last.write_text("mine\n")
    with pytest.raises(
        ValueError, match=r"mesh_06.txt exists with different content. Expected a new or empty folder"
    ):
        write_sample(tmp_path)
    assert last.read_text() == "mine\n"
