import numpy as np
import pytest

from texclass.loaders import find_recording, open_dataset
from texclass.loaders.filesets import digest_files
from texclass.loaders.places import cache_root, data_roots, write_atomically
from texclass.recording import RecordingError


def test_a_name_that_is_nothing_lists_the_shipped_cards():
    with pytest.raises(FileNotFoundError, match=r"nothing: no TOML file.*biotac20, borealtc"):
        open_dataset("nothing")


def test_a_shipped_name_wins_over_a_folder_of_that_name(tmp_path, monkeypatch):
    (tmp_path / "simulated").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(open_dataset("simulated")) == 240


@pytest.mark.parametrize(
    ("given", "message"), [({"fs": 8000}, "fs is 10000 Hz there"), ({"unit": "g"}, "'g'")]
)
def test_a_simulation_cannot_be_told_another_rate_or_unit(given, message):
    with pytest.raises(RecordingError, match=message):
        open_dataset("simulated", **given)


def test_data_are_looked_for_where_the_variable_says_then_with_the_user_then_beside_the_card(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "stated"))
    roots = data_roots(tmp_path / "cards" / "mine.toml")
    assert (roots[0], roots[-1], len(roots)) == (tmp_path / "stated", tmp_path / "cards", 3)
    monkeypatch.delenv("TEXCLASS_DATA")
    assert data_roots() == roots[1:2]


def test_the_cache_is_where_the_variable_says(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    assert cache_root() == tmp_path / "cache"


def test_a_digest_is_remembered_until_a_file_changes(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"one")
    first = digest_files(tmp_path, ["a"], "facts")
    assert digest_files(tmp_path, ["a"], "facts") == first
    assert digest_files(tmp_path, ["a"], "other facts") != first
    (tmp_path / "a").write_bytes(b"other")
    assert digest_files(tmp_path, ["a"], "facts") != first


def test_a_digest_depends_on_content_and_names_not_on_place(tmp_path):
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a").write_bytes(b"one")
    (tmp_path / "there" / "b").write_bytes(b"one")
    assert digest_files(tmp_path / "here", ["a"], "") == digest_files(tmp_path / "there", ["a"], "")
    assert digest_files(tmp_path / "there", ["b"], "") != digest_files(tmp_path / "there", ["a"], "")


def test_an_atomic_write_leaves_the_file_and_nothing_else(tmp_path):
    write_atomically(tmp_path / "below" / "file", b"content")
    assert [path.name for path in (tmp_path / "below").iterdir()] == ["file"]
    assert (tmp_path / "below" / "file").read_bytes() == b"content"


def test_a_recording_is_found_by_dataset_and_id(tmp_path):
    (tmp_path / "oak").mkdir()
    np.savetxt(tmp_path / "oak" / "one.txt", np.sin(np.arange(50.0)))
    found = find_recording(f"{tmp_path}:oak/one", fs=1000, unit="g")
    assert found.material == "oak"
    assert found.n_samples == 50
    assert find_recording(tmp_path / "oak" / "one.txt", fs=1000, unit="g").n_samples == 50
    with pytest.raises(RecordingError, match="oak/one"):
        find_recording(f"{tmp_path}:oak/two", fs=1000, unit="g")
