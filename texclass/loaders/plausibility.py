"""Signals as read become a recording: the impossible is refused, the unlikely is told."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.readers import RATES_HZ, ReadSignals, rate_conflict_error, reader_error
from texclass.loaders.timestamps import resample as band_limited
from texclass.recording import ACCELERATION_UNITS, STANDARD_GRAVITY, UNITS, Recording, Samples

CLIPPED_SHARE = 1e-3
"""Share of clipped samples from which a recording is flagged."""


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
    **facts: Any,
) -> Recording:
    """Check signals and return them as a recording.

    Parameters
    ----------
    signals : ReadSignals
        As read.
    fs : float or None
        Rate in Hz that user or card state; if files may have different ones, of those that state none.
    unit : str or None
        That user or card state; what the files state must agree, unless it is scaled to another.
    source, flags, **facts
        Fields of `Recording`.
    scale : float
        Factor by which the acceleration will be scaled.
    resample : float, optional
        Rate in Hz to which they are brought; then each file may have its own.
    rate_of : str
        File that states `fs`; by default user or card do.

    Raises
    ------
    RecordingError
        If unit or sampling rate are missing or contradicted, the acceleration too short, constant or not
        finite.
    """
    unit = resolve_unit(signals.unit if scale == 1.0 else None, unit, source)
    facts |= {**signals.named, "channels": signals.channels, "unit": unit, "source": source}
    rate = resolve_rate(signals.fs, fs if resample is None or signals.fs is None else None, source, rate_of)
    recording = Recording(fs=rate, **facts)
    flags = (*flags, *signals.flags, *acceleration_flags(recording.acceleration, recording.channels, source))
    flags = (*flags, *plausibility_flags(signals.named, rate, unit, scale, flags))
    if resample is not None and resample != rate:
        changed = {name: band_limited(getattr(recording, name), rate, resample) for name in signals.named}
        recording = recording.with_(fs=resample, native_fs=rate, **changed)
        flags = (*flags, f"resampled: from {rate:g} Hz to {resample:g} Hz, band-limited")
        if rate < resample:
            flags = (*flags, f"narrow band: sampled at {rate:g} Hz, nothing above {rate / 2:g} Hz")
    return recording.with_(flags=flags) if flags else recording


def resolve_rate(stated: float | None, given: float | None, where: object, rate_of: str = "") -> float:
    """Return the sampling rate in Hz, from the file, from the user or card, or from both if they agree.

    `rate_of` is the file that states `given`, if neither user nor card does.

    Raises
    ------
    RecordingError
        If it is missing or contradicted.
    """
    if stated is None and given is None:
        raise reader_error(where, "fs is missing", "a rate in Hz, never guessed: give --fs or --time-column")
    if stated is not None and given is not None and not math.isclose(stated, given, rel_tol=1e-9):
        raise rate_conflict_error(where, f"{stated:g} Hz", given, rate_of)
    rate = float(stated if stated is not None else given)  # type: ignore[arg-type]
    low, high = RATES_HZ
    if not low <= rate <= high:
        raise reader_error(where, f"fs is {rate:g} Hz", f"a sampling rate in Hz from {low:g} to {high:g}")
    return rate


def resolve_unit(stated: str | None, given: str | None, where: object) -> str:
    """Return the unit of the acceleration, from the file, from the user or card, or from both if they agree.

    Raises
    ------
    RecordingError
        If it is missing or contradicted.
    """
    if (unit := stated if given is None else given) is None:
        raise reader_error(where, "unit is missing", f"one of {', '.join(UNITS)}, never guessed: give --unit")
    if stated not in (None, unit):
        found = f"unit is {stated!r} there, {unit!r} was given (or is another file's)"
        raise reader_error(where, found, "one unit (`scale` in a card for another)")
    return unit


def acceleration_flags(acceleration: Samples, channels: Sequence[str], where: str) -> tuple[str, ...]:
    """Return what a user should know of an acceleration ("clipped: ...", "constant: ...").

    Raises
    ------
    RecordingError
        If there are fewer than two samples, no channel varies, or a value is no sensor's.
    """
    columns = acceleration.reshape(len(acceleration), -1)
    if len(columns) < 2:
        raise reader_error(where, f"holds {len(columns)} sample", "at least 2")
    if not (largest := np.abs(columns).max()) <= 1e30:  # no sensor's value is larger
        raise reader_error(
            where, f"holds a value of {largest:.3g}", "at most 1e+30; what is larger is damage"
        )
    constant = np.ptp(columns, axis=0) == 0
    if constant.all():
        raise reader_error(
            where, f"acceleration is {columns[0].tolist()} throughout", "a channel that varies"
        )
    dead = [f"constant: channel {name}" for name, is_dead in zip(channels, constant, strict=True) if is_dead]
    share = max(clipped_share(columns[:, i]) for i in np.flatnonzero(~constant))
    clipped = [f"clipped: {100 * share:.1f} % of the samples at full scale"] if share >= CLIPPED_SHARE else []
    return (*dead, *clipped)


def clipped_share(signal: Samples) -> float:
    """Return the share of samples that stand in a run at the signal's largest or smallest value.

    A run is at least 3 equal samples that the signal enters or leaves by more than two
    quantisation steps: a slow wave that is merely quantised reaches its crest step by step.

    Parameters
    ----------
    signal : ndarray of shape (n,)
        Not constant.

    Returns
    -------
    share : float
        Between 0 and 1.
    """
    firsts, lasts = [], []
    for extreme in (signal.min(), signal.max()):
        where = np.flatnonzero(signal == extreme)
        ends = np.flatnonzero(np.diff(where, append=np.inf) > 1)
        firsts.append(where[np.concatenate(([0], ends[:-1] + 1))])
        lasts.append(where[ends] + 1)
    first, last = np.concatenate(firsts), np.concatenate(lasts)
    long = last - first >= 3
    first, last = first[long], last[long]
    if not len(first):
        return 0.0
    levels = np.unique(signal[:10_000_000])  # enough to find the quantisation step
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    before = np.abs(signal[np.maximum(first - 1, 0)] - signal[first])
    after = np.abs(signal[np.minimum(last, len(signal) - 1)] - signal[last - 1])
    return float((last - first)[np.maximum(before, after) > 2 * step].sum() / len(signal))


def plausibility_flags(
    named: Mapping[str, Samples], fs: float, unit: str, scale: float = 1.0, said: Iterable[str] = ()
) -> tuple[str, ...]:
    """Return what is unlikely of the signals of a recording: a level at rest, turn rates at their rails.

    Parameters
    ----------
    named : mapping of str to ndarray of shape (n,) or (n, c)
        As read: the acceleration in `unit` but for the scale.
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the acceleration.
    scale : float
        Factor from what is stored to `unit`.
    said : iterable of str
        What the reader has told; it is not told twice.
    """
    found = []
    for name in ("turn_rate", "friction"):
        if (signal := named.get(name)) is not None and len(signal):
            share = max(clipped_share(column) for column in signal.reshape(len(signal), -1).T)
            if share >= CLIPPED_SHARE:
                found.append(f"clipped: {100 * share:.1f} % of the samples of the {name} at full scale")
    acceleration = named[ACCELERATION]
    is_told = any(one.startswith("unit:") for one in said)
    if unit not in ACCELERATION_UNITS or acceleration.shape[1:] != (3,) or is_told:
        return tuple(found)
    # over 0.25 s vibration averages out, gravity does not
    n = max(1, min(round(0.25 * fs), len(acceleration)))
    blocks = acceleration[: len(acceleration) // n * n].reshape(-1, n, 3).mean(axis=1)
    level = float(np.median(np.linalg.norm(blocks, axis=1))) * abs(scale)
    gravities = {other: level * size / STANDARD_GRAVITY for other, size in ACCELERATION_UNITS.items()}
    meant = next((other for other, times in gravities.items() if abs(times - 1) <= 0.1), None)
    if not 0.8 <= gravities[unit] <= 1.2:  # of a sensor that measures gravity
        gravity = STANDARD_GRAVITY / ACCELERATION_UNITS[unit]
        rests = f"unit: rests at {level:.3g} {unit}, gravity is {gravity:.3g}"
        if meant:
            found.append(f"{rests}: is it in {meant}? (--unit {meant}, `unit` in a card)")
        elif gravities[unit] > 0.35:  # nor is it removed
            found.append(f"{rests} or none: are unit, scale and columns right?")
    return tuple(found)


def similar_label_notes(surfaces: Iterable[str]) -> list[str]:
    """Return what is unlikely of the names of surfaces: two that differ in case or blanks only."""
    alike: dict[str, list[str]] = {}
    for surface in sorted(set(surfaces)):
        alike.setdefault(" ".join(surface.casefold().split()), []).append(surface)
    return [
        f"surfaces {' and '.join(map(repr, names))} differ in case or blanks only: are they one surface?"
        for names in alike.values()
        if len(names) > 1
    ]


def folder_level_notes(files: Iterable[Sequence[str]]) -> list[str]:
    """Return what is unlikely of a folder's levels, given the parts of its files' names.

    The first level is the label. Where every folder of it holds the same folders, and these are more, or
    where they are called session 1, session 2, the second level will be.
    """
    session = r"(session|run|day|trial|operator|subject|user|participant|person|s|p)[ _-]?\d+"
    below: dict[str, set[str]] = {}
    for parts in files:
        below.setdefault(parts[0], set()).update(parts[1:2] if len(parts) > 2 else ())
    shared = set.intersection(*below.values()) if below else set()
    are_sessions = len(shared) > len(below) or all(
        re.fullmatch(session, name, re.IGNORECASE) for name in below
    )
    if min(len(below), len(shared)) < 2 or not are_sessions:
        return []
    labels, inside = (", ".join(sorted(names)[:4]) for names in (below, shared))
    return [
        f"the labels are {labels}, and each of these folders holds {inside}: "
        "if those are the surfaces, say so in a card: files = '(?P<session>[^/]+)/(?P<surface>[^/]+)/.+'"
    ]
