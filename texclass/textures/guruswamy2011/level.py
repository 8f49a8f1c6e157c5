"""How strongly a surface vibrates at a speed and a force: the law, its regression, and the gain it gives."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.recording import Samples
from texclass.signals import lowpass
from texclass.textures.scan import Scan

LOWER_HZ = 0.122
"""Lower limit of the band, `guruswamy2011` section V-A; 500 / 4096 and 1000 / 8192 Hz."""
PATH_CUTOFF_HZ = 10.0
"""Low-pass of force and speed (f_lowpass). The paper gives none; a hand is slower than that."""


@dataclass(frozen=True)
class LevelLaw:
    """RMS acceleration of a tool that strokes a surface: a_RMS = k_v v_t + k_c f + a_0.

    Attributes
    ----------
    k_v : float
        Speed factor, (m/s^2) / (m/s) = 1/s; at least 0.
    k_c : float
        Force factor, (m/s^2) / N; at least 0.
    a_0 : float
        Offset, m/s^2; at least 0. Not all three are 0.

    Raises
    ------
    ValueError
        For a factor that breaks its rule.

    References
    ----------
    `guruswamy2011`, eq. (2); with k_v = 0 eq. (1).
    """

    k_v: float
    k_c: float
    a_0: float

    def __post_init__(self) -> None:
        values = np.array([self.k_v, self.k_c, self.a_0])
        if not (np.all(np.isfinite(values)) and np.all(values >= 0) and np.any(values > 0)):
            raise ValueError(f"{self}; the rule is finite, at least 0, and not all 0")

    def rms(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return a_RMS (m/s^2) at a speed in mm/s and a force in N."""
        v_t = np.asarray(speed, dtype=np.float64) / 1000
        return np.asarray(self.k_v * v_t + self.k_c * np.asarray(force, dtype=np.float64) + self.a_0)


@dataclass(frozen=True, eq=False)
class LevelFit:
    """A law found from repeated scans, and the scans it was found from.

    Attributes
    ----------
    law : LevelLaw
    speed, force, rms : ndarray of shape (n_scans,)
        Means (mm/s, N) and RMS acceleration (m/s^2) of the scans.
    r_squared : float
        Part of the variance of the RMS (without the share of a given k_c) that the law explains.
    """

    law: LevelLaw
    speed: Samples
    force: Samples
    rms: Samples
    r_squared: float


def fit_level_law(
    scans: Sequence[Scan], k_c: float | None = None, *, weighting: Literal["equal", "relative"] = "relative"
) -> LevelFit:
    """Regress the law on repeated scans of one surface at different speeds.

    Parameters
    ----------
    scans : sequence of Scan
        At least 2, of different mean speed; at least 3, of different mean force, too, without `k_c`.
    k_c : float, optional
        Force factor known from elsewhere, as the paper takes it; regressed with the others by default.
    weighting : {"equal", "relative"}
        Least squares as printed, or of the deviation relative to the level: two scans of one kind differ by
        some per cent, not by some m/s^2, so that weak scans know a_0 best.

    Returns
    -------
    LevelFit
        Factors that would come out negative are held at 0.

    Raises
    ------
    ValueError
        For too few scans, scans that do not differ, or silence.

    References
    ----------
    `guruswamy2011`, section III (eq. 2), section V-B, figure 10.
    """
    from scipy.optimize import nnls

    speed, force, rms = np.array([scan_level(scan) for scan in scans]).reshape(-1, 3).T
    known = np.zeros_like(rms) if k_c is None else k_c * force
    design = np.column_stack([speed / 1000, *([force] if k_c is None else []), np.ones_like(speed)])
    if np.linalg.matrix_rank(design) < design.shape[1] or not np.any(rms):
        raise ValueError(
            f"scans at {speed} mm/s and {force} N of RMS {rms}; the rule is {design.shape[1]} scans or more "
            "that differ in speed (and in force, if k_c is not given), not silent"
        )
    weight = np.ones_like(rms)
    for _ in range(1 if weighting == "equal" else 5):
        weighted = design * weight[:, np.newaxis]
        size = np.linalg.norm(weighted, axis=0)
        found = nnls(weighted / size, (rms - known) * weight)[0] / size
        if weighting == "relative":
            weight = 1 / np.maximum(design @ found + known, 1e-3 * rms.max())
    k_v, k_f, a_0 = (found[0], k_c, found[1]) if k_c is not None else found
    rest, spread = rms - known - design @ found, rms - known - np.mean(rms - known)
    explained = 1 - float(rest @ rest) / max(float(spread @ spread), np.finfo(float).tiny)
    return LevelFit(LevelLaw(float(k_v), float(k_f), float(a_0)), speed, force, rms, explained)


def scan_level(scan: Scan) -> tuple[float, float, float]:
    """Return mean speed (mm/s), mean force (N) and RMS acceleration (m/s^2) of a scan.

    Of the acceleration only a linear trend is left out: the law speaks of all that was felt, and over the
    seconds of a fast scan a filter at `LOWER_HZ` would mostly show its own transient.
    """
    a = signal.detrend(scan.acceleration)
    return float(scan.speed.mean()), float(scan.force.mean()), float(np.sqrt(np.mean(a**2)))


def smoothed_path(scan: Scan) -> tuple[Samples, Samples]:
    """Return speed (mm/s) and force (N) of a scan below `PATH_CUTOFF_HZ`, not negative."""
    cutoff = min(PATH_CUTOFF_HZ, 0.4 * scan.fs)
    both = lowpass(np.column_stack([scan.speed, scan.force]), cutoff, scan.fs)
    return np.maximum(both[:, 0], 0.0), np.maximum(both[:, 1], 0.0)


@dataclass(frozen=True)
class Amplitude:
    """The factor A_k of eq. (5) at a speed and a force: 1 where the surface was scanned.

    Attributes
    ----------
    law : LevelLaw
    speed : float
        Of the scan, mm/s, above 0.
    force : float
        Of the scan, N, at least 0.
    compensated : bool
        Whether faster strokes, which meet more features per second, are weakened for that, see `factor`.
    limit : float
        Largest factor, above 0.

    Raises
    ------
    ValueError
        If speed, force or limit break their rule, or the law is 0 there.
    """

    law: LevelLaw
    speed: float
    force: float
    compensated: bool = True
    limit: float = 4.0

    def __post_init__(self) -> None:
        values = np.array([self.speed, self.force, self.limit])
        if not (np.all(np.isfinite(values)) and self.speed > 0 and self.force >= 0 and self.limit > 0):
            raise ValueError(
                f"speed, force, limit are {self.speed} mm/s, {self.force} N, {self.limit}; "
                "the rule is above 0, at least 0, above 0"
            )
        with np.errstate(over="ignore"):
            level = float(self.law.rms(self.speed, self.force))
        if not 0 < level < np.inf:
            raise ValueError(
                f"{self.law} is {level} at {self.speed} mm/s, {self.force} N; the rule is finite, above 0"
            )

    def factor(self, speed: ArrayLike, force: ArrayLike) -> Samples:
        """Return A = a_RMS(v, f) / a_RMS(v_0, f_0) sqrt(v_0 / max(v, v_0)), at most `limit`.

        Eq. (2) is a law of the RMS of the whole vibration. Responses that overlap add in power, so a stroke
        twice as fast has sqrt(2) times the RMS without any change of amplitude; the root takes that back, and
        the rendered vibration obeys eq. (2). Without `compensated` it is left out, as the paper may be read.
        Slower than the scan the features stand alone and keep the amplitude of the law.
        """
        v = np.asarray(speed, dtype=np.float64)
        A = self.law.rms(v, force) / self.law.rms(self.speed, self.force)
        if self.compensated:
            A = A * np.sqrt(self.speed / np.maximum(v, self.speed))
        return np.minimum(A, self.limit)


def normalised(scan: Scan, amplitude: Amplitude) -> Samples:
    """Return the acceleration as it would be at the constant speed and force of `amplitude`, (n_samples,)."""
    factor = amplitude.factor(*smoothed_path(scan))
    return np.asarray(scan.acceleration / np.maximum(factor, 1 / 16))
