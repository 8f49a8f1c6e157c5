"""A made-up recording whose features tell whether the code that computes them still gives the same values."""

import numpy as np

from texclass.features.extractor import Plan
from texclass.features.phase_view import TURN
from texclass.recording import Phases, Recording, Samples, Tap

SECONDS = 1.5
MOST_SAMPLES = 1_000_000
GOLDEN = 0.6180339887498949
RTOL = 1e-6
"""Relative difference of values between machines and library versions that changes no answer."""


def probe_recording(plan: Plan, fs: float, unit: str) -> Recording:
    """Return a recording with one tap and a movement, the same on every machine.

    Noise is a Weyl sequence, frac(k^2 golden): no generator of random numbers has to stay the same.
    """
    n = max(64, min(round(SECONDS * fs), MOST_SAMPLES))
    turn = tuple(name for name in plan.channels if name in TURN)
    channels = plan.channels[: len(plan.channels) - len(turn)] or ("x", "y", "z")
    axes = np.column_stack([_noise(n, i) for i in range(len(channels))])
    first, last = n // 10, n // 5
    axes[:first] *= 0.01
    axes[first:last] *= np.exp(-np.linspace(0, 8, last - first))[:, None]
    return Recording(
        axes,
        fs=fs,
        unit=unit,
        recording_id="probe",
        channels=channels,
        friction=1 + 0.1 * _noise(n, 7),
        turn_rate=np.column_stack([_noise(n, 8 + i) for i in range(3)]) if turn else None,
        phases=Phases((Tap(first // 2, first, last),), (last, n), last),
    )


def probe_values(plan: Plan, fs: float, unit: str) -> Samples:
    """Return the plan's columns for the probe, shape (n_columns,); NaN where undefined."""
    return plan.compute(probe_recording(plan, fs, unit)).values


def difference(before: Samples, now: Samples, columns: tuple[str, ...]) -> str | None:
    """Return which column differs most between two computations of the probe; None if none does."""
    scale = np.maximum(np.maximum(np.abs(before), np.abs(now)), 1e-9)
    gap = np.abs(before - now) / scale
    gap[np.isnan(before) != np.isnan(now)] = np.inf
    gap = np.nan_to_num(gap, nan=0.0, posinf=np.inf)
    worst = int(gap.argmax())
    return None if gap[worst] <= RTOL else f"{columns[worst]} was {before[worst]:.6g}, is {now[worst]:.6g}"


def _noise(n: int, seed: int) -> Samples:
    k = np.arange(n, dtype=np.float64)
    white = np.modf((k + 1 + 1000 * seed) ** 2 * GOLDEN)[0] - 0.5
    smooth = np.convolve(white, [0.5, 0.3, 0.2], "same")
    return np.asarray(smooth + 0.1 * np.sin(0.05 * (1 + 0.1 * seed) * k))
