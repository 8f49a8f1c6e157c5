"""Resample signals with a column of time stamps: infer its unit, and convert to a uniform sampling rate."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.columns import time_unit
from texclass.loaders.readers import TIME_UNITS, reader_error
from texclass.loaders.timestamps import TIMESTAMPS, to_uniform_rate, typical_step
from texclass.recording import RecordingError, Samples

FAST_HZ = 50e3
"""Sampling rate in Hz above which the unit in a column name is not trusted for recordings below 0.1 s."""


def is_increasing(times: NDArray[np.generic]) -> bool:
    """Return whether a column increases like time stamps, with at most 1 % of backward steps."""
    steps = _numbers(times)
    return len(steps) > 1 and bool(steps[-1] > steps[0]) and float(np.mean(np.diff(steps) < 0)) <= 0.01


def resample_by_time_column(
    samples: Samples,
    times: NDArray[np.generic],
    name: str,
    user_fs: float | None,
    *,
    where: str,
    unit: str | None = None,
    rate_of: str = "",
    origin: Any = None,
) -> tuple[Samples, float, float, tuple[str, ...]]:
    """Resample signals to a uniform rate, given their time stamps.

    Parameters
    ----------
    samples : ndarray of shape (n, n_columns)
        Stored values.
    times : ndarray of shape (n,)
        Time stamps: numbers, or datetime64[ns].
    name : str
        Name of the column.
    user_fs : float or None
        Sampling rate in Hz set by the user.
    where : str
        File, for messages.
    unit : str, optional
        Unit of numbers, one of `TIME_UNITS` (default: the unit in the name, such as "time (ms)" or "t_us";
        otherwise the unit that agrees with `user_fs` or is inferred from range and step).
    rate_of : str
        File from which `user_fs` was read; "" if it is set by the user.
    origin : number or datetime64, optional
        Time stamp from which `start_s` is counted (default: the first one).

    Returns
    -------
    uniform : ndarray of shape (n_uniform, n_columns)
        Samples at `fs`.
    fs : float
        Sampling rate in Hz.
    start_s : float
        Time of the first sample in s after `origin`.
    flags : tuple of str
        Inferred unit, measured rate and corrections.

    Raises
    ------
    RecordingError
        If the time stamps contradict `user_fs`, do not increase, or have an ambiguous unit.
    """
    merge_flags: tuple[str, ...] = ()
    is_new = _new_rows(samples)
    if not is_new.all():
        share = np.mean(~is_new)
        merge_flags = (f"merged log: {share:.0%} of the rows repeat all values of the previous row, dropped",)
        samples, times = samples[is_new], times[is_new]
    numbers = _numbers(times)
    if len(numbers) < 2 or not 0 < _typical_step(numbers) < np.inf:
        raise reader_error(
            where, f"its column {name!r} does not increase", "time stamps, or --time-column none"
        )
    if times.dtype.kind in "Mm":
        unit, is_inferred = "ns", False
    else:
        is_inferred = (unit or time_unit(name)) is None
        unit = unit or _unit(numbers, name, user_fs, where)
    span = (numbers - numbers[0]) * TIME_UNITS[unit]
    if not np.abs(span).max() < 2**62:
        raise reader_error(
            where, f"its column {name!r} spans {np.ptp(numbers):g} {unit}", "less than a century"
        )
    stamps = np.rint(span).astype(np.int64)
    by = f"column {name!r}"
    uniform, fs, start_s, flags = to_uniform_rate(
        samples[:, None, :], stamps, stamps, user_fs, by_header=True, where=where, by=by, rate_of=rate_of
    )
    if is_inferred and unit != "s":
        flags = (
            f"time: unit of column {name!r} is {unit}, inferred from range and step (--time-unit)",
            *flags,
        )
    if origin is not None:
        start_s += float(np.diff(_numbers(np.array([origin, times[0]])))[0]) * TIME_UNITS[unit] / 1e9
    return uniform, fs, start_s, merge_flags + flags


def _new_rows(samples: Samples) -> NDArray[np.bool_]:
    """Return which rows contain new samples.

    In a merged log of several sensors, a row of another sensor repeats the last values. A sensor at rest also
    repeats values, but takes few distinct values. Repeated rows are dropped only if nearly all other rows are
    distinct, because then a repetition is unlikely to be a coincidence.
    """
    is_new = np.append(True, np.any(samples[1:] != samples[:-1], axis=1))
    n_new = np.count_nonzero(is_new)
    # Sorting all rows is slow, so it is only done if more than a tenth of them repeat.
    is_merged = 2 <= n_new < 0.9 * len(samples) and (len(np.unique(samples[is_new], axis=0)) >= 0.95 * n_new)
    return is_new if is_merged else np.ones(len(samples), bool)


def _numbers(times: NDArray[np.generic]) -> Samples:
    """Convert dates to ns since the first date; return numbers unchanged."""
    dates: Any = times
    return np.asarray(dates - dates[:1] if times.dtype.kind in "Mm" else times).astype(np.float64)


def _typical_step(numbers: Samples) -> float:
    """Return the typical step, or the mean step if rows share time stamps or come in bursts."""
    step = np.diff(numbers)
    mean = float(numbers[-1] - numbers[0]) / len(step)
    return typical_step(step) if np.median(step) > 0.2 * mean else mean


def _unit(numbers: Samples, name: str, user_fs: float | None, where: str) -> str:
    """Return the unit of time stamps from their name, the stated rate, their range or their step.

    Raises
    ------
    RecordingError
        If these contradict each other, or several units are plausible.
    """
    step = _typical_step(numbers)
    rates = {unit: 1e9 / (step * size) for unit, size in TIME_UNITS.items()}
    common_units = ("s", "ms", "us", "ns")
    plausible = [unit for unit in common_units if 1.0 < rates[unit] < 20e3]  # rates of accelerometers
    near = TIMESTAMPS.near_rate
    matching = [unit for unit in common_units if user_fs and abs(rates[unit] - user_fs) <= near * user_fs]
    if (name_unit := time_unit(name)) is not None:
        is_short = len(numbers) / rates[name_unit] < 0.1
        if rates[name_unit] > FAST_HZ and is_short and user_fs is None and plausible:
            raise _ambiguous_unit_error(where, name, rates, (name_unit, *plausible))
        if user_fs and name_unit not in matching and matching:
            suffix = f", but {user_fs:g} Hz was given"
            raise _ambiguous_unit_error(where, name, rates, (name_unit, *matching), suffix)
        return name_unit
    if matching:
        return matching[0]
    first = abs(float(numbers[0]))
    for unit, minimum in {"ns": 1e17, "us": 1e14, "ms": 1e11}.items():
        if first > minimum:  # time since 1970
            return unit
    # Days from 1954 to 2119 in Excel, from 1889 to 2135 in MATLAB.
    if rates["s"] > FAST_HZ and (20_000 < first < 80_000 or 690_000 < first < 780_000):
        return "days"
    if len(plausible) > 1:
        raise _ambiguous_unit_error(where, name, rates, plausible)
    return plausible[0] if plausible else "s"


def _ambiguous_unit_error(
    where: str, name: str, rates: dict[str, float], units: Iterable[str], suffix: str = ""
) -> RecordingError:
    options = " or ".join(f"{rates[unit]:.6g} Hz if in {unit}" for unit in units)
    return RecordingError(
        f"{where}: the unit of its column {name!r} is ambiguous: fs is {options}{suffix}. Set the unit with "
        "--time-unit (`time_unit` in a card)"
    )
