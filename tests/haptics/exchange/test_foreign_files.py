"""What is no file of its kind, or breaks a rule of it, is refused in one line that names file and rule."""

import json

import pytest
from spoiling import GONE, put
from test_ahap import sent, swell
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

READ = {
    "hjif": read_hjif, "ahap": read_ahap, "xml": read_hatt, "wav": read_wav,
    "texture": load_texture,
}  # fmt: skip


@pytest.fixture(scope="module")
def written(slate, tmp_path_factory):
    """What we write of each kind: its bytes."""
    folder, stroke = tmp_path_factory.mktemp("written"), play_texture(slate, seconds=0.3)
    write_hjif(play_texture(noise(), seconds=0.3), folder / "a.hjif")
    write_ahap(sent(swell(0.3)), folder / "a.ahap")
    write_hatt(slate, folder / "a.xml")
    write_wav(folder / "a.wav", stroke.samples, 1000.0)
    save_texture(slate, folder / "a.texture")
    return {kind: (folder / f"a.{kind}").read_bytes() for kind in READ}


def refused(path, data, words="Expected"):
    path.write_bytes(data)
    with pytest.raises(ValueError, match=words) as error:
        READ[path.suffix[1:]](path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


TEXTS = "", "{", "[]", "3", "[" * 5000, '{"version": NaN}', '{"a":' * 500 + "1" + "}" * 500


@pytest.mark.parametrize("kind", READ)
def test_what_is_no_whole_file_of_its_kind_is_refused(written, tmp_path, kind):
    for text in TEXTS:
        refused(tmp_path / f"b.{kind}", text.encode())
    n = len(written[kind])
    for part in (1, 11, 40, n // 2, n - 2):
        refused(tmp_path / f"b.{kind}", written[kind][:part])
    (tmp_path / f"c.{kind}").mkdir()
    with pytest.raises(ValueError, match="Expected a regular file"):
        READ[kind](tmp_path / f"c.{kind}")
    with pytest.raises(FileNotFoundError):
        READ[kind](tmp_path / f"absent.{kind}")


P, C = ("perceptions", 0), ("perceptions", 0, "channels", 0)
B = (*C, "bands", 0)
E = (*B, "effects", 0)
EVENT, CURVE = ("Pattern", 0, "Event"), ("Pattern", 1, "ParameterCurve")
UNBENT = [band("Curve", 9, effect("Basis", keyframes=frames)) for frames in ([], [{"relative_position": 0}])]
SPOILED = [
    ("hjif", ("version",), "1999", "version"),
    ("hjif", ("profile",), "Deluxe", "profile"),
    ("hjif", ("profile",), "Simple Parametric", "none for Simple Parametric"),
    ("hjif", ("level",), 3, "level"),
    ("hjif", ("timescale",), 0, "timescale"),
    ("hjif", ("syncs",), GONE, "missing key syncs"),
    ("hjif", ("perceptions",), [], "perceptions"),
    ("hjif", ("avatars",), 2 * [{"id": 1, "lod": 0, "type": "Vibration"}], "two avatars have the same id"),
    ("hjif", (*P, "avatar_id"), 7, "avatar 7 of a perception is not defined"),
    ("hjif", (*P, "perception_modality"), "Taste", "perception_modality"),
    ("hjif", (*P, "channels"), [], "channels"),
    ("hjif", (*C, "body_part_mask"), GONE, "missing key .*body_part_mask"),
    ("hjif", (*C, "gain"), -1.0, "gain is -1"),
    ("hjif", (*C, "gain"), "1", "gain is '1'"),
    ("hjif", (*C, "reference_device_id"), 9, "reference device 9 is none"),
    ("hjif", (*C, "direction"), {"X": 1, "Y": 0, "Z": 0}, "no unit vector"),
    ("hjif", (*C, "direction"), None, "direction is null"),
    ("hjif", (*B, "lower_frequency_limit"), 9000, "below its lower one"),
    ("hjif", (*B, "upper_frequency_limit"), 99.5, "upper_frequency_limit is 99.5"),
    ("hjif", (*B, "block_length"), 100, "block_length is 100"),
    ("hjif", (*B, "curve_type"), "Cubic", "a WaveletWave band has a curve type"),
    ("hjif", (*B, "curve_type"), None, "curve_type is null"),
    ("hjif", B, UNBENT[0], "no keyframe, or one without amplitude"),
    ("hjif", B, UNBENT[1], "no keyframe, or one without amplitude"),
    ("hjif", E, {"effect_type": "Reference", "id": 5, "position": 0}, "effect 5 is referred to"),
    ("hjif", (*E, "id"), None, "id is null"),
    ("hjif", (*E, "position"), -4, "position is -4"),
    ("hjif", (*E, "effect_type"), "Boom", "effect_type is 'Boom'"),
    ("hjif", (*E, "wavelet_stream"), GONE, "lacks its wavelet_stream"),
    ("hjif", (*E, "wavelet_stream"), "a", "no base64"),
    ("hjif", (*E, "keyframes"), [{"relative_position": 0}], "has keyframes"),
    ("ahap", ("Version",), GONE, "missing key Version"),
    ("ahap", (*EVENT, "Time"), -1, "Time is -1"),
    ("ahap", (*EVENT, "EventType"), "Boom", "EventType is 'Boom'"),
    ("ahap", (*EVENT, "EventDuration"), GONE, "no EventDuration"),
    ("ahap", (*CURVE, "ParameterCurveControlPoints"), [], "at least 1"),
    ("ahap", (*CURVE, "ParameterCurveControlPoints", 0, "Time"), 9.0, "must rise"),
]


@pytest.mark.parametrize(("kind", "way", "value", "words"), SPOILED)
def test_a_file_that_breaks_one_rule_is_refused(written, tmp_path, kind, way, value, words):
    content = json.loads(written[kind])
    put(content, way, value)
    refused(tmp_path / f"b.{kind}", json.dumps(content).encode(), words)
