"""Scene files are validated strictly, and hand paths are read and resampled."""

import numpy as np
import pytest

from texclass.haptics.exchange import play_texture, save_texture
from texclass.haptics.scene import plan_scene, read_path, read_scene, scene_from_texture, sweep_path
from texclass.haptics.scene.definition import shipped_scenes
from texclass.haptics.textures.hatt import HattTexture

S8, RANGES = 'simulated = "abdulali2016/S8"', "speeds_mm_s = [60, 120]\nforces_n = [0.8, 1.2]"


def test_all_keys_of_a_scene_file_are_read(scene, toml):
    definition = scene()
    assert (definition.name, definition.seed, definition.source) == ("scene", 0, toml())
    assert (definition.device.unit, definition.device.band_hz) == ("m/s^2", (20, 450))
    assert definition.motion.forces_n == (0.8, 1.2)
    tolerance, wood = definition.tolerance, definition.surfaces["wood"]
    assert (tolerance.aggregate, tolerance.level_db, tolerance.slope_db) == ("worst", None, 1.5)
    assert (wood.simulated, wood.friction) == ("abdulali2016/S8", 0.4)
    gfc = scene(('"log_spectral_db"', '"gfc"'), ("limit = 4", "limit = 0.9"))
    assert gfc.tolerance.level_db == 3.0
    for name in shipped_scenes():
        assert read_scene(name).name == name
        assert all(surface.simulated for surface in read_scene(name).surfaces.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate_hz = 1000", "rate_hz = 40", "device.rate_hz is 40. Expected a number of at least 50"),
        ("rate_hz = 1000", "rate_hz = 1000\nrat = 1", "unknown key device.rat (did you mean device.rate_hz?"),
        ("[20, 450]", "[20, 600]", "must increase and end at or below rate_hz / 2, got [20.0, 600.0]"),
        ("[20, 450]", "[450, 20]", "band_hz: must be two increasing, non-negative numbers, got [450.0"),
        ("[60, 120]", "[0, 120]", "motion: the lower end of speeds_mm_s must be positive, got 0"),
        ('"log_spectral_db"', '"psnr"', "score is 'psnr'. Expected one of log_spectral_db, band_db, gfc"),
        ('"log_spectral_db"', '"gfc"', "limit must be between 0 and 0.9999 for gfc, got 4"),
        ("limit = 4", "limit = 0", "tolerance: limit must be positive for log_spectral_db, got 0"),
        ("contacts = 2", "contacts = 4.5", "budget.contacts is 4.5. Expected a whole number"),
        ("friction = 0.4", "friction = -1", "wood.friction is -1. Expected a number of at least 0"),
        ("friction = 0.4", 'dataset = "d"', "recordings, dataset, got ['simulated', 'dataset']"),
        (S8, "", "surfaces.wood: must define exactly one of texture"),
        ("friction = 0.4", 'surface = "x"', "surface requires the key dataset, got only surface = 'x'"),
        (S8, 'texture = "none.texture"', "wood.texture: must be an existing file, got 'none.texture'"),
        (S8, "recordings = [{}]", "missing key surfaces.wood.recordings.1.file"),
        (S8, 'recordings = [{file = "scene.toml", speed = "v", force = 0}]', "force: must be a column name"),
        ("speeds_mm_s = [60, 120]", 'path = "p.csv"', "must define either path or speeds_mm_s"),
        (RANGES, 'path = "p.csv"', "motion: path: must be an existing file, got 'p.csv'"),
    ],
)  # fmt: skip
def test_messages_name_file_key_value_and_expected_value(toml, old, new, message):
    with pytest.raises(ValueError, match=r"scene\.toml") as error:
        read_scene(toml((old, new)))
    assert message in str(error.value)


def test_the_message_for_an_unknown_scene_lists_the_shipped_scenes():
    with pytest.raises(FileNotFoundError, match=r"shipped scene: example, twenty"):
        read_scene("nowhere")


def test_a_path_gives_speed_force_surface_and_the_motion_range(tmp_path, scene):
    rows = ["time,x,y,force,surface", "0,0,0,1,wood", "1,30,40,1,wood", "2,60,80,2,", "3,90,120,2,tile"]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    path = read_path(tmp_path / "path.csv")
    np.testing.assert_allclose(path.speed_mm_s, 50.0)
    velocity, force, surfaces = path.resample(10.0)
    np.testing.assert_allclose(velocity, np.tile([30.0, 40.0], (30, 1)))
    assert (force[5], force[25]) == (1.0, 2.0)
    assert (surfaces[9], surfaces[20], surfaces[-1]) == ("wood", None, None)
    motion = scene((RANGES, 'path = "path.csv"')).motion
    assert motion.speeds_mm_s == pytest.approx((50, 50))
    assert motion.forces_n == pytest.approx((1, 2))
    head = rows[0]
    for invalid in (
        "time,x\n0,0",
        f"{head}\n0,0,0,1,a\n0,1,0,1,a",
        f"{head}\n0,0,0,1,a\n1,nan,0,1,a",
        "",
        "\x00",
    ):
        (tmp_path / "path.csv").write_text(invalid)
        with pytest.raises(ValueError, match=r"path\.csv"):
            read_path(tmp_path / "path.csv")


def test_a_sweep_covers_every_surface_and_the_whole_range_of_speeds():
    path = sweep_path(["a", "b"], (40.0, 200.0), (0.5, 2.0), seconds=1.0)
    assert set(path.surfaces) == {"a", "b"}
    (slow, fast), _ = path.ranges()
    assert (slow, fast) == pytest.approx((48, 192), rel=0.01)  # 5th and 95th percentile of 40 to 200
    assert path.force_n.max() == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("speeds", [(20.0, 60.0), (100.0, 900.0)])
def test_a_page_of_a_texture_covers_the_range_of_its_recording(speeds, tmp_path):
    slow, fast = speeds
    lsf = [[0.6, 1.1]] * 4
    power = np.array([1.0, 8.0, 1.0, 8.0])
    fabric = HattTexture.from_models(
        [slow, fast, slow, fast], [0.1, 0.1, 0.3, 0.3], lsf, power, 1000.0, name="fabric"
    )
    path = save_texture(fabric, tmp_path / "fabric.texture")
    definition = scene_from_texture(path)
    assert definition.motion.speeds_mm_s == speeds
    assert definition.motion.forces_n == (0.1, 0.3)
    model = plan_scene(definition).scene.models[0]
    for v in speeds:
        expected = play_texture(fabric, speed=v, force=0.2, seconds=8.0).samples.std()
        level = np.sqrt(model.at([v], [0.2])[1][0])
        assert abs(20 * np.log10(level / expected)) < 1.5


def test_a_texture_of_one_speed_is_stroked_from_half_to_twice_that_speed(tmp_path):
    texture = HattTexture.from_models([80.0], [1.0], [[0.6, 1.1]], [1.0], 1000.0, name="oak")
    motion = scene_from_texture(save_texture(texture, tmp_path / "oak.texture")).motion
    assert (motion.speeds_mm_s, motion.forces_n) == ((40.0, 160.0), (0.5, 2.0))
