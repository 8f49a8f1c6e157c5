"""Filtered in blocks: what the whole signal gives, wherever one looks."""

from dataclasses import replace

import numpy as np
import pytest

from texclass.phases import segment, vibration_track
from texclass.phases.defects import Data
from texclass.phases.vibration_track import Filtered, block_mean
from texclass.recording import Recording
from texclass.signals import butterworth, causal

SOS = butterworth("highpass", 60.0, 2000.0)
SIGNAL = np.random.default_rng(0).normal(size=(1003, 2)).cumsum(axis=0)

DATA = Data(0, len(SIGNAL), SIGNAL[:20].mean(axis=0))
GLITCHES = np.zeros(0, dtype=np.intp)


def expected(steps):
    rows = SIGNAL
    for step in steps:
        rows = block_mean(rows, step)
    return causal(SOS, rows - SIGNAL[:20].mean(axis=0), np.zeros((len(SOS), 2, 2)))[0]


@pytest.mark.parametrize("steps", [(1,), (3,), (2, 5)])
def test_blocks_give_what_the_whole_signal_gives_in_any_order(steps):
    blocks, whole = Filtered(SIGNAL, steps, SOS, DATA, GLITCHES, size=30), expected(steps)
    assert len(blocks) == len(whole)
    for first, stop in ((70, 95), (0, 5), (25, 400), (-9, 3), (len(whole) - 4, len(whole) + 9)):
        np.testing.assert_allclose(blocks.between(first, stop), whole[max(0, first) : stop], atol=1e-12)
    np.testing.assert_allclose(blocks.power(10), block_mean((whole**2).sum(axis=1), 10), rtol=1e-11)


@pytest.mark.parametrize("lag", [0, 1])
def test_correlation_is_taken_across_the_edges_of_blocks(lag):
    whole = expected((1,))
    direct = (whole[lag:] * whole[: len(whole) - lag]).sum(axis=1).mean()
    assert Filtered(SIGNAL, (1,), SOS, DATA, GLITCHES, size=30).correlation(lag) == pytest.approx(
        direct, rel=1e-12
    )


def test_phases_do_not_depend_on_the_blocks(monkeypatch):
    rng = np.random.default_rng(2)
    signal = rng.normal(size=(40_000, 3)) * np.where(np.arange(40_000) < 15_000, 0.01, 1.0)[:, None]
    for at in (4000, 9000):
        signal[at : at + 200] += 9 * np.exp(-np.arange(200) / 30)[:, None]
    recording = Recording(signal, 10_000.0, "m/s^2", "r")
    phases = segment(recording)
    assert phases.kind == "taps and movement"
    monkeypatch.setattr(vibration_track, "BLOCK", 990)
    again = segment(recording)
    assert again.movement == phases.movement
    assert [tap.quality for tap in again.taps] == pytest.approx(
        [tap.quality for tap in phases.taps], rel=1e-9
    )
    assert [replace(tap, quality=1) for tap in again.taps] == [replace(tap, quality=1) for tap in phases.taps]
