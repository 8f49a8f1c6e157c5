"""A scene's TOML is read strictly, and a path as it is written."""

import numpy as np
import pytest

from texclass.scene import read_path, read_scene, sweep
from texclass.scene.definition import examples

SCENE = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[expected]
speeds_mm_s = [40, 200]
forces_n = [0.4, 2.0]
[tolerance]
score = "log_spectral_db"
limit = 3
[budget]
microseconds = 10
bytes = 100000
contacts = 4
[surfaces.wood]
simulated = "abdulali2016/S8"
friction = 0.4
"""


def written(folder, text):
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def test_everything_that_is_written_is_read(tmp_path):
    scene = read_scene(written(tmp_path, SCENE))
    assert (scene.name, scene.seed, scene.device.unit) == ("scene", 0, "m/s^2")
    assert scene.device.band_hz == (20, 450)
    assert scene.expected.forces_n == (0.4, 2.0)
    assert (scene.tolerance.over, scene.tolerance.level_db) == ("worst", None)
    wood = scene.surfaces["wood"]
    assert (wood.simulated, wood.friction) == ("abdulali2016/S8", 0.4)


@pytest.mark.parametrize("name", examples())
def test_shipped_scenes_are_valid_and_need_no_file(name):
    scene = read_scene(name)
    assert scene.name == name
    assert all(surface.simulated for surface in scene.surfaces.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate_hz = 1000", "rate_hz = true", "device.rate_hz is True; the rule is a number"),
        ("rate_hz = 1000", "rate_hz = 1000\nrat = 1", "unknown key device.rat; did you mean device.rate_hz?"),
        ("noise_floor = 0.05", "", "lacks the key device.noise_floor"),
        (
            "[20, 450]",
            "[20, 600]",
            "device: band_hz is [20.0, 600.0]; the rule is rising, at most rate_hz / 2",
        ),
        ("[20, 450]", "[450, 20]", "device.band_hz: is [450.0, 20.0]; the rule is rising numbers"),
        ("[40, 200]", "[0, 200]", "expected: speeds_mm_s begins at 0; the rule is above 0"),
        ('"log_spectral_db"', '"psnr"', "score is 'psnr'; the rule is one of log_spectral_db, band_db, gfc"),
        (
            '"log_spectral_db"',
            '"gfc"',
            "tolerance: limit is 3; the rule for gfc is at least 0, at most 0.9999",
        ),
        ("contacts = 4", "contacts = 4.5", "budget.contacts is 4.5; the rule is a whole number"),
        (
            "friction = 0.4",
            "friction = -1",
            "surfaces.wood.friction is -1; the rule is a number of at least 0",
        ),
        (
            "friction = 0.4",
            'dataset = "stylus6"',
            "surfaces.wood: sources are ['simulated', 'dataset']; the rule is one",
        ),
        ("friction = 0.4", 'material = "x"', "material is 'x'; the rule is beside a dataset only"),
        (
            'simulated = "abdulali2016/S8"',
            'texture = "none.texture"',
            "wood.texture: is 'none.texture'; the rule is an",
        ),
        (
            'simulated = "abdulali2016/S8"',
            "recordings = [{}]",
            "lacks the key surfaces.wood.recordings.1.file",
        ),
        (
            'simulated = "abdulali2016/S8"',
            'recordings = [{file = "scene.toml", speed = "v", force = 0}]',
            "recordings.1.force: is 0; the rule is the name of a column, or a number above 0",
        ),
        (
            "speeds_mm_s = [40, 200]",
            'path = "path.csv"',
            "expected: holds path, forces_n; the rule is a path alone",
        ),
        ("friction = 0.4", "[else]", "unknown key else; the rule is one of name, device"),
        ("[device]", "[device", "not valid TOML"),
    ],
)
def test_messages_name_file_key_value_and_rule(tmp_path, old, new, message):
    path = written(tmp_path, SCENE.replace(old, new))
    with pytest.raises(ValueError, match=r"scene\.toml") as error:
        read_scene(path)
    assert message in str(error.value)


def test_a_scene_that_does_not_exist_lists_the_shipped_ones():
    with pytest.raises(FileNotFoundError, match=r"shipped scenes \(example"):
        read_scene("nowhere")


def test_a_path_gives_speed_force_surface_and_what_is_expected(tmp_path):
    rows = ["time,x,y,force,surface", "0,0,0,1,wood", "1,30,40,1,wood", "2,60,80,2,", "3,90,120,2,tile"]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    path = read_path(tmp_path / "path.csv")
    np.testing.assert_allclose(path.speed_mm_s, 50.0)
    velocity, force, surfaces = path.at_rate(10.0)
    np.testing.assert_allclose(velocity, np.tile([30.0, 40.0], (30, 1)))
    assert (force[5], force[25]) == (1.0, 2.0)
    assert (surfaces[9], surfaces[20], surfaces[-1]) == ("wood", None, None)
    text = SCENE.replace("speeds_mm_s = [40, 200]\nforces_n = [0.4, 2.0]", 'path = "path.csv"')
    expected = read_scene(written(tmp_path, text)).expected
    assert expected.speeds_mm_s == pytest.approx((50, 50))
    assert expected.forces_n == pytest.approx((1, 2))


@pytest.mark.parametrize("rows", ["time,x\n0,0", "time,x,y,force,surface\n0,0,0,1,a\n0,1,0,1,a", "", "\x00"])
def test_a_broken_path_is_refused_with_its_name(tmp_path, rows):
    (tmp_path / "path.csv").write_text(rows)
    with pytest.raises(ValueError, match=r"path\.csv"):
        read_path(tmp_path / "path.csv")


def test_the_default_sweep_meets_every_surface_at_every_speed():
    path = sweep(["a", "b"], (40.0, 200.0), (0.5, 2.0), seconds=1.0)
    assert set(path.surface) == {"a", "b"}
    slow, fast = path.speed_range()
    assert slow < 60
    assert fast > 180
    assert path.force_n.max() == pytest.approx(2.0, rel=1e-3)
