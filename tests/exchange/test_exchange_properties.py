"""Files changed at random: read, or a ValueError that names them; never a crash, a hang or much memory."""

import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from texclass.exchange import load_texture, read_hatt, read_wav, save_texture, write_hatt, write_wav
from texclass.textures.hatt import HattTexture, Mesh

DRAWN = int(os.environ.get("TEXCLASS_EXAMPLES", "0"))
MOST_BYTES = 16 << 20
"""Of memory while a small file is read."""

edits = st.lists(
    st.tuples(
        st.sampled_from(["set", "cut", "insert", "double", "swap"]),
        st.floats(0, 1, exclude_max=True),
        st.binary(min_size=1, max_size=12),
    ),
    min_size=1,
    max_size=5,
)


def _settings(n):
    suppressed = [HealthCheck.function_scoped_fixture]
    return settings(
        max_examples=DRAWN or n, deadline=None, derandomize=not DRAWN, suppress_health_check=suppressed
    )


def edited(data, changes):
    for kind, place, new in changes:
        i = int(place * len(data))
        j = min(i + len(new), len(data))
        tail = {
            "set": new + data[j:],
            "cut": data[j:],
            "insert": new + data[i:],
            "double": data[i:] + data[i:],
            "swap": data[j:] + data[i:j],
        }
        data = data[:i] + tail[kind]
    return data


def holds(read, path):
    tracemalloc.start()
    try:
        read(path)
        said = str(path)
    except ValueError as error:
        said = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert str(path) in said
    assert peak < MOST_BYTES


class Files(dict):
    """Bytes by suffix; what hypothesis prints of them is short."""

    def __repr__(self):
        return "files"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    mesh = Mesh(np.array([0.0, 90.0, 0.0]), np.array([0.0, 0.0, 3.0]), np.array([[0, 1, 2]]))
    slate = HattTexture(mesh, [[0.5, 1.0, 2.0]] * 3, [[1.5]] * 3, [0.1] * 3, [2.0] * 3, 1000.0, "slate")
    folder = tmp_path_factory.mktemp("whole")
    save_texture(slate, folder / "a.texture")
    write_hatt(slate, folder / "a.xml")
    write_wav(folder / "a.wav", np.sin(np.arange(200.0)), 1000.0, encoding="pcm16")
    return Files({path.suffix: path.read_bytes() for path in folder.iterdir()})


READERS = {".texture": load_texture, ".xml": read_hatt, ".wav": read_wav}


@pytest.mark.parametrize("suffix", READERS)
@_settings(60)
@given(changes=edits)
def test_changed_files(files, tmp_path, suffix, changes):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(edited(files[suffix], changes))
    holds(READERS[suffix], path)


leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5)
)
values = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
)
keys = ["parameters", "parameters/fs", "parameters/name", "parameters/mesh", "fs", "family", "name", "unit"]
keys += ["version", "texclass", "order", "operations", "sha256"]


@_settings(60)
@given(key=st.sampled_from(keys), value=values)
def test_headers_of_any_content_with_a_right_checksum(files, forge, tmp_path, key, value):
    path = tmp_path / "a.texture"
    path.write_bytes(files[".texture"])
    holds(load_texture, forge(path, {key: value}))


NUMBERS = st.sampled_from(
    ["0", "-1", "nan", "1e308", "-1e308", "1e-308", "3.2", "", "999999", "x" * 50, "1_0", "٣"]
)


@_settings(60)
@given(place=st.floats(0, 1, exclude_max=True), number=NUMBERS)
def test_xml_with_any_number_changed(files, tmp_path, place, number):
    parts = files[".xml"].decode().split("<value>")
    i = 1 + int(place * (len(parts) - 1))
    parts[i] = number + parts[i][parts[i].index("<") :]
    path = tmp_path / "a.xml"
    path.write_text("<value>".join(parts), encoding="utf-8")
    holds(read_hatt, path)
