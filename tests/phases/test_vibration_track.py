"""Filtered in blocks: what the whole signal gives, wherever one looks."""

from dataclasses import replace

import numpy as np
import pytest

from texclass.phases import segment, vibration_track
from texclass.phases.defects import Data, mended
from texclass.phases.vibration_track import SINGLE, Filtered, block_mean, track
from texclass.recording import Recording
from texclass.signals import STEPS, butterworth, causal

SOS = butterworth("highpass", 60.0, 2000.0)
SIGNAL = np.random.default_rng(0).normal(size=(5003, 2)).cumsum(axis=0)
REST = SIGNAL[:20].mean(axis=0)
CASES = [(step, per, glitches) for step, per in ((1, 5), (3, 5), (2, 1)) for glitches in ([], [0, 640, 4990])]


def filtered(step, per, glitches=(), first=0, kind="d"):
    return Filtered(
        SIGNAL, step, per, SOS, Data(first, len(SIGNAL), REST), np.array(glitches, dtype=np.intp), kind
    )


def expected(step, glitches=(), first=0):
    rows = np.where(np.arange(len(SIGNAL))[:, None] < first, REST, mended(SIGNAL, np.array(glitches, int)))
    rows = block_mean(rows, step) - REST
    return rows, causal(SOS, rows, np.zeros((len(SOS), 2, 2)))[0]


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(vibration_track, "BLOCK", 330)
    monkeypatch.setattr(vibration_track, "KEPT", 3)


@pytest.mark.parametrize(("step", "per", "glitches"), CASES)
@pytest.mark.parametrize("first", [0, 700])
def test_blocks_give_what_the_whole_signal_gives_in_any_order(step, per, glitches, first):
    blocks, (rows, whole) = filtered(step, per, glitches, first), expected(step, glitches, first)
    for start, stop in ((700, 950), (0, 5), (25, 1400), (-9, 3), (len(whole) - 4, len(whole) + 9)):
        np.testing.assert_allclose(blocks.between(start, stop), whole[max(0, start) : stop].T, atol=1e-12)
    power, mean = blocks.levels()
    np.testing.assert_allclose(power, block_mean((whole**2).sum(axis=1), per), rtol=1e-10)
    np.testing.assert_allclose(mean[:, : len(power)], block_mean(rows, per).T, atol=1e-12)
    assert not mean[:, len(power) :].any()
    assert mean.shape[1] % STEPS == 0


def test_single_precision_errs_by_less_than_its_share_of_the_greatest_mean():
    power, mean = filtered(1, 5, kind="f").levels()
    exact, _ = filtered(1, 5).levels()
    assert power.dtype == np.float64
    assert mean.dtype == np.float32
    assert np.abs(np.sqrt(power) - np.sqrt(exact)).max() < 0.3 * SINGLE * np.abs(mean).max()


@pytest.mark.parametrize("gain", [1e-100, 1e-30, 1.0, 1e30, 1e100])
@pytest.mark.parametrize("noise", [1e-9, 1e-2])
def test_track_does_not_depend_on_the_unit_nor_miss_noise_below_single_precision(gain, noise):
    rng = np.random.default_rng(1)
    x = noise * rng.normal(size=(20_000, 2)) + 9.8 * np.cos(np.arange(20_000) / 1e5)[:, None]
    x[12_000:12_100] += 1e4 * noise * np.exp(-np.arange(100) / 20)[:, None]
    phases = segment(Recording(gain * x, 10_000.0, "arbitrary"))
    assert [tap.impact for tap in phases.taps] == [12_000]
    assert phases.movement is None


@pytest.mark.parametrize("lag", [0, 1])
def test_correlation_is_taken_across_the_edges_of_blocks(lag):
    _, whole = expected(1)
    direct = (whole[lag:] * whole[: len(whole) - lag]).sum(axis=1).mean()
    assert filtered(1, 5).correlation(lag) == pytest.approx(direct, rel=1e-12)


def test_phases_do_not_depend_on_the_blocks(monkeypatch):
    rng = np.random.default_rng(2)
    signal = rng.normal(size=(40_000, 3)) * np.where(np.arange(40_000) < 15_000, 0.01, 1.0)[:, None]
    for at in (4000, 9000):
        signal[at : at + 200] += 9 * np.exp(-np.arange(200) / 30)[:, None]
    recording = Recording(signal, 10_000.0, "m/s^2", "r")
    again = segment(recording)
    monkeypatch.setattr(vibration_track, "BLOCK", 1 << 13)
    phases = segment(recording)
    assert phases.kind == "taps and movement"
    assert again.movement == phases.movement
    assert [tap.quality for tap in again.taps] == pytest.approx(
        [tap.quality for tap in phases.taps], rel=1e-9
    )
    assert [replace(tap, quality=1) for tap in again.taps] == [replace(tap, quality=1) for tap in phases.taps]


@pytest.mark.parametrize("turned", ["up", "down"])
def test_a_volume_that_is_turned_is_seen_in_what_it_leaves_of_gravity(turned):
    rng = np.random.default_rng(3)
    volume = np.minimum(np.arange(20_000) / 3000, 1.0)
    x = (9.8 * volume)[:, None] * [0.6, 0.0, 0.8] + 0.01 * rng.normal(size=(20_000, 3))
    recording = Recording(x if turned == "up" else x[::-1], 10_000.0, "m/s^2")
    first, stop = track(recording, hand_hz=60.0, bin_s=0.001, quiet_s=0.1).full
    kept = (first, 2000) if turned == "up" else (0, stop)
    assert (first, stop) == kept
    assert 150 <= 2000 - (stop - first) <= 330
