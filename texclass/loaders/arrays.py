"""Named arrays: NPZ and HDF5 (MATLAB 7.3 files are HDF5 files, too).

A scalar named `fs` (in HDF5 also an attribute of the file) states the sampling rate in Hz. Objects are never
opened: an NPZ member that needs unpickling and an HDF5 dataset that is kept outside the file are refused.
"""

import warnings
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from texclass.loaders.columns import Columns, ReadOptions, as_samples, check_held, require
from texclass.recording import RecordingError

RATE = "fs"
CHECKSUM = 4
"""Bytes of a checksum of HDF5; where a chunk has no more, the library (2.0 and before) ends the process."""


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the arrays.

    Raises
    ------
    RecordingError
        If the file is not what its suffix says.
    """
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as archive:
                found = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
        else:
            with h5py.File(path) as file:
                found = _numeric_datasets(file)
    except Exception as error:  # damaged headers make numpy and h5py raise almost anything
        raise _unreadable(path, error) from error
    return tuple(name for name in found if name != RATE)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read the wanted arrays, and the sampling rate if it is stored.

    Raises
    ------
    RecordingError
        If the file is unreadable, an array is missing, or does not hold real numbers.
    """
    require(wanted, names(path, options), path)
    reader = _read_npz if path.suffix.lower() == ".npz" else _read_hdf5
    try:
        stored, fs = reader(path, wanted)
    except RecordingError:
        raise
    except Exception as error:  # damaged headers make numpy and h5py raise almost anything
        raise _unreadable(path, error) from error
    return Columns({name: as_samples(stored[name], name, path) for name in wanted}, fs)


def _read_npz(path: Path, wanted: tuple[str, ...]) -> tuple[dict[str, Any], float | None]:
    with zipfile.ZipFile(path) as archive:
        for name in {*wanted, RATE} & {member.removesuffix(".npy") for member in archive.namelist()}:
            check_held(archive.getinfo(f"{name}.npy").file_size // 8, path)
    with warnings.catch_warnings(), path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        warnings.simplefilter("ignore", UserWarning)  # of headers that Python 2 wrote
        rate = archive[RATE] if RATE in archive.files else None
        return {name: archive[name] for name in wanted}, _scalar(rate)


def _read_hdf5(path: Path, wanted: tuple[str, ...]) -> tuple[dict[str, Any], float | None]:
    with h5py.File(path) as file:
        stored = {name: _inside(file, name, path) for name in wanted}
        rate = file[RATE] if isinstance(file.get(RATE, getlink=True), h5py.HardLink) else file.attrs.get(RATE)
        return stored, _scalar(rate[()] if isinstance(rate, h5py.Dataset) and rate.size == 1 else rate)


def _numeric_datasets(file: h5py.File) -> list[str]:
    found: list[str] = []

    def visit(name: str, node: Any) -> None:
        is_numeric = isinstance(node, h5py.Dataset) and node.dtype.kind in "iuf"
        if is_numeric and not name.startswith("#") and node.attrs.get("MATLAB_class") != b"char":
            found.append(name)

    file.visititems(visit)
    return found


def _inside(file: h5py.File, name: str, path: Path) -> Any:
    """Return the values of a dataset whose bytes are in this file."""
    dataset = file[name]
    if dataset.external or dataset.is_virtual:
        raise RecordingError(f"{path}: {name} is kept in another file; the rule is one file")
    check_held(dataset.size, path)
    if dataset.fletcher32 and dataset.id.chunk_iter(lambda chunk: chunk.size <= CHECKSUM or None):
        raise RecordingError(f"{path}: {name} has a chunk without data; the rule is more than its checksum")
    # h5py converts piece by piece: stored floats of 4 bytes never stand in memory beside those of 8.
    return dataset.astype(np.float64)[()] if dataset.dtype.kind in "iuf" else dataset[()]


def _scalar(rate: Any) -> float | None:
    rate = np.asarray(rate) if rate is not None else None
    return float(rate.item()) if rate is not None and rate.size == 1 and rate.dtype.kind in "iuf" else None


def _unreadable(path: Path, error: Exception) -> RecordingError:
    kind = {".npz": "NPZ", ".mat": "MATLAB 7.3"}.get(path.suffix.lower(), "HDF5")
    return RecordingError(f"{path}: not a readable {kind} file ({error})")
