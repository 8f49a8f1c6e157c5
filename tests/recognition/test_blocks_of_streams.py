"""Blocks from messages with time stamps, and resampling of blocks."""

import numpy as np
import pytest
from scipy.signal import resample_poly

from texclass.recognition.sources.blocks import Block, BlockAssembler, Resampler, resampled
from texclass.recording import RecordingError

FS = 100.0
STEP = 10_000_000
START = 1_700_000_000_000_000_000


def _messages(n, k=1):
    """Return time stamps, and samples that count up, so that interpolated samples are known."""
    return START + np.arange(n) * STEP, np.arange(n * k, dtype=float).reshape(n, k, 1)


def _assemble(assembler, timestamps, samples, receipt=None, size=13):
    receipt = timestamps if receipt is None else receipt
    slices = [slice(i, i + size) for i in range(0, len(timestamps), size)]
    return [block for s in slices for block in assembler.push(timestamps[s], receipt[s], samples[s])]


def _flags(blocks):
    return [flag for block in blocks for flag in block.flags]


def _signal(blocks):
    return np.concatenate([block.samples for block in blocks])[:, 0]


@pytest.mark.parametrize("k", [1, 5])
@pytest.mark.parametrize("size", [1, 13, 500])
def test_a_regular_stream_is_unchanged(k, size):
    timestamps, samples = _messages(300, k)
    blocks = _assemble(BlockAssembler(FS * k, "m/s^2"), timestamps, samples, size=size)
    np.testing.assert_array_equal(_signal(blocks), np.arange(300 * k))
    assert _flags(blocks) == []
    assert {(block.fs, block.unit, block.n_lost) for block in blocks} == {(FS * k, "m/s^2", 0)}
    assert blocks[0].t_s == pytest.approx(START / 1e9 - (k - 1) / (FS * k), abs=1e-6)


def test_the_rate_is_measured_without_losing_samples():
    timestamps, samples = _messages(300)
    jitter = np.random.default_rng(0).integers(-100_000, 100_000, 300)
    assembler = BlockAssembler(None, "g")
    blocks = _assemble(assembler, timestamps + jitter, samples)
    np.testing.assert_array_equal(_signal(blocks), np.arange(300))
    assert assembler.fs == FS


def test_a_short_gap_is_interpolated():
    timestamps, samples = _messages(300)
    indices = np.delete(np.arange(300), [50, 51, 52, 200])
    assembler = BlockAssembler(FS, "g")
    blocks = _assemble(assembler, timestamps[indices], samples[indices])
    np.testing.assert_allclose(_signal(blocks), np.arange(300))
    assert sorted(_flags(blocks)) == ["gaps: 1 samples interpolated", "gaps: 3 samples interpolated"]
    assert assembler.n_lost == 4


def test_a_long_gap_is_counted_in_the_next_block():
    timestamps, samples = _messages(300)
    indices = np.r_[0:100, 140:300]
    assembler = BlockAssembler(FS, "g")
    blocks = _assemble(assembler, timestamps[indices], samples[indices])
    (block,) = [block for block in blocks if block.n_lost]
    assert block.n_lost == assembler.n_lost == 40
    assert block.samples[0, 0] == 140
    assert block.t_s == pytest.approx(START / 1e9 + 1.4, abs=1e-6)
    assert _flags(blocks) == ["lost: 40 samples"]


def test_duplicate_late_and_invalid_messages_are_left_out():
    timestamps, samples = _messages(100)
    samples[70] = np.nan
    order = [*range(20), 19, *range(20, 41), 42, 41, *range(43, 100)]
    blocks = _assemble(BlockAssembler(FS, "g"), timestamps[order], samples[order])
    np.testing.assert_allclose(_signal(blocks), np.arange(100))  # 41 and 70 are interpolated
    assert [flag for flag in _flags(blocks) if "left out" in flag] == [
        "duplicates: 1 messages left out",
        "out of order: 1 messages left out",
        "not finite: 1 messages left out",
    ]


@pytest.mark.parametrize("jump_s", [-3600, -0.2, 5, 86400])
def test_a_clock_jump_loses_no_sample(jump_s):
    receipt, samples = _messages(200)
    timestamps = receipt + np.where(np.arange(200) >= 120, int(jump_s * 1e9), 0)
    blocks = _assemble(BlockAssembler(FS, "g"), timestamps, samples, receipt=receipt)
    np.testing.assert_array_equal(_signal(blocks), np.arange(200))
    assert _flags(blocks) == [f"clock jumps: 1 (largest {abs(jump_s + 0.01):.3g} s)"]
    assert not any(block.n_lost for block in blocks)


def test_a_wrong_rate_is_reported_once():
    timestamps, samples = _messages(2000)
    flags = _flags(_assemble(BlockAssembler(FS * 1.1, "g"), timestamps, samples))
    assert [flag for flag in flags if flag.startswith("rate")] == [
        "rate: 100 Hz by the time stamps, but 110 Hz is assumed"
    ]


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
@pytest.mark.parametrize("size", [1, 13])
def test_the_rate_of_the_blocks_follows_a_change_of_the_rate(factor, size):
    """Half the rate is not a loss of every second message, twice the rate is not a wrong clock."""
    first = START + np.arange(400) * STEP
    second = first[-1] + np.rint(np.arange(1, 401) * STEP / factor).astype(int)
    samples = np.arange(800.0).reshape(800, 1, 1)
    blocks = _assemble(BlockAssembler(None, "g"), np.append(first, second), samples, size=size)
    assert [fs for i, block in enumerate(blocks) if (fs := block.fs) != (blocks[i - 1].fs if i else 0)] == [
        FS,
        FS * factor,
    ]
    x = _signal([block for block in blocks if block.fs != FS])
    np.testing.assert_array_equal(np.diff(x), 1)
    assert x[-1] == 799
    assert len(x) >= 400 - max(40, 0.5 * FS * factor)
    (new_fs,) = {b.fs for b in resampled((b for b in blocks), FS)}
    assert new_fs == FS
    # At least one sample is lost, and those that were in the filter.
    assert 1 <= sum(b.n_lost for b in resampled((b for b in blocks), FS)) <= 1 + 10


@pytest.mark.parametrize("kind", ["a third lost", "whole milliseconds", "bursts", "jitter"])
def test_loss_bursts_and_jitter_do_not_change_the_rate(kind):
    rng = np.random.default_rng(4)
    n = 3000
    timestamps = START + np.arange(n) * (STEP // 10)
    samples = np.arange(float(n)).reshape(n, 1, 1)
    if kind == "a third lost":
        indices = np.sort(rng.choice(n, 2 * n // 3, replace=False))
        timestamps, samples = timestamps[indices], samples[indices]
    elif kind == "whole milliseconds":
        timestamps = START + (np.arange(n) * 1.43).astype(int) * 1_000_000
    elif kind == "bursts":
        timestamps = np.repeat(timestamps[::30], 30) + np.tile(np.arange(30), n // 30) * 20_000
    else:
        timestamps += rng.integers(0, 600_000, n)
    fs = {"whole milliseconds": 1000 / 1.43}.get(kind, 1000.0)
    assert {block.fs for block in _assemble(BlockAssembler(fs, "g"), timestamps, samples)} == {fs}


def test_messages_of_another_size_raise_an_error():
    assembler = BlockAssembler(FS, "g")
    timestamps, samples = _messages(10)
    assembler.push(timestamps, timestamps, samples)
    with pytest.raises(RecordingError, match="messages must keep their shape"):
        assembler.push(timestamps, timestamps, np.zeros((10, 1, 2)))


def test_malicious_timestamps_do_not_fill_the_memory():
    rng = np.random.default_rng(3)
    timestamps = rng.integers(-(2**62), 2**62, 500)
    samples, receipt = rng.normal(size=(500, 1, 1)), rng.permutation(timestamps)
    blocks = _assemble(BlockAssembler(FS, "g"), timestamps, samples, receipt=receipt)
    assert sum(len(block.samples) for block in blocks) < 500 * 12


def _resample(x, fs, new_fs, sizes):
    resampler, outputs, start = Resampler(fs, new_fs), [], 0
    for size in sizes:
        outputs.append(resampler.push(x[start : start + size]))
        start += size
    return np.concatenate(outputs)


@pytest.mark.parametrize(
    ("fs", "new_fs"), [(1000, 500), (1000, 2000), (10_000, 4000), (100, 250), (997, 1000)]
)
def test_resampling_equals_resample_poly_of_scipy(fs, new_fs):
    x = np.random.default_rng(0).normal(size=(2000, 2))
    y = _resample(x, fs, new_fs, [2000])
    p, q = (new_fs // (g := np.gcd(fs, new_fs)), fs // g)
    expected = resample_poly(x, p, q, axis=0)
    np.testing.assert_allclose(y, expected[: len(y)], atol=1e-9)
    assert len(expected) - len(y) <= 1 + 10 * max(p, q) / q


@pytest.mark.parametrize("size", [1, 7, 250])
def test_resampling_does_not_depend_on_the_block_size(size):
    x = np.random.default_rng(1).normal(size=(1000, 3))
    sizes = [size] * (1000 // size + 1)
    np.testing.assert_array_equal(_resample(x, 1000, 400, sizes), _resample(x, 1000, 400, [1000]))


def test_resampling_to_the_same_rate_changes_nothing():
    x = np.random.default_rng(1).normal(size=(10, 1))
    assert Resampler(100, 100).push(x) is x


@pytest.mark.parametrize("new_fs", [0, -1, float("nan"), 1e9])
def test_an_impossible_rate_raises_an_error(new_fs):
    with pytest.raises(ValueError, match="Expected positive rates"):
        Resampler(1000, new_fs)


def test_lost_samples_restart_the_resampler_and_are_counted_at_the_new_rate():
    x = np.ones((400, 1))
    blocks = [Block(0.0, x, 1000, "g"), Block(0.5, x, 1000, "g", 100)]

    out = list(resampled((block for block in blocks), 500.0))
    assert [block.n_lost for block in out] == [0, 50 + 10]  # 10 samples were in the filter
    assert [block.t_s for block in out] == [0.0, 0.5]
    assert out[0].flags == ("resampled (band-limited) from 1000 Hz to 500 Hz",)
    assert {block.fs for block in out} == {500.0}


@pytest.mark.parametrize("n", [1, 5, 10, 11, 50])
@pytest.mark.parametrize("new_fs", [500.0, 2000.0])
def test_lost_samples_are_counted_after_resampling_for_any_block_size(n, new_fs):
    def blocks():
        for k in range(0, 3000, n):
            t_s = k / 1000 + 10.0 * (k >= 1500 // n * n)
            yield Block(t_s, np.ones((n, 1)), 1000.0, "m/s^2", 10_000 if k == 1500 // n * n else 0)

    out = list(resampled(blocks(), new_fs))
    (gap,) = [block for block in out if block.n_lost]
    ratio = new_fs / 1000
    n_in_filter = 3000 * ratio - sum(len(block.samples) for block in out) - (gap.n_lost - 10_000 * ratio)
    assert 0 <= n_in_filter <= 10 * max(ratio, 1) + 1
    assert gap.t_s == pytest.approx(11.5, abs=0.06)


def test_losses_between_blocks_that_are_too_short_for_the_filter_are_summed():
    blocks = [Block(k / 10, np.ones((5, 1)), 1000.0, "m/s^2", 95 if k else 0) for k in range(40)]
    out = list(resampled((block for block in blocks), 500.0))
    assert sum(len(block.samples) for block in out) == 0
    assert sum(block.n_lost for block in out) == pytest.approx(0.5 * (39 * 95 + 40 * 5), abs=40)


def test_a_silent_source_without_a_measured_rate_is_resampled():
    silent = Block(0.0, np.empty((0, 1)), 0.0, "m/s^2", 0, ("silence: no message for 1.0 s",))
    blocks = [silent, Block(1.0, np.ones((100, 1)), 1000.0, "m/s^2")]
    out = list(resampled((block for block in blocks), 500.0))
    assert out[0].flags == silent.flags
    assert {block.fs for block in out} == {500.0}
    assert sum(block.n_lost for block in out) == 0


def test_lost_samples_of_a_block_without_samples_are_counted_after_resampling():
    blocks = [
        Block(0.0, np.ones((100, 1)), 1000.0, "m/s^2"),
        Block(0.1, np.empty((0, 1)), 1000.0, "m/s^2", 500, ("lost: 500 samples",)),
        Block(0.6, np.ones((100, 1)), 1000.0, "m/s^2"),
    ]
    out = list(resampled((block for block in blocks), 500.0))
    assert [block.n_lost > 0 for block in out if len(block.samples)] == [False, True]
    assert sum(block.n_lost for block in out) >= 250


def test_times_of_receipt_replace_constant_timestamps_in_linear_time():
    n, fs = 30_000, 10_000
    receipt = START + np.arange(n) * (10**9 // fs)
    assembler, blocks = BlockAssembler(None, "g"), []
    n_concatenated = 0
    concatenate = np.concatenate

    def count(arrays, *args, **kwargs):
        nonlocal n_concatenated
        result = concatenate(arrays, *args, **kwargs)
        n_concatenated += len(result)
        return result

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(np, "concatenate", count)
        for k in range(0, n, 10):
            s = slice(k, k + 10)
            blocks += assembler.push(np.full(10, START), receipt[s], np.arange(n)[s, None, None] + 0.0)
    assert n_concatenated < 20 * n
    assert assembler.fs == fs
    np.testing.assert_array_equal(_signal(blocks), np.arange(n))
    assert [flag for flag in _flags(blocks) if flag.startswith("time stamps")] == [
        "time stamps: all are equal, times of receipt are used"
    ]


@pytest.mark.parametrize("fs", [2000, 1500])
@pytest.mark.parametrize("is_stated", [False, True])
@pytest.mark.parametrize("size", [1, 7, 50])
def test_a_coarse_clock_loses_no_sample_of_a_sensor_at_rest(fs, is_stated, size):
    rng = np.random.default_rng(1)
    n = 3 * fs
    values = np.round(rng.normal(size=n) * (rng.random(n) < 0.3), 1)
    values[:20] = np.arange(20)  # different values at equal time stamps reveal the coarse clock
    receipt = START + np.arange(n) * (10**9 // fs)
    timestamps = receipt // 10**6 * 10**6
    assembler, blocks = BlockAssembler(fs if is_stated else None, "g"), []
    for k in range(0, n, size):
        s = slice(k, k + size)
        blocks += assembler.push(timestamps[s], receipt[s], values[s, None, None])
    assert assembler.fs == fs
    # With a stated rate, three messages are needed to detect a coarse clock.
    assert assembler.n_lost <= 3 * is_stated
    np.testing.assert_array_equal(_signal(blocks)[-(n - 20) :], values[20:])
