"""Textures that feel otherwise on one scale."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import spearmanr

import texclass as tx
from texclass.exchange import load_texture, save_texture
from texclass.features import SCALES
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue
from texclass.textures import felt_scales, pack, retouch
from texclass.vibration import DecayingModes

FS = 2000.0
TAP = DecayingModes(*np.array([[210.0, 400.0], [90.0, 200.0], [30.0, 8.0], [-1.5, 0.5]]))
NO_TAP = DecayingModes(*np.zeros((4, 0)))


@pytest.fixture(scope="module", params=[90.0, 180.0], ids=["coarse", "fine"])
def texture(request):
    pole = 0.93 * np.exp(2j * np.pi * request.param / FS)
    noise = np.random.default_rng(1).standard_normal(round(8 * FS))
    x = lfilter([1.0], np.poly([pole, np.conj(pole), 0.6]).real, noise)
    return pack(1.5 * x / x.std(), 100, fs=FS).holding(tap=TAP, mu=0.5)


@pytest.mark.parametrize("scale", SCALES)
def test_one_scale_follows_what_is_asked_and_the_others_stay(texture, scale):
    before = felt_scales(texture)
    asked = before[scale] + np.linspace(-0.8, 1.6, 5)
    felt = [felt_scales(retouch(texture, 128, **{scale: value}), seed=5) for value in asked]
    assert spearmanr(asked, [one[scale] for one in felt])[0] >= 0.9
    np.testing.assert_allclose([one[scale] for one in felt], asked, atol=0.8)
    for other in set(before) - {scale}:
        assert np.abs([one[other] - before[other] for one in felt]).max() < 1.0, other


COARSE = pytest.mark.parametrize("texture", [90.0], indirect=True, ids=["coarse"])


@COARSE
def test_what_a_texture_does_not_hold_and_what_is_out_of_reach_is_refused(texture):
    for source, asked, why in (
        (texture, {"soft": 3.0}, "one or more of hard, rough"),
        (texture, {}, "asked for nothing"),
        (texture, {"rough": 90.0}, "30 dB"),
        (texture, {"sticky": 90.0}, "0 to 2.55"),
        (texture, {"hard": 60.0}, "8 to 5000 Hz"),
        (texture.holding(tap=NO_TAP), {"hard": 3.0}, "has no tap"),
        (texture.holding(mu=0.0), {"sticky": 3.0}, "has no friction"),
    ):
        with pytest.raises(ValueError, match=why):
            retouch(source, **asked)
    assert set(felt_scales(texture.holding(tap=NO_TAP, mu=0.0))) == set(SCALES) - {"hard", "sticky"}


def felt(fs=10_000):
    """Return a simulated recording."""
    surface, operator = (of(6, seed=6)[1] for of in (surface_catalogue, operator_catalogue))
    return record_freehand(surface, operator, duration_s=6.0, fs=fs, seed=30)


def test_a_recording_at_10_khz_is_packed_as_it_feels_and_retouched():
    recording = felt()
    texture = pack(recording, 128)
    told = tx.describe(recording).set_index("scale")["value"]
    before = felt_scales(texture)
    for scale in ("hard", "sticky"):
        assert before[scale] == pytest.approx(told[scale], abs=0.4)
    after = felt_scales(retouch(texture, rough=8.5, hard=3.0), seed=5)
    assert {name: after[name] for name in ("rough", "hard")} == pytest.approx(
        {"rough": 8.5, "hard": 3.0}, abs=0.8
    )
    for other in set(before) - {"rough", "hard"}:
        assert after[other] == pytest.approx(before[other], abs=1.0), other


def test_a_recorded_surface_becomes_regular_and_irregular_and_else_stays():
    texture = pack(felt(fs=2000), 128)
    before = felt_scales(texture)
    for asked in (before["regular"] - 2, 9.0):
        after = felt_scales(retouch(texture, regular=asked), seed=5)
        assert after["regular"] == pytest.approx(asked, abs=0.8)
        for other in set(before) - {"regular"}:
            assert after[other] == pytest.approx(before[other], abs=1.0), other


@COARSE
def test_a_harder_tap_rings_higher_shorter_and_stronger_at_the_same_damping(texture):
    soft, hard = texture.tap, retouch(texture, hard=9.0).tap
    higher = hard.frequency_hz / soft.frequency_hz
    assert higher.min() > 1.2
    np.testing.assert_allclose(hard.decay_per_s / soft.decay_per_s, higher, rtol=0.16)  # steps of 0.2 octaves
    np.testing.assert_allclose(hard.amplitude / soft.amplitude, higher, rtol=0.35)  # of 2.5 dB


@COARSE
def test_a_texture_is_retouched_on_the_command_line(command, texture, tmp_path):
    path = save_texture(texture, tmp_path / "cloth.texture")
    rough = felt_scales(texture)["rough"]
    asked = ("convert", path, "-o", tmp_path / "rougher.texture", "--scale")
    code, out, err = command(*asked, f"rough={rough + 2:.1f}")
    assert code == 0, err
    assert "rough" in out
    assert felt_scales(load_texture(tmp_path / "rougher.texture"))["rough"] == pytest.approx(
        rough + 2, abs=0.6
    )
    code, _, err = command(*asked, "rough")
    assert code == 1
    assert "SCALE=VALUE" in err
