"""A scene's TOML is read strictly, and a path as it is written."""

import numpy as np
import pytest

from texclass.haptics.scene import read_path, read_scene, sweep
from texclass.haptics.scene.definition import examples

S8, NODES = 'simulated = "abdulali2016/S8"', "speeds_mm_s = [60, 120]\nforces_n = [0.8, 1.2]"


def test_everything_that_is_written_is_read(scene, toml):
    found = scene()
    assert (found.name, found.seed, found.source) == ("scene", 0, toml())
    assert (found.device.unit, found.device.band_hz, found.expected.forces_n) == (
        "m/s^2",
        (20, 450),
        (0.8, 1.2),
    )
    assert (found.tolerance.over, found.tolerance.level_db, found.tolerance.slope_db) == ("worst", None, 1.5)
    assert (found.surfaces["wood"].simulated, found.surfaces["wood"].friction) == ("abdulali2016/S8", 0.4)
    blind = scene(('"log_spectral_db"', '"gfc"'), ("limit = 4", "limit = 0.9"))
    assert blind.tolerance.level_db == 3.0
    for name in examples():
        assert read_scene(name).name == name
        assert all(surface.simulated for surface in read_scene(name).surfaces.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate_hz = 1000", "rate_hz = 40", "device.rate_hz is 40. Expected a number of at least 50"),
        ("rate_hz = 1000", "rate_hz = 1000\nrat = 1", "unknown key device.rat (did you mean device.rate_hz?"),
        ("[20, 450]", "[20, 600]", "band_hz is [20.0, 600.0]. Expected rising, at most rate_hz / 2"),
        ("[20, 450]", "[450, 20]", "device.band_hz: is [450.0, 20.0]. Expected rising numbers"),
        ("[60, 120]", "[0, 120]", "expected: speeds_mm_s begins at 0. Expected a positive number"),
        ('"log_spectral_db"', '"psnr"', "score is 'psnr'. Expected one of log_spectral_db, band_db, gfc"),
        ('"log_spectral_db"', '"gfc"', "limit is 4. Expected for gfc: at least 0, at most 0.9999"),
        ("limit = 4", "limit = 0", "tolerance: limit is 0. Expected for log_spectral_db: above 0"),
        ("contacts = 2", "contacts = 4.5", "budget.contacts is 4.5. Expected a whole number"),
        ("friction = 0.4", "friction = -1", "wood.friction is -1. Expected a number of at least 0"),
        ("friction = 0.4", 'dataset = "d"', "wood: sources are ['simulated', 'dataset']. Expected one"),
        (S8, "", "surfaces.wood: sources are []. Expected one of texture"),
        ("friction = 0.4", 'surface = "x"', "surface is 'x'. Expected it only with a dataset"),
        (S8, 'texture = "none.texture"', "wood.texture: is 'none.texture'. Expected an existing file"),
        (S8, "recordings = [{}]", "missing key surfaces.wood.recordings.1.file"),
        (S8, 'recordings = [{file = "scene.toml", speed = "v", force = 0}]', "1.force: is 0. Expected"),
        ("speeds_mm_s = [60, 120]", 'path = "p.csv"', "holds path, forces_n. Expected a path alone"),
        (NODES, 'path = "p.csv"', "expected: path: is 'p.csv'. Expected an existing file"),
    ],
)  # fmt: skip
def test_messages_name_file_key_value_and_rule(toml, old, new, message):
    with pytest.raises(ValueError, match=r"scene\.toml") as error:
        read_scene(toml((old, new)))
    assert message in str(error.value)


def test_a_scene_that_does_not_exist_lists_the_shipped_ones():
    with pytest.raises(FileNotFoundError, match=r"shipped scenes \(example"):
        read_scene("nowhere")


def test_a_path_gives_speed_force_surface_and_what_is_expected(tmp_path, scene):
    rows = ["time,x,y,force,surface", "0,0,0,1,wood", "1,30,40,1,wood", "2,60,80,2,", "3,90,120,2,tile"]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    path = read_path(tmp_path / "path.csv")
    np.testing.assert_allclose(path.speed_mm_s, 50.0)
    velocity, force, surfaces = path.at_rate(10.0)
    np.testing.assert_allclose(velocity, np.tile([30.0, 40.0], (30, 1)))
    assert (force[5], force[25]) == (1.0, 2.0)
    assert (surfaces[9], surfaces[20], surfaces[-1]) == ("wood", None, None)
    expected = scene((NODES, 'path = "path.csv"')).expected
    assert expected.speeds_mm_s == pytest.approx((50, 50))
    assert expected.forces_n == pytest.approx((1, 2))
    head = rows[0]
    for broken in (
        "time,x\n0,0",
        f"{head}\n0,0,0,1,a\n0,1,0,1,a",
        f"{head}\n0,0,0,1,a\n1,nan,0,1,a",
        "",
        "\x00",
    ):
        (tmp_path / "path.csv").write_text(broken)
        with pytest.raises(ValueError, match=r"path\.csv"):
            read_path(tmp_path / "path.csv")


def test_the_default_sweep_meets_every_surface_at_every_speed():
    path = sweep(["a", "b"], (40.0, 200.0), (0.5, 2.0), seconds=1.0)
    assert set(path.surface) == {"a", "b"}
    (slow, fast), _ = path.ranges()
    assert (slow, fast) == pytest.approx((48, 192), rel=0.01)  # of 40 to 200, but for 5 % at each end
    assert path.force_n.max() == pytest.approx(2.0, rel=1e-3)
