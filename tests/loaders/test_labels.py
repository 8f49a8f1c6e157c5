"""Label tables: text as written, one row per recording, matched by id, path, name or stem."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.loaders import draft_card, open_dataset
from texclass.loaders.cards import CardError
from texclass.recording import RecordingError

OPTIONS = {"fs": 1000.0, "unit": "m/s^2"}
NAMES = ("rec001.txt", "rec002.txt", "more/rec003.txt")


@pytest.fixture
def mine(tmp_path):
    """Folder of three recordings whose names contain no surface."""
    root = tmp_path / "mine"
    for k, name in enumerate(NAMES):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(root / name, np.random.default_rng(k).normal(size=2000))
    return root


def open_labelled(root, table, **options):
    path = root.parent / "labels.csv"
    path.write_bytes(table if isinstance(table, bytes) else table.encode())
    return open_dataset(root, labels=path, **OPTIONS, **options)


@pytest.mark.parametrize(
    "names",
    [
        NAMES,
        ("rec001", "rec002", "rec003"),
        ("rec001", "rec002", "more/rec003"),
        ("mine/rec001.txt", "mine/rec002.txt", "mine/more/rec003.txt"),
        ("rec001.txt", "rec002.txt", r"more\rec003.txt"),
        ("rec001.txt", "rec002.txt", "rec003.txt"),
        ("rec001.wav", "rec002.CSV", "more/rec003.wav"),
    ],
)
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_files_are_found_with_or_without_path_and_suffix(mine, names, mark):
    surfaces = ("001", "1", "NA")
    rows = "".join(f"{name}{mark}{surface}\n" for name, surface in zip(names, surfaces, strict=True))
    dataset = open_labelled(mine, f"file{mark}surface\n{rows}")
    assert dict(zip(dataset.table.index, dataset.table["surface"], strict=True)) == {
        "rec001": "001",
        "rec002": "1",
        "more/rec003": "NA",
    }
    assert dataset.notes == ()
    assert dataset[0].surface == dataset.entries[0].surface


def test_groups_are_read_and_blank_groups_are_unknown(mine):
    table = (
        "Name,Label,Subject,session,repetition\nrec001,None,A,1,1\nrec002,1.0,,2,2\nrec003,1,B,2,3\n\n,,,,\n"
    )
    dataset = open_labelled(mine, table.encode("utf-16"))
    by_id = {entry.recording_id: entry for entry in dataset.entries}
    assert [by_id[name].surface for name in ("rec001", "rec002", "more/rec003")] == ["None", "1.0", "1"]
    assert by_id["rec001"].operator == "A"
    assert by_id["rec002"].operator is None
    assert by_id["more/rec003"].repetition == 3


def test_all_other_columns_are_labels_under_normalized_names(mine):
    table = (
        "file;surface;Speed (mm/s);Tool;;axis\nrec001;a;20;steel;x;1\nrec002;b;020;;x;2\nrec003;c;50;NA;x;3\n"
    )
    dataset = open_labelled(mine, table)
    assert list(dataset.table.columns[-2:]) == ["speed_mm_s", "tool"]
    assert dataset.table["speed_mm_s"].to_dict() == {"rec001": "20", "rec002": "020", "more/rec003": "50"}
    assert dataset.table["tool"].dropna().to_dict() == {"rec001": "steel", "more/rec003": "NA"}
    assert "speed_mm_s (3), tool (2)" in repr(dataset)
    other = open_labelled(mine, table.replace("50;NA", "60;NA"))
    assert other.input_hash != dataset.input_hash
    card = draft_card(mine, mine, labels=mine.parent / "labels.csv", **OPTIONS)
    (mine / "card.toml").write_text(card)
    from_card = open_dataset(mine / "card.toml")
    assert from_card.table.equals(other.table)


def test_columns_with_internal_names_are_no_labels(mine):
    table = "name;surface;file:;file_id\nrec001;a;1;A\nrec002;b;1;A\nrec003;c;1;A\n"
    assert list(open_labelled(mine, table).table.columns[-1:]) == ["repetition"]


def test_a_column_that_differs_between_axes_is_no_label_of_their_recording(tmp_path):
    root = tmp_path / "mine"
    root.mkdir()
    for k, axis in enumerate("XYZ"):
        np.savetxt(root / f"rec_{axis}.txt", np.random.default_rng(k).normal(size=2000))
    rows = "".join(f"rec_{axis}.txt,a,20,{offset}\n" for offset, axis in enumerate("XYZ"))
    (entry,) = open_labelled(root, f"file,surface,speed,offset\n{rows}").entries
    assert entry.labels == (("speed", "20"), ("offset", ""))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("file,surface\nrec001,a\nrec002,b\n", r"labels\.csv: no row for 'more/rec003' \(more/rec003\.txt\)"),
        ("file,surface\nrec001,a\nrec002,b\nrec003,c\nrec001,d\n", "rows 2 and 5 both describe 'rec001'"),
        (
            "file,surface\nrec001,a\nrec002,b\nrec003,c\nrec001.txt,d\n",
            r"'rec001' \(row 2\), 'rec001\.txt' \(row 5\) all match 'rec001'",
        ),
        ("file,surface\nrec001,a\nrec002,b\nrec003,c\nmine/rec001.txt,a\n", r"'mine/rec001\.txt' \(row 5\)"),
        (
            "file,surface\nrec001,a\nrec002,b\nrec003.wav,c\nrec003.flac,c\n",
            r"'rec003\.wav' \(row 4\), 'rec003\.flac' \(row 5\) all match 'more/rec003'",
        ),
        ("file,surface\nrec001,a\nrec002, \nrec003,c\n", "row 3 has a blank 'surface'"),
        ("file,surface\nrec001,a,b\n", "row 2 has 3 cells. Expected 2"),
        ("file,what\nrec001,a\n", r"no column for the surface: 'file', 'what'\. Expected one column `file`"),
        ("file,surface,label\nrec001,a,b\n", "several columns for the surface: 'surface', 'label'"),
        ("file,surface,sesion\nrec001,a,b\n", "defines the label 'sesion', which resembles 'session'"),
        ("file,surface,Tool,tool\nrec001,a,b,c\n", "several columns for the label 'tool': 'Tool', 'tool'"),
        ("", "no rows. Expected a header"),
        (b"file,surface\n\xff\xfa\x80,a\n", "cannot be read"),
        ('file,surface\n"rec001,a\n', "cannot be read"),
    ],
)
def test_an_invalid_table_is_an_error_with_its_row(mine, table, message):
    with pytest.raises((CardError, RecordingError), match=message):
        open_labelled(mine, table)


def test_a_name_of_two_files_is_refused(mine):
    np.savetxt(mine / "more/rec001.txt", np.random.default_rng(9).normal(size=2000))
    table = "file,surface\nrec001,a\nrec002,b\nrec003,c\n"
    with pytest.raises(CardError, match=r"'rec001' matches both .*Expected a path within the folder"):
        open_labelled(mine, table)
    assert len(open_labelled(mine, f"{table}more/rec001,d\n")) == 4


def test_files_of_axes_have_a_row_each_or_one(tmp_path):
    root = tmp_path / "mine"
    root.mkdir()
    for k, axis in enumerate("XYZ"):
        np.savetxt(root / f"rec_{axis}.txt", np.random.default_rng(k).normal(size=2000))
    rows = "".join(f"rec_{axis}.txt,a\n" for axis in "XYZ")
    for table in (rows, "rec,a\n", "rec.txt,a\n"):
        dataset = open_labelled(root, f"file,surface\n{table}")
        assert (dataset.surfaces, dataset.notes) == (("a",), ())
    with pytest.raises(CardError, match=r"'rec_X\.txt' \(row 2\).* all match 'rec'"):
        open_labelled(root, f"file,surface\n{rows.replace('Y.txt,a', 'Y.txt,b')}")


def test_files_without_a_row_are_left_out_on_request_and_rows_without_a_file_reported(mine):
    dataset = open_labelled(mine, "file,surface\nrec001,a\nrec002,b\nrec004,c\n", skip_bad=True)
    assert dataset.surfaces == ("a", "b")
    assert "rec004 is in the label table, but has no file" in dataset.notes
    assert any("no row for 'more/rec003'" in note for note in dataset.notes)


def test_a_table_within_the_folder_is_no_recording_and_changes_the_hash(mine):
    inside = mine / "labels.csv"
    hashes = set()
    for surface in "ab":
        inside.write_text(f"file,surface\nrec001,{surface}\nrec002,b\nrec003,c\n")
        dataset = open_dataset(mine, labels=inside, **OPTIONS)
        assert len(dataset) == 3
        hashes.add(dataset.input_hash)
    assert len(hashes) == 2
    card = draft_card(mine, mine, **OPTIONS)
    (mine / "card.toml").write_text(card)
    assert "QUESTION: is" not in card
    assert open_dataset(mine / "card.toml").labels.to_dict() == dataset.labels.to_dict()


def test_a_card_and_an_option_for_labels_are_not_combined(mine):
    inside = mine / "labels.csv"
    inside.write_text("file,surface\nrec001,a\nrec002,b\nrec003,c\n")
    (mine / "card.toml").write_text(draft_card(mine, mine, **OPTIONS))
    with pytest.raises(
        RecordingError, match=r"labels = .* cannot be combined with a dataset card.*\[labels\]"
    ):
        open_dataset(mine / "card.toml", labels=inside)


def test_rows_keep_their_labels_as_written(tmp_path):
    (tmp_path / "x.csv").write_text("name,1,2,3\n001,1,2,3\n1,4,5,6\n1.0,7,8,0\nNA,1,2,4\nNone,3,3,1\n")
    (tmp_path / "card.toml").write_text(
        "fs_hz = 1000\nunit = 'counts'\nfiles = ['x.csv']\nlabel_column = 'name'\n"
    )
    assert open_dataset(tmp_path / "card.toml").surfaces == ("001", "1", "1.0", "NA", "None")
    (tmp_path / "x.csv").write_text("name,1,2,3\noak,1,2,3\n ,4,5,6\n")
    with pytest.raises(CardError, match="row 3 has a blank label"):
        open_dataset(tmp_path / "card.toml")


def test_commands_take_labels_of_folders(mine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(4, 13):
        np.savetxt(mine / f"rec{k:03d}.txt", (1 + k % 3) * np.random.default_rng(k).normal(size=2000))
    rows = "".join(f"rec{k:03d},{'abc'[k % 3]}\n" for k in range(1, 13))
    (tmp_path / "labels.csv").write_text(f"file,surface\n{rows}")
    options = ("--labels", "labels.csv", "--fs", "1000", "--unit", "m/s^2")

    def run(*arguments):
        result = CliRunner().invoke(app, [*arguments, *options])
        assert result.exit_code == 0, (result.output, result.exception)
        return result.output

    assert "12 recordings" in run("extract", "mine", "-o", "t.csv", "--features", "scales", "--jobs", "1")
    run("card", "mine", "-o", "card.toml")
    assert open_dataset("card.toml").surfaces == ("a", "b", "c")
    run("train", "mine", "--jobs", "1", "-o", "m.skops")
    run("predict", "m.skops", "mine", "--json", "p.json")
    answers = json.loads((tmp_path / "p.json").read_text())["recordings"]
    assert len([one for one in answers if one["true_surface"] in "abc"]) == 12
    result = CliRunner().invoke(app, ["predict", "m.skops", "mine/rec001.txt", *options])
    assert result.exit_code == 1
    assert "require a folder of recordings" in result.output
