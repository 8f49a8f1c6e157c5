import numpy as np
import pytest

from texclass.loaders.files import check_acceleration, clipped_share
from texclass.recording import RecordingError

NOISE = np.random.default_rng(0).normal(size=20_000)


@pytest.mark.parametrize("limit", [0.5, 1.0, 1.5])
def test_the_share_of_clipped_samples_is_that_of_runs_at_the_rails(limit):
    smooth = np.convolve(NOISE, np.ones(8) / np.sqrt(8), "same")
    clipped = np.clip(smooth, -limit, limit)
    at_rail = np.abs(smooth) >= limit
    share = clipped_share(clipped)
    assert 0.7 * at_rail.mean() < share <= at_rail.mean()
    assert check_acceleration(clipped, ("x",), "r") == (
        f"clipped: {100 * share:.1f} % of the samples at full scale",
    )


@pytest.mark.parametrize("signal", [NOISE, np.sin(np.arange(5000) / 50), np.rint(20 * NOISE), np.sign(NOISE)])
def test_a_signal_within_its_range_is_not_called_clipped(signal):
    assert clipped_share(signal) < 1e-3


def test_a_slow_wave_that_is_merely_quantised_is_not_called_clipped():
    assert clipped_share(np.rint(100 * np.sin(np.arange(50_000) / 2000))) == 0


def test_one_clipped_axis_among_three_is_enough_for_the_flag():
    axes = np.column_stack([NOISE, NOISE, np.clip(np.cumsum(NOISE) % 50, 10, 40)])
    (flag,) = check_acceleration(axes, ("x", "y", "z"), "r")
    assert flag.startswith("clipped")


def test_a_dead_axis_is_flagged_by_name():
    axes = np.column_stack([NOISE, np.full_like(NOISE, 7.0)])
    assert check_acceleration(axes, ("x", "y"), "r") == ("constant: channel y",)


@pytest.mark.parametrize("axes", [np.full(100, 3.0), np.ones((100, 3))])
def test_a_recording_that_does_not_vary_is_refused(axes):
    with pytest.raises(RecordingError, match=r"r\.wav: acceleration is .* throughout"):
        check_acceleration(axes, ("x",), "r.wav")


def test_one_sample_is_not_a_recording():
    with pytest.raises(RecordingError, match="holds 1 sample; the rule is at least 2"):
        check_acceleration(np.ones(1), ("x",), "r")
