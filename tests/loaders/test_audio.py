import numpy as np
import pytest
import soundfile

from texclass.loaders import load_recording
from texclass.recording import RecordingError

FS = 2200


@pytest.mark.parametrize(
    ("suffix", "subtype", "bits"),
    [
        (".wav", "PCM_16", 16),
        (".wav", "PCM_24", 24),
        (".wav", "PCM_32", 32),
        (".flac", "PCM_16", 16),
        (".flac", "PCM_24", 24),
    ],
)
def test_counts_are_the_integer_codes_and_other_units_fractions_of_full_scale(
    tmp_path, subtype, bits, suffix
):
    codes = np.random.default_rng(0).integers(-(2 ** (bits - 1)), 2 ** (bits - 1), 300)
    path = tmp_path / f"r{suffix}"
    soundfile.write(path, (codes << (32 - bits)).astype(np.int32), FS, subtype=subtype)
    np.testing.assert_array_equal(load_recording(path, unit="counts").acceleration, codes)
    fractions = load_recording(path, unit="arbitrary").acceleration
    np.testing.assert_allclose(fractions, codes / 2 ** (bits - 1), rtol=1e-15)


@pytest.mark.parametrize("unit", ["counts", "arbitrary"])
@pytest.mark.parametrize("subtype", ["FLOAT", "DOUBLE"])
def test_floating_point_audio_is_kept_as_stored(tmp_path, unit, subtype):
    samples = np.random.default_rng(0).normal(size=300).astype(np.float32) * 50
    soundfile.write(tmp_path / "r.wav", samples, FS, subtype=subtype)
    np.testing.assert_array_equal(load_recording(tmp_path / "r.wav", unit=unit).acceleration, samples)


def test_a_wav_that_lost_its_end_is_refused_though_its_header_is_whole(tmp_path):
    path = tmp_path / "r.wav"
    soundfile.write(path, np.random.default_rng(0).normal(size=1000) / 9, FS)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordingError, match="holds 2043 of 2044 bytes"):
        load_recording(path, unit="counts")


def test_text_named_wav_is_refused(tmp_path):
    (tmp_path / "r.wav").write_text("not audio at all")
    with pytest.raises(RecordingError, match="not a readable audio file"):
        load_recording(tmp_path / "r.wav", unit="counts")
