import base64
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from texclass.exchange import Rendition, read_gltf, write_gltf
from texclass.exchange.gltf import WIDEST


def sent(n=500, **more):
    x = 3 * np.sin(np.arange(n) / 7)
    lost = {"speed": "fixed", "force": "fixed"}
    return Rendition("cloth", "m/s^2", 1000.0, x, 80.0, 1.5, friction=0.4, lost=lost, **more)


def test_a_material_comes_back_within_a_step(tmp_path):
    lost = write_gltf(sent(), tmp_path / "a.gltf")
    found = read_gltf(tmp_path / "a.gltf")
    assert (found.name, found.unit, found.speed, found.force) == ("cloth", "m/s^2", 80.0, 1.5)
    assert_allclose(found.fs, 1000.0)
    assert_allclose(found.samples, sent().samples, atol=3.0 / 255 + 1e-6)
    assert_allclose(found.friction, 0.4, atol=1 / 255)
    assert "follow the speed" in lost["speed"]
    assert abs(float(lost["level"].split()[0])) < 0.05


def test_every_index_and_length_of_the_file_leads_somewhere(tmp_path):
    write_gltf(sent(), tmp_path / "a.gltf")
    file = json.loads((tmp_path / "a.gltf").read_text())
    assert file["extensionsUsed"] == ["MPEG_haptic_material"]
    assert file["meshes"][0]["extensions"]["MPEG_haptic_material"] == {"hapticMaterialIndex": 0}
    data = base64.b64decode(file["buffers"][0]["uri"].split(",")[1])
    assert len(data) == file["buffers"][0]["byteLength"] == sum(v["byteLength"] for v in file["bufferViews"])
    corners = np.frombuffer(data[:48], dtype="<f4").reshape(4, 3)
    assert_allclose(corners.max(axis=0), file["accessors"][0]["max"], rtol=1e-6)
    assert np.frombuffer(data[80:], dtype="<u2").max() == 3


def test_what_is_too_long_is_cut_and_told_and_taps_have_no_place(tmp_path):
    lost = write_gltf(sent(n=WIDEST + 10), tmp_path / "a.gltf")
    assert lost["length"].startswith(f"{WIDEST} of {WIDEST + 10}")
    assert read_gltf(tmp_path / "a.gltf").samples.size == WIDEST
    with pytest.raises(ValueError, match="no taps"):
        write_gltf(sent(taps=np.ones((1, 3))), tmp_path / "b.gltf")
