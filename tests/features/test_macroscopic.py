import numpy as np
import pytest
from scipy import signal

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.features.roughness import (
    regularity,
    regularity_as_printed,
    spikiness,
    spikiness_as_printed,
    waviness,
    waviness_as_printed,
)
from texclass.recording import Samples

FS = 10_000.0
RNG = np.random.default_rng(3)


def low(x: Samples) -> Samples:
    """The 100 Hz low-pass by another road: a Butterworth filter run both ways over the full rate."""
    sos = signal.butter(2, 100, fs=FS, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, x))


def sma(x: Samples, n: int) -> Samples:
    """Centred moving average by a loop."""
    return np.array([x[max(0, i - n // 2) : i - n // 2 + n].mean() for i in range(x.size)])


def noise(n: int, seed: int = 0) -> Samples:
    x = np.random.default_rng(seed).standard_normal(n)
    return np.asarray(x - x.mean())


def test_waviness_as_printed_is_equation_5_written_out() -> None:
    x = noise(60_000) * (1 + 0.5 * np.sin(np.arange(60_000) / 8000))
    m = np.array([np.abs(frame).mean() for frame in low(x).reshape(-1, 200)])
    expected = np.log10(np.std(m - sma(m, 100)))
    assert waviness_as_printed(PhaseView(x, FS)) == pytest.approx(expected, abs=0.01)


def test_waviness_in_seconds_is_the_printed_one_at_the_rate_of_the_paper() -> None:
    view = PhaseView(noise(60_000), FS)
    assert waviness(view) == pytest.approx(waviness_as_printed(view), abs=1e-6)


def test_waviness_grows_with_the_modulation_of_low_frequencies() -> None:
    t = np.arange(60_000) / FS
    tone = np.sin(2 * np.pi * 50 * t)
    steady = waviness(PhaseView(tone + 0.01 * noise(t.size), FS))
    wavy = waviness(PhaseView(tone * (1 + 0.5 * np.sin(2 * np.pi * 3 * t)) + 0.01 * noise(t.size), FS))
    assert wavy > steady + 1


def test_spikiness_as_printed_is_equation_6_written_out() -> None:
    x = noise(30_000)
    x[1500::3000] += 80
    x -= x.mean()
    slow = low(x)
    threshold = 2 * np.std(slow) + slow.mean() + sma(slow, 5000)
    expected = np.log10(np.maximum(slow - threshold, 0).mean())
    assert spikiness_as_printed(PhaseView(x, FS)) == pytest.approx(expected, abs=0.02)


def test_spikiness_without_spikes_is_undefined_as_printed_and_its_floor_corrected() -> None:
    tone = PhaseView(np.sin(2 * np.pi * 50 * np.arange(30_000) / FS), FS)  # never reaches 2 sigma
    with pytest.raises(UndefinedFeatureError, match="spike threshold"):
        spikiness_as_printed(tone)
    sigma = np.sqrt(0.5) / (1 + 0.5**4)
    assert spikiness(tone) == pytest.approx(np.log10(1e-3 * sigma), abs=0.01)


def test_regularity_as_printed_is_equation_7_written_out() -> None:
    x = noise(3001)
    scaled = x / (x.max() - x.min())
    r = np.correlate(scaled, scaled, "full")[x.size - 1 :]
    expected = np.maximum(np.diff(r), 0).mean()
    assert regularity_as_printed(PhaseView(x, FS)) == pytest.approx(expected, rel=1e-5)


def test_regularity_as_printed_grows_with_length_and_the_corrected_one_does_not() -> None:
    short, long = PhaseView(noise(20_000), FS), PhaseView(noise(200_000, 1), FS)
    assert regularity_as_printed(long) > 2 * regularity_as_printed(short)
    assert regularity(long) == pytest.approx(regularity(short), rel=0.1)


@pytest.mark.parametrize("pitch_hz", [20.0, 80.0, 300.0])
def test_regularity_tells_a_grating_from_noise_at_any_pitch(pitch_hz: float) -> None:
    t = np.arange(30_000) / FS
    grating = signal.square(2 * np.pi * pitch_hz * t) + 0.1 * noise(t.size)
    assert regularity(PhaseView(grating, FS)) > 0.7
    assert regularity(PhaseView(noise(t.size), FS)) < 0.15


def test_regularity_of_a_sine_is_one() -> None:
    tone = np.sin(2 * np.pi * 100 * np.arange(30_000) / FS)
    assert regularity(PhaseView(tone, FS)) == pytest.approx(1, abs=0.01)


def test_frames_spread_over_a_long_movement_say_what_all_of_them_say() -> None:
    t = np.arange(400_000) / FS
    x = np.sin(2 * np.pi * 60 * t) * (t % 5 > 2) + noise(t.size)
    view = PhaseView(x, FS)
    assert regularity(view) == pytest.approx(regularity(view, n_frames=10_000), rel=0.05)
