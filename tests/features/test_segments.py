import numpy as np
import pytest
from scipy import signal

from texclass.features.contract import UndefinedFeatureError
from texclass.features.decaying_segments import (
    kept,
    major_frequency,
    segment_order,
    segment_peaks,
    segment_rate,
    upper_cutoff,
)
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples


def ridges(rate: float, fs: float = 10_000.0, duration_s: float = 5.0) -> Samples:
    """A mode of 200 Hz struck `rate` times a second."""
    t = np.arange(round(duration_s * fs)) / fs
    excitation = np.zeros(t.size)
    excitation[(np.arange(int(duration_s * rate)) * fs / rate).astype(int)] = 1.0
    ring = np.exp(-150 * t[:500]) * np.sin(2 * np.pi * 200 * t[:500])
    return np.asarray(signal.fftconvolve(excitation, ring)[: t.size])


@pytest.mark.parametrize("rate", [10.0, 20.0, 32.0])
def test_segments_are_the_ridges_that_were_passed(rate: float) -> None:
    assert segment_rate(PhaseView(ridges(rate), 10_000.0)) == pytest.approx(rate, rel=0.05)


def test_fewer_peaks_fit_between_ridges_that_come_faster() -> None:
    slow, fast = (segment_peaks(PhaseView(ridges(rate), 10_000.0)) for rate in (10.0, 40.0))
    assert fast < slow


def test_major_frequency_is_that_of_a_hump_and_the_cut_off_lies_above() -> None:
    noise = np.random.default_rng(0).standard_normal(100_000)
    x = signal.sosfilt(signal.butter(2, (250, 350), "bandpass", fs=10_000, output="sos"), noise)
    view = PhaseView(np.asarray(x), 10_000.0)
    assert major_frequency(view) == pytest.approx(300, abs=15)
    assert 350 < upper_cutoff(view) < 600


def test_what_is_kept_is_the_band_at_unit_deviation() -> None:
    t = np.arange(50_000) / 10_000
    x = np.sin(2 * np.pi * 100 * t) + 3 * np.sin(2 * np.pi * 0.8 * t) + 0.01 * np.sin(2 * np.pi * 1900 * t)
    samples, fs = kept(PhaseView(x, 10_000.0), 15.0, 30.0)
    f, power = signal.periodogram(samples, fs)
    assert samples.std() == pytest.approx(1)
    assert power[np.abs(f - 100) < 5].sum() > 0.95 * power.sum()


def test_a_finer_resolution_asks_for_a_higher_order() -> None:
    view = PhaseView(np.random.default_rng(0).standard_normal(20_000), 10_000.0)
    orders = [segment_order(view, resolution=resolution) for resolution in (0.5, 0.2, 0.1)]
    assert orders == sorted(orders)
    assert orders[0] < orders[-1]


def test_a_rate_that_leaves_no_band_is_the_reason() -> None:
    with pytest.raises(UndefinedFeatureError, match="the rule is"):
        upper_cutoff(PhaseView(np.random.default_rng(0).standard_normal(1000), 1.0))
