import numpy as np
import pytest
from scipy import fft

from texclass.features.contract import UndefinedFeatureError
from texclass.features.hardness import damping_as_printed, hardness, hardness_as_printed, impulse_peaks
from texclass.features.phase_view import TapSignal, TapView
from texclass.recording import Samples

FS = 10_000.0


def bounces(*at: int, n: int = 1000) -> Samples:
    """Impulses of falling height, each 5 samples wide."""
    i = np.zeros(n)
    for height, start in zip((1.0, 0.6, 0.4, 0.2), at, strict=False):
        i[start : start + 5] += height * np.array([0.2, 0.7, 1.0, 0.7, 0.2])
    return i


HAND = 0.1 * np.sin(np.linspace(0, np.pi, 400))


def one(hand: Samples, impulse: Samples, fs: float = FS, noise: float = 0.0) -> TapView:
    return TapView((TapSignal(hand, impulse),), fs, noise)


def test_hardness_as_printed_is_equation_1_written_out() -> None:
    impulse = bounces(10, 250, 600)
    n_mean = ((10 + 2) + (250 + 2) + (600 + 2)) / 3 + 1
    expected = 1.0 / n_mean / sum(abs(h) for h in HAND)
    assert hardness_as_printed(one(HAND, impulse)) == pytest.approx(expected)


def test_a_fourth_impulse_and_one_too_near_do_not_count() -> None:
    np.testing.assert_array_equal(impulse_peaks(bounces(10, 250, 600, 900), 100, 0.01), [12, 252, 602])
    np.testing.assert_array_equal(impulse_peaks(bounces(10, 60, 600), 100, 0.01), [12, 602])


def test_fewer_than_three_impulses_take_the_mean_of_those_there_are() -> None:
    assert hardness_as_printed(one(HAND, bounces(10))) == pytest.approx(1 / 13 / np.abs(HAND).sum())
    np.testing.assert_array_equal(impulse_peaks(np.exp(-np.arange(50.0)), 100, 0.01), [0])


def test_printed_hardness_falls_with_the_square_of_the_rate_and_the_corrected_one_does_not() -> None:
    def at(fs: float) -> TapView:
        t = np.arange(round(0.1 * fs)) / fs
        return one(np.sin(np.pi * t / 0.1), np.exp(-80 * t) * np.sin(2 * np.pi * 250 * t), fs)

    slow, fast = at(10_000.0), at(40_000.0)
    assert hardness_as_printed(fast, spacing=400) == pytest.approx(hardness_as_printed(slow) / 16, rel=0.05)
    assert hardness(fast) == pytest.approx(hardness(slow), rel=0.02)


def test_corrected_hardness_is_impact_over_time_and_velocity() -> None:
    t, v = 13 / FS, np.abs(HAND).sum() / FS
    assert hardness(one(HAND, bounces(10))) == pytest.approx(1.0 / (t * v))


def test_noise_floor_leaves_the_velocity() -> None:
    hand = np.append(np.zeros(4000), HAND)
    noisy = hand + 0.01 * np.random.default_rng(0).standard_normal(hand.size)
    clean = hardness(one(hand, bounces(10)))
    assert hardness(one(noisy, bounces(10), noise=0.01)) == pytest.approx(clean, rel=0.05)
    assert hardness(one(noisy, bounces(10))) < 0.7 * clean  # what the noise would cost otherwise


@pytest.mark.parametrize("function", [hardness, hardness_as_printed])
def test_without_hand_acceleration_there_is_no_hardness(function) -> None:
    with pytest.raises(UndefinedFeatureError, match=r"before the contact is 0"):
        function(one(np.zeros(0), bounces(10)))


def test_damping_as_printed_is_equation_2_written_out() -> None:
    i = bounces(10, 250)
    spectrum = fft.dct(np.append(i, np.zeros(4096 - i.size)))
    k = np.arange(1, 2049)
    expected = np.sum(k * spectrum[1:2049] ** 2) / np.sum(spectrum[1:2049] ** 2)
    assert damping_as_printed(one(HAND, i)) == pytest.approx(expected)


def test_a_tap_without_a_value_is_left_out_of_the_mean() -> None:
    good, silent = TapSignal(HAND, bounces(10)), TapSignal(HAND, np.zeros(100))
    both = TapView((good, silent, good), FS)
    assert hardness_as_printed(both) == pytest.approx(hardness_as_printed(TapView((good,), FS)))
