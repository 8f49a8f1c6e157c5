"""Arrays (NPZ, HDF5, MATLAB): what is stored comes back; what is hostile is neither followed nor believed."""

import contextlib
import io
import itertools
import pickle
import struct
import tracemalloc
import zipfile
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from fuzz.contract import judge
from fuzz.mutate import archive_of
from fuzz.targets import target_of

from texclass.loaders import load_recording, readers
from texclass.recording import RecordingError

SIGNAL = np.random.default_rng(0).normal(size=400)


class Hostile:
    """Unpickling this would create the file it names."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def assert_refused(path, message, **options):
    with pytest.raises(RecordingError, match=message):
        load_recording(path, **{"fs": 500, "unit": "V"} | options)


def test_a_pickle_in_npz_or_named_so_is_refused_and_not_executed(tmp_path):
    victim, path = tmp_path / "executed", tmp_path / "r.npz"
    np.savez(path, acceleration=np.array([Hostile(victim)], dtype=object))
    assert_refused(path, r"it contains 'acceleration \(object\)'. Expected an array of real numbers")
    np.save(tmp_path / "r.npy", np.array([Hostile(victim)], dtype=object))
    assert_refused(tmp_path / "r.npy", r"it contains 'acceleration \(object\)'")
    for suffix in ("npz", "npy"):
        (tmp_path / f"r.{suffix}").write_bytes(pickle.dumps(Hostile(victim)))
        assert_refused(tmp_path / f"r.{suffix}", rf"not a readable {suffix.upper()} file")
    assert not victim.exists()


def test_more_values_than_the_limit_are_refused_before_they_are_read(tmp_path, monkeypatch):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "r.npz", "w") as archive:
        archive.writestr("acceleration.npy", member.getvalue())
    (tmp_path / "r.npy").write_bytes(member.getvalue())
    for name in ("r.npz", "r.npy"):
        assert_refused(tmp_path / name, rf"{name}: its header announces 1000000000000 values")
    monkeypatch.setattr(readers, "MAX_VALUES", 399)
    np.savez_compressed(tmp_path / "r.npz", acceleration=SIGNAL)
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["acceleration"] = SIGNAL
    np.save(tmp_path / "r.npy", SIGNAL)
    for name in ("r.npz", "r.h5", "r.npy"):
        assert_refused(tmp_path / name, r"announces 4\d\d values. Expected at most 399")


def test_a_dataset_in_a_group_has_its_path_as_name(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["run/one/acc"], file["words"], file["fs"] = SIGNAL, "text", 500
    recording = load_recording(tmp_path / "r.h5", unit="V", column="run/one/acc")
    np.testing.assert_array_equal(recording.acceleration, SIGNAL)
    assert recording.fs == 500
    assert_refused(tmp_path / "r.h5", "no column 'right'; the columns are 'run/one/acc'", column="right")


def test_hdf5_datasets_in_other_files_are_not_read(tmp_path):
    SIGNAL.tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["acceleration"] = SIGNAL
    with h5py.File(tmp_path / "r.h5", "w") as file:
        place = [(str(tmp_path / "secret.bin"), 0, SIGNAL.nbytes)]
        file.create_dataset("acceleration", SIGNAL.shape, SIGNAL.dtype, external=place)
        file["linked"] = h5py.ExternalLink("secret.h5", "/acceleration")
    assert_refused(tmp_path / "r.h5", "stored in another file")
    assert_refused(tmp_path / "r.h5", "no column 'linked'", column="linked")


def test_arrays_that_are_not_signals_are_errors(tmp_path):
    for array in (np.zeros((5, 4, 3)), SIGNAL + 1j, np.array(["a", "b"])):
        np.savez(tmp_path / "r.npz", acceleration=array)
        assert_refused(tmp_path / "r.npz", "Expected")
    for variable in ({"a": 1}, np.array([SIGNAL, "x"], dtype=object), SIGNAL + 1j, "text"):
        scipy.io.savemat(tmp_path / "r.mat", {"acc": variable})
        assert_refused(tmp_path / "r.mat", r"it contains 'acc \(|no column 'acc'", column="acc")


def matlab_73(path, **variables):
    """Write what MATLAB 7.3 writes: HDF5 after a user block, axes reversed, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            stored = file.create_dataset(name, data=np.atleast_2d(value).T)
            stored.attrs["MATLAB_class"] = np.bytes_("char" if value.dtype == np.uint16 else "double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))


def test_matlab_has_vectors_in_version_5_and_time_along_the_first_axis_in_7_3(tmp_path):
    path = tmp_path / "r.mat"
    axes = np.column_stack([SIGNAL, 2 * SIGNAL, 3 * SIGNAL])
    note = np.frombuffer("rough".encode("utf-16-le"), dtype=np.uint16)
    for expected, write in (
        (SIGNAL, lambda: scipy.io.savemat(path, {"acc": SIGNAL[:, None], "fs": 500.0, "note": "rough"})),
        (SIGNAL, lambda: scipy.io.savemat(path, {"acc": SIGNAL[None], "fs": 500.0})),
        (axes, lambda: matlab_73(path, acc=axes, fs=np.array([[500.0]]), note=note)),
    ):
        write()
        recording = load_recording(path, unit="V")
        np.testing.assert_array_equal(recording.acceleration, expected)
        assert recording.fs == 500


def test_an_unreadable_matlab_file_is_refused(tmp_path):
    for content in (b"not matlab", b"MATLAB 5.0 MAT-file".ljust(128, b"\0"), bytes(300)):
        (tmp_path / "r.mat").write_bytes(content)
        assert_refused(tmp_path / "r.mat", r"r\.mat")


@contextlib.contextmanager
def bounded():
    """Refuse more than 100 MB in the meantime."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < 100 << 20
    finally:
        tracemalloc.stop()


def judged(name, data, tmp_path):
    verdict = judge(target_of(name), data, tmp_path)
    return verdict.kind, verdict.detail


def test_files_of_a_few_kilobytes_cannot_announce_gigabytes_but_what_deflate_can_shrink_is_read(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.create_dataset("acceleration", shape=(900_000_000,), chunks=(1 << 20,), dtype="f8")
    pa = pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    pq = pytest.importorskip("pyarrow.parquet")
    repeated = pa.DictionaryArray.from_arrays(pa.array(np.zeros(20_000_000, np.int8)), pa.array([1.5]))
    pq.write_table(pa.table({"acceleration": repeated}), tmp_path / "r.parquet")
    del repeated
    for name, n in (("r.h5", 900_000_000), ("r.parquet", 20_000_000)):
        assert (tmp_path / name).stat().st_size < 100_000
        with bounded():
            assert_refused(
                tmp_path / name, rf"{name}: its header announces {n} values, but the file has \d+ bytes"
            )
    ticks = np.zeros(2_000_000)
    ticks[::1000] = 1.0
    np.savez_compressed(tmp_path / "r.npz", acceleration=ticks)
    assert (tmp_path / "r.npz").stat().st_size < ticks.nbytes / 100
    assert load_recording(tmp_path / "r.npz", fs=100.0, unit="g").n_samples == len(ticks)


def test_a_checksummed_chunk_without_data_does_not_end_the_process(tmp_path):
    path = tmp_path / "r.h5"
    with h5py.File(path, "w", libver="earliest") as file:
        a = file.create_dataset("acceleration", data=np.arange(20.0), chunks=(10,), fletcher32=True)
        key = struct.pack("<II2Q", a.id.get_chunk_info(0).size, 0, 0, 0)
    assert load_recording(path, fs=100.0, unit="g").n_samples == 20
    data = path.read_bytes()
    assert data.count(key) == 1
    path.write_bytes(data.replace(key, bytes(4) + key[4:]))
    assert_refused(path, r"r\.h5: acceleration has a chunk without data")


def write_mat(path, kind, order, compressed, name=b"x"):
    def element(number, data):
        return struct.pack(f"{order}2I", number, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack(f"{order}2I", 6, 0)) + element(5, struct.pack(f"{order}2i", 4, 1))
    matrix = element(14, flags + element(1, name) + element(kind, struct.pack(f"{order}4d", 1, 2, 4, 3)))
    version = struct.pack(f"{order}H", 0x0100) + (b"IM" if order == "<" else b"MI")
    packed = struct.pack(f"{order}2I", 15, len(zlib.compress(matrix))) + zlib.compress(matrix)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + version + (packed if compressed else matrix))


def test_numbers_of_an_unknown_type_do_not_end_the_process(tmp_path):
    path = tmp_path / "r.mat"
    for byte_order, compressed in itertools.product("<>", (False, True)):
        write_mat(path, 9, byte_order, compressed)
        assert load_recording(path, fs=100.0, unit="g").n_samples == 4
        for kind in (0, 8, 14, 20, 41, 256, 4105, 0xFFFF):
            write_mat(path, kind, byte_order, compressed)
            assert_refused(path, rf"r\.mat: .*the numbers of x are of type {kind}")
    write_mat(path, 0, "<", compressed=False, name=b"")  # scipy takes it for what MATLAB keeps for itself
    assert_refused(path, r"r\.mat")


def test_a_rate_that_is_complex_and_a_byte_order_that_scipy_only_guesses_are_refused(tmp_path):
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"acceleration": np.arange(5.0), "fs": 100.0 + 1j})
    assert_refused(path, r"r\.mat: fs is missing", fs=None)
    scipy.io.savemat(path, {"x": np.arange(5.0)}, format="4")
    cray = (4000).to_bytes(4, "little") + path.read_bytes()[4:]
    assert judged("mat", cray, tmp_path)[0] == "refused"


def test_repeated_variables_and_arrays_of_python_2_give_no_warning(tmp_path):
    stored = []
    for variable in ({"acceleration": np.arange(5.0)}, {"fs": 1000.0}):
        scipy.io.savemat(tmp_path / "r.mat", variable)
        stored.append((tmp_path / "r.mat").read_bytes())
    signal, rate = stored
    twice = signal + signal[128:] + rate[128:]  # scipy goes on to the rate, and meets the name again
    assert judged("mat", twice, tmp_path) == ("accepted", "")
    member = io.BytesIO()
    np.lib.format.write_array(member, np.arange(5.0))
    old = member.getvalue().replace(b"(5,), }", b"(5L,),}", 1)
    assert judged("npz", archive_of({"x.npy": old}), tmp_path) == ("accepted", "")


@pytest.mark.skipif(np.finfo(np.longdouble).max == np.finfo(float).max, reason="no wider float here")
def test_a_float_too_large_for_float64_is_refused_without_a_warning(tmp_path):
    member = io.BytesIO()
    np.save(member, np.array([1, 2, np.finfo(np.longdouble).max], dtype=np.longdouble))
    assert judged("npz", archive_of({"x.npy": member.getvalue()}), tmp_path)[0] == "refused"


def test_groups_that_are_nested_too_deep_are_refused_at_once(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        group = file
        for _ in range(31):
            group = group.create_group("g")
        group["x"] = np.arange(50.0)
    assert load_recording(tmp_path / "r.h5", fs=1000, unit="counts").n_samples == 50
    with h5py.File(tmp_path / "r.h5", "a") as file:
        file.create_group("h/" * 32)
    with pytest.raises(RecordingError, match=r"group at nesting level 33 .*at most 32 levels and 10000"):
        load_recording(tmp_path / "r.h5", fs=1000, unit="counts")
