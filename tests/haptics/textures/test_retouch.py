"""Changing one perceptual scale of a texture."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from texclass.features.extractor import FeatureExtractor
from texclass.haptics import SCALES
from texclass.haptics.exchange import load_texture, save_texture
from texclass.haptics.scales import scale_values
from texclass.haptics.textures import measure_scales, pack, packing, retouch
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue
from texclass.vibration.decaying_modes import NO_MODES, DecayingModes

FS = 2000.0
TAP = DecayingModes(*np.array([[210.0, 400.0], [90.0, 200.0], [30.0, 8.0], [-1.5, 0.5]]))


@pytest.fixture(scope="module", params=[90.0, 180.0], ids=["coarse", "fine"])
def texture(request):
    pole = 0.93 * np.exp(2j * np.pi * request.param / FS)
    noise = np.random.default_rng(1).standard_normal(round(8 * FS))
    x = lfilter([1.0], np.poly([pole, np.conj(pole), 0.6]).real, noise)
    return pack(2.2 * x / x.std(), 100, fs=FS).with_contact(tap=TAP, mu=0.5)


@pytest.mark.parametrize("scale", SCALES)
def test_one_scale_reaches_its_target_and_the_others_stay(texture, scale):
    original = measure_scales(texture)
    changes = np.array([0.8, 1.6] if original[scale] < 5 else [-1.6, -0.8])  # towards the middle of the scale
    targets = original[scale] + changes
    results = [measure_scales(retouch(texture, 128, **{scale: target}), seed=5) for target in targets]
    assert results[0][scale] < results[1][scale]
    np.testing.assert_allclose([result[scale] for result in results], targets, atol=0.8)
    for other in set(original) - {scale}:
        assert np.abs([result[other] - original[other] for result in results]).max() < 1.0, other


@pytest.mark.parametrize("fs", [10_000, 2000])
def test_a_packed_recording_keeps_its_scales_and_can_be_retouched(fs):
    surface, operator = (of(6, seed=6)[1] for of in (surface_catalogue, operator_catalogue))
    recording = record_freehand(surface, operator, duration_s=6.0, fs=fs, seed=30)
    texture = pack(recording, 128)
    original = measure_scales(texture)
    if fs == 10_000:
        table = FeatureExtractor("scales").fit([recording]).extract([recording]).table
        recorded = scale_values(table).iloc[0]
        for scale in ("hard", "sticky"):
            assert original[scale] == pytest.approx(recorded[scale], abs=0.4)
    changes = {
        10_000: [{"rough": 8.5, "hard": 3.0}],
        2000: [{"regular": original["regular"] - 2}, {"regular": 9.0}],
    }
    for targets in changes[fs]:
        result = measure_scales(retouch(texture, **targets), seed=5)
        for scale in original:
            if scale in targets:
                assert result[scale] == pytest.approx(targets[scale], abs=0.8)
            else:
                assert result[scale] == pytest.approx(original[scale], abs=1.0), scale


COARSE = pytest.mark.parametrize("texture", [90.0], indirect=True, ids=["coarse"])


@COARSE
def test_scales_that_a_texture_lacks_and_targets_out_of_reach_are_refused(texture):
    for source, targets, message in (
        (texture, {}, "pass one or more of the scales hard, rough"),
        (texture, {"rough": 0.0, "bumpy": 10.0}, "30 dB"),
        (texture, {"rough": 10.5, "sticky": -1.0}, "must be from 0 to 10, got rough=10.5, sticky=-1"),
        (texture.with_contact(tap=NO_MODES), {"hard": 3.0}, "requires a texture with a tap"),
        (texture.with_contact(mu=0.0), {"sticky": 3.0}, "requires a texture with friction"),
    ):
        with pytest.raises(ValueError, match=message):
            retouch(source, **targets)
    assert set(measure_scales(texture.with_contact(tap=NO_MODES, mu=0.0))) == set(SCALES) - {"hard", "sticky"}


@COARSE
def test_a_harder_tap_is_higher_shorter_and_stronger_at_the_same_damping_ratio(texture):
    soft, hard = texture.tap, retouch(texture, hard=9.0).tap
    higher = hard.frequency_hz / soft.frequency_hz
    assert higher.min() > 1.2
    decay_step, amplitude_step = 0.16, 0.35  # quantization: 0.2 octaves and 2.5 dB
    np.testing.assert_allclose(hard.decay_per_s / soft.decay_per_s, higher, rtol=decay_step)
    np.testing.assert_allclose(hard.amplitude / soft.amplitude, higher, rtol=amplitude_step)


@COARSE
def test_the_command_line_retouches_a_texture(command, texture, tmp_path):
    path, target = save_texture(texture, tmp_path / "cloth.texture"), tmp_path / "rougher.texture"
    rough = measure_scales(texture)["rough"] + 2
    code, _, err = command("convert", path, "-o", target, "--scale", "soft=3")
    assert (code, err) == (1, f"error: --scale: unknown scale soft. Expected one of {', '.join(SCALES)}\n")
    code, out, err = command("convert", path, "-o", target, "--scale", f"rough={rough:.1f}")
    assert code == 0, err
    assert "rough" in out
    assert measure_scales(load_texture(target))["rough"] == pytest.approx(rough, abs=0.6)


def test_scales_below_the_references_may_stay_below_them():
    """A weak texture is even by any measure, so that it becomes rougher without becoming bumpy."""
    pole = 0.97 * np.exp(2j * np.pi * 150.0 / FS)
    noise = np.random.default_rng(3).standard_normal(round(8 * FS))
    x = lfilter([1.0, -1.0], np.poly([pole, np.conj(pole)]).real, noise)
    weak = pack(0.05 * x / x.std(), 128, fs=FS)
    original = measure_scales(weak)
    assert original["rough"] == original["bumpy"] == 0
    result = measure_scales(retouch(weak, rough=1.5), seed=5)
    assert result["rough"] == pytest.approx(1.5, abs=0.8)
    for name in ("bumpy", "fine", "regular"):
        assert result[name] == pytest.approx(original[name], abs=1.0)


@COARSE
def test_missed_targets_are_refused_and_changes_of_other_scales_are_reported(texture, monkeypatch):
    with pytest.raises(ValueError, match=r"rough=0, bumpy=10 cannot be reached.* instead of"):
        retouch(texture, rough=0.0, bumpy=10.0)
    monkeypatch.setattr(packing, "RETOUCH", replace(packing.RETOUCH, max_change=0.001))
    original = measure_scales(texture)
    with pytest.warns(UserWarning, match=r"rough=[\d.]+ also changes bumpy from") as warned:
        changed = retouch(texture, rough=original["rough"] + 1.5)
    stated = re.search(r"bumpy from ([\d.]+) to ([\d.]+)", str(warned[0].message))
    assert float(stated[1]) == pytest.approx(original["bumpy"], abs=0.06)
    assert float(stated[2]) == pytest.approx(measure_scales(changed)["bumpy"], abs=0.06)
