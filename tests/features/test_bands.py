from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from texclass.features.bands import (
    band_level,
    octave_level,
    periodogram,
    whole_periodogram,
)
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples

FS = 2000.0


def noise(n: int, seed: int = 0) -> Samples:
    return np.random.default_rng(seed).standard_normal(n)


def test_level_of_white_noise_is_its_density_in_every_band() -> None:
    view = PhaseView(3 * noise(200_000), FS)
    expected = np.log10(9 / (FS / 2))
    np.testing.assert_allclose(band_level(view)[1:], expected, atol=0.02)
    np.testing.assert_allclose(octave_level(view), expected, atol=0.05)


def test_levels_follow_a_known_filter() -> None:
    b, a = signal.butter(2, 100, fs=FS)
    view = PhaseView(signal.lfilter(b, a, noise(400_000)), FS)
    edges = np.linspace(0, FS / 2, 25)
    f, h = signal.freqz(b, a, 2400, fs=FS)
    inside = np.array([np.mean(np.abs(h[(f >= lo) & (f < hi)]) ** 2) for lo, hi in pairwise(edges)])
    np.testing.assert_allclose(band_level(view)[1:-1], np.log10(inside / (FS / 2))[1:-1], atol=0.06)


def test_running_sum_obeys_parseval() -> None:
    x = noise(1000).astype(np.float32)
    found = periodogram(x, FS)
    power = found.density(np.array([0.0, FS / 2]))[0] * FS / 2
    assert power == pytest.approx(np.mean(np.diff(x) ** 2), rel=0.1)


def test_a_strong_slow_motion_does_not_leak_over_weak_high_frequencies() -> None:
    t = np.arange(2000) / FS
    weak = 1e-3 * noise(2000)
    alone = band_level(PhaseView(weak, FS))
    together = band_level(PhaseView(weak + np.sin(2 * np.pi * 3.3 * t), FS))
    np.testing.assert_allclose(together[6:], alone[6:], atol=0.1)


def test_a_tone_appears_in_its_band_alone() -> None:
    t = np.arange(20_000) / FS
    tone = np.sin(2 * np.pi * 520 * t)
    assert band_level(PhaseView(tone, FS)).argmax() == int(520 / (FS / 2 / 24))
    column = dict(zip(_names(), octave_level(PhaseView(np.sin(2 * np.pi * 100 * t), FS)), strict=True))
    assert max(column, key=lambda name: column[name]) == "o3.1"


def _names() -> list[str]:
    return [f"o{k}.{i}" for k in (2, 3, 4) for i in (1, 2, 3)]


def test_all_levels_cost_one_transform() -> None:
    view = PhaseView(noise(1000), FS)
    first = whole_periodogram(view)
    band_level(view)
    octave_level(view)
    assert whole_periodogram(view) is first


def test_deep_octaves_need_a_long_movement() -> None:
    assert np.isfinite(octave_level(PhaseView(noise(768), FS), octaves=(6, 8))).all()
    with pytest.raises(UndefinedFeatureError, match=r"767 samples; the rule is at least 768 .*3.91 Hz"):
        octave_level(PhaseView(noise(767), FS), octaves=(6, 8))
