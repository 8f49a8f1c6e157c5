"""Hidden and system files are never data, and names are compared in one Unicode normal form."""

import shutil
import unicodedata

import pytest

from texclass.loaders import find_recording, open_dataset
from texclass.loaders.card_draft import draft_card
from texclass.loaders.open import flat_files
from texclass.recording import RecordingError

HIDDEN = (
    ".ipynb_checkpoints/01-checkpoint.csv",
    "__MACOSX/oak/._01.csv",
    "oak/._01.csv",
    "oak/.DS_Store",
    "oak/.ipynb_checkpoints/01.csv",
    "Thumbs.db",
    "oak/desktop.ini",
)
STATED = {"fs": 10_000, "unit": "counts"}


@pytest.fixture
def surfaces(tmp_path, axes, write):
    """Folder of two surfaces, with files that macOS, Windows and Jupyter leave behind."""
    for k, name in enumerate(("oak/01.csv", "slate/01.csv", *HIDDEN)):
        path = tmp_path / "mine" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, axes + k) if path.suffix == ".csv" and not path.name.startswith(
            "._"
        ) else path.write_bytes(b"\0\5")
    return tmp_path / "mine"


def test_a_folder_leaves_out_hidden_and_system_files(surfaces):
    dataset = open_dataset(surfaces, **STATED)
    assert [entry.paths for entry in dataset.entries] == [("oak/01.csv",), ("slate/01.csv",)]
    assert dataset.notes == ()


def test_a_card_leaves_out_hidden_and_system_files(surfaces, tmp_path):
    card = "folder = 'mine'\nfs_hz = 10000\nunit = 'counts'\nfiles = '(?P<surface>.+)/[^/]+'\n"
    (tmp_path / "card.toml").write_text(card)
    assert open_dataset(tmp_path / "card.toml").surfaces == ("oak", "slate")


def test_drafted_cards_and_flat_folders_leave_out_hidden_files(surfaces, tmp_path):
    card = draft_card(surfaces, tmp_path, **STATED)
    assert "2 surfaces, with number of files: oak (1), slate (1)" in card
    assert flat_files(surfaces / "oak") == [surfaces / "oak/01.csv"]


@pytest.mark.parametrize(
    ("copies", "note"),
    [
        (
            ["oak/02.csv", "oak/03.csv"],
            "3 recordings have the same content as another, for example 'oak/01', 'oak/02'",
        ),
        (
            ["slate/07.csv"],
            "2 recordings have the same content as another but a different label, for example 'oak/01', "
            "'slate/07'",
        ),
    ],
)
def test_exact_copies_are_reported(surfaces, copies, note):
    for name in copies:
        shutil.copy(surfaces / "oak/01.csv", surfaces / name)
    dataset = open_dataset(surfaces, **STATED)
    assert dataset.notes[0].startswith(note)
    ((first, *others),) = dataset.copies
    assert (first.paths, [one.paths[0] for one in others]) == (("oak/01.csv",), copies)


def test_equal_rows_of_tables_are_copies(tmp_path):
    (tmp_path / "x.csv").write_text("name,1,2,3\noak,1,2,3\noak,4,5,6\noak,1,2,3\n")
    (tmp_path / "card.toml").write_text(
        "fs_hz = 1000\nunit = 'counts'\nformat = 'rows'\nfiles = ['x.csv']\nlabel_column = 'name'\n"
    )
    dataset = open_dataset(tmp_path / "card.toml")
    assert [[entry.recording_id for entry in alike] for alike in dataset.copies] == [["oak_01", "oak_03"]]
    assert "for example 'oak_01', 'oak_03'" in dataset.notes[0]


def test_surfaces_in_two_normal_forms_are_one(tmp_path, axes, write):
    for k, form in enumerate(("NFC", "NFD")):
        folder = tmp_path / unicodedata.normalize(form, "müll")
        folder.mkdir()
        write(folder / f"{k}.csv", axes + k)
    dataset = open_dataset(tmp_path, **STATED)
    assert dataset.surfaces == ("müll",)
    assert len(dataset) == len(list(dataset)) == 2
    typed = unicodedata.normalize("NFD", f"{tmp_path}:müll/1")
    assert find_recording(typed, **STATED).acceleration[0, 0] == axes[0, 0] + 1


def test_card_patterns_match_names_in_either_normal_form(tmp_path, axes, write):
    write(tmp_path / unicodedata.normalize("NFD", "müll_1.csv"), axes)
    (tmp_path / "card.toml").write_text(
        "fs_hz = 10000\nunit = 'counts'\nfiles = '(?P<surface>müll)_1.csv'\n[surfaces]\n'müll' = 'waste'\n",
        encoding="utf-8",
    )
    dataset = open_dataset(tmp_path / "card.toml")
    assert dataset.surfaces == ("waste",)
    assert dataset[0].n_samples == len(axes)


def test_one_name_in_two_normal_forms_is_refused(tmp_path, axes, write):
    for form in ("NFC", "NFD"):
        folder = tmp_path / unicodedata.normalize(form, "müll")
        folder.mkdir()
        write(folder / "1.csv", axes)
    with pytest.raises(RecordingError, match=r"one name in two Unicode normal forms"):
        open_dataset(tmp_path, **STATED)
