"""Textures that feel otherwise on one scale."""

import numpy as np
import pytest
from scipy.signal import lfilter

from texclass.features.extractor import FeatureExtractor
from texclass.haptics import SCALES
from texclass.haptics.exchange import load_texture, save_texture
from texclass.haptics.scales import scale_values
from texclass.haptics.textures import felt_scales, pack, retouch
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue
from texclass.vibration.decaying_modes import NO_MODES, DecayingModes

FS = 2000.0
TAP = DecayingModes(*np.array([[210.0, 400.0], [90.0, 200.0], [30.0, 8.0], [-1.5, 0.5]]))


@pytest.fixture(scope="module", params=[90.0, 180.0], ids=["coarse", "fine"])
def texture(request):
    pole = 0.93 * np.exp(2j * np.pi * request.param / FS)
    noise = np.random.default_rng(1).standard_normal(round(8 * FS))
    x = lfilter([1.0], np.poly([pole, np.conj(pole), 0.6]).real, noise)
    return pack(1.5 * x / x.std(), 100, fs=FS).holding(tap=TAP, mu=0.5)


@pytest.mark.parametrize("scale", SCALES)
def test_one_scale_follows_what_is_asked_and_the_others_stay(texture, scale):
    before = felt_scales(texture)
    asked = before[scale] + np.array([-0.8, 1.6])
    felt = [felt_scales(retouch(texture, 128, **{scale: value}), seed=5) for value in asked]
    assert felt[0][scale] < felt[1][scale]
    np.testing.assert_allclose([one[scale] for one in felt], asked, atol=0.8)
    for other in set(before) - {scale}:
        assert np.abs([one[other] - before[other] for one in felt]).max() < 1.0, other


@pytest.mark.parametrize("fs", [10_000, 2000])
def test_a_recording_is_packed_as_it_feels_and_retouched(fs):
    surface, operator = (of(6, seed=6)[1] for of in (surface_catalogue, operator_catalogue))
    recording = record_freehand(surface, operator, duration_s=6.0, fs=fs, seed=30)
    texture = pack(recording, 128)
    before = felt_scales(texture)
    if fs == 10_000:
        told = scale_values(FeatureExtractor("scales").fit([recording]).extract([recording]).table).iloc[0]
        for scale in ("hard", "sticky"):
            assert before[scale] == pytest.approx(told[scale], abs=0.4)
    changes = {
        10_000: [{"rough": 8.5, "hard": 3.0}],
        2000: [{"regular": before["regular"] - 2}, {"regular": 9.0}],
    }
    for asked in changes[fs]:
        after = felt_scales(retouch(texture, **asked), seed=5)
        for scale in before:
            if scale in asked:
                assert after[scale] == pytest.approx(asked[scale], abs=0.8)
            else:
                assert after[scale] == pytest.approx(before[scale], abs=1.0), scale


COARSE = pytest.mark.parametrize("texture", [90.0], indirect=True, ids=["coarse"])


@COARSE
def test_what_a_texture_does_not_hold_and_what_is_out_of_reach_is_refused(texture):
    for source, asked, why in (
        (texture, {"soft": 3.0}, "one or more of hard, rough"),
        (texture, {}, "asked for nothing"),
        (texture, {"rough": 90.0}, "30 dB"),
        (texture, {"sticky": 90.0}, "0 to 2.55"),
        (texture, {"hard": 60.0}, "8 to 5000 Hz"),
        (texture.holding(tap=NO_MODES), {"hard": 3.0}, "has no tap"),
        (texture.holding(mu=0.0), {"sticky": 3.0}, "has no friction"),
    ):
        with pytest.raises(ValueError, match=why):
            retouch(source, **asked)
    assert set(felt_scales(texture.holding(tap=NO_MODES, mu=0.0))) == set(SCALES) - {"hard", "sticky"}


@COARSE
def test_a_harder_tap_rings_higher_shorter_and_stronger_at_the_same_damping(texture):
    soft, hard = texture.tap, retouch(texture, hard=9.0).tap
    higher = hard.frequency_hz / soft.frequency_hz
    assert higher.min() > 1.2
    np.testing.assert_allclose(hard.decay_per_s / soft.decay_per_s, higher, rtol=0.16)  # steps of 0.2 octaves
    np.testing.assert_allclose(hard.amplitude / soft.amplitude, higher, rtol=0.35)  # of 2.5 dB


@COARSE
def test_a_texture_is_retouched_on_the_command_line(command, texture, tmp_path):
    path, target = save_texture(texture, tmp_path / "cloth.texture"), tmp_path / "rougher.texture"
    rough = felt_scales(texture)["rough"] + 2
    code, out, err = command("convert", path, "-o", target, "--scale", f"rough={rough:.1f}")
    assert code == 0, err
    assert "rough" in out
    assert felt_scales(load_texture(target))["rough"] == pytest.approx(rough, abs=0.6)
