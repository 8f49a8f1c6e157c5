"""Files that are damaged, of another kind, or invalid are refused in one line with file and reason."""

import json

import pytest
from spoiling import REMOVED, replace_value
from test_ahap import make_rendition, swell
from test_hjif import band, effect, noise

from texclass.haptics.exchange import (
    load_texture,
    play_texture,
    read_ahap,
    read_hatt,
    read_hjif,
    read_wav,
    save_texture,
    write_ahap,
    write_hatt,
    write_hjif,
    write_wav,
)

READERS = {
    "hjif": read_hjif, "ahap": read_ahap, "xml": read_hatt, "wav": read_wav,
    "texture": load_texture,
}  # fmt: skip


@pytest.fixture(scope="module")
def files(slate, tmp_path_factory):
    """Return the bytes of a valid file of each kind."""
    folder, stroke = tmp_path_factory.mktemp("written"), play_texture(slate, seconds=0.3)
    write_hjif(play_texture(noise(), seconds=0.3), folder / "a.hjif")
    write_ahap(make_rendition(swell(0.3)), folder / "a.ahap")
    write_hatt(slate, folder / "a.xml")
    write_wav(folder / "a.wav", stroke.samples, 1000.0)
    save_texture(slate, folder / "a.texture")
    return {kind: (folder / f"a.{kind}").read_bytes() for kind in READERS}


def assert_refused(path, data, message=r"Expected|must"):
    path.write_bytes(data)
    with pytest.raises(ValueError, match=message) as error:
        READERS[path.suffix[1:]](path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


TEXTS = "", "{", "[]", "3", "[" * 5000, '{"version": NaN}', '{"a":' * 500 + "1" + "}" * 500


@pytest.mark.parametrize("kind", READERS)
def test_files_of_another_kind_and_partial_files_are_refused(files, tmp_path, kind):
    for text in TEXTS:
        assert_refused(tmp_path / f"b.{kind}", text.encode())
    n = len(files[kind])
    for size in (1, 11, 40, n // 2, n - 2):
        assert_refused(tmp_path / f"b.{kind}", files[kind][:size])
    (tmp_path / f"c.{kind}").mkdir()
    with pytest.raises(ValueError, match="not a regular file"):
        READERS[kind](tmp_path / f"c.{kind}")
    with pytest.raises(FileNotFoundError):
        READERS[kind](tmp_path / f"absent.{kind}")


P, C = ("perceptions", 0), ("perceptions", 0, "channels", 0)
B = (*C, "bands", 0)
E = (*B, "effects", 0)
EVENT, CURVE = ("Pattern", 0, "Event"), ("Pattern", 1, "ParameterCurve")
CURVES = [band("Curve", 9, effect("Basis", keyframes=frames)) for frames in ([], [{"relative_position": 0}])]
FAULTS = [
    ("hjif", ("version",), "1999", "version"),
    ("hjif", ("profile",), "Deluxe", "profile"),
    ("hjif", ("profile",), "Simple Parametric", "require the profile Main"),
    ("hjif", ("level",), 3, "level"),
    ("hjif", ("timescale",), 0, "timescale"),
    ("hjif", ("syncs",), REMOVED, "missing key syncs"),
    ("hjif", ("perceptions",), [], "perceptions"),
    ("hjif", ("avatars",), 2 * [{"id": 1, "lod": 0, "type": "Vibration"}], "two avatars have the same id"),
    ("hjif", (*P, "avatar_id"), 7, "avatar 7 of a perception is not defined"),
    ("hjif", (*P, "perception_modality"), "Taste", "perception_modality"),
    ("hjif", (*P, "channels"), [], "channels"),
    ("hjif", (*C, "body_part_mask"), REMOVED, "missing key .*body_part_mask"),
    ("hjif", (*C, "gain"), -1.0, "gain is -1"),
    ("hjif", (*C, "gain"), "1", "gain is '1'"),
    ("hjif", (*C, "reference_device_id"), 9, "reference device 9 is not defined"),
    ("hjif", (*C, "direction"), {"X": 1, "Y": 0, "Z": 0}, "must be a unit vector"),
    ("hjif", (*C, "direction"), None, "direction must not be null"),
    ("hjif", (*B, "lower_frequency_limit"), 9000, "at least lower_frequency_limit"),
    ("hjif", (*B, "upper_frequency_limit"), 99.5, "upper_frequency_limit is 99.5"),
    ("hjif", (*B, "block_length"), 100, "block_length must be a power of two, got 100"),
    ("hjif", (*B, "curve_type"), "Cubic", "a WaveletWave band must not have a curve_type"),
    ("hjif", (*B, "curve_type"), None, "curve_type must not be null"),
    ("hjif", B, CURVES[0], "must have keyframes with amplitude_modulation"),
    ("hjif", B, CURVES[1], "must have keyframes with amplitude_modulation"),
    ("hjif", E, {"effect_type": "Reference", "id": 5, "position": 0}, "reference to unknown effect 5"),
    ("hjif", (*E, "id"), None, "id must not be null"),
    ("hjif", (*E, "position"), -4, "position is -4"),
    ("hjif", (*E, "effect_type"), "Boom", "effect_type is 'Boom'"),
    ("hjif", (*E, "wavelet_stream"), REMOVED, "must have a wavelet_stream, got none"),
    ("hjif", (*E, "wavelet_stream"), "a", "must be base64"),
    ("hjif", (*E, "keyframes"), [{"relative_position": 0}], "must have a wavelet_stream, got keyframes"),
    ("ahap", ("Version",), REMOVED, "missing key Version"),
    ("ahap", (*EVENT, "Time"), -1, "Time is -1"),
    ("ahap", (*EVENT, "EventType"), "Boom", "EventType is 'Boom'"),
    ("ahap", (*EVENT, "EventDuration"), REMOVED, "must have a positive EventDuration"),
    ("ahap", (*CURVE, "ParameterCurveControlPoints"), [], "at least 1"),
    ("ahap", (*CURVE, "ParameterCurveControlPoints", 0, "Time"), 9.0, "must increase"),
]


@pytest.mark.parametrize(("kind", "key_path", "value", "message"), FAULTS)
def test_a_file_with_one_invalid_value_is_refused(files, tmp_path, kind, key_path, value, message):
    content = json.loads(files[kind])
    replace_value(content, key_path, value)
    assert_refused(tmp_path / f"b.{kind}", json.dumps(content).encode(), message)
