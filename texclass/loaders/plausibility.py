"""Convert signals to recordings, with errors for invalid input and flags for implausible input."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.readers import RATES_HZ, ReadSignals, rate_conflict_error, reader_error
from texclass.loaders.timestamps import resample as band_limited
from texclass.phases import describe_outliers, find_motion_outliers, interpolate_outliers, resolution_problem
from texclass.recording import (
    ACCELERATION_UNITS,
    AUXILIARY_UNITS,
    STANDARD_GRAVITY,
    UNITS,
    Recording,
    Samples,
)

CLIPPED_SHARE = 1e-3
"""Fraction of clipped samples at or above which a recording is flagged."""


def build_recording(
    signals: ReadSignals,
    *,
    fs: float | None,
    unit: str | None,
    source: str,
    scale: float = 1.0,
    resample: float | None = None,
    rate_of: str = "",
    flags: tuple[str, ...] = (),
    **attributes: Any,
) -> Recording:
    """Check signals and convert them to a recording.

    Parameters
    ----------
    signals : ReadSignals
        Signals of the files.
    fs : float or None
        Sampling rate in Hz from the user or the card. With `resample`, it applies only to files that do not
        state a rate.
    unit : str or None
        Unit from the user or the card. The unit in the files must agree, unless `scale` converts it.
    source, flags, **attributes
        Fields of `Recording`.
    scale : float
        Factor by which the acceleration will be scaled later.
    resample : float, optional
        Target sampling rate in Hz. The files may then have different rates.
    rate_of : str
        File from which `fs` was read; "" if it is set by the user or the card.

    Returns
    -------
    Recording
        Recording with a flag for each implausible property.

    Raises
    ------
    RecordingError
        If the unit or sampling rate is missing or contradicts the files, or the acceleration is too short,
        constant or not finite.
    """
    unit = resolve_unit(signals.unit if scale == 1.0 else None, unit, source)
    attributes |= {**signals.signals, "channels": signals.channels, "unit": unit, "source": source}
    attributes["auxiliary_fs"] = signals.rates
    rate = resolve_rate(signals.fs, fs if resample is None or signals.fs is None else None, source, rate_of)
    recording = Recording(fs=rate, **attributes)
    flags = (*flags, *signals.flags, *acceleration_flags(recording.acceleration, recording.channels, source))
    flags = (*flags, *plausibility_flags(signals.signals, rate, unit, scale, flags, signals.rates))
    if resolution := resolution_problem(recording.acceleration, rate):
        flags = (*flags, resolution)
    if resample is not None and (resample != rate or recording.auxiliary_fs):
        sources = {name: getattr(recording, name) for name in signals.signals}
        rates = {name: recording.rate_of(name) for name in sources}
        for name in {"speed", "normal_force"} & set(sources):  # an outlier would ring for many samples
            outliers = find_motion_outliers(sources[name], rates[name])
            sources[name] = interpolate_outliers(sources[name], outliers)
        resampled = {name: band_limited(signal, rates[name], resample) for name, signal in sources.items()}
        n = len(resampled[ACCELERATION])
        for name, signal in resampled.items():  # the last sample of signals with another rate is held
            resampled[name] = signal[np.minimum(np.arange(n), len(signal) - 1)]
        recording = recording.with_(fs=resample, native_fs=rate, auxiliary_fs={}, **resampled)
        others = "".join(f", {name} from {other:g} Hz" for name, other in signals.rates.items())
        flags = (*flags, f"resampled: from {rate:g} Hz to {resample:g} Hz, band-limited{others}")
        if rate < resample:
            flags = (*flags, f"narrow band: sampled at {rate:g} Hz, so no content above {rate / 2:g} Hz")
    return recording.with_(flags=flags) if flags else recording


def resolve_rate(file_fs: float | None, user_fs: float | None, where: object, rate_of: str = "") -> float:
    """Return the sampling rate from the file, or from the user or card; if both exist, they must agree.

    Parameters
    ----------
    file_fs : float or None
        Sampling rate in Hz that the file states.
    user_fs : float or None
        Sampling rate in Hz from the user or the card.
    where : str or Path
        File named in the messages.
    rate_of : str
        Other file from which `user_fs` was read; "" if it is set by the user or the card.

    Raises
    ------
    RecordingError
        If the rate is missing or contradictory.
    """
    if file_fs is None and user_fs is None:
        raise reader_error(
            where,
            "fs is missing, because the input states no sampling rate",
            "--fs HZ, or --time-column COLUMN if there are time stamps",
        )
    if file_fs is not None and user_fs is not None and not math.isclose(file_fs, user_fs, rel_tol=1e-9):
        raise rate_conflict_error(where, f"{file_fs:g} Hz", user_fs, rate_of)
    rate = float(file_fs if file_fs is not None else user_fs)  # type: ignore[arg-type]
    low, high = RATES_HZ
    if not low <= rate <= high:
        raise reader_error(where, f"fs is {rate:g} Hz", f"a rate from {low:g} to {high:g} Hz")
    return rate


def resolve_unit(file_unit: str | None, user_unit: str | None, where: object) -> str:
    """Return the unit of the acceleration from the file, or from the user or card; both must agree.

    Parameters
    ----------
    file_unit : str or None
        Unit that the file states.
    user_unit : str or None
        Unit from the user or the card, or from another file of the dataset.
    where : str or Path
        File named in the messages.

    Raises
    ------
    RecordingError
        If the unit is missing or contradictory.
    """
    if (unit := file_unit if user_unit is None else user_unit) is None:
        raise reader_error(
            where, "unit is missing, because the input states none", f"--unit with one of {', '.join(UNITS)}"
        )
    if file_unit not in (None, unit):
        problem = f"its unit is {file_unit!r}, but {unit!r} was given or is the unit of another file"
        raise reader_error(where, problem, "the same unit; to convert values, set `scale` in a card")
    return unit


def acceleration_flags(acceleration: Samples, channels: Sequence[str], where: str) -> tuple[str, ...]:
    """Check an acceleration and return flags on clipping and constant channels.

    Parameters
    ----------
    acceleration : ndarray of shape (n,) or (n, n_channels)
        Acceleration in any unit.
    channels : sequence of str
        Names of the channels.
    where : str
        File named in the messages.

    Returns
    -------
    tuple of str
        Flags such as "clipped: ..." and "constant: ...".

    Raises
    ------
    RecordingError
        If there are fewer than two samples, no channel varies, or a value exceeds 1e30.
    """
    columns = acceleration.reshape(len(acceleration), -1)
    if len(columns) < 2:
        raise reader_error(where, f"contains {len(columns)} sample", "at least 2")
    if not (largest := np.abs(columns).max()) <= 1e30:  # larger values come from damaged files
        raise reader_error(
            where, f"contains a value of {largest:.3g}", "at most 1e+30. The file may be damaged"
        )
    constant = np.ptp(columns, axis=0) == 0
    if constant.all():
        problem = f"the acceleration is constant, {columns[0].tolist()}"
        raise reader_error(where, problem, "at least one varying channel")
    constant_flags = [
        f"constant: channel {name}"
        for name, is_constant in zip(channels, constant, strict=True)
        if is_constant
    ]
    share = max(clipped_share(columns[:, i]) for i in np.flatnonzero(~constant))
    if share < CLIPPED_SHARE:
        return tuple(constant_flags)
    return (*constant_flags, f"clipped: {100 * share:.1f} % of the samples at full scale")


def clipped_share(signal: Samples) -> float:
    """Return the fraction of samples in clipped runs.

    A clipped run consists of at least 3 equal samples at the largest or smallest value. The signal enters or
    leaves the run by more than two quantisation steps. Crests of slow waves are reached in single
    quantisation steps and therefore do not count.

    Parameters
    ----------
    signal : ndarray of shape (n,)
        Signal that is not constant.

    Returns
    -------
    share : float
        Fraction from 0 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> wave = np.sin(np.arange(1000) / 5)
    >>> clipped_share(wave), round(clipped_share(np.clip(wave, -0.9, 0.9)), 2)
    (0.0, 0.29)
    """
    starts, stops = [], []
    for extreme in (signal.min(), signal.max()):
        indices = np.flatnonzero(signal == extreme)
        last_of_run = np.flatnonzero(np.diff(indices, append=np.inf) > 1)
        starts.append(indices[np.concatenate(([0], last_of_run[:-1] + 1))])
        stops.append(indices[last_of_run] + 1)
    start, stop = np.concatenate(starts), np.concatenate(stops)
    is_long = stop - start >= 3
    start, stop = start[is_long], stop[is_long]
    if not len(start):
        return 0.0
    levels = np.unique(signal[:10_000_000])  # enough samples to find the quantisation step
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    rise = np.abs(signal[np.maximum(start - 1, 0)] - signal[start])
    fall = np.abs(signal[np.minimum(stop, len(signal) - 1)] - signal[stop - 1])
    return float((stop - start)[np.maximum(rise, fall) > 2 * step].sum() / len(signal))


def plausibility_flags(
    signals: Mapping[str, Samples],
    fs: float,
    unit: str,
    scale: float = 1.0,
    flags: Iterable[str] = (),
    rates: Mapping[str, float] | None = None,
) -> tuple[str, ...]:
    """Return flags for implausible signals: clipping, outliers, and a level at rest that is not gravity.

    Parameters
    ----------
    signals : mapping of str to ndarray of shape (n,) or (n, c)
        Signals by field of `Recording`; the acceleration is in `unit` after multiplication by `scale`.
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit of the acceleration.
    scale : float
        Factor from stored values to `unit`.
    flags : iterable of str
        Flags of the reader. The level at rest is not checked if the reader has flagged the unit.
    rates : mapping of str to float, optional
        Sampling rates in Hz of signals with another rate.
    """
    new_flags = []
    for name in ("turn_rate", "friction"):
        if (signal := signals.get(name)) is not None and len(signal):
            share = max(clipped_share(column) for column in signal.reshape(len(signal), -1).T)
            if share >= CLIPPED_SHARE:
                new_flags.append(f"clipped: {100 * share:.1f} % of the samples of the {name} at full scale")
    for name in ("speed", "normal_force"):
        if (signal := signals.get(name)) is not None and np.isfinite(signal).all():
            rate = (rates or {}).get(name, fs)
            outliers = find_motion_outliers(signal, rate)
            if len(outliers):
                text = describe_outliers(signal, outliers, rate, name, AUXILIARY_UNITS[name])
                new_flags.append(f"outliers: {text}, excluded from fits of textures")
    acceleration = signals[ACCELERATION]
    is_unit_flagged = any(flag.startswith("unit:") for flag in flags)
    if unit not in ACCELERATION_UNITS or acceleration.shape[1:] != (3,) or is_unit_flagged:
        return tuple(new_flags)
    # Means over 0.25 s remove vibration but not gravity.
    n = max(1, min(round(0.25 * fs), len(acceleration)))
    blocks = acceleration[: len(acceleration) // n * n].reshape(-1, n, 3).mean(axis=1)
    level = float(np.median(np.linalg.norm(blocks, axis=1))) * abs(scale)
    level_in_g = {other: level * size / STANDARD_GRAVITY for other, size in ACCELERATION_UNITS.items()}
    likely_unit = next((other for other, ratio in level_in_g.items() if abs(ratio - 1) <= 0.1), None)
    if not 0.8 <= level_in_g[unit] <= 1.2:  # range of sensors that measure gravity
        gravity = STANDARD_GRAVITY / ACCELERATION_UNITS[unit]
        problem = f"unit: the level at rest is {level:.3g} {unit}, but gravity is {gravity:.3g} {unit}"
        if likely_unit:
            new_flags.append(
                f"{problem}. If the data are in {likely_unit}, set --unit {likely_unit} (`unit` in a card)"
            )
        elif level_in_g[unit] > 0.35:  # too high for a signal without gravity
            new_flags.append(f"{problem}. Check unit, scale and columns of the acceleration")
    return tuple(new_flags)


def similar_label_notes(surfaces: Iterable[str]) -> list[str]:
    """Return notes on surfaces whose names differ only in case or blanks."""
    groups: dict[str, list[str]] = {}
    for surface in sorted(set(surfaces)):
        groups.setdefault(" ".join(surface.casefold().split()), []).append(surface)
    return [
        f"surfaces {' and '.join(map(repr, names))} differ only in case or blanks: rename one of them if "
        "they are the same surface"
        for names in groups.values()
        if len(names) > 1
    ]


def folder_level_notes(file_parts: Iterable[Sequence[str]]) -> list[str]:
    """Return a note if the first level of folders looks like sessions rather than surfaces.

    This is the case if the folders have subfolders in common, and either there are more common subfolders
    than folders, or the folders are named like sessions ("session 1", "session 2").

    Parameters
    ----------
    file_parts : iterable of sequence of str
        Parts of the relative path of each file.
    """
    session = r"(session|run|day|trial|operator|subject|user|participant|person|s|p)[ _-]?\d+"
    subfolders: dict[str, set[str]] = {}
    for parts in file_parts:
        subfolders.setdefault(parts[0], set()).update(parts[1:2] if len(parts) > 2 else ())
    common = set.intersection(*subfolders.values()) if subfolders else set()
    are_sessions = len(common) > len(subfolders) or all(
        re.fullmatch(session, name, re.IGNORECASE) for name in subfolders
    )
    if min(len(subfolders), len(common)) < 2 or not are_sessions:
        return []
    labels, inner = (", ".join(sorted(names)[:4]) for names in (subfolders, common))
    return [
        f"the labels are {labels}, and each of these folders contains {inner}. If the latter are surfaces, "
        "write a card with files = '(?P<session>[^/]+)/(?P<surface>[^/]+)/.+'"
    ]
