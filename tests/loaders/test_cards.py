import pytest

from texclass.loaders import CardError, read_card

FILES = {
    "title": "mine",
    "source": "my shelf",
    "licence": "CC0",
    "format": "files",
    "folder": "mine",
    "fs_hz": 1000,
    "unit": "g",
    "files": r"(?P<material>\w+)\.txt",
    "phases": "detect",
}
RECIPE = {"n_surfaces": 2, "n_recordings": 2, "n_operators": 1, "duration_s": 2.0, "fs": 10000, "seed": 1}
SIMULATED = {"title": "mine", "source": "here", "licence": "MIT", "format": "simulated", "recipe": RECIPE}


def toml(value):
    """Write a value as TOML: enough for cards."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f"'{value}'"
        case list():
            return f"[{', '.join(map(toml, value))}]"
        case dict():
            return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + "}"
    return str(value)


def card(tmp_path, content):
    path = tmp_path / "mine.toml"
    path.write_text("\n".join(f"{key} = {toml(value)}" for key, value in content.items()))
    return read_card(path)


def test_a_valid_card_says_what_it_says(tmp_path):
    channels = {"acceleration": ["a", "b"], "friction": "f"}
    read = card(tmp_path, FILES | {"channels": channels, "notes": ["n"], "scale": 2})
    assert (read.name, read.fs_hz, read.unit, read.notes, read.scale) == ("mine", 1000.0, "g", ("n",), 2)
    assert read.files == (FILES["files"],)
    assert read.channels.acceleration == ("a", "b")
    assert read.channels.auxiliary == {"friction": ("f",)}


@pytest.mark.parametrize("key", sorted(set(FILES) - {"format", "source", "licence"}))
def test_a_missing_key_is_named(tmp_path, key):
    with pytest.raises(CardError, match=rf"mine\.toml: key {key} is missing"):
        card(tmp_path, {k: v for k, v in FILES.items() if k != key})


@pytest.mark.parametrize("key", sorted(RECIPE))
def test_a_missing_number_of_a_recipe_is_named(tmp_path, key):
    recipe = {k: v for k, v in RECIPE.items() if k != key}
    with pytest.raises(CardError, match=rf"key recipe\.{key} is missing"):
        card(tmp_path, SIMULATED | {"recipe": recipe})


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"fs": 3}, "unknown key fs; "),
        ({"unti": "g"}, r"unknown key unti; did you mean unit\?"),
        ({"format": "magic"}, "format is 'magic'; the rule is one of files, rows, simulated"),
        ({"unit": "m"}, r"unit is 'm'; the rule is one of m/s\^2"),
        ({"phases": "all"}, "phases is 'all'; the rule is one of detect, movement, tap"),
        ({"fs_hz": 0}, "fs_hz is 0; the rule is a rate in Hz above 0"),
        ({"fs_hz": "10k"}, "fs_hz is '10k'; the rule is int or float"),
        ({"fs_hz": True}, "fs_hz is True; the rule is int or float"),
        ({"remove_resting_level": 1}, "remove_resting_level is 1; the rule is bool"),
        ({"notes": [1]}, r"notes is \[1\]; the rule is list of str"),
        ({"files": []}, r"files is \[\]; the rule is str or list of str"),
        ({"files": "(?P<material>"}, "not a regular expression"),
        ({"files": "(?P<colour>.*)"}, r"files names groups \['colour'\]"),
        ({"files": r".*\.txt"}, "do not tell the material"),
        ({"channels": {"smell": "s"}}, r"unknown key channels\.smell"),
        (
            {"companions": {"frictoin": "f"}},
            r"unknown key companions\.frictoin; did you mean companions\.friction",
        ),
        ({"labels": {"file": "l.csv"}}, r"key labels\.recording is missing"),
        ({"labels": {"file": "l.csv", "recording": "r", "axis": "a"}}, r"unknown key labels\.axis"),
    ],
)
def test_a_broken_rule_is_named_with_file_key_and_value(tmp_path, wrong, message):
    with pytest.raises(CardError, match=rf"mine\.toml: .*{message}"):
        card(tmp_path, FILES | wrong)


def test_half_a_surface_is_refused(tmp_path):
    with pytest.raises(CardError, match=r"recipe\.n_surfaces is 2\.5; the rule is int"):
        card(tmp_path, SIMULATED | {"recipe": RECIPE | {"n_surfaces": 2.5}})


def test_a_card_that_is_not_toml_is_a_card_error(tmp_path):
    (tmp_path / "mine.toml").write_text("title =")
    with pytest.raises(CardError, match="not valid TOML"):
        read_card(tmp_path / "mine.toml")


def test_the_facts_of_a_card_change_with_what_changes_recordings_only(tmp_path):
    facts = card(tmp_path, FILES).facts
    assert card(tmp_path, FILES | {"title": "other", "notes": ["new"]}).facts == facts
    assert card(tmp_path, FILES | {"fs_hz": 2000}).facts != facts
    assert card(tmp_path, FILES | {"remove_resting_level": True}).facts != facts
