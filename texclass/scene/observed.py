"""What is known of a surface: power spectra at speeds and forces, apart for fitting, choosing and proving."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from texclass.recording import Samples
from texclass.scene.judge import Judge

STILL_MM_S, LIGHT_N = 5.0, 0.02
"""Pieces of freehand recordings that are slower or softer are left out."""
MARGIN = 0.25
"""Pieces this part beyond the expected range are still used."""
CELL = 6
"""Pieces of a freehand recording that are judged together: one alone scatters by 4 dB."""
MOST_CELLS = 4
LARGEST_FACTOR = 1000


@dataclass(frozen=True, eq=False)
class Points:
    """Spectra at speeds and forces.

    Attributes
    ----------
    spectra : ndarray of shape (n, n_bins)
        Power densities at the device's rate, unit^2/Hz.
    speed, force : ndarray of shape (n,)
        mm/s and N.
    """

    spectra: Samples
    speed: Samples
    force: Samples

    def __len__(self) -> int:
        return int(self.speed.size)


@dataclass(frozen=True, eq=False)
class Observed:
    """One surface.

    Attributes
    ----------
    name : str
    fit, choose, prove : Points
        What models are fitted to; what order and nodes are chosen by; what the choice is judged on, which
        neither has seen.
    peak : float
        Largest magnitude of the vibration.
    how : str
        What was held out, in words.
    friction : float or None
    """

    name: str
    fit: Points
    choose: Points
    prove: Points
    peak: float
    how: str
    friction: float | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of vibration at one speed (mm/s) and force (N), at the device's rate."""

    samples: Samples
    speed: float
    force: float


def at_rate(x: Samples, fs: float, rate: float) -> Samples:
    """Return a signal at another rate, its mean removed.

    Raises
    ------
    ValueError
        If the rates (Hz) have no ratio of whole numbers up to 1000.
    """
    centred = np.asarray(x - x.mean(), dtype=np.float64)
    if fs == rate:
        return centred
    up, down = (np.rint(np.array([rate, fs]) / np.gcd(round(rate), round(fs)))).astype(int)
    if max(up, down) > LARGEST_FACTOR or abs(up * fs - down * rate) > 1e-9 * up * fs:
        raise ValueError(
            f"rates are {fs:g} and {rate:g} Hz; the rule is a ratio of whole numbers up to {LARGEST_FACTOR}"
        )
    return np.asarray(signal.resample_poly(centred, up, down))


def points_of(pieces: Sequence[Piece], judge: Judge) -> Points:
    """Return the spectra of pieces."""
    spectra = [judge.spectrum(piece.samples) for piece in pieces]
    return Points(np.array(spectra), np.array([p.speed for p in pieces]), np.array([p.force for p in pieces]))


def cells_of(points: Points) -> Points:
    """Return the means of neighbours in speed: at most 4 groups, 6 pieces or more in each where possible."""
    n = int(np.clip(len(points) // CELL, 1, MOST_CELLS))
    groups = np.array_split(np.argsort(points.speed, kind="stable"), n)
    means = [
        [getattr(points, name)[g].mean(axis=0) for g in groups] for name in ("spectra", "speed", "force")
    ]
    return Points(*map(np.array, means))


def segments(
    x: Samples,
    speed: Samples,
    force: Samples,
    judge: Judge,
    expected: tuple[tuple[float, float], tuple[float, float]],
) -> list[Piece]:
    """Cut a freehand recording into pieces of one segment each, within what is expected of the hand."""
    n = judge.n_segment
    starts = range(0, x.size - n + 1, n)
    pieces = [
        Piece(x[i : i + n], float(speed[i : i + n].mean()), float(force[i : i + n].mean())) for i in starts
    ]
    (slow, fast), (light, hard) = expected
    return [
        piece
        for piece in pieces
        if max(STILL_MM_S, slow * (1 - MARGIN)) <= piece.speed <= fast * (1 + MARGIN)
        and max(LIGHT_N, light * (1 - MARGIN)) <= piece.force <= hard * (1 + MARGIN)
    ]


def of_segments(name: str, pieces: Sequence[Piece], judge: Judge, friction: float | None) -> Observed:
    """Divide pieces of freehand recordings in time: of four, two to fit, one to choose, one to prove."""
    if len(pieces) < 8:
        raise ValueError(
            f"surface {name}: {len(pieces)} pieces of {judge.n_segment / judge.device.rate_hz:.2g} s within "
            "the expected speeds and forces; the rule is at least 8"
        )
    fit = points_of([p for i, p in enumerate(pieces) if i % 2 == 0], judge)
    choose, proved = (cells_of(points_of(pieces[i::4], judge)) for i in (1, 3))
    peak = max(float(np.abs(p.samples).max()) for p in pieces)
    how = f"pieces 2 and 4 of every 4, {judge.n_segment / judge.device.rate_hz:.2g} s each"
    return Observed(name, fit, choose, proved, peak, how, friction)


def of_speeds(name: str, pieces: Sequence[Piece], judge: Judge, friction: float | None) -> Observed:
    """Divide recordings at known speeds: every second speed is held out, if there are three or more."""
    speeds = sorted({piece.speed for piece in pieces})
    out = set(speeds[1:-1:2])
    held = [p for p in pieces if p.speed in out] or list(pieces)
    quarters = (0.0, 0.5, 1.0) if out else (0.5, 0.75, 1.0)
    fit = [p for p in pieces if p.speed not in out] if out else [_cut(p, 0.0, 0.5) for p in pieces]
    choose = [_cut(p, *quarters[:2]) for p in held]
    prove = [_cut(p, *quarters[1:]) for p in held]
    if min(p.samples.size for p in (*fit, *choose, *prove)) < judge.n_segment:
        raise ValueError(
            f"surface {name}: a part of a recording is shorter than {judge.n_segment} samples at the "
            "device's rate; the rule is longer recordings"
        )
    peak = max(float(np.abs(p.samples).max()) for p in pieces)
    how = f"speeds {', '.join(f'{v:g}' for v in sorted(out))} mm/s" if out else "the later halves"
    points = [points_of(part, judge) for part in (fit, choose, prove)]
    return Observed(name, points[0], points[1], points[2], peak, how, friction)


def _cut(piece: Piece, begin: float, end: float) -> Piece:
    n = piece.samples.size
    return Piece(piece.samples[int(begin * n) : int(end * n)], piece.speed, piece.force)
