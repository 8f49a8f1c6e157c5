"""Textures of a hundred bytes."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter, resample_poly, welch

from texclass.exchange import describe, load_texture, save_texture
from texclass.loaders import load_recording
from texclass.textures import PackedTexture, Scan, pack
from texclass.textures.packed import MARK, _checksum

FS = 8000.0
EXCERPTS = sorted((Path(os.environ.get("TEXCLASS_DATA", "")) / "lmt_excerpts").glob("*.wav"))


def _vibration(seconds=2.0, seed=0):
    """Return noise with a resonance at 250 Hz."""
    pole = 0.97 * np.exp(2j * np.pi * 250 / FS)
    noise = np.random.default_rng(seed).standard_normal(round(seconds * FS))
    return lfilter([1.0], np.poly([pole, np.conj(pole)]).real, noise)


def _rendered(texture, speed=80.0, force=1.0, seconds=2.0, seed=1):
    n = round(seconds * texture.fs)
    velocity = np.column_stack([np.full(n, speed), np.zeros(n)])
    return texture.renderer(seed=seed).process(velocity, np.full(n, force))


def _likeness(x, y):
    amplitudes = [np.sqrt(welch(one, FS, nperseg=512)[1][2:64]) for one in (x, y)]
    return float(np.dot(*amplitudes) / np.prod([np.linalg.norm(a) for a in amplitudes]))


@pytest.mark.parametrize("n_bytes", [16, 64, 200])
def test_a_vibration_comes_back_with_its_spectrum_and_level_in_so_few_bytes(n_bytes):
    x = _vibration()
    packed = pack(x, n_bytes, fs=FS)
    assert len(packed.to_bytes()) <= n_bytes
    y = _rendered(packed)
    assert _likeness(x, y) > 0.98
    assert 20 * np.log10(y[800:].std() / x.std()) == pytest.approx(0.0, abs=0.6)


@pytest.mark.skipif(not EXCERPTS, reason="lmt_excerpts are not here")
def test_real_excerpts_keep_their_spectrum_in_64_bytes():
    likenesses = []
    for path in EXCERPTS:
        x = load_recording(path, unit="arbitrary")
        samples = resample_poly(x.acceleration.reshape(-1) - x.acceleration.mean(), FS, x.fs)
        likenesses.append(_likeness(samples, _rendered(pack(samples, 64, fs=FS))[800:]))
    assert np.sum(np.array(likenesses) >= 0.95) >= 9


def test_bytes_do_not_grow_with_the_length():
    assert max(len(pack(_vibration(seconds), 40, fs=FS).to_bytes()) for seconds in (0.5, 2.0, 20.0)) <= 40


def _scan(db_speed, db_force):
    """Return a scan whose level rises by so many dB at twice the speed and the force."""
    rng = np.random.default_rng(3)
    n = round(20 * FS)
    v = np.repeat(2.0 ** rng.uniform(4.5, 7.5, 160), n // 160)
    f = np.repeat(2.0 ** rng.uniform(-1.5, 1.5, 160), n // 160)
    level = 10 ** ((db_speed * np.log2(v / 80) + db_force * np.log2(f)) / 20)
    velocity = np.column_stack([v, np.zeros(n)])
    return Scan(level * _vibration(20.0), np.cumsum(velocity, axis=0) / FS, velocity, f, FS)


def test_the_slopes_of_the_level_over_speed_and_force_are_kept():
    packed = pack(_scan(4.0, 2.0), 64)
    db = {(v, f): 20 * np.log10(_rendered(packed, v, f)[800:].std()) for v, f in [(50, 1), (100, 1), (50, 2)]}
    assert db[100, 1] - db[50, 1] == pytest.approx(4.0, abs=0.7)
    assert db[50, 2] - db[50, 1] == pytest.approx(2.0, abs=0.7)


@settings(max_examples=150, deadline=None)
@given(st.binary(min_size=4, max_size=100))
def test_whatever_the_bytes_what_is_read_is_stable(body):
    try:
        texture = PackedTexture.from_bytes(bytes([MARK, _checksum(body)]) + body)
    except ValueError:
        return
    model = texture.model
    k, _ = model.at(np.array([90.0]), np.ones(1))
    assert np.abs(k).max() < 1
    y = texture.renderer(seed=0).process(np.tile([90.0, 0.0], (200, 1)), np.ones(200))
    assert np.isfinite(y).all()


def test_a_file_is_its_bytes_and_renders_the_same(tmp_path):
    packed = pack(_vibration(), 64, fs=FS, unit="m/s^2", name="hum")
    path = save_texture(packed, tmp_path / "hum.texture")
    assert path.read_bytes() == packed.to_bytes()
    read = load_texture(path)
    assert np.array_equal(_rendered(read), _rendered(packed))
    assert (read.name, describe(path)["unit"], describe(path)["bytes"]) == (
        "hum",
        "m/s^2",
        path.stat().st_size,
    )


def test_a_texture_can_be_packed_again(tmp_path):
    scanned = pack(_scan(4.0, 0.0), 200)
    again = pack(scanned, 64)
    assert _likeness(_rendered(scanned), _rendered(again)) > 0.97


def test_damaged_files_and_what_cannot_be_packed_are_refused(tmp_path):
    path = save_texture(pack(_vibration(), 64, fs=FS), tmp_path / "hum.texture")
    data = bytearray(path.read_bytes())
    data[9] ^= 4
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"hum\.texture: the bytes are damaged"):
        load_texture(path)
    for source, n_bytes, given_, why in (
        (np.zeros(8000), 64, {"fs": FS}, "silent"),
        (_vibration(), 7, {"fs": FS}, "8 to 512"),
        (_vibration(), 64, {}, "fs is missing"),
        (_vibration(), 64, {"fs": 999.5}, "whole number"),
        (_vibration()[:100], 64, {"fs": FS}, "0.125 s at least"),
    ):
        with pytest.raises(ValueError, match=why):
            pack(source, n_bytes, **given_)


def test_a_recording_is_packed_on_the_command_line(command, tmp_path):
    source = tmp_path / "felt.txt"
    source.write_text("\n".join(f"{v:.6f}" for v in _vibration()))
    target = tmp_path / "felt.texture"
    asked = ("convert", source, "-o", target, "--bytes", 48, "--fs", 8000, "--unit", "m/s^2")
    code, out, err = command(*asked)
    assert code == 0, err
    assert target.stat().st_size <= 48
    assert "taps" in out
    assert load_texture(target).fs == 8000
    code, _, err = command(*asked[:-2], "--unit", "m/s^2", "--bytes", 3)
    assert code == 1
    assert "8 to 512" in err
