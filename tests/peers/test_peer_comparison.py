"""Ours and peers on the same folds."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texclass.features.phase_view import views_of
from texclass.peers import PEERS, PeerSettings, compare_with_peers, whole_materials
from texclass.peers.comparison import _length_notes
from texclass.peers.signals import every_channel, same_signals, signal_reader
from texclass.recording import Phases, Recording, Tap


def test_a_perfect_peer_is_level_with_a_perfect_row(bench, interpreter):
    settings = PeerSettings(names=("minirocket",), python=interpreter("perfect"))
    found = compare_with_peers(*bench, settings)
    ours, *_, peer = found.contestants
    assert ours.ours
    assert found.reference is ours
    assert found.best_peer is peer
    assert (peer.accuracy.mean, peer.n_folds, peer.classifier) == (1.0, 4, "ridge")
    assert peer.difference.difference == ours.accuracy.mean - 1.0
    assert ours.accuracy.folds == bench[2].best[0].accuracy[bench[2].best[1]].folds
    assert found.peer_versions == {"fake": "1.0"}


def test_costs_are_those_of_one_fold(bench, interpreter):
    settings = PeerSettings(names=("minirocket",), python=interpreter("perfect"))
    cost = compare_with_peers(*bench, settings).contestants[-1].cost
    assert (cost.feature_ms, cost.fit_s, cost.predict_ms, cost.memory_mb) == (2.0, 0.5, 1.0, 3.0)
    # 9 + 3 recordings of a fold, fit, 3 predictions.
    assert cost.total_s == pytest.approx(12 * 0.002 + 0.5 + 3 * 0.001)


def test_our_widest_row_competes_beside_the_best(bench, interpreter):
    found = compare_with_peers(*bench, PeerSettings(names=("quant",), python=interpreter("absent")))
    assert all(c.cost.feature_ms > 0 and c.cost.fit_s > 0 for c in found.contestants if c.ours)
    assert "Modified MFCC, Constant Mel Filter Bank" in {c.name for c in found.contestants}


def test_a_wrong_fold_costs_what_it_tests(bench, interpreter):
    settings = PeerSettings(names=("quant",), python=interpreter("first fold wrong"))
    peer = compare_with_peers(*bench, settings).contestants[-1]
    assert peer.accuracy.folds == (0.0, 1.0, 1.0, 1.0)
    assert peer.difference.test.startswith("corrected resampled")


def test_a_peer_out_of_time_is_compared_on_the_folds_it_finished(bench, interpreter):
    settings = PeerSettings(names=("quant",), python=interpreter("slow"), time_limit_s=3.0)
    found = compare_with_peers(*bench, settings)
    peer = found.contestants[-1]
    assert (peer.status, peer.n_folds, peer.accuracy.n_tested) == ("out of time", 2, 6)
    assert len(peer.difference.folds[0]) == 2
    assert found.best_peer is None


def test_a_missing_peer_is_a_line_and_no_error(bench, interpreter):
    found = compare_with_peers(*bench, PeerSettings(names=("quant", "tsfel"), python=interpreter("absent")))
    lines = [c for c in found.contestants if not c.ours]
    assert [(c.status, c.message, c.accuracy) for c in lines] == [("not installed", "needs aeon", None)] * 2
    kept = json.loads(found.to_json())
    assert kept["contestants"][-1]["status"] == "not installed"
    assert {"dataset", "protocol", "versions", "peer_versions", "seed", "input_hash"} <= set(kept)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"names": ("mfcc", "weka")}, "weka"),
        ({"time_limit_s": 0.0}, "0.0 s"),
        ({"time_limit_s": np.nan}, "nan"),
    ],
)
def test_settings_are_checked(wrong, told):
    with pytest.raises(ValueError, match=told):
        PeerSettings(**wrong)
    assert PeerSettings().names == tuple(PEERS)


def test_a_limit_keeps_materials_whole(bench):
    dataset = bench[0]
    some = whole_materials(dataset, 9)
    assert some.materials == ("felt", "tile")
    assert len(some) == 8
    assert "2 of the 3 materials" in some.notes[-1]
    assert whole_materials(dataset, 12) is dataset
    with pytest.raises(ValueError, match="limit of 7"):
        whole_materials(dataset, 7)


@pytest.fixture
def recording():
    rng = np.random.default_rng(0)
    return Recording(
        rng.normal(size=(4000, 3)) + np.array([0, 0, 9.8]), fs=1000.0, unit="m/s^2", recording_id="r",
        turn_rate=rng.normal(size=(4000, 3)), phases=Phases(movement=(500, 3500)),
    )  # fmt: skip


def test_peers_are_given_the_movement_that_our_features_read(recording):
    given = signal_reader("same", recording, "auto")(recording)
    np.testing.assert_array_equal(given, views_of(recording)[""].movement.samples[None])
    apart = signal_reader("same", recording, "each")(recording)
    assert apart.shape[0] == 3
    views = views_of(recording, recording.channels)
    np.testing.assert_array_equal(apart[2], views["z/"].movement.samples)


def test_each_channel_by_itself_includes_the_turn_rate_and_no_mean(recording):
    given = signal_reader("each", recording, "auto")(recording)
    assert given.shape == (6, 3000)
    assert np.abs(given.mean(axis=1)).max() < 1e-12
    np.testing.assert_allclose(
        given[4], recording.turn_rate[500:3500, 1] - recording.turn_rate[500:3500, 1].mean()
    )
    with pytest.raises(ValueError, match=r"'raw'.*'same' or 'each'"):
        signal_reader("raw", recording, "auto")


def test_taps_stand_in_where_there_is_no_movement_and_all_of_it_where_there_are_neither(recording):
    one = recording.with_(acceleration=recording.acceleration[:, 0], turn_rate=None, channels=())
    tapped = one.with_(phases=Phases(taps=(Tap(100, 150, 400), Tap(600, 650, 900))))
    assert same_signals(tapped, ()).shape == (1, 600)
    assert same_signals(one.with_(phases=Phases()), ()).shape == (1, 4000)
    assert every_channel(one.with_(phases=Phases())).shape == (1, 4000)


def test_python_is_not_resolved():
    assert replace(PeerSettings(), python=Path("bin/python")).python == Path("bin/python")


def test_recordings_of_different_lengths_are_told_about():
    (note,) = _length_notes((100, 200, 200, 240))
    assert "100 to 240 samples" in note
    assert "(25%)" in note
    assert not list(_length_notes((200, 200)))
