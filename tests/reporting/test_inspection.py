import matplotlib.image
import numpy as np
import pytest

from texclass.phases import segment
from texclass.recording import Phases, Recording, Tap
from texclass.reporting.inspection import draw_inspection


def _recording(n=20_000, n_axes=3, fs=10_000.0, **facts):
    rng = np.random.default_rng(0)
    x = 0.02 * rng.standard_normal((n, n_axes))
    x[n // 2 :] += rng.standard_normal((n - n // 2, n_axes))
    return Recording(x if n_axes > 1 else x[:, 0], fs, "m/s^2", "made", **facts)


def _is_picture(path):
    picture = matplotlib.image.imread(path)
    return picture.shape[0] > 800 and picture.shape[1] > 1000 and picture[..., :3].std() > 0.05


@pytest.mark.parametrize(
    "phases",
    [
        Phases(taps=(Tap(3000, 3500, 3700), Tap(5000, 5500, 5700)), movement=(10_000, 20_000), onset=10_000),
        Phases(taps=(Tap(0, 0, 20_000),)),
        Phases(movement=(0, 20_000)),
        Phases(notes=("neither taps nor movement",)),
    ],
)
def test_every_kind_of_phases_is_drawn(tmp_path, phases):
    draw_inspection(
        _recording(n_axes=3 if phases.taps else 1),
        phases,
        {"hardness": 3.2, "damping": float("nan")},
        tmp_path / "a.png",
    )
    assert _is_picture(tmp_path / "a.png")


@pytest.mark.parametrize("n", [1, 40])
def test_short_and_constant_recordings_are_drawn(tmp_path, n):
    recording = Recording(np.full(n, 9.81), 1000.0, "counts", "short")
    draw_inspection(recording, segment(recording), None, tmp_path / "a.png")
    assert _is_picture(tmp_path / "a.png")


def test_names_with_dollars_and_many_features_are_drawn(tmp_path):
    recording = _recording(material="a $b_{c$ d", flags=("clipped: 3 %",) * 9)
    values = {f"a_long_name_of_a_feature_${i}": 10.0**i for i in range(100)}
    draw_inspection(recording, Phases(), values, tmp_path / "a.png")
    assert _is_picture(tmp_path / "a.png")
