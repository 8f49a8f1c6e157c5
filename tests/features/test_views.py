import numpy as np
import pytest

from texclass.features import FeatureExtractor
from texclass.features.phase_view import channels_apart, views_of
from texclass.recording import Phases, Recording


def inertial(seed: int = 0) -> Recording:
    rng = np.random.default_rng(seed)
    return Recording(
        rng.standard_normal((600, 3)),
        100.0,
        "m/s^2",
        f"run{seed}",
        channels=("ax", "ay", "az"),
        turn_rate=rng.standard_normal((600, 3)),
        phases=Phases(movement=(0, 600)),
    )


def test_all_adds_the_axes_of_the_turn_rate() -> None:
    recording = inertial()
    assert channels_apart(recording, "all") == ("ax", "ay", "az", "turn_x", "turn_y", "turn_z")
    assert channels_apart(recording, "each") == ("ax", "ay", "az")
    assert channels_apart(recording.with_(turn_rate=None), "all") == ("ax", "ay", "az")


def test_a_view_of_the_turn_rate_holds_that_axis_without_its_mean() -> None:
    recording = inertial()
    views = views_of(recording, channels_apart(recording, "all"))
    turn = recording.turn_rate
    assert turn is not None
    expected = turn[:, 1] - turn[:, 1].mean()
    np.testing.assert_allclose(views["turn_y/"].movement.samples, expected)
    expected = recording.acceleration[:, 2] - recording.acceleration[:, 2].mean()
    np.testing.assert_allclose(views["az/"].movement.samples, expected)


def test_extractor_names_six_channels_and_refuses_a_recording_that_lacks_some() -> None:
    extractor = FeatureExtractor("coarse", channels="all").fit([inertial()])
    values = extractor.transform([inertial(), inertial(1)])
    assert values.shape == (2, 6 * 15)
    assert np.isfinite(values).all()
    assert "turn_z/band_level.b12" in extractor.get_feature_names_out()
    with pytest.raises(ValueError, match=r"channels are .*; the rule is"):
        extractor.transform([inertial().with_(turn_rate=None)])
