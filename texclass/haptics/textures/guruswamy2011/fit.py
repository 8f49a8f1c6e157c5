"""From the scan of a surface to its texture: band-pass, segment, one filter a segment, placed in space."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from texclass import signals
from texclass.haptics.textures.guruswamy2011.texture import (
    Amplitude,
    Course,
    LevelLaw,
    SinusoidTexture,
    SpatialTexture,
)
from texclass.haptics.textures.scan import Scan
from texclass.recording import Samples
from texclass.vibration.decaying_modes import NO_MODES, DecayingModes, fit_amplitudes, fit_matrix_pencil
from texclass.vibration.rising_peaks import Segmentation, VibrationBand, segment_rising_peaks, vibration_band

LOWER_HZ = 0.122
"""Lower limit of the band, `guruswamy2011` section V-A; 500 / 4096 and 1000 / 8192 Hz."""
PATH_CUTOFF_HZ = 10.0
"""Low-pass of force and speed (f_lowpass). The paper gives none; a hand is slower than that."""
RESOLUTION = 0.153
"""One bit of the paper's sensor, m/s^2 (2 g / 128)."""
SMOOTHING_HZ = 3.0
"""Standard deviation of the Gaussian that low-passes the spectrum. The paper names none; ours."""
HIGHEST = 0.9
"""An upper cut-off above that part of fs/2 would only turn the phase of what it keeps: none is applied."""

Phase = Literal["causal", "zero"]


# How strongly a surface vibrates ----------------------------------------------------------------------------


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


def fit_level_law(scans: Sequence[Scan], k_c: float | None = None) -> LevelFit:
    """Regress the law on repeated scans of one surface at different speeds.

    Least squares of the deviation relative to the level: two scans of one kind differ by some per cent, not
    by some m/s^2, so that weak scans know a_0 best.

    Parameters
    ----------
    scans : sequence of Scan
        At least 2, of different mean speed; at least 3, of different mean force, too, without `k_c`.
    k_c : float, optional
        Force factor known from elsewhere, as the paper takes it; regressed with the others by default.

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
            f"scans at {speed} mm/s and {force} N of RMS {rms}. Expected {design.shape[1]} scans or more "
            "that differ in speed (and in force, if k_c is not given), not silent"
        )
    weight = np.ones_like(rms)
    for _ in range(5):
        weighted = design * weight[:, np.newaxis]
        size = np.linalg.norm(weighted, axis=0)
        found = nnls(weighted / size, (rms - known) * weight)[0] / size
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
    both = signals.lowpass(np.column_stack([scan.speed, scan.force]), cutoff, scan.fs)
    return np.maximum(both[:, 0], 0.0), np.maximum(both[:, 1], 0.0)


def normalised(scan: Scan, amplitude: Amplitude) -> Samples:
    """Return the acceleration as it would be at the constant speed and force of `amplitude`, (n_samples,)."""
    factor = amplitude.factor(*smoothed_path(scan))
    return np.asarray(scan.acceleration / np.maximum(factor, 1 / 16))


# Band and segments ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BandedVibration:
    """A vibration within its band.

    Attributes
    ----------
    samples : ndarray of shape (n_samples,)
        Unit of the acceleration.
    band : VibrationBand
        Major frequency and automatic cut-off, Hz.
    cutoff_hz : float
        Upper cut-off that was used: that of the band, or fs/2 where that lies above `HIGHEST` fs/2.
    segmentation : Segmentation
    """

    samples: Samples
    band: VibrationBand
    cutoff_hz: float
    segmentation: Segmentation


def band_of(acceleration: ArrayLike, fs: float) -> VibrationBand:
    """Return major frequency and automatic upper cut-off of a vibration.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Any unit; a linear trend is left out.
    fs : float
        Hz.

    References
    ----------
    `guruswamy2011`, eq. (6) and (7), between 0.122 Hz and fs/2.
    """
    a = np.asarray(acceleration, dtype=np.float64)
    n_fft = max(a.size, int(2 ** np.ceil(np.log2(fs / LOWER_HZ))))
    f, power = signal.periodogram(signal.detrend(a), fs, nfft=n_fft, detrend=False)
    return vibration_band(f[f >= LOWER_HZ], power[f >= LOWER_HZ], smoothing_hz=SMOOTHING_HZ)


def profile_of(
    acceleration: ArrayLike,
    fs: float,
    *,
    resolution: float = RESOLUTION,
    phase: Phase = "causal",
) -> BandedVibration:
    """Band-pass an acceleration by a 4th-order Butterworth filter and cut it where peaks rise.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Normalised to one speed and force. Not silent.
    fs : float
        Hz.
    resolution : float
        Of the sensor, in the unit of the acceleration; the dead band is twice that.
    phase : {"causal", "zero"}
        "causal": forwards once, then moved back by the delay at the major frequency (whole samples). "zero":
        forwards and backwards. See the notes.

    Returns
    -------
    BandedVibration

    Raises
    ------
    ValueError
        For silence, NaN or infinity, or fewer than 8 samples.

    Notes
    -----
    The paper does not say which. A filter that runs backwards, too, rings *before* each onset: the peaks then
    rise in steps, and the rule of rising peaks cuts the onset into several segments (a quarter to a half more
    of them on the simulated regular surfaces). Forwards only, what decayed still decays, and the edges are at
    -3 dB as designed instead of -6 dB; the delay of some samples is known and taken back.

    References
    ----------
    `guruswamy2011`, sections IV-B, IV-C and V-A.
    """
    a = np.asarray(acceleration, dtype=np.float64)
    if a.ndim != 1 or a.size < 8 or not np.all(np.isfinite(a)) or np.ptp(a) == 0:
        raise ValueError(
            f"acceleration has shape {a.shape}. Expected at least 8 samples of one channel, "
            "finite, not constant"
        )
    band = band_of(a, fs)
    is_wide = band.upper_hz > HIGHEST * fs / 2
    cutoff = fs / 2 if is_wide else band.upper_hz
    edges = LOWER_HZ if is_wide else (LOWER_HZ, cutoff)
    sos = signals.butterworth("highpass" if is_wide else "bandpass", edges, fs)
    a = a - np.mean(a)
    if phase == "zero":
        samples = signals.zero_phase(sos, a)
    else:
        # the group delay -d phi / d omega at the major frequency, in whole samples
        around = np.clip([band.major_hz - 0.5, band.major_hz + 0.5], LOWER_HZ, 0.499 * fs)
        H = signal.freqz_sos(sos, around, fs=fs)[1]
        turned = np.angle(H[0] * np.conj(H[1]))
        samples_late = round(float(turned / (2 * np.pi * (around[1] - around[0])) * fs))
        delay = min(max(samples_late, 0), a.size - 1)
        samples = signals.causal(sos, np.pad(a, (0, delay), mode="edge"))[0][delay:]
    return BandedVibration(samples, band, cutoff, segment_rising_peaks(samples, 2 * resolution))


# One filter per segment -------------------------------------------------------------------------------------

RING_S = 0.5
"""A filter has fallen by 60 dB after that long, at the latest."""
LEAST_DECAY = float(np.log(1000) / RING_S)
MAX_POLES = 24
"""Largest order of a filter: it bounds what a feature costs to render, and to fit."""
CANCELLING = 100.0
"""A fit whose modes exceed the segment's peak by that factor, and so nearly cancel, is not taken."""

Method = Literal["modes", "sinusoid"]


@dataclass(frozen=True, eq=False)
class Responses:
    """Filters of consecutive segments.

    Attributes
    ----------
    start : ndarray of int, shape (n_segments,)
        First sample of each segment.
    modes : tuple of DecayingModes
        The filter of each; one without modes adds nothing to what still rings.
    """

    start: NDArray[np.int64]
    modes: tuple[DecayingModes, ...]

    def sum(self, n_samples: int, fs: float) -> Samples:
        """Return the sum of all filters, each struck at its start: eq. (5) at the speed of the scan."""
        total = np.zeros(n_samples)
        for start, modes in zip(self.start, self.modes, strict=True):
            stop = min(start + _ring_samples(fs), n_samples)
            total[start:stop] += modes.synthesize(stop - start, fs)
        return total


def fit_responses(
    x: Samples, bounds: Sequence[int], fs: float, resolution: float, *, method: Method = "modes"
) -> Responses:
    """Fit one filter to each segment of a profile.

    What earlier filters still ring is taken off a segment before it is fitted, so that the sum of all filters
    is the profile again; fitted alone, as printed, the sum has tails on top.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        The profile.
    bounds : sequence of int
        Segment i holds the samples bounds[i] ... bounds[i + 1] - 1.
    fs : float
        Hz.
    resolution : float
        Mean absolute error to reach, in the unit of `x`.
    method : {"modes", "sinusoid"}
        `fit_modes`, or one decaying sinusoid, eq. (3).

    Returns
    -------
    Responses

    References
    ----------
    `guruswamy2011`, section IV-A.
    """
    rest = np.array(x, dtype=np.float64)
    fitted = []
    for start, stop in pairwise(bounds):
        piece = rest[start:stop]
        modes = fit_modes(piece, fs, resolution) if method == "modes" else fit_sinusoid(piece, fs)
        fitted.append(modes)
        end = min(start + _ring_samples(fs), rest.size)
        rest[start:end] -= modes.synthesize(end - start, fs)
    return Responses(np.asarray(bounds[:-1]), tuple(fitted))


def fit_modes(piece: Samples, fs: float, resolution: float) -> DecayingModes:
    """Fit decaying modes of about the least number of poles that meets the resolution.

    The number of poles is doubled until the mean absolute error of the segment falls below the resolution,
    then halved back; without success the fit of the least error counts. All modes decay by 60 dB in `RING_S`
    at the latest.

    Parameters
    ----------
    piece : ndarray of shape (n_samples,)
        Segment.
    fs : float
        Hz.
    resolution : float
        In the unit of `piece`, above 0.

    Returns
    -------
    DecayingModes
        None at all for a segment below the resolution.
    """
    if np.mean(np.abs(piece)) < resolution:
        return NO_MODES
    x = np.pad(piece, (0, max(0, 8 - piece.size)))  # short segments are continued by zeros, as printed
    tried: dict[int, tuple[float, DecayingModes]] = {}

    def error(order: int) -> float:
        if order not in tried:
            modes = fit_matrix_pencil(x, fs, order=order)
            if modes.decay_per_s.min(initial=LEAST_DECAY) < LEAST_DECAY:
                faster = np.maximum(modes.decay_per_s, LEAST_DECAY)
                modes = fit_amplitudes(x, modes.frequency_hz, faster, fs)
            missed = float(np.mean(np.abs(modes.synthesize(piece.size, fs) - piece)))
            moderate = np.max(modes.amplitude, initial=0.0) <= CANCELLING * np.max(np.abs(x))
            tried[order] = missed if moderate else np.inf, modes
        return tried[order][0]

    low, high, highest = 0, 2, min(x.size // 2, MAX_POLES)
    while error(high) >= resolution and high < highest:
        low, high = high, min(2 * high, highest)
    while high - low > 1 and tried[high][0] < resolution:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) < resolution else (middle, high)
    best = tried[high] if tried[high][0] < resolution else min(tried.values(), key=lambda each: each[0])
    return best[1] if np.isfinite(best[0]) else fit_sinusoid(piece, fs)


def fit_sinusoid(piece: Samples, fs: float) -> DecayingModes:
    """Fit a(t) = A exp(-beta t) sin(omega t) to a segment by least squares, A of either sign.

    For given beta and omega, A is the projection of the segment on the shape; beta and omega are searched on
    a grid that is narrowed four times about its best point.

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), after `okamura2001`, whose fit from peaks and spectrum needs two peaks.
    """
    if piece.size < 2 or not np.any(piece):  # every shape begins with 0
        return NO_MODES
    t = np.arange(piece.size) / fs
    low = np.log([LEAST_DECAY, 0.25 / max(t[-1], 1 / fs)])
    high = np.log([2 * fs, 0.49 * fs])
    for _ in range(5):
        B, f = (np.exp(axis) for axis in np.meshgrid(*np.linspace(low, high, 24).T))
        shape = np.exp(-B.ravel()[:, np.newaxis] * t) * np.sin(2 * np.pi * f.ravel()[:, np.newaxis] * t)
        size = np.maximum(np.linalg.norm(shape, axis=1), np.finfo(float).tiny)
        best = int(np.argmax(np.abs(shape @ piece / size)))
        centre, half = np.log([B.ravel()[best], f.ravel()[best]]), (high - low) / 8
        low, high = np.maximum(centre - half, low), np.minimum(centre + half, high)
    A = shape[[best]] @ piece / size[best] ** 2
    return DecayingModes(f.ravel()[[best]], B.ravel()[[best]], np.abs(A), np.where(A >= 0, -0.5, 0.5) * np.pi)


def _ring_samples(fs: float) -> int:
    """Three times `RING_S`: 180 dB."""
    return int(3 * RING_S * fs)


# The texture ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FittedScan:
    """A scan on its way to a texture, with what was found on the way.

    Attributes
    ----------
    scan : Scan
    normalised : ndarray of shape (n_samples,)
        Acceleration as at the mean speed and force.
    profile : BandedVibration
        That within its band, and its segments.
    responses : Responses
        One filter per segment.
    texture : SpatialTexture
    """

    scan: Scan
    normalised: Samples = field(repr=False)
    profile: BandedVibration
    responses: Responses
    texture: SpatialTexture


def fit_texture(
    scan: Scan,
    law: LevelLaw = LevelLaw(k_v=0.0, k_c=0.0, a_0=1.0),  # noqa: B008  frozen
    *,
    resolution: float = RESOLUTION,
    method: Method = "modes",
    compensated: bool = True,
    course: Course = "line",
) -> FittedScan:
    """Fit a texture to the scan of a surface.

    Parameters
    ----------
    scan : Scan
        One stroke, at best slow and steady: features that come before the last has decayed merge.
    law : LevelLaw
        Of the surface, from `fit_level_law`; by default speed and force change nothing.
    resolution : float
        One bit of the sensor, in the unit of the acceleration.
    method : {"modes", "sinusoid"}
        Filters of the order that each segment needs, or one decaying sinusoid each (the baseline).
    compensated : bool
        See `Amplitude`.
    course : {"line", "travelled"}
        See `SpatialTexture`.

    Returns
    -------
    FittedScan

    Raises
    ------
    ValueError
        If the tip does not move, the acceleration is silent, or nothing in it exceeds the resolution.

    References
    ----------
    `guruswamy2011`, sections III and IV.
    """
    length = scan.distance_mm[-1]
    speed = float(scan.speed.mean())
    if not (length > 0 and speed > 0):
        raise ValueError(
            f"scan {scan.name!r} is {length:g} mm long at {speed:g} mm/s. Expected a stroke that moves"
        )
    scaling = Amplitude(law, speed, max(float(scan.force.mean()), 0.0), compensated)
    a = normalised(scan, scaling)
    profile = profile_of(a, scan.fs, resolution=resolution)
    bounds = profile.segmentation.bounds.tolist()
    responses = fit_responses(profile.samples, bounds, scan.fs, resolution, method=method)
    kept = [i for i, modes in enumerate(responses.modes) if modes.n_modes]
    if not kept:
        raise ValueError(
            f"scan {scan.name!r} never exceeds the resolution. Expected a stronger vibration, "
            "or a smaller resolution"
        )
    modes = [responses.modes[i] for i in kept]
    # each filter begins where its segment does: along the path, half a sample before the start
    x, start = scan.distance_mm, responses.start[kept]
    passed = (x[np.maximum(start - 1, 0)] + x[start]) / 2
    # the line is the first principal axis of the path, from start to end
    axis = np.linalg.svd(scan.position - scan.position.mean(axis=0), full_matrices=False)[2][0]
    direction = -axis if (scan.position[-1] - scan.position[0]) @ axis < 0 else axis
    f, B, A, phi = np.concatenate([m.table for m in modes]).T
    texture = (SinusoidTexture if method == "sinusoid" else SpatialTexture)(
        name=scan.name,
        fs=scan.fs,
        length_mm=max(float(x[-1]), float(np.nextafter(passed[-1], np.inf))),
        position_mm=passed,
        feature=np.repeat(np.arange(float(len(kept))), [m.n_modes for m in modes]),
        frequency_hz=f,
        decay_per_s=B,
        amplitude=A,
        phase=phi,
        scaling=scaling,
        peak=float(np.max(np.abs(profile.samples))),
        direction=direction,
        course=course,
        origin_mm=float(scan.position[0] @ direction),
    )
    return FittedScan(scan, a - a.mean(), profile, responses, texture)
