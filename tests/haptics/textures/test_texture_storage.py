"""Conversion of objects to JSON values and arrays, and back with all checks."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from texclass.haptics.textures.contract import Serializable
from texclass.recording import Samples


@dataclass(frozen=True, eq=False)
class Partial:
    hz: float
    shape: Samples

    def __post_init__(self):
        if self.shape.ndim != 1:
            raise ValueError(f"shape must have 1 axis, got {self.shape.ndim}")


@dataclass(frozen=True, eq=False)
class Chime(Serializable):
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


def test_parameters_and_arrays_restore_the_object():
    parameters = json.loads(json.dumps(CHIME.parameters()))
    assert parameters["partials"][1] == {"hz": 70.0, "shape": None}
    assert set(CHIME.arrays()) == {"partials.0.shape", "partials.1.shape"}
    restored = Chime.restore(parameters, CHIME.arrays())
    assert restored.parameters() == CHIME.parameters()
    assert (restored.range, restored.loudest) == ((1.0, 2.5), 2.0)
    np.testing.assert_array_equal(restored.partials[1].shape, np.arange(3.0))


def test_values_of_a_wrong_type_are_refused():
    for change, message in (
        ({"name": 3}, "chime: name is 3. Expected a valid string"),
        ({"name": None}, "name is None"),
        ({"colour": 3}, "unknown key colour"),
        ({"range": [1.0]}, r"range\.1"),
        ({"range": [1.0, 10**400]}, r"range\.1 is 1000.*Expected a valid number"),
        ({"range": [1.0, float("inf")]}, "finite"),
        ({"partials": []}, "array 'partials.0.shape' does not belong to a parameter"),
        (
            {"partials": [{"hz": 1.0, "shape": [1.0]}, {"hz": 1.0, "shape": None}]},
            "does not belong to a parameter",
        ),
        ({"partials": 7}, "does not belong to a parameter"),
        ({"places": {"a": "x"}}, r"places\.a is 'x'"),
        ({"places": {"a": "3"}}, "numbers instead of strings or booleans"),
        ({"range": [True, 2.5]}, "numbers instead of strings or booleans"),
    ):
        with pytest.raises(ValueError, match=message):
            Chime.restore(CHIME.parameters() | change, CHIME.arrays())


def test_missing_unknown_and_invalid_arrays_are_refused():
    arrays: dict[str, Any] = CHIME.arrays()
    for change, message in (
        ({"partials.0.shape": np.ones((2, 2))}, r"partials\.0: shape must have 1 axis"),
        ({"more": np.ones(2)}, "'more' does not belong to a parameter"),
    ):
        with pytest.raises(ValueError, match=message):
            Chime.restore(CHIME.parameters(), arrays | change)
    del arrays["partials.1.shape"]
    with pytest.raises(ValueError, match=r"partials\.1\.shape is None"):
        Chime.restore(CHIME.parameters(), arrays)
