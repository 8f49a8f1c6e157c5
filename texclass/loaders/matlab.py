"""MATLAB files: version 5 by scipy, version 7.3 (HDF5 inside) by h5py."""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
from scipy import io as scipy_io

from texclass.loaders import arrays
from texclass.loaders.columns import Columns, ReadOptions, as_samples, check_held, require
from texclass.loaders.matlab_tags import check_tags
from texclass.recording import RecordingError

NUMERIC = ("double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
"""Classes of MATLAB variables that are read; a cell, a struct or an object is not opened."""


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the numeric variables.

    Raises
    ------
    RecordingError
        If it is not a MATLAB file.
    """
    if h5py.is_hdf5(path):
        return arrays.names(path, options)
    return tuple(name for name in _shapes(path) if name != arrays.RATE)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read the wanted variables, and the sampling rate if a scalar `fs` is stored.

    Raises
    ------
    RecordingError
        If it is not a MATLAB file, or a variable is missing or not numeric.
    """
    if h5py.is_hdf5(path):
        return arrays.read(path, wanted, options)
    shapes = _shapes(path)
    require(wanted, tuple(shapes), path)
    for name in wanted:
        check_held(shapes[name], path)
    rate = (arrays.RATE,) if shapes.get(arrays.RATE) == 1 else ()
    try:
        with _strictly():
            if scipy_io.matlab.matfile_version(str(path))[0] == 1:
                check_tags(path, {*wanted, *rate})
            stored: dict[str, Any] = scipy_io.loadmat(str(path), variable_names=[*wanted, *rate])
        columns = {name: as_samples(stored[name], name, path) for name in wanted}
        fs = float(stored[arrays.RATE].item()) if rate else None
    except RecordingError:
        raise
    except Exception as error:  # damaged headers make scipy raise almost anything
        raise _unreadable(path, error) from error
    return Columns(columns, fs)


def _shapes(path: Path) -> dict[str, int]:
    """Return name -> number of values of every numeric variable, without reading the values."""
    try:
        with _strictly():
            described = scipy_io.whosmat(str(path))
    except Exception as error:  # damaged headers make scipy raise almost anything
        raise _unreadable(path, error) from error
    sizes = {}
    for name, shape, matlab_class in described:
        # What scipy names itself (an array without a name is its "function workspace") is no recording.
        if matlab_class in NUMERIC and not name.startswith("__"):
            sizes[name] = 1
            for length in shape:
                sizes[name] *= int(length)
    return sizes


@contextlib.contextmanager
def _strictly() -> Iterator[None]:
    """Turn what scipy warns of (guessed byte orders, overflows) into errors, but for repeated names."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        yield


def _unreadable(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path}: not a readable MATLAB file, version 5 or 7.3 ({error})")
