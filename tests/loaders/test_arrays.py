import io
import pickle
import zipfile

import h5py
import numpy as np
import pytest

from texclass.loaders import columns, load_recording
from texclass.recording import RecordingError

SIGNAL = np.random.default_rng(0).normal(size=400)


class Hostile:
    """Unpickling this would create the file it names."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def test_a_pickle_inside_npz_is_refused_and_not_executed(tmp_path):
    victim = tmp_path / "executed"
    np.savez(tmp_path / "r.npz", acceleration=np.array([Hostile(victim)], dtype=object))
    with pytest.raises(RecordingError, match="not a readable NPZ file"):
        load_recording(tmp_path / "r.npz", fs=500, unit="V")
    assert not victim.exists()


def test_a_bare_pickle_named_npz_is_refused_and_not_executed(tmp_path):
    victim = tmp_path / "executed"
    (tmp_path / "r.npz").write_bytes(pickle.dumps(Hostile(victim)))
    with pytest.raises(RecordingError, match="not a readable NPZ file"):
        load_recording(tmp_path / "r.npz", fs=500, unit="V")
    assert not victim.exists()


def test_an_npz_header_that_announces_terabytes_is_refused(tmp_path):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "r.npz", "w") as archive:
        archive.writestr("acceleration.npy", member.getvalue())
    with pytest.raises(RecordingError, match=r"r\.npz"):
        load_recording(tmp_path / "r.npz", fs=500, unit="V")


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_more_values_than_the_limit_are_refused_before_they_are_read(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(columns, "MAX_VALUES", 399)
    path = tmp_path / f"r{suffix}"
    if suffix == ".npz":
        np.savez_compressed(path, acceleration=SIGNAL)
    else:
        with h5py.File(path, "w") as file:
            file["acceleration"] = SIGNAL
    with pytest.raises(RecordingError, match=r"announces 4\d\d values; the rule is at most 399"):
        load_recording(path, fs=500, unit="V")


def test_a_dataset_in_a_group_is_found_by_its_path(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["run/one/acc"] = SIGNAL
        file["fs"] = 500
    recording = load_recording(tmp_path / "r.h5", unit="V", column="run/one/acc")
    np.testing.assert_array_equal(recording.acceleration, SIGNAL)
    assert recording.fs == 500


def test_hdf5_without_the_named_dataset_lists_what_there_is(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["left"] = SIGNAL
        file["words"] = "text"
    with pytest.raises(RecordingError, match="column 'right' occurs 0 times; its columns are 'left'"):
        load_recording(tmp_path / "r.h5", fs=500, unit="V", column="right")


def test_hdf5_that_keeps_its_values_elsewhere_is_refused(tmp_path):
    SIGNAL.tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        place = [(str(tmp_path / "secret.bin"), 0, SIGNAL.nbytes)]
        file.create_dataset("acceleration", SIGNAL.shape, SIGNAL.dtype, external=place)
    with pytest.raises(RecordingError, match="kept in another file"):
        load_recording(tmp_path / "r.h5", fs=500, unit="V")


def test_a_link_to_another_hdf5_file_is_not_followed(tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["acceleration"] = SIGNAL
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["acceleration"] = h5py.ExternalLink("secret.h5", "/acceleration")
    with pytest.raises(RecordingError, match="occurs 0 times"):
        load_recording(tmp_path / "r.h5", fs=500, unit="V", column="acceleration")


@pytest.mark.parametrize("array", [np.zeros((5, 4, 3)), SIGNAL + 1j, np.array(["a", "b"])])
def test_what_is_not_a_signal_is_refused(tmp_path, array):
    np.savez(tmp_path / "r.npz", acceleration=array)
    with pytest.raises(RecordingError, match="the rule is"):
        load_recording(tmp_path / "r.npz", fs=500, unit="V")
