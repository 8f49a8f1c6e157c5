import h5py
import numpy as np
import pytest
import scipy.io

from texclass.loaders import load_recording
from texclass.recording import RecordingError

SIGNAL = np.random.default_rng(0).normal(size=400)


def matlab_73(path, **variables):
    """Write what MATLAB 7.3 writes: HDF5 after a user block, axes reversed, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            stored = file.create_dataset(name, data=np.atleast_2d(value).T)
            stored.attrs["MATLAB_class"] = np.bytes_("char" if value.dtype == np.uint16 else "double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))
    return path


@pytest.mark.parametrize("shape", [(400, 1), (1, 400)])
def test_a_vector_of_version_5_is_one_channel(tmp_path, shape):
    scipy.io.savemat(tmp_path / "r.mat", {"acc": SIGNAL.reshape(shape), "fs": 500.0, "note": "rough"})
    recording = load_recording(tmp_path / "r.mat", unit="V")
    np.testing.assert_array_equal(recording.acceleration, SIGNAL)
    assert recording.fs == 500


def test_a_matrix_of_version_7_3_has_time_along_its_first_axis(tmp_path):
    axes = np.column_stack([SIGNAL, 2 * SIGNAL, 3 * SIGNAL])
    note = np.frombuffer("rough".encode("utf-16-le"), dtype=np.uint16)
    path = matlab_73(tmp_path / "r.mat", acc=axes, fs=np.array([[500.0]]), note=note)
    recording = load_recording(path, unit="V")
    np.testing.assert_array_equal(recording.acceleration, axes)
    assert recording.fs == 500


@pytest.mark.parametrize("variable", [{"a": 1}, np.array([SIGNAL, "x"], dtype=object), SIGNAL + 1j, "text"])
def test_what_is_not_real_numbers_is_refused(tmp_path, variable):
    scipy.io.savemat(tmp_path / "r.mat", {"acc": variable})
    with pytest.raises(RecordingError, match=r"occurs 0 times|the rule is real numbers"):
        load_recording(tmp_path / "r.mat", fs=500, unit="V", column="acc")


@pytest.mark.parametrize("content", [b"not matlab", b"MATLAB 5.0 MAT-file".ljust(128, b"\0"), bytes(300)])
def test_an_unreadable_file_is_refused(tmp_path, content):
    (tmp_path / "r.mat").write_bytes(content)
    with pytest.raises(RecordingError, match=r"r\.mat"):
        load_recording(tmp_path / "r.mat", fs=500, unit="V")
