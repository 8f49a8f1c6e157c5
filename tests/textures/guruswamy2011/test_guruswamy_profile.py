import numpy as np
import pytest

from texclass.textures.guruswamy2011 import band_of, profile_of

FS = 500.0


def rings(spacing: int = 100, n: int = 40, f: float = 30.0, B: float = 40.0) -> np.ndarray:
    t = np.arange(spacing) / FS
    return np.tile(5 * np.exp(-B * t) * np.sin(2 * np.pi * f * t), n)


def test_major_frequency_and_cut_off_of_a_narrow_band():
    rng = np.random.default_rng(0)
    x = np.convolve(rng.standard_normal(20_000), np.sin(2 * np.pi * 60 * np.arange(50) / FS), mode="same")
    band = band_of(x, FS)
    assert band.major_hz == pytest.approx(60, abs=2)
    assert 65 < band.upper_hz < 80


@pytest.mark.parametrize("f", [25.0, 40.0])
def test_every_ring_becomes_one_segment_that_begins_at_its_onset(f):
    profile = profile_of(rings(f=f), FS)
    assert profile.segmentation.n_segments == 40
    assert np.abs(profile.segmentation.bounds[1:-1] - 100 * np.arange(1, 40)).max() <= 5


def test_a_filter_that_runs_backwards_cuts_onsets_into_pieces():
    x = rings(f=40.0) + rings(f=100.0, B=200.0)
    causal, zero = (profile_of(x, FS, phase=phase).segmentation.n_segments for phase in ("causal", "zero"))
    assert causal == 40
    assert zero > 1.2 * causal


def test_the_delay_is_taken_back():
    x = rings()
    profile = profile_of(x, FS)
    lags = np.arange(-8, 9)
    overlap = [np.dot(np.roll(profile.samples, lag), x) for lag in lags]
    assert abs(lags[int(np.argmax(overlap))]) <= 1


def test_nothing_is_cut_where_the_band_reaches_half_the_rate():
    x = np.random.default_rng(1).standard_normal(4000)
    profile = profile_of(x, FS, resolution=0.01)
    assert profile.cutoff_hz == FS / 2
    assert np.abs(profile.samples - (x - x.mean()))[1000:].max() < 0.3


def test_drift_is_left_out():
    x = rings()
    drifting = profile_of(x + 3 * np.sin(2 * np.pi * 0.02 * np.arange(x.size) / FS), FS)
    assert abs(drifting.samples[1000:].mean()) < 0.1


@pytest.mark.parametrize("bad", [np.zeros(100), np.ones(4), np.full(100, np.nan), np.ones((50, 2))])
def test_silence_and_broken_signals_are_refused(bad):
    with pytest.raises(ValueError, match="the rule is 8 samples"):
        profile_of(bad, FS)
