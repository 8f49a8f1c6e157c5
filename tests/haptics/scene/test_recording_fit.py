"""Textures fitted to recordings follow speed and force as far as held-out halves support it."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import describe, load_texture
from texclass.haptics.scene import fit_recordings
from texclass.haptics.textures.contract import constant_stroke
from texclass.loaders import open_dataset
from texclass.recording import Recording
from texclass.signals import remove_hand_motion

FS = 1000.0
T = np.arange(round(20 * FS)) / FS
SPEED = 100 * 2 ** (1.3 * np.sin(2 * np.pi * 0.23 * T))
FORCE = 1.0 * 2 ** (1.2 * np.cos(2 * np.pi * 0.31 * T))


def noise(seed=0, pole=0.8, n=T.size):
    return lfilter([0.6], [1, -pole], np.random.default_rng(seed).standard_normal(n))


def record(alpha=1.0, beta=0.5, *, seed=0, speed=SPEED, force=FORCE, fs=FS, unit="m/s^2"):
    """Return noise whose level is proportional to speed^alpha force^beta."""
    level = (speed / 100) ** alpha * force**beta
    return Recording(level * noise(seed, n=speed.size), fs, unit, "oak", speed=speed, normal_force=force)


def level_of(texture, speed, force):
    x = constant_stroke(texture, speed, force, 20_000, n_settling=500, seed=1)
    return 20 * np.log10(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize(
    ("alpha", "beta", "level"),
    [(1.0, 0.5, (2, 2)), (1.0, 0.0, (2, 1)), (0.0, 0.7, (1, 2)), (0.0, 0.0, (1, 1))],
)
def test_the_level_follows_exactly_what_it_depends_on(alpha, beta, level):
    fit = fit_recordings([record(alpha, beta)])
    assert fit.candidate.level == level
    assert fit.candidate.spectrum == (1, 1)
    slow, fast = fit.texture.speeds[[0, -1]]
    light, hard = fit.texture.forces[[0, -1]]
    texture = fit.texture
    rise = level_of(texture, fast, 1.0) - level_of(texture, slow, 1.0)
    assert rise == pytest.approx(20 * alpha * np.log10(fast / slow), abs=0.7)
    rise = level_of(texture, 100, hard) - level_of(texture, 100, light)
    assert rise == pytest.approx(20 * beta * np.log10(hard / light), abs=0.7)
    recorded = remove_hand_motion(noise(), FS)
    assert level_of(texture, 100, 1.0) == pytest.approx(20 * np.log10(np.std(recorded)), abs=0.4)


def test_a_spectrum_that_changes_with_the_speed_is_followed():
    slow, fast = noise(1, 0.9), noise(2, -0.5)
    w = np.clip(np.log2(SPEED / 40) / np.log2(250 / 40), 0, 1)
    recording = record().with_(acceleration=np.sqrt(1 - w) * slow + np.sqrt(w) * fast)
    fit = fit_recordings([recording])
    assert fit.candidate.spectrum[0] > 1
    assert fit.spectrum_errors_db[0] < 0.6 * fit.spectrum_errors_db[1]
    low_share = []
    for speed in fit.texture.speeds[[0, -1]]:
        x = constant_stroke(fit.texture, speed, 1.0, 20_000, n_settling=500)
        power = np.abs(np.fft.rfft(x)) ** 2
        low_share.append(power[: x.size // 5].sum() / power.sum())
    assert low_share[0] > 0.8
    assert low_share[1] < 0.6


def test_errors_are_those_of_held_out_halves_next_to_a_constant_texture():
    fit = fit_recordings([record()])
    # A frame of 125 samples of this noise has about 15 independent values: 10 log10(e) sqrt(2 / 15) = 1.6 dB.
    assert fit.level_errors_db[0] == pytest.approx(1.6, abs=0.4)
    true_levels = 20 * np.log10(SPEED / 100) + 10 * np.log10(FORCE)
    assert fit.level_errors_db[1] == pytest.approx(true_levels.std(), rel=0.2)
    assert fit.level_r_squared > 0.9
    assert not fit.notices


def test_a_level_that_does_not_depend_on_the_motion_gives_one_notice():
    fit = fit_recordings([record(0.0, 0.0)])
    (notice,) = fit.notices
    assert "speed and force explain only" in notice
    assert fit.level_r_squared < 0.1
    assert fit.level_errors_db[0] == fit.level_errors_db[1]


def test_constant_motion_gives_a_notice_and_a_model_without_a_dependence():
    fit = fit_recordings([record(speed=np.full(T.size, 80.0), force=np.full(T.size, 1.5))])
    assert fit.candidate.level == (1, 1)
    assert fit.texture.speeds.tolist() == pytest.approx([80.0])
    (notice,) = fit.notices
    assert notice.startswith("speed and force hardly varied")


def test_the_range_of_the_texture_is_that_of_the_recording():
    fit = fit_recordings([record()])
    for nodes, signal in ((fit.texture.speeds, SPEED), (fit.texture.forces, FORCE)):
        low, high = np.quantile(signal, [0.05, 0.95])
        assert nodes[0] == pytest.approx(low, rel=0.05)
        assert nodes[-1] == pytest.approx(high, rel=0.05)


def test_outliers_of_motion_and_glitches_do_not_move_the_fit_and_are_reported_once():
    valid = record()
    speed, force, x = SPEED.copy(), FORCE.copy(), valid.acceleration.copy()
    speed[1000], force[7000], x[9000] = 4e4, 505_831.0, 1e4
    wrong = valid.with_(speed=speed, normal_force=force, acceleration=x)
    fits = [fit_recordings([recording]) for recording in (valid, wrong)]
    np.testing.assert_allclose(fits[1].texture.grid.power, fits[0].texture.grid.power, rtol=0.01)
    assert fits[1].texture.grid.peak == pytest.approx(fits[0].texture.grid.peak, rel=0.01)
    assert len(fits[1].notices) == 2
    assert "505831 N at 7 s" in fits[1].notices[1]


def test_without_exclusion_one_outlier_would_spoil_the_regression_of_the_level(monkeypatch):
    force = FORCE.copy()
    force[7000] = 505_831.0
    recording = record().with_(normal_force=force)
    valid, excluded = (fit_recordings([each]).level_r_squared for each in (record(), recording))
    monkeypatch.setattr("texclass.haptics.textures.scan.exclude_outliers", lambda x, *_: x)
    assert excluded == pytest.approx(valid, abs=1e-3)
    assert fit_recordings([recording]).level_r_squared < valid - 0.05


def test_rest_and_air_are_excluded_wherever_they_are():
    speed, force = SPEED.copy(), FORCE.copy()
    speed[:7000], force[12_000:14_000] = 0.0, 0.0
    fit = fit_recordings([record(speed=speed, force=force)])
    assert fit.n_frames == pytest.approx(88, abs=2)
    assert fit.n_frames + fit.n_rest == pytest.approx(160, abs=1)
    assert fit.candidate.level == (2, 2)


@pytest.mark.parametrize("n", [99_999, 100_001, 99_996])
def test_lengths_that_the_decimation_does_not_divide_are_accepted(n):
    speed, force = (np.repeat(signal, 10)[:n] for signal in (SPEED, FORCE))
    fit = fit_recordings([record(speed=speed, force=force, fs=10_000.0)])
    assert fit.n_frames == pytest.approx(79, abs=1)


def test_several_recordings_a_negative_force_and_a_high_rate_are_accepted():
    fits = fit_recordings([record(seed=0), record(seed=1)])
    assert fits.n_frames == 320
    reversed_fit = fit_recordings([record().with_(normal_force=-FORCE)])
    assert reversed_fit.texture.forces[0] > 0
    assert "its sign was changed" in reversed_fit.notices[0]
    fast = [np.repeat(signal, 10)[:100_000] for signal in (SPEED, FORCE)]
    assert fit_recordings([record(speed=fast[0], force=fast[1], fs=10_000.0)]).texture.fs == 2000.0


@pytest.mark.parametrize(
    ("recordings", "match"),
    [
        ([record(speed=SPEED[:3000], force=FORCE[:3000])], "at least 32 frames of 0.125 s .* got 24"),
        ([record(), record(unit="g")], None),
        ([record(), record(unit="V")], "the same unit"),
        ([record(), record(fs=500.0)], "the same fs"),
        ([record(force=np.full(T.size, 0.001))], "check the columns and units"),
        ([record().with_(speed=None)], "no speed or no normal force"),
        ([], "at least one recording"),
        ([record(fs=80.0)], "fs must be at least 100 Hz, got 80 Hz"),
    ],
)
def test_unusable_recordings_are_refused_with_their_values(recordings, match):
    if match is None:  # g is converted to m/s^2
        assert fit_recordings(recordings).unit == "m/s^2"
        return
    with pytest.raises(ValueError, match=match):
        fit_recordings(recordings)


def test_speed_and_force_hardly_explain_the_level_of_a_stylus(data_root):
    for recording in open_dataset("stylus6"):
        fit = fit_recordings([recording])
        assert fit.level_r_squared < 0.1, recording.recording_id
        assert sum("explain only" in notice for notice in fit.notices) == 1
        assert fit.level_errors_db[0] < 1.05 * fit.level_errors_db[1]


# Command ----------------------------------------------------------------------------------------------------


def write_csv(path, header, columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


def run(*words):
    return CliRunner().invoke(app, ["texture", *map(str, words)], catch_exceptions=True)


def test_the_command_writes_texture_page_and_json_of_the_recordings_own_range(tmp_path):
    recording = record()
    path = write_csv(
        tmp_path / "rec.csv", "time,acceleration,v [m/s],f [mN]",
        [T, recording.acceleration, SPEED / 1000, FORCE * 1000],
    )  # fmt: skip
    out = tmp_path / "wood.texture"
    words = "fit", path, "--unit", "m/s^2", "--speed-column", "v", "--force-column", "f", "-o", out, "--page"
    result = run(*words, "--json", tmp_path / "wood.json")
    assert result.exit_code == 0, result.output
    expected = fit_recordings([recording], name="wood")
    content = json.loads((tmp_path / "wood.json").read_text())
    assert content["level_error_db"] == pytest.approx(expected.level_errors_db[0], rel=0.05)
    texture = load_texture(out)
    assert (texture.name, texture.family, describe(out)["unit"]) == ("wood", "grid", "m/s^2")
    np.testing.assert_allclose(texture.speeds, expected.texture.speeds, rtol=0.01)
    page = (tmp_path / "wood.html").read_text()
    slow, fast = expected.texture.speeds[[0, -1]]
    assert f'id="speed" min="{round(slow)}" max="{round(fast)}"' in page
    assert "AudioWorklet" in page
    assert run(out).exit_code == 0
    result = run("show", out, "--page", tmp_path / "again.html")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "again.html").read_text() == page  # the page has the fitted model itself
    words = [sorted(run(*command).output.split()) for command in (("show", out), (out,))]
    assert words[0] == words[1]  # the order of the arrays in a file varies


def test_positions_replace_the_speed(tmp_path):
    x = np.cumsum(SPEED * np.sign(np.sin(2 * np.pi * 0.4 * T))) / FS
    recording = record()
    path = write_csv(
        tmp_path / "rec.csv", "acceleration,x,y,force", [recording.acceleration, 0.6 * x, 0.8 * x, FORCE]
    )
    options = "--fs", FS, "--unit", "m/s^2", "--force-column", "force", "-o", tmp_path / "a.texture"
    result = run("fit", path, *options, "--position-columns", "x,y")
    assert result.exit_code == 0, result.output
    speeds = load_texture(tmp_path / "a.texture").speeds
    expected = fit_recordings([recording]).texture.speeds
    np.testing.assert_allclose(speeds[[0, -1]], expected[[0, -1]], rtol=0.1)


def test_positions_that_are_read_as_acceleration_are_refused(tmp_path):
    path = write_csv(tmp_path / "rec.csv", "x,y,z,force", [noise(), noise(1), noise(2), FORCE])
    options = "--fs", FS, "--unit", "m/s^2", "--force-column", "force", "--position-columns", "x"
    result = run("fit", path, *options, "-o", tmp_path / "a.texture")
    assert "x cannot be both position and acceleration. Set --column" in str(result.exception)


def test_a_recording_of_a_dataset_has_the_columns_of_its_card(data_root, tmp_path):
    result = run("fit", "stylus6:T5", "-o", tmp_path / "a.texture")
    assert result.exit_code == 0, result.output
    assert "excluded 1 sample of force (505831 N at 7.616 s)" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--force-column", "forc"], "no column 'forc'. Expected one of acceleration, force, speed [m/s]. "
         "Try --force-column force"),
        (["--speed-column", "speeds", "--force-column", "force"], "Try --speed-column speed"),
        (["--force-column", "force", "--speed-unit", "km/h"], "m/s, got 'km/h'. Set --speed-unit"),
        (["--force-column", "force", "--position-columns", "x"], "Try --position-columns"),
    ],
)  # fmt: skip
def test_wrong_columns_and_units_are_refused_with_the_closest_name(options, message, tmp_path):
    path = write_csv(tmp_path / "rec.csv", "acceleration,force,speed [m/s]", [noise(), FORCE, SPEED / 1000])
    result = run("fit", path, "--fs", FS, "--unit", "m/s^2", "-o", tmp_path / "a.texture", *options)
    assert result.exit_code == 1
    assert message in str(result.exception)
    assert not (tmp_path / "a.texture").exists()
