import pytest
from fuzz.mutate import toml_of

from texclass.loaders import CardError, open_dataset, read_card
from texclass.recording import RecordingError

FILES = {
    "title": "mine",
    "source": "my shelf",
    "licence": "CC0",
    "format": "files",
    "folder": "mine",
    "fs_hz": 1000,
    "unit": "g",
    "files": r"(?P<surface>\w+)\.txt",
    "phases": "detect",
}
RECIPE = {"n_surfaces": 2, "n_recordings": 2, "n_operators": 1, "duration_s": 2.0, "fs": 10000, "seed": 1}
SIMULATED = {"title": "mine", "source": "here", "licence": "MIT", "format": "simulated", "recipe": RECIPE}


def card(tmp_path, content):
    path = tmp_path / "mine.toml"
    path.write_bytes(toml_of(content))
    return read_card(path)


def test_values_of_a_valid_card_are_read(tmp_path):
    channels = {"acceleration": ["a", "b"], "friction": "f"}
    read = card(tmp_path, FILES | {"channels": channels, "notes": ["n"], "scale": 2})
    assert (read.name, read.fs_hz, read.unit, read.notes, read.scale) == ("mine", 1000.0, "g", ("n",), 2)
    assert read.files == (FILES["files"],)
    assert read.channels == {"acceleration": ("a", "b"), "friction": ("f",)}


def card_error(tmp_path, content):
    with pytest.raises(CardError) as error:
        card(tmp_path, content)
    return str(error.value).removeprefix(f"{tmp_path}/")


def test_a_missing_key_is_named(tmp_path):
    for key in ("fs_hz", "unit", "files"):
        message = card_error(tmp_path, {k: v for k, v in FILES.items() if k != key})
        assert message == f"mine.toml: missing key {key}"
    for key in RECIPE:
        message = card_error(tmp_path, SIMULATED | {"recipe": {k: v for k, v in RECIPE.items() if k != key}})
        assert message == f"mine.toml: missing key recipe.{key}"


def test_what_can_be_inferred_is_optional(tmp_path):
    read = card(tmp_path, {key: FILES[key] for key in ("fs_hz", "unit", "files")})
    assert (read.title, read.source, read.licence, read.format) == ("mine", "", "not stated", "files")
    assert (read.folder, read.phases) == ("", "detect")
    assert card(tmp_path, {"recipe": RECIPE}).format == "simulated"
    rows = {"label_column": "plate", "fs_hz": 1000, "unit": "g", "files": "c1.csv"}
    assert card(tmp_path, rows).format == "rows"


def test_a_card_without_folder_reads_the_recordings_in_its_own_folder(tmp_path, monkeypatch):
    elsewhere, own = tmp_path / "data", tmp_path / "own"
    elsewhere.mkdir()
    own.mkdir()
    (elsewhere / "wool.txt").write_text("1\n")
    monkeypatch.setenv("TEXCLASS_DATA", str(elsewhere))
    (own / "oak.txt").write_text("0.5\n1.5\n" * 200)
    (own / "mine.toml").write_bytes(toml_of({key: FILES[key] for key in ("fs_hz", "unit", "files")}))
    dataset = open_dataset(own / "mine.toml")
    assert (dataset.surfaces, dataset[0].n_samples, dataset.notes) == (("oak",), 400, ())


def test_a_download_needs_a_folder(tmp_path):
    download = {"url": "https://example.org/", "sha256": "0" * 64}
    content = {key: value for key, value in FILES.items() if key != "folder"}
    assert "missing key folder" in card_error(tmp_path, content | {"download": download})


def test_all_missing_and_unknown_keys_are_listed_at_once(tmp_path):
    message = card_error(tmp_path, {"fs": 1000, "units": "g", "file": FILES["files"]})
    for key, near in {"units": "unit", "file": "files"}.items():
        assert f"unknown key {key} (did you mean {near}?)" in message
    assert "unknown key fs (" in message
    assert all(f"missing key {key}" in message for key in ("fs_hz", "unit", "files"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fs": 3}, "unknown key fs (expected one of fs_hz, unit, files, "),
        ({"label_column": "plate"}, "unknown key label_column ("),
        (
            {"format": "magic"},
            "format is 'magic'. Expected one of files, rows, lerobot, hatt-models, simulated",
        ),
        ({"unit": "m"}, "unit is 'm'. Expected one of m/s^2, g, mg, counts, V, arbitrary"),
        ({"phases": "all"}, "phases is 'all'. Expected one of detect, movement, tap"),
        ({"fs_hz": 0}, "fs_hz is 0. Expected a rate in Hz above 0"),
        ({"scale": 0}, "scale is 0. Expected a finite factor other than 0"),
        ({"turn_rate_scale": 0}, "turn_rate_scale is 0. Expected a finite factor other than 0"),
        ({"files": []}, "files is []. Expected text or a list of text"),
        ({"files": "(?P<surface>"}, "files contains '(?P<surface>', which is not a valid regular expression"),
        (
            {"files": "(?P<surface>.*)_(?P<sesion>.*)"},
            "files defines the group 'sesion', which resembles 'session'. Correct it",
        ),
        (
            {"files": "(?P<surface>.*)_(?P<parent>.*)"},
            "files defines the group 'parent', which cannot be the name of a label",
        ),
        (
            {"files": r".*\.txt"},
            "neither files nor labels define the surface. Expected the group (?P<surface>...) in files",
        ),
        ({"delimiter": "ab"}, "delimiter is 'ab'. Expected one character, no quote"),
        ({"channels": {"smell": "s"}}, "unknown key channels.smell (expected one of acceleration, fric"),
        ({"labels": {"file": "l.csv"}}, "missing key labels.recording"),
        (
            {"labels": {"file": "l", "recording": "r", "axis": "a"}},
            "labels: [labels] defines 'axis', which cannot be the name of a label",
        ),
        (
            {"labels": {"file": "l", "recording": "r", "operater": "a"}},
            "labels: [labels] defines 'operater', which resembles 'operator'",
        ),
        ({"labels": {"file": "l", "recording": "r", "speed": 3}}, "labels.speed is 3. Expected text"),
    ],
)
def test_an_invalid_value_is_named_with_file_and_key(tmp_path, changes, message):
    assert card_error(tmp_path, FILES | changes).startswith(f"mine.toml: {message}")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_operators": 0}, "recipe.n_operators is 0. Expected a number of at least 1"),
        (
            {"duration_s": 1e300},
            "recipe: a recording must have at most 1e+09 samples, got 1e+300 s at 10000 Hz",
        ),
    ],
)
def test_an_invalid_recipe_is_a_card_error(tmp_path, changes, message):
    assert card_error(tmp_path, SIMULATED | {"recipe": RECIPE | changes}) == f"mine.toml: {message}"


LATER = {"question": "later", "protocol": "chronological"}


def test_a_card_declares_protocols_which_do_not_change_its_recordings(tmp_path):
    windows = LATER | {"folds": 5, "window_s": 5, "max_windows": 3, "note": "n"}
    read = card(tmp_path, FILES | {"protocols": [LATER, windows]})
    assert [(p.protocol, p.folds, p.window_s, p.max_windows, p.note) for p in read.protocols] == [
        ("chronological", 10, None, None, ""),
        ("chronological", 5, 5.0, 3, "n"),
    ]
    assert read.hash_input == card(tmp_path, FILES).hash_input
    assert card(tmp_path, SIMULATED | {"protocols": [LATER]}).protocols == read.protocols[:1]


@pytest.mark.parametrize(
    ("protocols", "message"),
    [
        ([LATER | {"question": "why"}], "protocols.1.question is 'why'. Expected one of published, same op"),
        ([LATER | {"folds": 1}], "protocols.1.folds is 1. Expected a number of folds of at least 2"),
        ([LATER | {"window_s": 0}], "protocols.1.window_s is 0. Expected a length in s above 0"),
        ([LATER | {"max_windows": 3}], "protocols.1: max_windows limits windows, but window_s is missing"),
        ([{"question": "later"}], "missing key protocols.1.protocol"),
        (
            [LATER | {"window_s": 5}, LATER, LATER | {"window_s": 5, "note": "b"}],
            "protocols lists 'chronological' with windows of 5 s twice for the question 'later'",
        ),
    ],
)
def test_an_invalid_protocol_of_a_card_is_a_card_error(tmp_path, protocols, message):
    assert message in card_error(tmp_path, FILES | {"protocols": protocols})


def test_a_card_that_is_not_toml_is_a_card_error(tmp_path):
    (tmp_path / "mine.toml").write_text("title =")
    with pytest.raises(CardError, match=r"not valid TOML|refused as TOML"):
        read_card(tmp_path / "mine.toml")


def test_the_hash_input_of_a_card_changes_only_with_keys_that_change_recordings(tmp_path):
    text = card(tmp_path, FILES).hash_input
    assert card(tmp_path, FILES | {"title": "other", "notes": ["new"]}).hash_input == text
    assert card(tmp_path, FILES | {"fs_hz": 2000}).hash_input != text
    assert card(tmp_path, FILES | {"remove_resting_level": True}).hash_input != text


HATT = {"title": "mine", "source": "shelf", "licence": "CC0", "format": "hatt-models", "folder": "mine"}


def test_models_give_ten_recordings_of_ten_seconds_at_1_khz_by_default(tmp_path):
    read = card(tmp_path, HATT)
    assert (read.fs_hz, read.n_recordings, read.duration_s, read.seed) == (1000.0, 10, 10.0, 0)
    assert read.phases == "movement"


@pytest.mark.parametrize(
    ("key", "minimum", "maximum", "too_small", "too_large"),
    [
        ("n_recordings", 1, 1000, 0, 1001),
        ("duration_s", 0.1, 600, 0.09, 601),
        ("seed", 0, 2**62, -1, None),
    ],
)
def test_the_limits_of_a_card_of_models_are_inclusive(tmp_path, key, minimum, maximum, too_small, too_large):
    for value in (minimum, maximum):
        assert getattr(card(tmp_path, HATT | {key: value}), key) == value
    for value in (too_small, too_large):
        if value is not None:
            assert f"{key} is {value}" in card_error(tmp_path, HATT | {key: value})


@pytest.mark.parametrize(
    "changes",
    [
        {"files": r"(?P<surface>\w+)\.xml"}, {"fs_hz": 2000}, {"n_recordings": 3}, {"duration_s": 2.0},
        {"seed": 4}, {"phases": "detect"},
    ],
)  # fmt: skip
def test_the_hash_input_of_models_changes_only_with_keys_that_change_recordings(tmp_path, changes):
    text = card(tmp_path, HATT).hash_input
    assert card(tmp_path, HATT | {"title": "other"}).hash_input == text
    assert card(tmp_path, HATT | changes).hash_input != text


@pytest.mark.parametrize(
    ("options", "key"), [({"delimiter": ";"}, "delimiter"), ({"time_column": "t"}, "time_column")]
)
def test_reader_options_are_refused_together_with_a_card(tmp_path, options, key):
    (tmp_path / "mine.toml").write_bytes(toml_of(SIMULATED))
    with pytest.raises(RecordingError, match=rf"mine\.toml: {key} = .* dataset card\. .*{key}"):
        open_dataset(tmp_path / "mine.toml", **options)
