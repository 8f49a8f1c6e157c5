"""Nulls, ceiling and separation on surfaces whose differences are known."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from texclass.signals import remove_hand_motion
from texclass.simulate import operator_catalogue, record_rising_speed, surface_catalogue
from texclass.vibration.null_scores import NULLS, distance_to_null, null_scores, same_or_different
from texclass.vibration.perceptual_distance import perceptual_distance
from texclass.vibration.scores import band_energy_distance, goodness_of_fit

FS = 2500.0


def surface(frequency_hz, seed, level=1.0, n=20_000):
    """Return noise with a resonance, and a level (RMS)."""
    r, w = 0.97, 2 * np.pi * frequency_hz / FS
    x = signal.lfilter([1], [1, -2 * r * np.cos(w), r * r], np.random.default_rng(seed).standard_normal(n))
    return level * x / x.std()


DIFFERENT = {f"{f:g} Hz": surface(f, i) for i, f in enumerate((60.0, 120.0, 240.0, 400.0))}
EQUAL = {f"copy {i}": surface(150.0, 10 + i) for i in range(5)}


def bands(recorded, candidate):
    return band_energy_distance(recorded, candidate, FS)


def perceptual(recorded, candidate):
    return perceptual_distance(recorded, candidate, FS, strongest_db=30)


@pytest.mark.parametrize(
    ("score", "higher_is_better"), [(goodness_of_fit, True), (bands, False), (perceptual, False)]
)
def test_the_ceiling_is_above_all_nulls_if_and_only_if_surfaces_differ(score, higher_is_better):
    for recordings, is_separable in ((DIFFERENT, True), (EQUAL, False)):
        nulls = null_scores(score, recordings, FS, higher_is_better=higher_is_better)
        ceiling = distance_to_null(nulls["other half"], nulls, higher_is_better=higher_is_better)
        pairs = same_or_different(score, recordings, FS, higher_is_better=higher_is_better, n_resamples=200)
        assert (ceiling["low"] > 0) == is_separable
        assert (pairs["auroc"] > 0.99) == is_separable
        assert is_separable or pairs["low"] < 0.5 < pairs["high"]


def test_the_best_null_is_the_highest_gfc_and_the_smallest_distance():
    for score, higher in ((goodness_of_fit, True), (bands, False)):
        nulls = null_scores(score, DIFFERENT, FS, higher_is_better=higher)
        extreme = nulls[list(NULLS)].max(axis=1) if higher else nulls[list(NULLS)].min(axis=1)
        assert_allclose(nulls["best null"], extreme)
        assert list(nulls.index) == list(DIFFERENT)


def test_candidates_have_the_level_of_the_known_half_or_their_own():
    """Other surfaces reveal the level of a recording only if they are scaled to it."""
    recordings = {"quiet": surface(100.0, 0, 1.0), "loud": surface(100.0, 1, 10.0)}

    def level_error(recorded, candidate):
        return abs(bands_level(recorded) - bands_level(candidate))

    def bands_level(x):
        f, density = signal.welch(x, FS, nperseg=1000)
        return 10 * np.log10(density[(f > 20) & (f < 1000)].sum())

    for equal_level, other_db in ((True, 0), (False, 20)):
        nulls = null_scores(level_error, recordings, FS, higher_is_better=False, equal_level=equal_level)
        assert_allclose(nulls["next surface"], other_db, atol=0.7)
        assert_allclose(nulls["mean of others"], other_db, atol=0.7)
        assert_allclose(nulls[["white noise", "other half"]], 0, atol=0.7)


def test_recordings_of_the_same_surface_are_no_nulls():
    recordings = {**DIFFERENT, "60 Hz again": surface(60.0, 20)}
    surfaces = {name: name.removesuffix(" again") for name in recordings}
    alone = null_scores(goodness_of_fit, recordings, FS, higher_is_better=True)
    labelled = null_scores(goodness_of_fit, recordings, FS, higher_is_better=True, surfaces=surfaces)
    assert alone.loc["60 Hz", "next surface"] > 0.95 > labelled.loc["60 Hz", "next surface"]
    pairs = same_or_different(bands, recordings, FS, higher_is_better=False, surfaces=surfaces)
    assert (pairs["n_same"], pairs["n_different"], pairs["auroc"]) == (5, 18, 1.0)


def test_the_mean_of_others_has_their_mean_spectrum():
    """Two other surfaces with resonances at 120 and 400 Hz: the null has both peaks."""
    candidates = []

    def keep(recorded, candidate):
        candidates.append(candidate)
        return 0.0

    three = {name: DIFFERENT[name] for name in ("60 Hz", "120 Hz", "400 Hz")}
    null_scores(keep, three, FS, higher_is_better=True, n_draws=1)
    # of the first recording: its half, white noise, two surfaces, the mean
    f, density = signal.welch(candidates[4], FS, nperseg=500)
    peaks = f[signal.argrelmax(density * (density > 0.2 * density.max()), order=20)[0]]
    assert_allclose(sorted(peaks)[:: len(peaks) - 1], [120, 400], atol=25)


def test_the_distance_to_a_null_has_its_sign_and_interval():
    nulls = pd.DataFrame({"best null": [1.0, 2.0, 3.0, 4.0]}, index=list("abcd"))
    scores = pd.Series([0.5, 1.0, 2.5, 5.0], index=list("abcd"))
    distance = distance_to_null(scores, nulls, higher_is_better=False)
    margin = np.array([0.5, 1.0, 0.5, -1.0])
    assert_allclose([distance["mean"], distance["n_better"], distance["n"]], [0.25, 3, 4])
    half = 3.182446 * margin.std(ddof=1) / 2  # t quantile of 3 degrees of freedom
    assert_allclose([distance["low"], distance["high"]], [0.25 - half, 0.25 + half], rtol=1e-6)
    assert distance_to_null(scores, nulls, higher_is_better=True)["mean"] == -0.25
    with pytest.raises(ValueError, match="nulls must contain all recordings of scores, but lack e"):
        distance_to_null(pd.Series({"e": 1.0}), nulls, higher_is_better=True)


def test_invalid_recordings_are_named():
    good = surface(100.0, 0)
    for recordings, message in (
        ({"a": good}, "at least two surfaces"),
        ({"a": good, "b": np.zeros(1000)}, "must not be silent"),
        ({"a": good, "b": [1.0, 2.0]}, r"recordings\['b'\] must be one channel of at least 8 samples"),
        ({"a": good, "b": np.full(1000, np.nan)}, r"recordings\['b'\] contains 1000 NaN"),
    ):
        for call in (null_scores, same_or_different):
            with pytest.raises(ValueError, match=message):
                call(bands, recordings, FS, higher_is_better=False)


def test_other_surfaces_of_the_gallery_have_a_high_gfc_but_a_larger_perceptual_distance():
    """The claims of examples/haptics/scores_and_nulls.py."""
    operator = operator_catalogue(1, seed=0)[0]
    vibrations = {}
    for one in surface_catalogue(8, seed=0):
        recording = record_rising_speed(one, operator, duration_s=5.0, fs=FS, seed=1, speed_mm_s=(80.0, 80.0))
        vibrations[one.name] = remove_hand_motion(recording.acceleration[2500:, 2], FS)
    gfc = null_scores(goodness_of_fit, vibrations, FS, higher_is_better=True)
    is_near = (gfc["best null"] > 0.975) & (gfc["other half"] - gfc["best null"] < 0.01)
    assert is_near.any()
    distance = null_scores(perceptual, vibrations, FS, higher_is_better=False)
    assert (distance["other half"] < distance["best null"]).all()
    for table, higher in ((gfc, True), (distance, False)):
        assert distance_to_null(table["other half"], table, higher_is_better=higher)["low"] > 0
