"""A transform is computed once a view, however its parameters are given."""

import numpy as np
import pytest

from texclass.features.phase_view import PhaseView, transform

CALLS: list[tuple[float, float, bool]] = []


@transform
def scaled(view: PhaseView, factor: float, offset: float = 0.0, *, negative: bool = False) -> float:
    CALLS.append((factor, offset, negative))
    return (-1 if negative else 1) * (factor * view.n_samples + offset)


@pytest.fixture
def view() -> PhaseView:
    CALLS.clear()
    return PhaseView(np.zeros(7), 100.0)


def test_a_parameter_by_place_by_name_or_by_default_is_the_same_transform(view: PhaseView) -> None:
    found = {
        scaled(view, 2.0),
        scaled(view, 2.0, 0.0),
        scaled(view, factor=2.0),
        scaled(view, 2.0, offset=0.0),
        scaled(view, 2.0, negative=False),
    }
    assert found == {14.0}
    assert CALLS == [(2.0, 0.0, False)]


def test_other_values_of_a_parameter_and_other_views_are_computed_anew(view: PhaseView) -> None:
    assert [scaled(view, 2.0, 1.0), scaled(view, 3.0), scaled(view, 2.0, negative=True)] == [15, 21, -14]
    assert scaled(PhaseView(np.zeros(1), 100.0), 2.0) == 2.0
    assert len(CALLS) == 4


def test_a_transform_that_fails_is_not_remembered_and_wrong_arguments_are_refused(view: PhaseView) -> None:
    for _ in range(2):
        with pytest.raises(TypeError, match="factor"):
            scaled(view)  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="positional"):
            scaled(view, 1.0, 2.0, 3.0)  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="unknown"):
            scaled(view, 1.0, unknown=2.0)  # type: ignore[call-arg]
    assert not view.memory
