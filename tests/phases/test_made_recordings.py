"""Taps and movement of synthetic recordings that do not come from the simulator, by family."""

import numpy as np
import pytest
from made_recordings import FAMILIES, make, matched, overlap
from scipy import signal

from texclass.features.hardness import hardness
from texclass.features.phase_view import Views
from texclass.loaders import open_dataset
from texclass.phase_settings import PhaseSettings
from texclass.phases import find_phases
from texclass.recording import Recording, Tap

WITH_BOTH = [family for family, plan in FAMILIES.items() if plan.strokes_s and plan.n_taps[1]]
RATES_HZ = (2200.0, 5000.0, 10_000.0)


def scores(family, n, first=500):
    """Return F1 of taps, the mean overlap of movement and the number of false taps in `n` recordings."""
    n_correct = n_true = n_detected = 0
    overlaps = []
    for seed in range(first, first + n):
        recording = make(family, seed, fs=RATES_HZ[seed % 3])
        phases = find_phases(recording.with_(phases=None))
        n_correct += matched(recording.phases, phases, recording.fs)
        n_true += len(recording.phases.taps)
        n_detected += len(phases.taps)
        overlaps.append(overlap(recording.phases, phases))
    f1 = 2 * n_correct / max(1, n_true + n_detected)
    return f1, np.mean(overlaps), n_detected - n_correct


@pytest.mark.parametrize("family", WITH_BOTH)
def test_taps_and_movement_are_found_in_each_family_of_recordings(family):
    f1, shared, _ = scores(family, 8)
    assert f1 >= 0.93  # one tap in about 35 may be missed; the study in reports/ states the targets
    assert shared >= 0.95


def test_strokes_alone_contain_no_taps():
    _, shared, false = scores("strokes only", 12)
    assert shared >= 0.95
    assert false == 0


@pytest.mark.parametrize("family", [family for family, plan in FAMILIES.items() if plan.strokes_s is None])
def test_taps_that_ring_rebound_or_reverberate_are_not_movement(family):
    f1, shared, _ = scores(family, 8)
    assert f1 >= 0.95
    assert shared == 1.0  # no movement in any recording


@pytest.mark.parametrize("spacing_s", [0.04, 0.055, 0.07])
@pytest.mark.parametrize("ratio", [0.85, 1.0, 1.1, 1.8])
def test_a_tap_starts_with_its_first_hit_even_if_the_rebound_is_stronger(spacing_s, ratio):
    second = tapped(at=(0.5 + spacing_s, 0.9 + spacing_s), duration=1.4, decay_s=0.02) - 9.81
    phases = of(tapped(at=(0.5, 0.9), duration=1.4, decay_s=0.02) + ratio * second)
    assert impacts(phases) == [0.5, 0.9]
    assert phases.movement is None


def test_noise_between_taps_is_not_movement_unless_it_lasts():
    noise = 0.5 * np.random.default_rng(1).standard_normal(40_000)
    x = tapped(at=(0.5, 0.9, 2.6, 3.0), duration=4.0)
    for seconds, is_movement in ((0.8, False), (1.4, True)):
        running = np.abs(np.arange(40_000) - 17_500) < seconds / 2 * 1e4
        phases = of(x + noise * running)
        assert (phases.movement is not None) == is_movement
        assert impacts(phases)[:2] == [0.5, 0.9]


def tapped(fs=10_000.0, at=(0.5, 0.9, 1.3, 1.7), duration=2.3, decay_s=0.006, seed=3):
    """Return four taps with gravity."""
    t = np.arange(round(duration * fs)) / fs
    x = 0.02 * np.random.default_rng(seed).standard_normal(len(t)) + 9.81
    for impact in at:
        decay_t, hand = np.maximum(t - impact, 0.0), np.clip((impact - t) / 0.08, 0.0, 1.0)
        x += 30.0 * (t >= impact) * np.exp(-decay_t / decay_s) * (np.sin(2 * np.pi * 250 * decay_t) + 0.4)
        x -= 1.5 * np.sin(np.pi * hand) ** 2
    return x


def of(x, fs=10_000.0):
    return find_phases(Recording(x, fs, "m/s^2"))


def impacts(phases, fs=10_000.0, moved_s=0.0):
    return [round(tap.impact / fs - moved_s, 2) for tap in phases.taps]


@pytest.mark.parametrize("before_s", [0.05, 0.1, 0.5])
@pytest.mark.parametrize("value", ["zeros", "first"])
def test_padding_before_the_data_does_not_change_taps(before_s, value):
    x = tapped()
    padding = np.full(round(before_s * 1e4), 0.0 if value == "zeros" else x[0])
    phases = of(np.concatenate([padding, x]))
    assert impacts(phases, moved_s=before_s) == [0.5, 0.9, 1.3, 1.7]
    assert phases.movement is None


def test_padding_after_the_data_does_not_change_taps():
    assert impacts(of(np.concatenate([tapped(), np.zeros(2000)]))) == [0.5, 0.9, 1.3, 1.7]


@pytest.mark.parametrize("shape", [np.asarray, lambda up: np.sin(0.5 * np.pi * up) ** 2])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_fades_do_not_change_the_noise_floor(shape, gravity):
    x = tapped() - 9.81 + gravity
    x[:1500] *= shape(np.linspace(0.0, 1.0, 1500))
    x[-1500:] *= shape(np.linspace(1.0, 0.0, 1500))
    assert impacts(of(x)) == [0.5, 0.9, 1.3, 1.7]


@pytest.mark.parametrize("at", [2000, 4800, 7000, 8990, 20_500])
def test_a_glitch_is_not_a_tap_and_does_not_change_hardness(at):
    x = tapped()
    with_glitch = x.copy()
    with_glitch[at] += 60.0
    recording, spoiled = (Recording(y, 1e4, "m/s^2") for y in (x, with_glitch))
    phases, spoiled_phases = find_phases(recording), find_phases(spoiled)
    assert impacts(spoiled_phases) == impacts(phases)
    clean, dirty = (hardness(Views(r, p).tap) for r, p in ((recording, phases), (spoiled, spoiled_phases)))
    assert dirty == pytest.approx(clean, rel=0.02)


def test_ringing_between_taps_is_not_movement():
    phases = of(tapped(decay_s=0.06))
    assert impacts(phases) == [0.5, 0.9, 1.3, 1.7]
    assert phases.movement is None


def stroked(start_s=2.0, stroke_s=2.0, rest_s=0.0, seed=5):
    """Return four taps, and strokes from `start_s` on that are followed by rest."""
    rng = np.random.default_rng(seed)
    x = tapped(duration=start_s + stroke_s + rest_s)
    t = np.arange(len(x)) / 1e4
    band = signal.butter(2, (80, 500), "bandpass", fs=1e4, output="sos")
    rough = signal.sosfilt(band, rng.standard_normal(len(x)))
    speed = np.abs(np.sin(np.pi * (t - start_s) / 0.5)) * ((t >= start_s) & (t < start_s + stroke_s))
    return x + 4.0 * rough * np.sqrt(speed)


@pytest.mark.parametrize("wait_s", [0.08, 0.15, 0.3, 0.6])
def test_a_tap_just_before_a_stroke_is_separate_from_it(wait_s):
    phases = of(stroked(1.7 + wait_s))
    assert impacts(phases) == [0.5, 0.9, 1.3, 1.7]
    assert phases.onset / 1e4 == pytest.approx(1.7 + wait_s, abs=0.03)


@pytest.mark.parametrize("rest_s", [0.4, 0.7, 1.0])
def test_the_movement_ends_where_the_tool_rests(rest_s):
    _, last = of(stroked(rest_s=rest_s)).movement
    assert last / 1e4 == pytest.approx(4.0, abs=0.03)


def test_a_soft_tap_far_below_the_strongest_is_found_without_hand_motion():
    x = tapped(at=(0.5, 0.9))
    t = np.arange(len(x)) / 1e4
    x += 2.0 * np.sin(np.pi * np.clip((t - 1.5) / 0.006, 0.0, 1.0))
    assert impacts(of(x)) == [0.5, 0.9, 1.5]


def test_a_tap_softer_than_the_hand_motion_before_it_is_found():
    t = np.arange(20_000) / 1e4
    x = 0.02 * np.random.default_rng(0).standard_normal(20_000) + 9.81
    for at in (0.5, 1.0, 1.5):
        x -= 2.0 * np.sin(np.pi * np.clip((at - t) / 0.07, 0.0, 1.0)) ** 2
        x += 0.8 * np.sin(np.pi * np.clip((t - at) / 0.008, 0.0, 1.0))
    assert impacts(of(x)) == [0.5, 1.0, 1.5]


def test_strokes_barely_above_the_noise_start_at_their_onset():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(30_000) * np.where(np.arange(30_000) < 5000, 0.02, 0.06)
    first, last = of(x).movement
    assert first / 1e4 == pytest.approx(0.5, abs=0.02)
    assert last == 30_000


def test_quality_of_a_tap_decreases_with_the_noise_around_it():
    noise = np.random.default_rng(0).standard_normal(23_000)
    clear, noisy = of(tapped()), of(tapped() + 0.7 * noise)
    assert all(0.002 < tap.width / 1e4 < 0.03 for tap in clear.taps)
    assert min(tap.quality for tap in clear.taps) > 0.98
    assert len(noisy.taps) == 4
    assert max(tap.quality for tap in noisy.taps) < min(tap.quality for tap in clear.taps)


def test_with_contents_taps_no_movement_is_searched_for():
    x = tapped(duration=3.5)
    x[4_000:32_000] += np.random.default_rng(1).standard_normal(28_000)  # a machine is running
    assert of(x).movement is not None
    phases = find_phases(Recording(x, 1e4, "m/s^2"), PhaseSettings(contents="taps"))
    assert [tap.impact / 1e4 for tap in phases.taps] == pytest.approx([0.5, 0.9, 1.3, 1.7], abs=0.01)
    assert phases.movement is None


def test_all_taps_of_a_quarter_of_the_embedded_dataset_are_found_and_at_most_one_other():
    dataset = open_dataset("simulated")
    recipe, *_ = dataset.load.args  # the dataset does not provide the true phases
    surfaces = [surface.name for surface in recipe.surfaces]
    n_true = n_detected = n_correct = 0
    for entry in dataset.entries[::4]:
        recording = recipe.record(surfaces.index(entry.surface), entry.repetition)
        phases = find_phases(recording.with_(phases=None))
        n_correct += matched(recording.phases, phases, recording.fs)
        n_true += len(recording.phases.taps)
        n_detected += len(phases.taps)
        assert overlap(recording.phases, phases) > 0.95
    assert n_true == n_correct == 285
    assert n_detected <= n_true + 1


def test_eight_bit_quantisation_hides_at_most_one_tap():
    dataset = open_dataset("simulated6")
    missed = []
    for entry in dataset.entries[::6]:
        recording = dataset.load(entry).with_(phases=None)
        step = np.abs(recording.acceleration).max() / 127
        coarse = recording.with_(acceleration=step * np.round(recording.acceleration / step))
        expected, detected = find_phases(recording), find_phases(coarse)
        missed.append(abs(len(detected.taps) - len(expected.taps)))
        assert abs(detected.movement[0] - expected.movement[0]) < 0.1 * recording.fs
    assert sum(missed) <= 1


def test_an_invalid_quality_of_a_tap_is_rejected():
    with pytest.raises(ValueError, match="quality from 0 to 1"):
        Tap(1, 2, 3, quality=2.0)
