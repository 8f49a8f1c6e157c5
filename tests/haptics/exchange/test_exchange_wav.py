import json

import numpy as np
import pytest
import soundfile
from numpy.testing import assert_allclose, assert_array_equal

from texclass.haptics.exchange import read_wav, write_wav

RNG = np.random.default_rng(0)


def test_float_files_keep_32_bits_in_physical_units_and_the_exact_rate(tmp_path):
    for x in (30 * RNG.standard_normal(500), 30 * RNG.standard_normal((500, 2))):
        vibration = read_wav(write_wav(tmp_path / "a.wav", x, 3333.3))
        assert_array_equal(vibration.samples, x.astype(np.float32))
        assert (vibration.fs, vibration.unit, vibration.peak) == (3333.3, "m/s^2", np.abs(x).max())
        assert soundfile.info(tmp_path / "a.wav").samplerate == 3333


def test_16_bit_files_are_accurate_to_half_a_code_and_their_largest_code_is_the_peak(tmp_path):
    x = 30 * RNG.standard_normal(2000)
    vibration = read_wav(write_wav(tmp_path / "a.wav", x, 2000.0, unit="g", encoding="pcm16"))
    assert np.abs(vibration.samples - x).max() <= vibration.peak / 65534 * (1 + 1e-9)
    assert np.abs(vibration.samples).max() == pytest.approx(np.abs(x).max(), rel=1e-12)
    assert (vibration.unit, vibration.fs) == ("g", 2000.0)
    assert np.abs(soundfile.read(tmp_path / "a.wav", dtype="int16")[0]).max() == 32767
    with soundfile.SoundFile(tmp_path / "a.wav") as file:
        assert f'"unit": "g", "peak": {vibration.peak!r}' in file.comment


@pytest.mark.parametrize(("fs", "shift"), [(1000.0, 0.0), (2333.3, 0.0), (1000.0, 250.0), (96_000.0, 40.0)])
def test_audible_files_are_16_bit_at_48_khz_normalised_and_shifted_in_frequency(tmp_path, fs, shift):
    t = np.arange(round(fs)) / fs
    x = np.column_stack([2.5 * np.sin(2 * np.pi * 80 * t), 0.5 * np.sin(2 * np.pi * 310 * t)])
    path = write_wav(tmp_path / "a.wav", x, fs, encoding="audible", shift_hz=shift)
    info, vibration = soundfile.info(path), read_wav(path)
    assert (info.samplerate, info.subtype, vibration.fs, vibration.shift_hz) == (
        48_000,
        "PCM_16",
        48_000.0,
        shift,
    )
    assert np.abs(soundfile.read(path, dtype="int16")[0]).max() == 32767
    middle = vibration.samples[2400:-2400][: 9 * 4800]
    spectra = np.abs(np.fft.rfft(middle * np.hanning(len(middle))[:, np.newaxis], axis=0))
    for channel, (hz, height) in enumerate([(80, 2.5), (310, 0.5)]):
        assert spectra[:, channel].argmax() / 0.9 == pytest.approx(hz + shift, abs=1.2)
        assert np.sqrt(2 * np.mean(middle[:, channel] ** 2)) == pytest.approx(height, rel=0.01)
    with soundfile.SoundFile(path) as file:
        note = json.loads(file.comment)
    assert note["gain"] * vibration.peak == pytest.approx(1)


def test_silence_stays_silent_and_files_of_other_programs_have_an_arbitrary_unit(tmp_path):
    for encoding in ("float32", "pcm16", "audible"):
        vibration = read_wav(write_wav(tmp_path / "a.wav", np.zeros(10), 1000.0, encoding=encoding))
        assert not vibration.samples.any()
        assert vibration.peak == 0
    soundfile.write(tmp_path / "a.wav", np.array([0.5, -0.25]), 1000, subtype="PCM_16")
    vibration = read_wav(tmp_path / "a.wav")
    assert_allclose(vibration.samples, [0.5, -0.25])
    assert (vibration.unit, vibration.peak) == ("arbitrary", 0.5)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"samples": [1.0, np.nan]}, "finite"),
        ({"samples": []}, "n >= 1"),
        ({"samples": np.ones((2, 2, 2))}, "shape"),
        ({"samples": [1e300]}, "32-bit"),
        ({"fs": 0.0}, "fs must be"),
        ({"fs": np.nan}, "fs must be"),
        ({"unit": "stone"}, "stone"),
        ({"encoding": "mp3"}, "mp3"),
        ({"shift_hz": 100.0}, "requires encoding 'audible'"),
        ({"encoding": "audible", "shift_hz": -1.0}, "shift_hz"),
        ({"encoding": "audible", "fs": 5.0}, "Use encoding 'float32'"),
        ({"path": "a.flac"}, ".wav"),
    ],
)
def test_invalid_arguments_are_refused(tmp_path, change, match):
    valid = {"path": "a.wav", "samples": [1.0], "fs": 1000.0, "unit": "m/s^2", "encoding": "float32"}
    arguments = valid | change
    path = tmp_path / arguments.pop("path")
    with pytest.raises(ValueError, match=match):
        write_wav(path, **arguments)
    assert not path.exists()


@pytest.mark.parametrize(
    ("comment", "match"),
    [
        ('{"texclass": 1}', "missing key"),
        ('{"texclass": 1, "unit": "g", "peak": -1.0, "fs": 1000.0}', "peak"),
        ('{"texclass": 1, "unit": "g", "peak": NaN, "fs": 1000.0}', "JSON"),
        ('{"texclass": 1, "unit": "g", "peak": 1.0, "fs": 44100.0}', "header"),
        ('{"texclass": 1', "JSON"),
    ],
)  # fmt: skip
def test_invalid_comments_are_refused(tmp_path, comment, match):
    path = tmp_path / "a.wav"
    with soundfile.SoundFile(path, "w", 1000, 1, "PCM_16") as file:
        file.comment = comment
        file.write(np.ones(10))
    with pytest.raises(ValueError, match=match) as error:
        read_wav(path)
    assert str(path) in str(error.value)


def test_other_sample_formats_are_refused(tmp_path):
    soundfile.write(tmp_path / "b.wav", np.ones(9), 1000, subtype="PCM_24")
    with pytest.raises(ValueError, match="PCM_24"):
        read_wav(tmp_path / "b.wav")
