"""Textures, taps and planned scenes in files: ours, Penn HaTT XML, WAV."""

import hashlib
import random
import struct
import sys
from pathlib import Path

import numpy as np

from fuzz.contract import Target
from fuzz.mutate import archives, either, of_bytes, of_text, of_tree
from fuzz.recordings import written
from texclass.exchange import (
    describe,
    load_taps,
    load_texture,
    read_hatt,
    read_wav,
    save_texture,
    write_hatt,
    write_wav,
)
from texclass.exchange.description import encode, parse_json
from texclass.scene import GridModel, PlannedScene
from texclass.scene.planned import load_scene
from texclass.textures.hatt import HattTexture, Mesh
from texclass.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel

_DESCRIPTION = "texture.json"
_ODD = (0.0, -0.0, -1.0, 1e-300, 5e-324, 1e9, 1e154, 1e300, 1.7e308, -1.7e308, 0.5, 1.0, 3.141592653589793)


def _slate() -> HattTexture:
    mesh = Mesh(np.array([0.0, 90.0, 0.0]), np.array([0.0, 0.0, 3.0]), np.array([[0, 1, 2]]))
    return HattTexture(mesh, [[0.5, 1.0, 2.0]] * 3, [[1.5]] * 3, [0.1] * 3, [2.0] * 3, 1000.0, "slate")


def _planned() -> PlannedScene:
    v, f = np.array([40.0, 160.0]), np.array([0.5, 2.0])
    lattice = GridModel(v, f, np.full((2, 2, 2), 0.5), np.array([[1.0, 4.0], [4.0, 16.0]]), 8.0)
    lines = GridModel(v, f, np.ones((2, 2, 1)), np.ones((2, 2)), 2.5, np.array([120.0]), np.array([0.0]))
    models = (lattice, lines, GridModel.silence())
    return PlannedScene("test", 1000.0, "m/s^2", (20.0, 450.0), 20.0, 2, {"a": 0, "b": 1, "c": 2}, models)


def _families() -> list[bytes]:
    """Return a texture of every family that is stroked: those that the tests of families make."""
    folder = str(Path(__file__).parents[1] / "exchange")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    from test_families import MADE

    made = [_slate(), *(make() for make in MADE.values())]
    return [written("a.texture", lambda p, t=texture: save_texture(t, p)) for texture in made]


def _scenes() -> list[bytes]:
    return [written("a.texture", _planned().save)]


def _sealed(rng: random.Random, members: dict[str, bytes]) -> dict[str, bytes]:
    """Change values of the description or of an array, and make all checksums right again."""
    described = parse_json(members[_DESCRIPTION], "seed")
    described.pop("sha256", None)
    arrays = [name for name in members if name != _DESCRIPTION]
    if arrays and rng.random() < 0.5:
        name = rng.choice(arrays)
        members[name] = _changed_array(rng, members[name])
        announced = described["arrays"][name[7:-4]]
        announced["sha256"] = hashlib.sha256(members[name]).hexdigest()
        if rng.random() < 0.3:
            shape = rng.choice(([], [0], [1], [10**9], *([list(reversed(announced["shape"]))] * 3)))
            announced["shape"] = shape
            members[name] = _with_shape(members[name], tuple(shape))
            announced["sha256"] = hashlib.sha256(members[name]).hexdigest()
    else:
        described["parameters"] = of_tree(rng, described["parameters"])
        if isinstance(described["parameters"], dict) and rng.random() < 0.7:
            described |= {key: described["parameters"].get(key, described[key]) for key in ("name", "fs")}
        if rng.random() < 0.2:
            described = of_tree(rng, described)
    members[_DESCRIPTION] = encode(described)
    return members


def _changed_array(rng: random.Random, data: bytes) -> bytes:
    start = 10 + int.from_bytes(data[8:10], "little")
    count = (len(data) - start) // 8
    for _ in range(rng.choice((1, 1, 2, 5)) if count else 0):
        at = start + 8 * rng.randrange(count)
        data = data[:at] + struct.pack("<d", rng.choice(_ODD) * rng.choice((1, 1, -1, 1.5))) + data[at + 8 :]
    return data


def _with_shape(data: bytes, shape: tuple[int, ...]) -> bytes:
    from texclass.exchange.npy import _header

    body = data[10 + int.from_bytes(data[8:10], "little") :]
    return _header(shape) + body[: 8 * int(np.prod(shape, dtype=object))]


def _texture(path: Path) -> object:
    texture = load_texture(path)
    assert 0 < texture.fs < float("inf")
    describe(path)
    return texture


def _hatts() -> list[bytes]:
    return [written("a.xml", lambda p: write_hatt(_slate(), p))]


def _wavs() -> list[bytes]:
    x = np.sin(np.arange(20.0))
    return [
        written("a.wav", lambda p, e=e: write_wav(p, x, 1000.0, encoding=e)) for e in ("pcm16", "float32")
    ]


def _wav(path: Path) -> object:
    found = read_wav(path)
    assert np.isfinite(found.samples).all()
    assert 0 < found.fs < float("inf")
    return found


def _scene(path: Path) -> object:
    from texclass.scene import SceneRenderer

    return SceneRenderer(load_scene(path), seed=0).n_contacts


def _libraries() -> list[bytes]:
    library = TapLibrary(("a", "b"), (TapModel(-100.0, 50.0, 60.0), TapModel(-150.0, 70.0, 200.0)))
    return [written("a.texture", lambda p: save_texture(library, p))]


_ARCHIVES = archives(_sealed, deflate=False)
TARGETS = (
    Target("texture", _families, _texture, _ARCHIVES, "fuzzed.texture"),
    Target("planned scene", _scenes, _scene, _ARCHIVES, "scene.texture"),
    Target("taps", _libraries, load_taps, _ARCHIVES, "taps.texture"),
    Target("HaTT XML", _hatts, read_hatt, either(of_text, of_text, of_bytes), "fuzzed.xml"),
    Target("rendered WAV", _wavs, _wav, of_bytes, "vibration.wav"),
)
