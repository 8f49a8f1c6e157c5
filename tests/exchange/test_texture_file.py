import hashlib
import io
import json
import pickle
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from texclass.exchange import archive, load_taps, load_texture, read_texture_file, save_texture
from texclass.exchange.families import FAMILIES
from texclass.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel


@pytest.fixture
def path(hum, tmp_path):
    return save_texture(hum, tmp_path / "hum.texture")


def refused(path, match):
    """Assert that reading ends in a ValueError that names the file and the rule."""
    with pytest.raises(ValueError, match=match) as error:
        load_texture(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 1000


def test_round_trip_keeps_every_bit_and_kind(hum, path):
    found = load_texture(path)
    assert (found.name, found.fs) == (hum.name, hum.fs)
    assert_array_equal(found.tones, hum.tones)
    file = read_texture_file(path)
    assert file.parameters == hum.parameters()
    assert (file.family, file.unit, file.version, file.n_bytes) == ("hum", "m/s^2", 1, path.stat().st_size)


def test_round_trip_renders_the_same_samples(slate, tmp_path):
    found = load_texture(save_texture(slate, tmp_path / "slate.texture"))
    v = np.column_stack([np.linspace(0, 300, 500), np.zeros(500)])
    f = np.linspace(4, 0, 500)
    assert_array_equal(found.renderer(seed=4).process(v, f), slate.renderer(seed=4).process(v, f))


def test_the_same_texture_makes_the_same_bytes(hum, path, tmp_path):
    assert save_texture(hum, tmp_path / "again.texture").read_bytes() == path.read_bytes()


def test_numpy_reads_the_members(path):
    with zipfile.ZipFile(path) as whole:
        array = np.load(io.BytesIO(whole.read("arrays/tones.npy")), allow_pickle=False)
    assert_array_equal(array, [[50.0, 1.0], [120.5, 0.25]])


def test_taps_are_no_texture_to_stroke(tmp_path):
    library = TapLibrary(
        ("wood", "steel"), (TapModel(100.0, 50.0, 90.0), TapModel(300.0, 90.0, 300.0)), "m/s^2"
    )
    path = save_texture(library, tmp_path / "taps.texture")
    assert load_taps(path) == library
    assert read_texture_file(path).fs is None
    refused(path, "texture to stroke")


def test_a_texture_is_no_tap_library(path):
    with pytest.raises(ValueError, match="tap library"):
        load_taps(path)


@pytest.mark.parametrize(
    ("description", "match"),
    [
        ({"version": 2}, "newer texclass"),
        ({"version": 0}, "from 1 on"),
        ({"version": True}, "from 1 on"),
        ({"schema": "sound"}, "schema"),
        ({"family": "os.system"}, "one of"),
        ({"family": "../hum"}, "one of"),
        ({"unit": "furlong"}, "unit is"),
        ({"fs": -1.0}, "fs is"),
        ({"fs": 10**400}, "fs is"),
        ({"fs": "1000"}, "fs is"),
        ({"fs": 500.0}, "the rule is the same"),
        ({"name": "bell\x07"}, "printable"),
        ({"name": "x" * 300}, "printable"),
        ({"name": 3}, "printable"),
        ({"parameters": []}, "map"),
        ({"parameters/fs": None}, "KeyError"),
        ({"author": "me"}, "keys are"),
        ({"family": None}, "keys are"),
        ({"arrays/tones/shape": [2, 3]}, "header"),
        ({"arrays/tones/shape": [-2, -2]}, "shape"),
        ({"arrays/tones/shape": [2] * 9}, "shape"),
        ({"arrays/tones/shape": [1 << 39, 1 << 39]}, "header"),
        ({"arrays/tones/dtype": "|O"}, "dtype"),
        ({"arrays/tones/sha256": "0" * 64}, "SHA-256"),
        ({"arrays/more": {"dtype": "<f8", "shape": [1], "sha256": ""}}, "both"),
        ({"arrays/tones": None}, "both"),
    ],
)
def test_a_description_that_breaks_a_rule_is_refused(path, forge, description, match):
    refused(forge(path, description), match)


def test_a_family_that_is_not_installed_is_refused(path, monkeypatch):
    def absent():
        raise ModuleNotFoundError("no module named hum")

    monkeypatch.setitem(FAMILIES, "hum", absent)
    refused(path, "not installed")


@pytest.mark.parametrize("failure", [KeyError, TypeError, ZeroDivisionError, MemoryError, RecursionError])
def test_whatever_a_family_stumbles_over_is_a_value_error(path, hum, monkeypatch, failure):
    def stumble(parameters, arrays):
        raise failure("here")

    monkeypatch.setattr(type(hum), "restore", stumble)
    refused(path, "makes no 'hum'")


def _announced(data):
    return {"arrays/tones/sha256": hashlib.sha256(data).hexdigest()}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nan_and_infinity_are_refused(path, forge, dumped, value):
    data = dumped(np.array([[50.0, 1.0], [value, 0.25]]))
    refused(forge(path, _announced(data), tones=data), "finite")


def test_pickled_arrays_are_never_unpickled(path, forge, tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "executed"), "w"))

    buffer = io.BytesIO()
    np.save(buffer, np.array([[Bomb()]], dtype=object), allow_pickle=True)
    refused(forge(path, _announced(buffer.getvalue()), tones=buffer.getvalue()), "header")
    data = pickle.dumps(Bomb())
    refused(forge(path, _announced(data), tones=data), "header")
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("data", [b"", b"\x93NUMPY\x01\x00", b"\x93NUMPY\x01\x00\xff\xff" + b" " * 90])
def test_cut_arrays_are_refused(path, forge, data):
    refused(forge(path, _announced(data), tones=data), "header")


def test_arrays_with_data_missing_or_added_are_refused(path, forge, dumped):
    whole = dumped(np.ones((2, 2)))
    for data in (whole[:-8], whole + b"12345678"):
        refused(forge(path, _announced(data), tones=data), "bytes")


def test_truncation_anywhere_is_refused(path):
    data = path.read_bytes()
    for n in range(0, len(data), 7):
        path.write_bytes(data[:n])
        refused(path, "the rule is")


def test_any_changed_byte_is_found_or_harmless(path, hum):
    data = path.read_bytes()
    for n in range(0, len(data), 3):
        path.write_bytes(data[:n] + bytes([data[n] ^ 0x10]) + data[n + 1 :])
        try:
            assert_array_equal(load_texture(path).tones, hum.tones)
            said = str(path)
        except ValueError as error:
            said = str(error)
        assert str(path) in said


def _zip(path, members, **options):
    with zipfile.ZipFile(path, "w", **options) as whole:
        for name, data in members:
            whole.writestr(name, data)
    return path


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("members", "match"),
    [
        ([("texture.json", b"{}"), ("../../evil.npy", b"")], "NAME.npy"),
        ([("/etc/passwd.npy", b"")], "NAME.npy"),
        ([("arrays\\x.npy", b"")], "NAME.npy"),
        ([("arrays/", b"")], "NAME.npy"),
        ([("arrays/x.pkl", b"")], "NAME.npy"),
        ([("texture.json", b"{}"), ("texture.json", b"{}")], "twice"),
        ([("arrays/x.npy", b"")], "holds no texture.json"),
        ([(f"arrays/x{i}.npy", b"") for i in range(300)], "300 members"),
        ([], "holds no texture.json"),
    ],
)
def test_archives_with_odd_members_are_refused(tmp_path, members, match):
    refused(_zip(tmp_path / "odd.texture", members), match)
    assert [each.name for each in tmp_path.iterdir()] == ["odd.texture"]


def test_a_zip_bomb_is_refused_before_it_is_read(tmp_path):
    path = _zip(
        tmp_path / "bomb.texture", [("texture.json", b"0" * (1 << 24))], compression=zipfile.ZIP_DEFLATED
    )
    refused(path, "compressed")


def test_overlapping_members_are_refused(path):
    data = bytearray(path.read_bytes())
    directory = data.index(b"PK\x01\x02")
    for at in (20, 24):  # both sizes of the first member
        data[directory + at : directory + at + 4] = (len(data)).to_bytes(4, "little")
    path.write_bytes(bytes(data))
    refused(path, "no overlap")


def test_a_file_beyond_the_limit_is_refused_unread(path, monkeypatch):
    monkeypatch.setattr(archive, "LARGEST_FILE", 100)
    refused(path, "at most 100")


def test_comments_and_zip64_are_refused(path):
    data = path.read_bytes()
    path.write_bytes(data[:-2] + b"\x05\x00hello")
    refused(path, "whole one without a comment")
    path.write_bytes(data[:-22] + b"PK\x06\x07" + b"\0" * 16 + data[-22:])
    refused(path, "its directory")


def test_folders_and_other_files_are_refused(tmp_path):
    refused(tmp_path, "regular file")
    other = tmp_path / "other.texture"
    other.write_text("not a texture")
    refused(other, "ZIP archive")
    with pytest.raises(FileNotFoundError):
        load_texture(tmp_path / "absent.texture")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (b"[" * 100_000 + b"]" * 100_000, "nested"),
        (b'{"a":' * 50_000 + b"1" + b"}" * 50_000, "nested"),
        (b'["]",' * 50 + b"1" + b"]" * 50, "nested"),
        (b" " * (1 << 20) + b"{}", "at most 1048576"),
        (b'{"schema": "texclass-texture", "version": NaN}', "NaN"),
        (b'{"version": 1e999}', "1e999"),
        (b'{"a": 1, "a": 2}', "twice"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not the JSON"),
        (b"\xff\xfe", "not the JSON"),
        (b"null", "no texture description"),
        (b"", "not the JSON"),
    ],
)
def test_hostile_json_is_refused(tmp_path, text, match):
    path = tmp_path / "deep.texture"
    path.write_bytes(archive.pack({"texture.json": text}))
    refused(path, match)


def test_brackets_in_text_are_no_depth(hum, tmp_path):
    hum.name = '"[[[[' + "[{" * 60
    assert load_texture(save_texture(hum, tmp_path / "hum.texture")).name == hum.name


def test_a_changed_description_does_not_fit_its_checksum(path):
    members = archive.unpack(path)
    members["texture.json"] = members["texture.json"].replace(b'"m/s^2"', b'"g"')
    path.write_bytes(archive.pack(members))
    refused(path, "checksum")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"name": "\x1b[31m"}, "printable"),
        ({"fs": np.nan}, "no JSON|JSON"),
        ({"tones": np.array([np.nan])}, "finite"),
        ({"family": "tune"}, "family"),
    ],
)
def test_what_could_not_be_read_is_not_written(hum, tmp_path, change, match):
    for name, value in change.items():
        setattr(hum, name, value)
    with pytest.raises(ValueError, match=match) as error:
        save_texture(hum, tmp_path / "hum.texture")
    assert "/." not in str(error.value)  # the name it was given, not that of the unfinished file
    assert not list(tmp_path.iterdir())


def test_parameters_without_json_are_not_written(hum, tmp_path, monkeypatch):
    monkeypatch.setattr(type(hum), "parameters", lambda self: {"tones": self.tones})
    with pytest.raises(ValueError, match="no JSON"):
        save_texture(hum, tmp_path / "hum.texture")


def test_other_endings_and_units_are_refused(hum, tmp_path):
    with pytest.raises(ValueError, match=r"'\.texture'"):
        save_texture(hum, tmp_path / "hum.zip")
    with pytest.raises(ValueError, match="unit is"):
        save_texture(hum, tmp_path / "hum.texture", unit="stone")


def test_the_description_is_json_for_everyone(path):
    description = json.loads(archive.unpack(path)["texture.json"])
    assert description["schema"] == "texclass-texture"
    assert description["arrays"]["tones"]["shape"] == [2, 2]
