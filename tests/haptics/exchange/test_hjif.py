import base64
import itertools
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from texclass.haptics.exchange import (
    play_hjif,
    play_taps,
    play_texture,
    read_hjif,
    to_rendition,
    wavelet_stream,
    write_hjif,
)
from texclass.haptics.exchange.hjif import MAX_BANDS, Haptics
from texclass.haptics.exchange.hjif_rendition import BLOCK, HEADROOM, build_hjif
from texclass.haptics.textures.guruswamy2011 import Amplitude, LevelLaw, SpatialTexture
from texclass.haptics.textures.oeztuerk2018 import FrequencyTexture, LpcTexture
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import Autoregression, MajorFrequencies, TapModel
from texclass.vibration.scores import goodness_of_fit


def noise(fs=2000.0):
    return LpcTexture([40.0, 160.0], Autoregression([[-0.6, 0.5], [-0.2, 0.4]], [1.0, 3.0]), 9.0, fs, "bark")


def lines(n=3, fs=1000.0):
    f = np.linspace(40, 400, n)
    models = tuple(MajorFrequencies(f, gain * np.linspace(1, 2, n), np.linspace(0, 6, n)) for gain in (1, 2))
    return FrequencyTexture([50.0, 100.0], models, 10.0, fs, "sieve")


def ridges(speed=50.0):
    ring = np.full((4, 2), [[70.0], [60.0], [2.0], [-1.5]])
    law = Amplitude(LevelLaw(0.0, 0.0, 1.0), speed, 1.0)
    x = np.array([3.0, 11.0])
    return SpatialTexture("ridges", 1000.0, 20.0, x, np.arange(2.0), *ring, law, 2.0, np.array([1.0, 0.0]))


def channel_of(haptics):
    return haptics.perceptions[0].channels[0]


TAPS = TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 200.0), TapModel(-800.0, 40.0, 600.0)))


def test_wavelets_are_inverted_and_a_stream_is_accurate_to_half_a_step():
    for n in (16, 128, BLOCK):
        x = np.random.default_rng(n).standard_normal(n)
        assert_allclose(wavelet_stream.inverse(wavelet_stream.transform(x)), x, atol=1e-11)
    for planes, gain in itertools.product((1, 6, 15), (0.0, 1e-6, 0.01, 0.9, 1.0, 4.0)):
        c = np.random.default_rng(planes).laplace(size=BLOCK)
        c *= gain * wavelet_stream.MAX_COEFFICIENT / 8 / np.abs(c).max()
        stream = wavelet_stream.encode(c, planes)
        decoded = wavelet_stream.decode(stream, BLOCK)
        scale = max(np.abs(c).max() + 1 / 8, 1 / 128)  # the largest coefficient is rounded up
        assert np.abs(decoded - c).max() <= scale / 2**planes / 2
        assert decoded.any() or stream == b""


def test_a_stream_equals_that_of_the_reference_software_and_damaged_streams_decode_to_bounded_numbers():
    c = np.cos(np.arange(32.0) ** 2) / 4
    stream = wavelet_stream.encode(c, 5)
    assert base64.b64encode(stream).decode() == "nnCBvDvLXMixZmZ1CT6izv4zZF+urMa3pszTgaAQ"
    assert_allclose(wavelet_stream.decode(stream, 32), c, atol=0.25 / 2**6 + 1e-12)
    rng = np.random.default_rng(0)
    for n in (1, 3, 100, 3000):
        decoded = wavelet_stream.decode(rng.bytes(n), BLOCK)
        assert decoded.shape == (BLOCK,)
        assert np.abs(decoded).max() <= 2 * wavelet_stream.MAX_COEFFICIENT * 2


def test_a_texture_of_1_khz_has_no_images_and_its_level_is_that_of_the_played_signal():
    rendition = play_texture(noise(1000.0), seconds=2.0)
    haptics, losses = build_hjif(rendition)
    f, power = signal.welch(play_hjif(haptics, 8000.0)[:, 0], 8000.0, nperseg=4096)
    image_power = power[f > 500.0].sum() / power.sum()  # 0.1 if samples of 1 kHz were constant
    assert image_power < 0.02
    ratio = 10 ** (float(losses["level"].split()[0]) / 10)
    assert ratio == pytest.approx(power.sum() * f[1] / np.mean(rendition.samples**2), rel=0.03)
    assert to_rendition(haptics).fs == rendition.fs
    expected = rendition.samples
    assert_allclose(to_rendition(haptics).samples, expected, atol=0.01 * np.std(expected))


def test_noise_is_played_in_its_unit_and_below_full_scale(tmp_path):
    rendition = play_texture(noise(), speed=80.0, seconds=1.5)
    losses = write_hjif(rendition, tmp_path / "a.hjif")
    haptics = read_hjif(tmp_path / "a.hjif")
    played = play_hjif(haptics, 2000.0)[:, 0]
    assert played.size == rendition.samples.size == 3000
    assert np.std(played - rendition.samples) < 0.002 * np.std(rendition.samples)
    assert goodness_of_fit(rendition.samples, played) > 0.999
    assert abs(float(losses["level"].split()[0])) < 0.03
    assert losses["band"] == "0 to 1000 Hz of 0 to 1000 Hz"
    assert "80 mm/s; 40 to 160 mm/s change the level by -" in losses["speed"]
    assert "has only this value" in losses["force"]
    assert 0.9 < np.abs(played).max() / channel_of(haptics).gain < 1 < HEADROOM


def test_losses_of_band_and_unit_are_described():
    haptics, losses = build_hjif(play_texture(noise(20_000.0), seconds=0.3))
    assert losses["band"] == "0 to 4000 Hz of 0 to 10000 Hz"
    assert channel_of(haptics).bands[0].upper_frequency_limit == 8000
    results = [build_hjif(play_texture(noise(), unit=unit, seconds=0.5)) for unit in ("m/s^2", "g", "V")]
    gains = [channel_of(haptics).gain for haptics, _ in results]
    assert_allclose(gains[1] / gains[0], 9.80665)
    assert "V" in results[2][1]["unit"]


def test_lines_become_oscillators_with_their_phase_and_the_strongest_are_kept(tmp_path):
    rendition = play_texture(lines(), speed=70.0, seconds=1.0)
    write_hjif(rendition, tmp_path / "a.hjif")
    played = play_hjif(read_hjif(tmp_path / "a.hjif"), 1000.0)[:, 0]
    assert_allclose(played, rendition.samples, atol=2e-4)  # frequencies 40, 220, 400 are whole
    haptics, losses = build_hjif(play_texture(lines(80), seconds=0.5))
    assert haptics.level == 2
    assert len(channel_of(haptics).bands) == MAX_BANDS[2]
    assert losses["lines"].startswith("63 of 80")


def test_taps_become_transients():
    haptics, losses = build_hjif(play_taps(TAPS, velocity=0.2))
    channel = channel_of(haptics)
    transients = [(e.position, e.keyframes[0]) for e in channel.bands[0].effects]
    assert [(tick, frame.frequency_modulation) for tick, frame in transients] == [(0, 200), (250, 600)]
    samples = play_taps(TAPS, velocity=0.2).samples
    peaks = [np.abs(half).max() for half in np.split(samples, 2)]
    assert_allclose([channel.gain * frame.amplitude_modulation for _, frame in transients], peaks, rtol=0.02)
    assert "not its decay" in losses["waveform"]


def test_features_keep_their_position_on_the_surface():
    for speed in (20.0, 50.0, 200.0):
        haptics, losses = build_hjif(play_texture(ridges(speed)))
        perception, rate = haptics.perceptions[0], channel_of(haptics).bands[0].upper_frequency_limit
        played = np.abs(play_hjif(haptics, rate)[:, 0])
        mm = np.arange(played.size) / rate * 1000 * 10.0 ** (3 + perception.unit_exponent)
        assert perception.perception_modality == "Vibrotactile Texture"
        assert_allclose(mm[-1], 20.0, atol=0.2)
        for x in (3.0, 11.0):  # silent before the feature, loud after it
            assert played[(mm > x - 0.8) & (mm < x - 0.2)].max() < 0.2 * played.max()
            assert played[(mm > x) & (mm < x + 0.5 * speed / 50)].max() > 0.4 * played.max()
        assert "fixed to distance" in losses["speed"]


def test_friction_is_a_second_perception(slate):
    haptics, _ = build_hjif(play_texture(slate, seconds=0.5))
    assert [one.perception_modality for one in haptics.perceptions] == ["Vibrotactile", "Friction"]
    assert_allclose(play_hjif(haptics)[:4000, 1], 0.25)


@pytest.fixture
def content(tmp_path):
    write_hjif(play_texture(noise(), seconds=0.3), tmp_path / "a.hjif")
    return json.loads((tmp_path / "a.hjif").read_text())


def parsed(content):
    return Haptics.model_validate_json(json.dumps(content))


def effect(kind, position=0, **more):
    return {"effect_type": kind, "position": position, **more}


def band(kind, high, *effects):
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": high}
    return {"band_type": kind, **limits, "effects": list(effects)}


CLICK = effect("Basis", id=3, keyframes=[{"relative_position": 0, "amplitude_modulation": 0.5}])


def test_library_effects_and_nested_effects_are_played(content):
    perception = content["perceptions"][0]
    perception["effect_library"] = [CLICK]
    nested = effect("Composite", 100, composition=[effect("Reference", 40, id=3)])
    clicks = band("Transient", 300, effect("Reference", 10, id=3), nested)
    perception["channels"] = [perception["channels"][0] | {"gain": 2.0, "bands": [clicks]}]
    del perception["channels"][0]["sample_count"]
    played = play_hjif(parsed(content))[:, 0]
    assert_allclose(np.abs(played).max(), 1.0, rtol=1e-3)
    times = np.flatnonzero(np.abs(played) > 1e-6) / 8000
    assert_allclose(times[[0, -1]], [0.010, 0.140 + 0.022], atol=2e-4)
    assert not np.any((times > 0.0325) & (times < 0.1395))


@pytest.mark.parametrize("last", [CLICK, effect("Composite", id=3)], ids=["click", "empty"])
def test_references_that_expand_to_too_many_effects_are_refused(content, last):
    perception = content["perceptions"][0]
    many = [effect("Composite", id=i, composition=300 * [effect("Reference", id=i + 1)]) for i in range(3)]
    perception["effect_library"] = [*many, last]
    perception["channels"][0]["bands"] = [band("Transient", 300, effect("Reference", id=0))]
    with pytest.raises(ValueError, match="at most 100000 effects"):
        play_hjif(parsed(content))


def test_references_to_missing_effects_and_to_themselves_are_refused(content):
    perception = content["perceptions"][0]
    perception["channels"][0]["bands"] = [band("Transient", 9, effect("Reference", id=4))]
    for other, match in (
        (9, "reference to unknown effect 9. Expected an id of the library"),
        (4, "at most 8 deep"),
    ):
        perception["effect_library"] = [
            effect("Composite", id=4, composition=[effect("Reference", id=other)])
        ]
        with pytest.raises(ValueError, match=match):
            play_hjif(parsed(content))


def test_very_long_files_and_large_blocks_are_refused(content):
    channel = content["perceptions"][0]["channels"][0]
    first = channel["bands"][0]["effects"][0]
    del channel["sample_count"]
    first["position"] = 2**31 - 1
    with pytest.raises(ValueError, match="at most 600 s"):
        play_hjif(parsed(content))
    first["position"] = 0
    channel["bands"][0]["block_length"], channel["sample_count"] = 1 << 20, 100
    with pytest.raises(ValueError, match="a power of two from 16 to 65536"):
        play_hjif(parsed(content))


def test_too_many_channels_and_too_long_effects_are_refused(content):
    channel = content["perceptions"][0]["channels"][0]
    long = channel | {"frequency_sampling": 1000, "sample_count": 600_000}
    content["perceptions"][0]["channels"] = [long | {"id": i} for i in range(21)]
    with pytest.raises(ValueError, match=r"at most 12000 s for channels.*21 channels of 600 s"):
        play_hjif(parsed(content))
    constant = effect("Basis", keyframes=[{"relative_position": 590_000, "amplitude_modulation": 1}])
    content["perceptions"][0]["channels"] = [long | {"bands": [band("VectorialWave", 9, *170 * [constant])]}]
    with pytest.raises(ValueError, match="100300 s of effects"):
        play_hjif(parsed(content))


def test_too_many_samples_of_wavelet_blocks_are_refused(content):
    wavelets = content["perceptions"][0]["channels"][0]["bands"][0]
    wavelets |= {
        "block_length": 16_384,
        "upper_frequency_limit": 4000,
        "effects": 62 * wavelets["effects"][:1],
    }
    with pytest.raises(ValueError, match=r"at most 4000000 samples in total, got 4063232"):
        play_hjif(parsed(content))


def test_unknown_keys_and_padding_do_not_matter(content):
    wavelets = content["perceptions"][0]["channels"][0]["bands"][0]
    original = play_hjif(parsed(content))
    wavelets["vendor"] = {"a": 1}
    stream = wavelets["effects"][0]["wavelet_stream"]
    wavelets["effects"][0]["wavelet_stream"] = stream + "=" * (-len(stream) % 4)
    assert base64.b64decode(wavelets["effects"][0]["wavelet_stream"])
    assert_array_equal(play_hjif(parsed(content)), original)
