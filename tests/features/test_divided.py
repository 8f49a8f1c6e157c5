import numpy as np
import pytest

from texclass.features.bands import band_course, band_level
from texclass.features.contract import UndefinedFeatureError, find
from texclass.features.phase_view import LEAST_PIECE, Memory, PhaseView
from texclass.features.sets import load_feature_set
from texclass.features.slopes import vibration_level

FS = 2000.0
X = np.random.default_rng(0).standard_normal(4 * LEAST_PIECE) * np.linspace(1, 2, 4 * LEAST_PIECE)


def test_each_piece_has_the_value_it_has_by_itself() -> None:
    found = band_level(PhaseView(X, FS), n_bands=8, n_pieces=4).reshape(8, 4)
    for i, piece in enumerate(X.reshape(4, -1)):
        np.testing.assert_array_equal(found[:, i], band_level(PhaseView(piece, FS), n_bands=8))


def test_one_piece_is_the_feature_itself() -> None:
    view = PhaseView(X, FS)
    np.testing.assert_array_equal(band_course(view, n_parts=3, n_pieces=1), band_course(view, n_parts=3))


def test_names_stand_beside_each_other_as_values_do() -> None:
    names = find("band_level").columns("low", {"n_bands": 2, "n_pieces": 2})
    assert names == ("low.b1.piece1", "low.b1.piece2", "low.b2.piece1", "low.b2.piece2")
    assert find("band_level").columns("low", {"n_bands": 2}) == ("low.b1", "low.b2")


def test_a_movement_too_short_for_pieces_counts_as_equal_ones() -> None:
    view = PhaseView(X[:-1], FS)
    assert vibration_level(view, n_pieces=4).tolist() == 4 * vibration_level(view).tolist()


def test_pieces_share_their_transforms_and_are_timed_one_by_one() -> None:
    timed = []

    def watch(key, compute):
        timed.append((key[0].__name__, *key[1:]))
        return compute()

    view = PhaseView(X, FS, Memory())
    view.memory.timed = watch
    band_level(view, n_pieces=2)
    assert ("whole_periodogram", "piece 2") in timed
    before = len(timed)
    band_level(view, n_pieces=2)
    assert len(timed) == before


def test_a_piece_without_value_is_named() -> None:
    quiet = X.copy()
    quiet[LEAST_PIECE : 2 * LEAST_PIECE] = 0
    with pytest.raises(UndefinedFeatureError, match="piece 2: silence"):
        band_level(PhaseView(quiet, FS), n_pieces=4)


@pytest.mark.parametrize("n_pieces", [0, -1, 1.5])
def test_a_number_of_pieces_below_one_is_refused(n_pieces) -> None:
    with pytest.raises(ValueError, match="the rule is a whole number of at least 1"):
        band_level(PhaseView(X, FS), n_pieces=n_pieces)


def test_the_shipped_set_of_quarters_holds_every_feature_of_the_set_it_divides() -> None:
    quarters = load_feature_set("multiscale")
    names = {m.name for m in load_feature_set("texclass").members}
    own = {m.name for m in quarters.members} - names
    assert {m.feature.function.__module__.rsplit(".", 1)[-1] for m in quarters.members if m.name in own} == {
        "excess"
    }
    shared = quarters.restricted_to(m.name for m in quarters.members if m.name in names)
    whole = load_feature_set("texclass").restricted_to(m.name for m in shared.members)
    assert [m.name for m in shared.members] == [m.name for m in whole.members]
    assert shared.column_names == tuple(f"{c}.piece{i}" for c in whole.column_names for i in (1, 2, 3, 4))
    for a, b in zip(whole.members, shared.members, strict=True):
        assert dict(b.parameters) == {**a.parameters, "n_pieces": 4}


def test_every_member_of_the_shipped_set_of_quarters_is_divided_into_four() -> None:
    quarters = load_feature_set("multiscale")
    assert {dict(m.parameters)["n_pieces"] for m in quarters.members} == {4}
    assert all(name.endswith((".piece1", ".piece2", ".piece3", ".piece4")) for name in quarters.column_names)
