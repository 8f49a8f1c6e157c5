"""MATLAB files: arrays beside objects and in structs are read; a stored sampling rate is honoured."""

import struct
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from texclass.loaders import load_recording
from texclass.loaders.matlab import matlab_5_arrays
from texclass.recording import RecordingError

SIGNAL = np.random.default_rng(0).normal(size=400)
AXES = np.random.default_rng(1).normal(size=(400, 3))


def element(kind, data):
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def matlab_object(name, matlab_class):
    """Return a variable as MATLAB stores a datetime or a table: name, type system, class, reference."""
    flags = element(6, struct.pack("<2I", 17, 0))
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", matlab_class))
    dimensions = element(5, struct.pack("<2i", 6, 1))
    reference = element(6, struct.pack("<2I", 13, 0)) + dimensions + element(1, b"") + element(6, bytes(24))
    return element(14, flags + texts + element(14, reference))


def write_mat(path, objects=(), *, compressed=False, **stored):
    """Write variables with scipy, and objects of MATLAB before them."""
    scipy.io.savemat(path, stored, do_compression=compressed)
    content = path.read_bytes()
    front = [matlab_object(*one) for one in objects]
    if compressed:
        front = [struct.pack("<2I", 15, len(zlib.compress(one))) + zlib.compress(one) for one in front]
    path.write_bytes(content[:128] + b"".join(front) + content[128:])


@pytest.mark.parametrize("compressed", [False, True])
def test_objects_of_matlab_do_not_hide_other_variables(tmp_path, compressed):
    objects = [("t", "datetime"), ("tt", "timetable"), ("T", "table"), ("d", "duration"), ("s", "string")]
    path = tmp_path / "r.mat"
    write_mat(path, objects, compressed=compressed, acc=AXES, Fs=500.0, note="oak")
    recording = load_recording(path, unit="V")
    np.testing.assert_array_equal(recording.acceleration, AXES)
    assert recording.fs == 500
    object_list = "'t (datetime)', 'tt (timetable)', 'T (table)', 'd (duration)', 's (string)'"
    assert recording.flags == ("time: fs is 500 Hz, from 'Fs' in the file", f"ignored: {object_list}")
    with pytest.raises(RecordingError, match=r"no column 'T'.*'T \(table\)'.*cannot be read"):
        load_recording(path, unit="V", column="T")
    write_mat(path, objects[:1], compressed=compressed, note="oak")
    with pytest.raises(RecordingError, match=r"contains 't \(datetime\)', 'note \(char\)'.*real numbers"):
        load_recording(path, unit="V")


def test_function_handles_and_objects_of_matlab_7_3_do_not_hide_other_variables(tmp_path):
    path = tmp_path / "r.mat"
    with h5py.File(path, "w", userblock_size=512) as file:

        def stored(name, value, matlab_class, group=file):
            group.create_dataset(name, data=value).attrs["MATLAB_class"] = np.bytes_(matlab_class)

        stored("t", np.zeros((1, 6), np.uint32), "datetime")
        stored("T", np.zeros((1, 6), np.uint32), "table")
        stored("flag", np.ones((1, 6), np.uint8), "logical")
        handle = file.create_group("f")
        handle.attrs["MATLAB_class"] = np.bytes_("function_handle")
        stored("workspace", np.zeros(5), "double", handle)
        data = file.create_group("data")
        data.attrs["MATLAB_class"] = np.bytes_("struct")
        stored("acc", AXES.T, "double", data)
        stored("SampleRate", [[500.0]], "double", data)
        file.create_group("#refs#").create_dataset("a", data=SIGNAL)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    for column in (None, "data.acc"):
        recording = load_recording(path, unit="V", column=column)
        np.testing.assert_array_equal(recording.acceleration, AXES)
        assert recording.fs == 500
        assert "'t (datetime)'" in recording.flags[1]
        assert "'f (function_handle)'" in recording.flags[1]


@pytest.mark.parametrize("compressed", [False, True])
def test_structs_are_walked_and_arrays_of_structs_are_not(tmp_path, compressed):
    path = tmp_path / "r.mat"
    inner = {"acc": AXES, "t": np.arange(400) / 500, "who": "me"}
    several = np.zeros(2, dtype=[("acc", "O")])
    several["acc"] = [SIGNAL, SIGNAL]
    scipy.io.savemat(path, {"data": {"run": inner}, "several": several}, do_compression=compressed)
    for column in (None, "data.run.acc"):
        recording = load_recording(path, unit="V", column=column)
        np.testing.assert_allclose(recording.acceleration, AXES, atol=1e-12)
        assert recording.fs == pytest.approx(500)
    one = np.zeros((1, 1), dtype=[("acc", "O")])
    one["acc"][0, 0] = SIGNAL
    scipy.io.savemat(path, {"data": one}, do_compression=compressed)
    assert load_recording(path, fs=500, unit="V", column="data.acc").n_samples == 400


RATES = ["fs", "Fs", "FS", "SampleRate", "sampling_rate", "samplerate", "Fs_Hz", "sample frequency (Hz)"]


@pytest.mark.parametrize("name", RATES)
def test_a_stored_rate_is_honoured_reported_and_compared_with_the_given_one(tmp_path, name):
    paths = [tmp_path / f"r.{suffix}" for suffix in ("npz", "h5", "hdf5")]
    np.savez(paths[0], acceleration=SIGNAL, **{name: 500})
    with h5py.File(paths[1], "w") as file:
        file["acceleration"], file[name] = SIGNAL, [500.0]
    with h5py.File(paths[2], "w") as file:
        file["acceleration"] = SIGNAL
        file["acceleration"].attrs[name] = 500
    if name.isidentifier():
        paths.append(tmp_path / "r.mat")
        scipy.io.savemat(paths[-1], {"data": {"acc": SIGNAL, name: 500.0}})
        paths.append(tmp_path / "r4.mat")
        scipy.io.savemat(paths[-1], {"acc": SIGNAL, name: 500.0}, format="4")
    for path in paths:
        recording = load_recording(path, unit="V")
        assert recording.fs == 500
        assert name in recording.flags[0]
        assert recording.flags[0].startswith("time: fs is 500 Hz")
        assert load_recording(path, unit="V", fs=500).fs == 500
        with pytest.raises(RecordingError, match="fs is 500 Hz, but 400 Hz was given"):
            load_recording(path, unit="V", fs=400)


def test_a_rate_belongs_to_the_arrays_beside_it_and_that_of_metadata_to_all(tmp_path):
    path = tmp_path / "r.mat"
    audio = {"x": SIGNAL[:100], "Fs": 44100.0}
    scipy.io.savemat(path, {"acc": SIGNAL, "audio": audio, "meta": {"SampleRate": 500.0}})
    assert load_recording(path, unit="V", column="acc").fs == 500
    assert load_recording(path, unit="V", column="audio.x").fs == 44100
    scipy.io.savemat(path, {"acc": SIGNAL, "fs": 500.0, "SampleRate": 600.0})
    with pytest.raises(RecordingError, match="several sampling rates: fs = 500, SampleRate = 600"):
        load_recording(path, unit="V")
    assert load_recording(path, unit="V", fs=600).fs == 600
    scipy.io.savemat(path, {"acc": SIGNAL, "Fs_kHz": 0.5, "fsr": 4.0})
    with pytest.raises(RecordingError, match="fs is missing"):
        load_recording(path, unit="V")


def test_files_that_matlab_wrote_are_read_as_by_scipy():
    """MATLAB 5.3 to 8 on Solaris, Windows and Linux wrote the files that scipy is tested with."""
    folder = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
    if not folder.is_dir():
        pytest.skip("this scipy has no test data")
    n_read = 0
    for name in (
        "testdouble",
        "testmatrix",
        "testminus",
        "teststruct",
        "testmulti",
        "test3dmatrix",
        "little",
    ):
        for path in folder.glob(f"{name}*.mat"):
            if scipy.io.matlab.matfile_version(str(path))[0] == 1:
                stored = scipy.io.loadmat(path)
                for variable in (array for array in matlab_5_arrays(path) if not array.kind):
                    first, *fields = variable.name.split(".")
                    expected = stored[first]
                    for field in fields:
                        expected = expected[field][0, 0]
                    np.testing.assert_array_equal(variable.values(), expected)
                    n_read += 1
    assert n_read > 20


def test_a_damaged_compressed_variable_is_refused(tmp_path):
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"acc": SIGNAL}, do_compression=True)
    content = bytearray(path.read_bytes())
    content[-2] ^= 0xFF  # in the checksum
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"r\.mat: not a readable MATLAB file"):
        load_recording(path, fs=500, unit="V")


def test_an_npy_file_has_time_along_the_longer_axis(tmp_path):
    path = tmp_path / "r.npy"
    for stored, expected in ((SIGNAL, SIGNAL), (AXES, AXES), (AXES.T, AXES), (AXES.astype(">f4"), AXES)):
        np.save(path, stored)
        loaded = load_recording(path, fs=500, unit="V").acceleration
        np.testing.assert_allclose(loaded, expected, rtol=1e-6)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(RecordingError, match=r"r\.npy: not a readable NPY file"):
        load_recording(path, fs=500, unit="V")
