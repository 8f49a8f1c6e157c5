"""Read arrays: WAV and FLAC, NPY and NPZ, HDF5, MATLAB to 7.2 and 7.3 (HDF5 inside).

A scalar with a name such as `fs` or `SampleRate` (in HDF5 also an attribute) states the sampling rate in Hz
of the arrays in its group or struct. Objects are never opened: an array that needs unpickling, a MATLAB cell
and an HDF5 dataset that is kept outside the file are not read. Integer audio does not state its unit: with
`options.codes` its codes are kept, -32768 ... 32767 for 16 bit; else full scale is 1. Floating-point audio is
kept as stored.
"""

import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
import soundfile
from scipy import io as scipy_io

from texclass.loaders import matlab
from texclass.loaders.columns import (
    UNNAMED,
    ReadOptions,
    ReadSignals,
    as_samples,
    check_held,
    readable,
    refused,
    require,
)
from texclass.loaders.contents import Contents, is_rate
from texclass.loaders.matlab import MOST_MEMBERS, MOST_NESTED, NUMERIC

AUDIO = (".wav", ".flac")
KINDS = {**dict.fromkeys(AUDIO, "audio"), ".npy": "NPY", ".npz": "NPZ", ".mat": "MATLAB"}
"""What to call a file, by its suffix; HDF5 has two."""
CODE_BITS = {"PCM_S8": 8, "PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32}
"""Bits of a code, by libsndfile's name of the encoding; libsndfile aligns codes to the top of 32 bit."""
NUMBERS, TEXT = "numbers", "char"
"""Classes of datasets of HDF5: of real numbers, and of texts, which nobody expects to be read."""
_STREAMED = 0xFFFFFFFF
"""Size that a RIFF file announces which was written to a pipe."""
_CHECKSUM = 4
"""Bytes of a checksum of HDF5; where a chunk has no more, the library (2.0 and before) ends the process."""
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""Readers of the header of an NPY file by its version; version 3 is for records."""

Stored = tuple[dict[str, Any], float | None]
"""Arrays by name, and the sampling rate if it is stated."""


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the arrays; all channels of audio have one name.

    Raises
    ------
    RecordingError
        If the file is not what its suffix says, or contains no array of real numbers.
    """
    return (UNNAMED,) if path.suffix.lower() in AUDIO else _contents(path).signals


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted arrays, and the sampling rate if it is stored.

    Raises
    ------
    RecordingError
        If the file is unreadable or shorter than its header says, an array is missing, or does not hold real
        numbers.
    """
    kind = KINDS.get(path.suffix.lower(), "HDF5")
    if kind == "audio":
        require(wanted, (UNNAMED,), path)
        with readable(path, kind):
            stored, fs = _read_audio(path, codes=options.codes)
            return ReadSignals({name: as_samples(stored[name], name, path) for name in wanted}, fs)
    contents = _contents(path)
    require(
        wanted, contents.signals, path, hint=f"; {contents.unread} cannot be read" * bool(contents.others)
    )
    for name in wanted:
        check_held(contents.sizes[name], path)
    fs, stated_by = contents.rate_of(wanted, path, options.fs)
    flags: tuple[str, ...] = (
        (f"time: fs is {fs:g} Hz, as {stated_by!r} in the file states",) if fs is not None else ()
    )
    if objects := {name: one for name, one in contents.others.items() if one != TEXT}:
        flags += (f"ignored: {Contents(others=objects).unread}",)
    with readable(path, kind):
        stored = _values(path, wanted)
        return ReadSignals({name: as_samples(stored[name], name, path) for name in wanted}, fs, flags)


def _contents(path: Path) -> Contents:
    kind = KINDS.get(path.suffix.lower(), "HDF5")
    with readable(path, kind):
        if kind in {"NPY", "NPZ"}:
            found = _npy_contents(path)
        elif kind == "MATLAB" and not h5py.is_hdf5(path):
            found = _matlab_contents(path)
        else:
            found = _hdf5_contents(path)
    if not found.signals:
        raise refused(path, f"it contains {found.unread}", "an array of real numbers")
    return found


def _values(path: Path, wanted: tuple[str, ...]) -> dict[str, Any]:
    """Return the wanted arrays of a file that contains them."""
    if path.suffix.lower() in {".npy", ".npz"}:
        members = _npy_members(path)
        return {n: np.lib.format.read_array(file, allow_pickle=False) for n, file in members if n in wanted}
    if path.suffix.lower() == ".mat" and not h5py.is_hdf5(path):
        if _is_matlab_5(path):
            return {v.name: v.values() for v in matlab.variables(path) if v.name in wanted}
        with _strictly():
            return dict(scipy_io.loadmat(str(path), variable_names=wanted))
    with h5py.File(path) as file:
        return {
            n: _inside(node, n, path) for n, node, _ in _hdf5_nodes(file, path, _mark(path)) if n in wanted
        }


def _read_audio(path: Path, *, codes: bool) -> Stored:
    with path.open("rb") as raw:
        head = raw.read(8)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little")
    if head[:4] == b"RIFF" and announced != _STREAMED and announced + 8 > size:
        # libsndfile would read it without a word.
        raise refused(path, f"holds {size} of {announced + 8} bytes that its header announces", "all")
    with soundfile.SoundFile(path) as file:
        check_held(file.frames * file.channels, path)
        bits = CODE_BITS.get(file.subtype) if codes else None
        samples = file.read(dtype="int32" if bits else "float64")
        frames, fs = file.frames, float(file.samplerate)
    if len(samples) < frames:
        raise refused(path, f"holds {len(samples)} of {frames} frames that its header announces", "all")
    return {UNNAMED: np.right_shift(samples, 32 - bits, out=samples) if bits else samples}, fs


def _npy_members(path: Path) -> Iterator[tuple[str, IO[bytes]]]:
    """Yield the name and the open file of every array."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of headers that Python 2 wrote
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                yield UNNAMED, file
            return
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                if member.filename.endswith(".npy"):
                    check_held(member.file_size // 8, path)
                    with archive.open(member) as file:
                        yield member.filename.removesuffix(".npy"), file


def _npy_contents(path: Path) -> Contents:
    found = Contents()
    for name, file in _npy_members(path):
        read_header = _HEADERS.get(np.lib.format.read_magic(file))
        shape, _, kind = read_header(file) if read_header else ((), False, np.dtype(object))
        if kind.kind not in "iuf":
            found.others[name] = TEXT if kind.kind in "US" else kind.name
            continue
        found.sizes[name] = math.prod(shape)
        if found.sizes[name] == 1 and is_rate(name):
            found.rates[name] = float(np.frombuffer(file.read(kind.itemsize), kind)[0])
    return found


def _hdf5_contents(path: Path) -> Contents:
    found = Contents(_mark(path))
    with h5py.File(path) as file:
        for name, node, kind in _hdf5_nodes(file, path, found.mark):
            for attribute in filter(is_rate, node.attrs):
                value = np.asarray(node.attrs[attribute])
                if value.size == 1 and value.dtype.kind in "iuf":
                    found.rates[f"{name}{found.mark * bool(name)}{attribute}"] = float(value.item())
            if kind == NUMBERS:
                found.sizes[name] = node.size
                if node.size == 1 and is_rate(name):
                    found.rates[name] = float(_inside(node, name, path).item())
            elif kind:
                found.others[name] = kind
    return found


def _mark(path: Path) -> str:
    """Return what stands between the names of a group and its member."""
    return "." if path.suffix.lower() == ".mat" else "/"


def _hdf5_nodes(
    group: h5py.Group, path: Path, mark: str, prefix: str = "", depth: int = 1
) -> Iterator[tuple[str, Any, str]]:
    """Yield groups and datasets by name, with the class of what a dataset contains; no link is followed."""
    if depth > MOST_NESTED or len(group) > MOST_MEMBERS:
        found = f"has groups {depth} deep, one with {len(group)} members"
        raise refused(path, found, f"at most {MOST_NESTED} and {MOST_MEMBERS}")
    yield prefix.removesuffix(mark), group, ""
    for name in group:
        is_matlab_own = name.startswith("#")  # what cells and objects refer to
        if is_matlab_own or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        node = group[name]
        stated = node.attrs.get("MATLAB_class", b"")
        matlab_class = stated.decode("latin1") if isinstance(stated, bytes) else str(stated)
        if isinstance(node, h5py.Dataset):
            yield prefix + name, node, _hdf5_class(node, matlab_class)
        elif isinstance(node, h5py.Group) and matlab_class in {"", "struct"}:
            yield from _hdf5_nodes(node, path, mark, f"{prefix}{name}{mark}", depth + 1)
        elif isinstance(node, h5py.Group):
            yield prefix + name, node, "sparse" if "MATLAB_sparse" in node.attrs else matlab_class


def _hdf5_class(dataset: h5py.Dataset, matlab_class: str) -> str:
    if matlab_class and matlab_class not in NUMERIC:
        return matlab_class
    if "MATLAB_empty" in dataset.attrs:
        return "empty"
    if dataset.dtype.kind in "iuf":
        return NUMBERS
    return TEXT if h5py.check_string_dtype(dataset.dtype) else str(dataset.dtype.name)


def _inside(dataset: h5py.Dataset, name: str, path: Path) -> Any:
    """Return the values of a dataset whose bytes are in this file."""
    if dataset.external or dataset.is_virtual:
        raise refused(path, f"{name} is kept in another file", "one file")
    check_held(dataset.size, path)
    if dataset.fletcher32 and dataset.id.chunk_iter(lambda chunk: chunk.size <= _CHECKSUM or None):
        raise refused(path, f"{name} has a chunk without data", "more than its checksum")
    # h5py converts piece by piece: stored floats of 4 bytes never stand in memory beside those of 8.
    return dataset.astype(np.float64)[()]


def _matlab_contents(path: Path) -> Contents:
    found = Contents(_mark(path))
    if _is_matlab_5(path):
        for variable in matlab.variables(path):
            if not variable.is_signal:
                found.others[variable.name] = variable.matlab_class
                continue
            found.sizes[variable.name] = math.prod(variable.shape)
            if found.sizes[variable.name] == 1 and is_rate(variable.name):
                found.rates[variable.name] = float(variable.values().item())
        return found
    with _strictly():
        for name, shape, kind in scipy_io.whosmat(str(path)):
            if kind in NUMERIC:
                found.sizes[name] = math.prod(map(int, shape))
            else:
                found.others[name] = kind
        rates = [name for name, size in found.sizes.items() if size == 1 and is_rate(name)]
        stored = scipy_io.loadmat(str(path), variable_names=rates) if rates else {}
    found.rates = {name: float(stored[name].item()) for name in rates if stored[name].dtype.kind in "iuf"}
    return found


def _is_matlab_5(path: Path) -> bool:
    """Whether a file is of the versions 5 to 7.2, and not 4."""
    return bool(scipy_io.matlab.matfile_version(str(path))[0] == 1)


@contextmanager
def _strictly() -> Iterator[None]:
    """Turn what scipy warns of (guessed byte orders, overflows) into errors, but for repeated names."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        yield
