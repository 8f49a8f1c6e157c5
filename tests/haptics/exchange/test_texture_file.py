"""A texture that is written down renders the same; whatever else a file holds is one clear error."""

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


def refused(path, match):
    """Assert that reading ends in a ValueError that names the file and the rule."""
    with pytest.raises(ValueError, match=match) as error:
        load_texture(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 1000


def test_round_trip_keeps_every_bit_and_kind(hum, path, tmp_path):
    found = load_texture(path)
    assert vars(found).keys() == vars(hum).keys()
    assert (found.name, found.fs, found.note) == (hum.name, hum.fs, hum.note)
    assert_array_equal(found.tones, hum.tones)
    told = describe(path)
    assert (told["family"], told["unit"], told["bytes"]) == ("hum", "m/s^2", path.stat().st_size)
    assert (told["operations per sample"], told["arrays"]) == (4.0, {"tones": [2, 2]})
    assert save_texture(hum, tmp_path / "again.texture").read_bytes() == path.read_bytes()
    assert_array_equal(load_file(path)["tones"], hum.tones)  # any program that knows safetensors
    hum.name = '"[[[[' + "[{" * 60
    assert load_texture(save_texture(hum, path)).name == hum.name


def test_taps_are_no_texture_to_stroke_and_no_texture_is_a_tap_library(path, tmp_path):
    library = TapLibrary(("wood", "steel"), (TapModel(100.0, 50.0, 90.0), TapModel(300.0, 90.0, 300.0)), "g")
    taps = save_texture(library, tmp_path / "taps.texture")
    assert load_taps(taps) == library
    assert (describe(taps)["fs"], describe(taps)["unit"]) == (None, "g")
    refused(taps, "holds 'okamura2001'. Expected one of abdulali2016")
    with pytest.raises(ValueError, match=r"holds 'hum'. Expected one of okamura2001"):
        load_taps(path)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"version": 3}, "newer texclass"),
        ({"family": "os.system"}, "one of"),
        ({"unit": "furlong"}, "unit is 'furlong'. Expected one of m/s"),
        ({"parameters/fs": "fast"}, "fs is 'fast'. Expected"),
        ({"parameters/fs": 500.0}, r"describes .*1000.0.*, holds .*500.0.*. Expected the same"),
        ({"parameters/tones": 3}, "array 'tones' belongs to no parameter"),
        ({"name": "bell\x07"}, "printable"),
        ({"name": "x" * 300}, "printable"),
        ({"parameters": []}, "table"),
        ({"author": "me"}, "unknown key author"),
    ],
)
def test_a_header_that_breaks_a_rule_is_refused(path, forge, changes, match):
    refused(forge(path, changes), match)


def test_a_key_named_twice_is_refused(path):
    with safe_open(path, "np") as file:
        text, arrays = file.metadata()["texclass"], load_file(path)
    for old, new in (('"fs":1000.0', '"fs":1000.0,"fs":1000.0'), ('"note"', '"name":"hum","note"')):
        assert old in text
        path.write_bytes(save(arrays, {"texclass": text.replace(old, new, 1)}))
        refused(path, "each key once")


def test_arrays_that_break_a_rule_are_refused(path, forge):
    whole = path.read_bytes()
    odd = [({"tones": np.array([[50.0, value]])}, "finite") for value in (np.nan, np.inf, -np.inf)]
    odd += [({"more": array}, "damaged") for array in (np.ones(2, np.float32), np.ones((1,) * 5))]
    odd += [
        ({"more": np.ones(2)}, "'more' belongs to no parameter"),
        ({"tones": np.ones(2)}, r"tones have shape \(2,\)"),
    ]
    for arrays, match in odd:
        path.write_bytes(whole)
        refused(forge(path, **arrays), match)


@pytest.mark.parametrize("failure", [KeyError, TypeError, ZeroDivisionError, MemoryError, RecursionError])
def test_whatever_a_family_stumbles_over_is_a_value_error(path, hum, monkeypatch, failure):
    def stumble(parameters, arrays):
        raise failure("here")

    monkeypatch.setattr(type(hum), "restore", stumble)
    refused(path, "makes no 'hum'")


def test_truncation_anywhere_is_refused_and_any_changed_byte_is_found_or_harmless(path, hum):
    data = path.read_bytes()
    for n in range(0, len(data), 3):
        path.write_bytes(data[:n])
        refused(path, "Expected")
        path.write_bytes(data[:n] + bytes([data[n] ^ 0x10]) + data[n + 1 :])
        try:
            assert_array_equal(load_texture(path).tones, hum.tones)
            said = str(path)
        except ValueError as error:
            said = str(error)
        assert str(path) in said
    path.write_bytes(data.replace(b"120.5", b"130.5").replace(b"low", b"top"))
    refused(path, "checksum|SHA-256")


def _raw(header, body=b""):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def _array(dtype, shape, *offsets):
    return {"dtype": dtype, "shape": shape, "data_offsets": offsets}


class Bomb:
    """Says that it was made where a file executes something."""

    made: ClassVar[list[int]] = []

    def __reduce__(self):
        return (self.made.append, (1,))


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (b"", "damaged"),
        (b"not a texture at all", "no texture"),
        (struct.pack("<Q", 1 << 62), "no texture"),
        (pickle.dumps(Bomb()), "no texture|damaged"),
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
def test_foreign_damaged_and_hostile_files_are_refused(tmp_path, data, match):
    path = tmp_path / "odd.texture"
    path.write_bytes(data)
    refused(path, match)
    assert not Bomb.made


def test_files_of_the_former_kind_say_what_to_do(tmp_path):
    with zipfile.ZipFile(tmp_path / "old.texture", "w") as archive:
        archive.writestr("texture.json", "{}")
    refused(tmp_path / "old.texture", "written by texclass 0.1. .*save it, or plan the scene again")


def test_a_file_that_is_too_large_is_refused(path, monkeypatch):
    monkeypatch.setattr(texture_file, "LARGEST_FILE", 100)
    refused(path, "at most 100")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"name": "\x1b[31m"}, "printable"),
        ({"fs": np.nan}, "JSON"),
        ({"note": np.sin}, "no JSON"),
        ({"tones": np.array([[np.nan]])}, "finite"),
        ({"family": "tune"}, "family"),
        ({"unit": "stone"}, "unit is"),
    ],
)
def test_what_could_not_be_read_is_not_written(hum, tmp_path, change, match):
    for name, value in change.items():
        setattr(hum, name, value)
    with pytest.raises(ValueError, match=match) as error:
        save_texture(hum, tmp_path / "hum.texture")
    assert str(tmp_path / "hum.texture") in str(error.value)
    with pytest.raises(ValueError, match=r"Expected \.texture"):
        save_texture(type(hum)(), tmp_path / "hum.zip")
    assert not list(tmp_path.iterdir())
