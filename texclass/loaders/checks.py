"""What can be wrong with a signal that was read without error: too short, constant, clipped."""

from collections.abc import Sequence

import numpy as np

from texclass.recording import RecordingError, Samples

CLIPPED_RUN = 3
"""Samples in a row at the extreme value that count as clipped."""
CLIPPED_SHARE = 1e-3
"""Share of clipped samples from which a recording is flagged."""
MOST_LEVELS = 10_000_000
"""Samples in which the quantisation step is looked for."""
BLOCK = 1 << 20
"""Samples searched for runs at a time."""


def check_acceleration(acceleration: Samples, channels: Sequence[str], where: str) -> tuple[str, ...]:
    """Return what a user should know of an acceleration ("clipped: ...", "constant: ...").

    Raises
    ------
    RecordingError
        If there are fewer than two samples, or no channel varies.
    """
    columns = acceleration.reshape(len(acceleration), -1)
    if len(columns) < 2:
        raise RecordingError(f"{where}: holds {len(columns)} sample; the rule is at least 2")
    constant = np.ptp(columns, axis=0) == 0
    if constant.all():
        raise RecordingError(
            f"{where}: acceleration is {columns[0].tolist()} throughout; the rule is a channel that varies"
        )
    dead = [f"constant: channel {name}" for name, is_dead in zip(channels, constant, strict=True) if is_dead]
    share = max(clipped_share(columns[:, i]) for i in np.flatnonzero(~constant))
    clipped = [f"clipped: {100 * share:.1f} % of the samples at full scale"] if share >= CLIPPED_SHARE else []
    return (*dead, *clipped)


def clipped_share(signal: Samples) -> float:
    """Return the share of samples that stand in a run at the signal's largest or smallest value.

    A run is at least `CLIPPED_RUN` equal samples that the signal enters or leaves by more than two
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
    runs = [run for extreme in (signal.min(), signal.max()) for run in _runs_at(signal, extreme)]
    if not runs:
        return 0.0
    levels = np.unique(signal[:MOST_LEVELS])
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    clipped = sum(last - first for first, last in runs if _jump(signal, first, last) > 2 * step)
    return clipped / len(signal)


def _runs_at(signal: Samples, extreme: float) -> list[tuple[int, int]]:
    """Return half-open ranges of at least `CLIPPED_RUN` samples that equal `extreme`."""
    starts = range(0, len(signal), BLOCK)
    where = np.concatenate([k + np.flatnonzero(signal[k : k + BLOCK] == extreme) for k in starts])
    ends = np.flatnonzero(np.diff(where, append=np.inf) > 1)
    last = where[ends] + 1
    first = where[np.concatenate(([0], ends[:-1] + 1))]
    long = last - first >= CLIPPED_RUN
    return list(zip(first[long].tolist(), last[long].tolist(), strict=True))


def _jump(signal: Samples, first: int, last: int) -> float:
    """Return the larger of the steps by which the signal enters and leaves a run."""
    before = abs(signal[first - 1] - signal[first]) if first > 0 else 0.0
    after = abs(signal[last] - signal[last - 1]) if last < len(signal) else 0.0
    return float(max(before, after))
