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


def test_a_valid_card_says_what_it_says(tmp_path):
    channels = {"acceleration": ["a", "b"], "friction": "f"}
    read = card(tmp_path, FILES | {"channels": channels, "notes": ["n"], "scale": 2})
    assert (read.name, read.fs_hz, read.unit, read.notes, read.scale) == ("mine", 1000.0, "g", ("n",), 2)
    assert read.files == (FILES["files"],)
    assert read.channels == {"acceleration": ("a", "b"), "friction": ("f",)}


def refused(tmp_path, content):
    with pytest.raises(CardError) as caught:
        card(tmp_path, content)
    return str(caught.value).removeprefix(f"{tmp_path}/")


def test_a_missing_key_is_named(tmp_path):
    for key in ("fs_hz", "unit", "files"):
        said = refused(tmp_path, {k: v for k, v in FILES.items() if k != key})
        assert said == f"mine.toml: missing key {key}"
    for key in RECIPE:
        said = refused(tmp_path, SIMULATED | {"recipe": {k: v for k, v in RECIPE.items() if k != key}})
        assert said == f"mine.toml: missing key recipe.{key}"


def test_what_can_be_inferred_is_optional(tmp_path):
    read = card(tmp_path, {key: FILES[key] for key in ("fs_hz", "unit", "files")})
    assert (read.title, read.source, read.licence, read.format) == ("mine", "", "not stated", "files")
    assert (read.folder, read.phases) == ("", "detect")
    assert card(tmp_path, {"recipe": RECIPE}).format == "simulated"
    rows = {"label_column": "plate", "fs_hz": 1000, "unit": "g", "files": "c1.csv"}
    assert card(tmp_path, rows).format == "rows"


def test_a_card_without_folder_reads_the_recordings_beside_it(tmp_path, monkeypatch):
    elsewhere, own = tmp_path / "data", tmp_path / "own"
    elsewhere.mkdir()
    own.mkdir()
    (elsewhere / "wool.txt").write_text("1\n")
    monkeypatch.setenv("TEXCLASS_DATA", str(elsewhere))
    (own / "oak.txt").write_text("0.5\n1.5\n" * 200)
    (own / "mine.toml").write_bytes(toml_of({key: FILES[key] for key in ("fs_hz", "unit", "files")}))
    dataset = open_dataset(own / "mine.toml")
    assert (dataset.surfaces, dataset[0].n_samples, dataset.notes) == (("oak",), 400, ())


def test_published_files_need_a_folder_of_their_own(tmp_path):
    published = {"url": "https://example.org/", "sha256": "0" * 64}
    content = {key: value for key, value in FILES.items() if key != "folder"}
    assert "missing key folder" in refused(tmp_path, content | {"published": published})


def test_all_missing_and_unknown_keys_are_listed_at_once(tmp_path):
    said = refused(tmp_path, {"fs": 1000, "units": "g", "file": FILES["files"]})
    for key, near in {"units": "unit", "file": "files"}.items():
        assert f"unknown key {key} (did you mean {near}?)" in said
    assert "unknown key fs (" in said
    assert all(f"missing key {key}" in said for key in ("fs_hz", "unit", "files"))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"fs": 3}, "unknown key fs (expected one of fs_hz, unit, files, "),
        ({"label_column": "plate"}, "unknown key label_column ("),
        ({"format": "magic"}, "format is 'magic'. Expected one of files, rows, hatt-models, simulated"),
        ({"unit": "m"}, "unit is 'm'. Expected one of m/s^2, g, mg, counts, V, arbitrary"),
        ({"phases": "all"}, "phases is 'all'. Expected one of detect, movement, tap"),
        ({"fs_hz": 0}, "fs_hz is 0. Expected a rate in Hz above 0"),
        ({"scale": 0}, "scale is 0. Expected a finite factor other than 0"),
        ({"turn_rate_scale": 0}, "turn_rate_scale is 0. Expected a finite factor other than 0"),
        ({"files": []}, "files is []. Expected text or a list of text"),
        ({"files": "(?P<surface>"}, "files holds '(?P<surface>', not a regular expression"),
        (
            {"files": "(?P<colour>.*)"},
            "files defines groups ['colour']. Expected some of recording, surface, ",
        ),
        ({"files": r".*\.txt"}, "files and labels do not define the group (?P<surface>...)"),
        ({"delimiter": "ab"}, "delimiter is 'ab'. Expected one character, no quote"),
        ({"channels": {"smell": "s"}}, "unknown key channels.smell (expected one of acceleration, fric"),
        ({"labels": {"file": "l.csv"}}, "missing key labels.recording"),
        (
            {"labels": {"file": "l", "recording": "r", "axis": "a"}},
            "unknown key labels.axis (expected one",
        ),
    ],
)
def test_a_broken_rule_is_named_with_file_key_and_value(tmp_path, wrong, said):
    assert refused(tmp_path, FILES | wrong).startswith(f"mine.toml: {said}")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"n_operators": 0}, "recipe.n_operators is 0. Expected a number of at least 1"),
        (
            {"duration_s": 1e300},
            "recipe: a recording must have at most 1e+09 samples, got 1e+300 s at 10000 Hz",
        ),
    ],
)
def test_an_impossible_recipe_is_refused(tmp_path, wrong, said):
    assert refused(tmp_path, SIMULATED | {"recipe": RECIPE | wrong}) == f"mine.toml: {said}"


def test_a_card_that_is_not_toml_is_a_card_error(tmp_path):
    (tmp_path / "mine.toml").write_text("title =")
    with pytest.raises(CardError, match="not valid TOML"):
        read_card(tmp_path / "mine.toml")


def test_the_facts_of_a_card_change_with_what_changes_recordings_only(tmp_path):
    facts = card(tmp_path, FILES).facts
    assert card(tmp_path, FILES | {"title": "other", "notes": ["new"]}).facts == facts
    assert card(tmp_path, FILES | {"fs_hz": 2000}).facts != facts
    assert card(tmp_path, FILES | {"remove_resting_level": True}).facts != facts


HATT = {"title": "mine", "source": "shelf", "licence": "CC0", "format": "hatt-models", "folder": "mine"}


def test_models_make_ten_recordings_of_ten_seconds_at_1_khz_unless_the_card_says_otherwise(tmp_path):
    read = card(tmp_path, HATT)
    assert (read.fs_hz, read.n_recordings, read.duration_s, read.seed) == (1000.0, 10, 10.0, 0)
    assert read.phases == "movement"


@pytest.mark.parametrize(
    ("key", "least", "most", "below", "above"),
    [
        ("n_recordings", 1, 1000, 0, 1001),
        ("duration_s", 0.1, 600, 0.09, 601),
        ("seed", 0, 2**62, -1, None),
    ],
)
def test_the_limits_of_a_card_of_models_are_allowed_and_what_exceeds_them_is_named(
    tmp_path, key, least, most, below, above
):
    for value in (least, most):
        assert getattr(card(tmp_path, HATT | {key: value}), key) == value
    for value in (below, above):
        if value is not None:
            assert f"{key} is {value}" in refused(tmp_path, HATT | {key: value})


@pytest.mark.parametrize(
    "changed",
    [
        {"files": r"(?P<surface>\w+)\.xml"}, {"fs_hz": 2000}, {"n_recordings": 3}, {"duration_s": 2.0},
        {"seed": 4}, {"phases": "detect"},
    ],
)  # fmt: skip
def test_the_facts_of_a_card_of_models_change_with_what_changes_recordings_only(tmp_path, changed):
    facts = card(tmp_path, HATT).facts
    assert card(tmp_path, HATT | {"title": "other"}).facts == facts
    assert card(tmp_path, HATT | changed).facts != facts


@pytest.mark.parametrize(
    ("given", "key"), [({"delimiter": ";"}, "delimiter"), ({"time_column": "t"}, "time_column")]
)
def test_what_a_card_has_to_say_is_refused_beside_it(tmp_path, given, key):
    (tmp_path / "mine.toml").write_bytes(toml_of(SIMULATED))
    with pytest.raises(RecordingError, match=rf"mine\.toml: {next(iter(given.values()))!r} .*{key}"):
        open_dataset(tmp_path / "mine.toml", **given)
