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


def _uniform(stamps, values, *, received=None, by_header=True, given=None):
    """Return the uniform signal of one channel, its rate and all flags."""
    received = stamps if received is None else received
    samples = np.asarray(values, float).reshape(len(stamps), 1, 1)
    signal, fs, _, flags = to_uniform_rate(samples, stamps, received, given, by_header=by_header, where="bag")
    return signal[:, 0], fs, flags


def _slow(n=N):
    return np.sin(2 * np.pi * 3 * np.arange(n) / FS)


def test_what_is_lost_is_counted_and_bridged():
    stamps = np.arange(N) * T
    kept = np.delete(np.arange(N), [40, 41, 42, 200, 300])
    signal, fs, flags = _uniform(stamps[kept], _slow()[kept])
    np.testing.assert_allclose(signal, _slow(), atol=0.06)
    np.testing.assert_array_equal(signal[kept], _slow()[kept])
    assert fs == FS
    assert flags == ("gaps: 5 messages missing in 3 gaps, interpolated", "rate: 100 Hz by the header stamps")


def test_stamps_of_today_say_what_stamps_from_zero_say():
    stamps = np.arange(N) * T + RNG.integers(-T // 5, T // 5, N)
    (signal, *told), (later, *said) = (_uniform(stamps + at, _slow()) for at in (0, 1_700_000_000 * 10**9))
    np.testing.assert_allclose(later, signal, atol=1e-9)
    assert said == told


def test_a_long_gap_leaves_the_longest_stretch():
    stamps = np.arange(N) * T
    kept = np.r_[0:150, 180:N]
    signal, _, flags = _uniform(stamps[kept], np.arange(N)[kept])
    np.testing.assert_array_equal(signal, np.arange(180, N))
    assert flags[0].startswith("divided: 1 gaps of up to 0.3 s; only the longest stretch")
    away = stamps + 10**10 * (np.arange(N) >= 150)  # nothing was sent for 10 s: no clock was set
    signal, _, flags = _uniform(away, np.arange(N))
    np.testing.assert_array_equal(signal, np.arange(150, N))
    assert flags[0].startswith("divided: 1 gaps of up to 10 s; only the longest stretch")


def test_duplicates_are_dropped_and_a_swapped_pair_is_put_in_order():
    order = np.r_[0:100, 99, 100:200, 201, 200, 202:N]
    signal, _, flags = _uniform(order * T, order)
    np.testing.assert_array_equal(signal, np.arange(N))
    assert [flag.split(":")[0] for flag in flags] == ["duplicates", "out of order", "rate"]


@pytest.mark.parametrize("jump_s", [-0.5, 86_400])
def test_a_clock_that_is_set_costs_no_sample(jump_s):
    received = np.arange(N) * T
    stamps = received + np.where(np.arange(N) >= 123, int(jump_s * 1e9), 0)
    signal, fs, flags = _uniform(stamps, np.arange(N), received=received)
    np.testing.assert_array_equal(signal, np.arange(N))
    assert fs == FS
    assert flags[0] == f"clock jumps: 1 (largest {jump_s + 0.01:+.3g} s), bridged by the times of receipt"


def test_jittering_headers_put_samples_where_they_were_taken():
    stamps = np.arange(N) * T + RNG.integers(-2_000_000, 2_000_000, N)
    signal, fs, flags = _uniform(stamps, np.sin(2 * np.pi * 3 * stamps / 1e9))
    np.testing.assert_allclose(signal[2:-2], _slow()[2:-2], atol=0.02)
    assert fs == FS
    assert flags[-1] == "jitter: 12 % of a period (rms), samples interpolated at their stamps"


def test_times_of_receipt_that_come_in_bursts_count_samples_only():
    for after_first in (np.sort(RNG.integers(0, 20_000, (N // 8, 8)), axis=1), 20_000 * np.arange(8)):
        received = ((np.arange(N).reshape(-1, 8) // 8 * 8 + 8) * T + after_first).ravel()
        signal, fs, flags = _uniform(received, np.arange(N), by_header=False)
        np.testing.assert_array_equal(signal, np.arange(N))
        assert fs == pytest.approx(FS, rel=0.01)
        assert flags[-1].endswith("samples taken as evenly spaced")


@pytest.mark.parametrize("fs", [400.0, 333.0, 150.0])
def test_stamps_in_whole_milliseconds_count_samples_only(fs):
    stamps = np.arange(N) * 1e9 / fs // 1_000_000 * 1_000_000
    signal, found, flags = _uniform(stamps.astype(np.int64), np.arange(N))
    np.testing.assert_array_equal(signal, np.arange(N))
    assert found == fs
    assert flags[-1].endswith("samples taken as evenly spaced")


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
def test_messages_at_one_instant_are_refused(stamps):
    with pytest.raises(RecordingError, match="Expected"):
        _uniform(np.array(stamps), RNG.normal(size=len(stamps)))


@settings(max_examples=150, deadline=None)
@given(st.lists(st.integers(-(2**62), 2**62) | st.integers(0, 2000), min_size=1, max_size=60), st.randoms())
def test_whatever_the_stamps_the_answer_is_bounded(stamps, random):
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


def test_a_clock_that_is_set_is_bridged_by_the_times_of_receipt_from_the_first_stamp_on():
    received = np.arange(20) * 0.01
    stamps = received + 5.0 + 100.0 * (np.arange(20) >= 10)
    bridged, told = _bridge_clock_jumps(stamps, received)
    np.testing.assert_allclose(bridged, received + 5.0, atol=1e-9)
    assert told.startswith("clock jumps: 1 (largest +100 s)")
    unchanged, told = _bridge_clock_jumps(received, received)
    np.testing.assert_array_equal(unchanged, received)
    assert not told


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
    kept = np.flatnonzero((np.random.default_rng(6).random(4000) >= share) | (np.arange(4000) % 1000 < 500))
    _, fs, flags = _uniform(kept * T, np.arange(4000)[kept])
    assert fs == FS
    assert not any("advance by" in flag for flag in flags)
