"""Files are whole or absent: on a full disk, when folders vanish; names steer no terminal."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from texclass.atomic_write import sibling_path, write_atomic
from texclass.cli.app import main
from texclass.haptics.exchange import write_wav
from texclass.loaders import load_recording, open_dataset
from texclass.loaders.cards import CardError
from texclass.recording import RecordingError
from texclass.reporting import Document, write_document


@pytest.fixture
def full_disk(monkeypatch):
    """A disk on which half of a file finds room."""

    def write_half(path, data):
        with path.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", write_half)
    monkeypatch.setattr(Path, "write_text", lambda path, text, **_: write_half(path, text.encode()))


def test_a_full_disk_leaves_a_result_unchanged_and_no_temporary_file(tmp_path, full_disk):
    (tmp_path / "r.json").touch()
    for write in (
        lambda: write_atomic(tmp_path / "r.json", '{"new": 1}'),
        lambda: write_document(Document("A result", ["text"]), tmp_path, "r", json='{"new": 1}'),
        lambda: write_wav(tmp_path / "r.wav", np.ones(1000), 1000, unit="g"),
    ):
        with pytest.raises(OSError, match="No space left"):
            write()
        assert [(file.name, file.stat().st_size) for file in tmp_path.iterdir()] == [("r.json", 0)]


def test_a_full_disk_leaves_no_truncated_figure(tmp_path, full_disk, monkeypatch, capsys):
    np.savetxt(tmp_path / "r.txt", np.random.default_rng(0).normal(size=2000))
    arguments = ["r.txt", "--fs", "1000", "--unit", "counts", "--features", "coarse"]
    monkeypatch.setattr("sys.argv", ["texclass", "inspect", *arguments])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main()
    assert "No space left on device" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["r.txt"]


def test_links_are_kept_and_pipes_are_written_to(tmp_path):
    (tmp_path / "real").touch()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_atomic(tmp_path / "link", "text")
    assert ((tmp_path / "link").is_symlink(), (tmp_path / "real").read_text()) == (True, "text")
    write_atomic(os.devnull, "text")
    assert not Path(os.devnull).is_file()


def test_a_folder_removed_by_another_process_is_created_again(tmp_path, monkeypatch):
    there = iter([False, True])
    made = Path.mkdir
    monkeypatch.setattr(Path, "mkdir", lambda path, **how: next(there) and made(path, **how))
    write_atomic(tmp_path / "parts" / "1.json", "{}")
    assert (tmp_path / "parts" / "1.json").read_text() == "{}"


def test_writing_is_tried_again_while_a_file_is_read_on_windows(tmp_path, monkeypatch):
    free, put = iter([False, True]), Path.replace

    def replace(path, target):
        if not next(free):
            raise PermissionError("another process reads it")
        return put(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    write_atomic(tmp_path / "1.json", "{}")
    assert [path.name for path in tmp_path.iterdir()] == ["1.json"]


STEERING = "wood\x1b[2J"


def test_control_characters_in_names_are_not_printed(tmp_path, capsys, monkeypatch):
    (tmp_path / "own" / STEERING).mkdir(parents=True)
    rows = np.random.default_rng(0).normal(size=(100, 2))
    np.savetxt(tmp_path / "own" / STEERING / "r.txt", rows[:, 0])
    with pytest.raises(
        RecordingError, match=r"'wood\\x1b\[2J.* contains a control character. Expected printable"
    ):
        open_dataset(tmp_path / "own", fs=1000, unit="g")
    table = tmp_path / "r.csv"
    table.write_text(f"x\x1b[2J,y\n{rows[0, 0]},1\n2,3\n")
    with pytest.raises(RecordingError, match=r"column 'x\\x1b\[2J' contains a control character"):
        load_recording(table, fs=1000, unit="g", column="1")
    card = tmp_path / "card.toml"
    card.write_text(f"title = {json.dumps(STEERING)}\nformat = 'simulated'\n[recipe]\n")
    with pytest.raises(CardError, match=r"card.toml: contains the control character \\u001b"):
        open_dataset(card)
    monkeypatch.setattr("sys.argv", ["texclass", "inspect", f"{STEERING}.csv"])
    with pytest.raises(SystemExit):
        main()
    assert "wood\\x1b[2J.csv: cannot be opened" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a" * 250 + ".json", "ü" * 122 + ".json"])
def test_names_up_to_the_limit_of_file_systems_are_written(tmp_path, name):
    write_atomic(tmp_path / name, "text")
    assert (tmp_path / name).read_text() == "text"
    assert sibling_path(tmp_path / name, ".parts").name.endswith(".parts")
    sibling_path(tmp_path / name, ".parts").mkdir()


def test_a_full_disk_is_reported_with_the_file(tmp_path, monkeypatch):
    def full(path, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*result\.json'"):
        write_atomic(tmp_path / "result.json", "text")
    assert list(tmp_path.iterdir()) == []
