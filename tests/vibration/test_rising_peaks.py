from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from texclass.recording import Samples
from texclass.vibration.rising_peaks import segment_rising_peaks, vibration_band

FS = 10_000.0


def bounds_as_printed(x: Samples, d: float, alpha: float, beta: float) -> list[int]:
    """Return the bounds by the criterion as printed, peak by peak."""
    magnitude = np.abs(x)
    peaks = signal.find_peaks(np.pad(magnitude, 1))[0] - 1
    bounds, j = [0], 1
    for previous, current in pairwise(peaks):
        rise = magnitude[current] - magnitude[previous]
        if rise > d and rise > alpha * np.exp(-beta * j) * magnitude[previous]:
            bounds.append(int(previous + np.argmin(magnitude[previous:current])))
            j = 0
        j += 1
    return [*bounds, x.size]


@pytest.mark.parametrize(
    ("d", "alpha", "beta"), [(0.0, 0.0, 0.0), (0.3, 1.0, 0.05), (0.1, 0.5, 0.5), (0.0, 1.0, 0.0)]
)
def test_bounds_equal_those_of_the_criterion_as_printed(d: float, alpha: float, beta: float) -> None:
    x = signal.sosfilt(
        signal.butter(2, (100, 400), "bandpass", fs=FS, output="sos"),
        np.random.default_rng(0).standard_normal(20_000),
    )
    x /= x.std()
    segmentation = segment_rising_peaks(x, d, threshold=alpha, decay=beta)
    assert segmentation.bounds.tolist() == bounds_as_printed(x, d, alpha, beta)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.integers(-5, 5), min_size=1, max_size=60),
    st.integers(-900, 900),
    st.floats(0, 3),
    st.floats(0, 2),
)
def test_segments_cover_the_signal_and_do_not_depend_on_the_gain(
    values: list[int], exponent: int, d: float, alpha: float
) -> None:
    x = np.array(values, dtype=np.float64)
    segmentation = segment_rising_peaks(x, d, threshold=alpha)
    np.testing.assert_array_equal(np.concatenate(segmentation.split(x)), x)
    assert np.all(np.diff(segmentation.bounds) > 0)
    d_scaled = float(np.ldexp(d, exponent))
    if d == 0 or d_scaled >= np.finfo(float).tiny:
        scaled = segment_rising_peaks(np.ldexp(x, exponent), d_scaled, threshold=alpha)
        np.testing.assert_array_equal(scaled.bounds, segmentation.bounds)
        np.testing.assert_array_equal(scaled.n_peaks, segmentation.n_peaks)


def test_a_signal_without_a_rise_is_one_segment() -> None:
    for x in (np.zeros(50), np.array([3.0]), np.ones(7)):
        assert segment_rising_peaks(x, 0.0).bounds.tolist() == [0, x.size]


@pytest.mark.parametrize("pedestal", [0.0, 0.05])  # above it the floor decides, with it the share
def test_cut_off_is_the_lowest_frequency_that_satisfies_both_conditions(pedestal: float) -> None:
    f = np.arange(1000.0)
    Y = 1 / (1 + ((f - 120) / 30) ** 2) + pedestal
    Y += (0.0 if pedestal else 0.3) * np.exp(-(((f - 500) / 20) ** 2))
    band = vibration_band(f, Y, smoothing_hz=0.0)
    share = np.cumsum(Y) / Y.sum()

    def fits(i: int) -> bool:
        return bool(share[i] > 0.75 and np.all(Y[i + 1 :] < 0.1 * Y.max()))

    i = int(band.upper_hz)
    assert fits(i)
    assert not fits(i - 1)
    assert band.major_hz == 120


def test_band_does_not_depend_on_the_level() -> None:
    f = np.arange(0.0, 500.0, 0.5)
    Y = np.random.default_rng(2).exponential(size=f.size) * np.exp(-f / 100)
    for gain in (1e-200, 1e200):
        assert vibration_band(f, gain * Y, smoothing_hz=10.0) == vibration_band(f, Y, smoothing_hz=10.0)


def test_smoothing_prefers_a_broad_hump_to_one_high_bin() -> None:
    f = np.arange(500.0)
    Y = np.exp(-(((f - 200) / 40) ** 2))
    Y[20] = 2.0
    assert vibration_band(f, Y, smoothing_hz=0.0).major_hz == 20
    assert vibration_band(f, Y, smoothing_hz=10.0).major_hz == 200


@pytest.mark.parametrize("step_hz", [0.25, 1.0])
def test_smoothing_is_in_hertz_at_any_bin_width(step_hz: float) -> None:
    f = np.arange(0.0, 400.0, step_hz)
    band = vibration_band(f, (f == 200.0).astype(float), smoothing_hz=10.0)
    assert band.upper_hz == pytest.approx(200 + 10 * np.sqrt(2 * np.log(10)), abs=1.0)  # a tenth of the peak
