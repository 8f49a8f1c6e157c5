"""Read a column of time stamps: find its unit, and bring the samples to a uniform rate."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.columns import time_unit
from texclass.loaders.readers import TIME_UNITS, reader_error
from texclass.loaders.timestamps import TIMESTAMPS, to_uniform_rate, typical_step
from texclass.recording import RecordingError, Samples

FAST_HZ = 50e3
"""A unit of the name that gives a higher rate, and less than 0.1 s, contradicts the data."""


def is_increasing(times: NDArray[np.generic]) -> bool:
    """Whether a column increases as time stamps do: clocks are set, rows are swapped, but rarely."""
    steps = _numbers(times)
    return len(steps) > 1 and bool(steps[-1] > steps[0]) and float(np.mean(np.diff(steps) < 0)) <= 0.01


def resample_by_time_column(
    samples: Samples,
    times: NDArray[np.generic],
    name: str,
    given: float | None,
    *,
    where: str,
    unit: str | None = None,
    rate_of: str = "",
) -> tuple[Samples, float, tuple[str, ...]]:
    """Return samples at a uniform rate, by the column of their time stamps.

    Parameters
    ----------
    samples : ndarray of shape (n, n_columns)
        As stored.
    times : ndarray of shape (n,)
        Time stamps: numbers, or datetime64[ns].
    name : str
        Name of their column.
    given : float or None
        Rate in Hz that the user states.
    where : str
        File, for messages.
    unit : str, optional
        Unit of the numbers, of `TIME_UNITS`; by default the one in the name ("time (ms)", "t_us"), else the
        one that agrees with the given rate, else the one that the range and step of the numbers imply.
    rate_of : str
        File that states `given`; by default the user does.

    Returns
    -------
    uniform : ndarray of shape (n_uniform, n_columns)
    fs : float
        Rate in Hz.
    flags : tuple of str
        What was measured, inferred and corrected, as `at_uniform_rate`.

    Raises
    ------
    RecordingError
        If the time stamps contradict the given rate, do not increase, or leave their unit open.
    """
    merged: tuple[str, ...] = ()
    is_new = _new_rows(samples)
    if not is_new.all():
        merged = (
            f"merged log: {np.mean(~is_new):.0%} of the rows repeat all values of the row before, left out",
        )
        samples, times = samples[is_new], times[is_new]
    numbers = _numbers(times)
    if len(numbers) < 2 or not 0 < _typical_step(numbers) < np.inf:
        raise reader_error(
            where, f"its column {name!r} does not rise", "a time for each sample, or --time-column none"
        )
    if times.dtype.kind in "Mm":
        unit, inferred = "ns", False
    else:
        inferred = (unit or time_unit(name)) is None
        unit = unit or _unit(numbers, name, given, where)
    span = (numbers - numbers[0]) * TIME_UNITS[unit]
    if not np.abs(span).max() < 2**62:
        raise reader_error(
            where, f"its column {name!r} spans {np.ptp(numbers):g} {unit}", "less than a century"
        )
    stamps = np.rint(span).astype(np.int64)
    by = f"column {name!r}"
    uniform, fs, _, flags = to_uniform_rate(
        samples[:, None, :], stamps, stamps, given, by_header=True, where=where, by=by, rate_of=rate_of
    )
    if inferred and unit != "s":
        flags = (
            f"time: unit of column {name!r} is {unit}, inferred from range and step (--time-unit)",
            *flags,
        )
    return uniform, fs, merged + flags


def _new_rows(samples: Samples) -> NDArray[np.bool_]:
    """Return which rows are of this sensor: in a log of several, the others repeat its latest values.

    A sensor at rest repeats values, too, but with few levels. Where nearly all rows with a change are
    different, chance does not repeat a row.
    """
    is_new = np.append(True, np.any(samples[1:] != samples[:-1], axis=1))
    n_new = np.count_nonzero(is_new)
    # Sorting all rows takes long: only where more than a tenth of them repeat.
    is_merged = 2 <= n_new < 0.9 * len(samples) and (len(np.unique(samples[is_new], axis=0)) >= 0.95 * n_new)
    return is_new if is_merged else np.ones(len(samples), bool)


def _numbers(times: NDArray[np.generic]) -> Samples:
    """Return dates as nanoseconds after the first, and numbers as they are."""
    dates: Any = times
    return np.asarray(dates - dates[:1] if times.dtype.kind in "Mm" else times).astype(np.float64)


def _typical_step(numbers: Samples) -> float:
    """Return the usual step, or the mean step where many rows share a time stamp or come in bursts."""
    step = np.diff(numbers)
    mean = float(numbers[-1] - numbers[0]) / len(step)
    return typical_step(step) if np.median(step) > 0.2 * mean else mean


def _unit(numbers: Samples, name: str, given: float | None, where: str) -> str:
    """Return the unit of time stamps, by name, given rate, range or step.

    Raises
    ------
    RecordingError
        If these contradict each other or several units are plausible.
    """
    step = _typical_step(numbers)
    rates = {unit: 1e9 / (step * size) for unit, size in TIME_UNITS.items()}
    usual = ("s", "ms", "us", "ns")
    plausible = [unit for unit in usual if 1.0 < rates[unit] < 20e3]  # rates of accelerometers
    near = TIMESTAMPS.near_rate
    agreeing = [unit for unit in usual if given and abs(rates[unit] - given) <= near * given]
    if (named := time_unit(name)) is not None:
        is_short = len(numbers) / rates[named] < 0.1
        if rates[named] > FAST_HZ and is_short and given is None and plausible:
            raise _ambiguous_unit_error(where, name, rates, (named, *plausible))
        if given and named not in agreeing and agreeing:
            raise _ambiguous_unit_error(where, name, rates, (named, *agreeing), f", {given:g} Hz was given")
        return named
    if agreeing:
        return agreeing[0]
    first = abs(float(numbers[0]))
    for unit, least in {"ns": 1e17, "us": 1e14, "ms": 1e11}.items():
        if first > least:  # since 1970
            return unit
    # 1954 to 2119 as Excel counts days, 1889 to 2135 as MATLAB does
    if rates["s"] > FAST_HZ and (20_000 < first < 80_000 or 690_000 < first < 780_000):
        return "days"
    if len(plausible) > 1:
        raise _ambiguous_unit_error(where, name, rates, plausible)
    return plausible[0] if plausible else "s"


def _ambiguous_unit_error(
    where: str, name: str, rates: dict[str, float], units: Iterable[str], given: str = ""
) -> RecordingError:
    options = " or ".join(f"{rates[unit]:.6g} Hz if in {unit}" for unit in units)
    return RecordingError(
        f"{where}: fs is {options} by its column {name!r}{given}. Expected one unit: set --time-unit "
        "(`time_unit` in a card)"
    )
