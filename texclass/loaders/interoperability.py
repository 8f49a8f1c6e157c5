"""Convert recordings from MNE and xarray, and to collections of aeon and sktime."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.dataset import GROUPS
from texclass.loaders.plausibility import build_recording
from texclass.loaders.readers import ReadSignals, reader_error
from texclass.loaders.time_columns import resample_by_time_column
from texclass.recording import Phases, Recording, Samples


def is_mne_or_xarray(data: Any) -> bool:
    """Return whether an object has the attributes of an MNE or xarray object."""
    return (hasattr(data, "get_data") and hasattr(data, "info")) or hasattr(data, "dims")


def recordings_of(data: Any, *, fs: float | None = None, unit: str | None = None) -> list[Recording]:
    """Convert an object of MNE or xarray to recordings.

    Parameters
    ----------
    data : mne.io.Raw, mne.Epochs or xarray.DataArray
        Acceleration. In `Raw`, every channel is an axis: pick the channels of the accelerometer first. Each
        epoch of `Epochs` is a recording of movement whose surface is the name of its event. A `DataArray` has
        the dimension `time` and at most one other dimension, the axes. Its sampling rate is the attribute
        `fs` or follows from the coordinate `time`; its unit is the attribute `unit` or `units`. The
        attributes `surface`, `operator`, `session`, `repetition` and `native_fs` are kept.
    fs : float, optional
        Sampling rate in Hz, if the object does not state it.
    unit : str, optional
        Unit of the acceleration, if the object does not state it (default "arbitrary").

    Returns
    -------
    recordings : list of Recording
        One recording, or one per epoch.

    Raises
    ------
    RecordingError
        If the sampling rate or unit contradicts the object, or a signal is invalid.

    See Also
    --------
    texclass.Recording.to_xarray : Conversion to xarray.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> samples = np.random.default_rng(0).standard_normal((3, 2000))
    >>> raw = SimpleNamespace(  # has the same attributes as mne.io.Raw
    ...     get_data=lambda: samples, info={"sfreq": 1000.0}, ch_names=["x", "y", "z"]
    ... )
    >>> recordings_of(raw, unit="g")
    [<Recording 'recording': 2 s at 1000 Hz, 3 axes in m/s^2>]
    """
    parts = _read_xarray(data, fs) if hasattr(data, "dims") else _read_mne(data)
    return [
        build_recording(signals, fs=fs, unit=unit or signals.unit or "arbitrary", source=source, **attributes)
        for signals, source, attributes in parts
    ]


def collection_of(recordings: Iterable[Recording]) -> Samples | list[Samples]:
    """Convert recordings to a collection of time series of aeon or sktime; `Dataset.labels` is the target.

    Parameters
    ----------
    recordings : iterable of Recording
        A dataset, or several recordings.

    Returns
    -------
    collection : ndarray of shape (n_recordings, n_axes, n_samples), or list of ndarray (n_axes, n_samples)
        Array if all recordings have the same length, otherwise a list. `FeatureExtractor` accepts both.

    Examples
    --------
    >>> import texclass as tx
    >>> recordings = [tx.Recording([[0, 1, 2]] * n, fs=1000.0) for n in (300, 400)]
    >>> [case.shape for case in tx.loaders.collection_of(recordings)]
    [(3, 300), (3, 400)]
    """
    cases = [
        np.ascontiguousarray(recording.acceleration.reshape(recording.n_samples, -1).T)
        for recording in recordings
    ]
    return np.stack(cases) if len({case.shape for case in cases}) == 1 else cases


def _read_mne(data: Any) -> Iterator[tuple[ReadSignals, str, dict[str, Any]]]:
    values, rate, axes = data.get_data(), float(data.info["sfreq"]), tuple(data.ch_names)
    if values.ndim == 2:
        yield ReadSignals({ACCELERATION: values.T}, rate, channels=axes), type(data).__name__, {}
        return
    event_names = {code: name for name, code in data.event_id.items()}
    for k, (epoch, code) in enumerate(zip(values, data.events[:, 2], strict=True)):
        phases = Phases(movement=(0, epoch.shape[1]))
        attributes = {"recording_id": f"epoch {k}", "surface": event_names[code], "phases": phases}
        yield ReadSignals({ACCELERATION: epoch.T}, rate, channels=axes), f"epoch {k}", attributes


def _read_xarray(data: Any, fs: float | None) -> Iterator[tuple[ReadSignals, str, dict[str, Any]]]:
    name, other_dims = str(data.name or "recording"), [dim for dim in data.dims if dim != "time"]
    if "time" not in data.dims or len(other_dims) > 1:
        expected = "`time` and at most one other dimension, the axes"
        raise reader_error(name, f"its dimensions are {data.dims}", expected)
    samples = np.asarray(data.transpose("time", *other_dims), dtype=np.float64)
    axes = tuple(
        str(axis) for dim in other_dims if dim in data.coords for axis in data.coords[dim].to_numpy()
    )
    rate = data.attrs.get("fs", fs)
    flags: tuple[str, ...] = ()
    if "time" in data.coords:
        time = data.coords["time"]
        times = time.to_numpy() + (np.datetime64(0, "ns") if time.dtype.kind == "m" else 0)
        time_name = f"time ({time.attrs['units']})" if "units" in time.attrs else "time"
        rows = samples.reshape(len(samples), -1)
        rows, rate, _, flags = resample_by_time_column(rows, times, time_name, rate, where=name)
        samples = rows.reshape(-1, *samples.shape[1:])
    attributes = {key: data.attrs[key] for key in (*GROUPS, "native_fs") if key in data.attrs}
    unit = data.attrs.get("unit", data.attrs.get("units"))
    signals = ReadSignals({ACCELERATION: samples}, rate, flags, axes, unit)
    yield signals, name, {"recording_id": name, **attributes}
