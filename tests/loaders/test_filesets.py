import numpy as np
import pandas as pd
import pytest

from texclass.loaders import CardError, DataNotFoundError, open_dataset
from texclass.loaders.filesets import contact
from texclass.recording import RecordingError

CARD = r"""
title = "mine"
source = "https://example.org/mine"
licence = "CC0"
format = "files"
folder = "mine"
fs_hz = 10000
unit = "counts"
files = '(?P<recording>(?P<material>[a-z]+)_(?P<operator>[A-Z]+)_(?P<repetition>\d+))\.csv'
phases = "movement"
"""


@pytest.fixture
def mine(tmp_path, monkeypatch, axes, write):
    """Return a function that writes the card with further lines and opens it."""
    monkeypatch.setenv("TEXCLASS_DATA", str(tmp_path / "data"))
    root = tmp_path / "data" / "mine"
    root.mkdir(parents=True)
    for material in ("wood", "steel"):
        write(root / f"{material}_AB_2.csv", axes + 50)

    def opened(more="", card=CARD, **options):
        (tmp_path / "card.toml").write_text(card + more)
        return open_dataset(tmp_path / "card.toml", **options)

    opened.root = root
    return opened


def test_names_tell_material_and_groups(mine):
    entry = mine().entries[0]
    assert (entry.recording_id, entry.material, entry.operator, entry.repetition) == (
        "steel_AB_2",
        "steel",
        "AB",
        2,
    )
    recording = mine()[0]
    assert (recording.material, recording.operator, recording.repetition) == ("steel", "AB", 2)
    assert recording.phases.movement == (0, 500)


def test_a_table_tells_what_names_do_not(mine):
    (mine.root / "l.csv").write_text("id,what\nwood_AB_2,oak\nsteel_AB_2,brushed\nglass_AB_1,glass\n")
    dataset = mine('[labels]\nfile = "l.csv"\nrecording = "id"\nmaterial = "what"\n')
    assert [entry.material for entry in dataset.entries] == ["brushed", "oak"]
    assert dataset.notes == ("glass_AB_1 is in the table of labels, but has no file",)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("id,what\nwood_AB_2,oak\n", "has no row for 'steel_AB_2'"),
        ("id,name\nwood_AB_2,oak\n", r"lacks the columns \['what'\]"),
        ("", r"lacks the columns \['id', 'what'\]"),
        (None, "cannot be read"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(mine, table, message):
    if table is not None:
        (mine.root / "l.csv").write_text(table)
    with pytest.raises(CardError, match=rf"l\.csv.*{message}"):
        mine('[labels]\nfile = "l.csv"\nrecording = "id"\nmaterial = "what"\n')


def test_the_resting_level_is_removed_from_every_channel_and_scale_applied(mine, axes):
    acceleration = mine("scale = 0.5\nremove_resting_level = true")[0].acceleration
    np.testing.assert_allclose(acceleration, (axes - np.median(axes, axis=0)) / 2)


def test_companions_join_and_absent_ones_are_flagged(mine):
    np.savetxt(mine.root / "wood_Friction_2.txt", np.arange(500.0))
    steel, wood = mine('[companions]\nfriction = "{material}_Friction_{repetition}.txt"')
    assert steel.friction is None
    assert steel.flags == ("absent: no file with the friction",)
    np.testing.assert_array_equal(wood.friction, np.arange(500.0))


def test_signals_of_different_length_are_refused_unless_the_card_trims(mine):
    np.savetxt(mine.root / "wood_Friction_2.txt", np.arange(490.0))
    companions = '[companions]\nfriction = "{material}_Friction_{repetition}.txt"'
    with pytest.raises(RecordingError, match="friction has 490 samples, acceleration 500"):
        mine(companions)[1]
    trimmed = mine("trim = true\n" + companions)[1]
    assert trimmed.n_samples == len(trimmed.friction) == 490
    assert trimmed.flags[0].startswith("trimmed")


def test_a_companion_changes_the_hash(mine):
    more = '[companions]\nfriction = "{material}_Friction_{repetition}.txt"'
    before = mine(more).input_hash
    np.savetxt(mine.root / "wood_Friction_2.txt", np.arange(500.0))
    assert mine(more).input_hash != before


def test_a_card_that_describes_no_file_is_refused(mine):
    with pytest.raises(RecordingError, match="holds no recording"):
        mine(card=CARD.replace(".csv", ".wav"))


def test_two_files_with_one_id_are_refused(mine, axes, write):
    (mine.root / "again").mkdir()
    write(mine.root / "again" / "wood_AB_2.csv", axes)
    with pytest.raises(RecordingError, match="'wood_AB_2' occurs twice"):
        mine(card=CARD.replace("files = '", "files = '(?:.*/)?"))


def test_absent_data_says_where_to_get_it_and_where_it_was_looked_for(mine):
    with pytest.raises(
        DataNotFoundError, match=r"(?s)data/elsewhere.*https://example\.org/mine.*TEXCLASS_DATA"
    ):
        mine(card=CARD.replace('"mine"', '"elsewhere"'))


@pytest.mark.parametrize(("given", "message"), [({"fs": 8000}, "8000 Hz"), ({"unit": "g"}, "'g' was given")])
def test_facts_that_contradict_the_card_are_refused(mine, given, message):
    with pytest.raises(RecordingError, match=message):
        mine(**given)
    assert mine(fs=10_000, unit="counts")[0].fs == 10_000


@pytest.mark.parametrize("level", [0.0, 300.0])
@pytest.mark.parametrize("impact", [1, 40])
def test_the_contact_is_found_whatever_the_channel_reads_at_rest(impact, level):
    rng = np.random.default_rng(0)
    t = np.arange(200 - impact)
    tap = rng.normal(scale=0.5, size=(200, 2)) + level
    tap[impact:] += np.outer(100 * np.exp(-t / 30) * np.cos(t / 2), [1, -0.4])
    assert contact(tap) == impact


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
def taps(tmp_path):
    """Return a function that writes two channels of three taps with the card, and opens it."""
    (tmp_path / "taps").mkdir()
    (tmp_path / "card.toml").write_text(ROWS)
    values = np.random.default_rng(0).normal(size=(2, 3, 50))

    def opened(plates=(("oak", "oak", "tin"),) * 2, values=values, **options):
        for name, labels, channel in zip(("one", "two"), plates, values, strict=True):
            pd.DataFrame(channel).assign(plate=labels).to_csv(tmp_path / "taps" / f"{name}.csv", index=False)
        return open_dataset(tmp_path / "card.toml", **options)

    opened.root = tmp_path / "taps"
    opened.written = values
    return opened


def test_a_row_of_each_file_is_a_recording(taps):
    dataset = taps()
    assert [entry.recording_id for entry in dataset.entries] == ["oak_01", "oak_02", "tin_01"]
    np.testing.assert_allclose(dataset[1].acceleration, taps.written[:, 1].T)
    assert dataset[1].channels == ("c1", "c2")
    (tap,) = dataset[1].phases.taps
    assert (tap.start, tap.end) == (0, 50)


def test_files_that_disagree_are_refused(taps):
    with pytest.raises(RecordingError, match=r"two\.csv.*the same rows and labels"):
        taps(plates=(("oak", "oak", "tin"), ("oak", "tin", "tin")))


def test_an_absent_channel_is_refused(taps):
    taps()
    (taps.root / "two.csv").unlink()
    with pytest.raises(RecordingError, match=r"two\.csv: is missing"):
        open_dataset(taps.root.parent / "card.toml")


def test_a_gap_in_a_row_spoils_that_row_only(taps):
    values = taps.written.copy()
    values[1, 2, 7] = np.nan
    results = [result for _, result in taps(values=values, skip_bad=True).attempts()]
    assert [isinstance(result, RecordingError) for result in results] == [False, False, True]
    assert "row 3" in str(results[2])


@pytest.mark.parametrize(
    ("content", "message"), [("a,b\n1,2\n", "lacks the column 'plate'"), ("a,plate\nx,oak\n", "not a table")]
)
def test_a_table_without_labels_or_numbers_is_refused(taps, content, message):
    taps()
    (taps.root / "one.csv").write_text(content)
    with pytest.raises(RecordingError, match=message):
        open_dataset(taps.root.parent / "card.toml")
