"""Model files: damaged, changed and unsafe files are refused with one line."""

import io
import json
import pickle
import struct
import zipfile

import numpy as np
import pytest
import skops.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from skops.io._protocol import PROTOCOL
from toy_models import model_of
from toy_surfaces import pipeline, surfaces

from texclass.evaluation.pipeline import Use
from texclass.evaluation.skops_archive import ALLOWED_CLASSES, UnsafeFileError, check_archive, load_archive
from texclass.recognition import ModelFileError, load_model, read_manifest_of, train
from texclass.recognition.model_files import FORMAT, read_manifest, read_model_file, write_model_file


@pytest.fixture(scope="module")
def file(linear_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "surface.skops"
    linear_model.save(path)
    return path


@pytest.fixture(scope="module")
def skops_file(tmp_path_factory):
    """Return the file of a model with a step that has no array form."""
    path = tmp_path_factory.mktemp("models") / "surface.skops"
    model_of([SimpleImputer(), PCA(3)], LinearDiscriminantAnalysis()).save(path)
    return path


def members_of(file):
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewritten(file, change, *, sign=True):
    """Return the path of a model file with changed members and, with `sign`, an updated digest."""
    from texclass.recognition.model_files import digest_of

    members = change(members_of(file))
    if sign:
        values = json.loads(members.pop("manifest.json"))
        values.pop("digest", None)
        values["digest"] = digest_of(values, members)
        members["manifest.json"] = json.dumps(values).encode()
    path = file.with_name("changed.skops")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def edited(name, old, new):
    def change(members):
        assert old in members[name]
        return {**members, name: members[name].replace(old, new, 1)}

    return change


def test_the_manifest_is_read_without_loading_the_model(file, linear_model, monkeypatch):
    monkeypatch.setattr(skops.io, "loads", None)
    assert read_manifest_of(file) == linear_model.manifest


def test_truncated_files_are_refused(file, tmp_path):
    data = file.read_bytes()
    cut = tmp_path / "cut.skops"
    for n in (0, 10, len(data) // 2, len(data) - 1):
        cut.write_bytes(data[:n])
        with pytest.raises(ModelFileError, match=r"cut\.skops: it is truncated or not an archive"):
            load_model(cut)


def of_format(version):
    def change(members):
        values = json.loads(members["manifest.json"]) | {"format_version": version}
        return {**members, "manifest.json": json.dumps(values).encode()}

    return change


def one_array_more(members):
    return {**members, "9999999.npy": next(v for k, v in members.items() if k.endswith(".npy"))}


OTHER_FORMAT = r"its format is {}, written by texclass \S+\. Expected format 7: train the model again"


@pytest.mark.parametrize(
    ("change", "sign", "message"),
    [
        (edited("manifest.json", b"cork", b"corn"), False, "it was changed since it was written"),
        (one_array_more, False, "it was changed since it was written"),
        (of_format(FORMAT + 1), True, OTHER_FORMAT.format(FORMAT + 1)),
        (of_format([2, 4]), True, OTHER_FORMAT.format(r"\[2, 4\]")),
        (
            lambda members: {**members, "../evil.py": b"import os"},
            True,
            r"it contains '\.\./evil\.py'. Expected a schema and arrays only",
        ),
    ],
)
def test_a_file_with_changes_another_format_or_other_members_is_refused(file, change, sign, message):
    with pytest.raises(ModelFileError, match=rf"changed\.skops: .*{message}"):
        load_model(rewritten(file, change, sign=sign))


def test_a_file_contains_either_arrays_or_skops(file, skops_file):
    arrays, archive = members_of(file), members_of(skops_file)
    assert "arrays.json" in arrays
    assert "schema.json" not in arrays
    assert "schema.json" in archive
    assert "arrays.json" not in archive
    assert load_model(skops_file).estimators == ("PCA",)
    for change in (
        lambda members: {**members, "schema.json": archive["schema.json"]},
        lambda members: {name: data for name, data in members.items() if name != "arrays.json"},
    ):
        with pytest.raises(ModelFileError, match=r"it must contain either arrays\.json or schema\.json"):
            load_model(rewritten(file, change))


def test_a_class_that_is_not_on_the_allow_list_is_not_loaded(skops_file):
    popen = edited("schema.json", b'"PCA"', b'"Popen"')
    with pytest.raises(ModelFileError, match=r"it contains sklearn\.decomposition\._pca\.Popen. Expected"):
        load_model(rewritten(skops_file, popen))


@pytest.mark.parametrize(
    "content",
    [
        b"{",
        b"[]",
        b'{"steps": {"array": "none.npy"}}',
        b"[" * 100_000,
        b'{"plan": "[]"}',
        b'{"plan": "[]", "channels": [], "classifier": {"operation": "__import__", "name": "os"}}',
    ],
)
def test_arrays_that_cannot_be_read_are_refused(file, content):
    with pytest.raises(ModelFileError, match=r"changed\.skops: "):
        load_model(rewritten(file, lambda members: {**members, "arrays.json": content}))


def test_an_invalid_manifest_is_refused(linear_model):
    values = json.loads(linear_model.manifest.to_json())
    assert read_manifest(json.dumps(values)) == linear_model.manifest
    for text in (
        b"{",
        b"[]",
        b'{"format_version": "1.0"}',
        b'{"format_version": 7}',
        b"[" * 100_000,
        b"\xff",
    ):
        with pytest.raises(ValueError, match=r"its (manifest|format)"):
            read_manifest(text)
    for change, message in (
        ({"fs": -1.0}, "fs is -1.0. Expected"),
        ({"surfaces": "oak"}, "surfaces is 'oak'. Expected"),
        ({"color": 1}, "unknown key color"),
        ({"input": {**values["input"], "phases": "all"}}, "phases is 'all'. Expected"),
    ):
        with pytest.raises(ValueError, match=f"its manifest: .*{message}"):
            read_manifest(json.dumps(values | change))


@pytest.mark.parametrize("name", ["texclass.recognition.model.Model", "texclass.cli.app.main", "os.system"])
def test_modules_are_not_on_the_allow_list_as_a_whole(name):
    assert name not in ALLOWED_CLASSES
    module, _, inner = name.rpartition(".")
    node = {"__class__": inner, "__module__": module, "__loader__": "FunctionNode", "__id__": 1}
    schema = {**node, "protocol": PROTOCOL, "_skops_version": skops.__version__}
    with pytest.raises(UnsafeFileError, match=f"it contains {name}"):
        load_archive(archive_of({"schema.json": json.dumps(schema)}))


def test_pickles_are_never_read(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was read",))

    (tmp_path / "p.skops").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(ModelFileError, match="not an archive"):
        load_model(tmp_path / "p.skops")
    array = io.BytesIO()
    np.save(array, np.array([Bomb()], dtype=object), allow_pickle=True)
    with pytest.raises(UnsafeFileError, match="Expected a complete array of numbers"):
        check_archive(archive_of({"schema.json": b"{}", "1.npy": array.getvalue()}))


def archive_of(members, compression=zipfile.ZIP_STORED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def test_decompression_bombs_are_refused():
    packed = archive_of({"schema.json": b" " * 10**7}, zipfile.ZIP_DEFLATED)
    with pytest.raises(UnsafeFileError, match=r"schema\.json is compressed"):
        check_archive(packed)
    with pytest.raises(UnsafeFileError, match=r"16777217 bytes. Expected at most"):
        check_archive(archive_of({"schema.json": b" " * ((1 << 24) + 1)}))
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(array, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with pytest.raises(
        UnsafeFileError, match=r"should contain \(1000000000000,\) of float64, but has 0 bytes"
    ):
        check_archive(archive_of({"schema.json": b"{}", "1.npy": array.getvalue()}))


def test_members_that_overlap_are_refused():
    data = bytearray(archive_of({"schema.json": b"{}", "1.npy": b"x" * 200}))
    first = data.index(b"PK\x01\x02")  # the directory states that the second member is larger than the file
    second = data.index(b"PK\x01\x02", first + 1)
    data[second + 20 : second + 28] = struct.pack("<II", 10**6, 10**6)
    with pytest.raises(UnsafeFileError, match="overlap"):
        check_archive(bytes(data))


def test_inconsistent_entries_are_refused(tmp_path, file):
    document, manifest = read_model_file(file)
    for key, value, message in (
        ("calibration", {"beta": 1.0}, "lapse"),
        ("ranges", {name: np.zeros(2) for name in ("low", "median", "high")}, "shapes"),
        (
            "probe",
            {"values": np.zeros(13), "probabilities": np.full(4, 0.25)},
            "other probabilities",
        ),
        ("novelty", {**document["novelty"], "kind": "guess"}, "got 'guess'"),
        ("classifier", {"operation": "estimator", "estimator": {}, "is_averaged": False}, "no attribute"),
        ("classifier", {"operation": "eval"}, "eval"),
    ):
        write_model_file(tmp_path / "odd.skops", {**document, key: value}, manifest, is_arrays=True)
        with pytest.raises(ModelFileError, match=rf"odd\.skops: not a model of texclass \(.*{message}"):
            load_model(tmp_path / "odd.skops")


def test_changed_values_of_features_give_a_warning(file, monkeypatch):
    monkeypatch.setattr("texclass.features.plan.code_hash", lambda feature_set: "other")
    load_model(file)  # other code with the same values gives no warning
    monkeypatch.setattr("texclass.recognition.model_files.GOLDEN", 0.6)
    with pytest.warns(UserWarning, match=r"features differ from those at training \(mfcc\.c"):
        load_model(file)


def test_a_classifier_that_cannot_be_loaded_safely_is_not_trained():
    forest = {"forest": Use(use="sklearn.ensemble.RandomForestClassifier", n_estimators=5, random_state=0)}
    with pytest.raises(ValueError, match=r"contains sklearn\.tree\._tree\.Tree, which is not on"):
        train(surfaces(), pipeline(classifiers=forest), row="Spectrum")
    both = pipeline(classifiers={**forest, **pipeline().classifiers})
    assert train(surfaces(), both, row="Spectrum").estimators == ()


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_refused_or_changes_nothing(file, linear_model, place, bit):
    data = bytearray(file.read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    damaged = file.with_name("damaged.skops")
    damaged.write_bytes(data)
    try:
        manifest = read_manifest_of(damaged)
    except ModelFileError:
        return
    assert manifest == linear_model.manifest
