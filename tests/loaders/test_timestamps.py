import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texclass.loaders.timestamps import _bridge_clock_jumps, nominal_rate, to_uniform_rate
from texclass.recording import RecordingError

FS = 100.0
N = 400
T = 10_000_000
RNG = np.random.default_rng(0)


def _uniform(stamps, values, *, received=None, by_header=True, user_fs=None):
    """Return the uniform signal of one channel, its rate and all flags."""
    received = stamps if received is None else received
    samples = np.asarray(values, float).reshape(len(stamps), 1, 1)
    signal, fs, _, flags = to_uniform_rate(
        samples, stamps, received, user_fs, by_header=by_header, where="bag"
    )
    return signal[:, 0], fs, flags


def _slow(n=N):
    return np.sin(2 * np.pi * 3 * np.arange(n) / FS)


def test_lost_messages_are_counted_and_interpolated():
    stamps = np.arange(N) * T
    indices = np.delete(np.arange(N), [40, 41, 42, 200, 300])
    signal, fs, flags = _uniform(stamps[indices], _slow()[indices])
    np.testing.assert_allclose(signal, _slow(), atol=0.06)
    np.testing.assert_array_equal(signal[indices], _slow()[indices])
    assert fs == FS
    assert flags == (
        "gaps: 5 messages missing in 3 gaps, interpolated",
        "rate: 100 Hz by the header time stamps",
    )


def test_results_do_not_depend_on_the_first_time_stamp():
    stamps = np.arange(N) * T + RNG.integers(-T // 5, T // 5, N)
    (signal, *rest), (later_signal, *later_rest) = (
        _uniform(stamps + at, _slow()) for at in (0, 1_700_000_000 * 10**9)
    )
    np.testing.assert_allclose(later_signal, signal, atol=1e-9)
    assert later_rest == rest


def test_a_long_gap_leaves_the_longest_segment():
    stamps = np.arange(N) * T
    indices = np.r_[0:150, 180:N]
    signal, _, flags = _uniform(stamps[indices], np.arange(N)[indices])
    np.testing.assert_array_equal(signal, np.arange(180, N))
    assert flags[0].startswith("divided: 1 gaps of up to 0.3 s; only the longest segment")
    away = stamps + 10**10 * (np.arange(N) >= 150)  # nothing was sent for 10 s: no clock was set
    signal, _, flags = _uniform(away, np.arange(N))
    np.testing.assert_array_equal(signal, np.arange(150, N))
    assert flags[0].startswith("divided: 1 gaps of up to 10 s; only the longest segment")


def test_duplicates_are_dropped_and_a_swapped_pair_is_put_in_order():
    order = np.r_[0:100, 99, 100:200, 201, 200, 202:N]
    signal, _, flags = _uniform(order * T, order)
    np.testing.assert_array_equal(signal, np.arange(N))
    assert [flag.split(":")[0] for flag in flags] == ["duplicates", "out of order", "rate"]


@pytest.mark.parametrize("jump_s", [-0.5, 86_400])
def test_a_clock_jump_loses_no_sample(jump_s):
    received = np.arange(N) * T
    stamps = received + np.where(np.arange(N) >= 123, int(jump_s * 1e9), 0)
    signal, fs, flags = _uniform(stamps, np.arange(N), received=received)
    np.testing.assert_array_equal(signal, np.arange(N))
    assert fs == FS
    assert flags[0] == f"clock jumps: 1 (largest {jump_s + 0.01:+.3g} s), corrected by the times of receipt"


def test_samples_are_interpolated_at_jittering_header_time_stamps():
    stamps = np.arange(N) * T + RNG.integers(-2_000_000, 2_000_000, N)
    signal, fs, flags = _uniform(stamps, np.sin(2 * np.pi * 3 * stamps / 1e9))
    np.testing.assert_allclose(signal[2:-2], _slow()[2:-2], atol=0.02)
    assert fs == FS
    assert flags[-1] == "jitter: 12 % of a period (rms), samples interpolated at their time stamps"


def test_times_of_receipt_that_come_in_bursts_count_samples_only():
    for after_first in (np.sort(RNG.integers(0, 20_000, (N // 8, 8)), axis=1), 20_000 * np.arange(8)):
        received = ((np.arange(N).reshape(-1, 8) // 8 * 8 + 8) * T + after_first).ravel()
        signal, fs, flags = _uniform(received, np.arange(N), by_header=False)
        np.testing.assert_array_equal(signal, np.arange(N))
        assert fs == pytest.approx(FS, rel=0.01)
        assert flags[-1].endswith("samples assumed evenly spaced")


@pytest.mark.parametrize("fs", [400.0, 333.0, 150.0])
def test_stamps_in_whole_milliseconds_count_samples_only(fs):
    stamps = np.arange(N) * 1e9 / fs // 1_000_000 * 1_000_000
    signal, fs_out, flags = _uniform(stamps.astype(np.int64), np.arange(N))
    np.testing.assert_array_equal(signal, np.arange(N))
    assert fs_out == fs
    assert flags[-1].endswith("samples assumed evenly spaced")


def test_late_messages_are_not_losses():
    received = np.arange(N) * T
    received[100:104] = received[104]
    signal, fs, _ = _uniform(received, np.arange(N), by_header=False)
    np.testing.assert_array_equal(signal, np.arange(N))
    assert fs == FS


@pytest.mark.parametrize(
    ("measured", "nominal"), [(99.98, 100), (10_000.4, 10_000), (104.2, 104.2), (1125.2, 1125), (238.0, 238)]
)
def test_the_nominal_rate_is_the_roundest_within_a_thousandth(measured, nominal):
    assert nominal_rate(measured) == nominal


@pytest.mark.parametrize("stamps", [[0, 0, 0], [5], [3, 3]])
def test_messages_with_one_time_stamp_are_an_error(stamps):
    with pytest.raises(RecordingError, match="Expected"):
        _uniform(np.array(stamps), RNG.normal(size=len(stamps)))


@settings(max_examples=150, deadline=None)
@given(st.lists(st.integers(-(2**62), 2**62) | st.integers(0, 2000), min_size=1, max_size=60), st.randoms())
def test_results_are_bounded_for_all_time_stamps(stamps, random):
    received = np.sort(np.array([random.randrange(10**10) for _ in stamps]))
    try:
        signal, fs, _ = _uniform(
            np.array(stamps, np.int64), np.sin(np.arange(len(stamps))), received=received
        )
    except RecordingError:
        return
    assert len(signal) <= 2 * len(stamps) + 11
    assert np.isfinite(signal).all()
    assert fs > 0


def test_clock_jumps_are_corrected_from_the_first_time_stamp_on():
    received = np.arange(20) * 0.01
    stamps = received + 5.0 + 100.0 * (np.arange(20) >= 10)
    corrected, flag = _bridge_clock_jumps(stamps, received)
    np.testing.assert_allclose(corrected, received + 5.0, atol=1e-9)
    assert flag.startswith("clock jumps: 1 (largest +100 s)")
    unchanged, flag = _bridge_clock_jumps(received, received)
    np.testing.assert_array_equal(unchanged, received)
    assert not flag


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_rate_that_changes_divides_the_recording_and_is_reported(factor, jitter):
    step = np.concatenate((np.full(1000, T), np.full(3000, T / factor)))
    late = np.random.default_rng(5).integers(-1, 2, 4000) * int(jitter * T / factor / 2)
    stamps = np.cumsum(step).astype(np.int64) + late
    signal, fs, flags = _uniform(stamps, np.arange(4000))
    assert fs == FS * factor
    assert flags[0].startswith("divided: time stamps advance by 0.0")
    assert 2900 <= len(signal) <= 3100
    assert signal[-1] == pytest.approx(3999, abs=1)


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_losses_that_come_and_go_are_no_change_of_the_rate(share):
    indices = np.flatnonzero(
        (np.random.default_rng(6).random(4000) >= share) | (np.arange(4000) % 1000 < 500)
    )
    _, fs, flags = _uniform(indices * T, np.arange(4000)[indices])
    assert fs == FS
    assert not any("advance by" in flag for flag in flags)
