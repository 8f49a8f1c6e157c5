"""Packed textures of about a hundred bytes."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter, resample_poly, welch
from scipy.stats import spearmanr

from texclass.features.extractor import FeatureExtractor
from texclass.haptics.exchange import describe, load_texture, save_texture
from texclass.haptics.scales import scale_values
from texclass.haptics.textures import PackedTexture, Scan, pack
from texclass.haptics.textures.packed import LEVELS, add_checksum
from texclass.loaders import load_recording
from texclass.recording import Phases, Recording, Tap
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue
from texclass.vibration import DecayingModes

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


def _similarity(x, y):
    amplitudes = [np.sqrt(welch(signal, FS, nperseg=512)[1][2:64]) for signal in (x, y)]
    return float(np.dot(*amplitudes) / np.prod([np.linalg.norm(a) for a in amplitudes]))


@pytest.mark.parametrize("n_bytes", [16, 64, 200])
def test_a_packed_vibration_has_the_spectrum_and_level_of_its_source(n_bytes):
    x = _vibration()
    packed = pack(x, n_bytes, fs=FS)
    assert len(packed.to_bytes()) <= n_bytes
    y = _rendered(packed)
    assert _similarity(x, y) > 0.98
    assert 20 * np.log10(y[800:].std() / x.std()) == pytest.approx(0.0, abs=0.6)


@pytest.mark.skipif(not EXCERPTS, reason="the data set lmt_excerpts is missing")
def test_real_excerpts_keep_their_spectrum_in_64_bytes():
    similarities = []
    for path in EXCERPTS:
        x = load_recording(path, unit="arbitrary")
        samples = resample_poly(x.acceleration.reshape(-1) - x.acceleration.mean(), FS, x.fs)
        similarities.append(_similarity(samples, _rendered(pack(samples, 64, fs=FS))[800:]))
    assert np.sum(np.array(similarities) >= 0.95) >= 9


def test_a_value_outside_the_range_of_a_quantizer_gets_the_nearest_code():
    assert [LEVELS.encode(db) for db in (-1e9, -120.0, 0.0, 135.5, 1e9)] == [0, 0, 240, 511, 511]


def _scan(db_speed, db_force):
    """Return a scan whose level rises by these numbers of dB when speed or force doubles."""
    rng = np.random.default_rng(3)
    n = round(20 * FS)
    v = np.repeat(2.0 ** rng.uniform(4.5, 7.5, 160), n // 160)
    f = np.repeat(2.0 ** rng.uniform(-1.5, 1.5, 160), n // 160)
    level = 10 ** ((db_speed * np.log2(v / 80) + db_force * np.log2(f)) / 20)
    velocity = np.column_stack([v, np.zeros(n)])
    return Scan(level * _vibration(20.0), np.cumsum(velocity, axis=0) / FS, velocity, f, FS)


def test_packing_keeps_the_slopes_of_the_level_and_the_spectrum_of_a_packed_texture():
    packed, scanned = (pack(_scan(4.0, 2.0), n_bytes) for n_bytes in (64, 200))
    assert _similarity(_rendered(scanned), _rendered(pack(scanned, 64))) > 0.97
    db = {(v, f): 20 * np.log10(_rendered(packed, v, f)[800:].std()) for v, f in [(50, 1), (100, 1), (50, 2)]}
    assert db[100, 1] - db[50, 1] == pytest.approx(4.0, abs=0.7)
    assert db[50, 2] - db[50, 1] == pytest.approx(2.0, abs=0.7)


def test_the_level_is_constant_below_the_recorded_range_and_fades_at_rest():
    packed = pack(_scan(0.0, 0.0), 64)
    slow, soft = (axis[0] for axis in packed.model.axes)
    db = [
        20 * np.log10(_rendered(packed, v, f)[800:].std())
        for v, f in ((slow, soft), (slow / 3, soft), (slow, soft / 3), (0.5, soft), (slow, 0.005))
    ]
    assert slow / 3 > 5
    assert soft / 3 > 0.05
    assert db[1:3] == pytest.approx([db[0]] * 2, abs=0.5)
    assert db[3:] == pytest.approx([db[0] - 20] * 2, abs=0.5)


@settings(max_examples=150, deadline=None)
@given(st.binary(min_size=4, max_size=100))
def test_any_bytes_decode_to_a_stable_texture(body):
    try:
        texture = PackedTexture.from_bytes(add_checksum(body))
    except ValueError:
        return
    model = texture.model
    k, _ = model.at(np.array([90.0]), np.ones(1))
    assert np.abs(k).max() < 1
    y = texture.renderer(seed=0).process(np.tile([90.0, 0.0], (200, 1)), np.ones(200))
    assert np.isfinite(y).all()
    assert np.isfinite(texture.tap.synthesize(200, texture.fs)).all()
    assert texture.tap.decay_per_s.min(initial=2.0) >= 2.0
    assert 0 <= texture.mu <= 2.55


def test_tap_and_friction_take_three_bytes_per_mode_and_one_byte_and_leave_the_vibration_unchanged():
    plain, tap = pack(_vibration(), 50, fs=FS), DecayingModes(*np.array([[210.0], [90.0], [30.0], [0.0]]))
    for new_tap, mu in ((tap, 0.4), (tap, None), (None, 0.4)):
        changed = plain.with_contact(tap=new_tap, mu=mu)
        assert len(changed.to_bytes()) - len(plain.to_bytes()) == 3 * (new_tap is tap) + (mu is not None)
        assert np.array_equal(_rendered(changed), _rendered(plain))
        for texture in (changed, pack(changed, 60)):
            assert texture.mu == pytest.approx(mu or 0.0, abs=0.005)
            assert texture.tap.n_modes == (new_tap is tap)
            np.testing.assert_allclose(texture.tap.frequency_hz, changed.tap.frequency_hz)
    with pytest.raises(ValueError, match=r"between 0 and 2\.55"):
        plain.with_contact(mu=3.0)


def test_a_lower_rate_keeps_the_spectrum_and_level_below_its_half():
    low = pack(_vibration(), 100, fs=FS, max_hz=2000.0)
    assert low.fs == 2000
    x = resample_poly(_vibration(), 1, 4)
    P, Q = (welch(signal, 2000, nperseg=256)[1][4:100] for signal in (x, _rendered(low)[200:]))
    assert np.abs(10 * np.log10(Q / P)).mean() < 1.5
    assert 10 * np.log10(Q.sum() / P.sum()) == pytest.approx(0.0, abs=0.6)


def test_a_saved_texture_is_its_bytes_and_renders_the_same(tmp_path):
    packed = pack(_vibration(), 64, fs=FS, unit="m/s^2", name="hum")
    path = save_texture(packed, tmp_path / "hum.texture")
    assert path.read_bytes() == packed.to_bytes()
    read = load_texture(path)
    assert np.array_equal(_rendered(read), _rendered(packed))
    description = describe(path)
    expected = ("hum", "m/s^2", path.stat().st_size)
    assert (read.name, description["unit"], description["bytes"]) == expected


def _knocked(modes, n_bytes):
    """Return the packed texture of a stroke and three knocks; these modes have the median hardness."""
    rest, knocks = np.zeros(2400), []
    for size, decay_factor in ((4, 1.25), (1, 1.0), (2, 0.8)):
        knock = replace(modes, decay_per_s=decay_factor * np.array(modes.decay_per_s))
        knocks += [size * knock.synthesize(1600, FS), rest]
    x = np.concatenate([rest, *knocks, _vibration(1.0)])
    onsets = [2400 + i * 4000 for i in range(3)]
    phases = Phases(tuple(Tap(i - 50, i, i + 1600) for i in onsets), (x.size - round(FS), x.size))
    return pack(Recording(x, FS, "m/s^2", "knocked", phases=phases), n_bytes)


@pytest.mark.parametrize(("n_bytes", "n_modes"), [(8, 0), (16, 1), (32, 2), (64, 4)])
def test_a_tap_is_packed_as_modes_within_the_bytes(n_bytes, n_modes):
    modes = DecayingModes(
        [60.0, 180.0, 330.0, 700.0], [90.0, 150.0, 240.0, 350.0], [9.0, 6.0, 4.0, 3.0], np.ones(4)
    )
    packed = _knocked(modes, n_bytes)
    assert (len(packed.to_bytes()) <= n_bytes, packed.tap.n_modes) == (True, n_modes)
    if n_bytes == 64:  # packing again keeps the strongest modes
        fewer = pack(packed, 32).tap
        np.testing.assert_allclose(fewer.frequency_hz, packed.tap.frequency_hz[:2], rtol=1e-9)
    recorded, rendered = (DecayingModes.synthesize(tap, 1600, FS) for tap in (modes, packed.tap))
    limit = {0: 1.01, 1: 0.5, 2: 0.3, 4: 0.05}[n_modes]
    assert np.sum((rendered - recorded) ** 2) < limit * np.sum(recorded**2)


def test_a_packed_tap_is_as_hard_as_the_recorded_one():
    surfaces, operator = surface_catalogue(24, seed=6), operator_catalogue(4, seed=6)[0]
    hard = []
    for surface in surfaces[1::4]:
        recording = record_freehand(surface, operator, duration_s=4.0, seed=5)
        packed = pack(recording, 64)
        rest, ringing = np.zeros(500), packed.tap.synthesize(250, recording.fs)
        x, phases = np.concatenate([rest, ringing]), Phases((Tap(0, 500, 750),))
        knock = Recording(x, recording.fs, "m/s^2", "knock", phases=phases)
        tables = (FeatureExtractor("scales").fit([one]).extract([one]).table for one in (recording, knock))
        hard.append([scale_values(table)["hard"].iloc[0] for table in tables])
    recorded, rendered = np.transpose(hard)
    assert np.ptp(recorded) > 5
    assert np.median(np.abs(recorded - rendered)) < 0.7
    assert spearmanr(recorded, rendered).statistic > 0.9


def test_the_spectrum_has_priority_over_tap_and_friction():
    surface, operator = surface_catalogue(2, seed=6)[0], operator_catalogue(1, seed=6)[0]
    recording = record_freehand(surface, operator, duration_s=4.0, seed=5)
    assert all(track is not None for track in (recording.speed, recording.normal_force, recording.friction))
    small, large = pack(recording, 16), pack(recording, 32)
    assert len(small.to_bytes()) <= 16
    assert small.model.speeds.size == 2
    assert (small.tap.n_modes, small.mu, large.tap.n_modes) == (0, 0.0, 2)
    assert large.mu > 0


def test_damaged_files_and_invalid_sources_are_refused(tmp_path):
    path = save_texture(pack(_vibration(), 64, fs=FS), tmp_path / "hum.texture")
    data = bytearray(path.read_bytes())
    data[9] ^= 4
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"hum\.texture: the data are damaged"):
        load_texture(path)
    for source, n_bytes, arguments, message in (
        (np.zeros(8000), 64, {"fs": FS}, "silent"),
        (_vibration(), 7, {"fs": FS}, "between 8 and 512"),
        (_vibration(), 64, {}, "fs is missing"),
        (_vibration(), 64, {"fs": 999.5}, "integer"),
        (_vibration()[:100], 64, {"fs": FS}, "at least 0.125 s"),
    ):
        with pytest.raises(ValueError, match=message):
            pack(source, n_bytes, **arguments)


def test_the_command_line_packs_a_recording(command, tmp_path):
    source = tmp_path / "felt.txt"
    source.write_text("\n".join(f"{v:.6f}" for v in _vibration()))
    target = tmp_path / "felt.texture"
    arguments = ("convert", source, "-o", target, "--bytes", 48, "--fs", 8000, "--unit", "m/s^2")
    code, out, err = command(*arguments)
    assert code == 0, err
    assert target.stat().st_size <= 48
    assert "taps" in out
    assert load_texture(target).fs == 8000
    code, _, err = command(*arguments[:-2], "--unit", "m/s^2", "--bytes", 3)
    assert code == 1
    assert "between 8 and 512" in err
