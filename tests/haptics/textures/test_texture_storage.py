"""What is taken apart to be stored is put together again, by the rules of its own types."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from texclass.haptics.textures.contract import Stored
from texclass.recording import Samples


@dataclass(frozen=True, eq=False)
class Partial:
    hz: float
    shape: Samples

    def __post_init__(self):
        if self.shape.ndim != 1:
            raise ValueError(f"shape has {self.shape.ndim} axes. Expected 1")


@dataclass(frozen=True, eq=False)
class Chime(Stored):
    family = "chime"
    name: str
    partials: tuple[Partial, ...]
    range: tuple[float, float]
    places: Mapping[str, int]
    note: str | None = None
    loudest: float = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "loudest", max(partial.shape.max() for partial in self.partials))


CHIME = Chime("low", (Partial(50.0, np.ones(2)), Partial(np.float64(70), np.arange(3.0))), (1, 2.5), {"a": 3})


def test_what_is_written_down_is_made_again():
    told = json.loads(json.dumps(CHIME.parameters()))
    assert told["partials"][1] == {"hz": 70.0, "shape": None}
    assert set(CHIME.arrays()) == {"partials.0.shape", "partials.1.shape"}
    again = Chime.restore(told, CHIME.arrays())
    assert again.parameters() == CHIME.parameters()
    assert (again.range, again.loudest) == ((1.0, 2.5), 2.0)
    np.testing.assert_array_equal(again.partials[1].shape, np.arange(3.0))


def test_what_is_of_another_kind_is_refused():
    for change, message in (
        ({"name": 3}, "chime: name is 3. Expected a valid string"),
        ({"name": None}, "name is None"),
        ({"colour": 3}, "colour is 3. Expected no such key"),
        ({"range": [1.0]}, r"range\.1"),
        ({"range": [1.0, 10**400]}, r"range\.1 is 1000.*Expected a valid number"),
        ({"range": [1.0, float("inf")]}, "finite"),
        ({"partials": []}, "array 'partials.0.shape' has no place"),
        ({"partials": [{"hz": 1.0, "shape": [1.0]}, {"hz": 1.0, "shape": None}]}, "has no place"),
        ({"partials": 7}, "has no place"),
        ({"places": {"a": "x"}}, r"places\.a is 'x'"),
        ({"places": {"a": "3"}}, "no text or true for one"),
        ({"range": [True, 2.5]}, "no text or true for one"),
    ):
        with pytest.raises(ValueError, match=message):
            Chime.restore(CHIME.parameters() | change, CHIME.arrays())


def test_arrays_that_are_missing_superfluous_or_break_a_rule_are_refused():
    arrays: dict[str, Any] = CHIME.arrays()
    for change, message in (
        ({"partials.0.shape": np.ones((2, 2))}, r"partials\.0: shape has 2 axes"),
        ({"more": np.ones(2)}, "'more' has no place"),
    ):
        with pytest.raises(ValueError, match=message):
            Chime.restore(CHIME.parameters(), arrays | change)
    del arrays["partials.1.shape"]
    with pytest.raises(ValueError, match=r"partials\.1\.shape is None"):
        Chime.restore(CHIME.parameters(), arrays)
