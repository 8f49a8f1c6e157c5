"""Saved textures render the same samples; all other files are refused with one clear error."""

import json
import pickle
import struct
import zipfile
from typing import ClassVar

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from safetensors import safe_open
from safetensors.numpy import load_file, save

from texclass.haptics.exchange import describe, load_taps, load_texture, save_texture, texture_file
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel


@pytest.fixture
def path(hum, tmp_path):
    return save_texture(hum, tmp_path / "hum.texture")


def assert_refused(path, match):
    """Assert that reading raises a ValueError that names the file and the reason."""
    with pytest.raises(ValueError, match=match) as error:
        load_texture(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 1000


def test_a_round_trip_keeps_every_bit_and_type(hum, path, tmp_path):
    loaded = load_texture(path)
    assert vars(loaded).keys() == vars(hum).keys()
    assert (loaded.name, loaded.fs, loaded.note) == (hum.name, hum.fs, hum.note)
    assert_array_equal(loaded.tones, hum.tones)
    properties = describe(path)
    expected = ("hum", "m/s^2", path.stat().st_size)
    assert (properties["family"], properties["unit"], properties["bytes"]) == expected
    assert (properties["operations per sample"], properties["arrays"]) == (4.0, {"tones": [2, 2]})
    assert save_texture(hum, tmp_path / "second.texture").read_bytes() == path.read_bytes()
    assert_array_equal(load_file(path)["tones"], hum.tones)  # readable by any program for safetensors
    hum.name = '"[[[[' + "[{" * 60
    assert load_texture(save_texture(hum, path)).name == hum.name


def test_tap_libraries_and_textures_are_not_confused(path, tmp_path):
    library = TapLibrary(("wood", "steel"), (TapModel(100.0, 50.0, 90.0), TapModel(300.0, 90.0, 300.0)), "g")
    taps = save_texture(library, tmp_path / "taps.texture")
    assert load_taps(taps) == library
    assert (describe(taps)["fs"], describe(taps)["unit"]) == (None, "g")
    assert_refused(taps, "contains an object of the family 'okamura2001'. Expected one of abdulali2016")
    with pytest.raises(
        ValueError, match=r"contains an object of the family 'hum'. Expected one of okamura2001"
    ):
        load_taps(path)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"version": texture_file.VERSION + 1}, "newer texclass"),
        ({"family": "os.system"}, "one of"),
        ({"unit": "furlong"}, "unit is 'furlong'. Expected one of m/s"),
        ({"parameters/fs": "fast"}, "fs is 'fast'. Expected"),
        ({"parameters/fs": 500.0}, r"1000.0.* in the header but .*500.0.* in the data"),
        ({"parameters/tones": 3}, "array 'tones' does not belong to a parameter"),
        ({"name": "bell\x07"}, "printable"),
        ({"name": "x" * 300}, "printable"),
        ({"parameters": []}, "table"),
        ({"author": "me"}, "unknown key author"),
    ],
)
def test_invalid_headers_are_refused(path, forge, changes, match):
    assert_refused(forge(path, changes), match)


def test_duplicate_keys_are_refused(path):
    with safe_open(path, "np") as file:
        text, arrays = file.metadata()["texclass"], load_file(path)
    for old, new in (('"fs":1000.0', '"fs":1000.0,"fs":1000.0'), ('"note"', '"name":"hum","note"')):
        assert old in text
        path.write_bytes(save(arrays, {"texclass": text.replace(old, new, 1)}))
        assert_refused(path, "not written by texclass")


def test_invalid_arrays_are_refused(path, forge):
    whole = path.read_bytes()
    cases = [({"tones": np.array([[50.0, value]])}, "finite") for value in (np.nan, np.inf, -np.inf)]
    cases += [({"more": array}, "damaged") for array in (np.ones(2, np.float32), np.ones((1,) * 5))]
    cases += [
        ({"more": np.ones(2)}, "'more' does not belong to a parameter"),
        ({"tones": np.ones(2)}, r"tones must have shape.*got \(2,\)"),
    ]
    for arrays, match in cases:
        path.write_bytes(whole)
        assert_refused(forge(path, **arrays), match)


@pytest.mark.parametrize("failure", [KeyError, TypeError, ZeroDivisionError, MemoryError, RecursionError])
def test_any_error_of_a_family_becomes_a_value_error(path, hum, monkeypatch, failure):
    def fail(parameters, arrays):
        raise failure("here")

    monkeypatch.setattr(type(hum), "restore", fail)
    assert_refused(path, "cannot create 'hum'")


def test_partial_files_are_refused_and_changed_bytes_are_detected_or_harmless(path, hum):
    data = path.read_bytes()
    for n in range(0, len(data), 3):
        path.write_bytes(data[:n])
        assert_refused(path, "Expected")
        path.write_bytes(data[:n] + bytes([data[n] ^ 0x10]) + data[n + 1 :])
        try:
            assert_array_equal(load_texture(path).tones, hum.tones)
            message = str(path)
        except ValueError as error:
            message = str(error)
        assert str(path) in message
    path.write_bytes(data.replace(b"120.5", b"130.5").replace(b"low", b"top"))
    assert_refused(path, "checksum|SHA-256")


def _raw(header, body=b""):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def _array(dtype, shape, *offsets):
    return {"dtype": dtype, "shape": shape, "data_offsets": offsets}


class Bomb:
    """Object that records its creation if a file executes something."""

    calls: ClassVar[list[int]] = []

    def __reduce__(self):
        return (self.calls.append, (1,))


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (b"", "damaged"),
        (b"not a texture at all", "not a texture"),
        (struct.pack("<Q", 1 << 62), "not a texture"),
        (pickle.dumps(Bomb()), "not a texture|damaged"),
        (_raw({"a": _array("F64", [1 << 40], 0, 8)}, bytes(8)), "damaged"),
        (_raw({"a": _array("F64", [1 << 40, 1 << 40, 0], 0, 0)}), "damaged"),
        (_raw({"a": _array("F64", [1], 0, 8)}, bytes(16)), "damaged"),
        (_raw({"a": _array("F64", [1], 0, 8), "b": _array("F64", [1], 0, 8)}, bytes(8)), "damaged"),
        (_raw({"a": _array("BF16", [1], 0, 2)}, bytes(2)), "BF16"),
        (_raw({"a": _array("F64", [1] * 200, 0, 8)}, bytes(8)), "200 axes"),
        (_raw(b"[" * 100_000), "damaged"),
        (_raw({"__metadata__": {"texclass": "[" * 100_000}}), "damaged"),
        (_raw({"__metadata__": {"texclass": '{"version": NaN}'}}), "damaged"),
        (_raw({"__metadata__": {"texclass": '{"version": 1e999}'}}), "version|missing key"),
        (_raw({"__metadata__": {"texclass": '{"fs": ' + "9" * 5000 + "}"}}), "damaged"),
        (_raw({"__metadata__": {"texclass": "null"}}), "table"),
        (_raw({"__metadata__": {"other": "{}"}}), "damaged"),
        (_raw({}), "damaged"),
    ],
)
def test_damaged_and_hostile_files_are_refused(tmp_path, data, match):
    path = tmp_path / "odd.texture"
    path.write_bytes(data)
    assert_refused(path, match)
    assert not Bomb.calls


def test_files_of_the_first_version_get_instructions(tmp_path):
    with zipfile.ZipFile(tmp_path / "old.texture", "w") as archive:
        archive.writestr("texture.json", "{}")
    assert_refused(tmp_path / "old.texture", "written by texclass 0.1. .*or plan the scene again")


def test_large_files_are_refused(path, monkeypatch):
    monkeypatch.setattr(texture_file, "MAX_FILE_BYTES", 100)
    assert_refused(path, "at most 100")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"name": "\x1b[31m"}, "printable"),
        ({"fs": np.nan}, "JSON"),
        ({"note": np.sin}, "cannot be written as JSON"),
        ({"tones": np.array([[np.nan]])}, "finite"),
        ({"family": "tune"}, "family"),
        ({"unit": "stone"}, "unit is"),
    ],
)
def test_objects_that_could_not_be_read_are_not_written(hum, tmp_path, change, match):
    for name, value in change.items():
        setattr(hum, name, value)
    with pytest.raises(ValueError, match=match) as error:
        save_texture(hum, tmp_path / "hum.texture")
    assert str(tmp_path / "hum.texture") in str(error.value)
    with pytest.raises(ValueError, match=r"Expected \.texture"):
        save_texture(type(hum)(), tmp_path / "hum.zip")
    assert not list(tmp_path.iterdir())
