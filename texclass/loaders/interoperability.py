"""Convert recordings from MNE and xarray, and to collections of aeon and sktime; none of them is imported."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.dataset import GROUPS
from texclass.loaders.plausibility import build_recording
from texclass.loaders.readers import ReadSignals, reader_error
from texclass.loaders.time_columns import resample_by_time_column
from texclass.recording import Phases, Recording, Samples


def is_mne_or_xarray(given: Any) -> bool:
    """Whether `recordings_of` takes an object: by its attributes, so that no library is needed."""
    return (hasattr(given, "get_data") and hasattr(given, "info")) or hasattr(given, "dims")


def recordings_of(given: Any, *, fs: float | None = None, unit: str | None = None) -> list[Recording]:
    """Return the recordings that an object of MNE or xarray holds.

    Parameters
    ----------
    given : mne.io.Raw, mne.Epochs or xarray.DataArray
        Of `Raw` every channel is an axis: pick those of the accelerometer before. `Epochs` are as many
        recordings, of the surface that their event names, and all movement, as arrays are. A `DataArray` has
        a dimension `time` and at most one other, the axes; the rate is its attribute `fs` or what its
        coordinate `time` tells, the unit its attribute `unit` or `units`; `name`, `surface`, `operator`,
        `session`, `repetition` and `native_fs` are kept.
    fs : float, optional
        Sampling rate in Hz, where the object does not state it.
    unit : str, optional
        Unit of the acceleration, where the object does not state it; "arbitrary" by default.

    Returns
    -------
    recordings : list of Recording

    Raises
    ------
    RecordingError
        If rate or unit are contradicted, or a signal breaks a rule.

    See Also
    --------
    texclass.Recording.to_xarray : The way back.
    """
    found = _of_xarray(given, fs) if hasattr(given, "dims") else _of_mne(given)
    return [
        build_recording(signals, fs=fs, unit=unit or signals.unit or "arbitrary", source=source, **facts)
        for signals, source, facts in found
    ]


def collection_of(recordings: Iterable[Recording]) -> Samples | list[Samples]:
    """Return recordings as aeon has a collection of time series; `Dataset.labels` are its y.

    Parameters
    ----------
    recordings : iterable of Recording
        A dataset, or several recordings.

    Returns
    -------
    collection : ndarray of shape (n_recordings, n_axes, n_samples), or list of ndarray (n_axes, n_samples)
        A list where recordings are not of one length; `FeatureExtractor` takes either back.

    Examples
    --------
    >>> import texclass as tx
    >>> recordings = [tx.Recording([[0, 1, 2]] * n, fs=1000.0) for n in (300, 400)]
    >>> [case.shape for case in tx.loaders.collection_of(recordings)]
    [(3, 300), (3, 400)]
    """
    cases = [np.ascontiguousarray(one.acceleration.reshape(one.n_samples, -1).T) for one in recordings]
    return np.stack(cases) if len({case.shape for case in cases}) == 1 else cases


def _of_mne(given: Any) -> Iterator[tuple[ReadSignals, str, dict[str, Any]]]:
    data, rate, axes = given.get_data(), float(given.info["sfreq"]), tuple(given.ch_names)
    if data.ndim == 2:
        yield ReadSignals({ACCELERATION: data.T}, rate, channels=axes), type(given).__name__, {}
        return
    events = {code: name for name, code in given.event_id.items()}
    for k, (epoch, code) in enumerate(zip(data, given.events[:, 2], strict=True)):
        whole = Phases(movement=(0, epoch.shape[1]))
        facts = {"recording_id": f"epoch {k}", "surface": events[code], "phases": whole}
        yield ReadSignals({ACCELERATION: epoch.T}, rate, channels=axes), f"epoch {k}", facts


def _of_xarray(given: Any, fs: float | None) -> Iterator[tuple[ReadSignals, str, dict[str, Any]]]:
    name, beside = str(given.name or "recording"), [dim for dim in given.dims if dim != "time"]
    if "time" not in given.dims or len(beside) > 1:
        raise reader_error(
            name, f"its dimensions are {given.dims}", "`time`, and at most one other, the axes"
        )
    samples = np.asarray(given.transpose("time", *beside), dtype=np.float64)
    axes = tuple(str(axis) for dim in beside if dim in given.coords for axis in given.coords[dim].to_numpy())
    rate = given.attrs.get("fs", fs)
    flags: tuple[str, ...] = ()
    if "time" in given.coords:
        time = given.coords["time"]
        times = time.to_numpy() + (np.datetime64(0, "ns") if time.dtype.kind == "m" else 0)
        called = f"time ({time.attrs['units']})" if "units" in time.attrs else "time"
        rows = samples.reshape(len(samples), -1)
        rows, rate, flags = resample_by_time_column(rows, times, called, rate, where=name)
        samples = rows.reshape(-1, *samples.shape[1:])
    facts = {fact: given.attrs[fact] for fact in (*GROUPS, "native_fs") if fact in given.attrs}
    unit = given.attrs.get("unit", given.attrs.get("units"))
    yield ReadSignals({ACCELERATION: samples}, rate, flags, axes, unit), name, {"recording_id": name, **facts}
