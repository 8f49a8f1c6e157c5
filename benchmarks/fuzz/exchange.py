"""Fuzzing targets: textures, taps and planned scenes in our files, Penn HaTT XML and WAV."""

import json
import random
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save

from fuzz.contract import Target
from fuzz.mutate import either, json_of, of_bytes, of_text, of_tree
from fuzz.recordings import written
from texclass.haptics.exchange import (
    describe,
    load_taps,
    load_texture,
    play_ahap,
    play_hjif,
    play_taps,
    play_texture,
    read_ahap,
    read_hatt,
    read_hjif,
    read_wav,
    save_texture,
    to_rendition,
    to_texture,
    write_ahap,
    write_hatt,
    write_hjif,
    write_wav,
)
from texclass.haptics.exchange.rendition import Rendition
from texclass.haptics.exchange.texture_file import Header, to_bytes
from texclass.haptics.scene import PlannedScene, load_scene
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.hatt import HattTexture, Mesh
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel

_ODD = (0.0, -0.0, -1.0, 1e-300, 5e-324, 1e9, 1e154, 1e300, 1.7e308, -1.7e308, 0.5, 1.0, 3.141592653589793)


def _slate() -> HattTexture:
    mesh = Mesh(np.array([0.0, 90.0, 0.0]), np.array([0.0, 0.0, 3.0]), np.array([[0, 1, 2]]))
    return HattTexture(mesh, [[0.5, 1.0, 2.0]] * 3, [[1.5]] * 3, [0.1] * 3, [2.0] * 3, 1000.0, "slate")


def _planned() -> PlannedScene:
    v, f = np.array([40.0, 160.0]), np.array([0.5, 2.0])
    lattice = GridModel((v, f), np.full((2, 2, 2), 0.5), np.array([[1.0, 4.0], [4.0, 16.0]]), 8.0)
    lines = GridModel((v, f), np.ones((2, 2, 1)), np.ones((2, 2)), 2.5, np.array([120.0]), np.array([0.0]))
    models = (lattice, lines, GridModel.silence())
    return PlannedScene("test", 1000.0, "m/s^2", (20.0, 450.0), 20.0, 2, {"a": 0, "b": 1, "c": 2}, models)


def _families() -> list[bytes]:
    """Return a texture of every family that is stroked: those that the tests of families make."""
    tests = Path(__file__).parents[2] / "tests"
    for folder in (str(tests), str(tests / "haptics" / "exchange")):
        if folder not in sys.path:
            sys.path.insert(0, folder)
    from test_families import FAMILIES

    return [written("a.texture", partial(save_texture, make())) for make in FAMILIES.values()]


def _scenes() -> list[bytes]:
    return [written("a.texture", _planned().save)]


def _container(rng: random.Random, data: bytes) -> bytes:
    """Change values of the header or of an array, and make the checksum right again; or change any bytes."""
    if rng.random() < 0.3:
        return of_bytes(rng, data)
    try:
        return _resealed(rng, *_members(data))
    except Exception:  # what has been spoilt before need not be changed again
        return of_bytes(rng, data)


def _resealed(rng: random.Random, content: dict, arrays: dict[str, np.ndarray]) -> bytes:
    if arrays and rng.random() < 0.5:
        name = rng.choice(sorted(arrays))
        arrays[name] = _changed_array(rng, arrays[name])
    else:
        content["parameters"] = of_tree(rng, content["parameters"])
        if rng.random() < 0.2:
            content = of_tree(rng, content)
    try:
        return to_bytes(Header.model_validate(content), arrays)
    except (ValueError, OverflowError, TypeError):
        return save(arrays, {"texclass": json_of(content).decode("utf-8", "replace")})


def _members(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        with safe_open(file.name, "np") as whole:
            arrays = {name: whole.get_tensor(name) for name in whole.offset_keys()}
            return json.loads(whole.metadata()["texclass"]), arrays


def _changed_array(rng: random.Random, array: np.ndarray) -> np.ndarray:
    changed = array.astype(np.float64) if rng.random() < 0.5 else array.copy()
    for _ in range(rng.choice((1, 1, 2, 5)) if changed.size else 0):
        odd = rng.choice(_ODD) * rng.choice((1, 1, -1, 1.5))
        with np.errstate(all="ignore"):
            changed.flat[rng.randrange(changed.size)] = (
                np.clip(odd, -1e18, 1e18) if array.dtype == int else odd
            )
    if rng.random() < 0.3:
        shape = rng.choice(([0], [1], [changed.size], list(reversed(changed.shape))))
        changed = np.resize(changed, shape)
    return changed


def _texture(path: Path) -> object:
    texture = load_texture(path)
    assert 0 < texture.fs < float("inf")
    describe(path)
    return texture


def _hatts() -> list[bytes]:
    return [written("a.xml", lambda p: write_hatt(_slate(), p))]


def _wavs() -> list[bytes]:
    x = np.sin(np.arange(20.0))
    encodings = "pcm16", "float32", "audible"
    return [written("a.wav", lambda p, e=e: write_wav(p, x, 1000.0, encoding=e)) for e in encodings]


def _wav(path: Path) -> object:
    seeds = read_wav(path)
    assert np.isfinite(seeds.samples).all()
    assert 0 < seeds.fs < float("inf")
    return seeds


def _scene(path: Path) -> object:
    from texclass.haptics.scene import SceneRenderer

    return SceneRenderer(load_scene(path), seed=0).n_contacts


def _libraries() -> list[bytes]:
    return [written("a.texture", lambda p: save_texture(_taps(), p))]


def _taps() -> TapLibrary:
    return TapLibrary(("a", "b"), (TapModel(-100.0, 50.0, 60.0), TapModel(-150.0, 70.0, 200.0)))


def _hjifs() -> list[bytes]:
    sent = play_texture(_slate(), seconds=0.6), play_taps(_taps())
    return [written("a.hjif", lambda p, one=one: write_hjif(one, p)) for one in sent]


def _ahaps() -> list[bytes]:
    sent = play_texture(_slate(), seconds=0.1), play_taps(_taps())
    return [written("a.ahap", lambda p, one=one: write_ahap(one, p)) for one in sent]


def _hjif(path: Path) -> object:
    _played(path, lambda: play_hjif(read_hjif(path), 100.0))
    return _again(path, lambda: to_rendition(read_hjif(path)))


def _ahap(path: Path) -> object:
    return _played(path, lambda: play_ahap(read_ahap(path), 100.0))


def _tree(rng: random.Random, data: bytes) -> bytes:
    return json_of(of_tree(rng, json.loads(data)))


def _again(path: Path, read: Callable[[], Rendition]) -> object:
    """Return a texture fitted to the playback of a file."""
    return _named(path, lambda: to_texture(read()))


def _played(path: Path, play: Callable[[], np.ndarray]) -> object:
    """Return the playback of a file."""
    samples = _named(path, play)
    assert np.isfinite(samples).all()
    return samples


def _named(path: Path, make: Callable[[], Any]) -> Any:
    """Return the object of a file; messages of players get the file name as a prefix."""
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{str(path) * (str(path) not in str(error))}{error}") from error


TARGETS = (
    Target("texture", _families, _texture, _container, "fuzzed.texture"),
    Target("planned scene", _scenes, _scene, _container, "scene.texture"),
    Target("taps", _libraries, load_taps, _container, "taps.texture"),
    Target("HaTT XML", _hatts, read_hatt, either(of_text, of_text, of_bytes), "fuzzed.xml"),
    Target("MPEG haptics", _hjifs, _hjif, either(_tree, _tree, of_text), "fuzzed.hjif"),
    Target("AHAP", _ahaps, _ahap, either(_tree, _tree, of_text), "fuzzed.ahap"),
    Target("rendered WAV", _wavs, _wav, of_bytes, "vibration.wav"),
)
