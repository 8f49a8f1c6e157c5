"""Read arrays from NPY, NPZ, HDF5 and MATLAB files (versions 4 to 7.3).

A scalar with a name such as `fs` or `SampleRate` (in HDF5 also an attribute) is the sampling rate in Hz of
the arrays in its group or struct. Arrays that need unpickling, MATLAB cells and objects, and HDF5 datasets
stored in another file are not read.
"""

import math
import re
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from scipy import io as scipy_io

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.matlab import MAX_DEPTH, MAX_MEMBERS, NUMERIC, StoredArray, matlab_5_arrays
from texclass.loaders.readers import (
    FORMATS,
    ReaderSettings,
    ReadSignals,
    as_samples,
    check_announced_size,
    quote_names,
    reader_error,
    require_columns,
    wrap_library_errors,
)

_TEXT = "char"
"""Class of text arrays; they are ignored, and no flag reports them."""


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the arrays.

    Raises
    ------
    RecordingError
        If the file does not have the format of its suffix, or contains no array of real numbers.
    """
    return _signals(*_contents(path)[:2])


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read arrays, and the sampling rate if it is stored.

    Raises
    ------
    RecordingError
        If the file is unreadable or truncated, or an array is missing or does not contain real numbers.
    """
    sizes, rates, others = _contents(path)
    signals = _signals(sizes, rates)
    require_columns(wanted, signals, path, hint=f"; {_describe_others(others)} cannot be read" * bool(others))
    for name in wanted:
        check_announced_size(sizes[name], path)
    names_of_rates, signal_rates = dict[str, None](), dict[str, float]()
    for signal in wanted:
        stored_rates = _rates_of(signal, signals, rates, _separator(path))
        if len(set(stored_rates.values())) > 1 and settings.fs not in stored_rates.values():
            rate_list = ", ".join(f"{name} = {rate:g}" for name, rate in stored_rates.items())
            raise reader_error(
                path, f"it contains several sampling rates: {rate_list}", "one rate; pass --fs to select one"
            )
        names_of_fs = (name for name, rate in stored_rates.items() if rate == settings.fs)
        if rate_name := next(names_of_fs, next(iter(stored_rates), None)):
            names_of_rates[rate_name], signal_rates[signal] = None, stored_rates[rate_name]
    fs = next(iter(signal_rates.values())) if len(set(signal_rates.values())) == 1 else None
    flags = [f"time: fs is {rates[name]:g} Hz, from {name!r} in the file" for name in names_of_rates]
    if objects := {name: kind for name, kind in others.items() if kind != _TEXT}:
        flags.append(f"ignored: {_describe_others(objects)}")
    with wrap_library_errors(path, _kind(path)):
        arrays = (array for array in _arrays(path) if not array.is_attribute)
        values = {array.name: array.values() for array in arrays if array.name in wanted}
        samples = {name: as_samples(values[name], name, path) for name in wanted}
    return ReadSignals(samples, fs, tuple(flags), rates=signal_rates)


def is_rate(name: str) -> bool:
    """Return whether a name denotes a sampling rate, such as "Fs" or "data.sampling_rate"."""
    plain = re.sub(r"[\s_()\[\]-]", "", re.split(r"[./]", name)[-1].lower()).removesuffix("hz")
    return re.fullmatch("fs|sr|srate|sampl(e|ing)(rate|freq|frequency)", plain) is not None


def _kind(path: Path) -> str:
    return FORMATS[path.suffix.lower()].name


def _contents(path: Path) -> tuple[dict[str, int], dict[str, float], dict[str, str]]:
    """Return the sizes of arrays, the sampling rates in Hz, and the classes of all other objects, by name."""
    sizes, rates, others = dict[str, int](), dict[str, float](), dict[str, str]()
    with wrap_library_errors(path, _kind(path)):
        for array in _arrays(path):
            if array.is_attribute or (not array.kind and array.size == 1 and is_rate(array.name)):
                value = np.asarray(array.values())
                if value.size == 1 and value.dtype.kind in "iuf":
                    rates[array.name] = float(value.item())
            if array.kind:
                others[array.name] = array.kind
            elif not array.is_attribute:
                sizes[array.name] = array.size
    if not _signals(sizes, rates):
        raise reader_error(path, f"it contains {_describe_others(others)}", "an array of real numbers")
    return sizes, rates, others


def _signals(sizes: Mapping[str, int], rates: Mapping[str, float]) -> tuple[str, ...]:
    """Return the names of the arrays, or of scalars if there are no larger arrays."""
    arrays = tuple(name for name, size in sizes.items() if size > 1)
    return arrays or tuple(name for name in sizes if name not in rates)


def _describe_others(others: Mapping[str, str]) -> str:
    return quote_names([f"{name} ({kind})" for name, kind in others.items()])


def _rates_of(
    signal: str, signals: tuple[str, ...], rates: Mapping[str, float], separator: str
) -> dict[str, float]:
    """Return the sampling rates in Hz of an array, by name of the scalar that contains the rate.

    A scalar is the rate of the arrays in its group, or in the nearest enclosing group that contains arrays.
    """

    def is_in(name: str, scope: str) -> bool:
        return not scope or f"{name}{separator}".startswith(f"{scope}{separator}")

    scopes = {}
    for name in rates:
        scope = name.rpartition(separator)[0]
        while not any(is_in(other, scope) for other in signals):
            scope = scope.rpartition(separator)[0]
        scopes[name] = scope
    nearest = max((scope for scope in scopes.values() if is_in(signal, scope)), key=len, default=None)
    return {name: rates[name] for name, scope in scopes.items() if scope == nearest}


def _separator(path: Path) -> str:
    """Return the separator between the name of a group and the name of its member."""
    return "." if path.suffix.lower() == ".mat" else "/"


def _arrays(path: Path) -> Iterator[StoredArray]:
    """Yield the arrays of a file; read the values of an array before requesting the next one."""
    if path.suffix.lower() in {".npy", ".npz"}:
        yield from _npy_arrays(path)
    elif path.suffix.lower() != ".mat" or h5py.is_hdf5(path):
        with h5py.File(path) as file:
            yield from _hdf5_arrays(file, path, _separator(path))
    elif scipy_io.matlab.matfile_version(str(path))[0] == 1:  # 5 to 7.2
        yield from matlab_5_arrays(path)
    else:
        yield from _matlab_4_arrays(path)


def _npy_arrays(path: Path) -> Iterator[StoredArray]:
    headers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    for name, file in _npy_members(path):
        read_header = headers.get(np.lib.format.read_magic(file))  # version 3 is only used for records
        shape, _, dtype = read_header(file) if read_header else ((), False, np.dtype(object))
        other = _TEXT if dtype.kind in "US" else dtype.name
        file.seek(0)
        values = partial(np.lib.format.read_array, file, allow_pickle=False)
        yield StoredArray(name, "" if dtype.kind in "iuf" else other, math.prod(shape), values)


def _npy_members(path: Path) -> Iterator[tuple[str, IO[bytes]]]:
    """Yield the name and the open file of every array."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about headers written by Python 2
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                yield ACCELERATION, file
            return
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                if member.filename.endswith(".npy"):
                    check_announced_size(member.file_size // 8, path)
                    with archive.open(member) as file:
                        yield member.filename.removesuffix(".npy"), file


def _hdf5_arrays(
    group: h5py.Group, path: Path, separator: str, prefix: str = "", depth: int = 1
) -> Iterator[StoredArray]:
    """Yield the datasets and attributes of a group and its subgroups; links are not followed."""
    if depth > MAX_DEPTH or len(group) > MAX_MEMBERS:
        problem = f"a group at nesting level {depth} has {len(group)} members"
        expected = f"at most {MAX_DEPTH} levels and {MAX_MEMBERS} members per group"
        raise reader_error(path, problem, expected)
    yield from _hdf5_rates(group, prefix)
    for member in group:
        is_matlab_internal = member.startswith("#")  # content of cells and objects
        if is_matlab_internal or not isinstance(group.get(member, getlink=True), h5py.HardLink):
            continue
        node, name = group[member], prefix + member
        attribute = node.attrs.get("MATLAB_class", b"")
        matlab_class = attribute.decode("latin1") if isinstance(attribute, bytes) else str(attribute)
        if isinstance(node, h5py.Dataset):
            yield from _hdf5_rates(node, name + separator)
            kind = _hdf5_class(node, matlab_class)
            yield StoredArray(name, kind, node.size or 0, partial(_read_dataset, node, name, path))
        elif isinstance(node, h5py.Group) and matlab_class in {"", "struct"}:
            yield from _hdf5_arrays(node, path, separator, name + separator, depth + 1)
        elif isinstance(node, h5py.Group):
            yield from _hdf5_rates(node, name + separator)
            kind = "sparse" if "MATLAB_sparse" in node.attrs else matlab_class
            yield StoredArray(name, kind)


def _hdf5_rates(node: Any, prefix: str) -> Iterator[StoredArray]:
    for attribute in filter(is_rate, node.attrs):
        values = partial(node.attrs.__getitem__, attribute)
        yield StoredArray(prefix + attribute, "", 1, values, is_attribute=True)


def _hdf5_class(dataset: h5py.Dataset, matlab_class: str) -> str:
    """Return the class of an HDF5 dataset; "" if it contains real numbers."""
    if matlab_class and matlab_class not in NUMERIC:
        return matlab_class
    if "MATLAB_empty" in dataset.attrs:
        return "empty"
    if dataset.dtype.kind in "iuf":
        return ""
    return _TEXT if h5py.check_string_dtype(dataset.dtype) else str(dataset.dtype.name)


def _read_dataset(dataset: h5py.Dataset, name: str, path: Path) -> Any:
    """Return the values of an HDF5 dataset, which must be stored in the file itself."""
    if dataset.external or dataset.is_virtual:
        raise reader_error(path, f"the dataset {name} is stored in another file", "all data in one file")
    check_announced_size(dataset.size, path)
    # HDF5 up to 2.0 crashes on a chunk that contains only its 4-byte checksum.
    if dataset.fletcher32 and dataset.id.chunk_iter(lambda chunk: chunk.size <= 4 or None):
        raise reader_error(path, f"{name} has a chunk without data", "data and a checksum in each chunk")
    # h5py converts in blocks, so the data are never in memory as both float32 and float64.
    return dataset.astype(np.float64)[()]


def _matlab_4_arrays(path: Path) -> Iterator[StoredArray]:
    with _warnings_as_errors():
        variables = scipy_io.whosmat(str(path))
    for name, shape, kind in variables:
        values = partial(_matlab_4_values, path, name)
        yield StoredArray(name, "" if kind in NUMERIC else kind, math.prod(map(int, shape)), values)


def _matlab_4_values(path: Path, name: str) -> Any:
    with _warnings_as_errors():
        return scipy_io.loadmat(str(path), variable_names=[name])[name]


@contextmanager
def _warnings_as_errors() -> Iterator[None]:
    """Convert scipy warnings about byte orders and overflows to errors; ignore those about repeated names."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        yield
