"""Textures that feel otherwise on one scale."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import spearmanr

from texclass.exchange import load_texture, save_texture
from texclass.textures import felt_scales, pack, retouch

FS = 2000.0


@pytest.fixture(scope="module", params=[90.0, 180.0], ids=["coarse", "fine"])
def texture(request):
    pole = 0.96 * np.exp(2j * np.pi * request.param / FS)
    noise = np.random.default_rng(1).standard_normal(round(8 * FS))
    x = lfilter([1.0], np.poly([pole, np.conj(pole), 0.6]).real, noise)
    return pack(1.5 * x / x.std(), 100, fs=FS)


@pytest.mark.parametrize("scale", ["rough", "bumpy", "fine"])
def test_one_scale_follows_what_is_asked_and_the_others_stay(texture, scale):
    before = felt_scales(texture)
    asked = before[scale] + np.linspace(-1.5, 1.5, 5)
    felt = [felt_scales(retouch(texture, 128, **{scale: value}), seed=5) for value in asked]
    assert spearmanr(asked, [one[scale] for one in felt])[0] >= 0.9
    np.testing.assert_allclose([one[scale] for one in felt], asked, atol=0.8)
    for other in set(before) - {scale}:
        assert np.abs([one[other] - before[other] for one in felt]).max() < 1.0, other


def test_what_no_spectrum_holds_and_what_is_out_of_reach_is_refused(texture):
    for asked, why in (
        ({"hard": 3.0}, "one or more of rough"),
        ({}, "asked for nothing"),
        ({"rough": 90.0}, "30 dB"),
    ):
        with pytest.raises(ValueError, match=why):
            retouch(texture, **asked)


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
