"""Recordings, tables, models and scenes in files that once escaped the documented error, or its bounds."""

import contextlib
import io
import itertools
import json
import struct
import tracemalloc
import warnings
import zlib

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from fuzz.contract import judge
from fuzz.mutate import archive_of
from fuzz.targets import target_of

from texclass.experiment.feature_table import read_part, read_table
from texclass.loaders import CardError, load_recording
from texclass.recording import RecordingError

MOST_BYTES = 100 << 20


def _kind(name, data, tmp_path):
    verdict = judge(target_of(name), data, tmp_path)
    return verdict.kind, verdict.detail


@contextlib.contextmanager
def _bounded():
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()


def test_an_hdf5_file_of_a_few_kilobytes_cannot_announce_gigabytes(tmp_path):
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("acceleration", shape=(900_000_000,), chunks=(1 << 20,), dtype="f8")
    with _bounded(), pytest.raises(RecordingError, match=r"r\.h5: announces 900000000 values in \d+ bytes"):
        load_recording(path, fs=100.0, unit="g")


def test_a_checksummed_chunk_without_data_does_not_end_the_process(tmp_path):
    path = tmp_path / "r.h5"
    with h5py.File(path, "w", libver="earliest") as file:
        a = file.create_dataset("acceleration", data=np.arange(20.0), chunks=(10,), fletcher32=True)
        key = struct.pack("<II2Q", a.id.get_chunk_info(0).size, 0, 0, 0)
    assert load_recording(path, fs=100.0, unit="g").n_samples == 20
    data = path.read_bytes()
    assert data.count(key) == 1
    path.write_bytes(data.replace(key, bytes(4) + key[4:]))
    with pytest.raises(RecordingError, match=r"r\.h5: acceleration has a chunk without data"):
        load_recording(path, fs=100.0, unit="g")


def test_a_parquet_file_of_a_few_kilobytes_cannot_announce_gigabytes(tmp_path):
    path = tmp_path / "r.parquet"
    repeated = pa.DictionaryArray.from_arrays(pa.array(np.zeros(20_000_000, np.int8)), pa.array([1.5]))
    pq.write_table(pa.table({"acceleration": repeated}), path)
    del repeated
    assert path.stat().st_size < 100_000
    with _bounded(), pytest.raises(RecordingError, match=r"r\.parquet: announces 20000000 values in"):
        load_recording(path, fs=100.0, unit="g")


def test_what_deflate_can_shrink_is_still_read(tmp_path):
    path = tmp_path / "r.npz"
    a = np.zeros(2_000_000)
    a[::1000] = 1.0
    np.savez_compressed(path, acceleration=a)
    assert path.stat().st_size < a.nbytes / 100
    assert load_recording(path, fs=100.0, unit="g").n_samples == len(a)


def test_a_complex_rate_is_no_rate(tmp_path):
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"acceleration": np.arange(5.0), "fs": 100.0 + 1j})
    with pytest.raises(RecordingError, match=r"r\.mat: not a readable MATLAB file"):
        load_recording(path, unit="g")


def test_numbers_of_an_unknown_type_do_not_end_the_process(tmp_path):
    path = tmp_path / "r.mat"
    for byte_order, compressed in itertools.product("<>", (False, True)):
        _write_mat(path, 9, byte_order, compressed)
        assert load_recording(path, fs=100.0, unit="g").n_samples == 4
        for kind in (0, 8, 14, 20, 41, 256, 4105, 0xFFFF):
            _write_mat(path, kind, byte_order, compressed)
            with pytest.raises(RecordingError, match=rf"r\.mat: .*the numbers of x are of type {kind}"):
                load_recording(path, fs=100.0, unit="g")


def test_an_array_without_a_name_is_no_variable(tmp_path):
    """Scipy reads it as what MATLAB keeps for itself, and a type that is none ends the process."""
    path = tmp_path / "r.mat"
    _write_mat(path, 0, "<", compressed=False, name=b"")
    with pytest.raises(RecordingError, match=r"r\.mat"):
        load_recording(path, fs=100.0, unit="g")


def _write_mat(path, kind, order, compressed, name=b"x"):
    def element(number, data):
        return struct.pack(f"{order}2I", number, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack(f"{order}2I", 6, 0)) + element(5, struct.pack(f"{order}2i", 4, 1))
    matrix = element(14, flags + element(1, name) + element(kind, struct.pack(f"{order}4d", 1, 2, 4, 3)))
    version = struct.pack(f"{order}H", 0x0100) + (b"IM" if order == "<" else b"MI")
    packed = struct.pack(f"{order}2I", 15, len(zlib.compress(matrix))) + zlib.compress(matrix)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + version + (packed if compressed else matrix))


def test_a_byte_order_that_scipy_only_guesses_is_refused(tmp_path):
    file = io.BytesIO()
    scipy.io.savemat(file, {"x": np.arange(5.0)}, format="4")
    cray = (4000).to_bytes(4, "little") + file.getvalue()[4:]
    assert _kind("matlab 4 and 5", cray, tmp_path)[0] == "refused"


def test_two_variables_of_a_name_warn_of_nothing(tmp_path):
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"acceleration": np.arange(5.0)})
    data = path.read_bytes()
    path.write_bytes(data + data[128:])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_recording(path, fs=100.0, unit="g").n_samples == 5


def test_an_array_that_python_2_wrote_warns_of_nothing(tmp_path):
    member = io.BytesIO()
    np.lib.format.write_array(member, np.arange(5.0))
    old = member.getvalue().replace(b"(5,), }", b"(5L,),}", 1)
    assert _kind("npz", archive_of({"x.npy": old}), tmp_path) == ("accepted", "")


@pytest.mark.skipif(np.finfo(np.longdouble).max == np.finfo(float).max, reason="no wider float here")
def test_a_float_too_large_for_float64_is_refused_without_a_warning(tmp_path):
    member = io.BytesIO()
    np.save(member, np.array([1, 2, np.finfo(np.longdouble).max], dtype=np.longdouble))
    assert _kind("npz", archive_of({"x.npy": member.getvalue()}), tmp_path)[0] == "refused"


def test_a_row_with_a_number_beyond_floats_is_refused(tmp_path):
    data = b"label,0,1\noak,1,2\nfelt," + b"9" * 400 + b",3\n"
    assert _kind("table of rows", data, tmp_path)[0] == "refused"


def test_a_label_that_is_not_there_is_refused_and_its_row_is_named(tmp_path):
    for line in (b"r2", b"r2,felt", b"r2,felt,1,more"):
        assert _kind("table of labels", b"id,what,run\nr1,oak,1\n" + line + b"\n", tmp_path)[0] == "refused"
    (tmp_path / "labels.csv").write_bytes(b"id,what,run\nr1,oak,1\nr2\n")
    with pytest.raises(CardError, match=r"labels\.csv: row 2 has other cells than the header"):
        target_of("table of labels").read(tmp_path / "labels.csv")


def _facts(path, **changes):
    arrow = pq.read_table(path)
    metadata = dict(arrow.schema.metadata)
    metadata[b"texclass"] = json.dumps(json.loads(metadata[b"texclass"]) | changes).encode()
    pq.write_table(arrow.replace_schema_metadata(metadata), path)


@pytest.mark.parametrize(
    "changes",
    [{"columns": 5}, {"columns": ["absent"]}, {"columns": ["material"]}, {"ms": ["x", "y"]}, {"ms": [1.0]},
     {"reasons": [["too", "few"]]}, {"flags": 1}, {"left_out": None}, {"key": []}],
)  # fmt: skip
def test_a_feature_table_whose_facts_do_not_fit_it_is_refused(changes, tmp_path):
    path = tmp_path / "t.parquet"
    path.write_bytes(target_of("feature table").seeds()[0])
    assert read_table(path).n_recordings == 2
    _facts(path, **changes)
    with pytest.raises(ValueError, match=r"t\.parquet: not a feature table of texclass"):
        read_table(path)


def test_columns_that_pandas_is_told_to_rename_are_refused(tmp_path):
    path = tmp_path / "t.parquet"
    path.write_bytes(target_of("feature table").seeds()[0])
    arrow = pq.read_table(path)
    facts = json.loads(arrow.schema.metadata[b"pandas"])
    facts["columns"][3] |= {"name": "mfcc.c1", "field_name": "session"}
    facts["columns"][3]["pandas_type"] = "unicode"
    renamed = json.dumps(facts).replace('"name": "session"', '"name": "mfcc.c1"')
    pq.write_table(arrow.replace_schema_metadata({**arrow.schema.metadata, b"pandas": renamed}), path)
    with pytest.raises(ValueError, match=r"t\.parquet: .*the rule is those of the schema"):
        read_table(path)


@pytest.mark.parametrize(
    "row",
    [{"features": None}, {"features": [1.0]}, {"features": ["a", "b"]}, {"reasons": "["}, {"reasons": [[1]]},
     {"flags": 5}, {"ms": None}, {"ms": "x"}, {"ms": float("inf")}],
)  # fmt: skip
def test_a_damaged_part_of_an_extraction_says_what_to_do(row, tmp_path):
    path = tmp_path / "p.json"
    whole = {"features": [1.0, float("nan")], "reasons": [["mfcc", "short"]], "flags": [], "ms": 1.0}
    path.write_text(json.dumps([whole]))
    assert read_part(path, 2)[0].ms == 1.0
    path.write_text(json.dumps([whole | row]))
    with pytest.raises(ValueError, match=r"p\.json: is damaged.*delete it"):
        read_part(path, 2)
