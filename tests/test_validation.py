"""Validation of files: values are converted as the model declares, errors name file, key and value."""

from typing import Annotated, Literal

import pytest
from pydantic import Field, RootModel, field_validator

from texclass.validation import StrictModel, read_toml, validate


class Nail(StrictModel):
    kind: Literal["nail"]
    length_mm: float = Field(gt=0, description="a length in mm above 0")


class Screw(StrictModel):
    kind: Literal["screw"]
    turns: int = Field(ge=1, le=9)


class Box(StrictModel):
    name: str
    sizes: tuple[float, ...] = ()
    parts: tuple[Annotated[Nail | Screw, Field(discriminator="kind")], ...] = ()
    spare: dict[str, Screw] = Field(default_factory=dict)
    marks: dict[Literal["left", "right"], bool] = Field(default_factory=dict)
    names: dict[Annotated[str, Field(pattern="^[a-z]{2}$")], bool] = Field(default_factory=dict)
    layers: Literal[1, 2] = 1

    @field_validator("name")
    @classmethod
    def _is_short(cls, name: str) -> str:
        if len(name) > 4:
            raise ValueError(f"{name!r} is long. Expected at most 4 letters")
        return name


class AnyPart(RootModel[Annotated[Nail | Screw, Field(discriminator="kind")]]):
    pass


def test_lists_are_accepted_for_tuples_and_integers_for_floats():
    box = validate(Box, {"name": "b", "sizes": [1, 2.5], "parts": [{"kind": "nail", "length_mm": 3}]}, "f")
    assert box.sizes == (1.0, 2.5)
    assert box.parts == (Nail(kind="nail", length_mm=3.0),)
    assert validate(AnyPart, {"kind": "screw", "turns": 2}, "f").root.turns == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": 5}, "name is 5. Expected text"),
        ({"name": "boxes"}, "name: 'boxes' is long. Expected at most 4 letters"),
        ({"sizes": [1, "x"]}, "sizes.2 is 'x'. Expected a number"),
        ({"sizes": [float("nan")]}, "sizes.1 is nan. Expected a finite number"),
        ({"sizes": 3}, "sizes is 3. Expected a list"),
        ({"size": 3}, "unknown key size (did you mean sizes?"),
        ({"colour": 3}, "unknown key colour (expected one of name, sizes, parts, spare, marks, "),
        ({"parts": [{}]}, "missing key parts.1.kind"),
        ({"parts": [{"kind": "nut"}]}, "parts.1.kind is 'nut'. Expected one of nail, screw"),
        ({"parts": [{"kind": "nail", "length": 1, "length_mm": 1}]}, "unknown key parts.1.length (did you"),
        ({"parts": [{"kind": "nail", "length_mm": -1}]}, "parts.1.length_mm is -1. Expected a length"),
        ({"parts": [{"kind": "screw"}]}, "missing key parts.1.turns"),
        ({"spare": {"a": {"kind": "screw", "turns": 0}}}, "spare.a.turns is 0. Expected a number of"),
        ({"spare": {"a": 1}}, "spare.a is 1. Expected a table with the keys kind, turns"),
        ({"marks": {"lefft": True}}, "unknown key marks.lefft (did you mean marks.left?"),
        ({"marks": {"left": 1}}, "marks.left is 1. Expected true or false"),
        ({"names": {"a b": True}}, "names.a b is 'a b'. Expected text that matches ^[a-z]{2}$"),
        ({"layers": 3}, "layers is 3. Expected one of 1 or 2"),
    ],
)
def test_an_error_names_file_key_value_and_expectation(changes, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        validate(Box, {"name": "b"} | changes, "box.toml")
    assert str(error.value).startswith(f"box.toml: {message}")
    assert "\n" not in str(error.value)


def test_content_that_is_not_a_table_is_an_error_and_further_errors_are_counted():
    with pytest.raises(
        ValueError, match=r"^f contains \[1\]. Expected a table with the keys kind, length_mm, turns$"
    ):
        validate(AnyPart, [1], "f")
    with pytest.raises(ValueError, match=r"\(and 1 more\)$"):
        validate(Box, {"name": 5, "sizes": 3}, "f")


def test_all_missing_and_unknown_keys_are_listed_each_with_the_closest_valid_key():
    content = {"size": 3, "part": 1, "parts": [{"kind": "screw", "turn": 1}], "layers": 7, "marks": 2}
    with pytest.raises(ValueError) as error:  # noqa: PT011
        validate(Box, content, "box.toml")
    first = "box.toml: marks is 2. Expected a table; "
    assert str(error.value).startswith(first)
    keys = str(error.value).removeprefix(first).removesuffix(" (and 1 more)")
    assert sorted(keys.split("; ")) == [
        "missing key name",
        "missing key parts.1.turns",
        "unknown key part (did you mean parts?)",
        "unknown key parts.1.turn (did you mean parts.1.turns?)",
        "unknown key size (did you mean sizes?)",
    ]


def test_a_file_of_unknown_keys_gives_a_message_of_limited_length():
    with pytest.raises(ValueError, match=r"\(and 9980 more\)$"):
        validate(Box, {"name": "b"} | {f"k{i}": 1 for i in range(10_000)}, "box.toml")


def test_numbers_beyond_float_and_deep_tables_are_errors():
    deep: dict[str, object] = {}
    for _ in range(500):
        deep = {"name": deep}
    for content in ({"name": "b", "sizes": [10**400]}, deep, {"name": "\ud800"}):
        with pytest.raises(ValueError, match=r"^f: "):
            validate(Box, content, "f")


@pytest.mark.parametrize("content", [b"title = ", b"\xff\xfe", b"#" * 1_100_000, b"a." * 40 + b"b = 1"])
def test_a_file_that_is_not_toml_is_named(tmp_path, content):
    own = tmp_path / "broken.toml"
    own.write_bytes(content)
    with pytest.raises(ValueError, match=r"broken\.toml: (not valid|refused as) TOML"):
        read_toml(own)


def test_an_unknown_key_of_an_empty_table_is_an_error():
    class Empty(StrictModel):
        pass

    with pytest.raises(ValueError, match=r"unknown key size \(expected no key at all\)"):
        validate(Empty, {"size": 1}, "box.toml")
