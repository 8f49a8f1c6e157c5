"""Stamped messages become blocks; blocks of another rate are those of scipy, however they are divided."""

import numpy as np
import pytest
from scipy.signal import resample_poly

from texclass.recognition.sources.blocks import Block, Resampler, Timing, resampled
from texclass.recording import RecordingError

FS = 100.0
STEP = 10_000_000
START = 1_700_000_000_000_000_000


def _messages(n, k=1):
    """Return stamps and samples that count up, so that what is bridged by straight lines is known."""
    return START + np.arange(n) * STEP, np.arange(n * k, dtype=float).reshape(n, k, 1)


def _run(timing, stamps, samples, sent=None, size=13):
    sent = stamps if sent is None else sent
    parts = range(0, len(stamps), size)
    return [
        block
        for i in parts
        for block in timing.push(stamps[i : i + size], sent[i : i + size], samples[i : i + size])
    ]


def _flags(blocks):
    return [flag for block in blocks for flag in block.flags]


def _signal(blocks):
    return np.concatenate([block.samples for block in blocks])[:, 0]


@pytest.mark.parametrize("k", [1, 5])
@pytest.mark.parametrize("size", [1, 13, 500])
def test_a_regular_stream_is_passed_on(k, size):
    stamps, samples = _messages(300, k)
    blocks = _run(Timing(FS * k, "m/s^2"), stamps, samples, size=size)
    np.testing.assert_array_equal(_signal(blocks), np.arange(300 * k))
    assert _flags(blocks) == []
    assert {(block.fs, block.unit, block.lost) for block in blocks} == {(FS * k, "m/s^2", 0)}
    assert blocks[0].t_s == pytest.approx(START / 1e9 - (k - 1) / (FS * k), abs=1e-6)


def test_an_unstated_rate_is_measured_and_nothing_lost_meanwhile():
    stamps, samples = _messages(300)
    jitter = np.random.default_rng(0).integers(-100_000, 100_000, 300)
    timing = Timing(None, "g")
    np.testing.assert_array_equal(_signal(_run(timing, stamps + jitter, samples)), np.arange(300))
    assert timing.fs == FS


def test_a_short_gap_is_bridged():
    stamps, samples = _messages(300)
    kept = np.delete(np.arange(300), [50, 51, 52, 200])
    timing = Timing(FS, "g")
    blocks = _run(timing, stamps[kept], samples[kept])
    np.testing.assert_allclose(_signal(blocks), np.arange(300))
    assert sorted(_flags(blocks)) == ["gaps: 1 samples interpolated", "gaps: 3 samples interpolated"]
    assert timing.n_lost == 4


def test_a_long_gap_is_told_to_who_must_start_anew():
    stamps, samples = _messages(300)
    kept = np.r_[0:100, 140:300]
    timing = Timing(FS, "g")
    blocks = _run(timing, stamps[kept], samples[kept])
    (after,) = [block for block in blocks if block.lost]
    assert after.lost == timing.n_lost == 40
    assert after.samples[0, 0] == 140
    assert after.t_s == pytest.approx(START / 1e9 + 1.4, abs=1e-6)
    assert _flags(blocks) == ["lost: 40 samples"]


def test_duplicates_late_and_broken_messages_are_left_out():
    stamps, samples = _messages(100)
    samples[70] = np.nan
    order = [*range(20), 19, *range(20, 41), 42, 41, *range(43, 100)]
    blocks = _run(Timing(FS, "g"), stamps[order], samples[order])
    np.testing.assert_allclose(_signal(blocks), np.arange(100))  # 41 and 70 were bridged
    assert [flag for flag in _flags(blocks) if "left out" in flag] == [
        "duplicates: 1 messages left out",
        "out of order: 1 messages left out",
        "not finite: 1 messages left out",
    ]


@pytest.mark.parametrize("jump_s", [-3600, -0.2, 5, 86400])
def test_a_clock_that_is_set_is_survived(jump_s):
    stamps, samples = _messages(200)
    moved = stamps + np.where(np.arange(200) >= 120, int(jump_s * 1e9), 0)
    blocks = _run(Timing(FS, "g"), moved, samples, sent=stamps)
    np.testing.assert_array_equal(_signal(blocks), np.arange(200))
    assert _flags(blocks) == [f"clock jumps: 1 (largest {abs(jump_s + 0.01):.3g} s)"]
    assert not any(block.lost for block in blocks)


def test_a_wrong_rate_is_said_once():
    stamps, samples = _messages(2000)
    flags = _flags(_run(Timing(FS * 1.1, "g"), stamps, samples))
    assert [flag for flag in flags if flag.startswith("rate")] == [
        "rate: 100 Hz by the stamps, 110 Hz is assumed"
    ]


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
@pytest.mark.parametrize("size", [1, 13])
def test_a_rate_that_changes_gives_blocks_of_the_new_rate(factor, size):
    """Half the rate is not every second message lost, twice the rate no wrong clock."""
    before = START + np.arange(400) * STEP
    after = before[-1] + np.rint(np.arange(1, 401) * STEP / factor).astype(int)
    samples = np.arange(800.0).reshape(800, 1, 1)
    blocks = _run(Timing(None, "g"), np.append(before, after), samples, size=size)
    assert [fs for i, block in enumerate(blocks) if (fs := block.fs) != (blocks[i - 1].fs if i else 0)] == [
        FS,
        FS * factor,
    ]
    told = _signal([block for block in blocks if block.fs != FS])
    np.testing.assert_array_equal(np.diff(told), 1)
    assert told[-1] == 799
    assert len(told) >= 400 - max(40, 0.5 * FS * factor)
    (slower,) = {b.fs for b in resampled((b for b in blocks), FS)}
    assert slower == FS
    # One sample at least, and those that the filter held.
    assert 1 <= sum(b.lost for b in resampled((b for b in blocks), FS)) <= 1 + 10


@pytest.mark.parametrize("kind", ["a third lost", "whole milliseconds", "bursts", "jitter"])
def test_loss_bursts_and_jitter_are_no_new_rate(kind):
    rng = np.random.default_rng(4)
    n = 3000
    stamps = START + np.arange(n) * (STEP // 10)
    samples = np.arange(float(n)).reshape(n, 1, 1)
    if kind == "a third lost":
        kept = np.sort(rng.choice(n, 2 * n // 3, replace=False))
        stamps, samples = stamps[kept], samples[kept]
    elif kind == "whole milliseconds":
        stamps = START + (np.arange(n) * 1.43).astype(int) * 1_000_000
    elif kind == "bursts":
        stamps = np.repeat(stamps[::30], 30) + np.tile(np.arange(30), n // 30) * 20_000
    else:
        stamps += rng.integers(0, 600_000, n)
    fs = {"whole milliseconds": 1000 / 1.43}.get(kind, 1000.0)
    assert {block.fs for block in _run(Timing(fs, "g"), stamps, samples)} == {fs}


def test_messages_of_another_size_are_refused():
    timing = Timing(FS, "g")
    stamps, samples = _messages(10)
    timing.push(stamps, stamps, samples)
    with pytest.raises(RecordingError, match="Expected one size"):
        timing.push(stamps, stamps, np.zeros((10, 1, 2)))


def test_hostile_stamps_cost_no_memory():
    rng = np.random.default_rng(3)
    stamps = rng.integers(-(2**62), 2**62, 500)
    blocks = _run(Timing(FS, "g"), stamps, rng.normal(size=(500, 1, 1)), sent=rng.permutation(stamps))
    assert sum(len(block.samples) for block in blocks) < 500 * 12


def _pushed(x, fs, to, sizes):
    resampler, parts, at = Resampler(fs, to), [], 0
    for size in sizes:
        parts.append(resampler.push(x[at : at + size]))
        at += size
    return np.concatenate(parts)


@pytest.mark.parametrize(("fs", "to"), [(1000, 500), (1000, 2000), (10_000, 4000), (100, 250), (997, 1000)])
def test_the_stream_is_scipy_resampling_of_the_whole(fs, to):
    x = np.random.default_rng(0).normal(size=(2000, 2))
    y = _pushed(x, fs, to, [2000])
    p, q = (to // (g := np.gcd(fs, to)), fs // g)
    whole = resample_poly(x, p, q, axis=0)
    np.testing.assert_allclose(y, whole[: len(y)], atol=1e-9)
    assert len(whole) - len(y) <= 1 + 10 * max(p, q) / q


@pytest.mark.parametrize("size", [1, 7, 250])
def test_any_division_into_blocks_gives_the_same_numbers(size):
    x = np.random.default_rng(1).normal(size=(1000, 3))
    sizes = [size] * (1000 // size + 1)
    np.testing.assert_array_equal(_pushed(x, 1000, 400, sizes), _pushed(x, 1000, 400, [1000]))


def test_the_same_rate_changes_nothing():
    x = np.random.default_rng(1).normal(size=(10, 1))
    assert Resampler(100, 100).push(x) is x


@pytest.mark.parametrize("to", [0, -1, float("nan"), 1e9])
def test_an_impossible_rate_is_refused(to):
    with pytest.raises(ValueError, match="Expected positive rates"):
        Resampler(1000, to)


def test_a_loss_starts_anew_and_is_counted_at_the_new_rate():
    x = np.ones((400, 1))
    blocks = [Block(0.0, x, 1000, "g"), Block(0.5, x, 1000, "g", 100)]

    out = list(resampled((block for block in blocks), 500.0))
    assert [block.lost for block in out] == [0, 50 + 10]  # the filter held the last 10
    assert [block.t_s for block in out] == [0.0, 0.5]
    assert out[0].flags == ("resampled (band-limited) from 1000 Hz to 500 Hz",)
    assert {block.fs for block in out} == {500.0}


@pytest.mark.parametrize("n", [1, 5, 10, 11, 50])
@pytest.mark.parametrize("to", [500.0, 2000.0])
def test_a_loss_between_blocks_of_any_length_survives_resampling(n, to):
    def blocks():
        for k in range(0, 3000, n):
            at = k / 1000 + 10.0 * (k >= 1500 // n * n)
            yield Block(at, np.ones((n, 1)), 1000.0, "m/s^2", 10_000 if k == 1500 // n * n else 0)

    out = list(resampled(blocks(), to))
    (gap,) = [block for block in out if block.lost]
    held = 3000 * to / 1000 - sum(len(block.samples) for block in out) - (gap.lost - 10_000 * to / 1000)
    assert 0 <= held <= 10 * max(to / 1000, 1) + 1  # what the filter still held at the end
    assert gap.t_s == pytest.approx(11.5, abs=0.06)


def test_losses_between_blocks_that_are_too_short_for_the_filter_are_added_up():
    given = [Block(k / 10, np.ones((5, 1)), 1000.0, "m/s^2", 95 if k else 0) for k in range(40)]
    out = list(resampled((block for block in given), 500.0))
    assert sum(len(block.samples) for block in out) == 0
    assert sum(block.lost for block in out) == pytest.approx(0.5 * (39 * 95 + 40 * 5), abs=40)


def test_a_silent_source_whose_rate_is_not_known_yet_is_resampled():
    silent = Block(0.0, np.empty((0, 1)), 0.0, "m/s^2", 0, ("silent: nothing for 1.0 s",))
    given = [silent, Block(1.0, np.ones((100, 1)), 1000.0, "m/s^2")]
    out = list(resampled((block for block in given), 500.0))
    assert out[0].flags == silent.flags
    assert {block.fs for block in out} == {500.0}
    assert sum(block.lost for block in out) == 0


def test_a_loss_that_a_block_without_samples_reports_survives_resampling():
    given = [
        Block(0.0, np.ones((100, 1)), 1000.0, "m/s^2"),
        Block(0.1, np.empty((0, 1)), 1000.0, "m/s^2", 500, ("lost: 500 samples",)),
        Block(0.6, np.ones((100, 1)), 1000.0, "m/s^2"),
    ]
    out = list(resampled((block for block in given), 500.0))
    assert [block.lost > 0 for block in out if len(block.samples)] == [False, True]
    assert sum(block.lost for block in out) >= 250


def test_stamps_that_stand_still_cost_no_more_than_others_and_times_of_receipt_are_used():
    n, fs = 30_000, 10_000
    sent = START + np.arange(n) * (10**9 // fs)
    timing, made = Timing(None, "g"), []
    n_concatenated = 0
    whole = np.concatenate

    def counted(arrays, *rest, **more):
        nonlocal n_concatenated
        joined = whole(arrays, *rest, **more)
        n_concatenated += len(joined)
        return joined

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(np, "concatenate", counted)
        for k in range(0, n, 10):
            part = slice(k, k + 10)
            made += timing.push(np.full(10, START), sent[part], np.arange(n)[part, None, None] + 0.0)
    assert n_concatenated < 20 * n
    assert timing.fs == fs
    np.testing.assert_array_equal(_signal(made), np.arange(n))
    assert [flag for flag in _flags(made) if flag.startswith("stamps")] == [
        "stamps: those of the headers stand still, times of receipt are used"
    ]


@pytest.mark.parametrize("fs", [2000, 1500])
@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("size", [1, 7, 50])
def test_a_coarse_clock_loses_no_sample_of_a_sensor_at_rest(fs, given, size):
    rng = np.random.default_rng(1)
    n = 3 * fs
    values = np.round(rng.normal(size=n) * (rng.random(n) < 0.3), 1)
    values[:20] = np.arange(20)  # shows at once that values differ at equal stamps
    sent = START + np.arange(n) * (10**9 // fs)
    stamps = sent // 10**6 * 10**6
    timing, made = Timing(fs if given else None, "g"), []
    for k in range(0, n, size):
        part = slice(k, k + size)
        made += timing.push(stamps[part], sent[part], values[part, None, None])
    assert timing.fs == fs
    # With a given rate, the clock is known to be coarse after three messages.
    n_early = 3 * given
    assert timing.n_lost <= n_early
    np.testing.assert_array_equal(_signal(made)[-(n - 20) :], values[20:])
