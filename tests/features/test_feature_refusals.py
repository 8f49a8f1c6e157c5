"""Undefined features: the reason names the value and what was expected."""

import numpy as np
import pytest
from feature_signals import FS, noise, tone

from texclass.features import autoregression, bands, fineness, related_work, roughness, slopes
from texclass.features.cepstrum import mfcc, mfcc_deviation
from texclass.features.channels import lag_correlation
from texclass.features.contract import UndefinedFeatureError
from texclass.features.decaying_segments import upper_cutoff

LONG, RAMP = noise(30_000), np.linspace(-1, 1, 2000)
CLICK = np.append(np.zeros(3000), [1.0, -1.0])  # frames are silent, the movement is not
LOW = 2000.0


@pytest.mark.parametrize(
    ("feature", "parameters", "x", "fs", "reason"),
    [
        (
            bands.octave_level,
            {"octaves": (6, 8)},
            LONG[:1023],
            LOW,
            "1023 samples. .* at least 1024 .*3.91 Hz",
        ),
        (bands.level_fluctuation, {}, LONG[:511], LOW, "511 samples. Expected at least 512"),
        (bands.band_course, {}, LONG[:287], LOW, "287 samples. Expected at least 288"),
        (slopes.curvature_shape, {}, RAMP, LOW, "second difference at lag 1 must be above"),
        (slopes.curvature_shape, {}, LONG[:127], LOW, "127 samples. Expected at least 128"),
        (slopes.curvature_level, {}, LONG[:127], LOW, "127 samples. Expected at least 128"),
        (slopes.slope_agreement, {}, LONG[:255], LOW, "255 samples. Expected at least 256"),
        (slopes.curvature_agreement, {}, LONG[:319], LOW, "319 samples. Expected at least 320"),
        (mfcc, {}, CLICK, FS, "silence: no energy between 0 and 1400 Hz"),
        (mfcc_deviation, {}, CLICK, FS, "silence: no energy between 0 and 1400 Hz"),
        (mfcc, {"n_filters": 80}, LONG, FS, r"mel filter 1 .* contains no bin"),
        (mfcc, {"coefficients": (1, 20)}, LONG, FS, r"must be 1 \.\.\. 19 .* got 20"),
        (autoregression.prediction_gain, {"orders": (1, 19)}, LONG, LOW, r"must be 1 \.\.\. 18 .* got 19"),
        (autoregression.resonances, {"n_resonances": 10}, LONG, LOW, "n_resonances must be .* got 10"),
        (lag_correlation, {"lags": (10,)}, noise(78).reshape(39, 2), 100.0, "39 samples. .* at least 40"),
        (roughness.temporal_roughness_as_printed, {}, LONG[:543], FS, "543 samples. .* at least 544"),
        (roughness.temporal_roughness, {}, LONG, LOW, "fs is 2000 Hz. Expected more than 2000 Hz"),
        (roughness.spikiness_as_printed, {}, tone(50, 30_000), FS, "spike threshold"),  # within 2 sigma
        (fineness.fineness, {}, LONG[:63], FS, "63 samples. Expected at least 64"),
        (fineness.grain_frequency, {}, LONG, 300.0, "fs is 300 Hz"),
        (fineness.grain_frequency, {}, LONG[:1900], FS, "three periods of 15 Hz"),
        (fineness.ridge_density, {}, LONG, 1000.0, "samples are 1 mm apart"),
        (related_work.spectral_peaks, {"n_peaks": 600}, LONG, FS, "spectral envelope. Expected 600"),
        (upper_cutoff, {}, LONG, 1.0, "Expected"),
    ],
)
def test_undefined_features_have_a_reason_with_the_expected_value(feature, parameters, x, fs, reason):
    with pytest.raises(UndefinedFeatureError, match=reason):
        feature(x, fs=fs, **parameters)


def test_one_more_sample_makes_the_feature_defined():
    assert np.isfinite(bands.octave_level(LONG[:1024], octaves=(6, 8), fs=LOW)).all()
    assert np.isfinite(roughness.temporal_roughness_as_printed(LONG[:544], fs=FS))
