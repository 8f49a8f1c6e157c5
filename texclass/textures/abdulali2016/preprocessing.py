"""From what the sensors give to a scan that can be segmented: bands, rates and the plane of the surface."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass import signals
from texclass.recording import Samples
from texclass.signals import combine
from texclass.textures.scan import Scan

MOTION_HZ = 25.0
"""Cut-off of position, velocity and force; `abdulali2016`, section 2.2."""
VIBRATION_HZ = (10.0, 1000.0)
"""Band of the acceleration; `abdulali2016`, section 2.2."""
BESSEL_ORDER = 2


def smooth_motion(x: ArrayLike, fs: float, *, cutoff_hz: float = MOTION_HZ) -> Samples:
    """Low-pass what a hand does: Bessel, forwards and backwards, so that nothing is delayed.

    Parameters
    ----------
    x : array_like of shape (n_samples, ...)
        Position, velocity or force.
    fs : float
        Hz.
    cutoff_hz : float
        Where the two passes together take away 6 dB.

    Returns
    -------
    ndarray of the shape of `x`

    Raises
    ------
    ValueError
        If the cut-off is not between 0 and fs/2, there is no sample, or one is not finite.

    References
    ----------
    `abdulali2016`, section 2.2, which gives neither the order (`BESSEL_ORDER` a pass here) nor the direction.
    """
    if not 0 < cutoff_hz < fs / 2:
        raise ValueError(f"cutoff_hz is {cutoff_hz}; the rule is above 0 and below fs/2 = {fs / 2:g} Hz")
    sos = signal.bessel(BESSEL_ORDER, cutoff_hz, fs=fs, norm="mag", output="sos")
    return signals.zero_phase(np.asarray(sos), x)


def limit_vibration(x: ArrayLike, fs: float, *, band_hz: tuple[float, float] = VIBRATION_HZ) -> Samples:
    """Keep the band of the vibration: gravity and the hand go below it, noise above.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Acceleration.
    fs : float
        Hz. Where the upper edge reaches fs/2 (as the printed 1000 Hz does at the printed 1 kHz) the sampling
        has already cut there, and the lower edge alone is left.
    band_hz : tuple of float
        Lower and upper edge.

    Returns
    -------
    ndarray of shape (n_samples,)
        Without delay.

    Raises
    ------
    ValueError
        If the lower edge is not between 0 and fs/2, there is no sample, or one is not finite.

    References
    ----------
    `abdulali2016`, section 2.2.
    """
    low, high = band_hz
    if high >= 0.99 * fs / 2:
        return signals.zero_phase(signals.butterworth("highpass", low, fs), x)
    return signals.zero_phase(signals.butterworth("bandpass", band_hz, fs), x)


def condition(scan: Scan) -> Scan:
    """Return the scan with its motion smoothed and its vibration limited to their bands."""
    position, velocity, force = (
        smooth_motion(x, scan.fs) for x in (scan.position, scan.velocity, scan.force)
    )
    vibration = limit_vibration(scan.acceleration, scan.fs)
    return Scan(vibration, position, velocity, force, scan.fs, scan.name)


def scan_from_sensors(
    acceleration: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    fs: float,
    *,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    name: str = "",
) -> Scan:
    """Return the scan of a tool whose 3D position and force were recorded, conditioned.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, 3)
        m/s^2; axes are combined to one with their spectrum (DFT321).
    position : array_like of shape (n_samples, 3)
        mm.
    force : array_like of shape (n_samples, 3)
        N, of the tool on the surface or back: its part along the normal counts, by its mean as pressing.
    fs : float
        Hz, of all three: bring them to one rate first, see `downsample`.
    normal : array_like of shape (3,)
        Of the surface, of any length.
    name : str, optional
        Of the surface.

    Returns
    -------
    Scan

    Raises
    ------
    ValueError
        If a shape does not fit, the normal is 0, or a value is not finite.

    Notes
    -----
    The velocity is the derivative of the smoothed position (central differences), projected on the plane.

    References
    ----------
    `abdulali2016`, section 2.2.
    """
    plane, n = tangent_axes(normal)
    x, f = np.asarray(position, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or f.shape != x.shape or len(x) < 2:
        raise ValueError(f"position {x.shape} and force {f.shape}; the rule is (n_samples, 3), 2 at least")
    tangential = smooth_motion(x @ plane.T, fs)
    pressing = smooth_motion(f @ n, fs)
    return Scan(
        limit_vibration(combine(acceleration), fs),
        tangential,
        np.gradient(tangential, 1 / fs, axis=0),
        pressing if pressing.mean() >= 0 else -pressing,
        fs,
        name,
    )


def tangent_axes(normal: ArrayLike) -> tuple[Samples, Samples]:
    """Return two unit vectors that span the plane of a surface, (2, 3), and its unit normal, (3,).

    The first is the x axis seen along the normal (the y axis, where x is the normal).
    """
    n = np.asarray(normal, dtype=np.float64)
    length = np.linalg.norm(n)
    if n.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise ValueError(f"normal is {n}; the rule is three finite numbers, not all 0")
    n = n / length
    seen = np.eye(3) - np.outer(n, n)
    first = seen[0] if seen[0] @ seen[0] > 1e-6 else seen[1]
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(n, first)]), n


def downsample(x: ArrayLike, fs: float, to_fs: float) -> Samples:
    """Return a signal at a lower rate, limited to what that holds (linear phase, no delay).

    Parameters
    ----------
    x : array_like of shape (n_samples, ...)
        Along its first axis.
    fs, to_fs : float
        Hz; `fs` a multiple of `to_fs`.

    Raises
    ------
    ValueError
        If it is no multiple.
    """
    ratio = round(fs / to_fs) if to_fs > 0 else 0
    if ratio < 1 or not np.isclose(ratio * to_fs, fs, rtol=1e-9, atol=0):
        raise ValueError(f"fs is {fs} and to_fs {to_fs}; the rule is a multiple")
    samples = np.asarray(x, dtype=np.float64)
    return samples.copy() if ratio == 1 else np.asarray(signal.resample_poly(samples, 1, ratio, axis=0))
