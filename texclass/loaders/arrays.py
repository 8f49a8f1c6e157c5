"""Read arrays: WAV and FLAC, NPZ, HDF5, MATLAB 5 (by scipy) and 7.3 (HDF5 inside).

A scalar named `fs` (in HDF5 also an attribute of the file) states the sampling rate in Hz. Objects are never
opened: an NPZ member that needs unpickling, a MATLAB cell and an HDF5 dataset that is kept outside the file
are refused. Integer audio says nothing of its unit: with `options.codes` its codes are kept, -32768 ... 32767
for 16 bit; else full scale is 1. Floating-point audio is kept as stored.
"""

import math
import struct
import warnings
import zipfile
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import soundfile
from scipy import io as scipy_io

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

KINDS = {".wav": "audio", ".flac": "audio", ".npz": "NPZ", ".mat": "MATLAB"}
"""What to call a file, by its suffix; HDF5 has two."""
RATE = "fs"
CODE_BITS = {"PCM_S8": 8, "PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32}
"""Bits of a code, by libsndfile's name of the encoding; libsndfile aligns codes to the top of 32 bit."""
NUMERIC = ("double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
"""Classes of MATLAB variables that are read; a cell, a struct or an object is not opened."""
MOST_NESTED, MOST_MEMBERS = 32, 10_000
"""Groups of HDF5 within each other, and members of one: the library takes long for more."""
_STREAMED = 0xFFFFFFFF
"""Size that a RIFF file announces which was written to a pipe."""
_CHECKSUM = 4
"""Bytes of a checksum of HDF5; where a chunk has no more, the library (2.0 and before) ends the process."""

Stored = tuple[dict[str, Any], float | None]
"""Arrays by name, and the sampling rate if it is stated."""


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the arrays; all channels of audio have one name.

    Raises
    ------
    RecordingError
        If the file is not what its suffix says.
    """
    if path.suffix.lower() in (".wav", ".flac"):
        return (UNNAMED,)
    found: list[str] = []
    with readable(path, KINDS.get(path.suffix.lower(), "HDF5")):
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as archive:
                found = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
        elif h5py.is_hdf5(path) or path.suffix.lower() != ".mat":
            with h5py.File(path) as file:
                found = [name for name, node in _datasets(file, path) if _is_numeric(node)]
        else:
            found = list(_matlab_sizes(path))
    return tuple(name for name in found if name != RATE)


def _datasets(group: h5py.Group, path: Path, prefix: str = "", depth: int = 1) -> Iterator[tuple[str, Any]]:
    """Yield the datasets in a group and in those within it, by name; links are not followed."""
    if depth > MOST_NESTED or len(group) > MOST_MEMBERS:
        found = f"has groups {depth} deep, one with {len(group)} members"
        raise refused(path, found, f"at most {MOST_NESTED} and {MOST_MEMBERS}")
    for name in group:
        is_matlab_own = name.startswith("#")  # what cells and objects refer to
        if is_matlab_own or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        node = group[name]
        if isinstance(node, h5py.Group):
            yield from _datasets(node, path, f"{prefix}{name}/", depth + 1)
        elif isinstance(node, h5py.Dataset):
            yield prefix + name, node


def _is_numeric(node: h5py.Dataset) -> bool:
    is_matlab_text = node.attrs.get("MATLAB_class") == b"char"
    return node.dtype.kind in "iuf" and not is_matlab_text


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted arrays, and the sampling rate if it is stored.

    Raises
    ------
    RecordingError
        If the file is unreadable or shorter than its header says, an array is missing, or does not hold real
        numbers.
    """
    require(wanted, names(path, options), path)
    with readable(path, KINDS.get(path.suffix.lower(), "HDF5")):
        if path.suffix.lower() in (".wav", ".flac"):
            stored, fs = _read_audio(path, codes=options.codes)
        elif path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as members:
                for name in {*wanted, RATE} & {member.removesuffix(".npy") for member in members.namelist()}:
                    check_held(members.getinfo(f"{name}.npy").file_size // 8, path)
            with (
                warnings.catch_warnings(),
                path.open("rb") as raw,
                np.load(raw, allow_pickle=False) as archive,
            ):
                warnings.simplefilter("ignore", UserWarning)  # of headers that Python 2 wrote
                fs = _scalar(archive[RATE] if RATE in archive.files else None)
                stored = {name: archive[name] for name in wanted}
        elif h5py.is_hdf5(path) or path.suffix.lower() != ".mat":
            with h5py.File(path) as file:
                stored = {name: _inside(file, name, path) for name in wanted}
                is_here = isinstance(file.get(RATE, getlink=True), h5py.HardLink)
                rate = file[RATE] if is_here else file.attrs.get(RATE)
                fs = _scalar(rate[()] if isinstance(rate, h5py.Dataset) and rate.size == 1 else rate)
        else:
            stored, fs = _read_matlab(path, wanted)
        return ReadSignals({name: as_samples(stored[name], name, path) for name in wanted}, fs)


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


def _inside(file: h5py.File, name: str, path: Path) -> Any:
    """Return the values of a dataset whose bytes are in this file."""
    dataset = file[name]
    if dataset.external or dataset.is_virtual:
        raise refused(path, f"{name} is kept in another file", "one file")
    check_held(dataset.size, path)
    if dataset.fletcher32 and dataset.id.chunk_iter(lambda chunk: chunk.size <= _CHECKSUM or None):
        raise refused(path, f"{name} has a chunk without data", "more than its checksum")
    # h5py converts piece by piece: stored floats of 4 bytes never stand in memory beside those of 8.
    return dataset.astype(np.float64)[()] if dataset.dtype.kind in "iuf" else dataset[()]


def _scalar(rate: Any) -> float | None:
    rate = np.asarray(rate) if rate is not None else None
    return float(rate.item()) if rate is not None and rate.size == 1 and rate.dtype.kind in "iuf" else None


def _read_matlab(path: Path, wanted: tuple[str, ...]) -> Stored:
    sizes = _matlab_sizes(path)
    for name in wanted:
        check_held(sizes[name], path)
    rate = (RATE,) if sizes.get(RATE) == 1 else ()
    with _strictly():
        if scipy_io.matlab.matfile_version(str(path))[0] == 1:
            _check_matlab_tags(path, {*wanted, *rate})
        stored: dict[str, Any] = scipy_io.loadmat(str(path), variable_names=[*wanted, *rate])
    return stored, float(stored[RATE].item()) if rate else None


def _matlab_sizes(path: Path) -> dict[str, int]:
    """Return name -> number of values of every numeric variable, without reading the values."""
    with _strictly():
        described = scipy_io.whosmat(str(path))
    # What scipy names itself (an array without a name is its "function workspace") is no recording.
    return {
        name: math.prod(map(int, shape))
        for name, shape, matlab_class in described
        if matlab_class in NUMERIC and not name.startswith("__")
    }


@contextmanager
def _strictly() -> Iterator[None]:
    """Turn what scipy warns of (guessed byte orders, overflows) into errors, but for repeated names."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        yield


# scipy (1.17 and before) takes the type of an array's numbers for an index into a table of its own, in
# compiled code that does not check it: one changed byte ends the process. So the tags are looked at first.
# Elements are laid out as in MathWorks, "MAT-File Format", level 5: a tag of type and size, or of both in
# four bytes, and data padded to eight.
_LONGEST_HEAD = 4096
"""Bytes of flags, dimensions and name of an array; they take some hundred."""
_NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13))
"""Types of numbers: integers of 8 to 64 bits, single, double."""
_MATRIX, _COMPRESSED, _OPAQUE = 14, 15, 17
_CLASSES = range(6, 16)
"""Classes of arrays of numbers: double, single, integers."""


def _check_matlab_tags(path: Path, wanted: Collection[str]) -> None:
    """Check all arrays of the wanted names, as far as scipy goes through the file.

    Raises
    ------
    ValueError
        If one is not of real numbers of a known type.
    zlib.error
        If a compressed one is damaged.
    """
    with path.open("rb") as file:
        file.seek(126)
        order = "<" if file.read(2) == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}2I", tag)
            after = file.tell() + size
            head = file.read(_LONGEST_HEAD)
            if kind == _COMPRESSED:
                head = zlib.decompressobj().decompress(head, _LONGEST_HEAD)
                (kind,) = struct.unpack_from(f"{order}I", head.ljust(4, b"\0"))
                head = head[8:]
            if kind != _MATRIX:
                return  # scipy refuses it
            head = head.ljust(_LONGEST_HEAD, b"\0")
            (flags,) = struct.unpack_from(f"{order}I", head, 8)
            file.seek(after)
            if flags & 0xFF == _OPAQUE:
                continue  # bears no name
            _, _, at = _matlab_element(head, order, 16)
            _, name, at = _matlab_element(head, order, at)
            shown = name.decode("latin1")
            if shown not in wanted:
                continue
            if flags & 0xFF not in _CLASSES or flags >> 11 & 1:
                raise ValueError(f"{shown} is another array; the rule is real numbers")
            kind, _, _ = _matlab_element(head, order, at)
            if kind not in _NUMBERS:
                raise ValueError(
                    f"the numbers of {shown} are of type {kind}; the rule is one of {sorted(_NUMBERS)}"
                )


def _matlab_element(head: bytes, order: str, at: int) -> tuple[int, bytes, int]:
    """Return type and data of an element, and where the next one begins."""
    if at + 8 > len(head):
        raise ValueError(f"the head of an array is longer than {_LONGEST_HEAD} bytes")
    first, size = struct.unpack_from(f"{order}2I", head, at)
    if first >> 16:
        return first & 0xFFFF, head[at + 4 : at + 4 + (first >> 16)], at + 8
    return first, head[at + 8 : at + 8 + size], at + 8 + size + -size % 8
