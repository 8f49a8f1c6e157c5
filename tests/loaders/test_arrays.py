"""Named arrays (NPZ, HDF5, MATLAB): what is stored comes back; what is hostile is not followed."""

import io
import pickle
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io

from texclass.loaders import columns, load_recording
from texclass.recording import RecordingError

SIGNAL = np.random.default_rng(0).normal(size=400)


class Hostile:
    """Unpickling this would create the file it names."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def refused(path, said, **options):
    with pytest.raises(RecordingError, match=said):
        load_recording(path, **{"fs": 500, "unit": "V"} | options)


def test_a_pickle_in_npz_or_named_so_is_refused_and_not_executed(tmp_path):
    victim, path = tmp_path / "executed", tmp_path / "r.npz"
    np.savez(path, acceleration=np.array([Hostile(victim)], dtype=object))
    refused(path, "not a readable NPZ file")
    path.write_bytes(pickle.dumps(Hostile(victim)))
    refused(path, "not a readable NPZ file")
    assert not victim.exists()


def test_more_values_than_the_limit_are_refused_before_they_are_read(tmp_path, monkeypatch):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "r.npz", "w") as archive:
        archive.writestr("acceleration.npy", member.getvalue())
    refused(tmp_path / "r.npz", r"r\.npz: not a readable NPZ file")
    monkeypatch.setattr(columns, "MAX_VALUES", 399)
    np.savez_compressed(tmp_path / "r.npz", acceleration=SIGNAL)
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["acceleration"] = SIGNAL
    for name in ("r.npz", "r.h5"):
        refused(tmp_path / name, r"announces 4\d\d values; the rule is at most 399")


def test_a_dataset_in_a_group_is_found_by_its_path_and_another_is_asked_for(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["run/one/acc"], file["words"], file["fs"] = SIGNAL, "text", 500
    recording = load_recording(tmp_path / "r.h5", unit="V", column="run/one/acc")
    np.testing.assert_array_equal(recording.acceleration, SIGNAL)
    assert recording.fs == 500
    refused(tmp_path / "r.h5", "column 'right' occurs 0 times; its columns are 'run/one/acc'", column="right")


def test_hdf5_that_keeps_its_values_elsewhere_is_not_followed(tmp_path):
    SIGNAL.tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["acceleration"] = SIGNAL
    with h5py.File(tmp_path / "r.h5", "w") as file:
        place = [(str(tmp_path / "secret.bin"), 0, SIGNAL.nbytes)]
        file.create_dataset("acceleration", SIGNAL.shape, SIGNAL.dtype, external=place)
        file["linked"] = h5py.ExternalLink("secret.h5", "/acceleration")
    refused(tmp_path / "r.h5", "kept in another file")
    refused(tmp_path / "r.h5", "occurs 0 times", column="linked")


def test_what_is_not_a_signal_is_refused(tmp_path):
    for array in (np.zeros((5, 4, 3)), SIGNAL + 1j, np.array(["a", "b"])):
        np.savez(tmp_path / "r.npz", acceleration=array)
        refused(tmp_path / "r.npz", "the rule is")
    for variable in ({"a": 1}, np.array([SIGNAL, "x"], dtype=object), SIGNAL + 1j, "text"):
        scipy.io.savemat(tmp_path / "r.mat", {"acc": variable})
        refused(tmp_path / "r.mat", r"occurs 0 times|the rule is real numbers", column="acc")


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
        refused(tmp_path / "r.mat", r"r\.mat")
