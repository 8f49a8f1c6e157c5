"""Fit spatial textures to scans: level law, band-pass filter, segmentation, and one filter per segment."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, signal

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
"""Lower limit of the band in Hz: 500 / 4096 and 1000 / 8192 in `guruswamy2011`, section V-A."""
PATH_CUTOFF_HZ = 10.0
"""Low-pass cut-off of force and speed in Hz (f_lowpass). The paper specifies no value; hand motion is slower
(our choice)."""
RESOLUTION = 0.153
"""Resolution of the sensor used in the paper: one bit in m/s^2 (2 g / 128)."""
SMOOTHING_HZ = 3.0
"""Standard deviation in Hz of the Gaussian that smooths the spectrum; not in the paper (our choice)."""
MAX_CUTOFF_FRACTION = 0.9
"""Fraction of fs/2 above which no upper cut-off is applied, since it would only change the phase."""

DELAY_STEPS = 16
"""Steps per sample in which the delay of the filter is found (our choice)."""

Phase = Literal["causal", "zero"]


# Law of the level -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LevelFit:
    """A level law, and the scans to which it was fitted.

    Attributes
    ----------
    law : LevelLaw
        Fitted law.
    speed, force, rms : ndarray of shape (n_scans,)
        Mean speed (mm/s), mean force (N) and RMS acceleration (m/s^2) of the scans.
    r_squared : float
        Fraction of the variance of the RMS that the law explains. If k_c is known, the force term k_c f is
        subtracted first.
    """

    law: LevelLaw
    speed: Samples
    force: Samples
    rms: Samples
    r_squared: float


def fit_level_law(scans: Sequence[Scan], k_c: float | None = None) -> LevelFit:
    """Fit the level law to repeated scans of one surface at different speeds.

    Relative deviations are minimised by iteratively reweighted least squares, because the deviation between
    repeated scans is proportional to the level. Weak scans therefore determine a_0.

    Parameters
    ----------
    scans : sequence of Scan
        At least two scans with different mean speeds. Without `k_c`, at least three, with different mean
        forces as well.
    k_c : float, optional
        Force factor from a separate measurement, as in the paper. By default, it is fitted like the other
        factors.

    Returns
    -------
    LevelFit
        Fitted law, with non-negative factors.

    Raises
    ------
    ValueError
        If there are too few scans, all scans are silent, or their speeds or forces do not differ as required.

    References
    ----------
    `guruswamy2011`, section III (eq. 2), section V-B, figure 10.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(2000)
    >>> scans = [Scan.along_line(k * noise, 20.0 * k, 1.0, fs=1000.0) for k in (1, 2, 4)]
    >>> law = fit_level_law(scans, k_c=0.0).law
    >>> round(law.k_v), round(law.a_0, 3)
    (50, 0.0)
    """
    from scipy.optimize import nnls

    speed, force, rms = np.array([scan_level(scan) for scan in scans]).reshape(-1, 3).T
    offset = np.zeros_like(rms) if k_c is None else k_c * force
    design = np.column_stack([speed / 1000, *([force] if k_c is None else []), np.ones_like(speed)])
    if np.linalg.matrix_rank(design) < design.shape[1] or not np.any(rms):
        raise ValueError(
            "scans must differ in speed (without k_c, also in force), not be silent, and number at least "
            f"{design.shape[1]}, got {speed} mm/s and {force} N with RMS {rms}"
        )
    weight = np.ones_like(rms)
    for _ in range(5):
        weighted = design * weight[:, np.newaxis]
        size = np.linalg.norm(weighted, axis=0)
        factors = nnls(weighted / size, (rms - offset) * weight)[0] / size
        weight = 1 / np.maximum(design @ factors + offset, 1e-3 * rms.max())
    k_v, k_f, a_0 = (factors[0], k_c, factors[1]) if k_c is not None else factors
    residual, spread = rms - offset - design @ factors, rms - offset - np.mean(rms - offset)
    explained = 1 - float(residual @ residual) / max(float(spread @ spread), np.finfo(float).tiny)
    return LevelFit(LevelLaw(float(k_v), float(k_f), float(a_0)), speed, force, rms, explained)


def scan_level(scan: Scan) -> tuple[float, float, float]:
    """Return the mean speed (mm/s), mean force (N) and RMS acceleration (m/s^2) of a scan.

    Only a linear trend is removed from the acceleration, because the law describes the whole vibration. In a
    fast scan of a few seconds, the output of a filter at `LOWER_HZ` would be mostly its own transient.

    Examples
    --------
    >>> scan = Scan.along_line(np.sin(np.arange(1000)), speed=20.0, force=0.5, fs=500.0)
    >>> speed, force, rms = scan_level(scan)
    >>> speed, force, round(rms, 2)
    (20.0, 0.5, 0.71)
    """
    a = signal.detrend(scan.acceleration)
    return float(scan.speed.mean()), float(scan.force.mean()), float(np.sqrt(np.mean(a**2)))


def smooth_path(scan: Scan) -> tuple[Samples, Samples]:
    """Return the speed (mm/s) and force (N) of a scan, low-pass filtered at `PATH_CUTOFF_HZ`; at least 0."""
    cutoff = min(PATH_CUTOFF_HZ, 0.4 * scan.fs)
    both = signals.lowpass(np.column_stack([scan.speed, scan.force]), cutoff, scan.fs)
    return np.maximum(both[:, 0], 0.0), np.maximum(both[:, 1], 0.0)


def normalise_acceleration(scan: Scan, amplitude: Amplitude) -> Samples:
    """Normalise the acceleration (n_samples,) to the constant speed and force of `amplitude`.

    Examples
    --------
    The force of this scan is twice the reference force:

    >>> law = LevelLaw(k_v=0.0, k_c=2.0, a_0=0.0)
    >>> scan = Scan.along_line(2 * np.ones(100), speed=20.0, force=1.0, fs=500.0)
    >>> normalise_acceleration(scan, Amplitude(law, speed=20.0, force=0.5)).round(3)[:2].tolist()
    [1.0, 1.0]
    """
    factor = amplitude.factor(*smooth_path(scan))
    return np.asarray(scan.acceleration / np.maximum(factor, 1 / 16))


# Band and segments ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BandedVibration:
    """A band-pass filtered vibration and its segmentation.

    Attributes
    ----------
    samples : ndarray of shape (n_samples,)
        Vibration in the unit of the acceleration.
    band : VibrationBand
        Major frequency and automatic cut-off in Hz.
    cutoff_hz : float
        Applied upper cut-off in Hz: the cut-off of the band, or fs/2 if it exceeds `MAX_CUTOFF_FRACTION`
        times fs/2.
    segmentation : Segmentation
        Segments of the vibration.
    """

    samples: Samples
    band: VibrationBand
    cutoff_hz: float
    segmentation: Segmentation


def estimate_band(acceleration: ArrayLike, fs: float) -> VibrationBand:
    """Estimate the major frequency and the upper cut-off of a vibration.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Acceleration in any unit; a linear trend is removed.
    fs : float
        Sampling rate in Hz.

    References
    ----------
    `guruswamy2011`, eq. (6) and (7), applied between 0.122 Hz and fs/2.

    Examples
    --------
    >>> t = np.arange(2000) / 500
    >>> round(estimate_band(np.sin(2 * np.pi * 60 * t), fs=500.0).major_hz)
    60
    """
    a = np.asarray(acceleration, dtype=np.float64)
    n_fft = max(a.size, int(2 ** np.ceil(np.log2(fs / LOWER_HZ))))
    f, power = signal.periodogram(signal.detrend(a), fs, nfft=n_fft, detrend=False)
    return vibration_band(f[f >= LOWER_HZ], power[f >= LOWER_HZ], smoothing_hz=SMOOTHING_HZ)


def extract_profile(
    acceleration: ArrayLike,
    fs: float,
    *,
    resolution: float = RESOLUTION,
    phase: Phase = "causal",
) -> BandedVibration:
    """Band-pass filter an acceleration with a 4th-order Butterworth filter and segment it at rising peaks.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Acceleration normalised to one speed and force; must not be constant.
    fs : float
        Sampling rate in Hz.
    resolution : float
        Resolution of the sensor in the unit of the acceleration; the dead band is twice this value.
    phase : {"causal", "zero"}
        "causal" (default): filter forwards, and remove the delay. "zero": filter forwards and backwards. See
        Notes.

    Returns
    -------
    BandedVibration
        Filtered vibration with its band and segments.

    Raises
    ------
    ValueError
        If the acceleration is constant, not finite, or shorter than 8 samples.

    Notes
    -----
    The paper does not specify the direction of the filter. A backward pass rings *before* each onset. The
    peaks then rise in steps, and the segmentation at rising peaks splits onsets: on the simulated regular
    surfaces, it yields 25 to 50 % more segments. A forward pass preserves the decay, and its gain at the band
    edges is -3 dB as designed, instead of -6 dB.

    The removed delay is that with the highest correlation of vibration and acceleration, in steps of 1/16
    sample. Whole samples are too coarse: 2 ms are a quarter of a period at 125 Hz.

    References
    ----------
    `guruswamy2011`, sections IV-B, IV-C and V-A.

    Examples
    --------
    >>> t = np.arange(100) / 500
    >>> impulse = 5 * np.exp(-40 * t) * np.sin(2 * np.pi * 30 * t)
    >>> extract_profile(np.tile(impulse, 10), fs=500.0).segmentation.n_segments
    10
    """
    a = np.asarray(acceleration, dtype=np.float64)
    if a.ndim != 1 or a.size < 8 or not np.all(np.isfinite(a)) or np.ptp(a) == 0:
        raise ValueError(
            "acceleration must be one finite, non-constant channel of at least 8 samples, "
            f"got shape {a.shape}"
        )
    band = estimate_band(a, fs)
    is_wide = band.upper_hz > MAX_CUTOFF_FRACTION * fs / 2
    cutoff = fs / 2 if is_wide else band.upper_hz
    edges = LOWER_HZ if is_wide else (LOWER_HZ, cutoff)
    sos = signals.butterworth("highpass" if is_wide else "bandpass", edges, fs)
    a = a - np.mean(a)
    if phase == "zero":
        samples = signals.zero_phase(sos, a)
    else:
        # delay in samples at which the filtered vibration correlates best with the acceleration
        n = min(a.size, 8192)
        f, power = signal.welch(a, fs, nperseg=n)
        correlation = np.fft.irfft(power * signal.freqz_sos(sos, f, fs=fs)[1], DELAY_STEPS * n)
        delay = int(np.argmax(correlation[: DELAY_STEPS * n // 2])) / DELAY_STEPS
        late = signals.causal(sos, np.pad(a, (0, int(np.ceil(delay))), mode="edge"))[0]
        samples = ndimage.shift(late, -delay, order=5, mode="nearest")[: a.size]
    return BandedVibration(samples, band, cutoff, segment_rising_peaks(samples, 2 * resolution))


# One filter per segment -------------------------------------------------------------------------------------

RING_S = 0.5
"""Longest time in s that a filter takes to decay by 60 dB (our choice)."""
MIN_DECAY = float(np.log(1000) / RING_S)
"""Smallest decay rate of a mode in 1/s."""
MAX_POLES = 24
"""Largest order of a filter, which bounds the cost of rendering and fitting."""
MAX_AMPLITUDE_RATIO = 100.0
"""Largest ratio of the amplitude of a mode to the peak of the segment. Larger modes cancel each other, and
fits with such modes are rejected."""

Method = Literal["modes", "sinusoid"]


@dataclass(frozen=True, eq=False)
class Responses:
    """Filters of consecutive segments.

    Attributes
    ----------
    start : ndarray of int, shape (n_segments,)
        First sample of each segment.
    modes : tuple of DecayingModes
        Filter of each segment; a filter without modes has no output.
    """

    start: NDArray[np.int64]
    modes: tuple[DecayingModes, ...]

    def sum(self, n_samples: int, fs: float) -> Samples:
        """Return the sum of all responses, each excited at its start: eq. (5) at the speed of the scan."""
        total = np.zeros(n_samples)
        for start, modes in zip(self.start, self.modes, strict=True):
            stop = min(start + _ring_samples(fs), n_samples)
            total[start:stop] += modes.synthesize(stop - start, fs)
        return total


def fit_responses(
    x: Samples, bounds: Sequence[int], fs: float, resolution: float, *, method: Method = "modes"
) -> Responses:
    """Fit one filter to each segment of a profile.

    The tails of earlier filters are subtracted from a segment before the fit, so that the sum of all filters
    approximates the profile. If segments were fitted separately, as in the paper, the sum would contain
    additional tails.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Profile; see `extract_profile`.
    bounds : sequence of int
        Segment i consists of the samples bounds[i] to bounds[i + 1] - 1.
    fs : float
        Sampling rate in Hz.
    resolution : float
        Target of the mean absolute error in the unit of `x`.
    method : {"modes", "sinusoid"}
        "modes" (default): several decaying modes, see `fit_modes`. "sinusoid": one decaying sinusoid, eq.
        (3).

    Returns
    -------
    Responses
        Filters of the segments.

    References
    ----------
    `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> t = np.arange(100) / 500
    >>> x = np.tile(5 * np.exp(-40 * t) * np.sin(2 * np.pi * 30 * t), 2)
    >>> responses = fit_responses(x, [0, 100, 200], 500.0, resolution=0.01)
    >>> bool(np.abs(responses.sum(200, 500.0) - x).max() < 0.1)
    True
    """
    residual = np.array(x, dtype=np.float64)
    filters = []
    for start, stop in pairwise(bounds):
        segment = residual[start:stop]
        modes = fit_modes(segment, fs, resolution) if method == "modes" else fit_sinusoid(segment, fs)
        filters.append(modes)
        end = min(start + _ring_samples(fs), residual.size)
        residual[start:end] -= modes.synthesize(end - start, fs)
    return Responses(np.asarray(bounds[:-1]), tuple(filters))


def fit_modes(segment: Samples, fs: float, resolution: float) -> DecayingModes:
    """Fit decaying modes, with approximately the smallest number of poles that reaches the resolution.

    The number of poles is doubled until the mean absolute error is below the resolution, and then reduced by
    bisection. If the resolution is not reached, the fit with the smallest error is used. All modes decay by
    60 dB within `RING_S`.

    Parameters
    ----------
    segment : ndarray of shape (n_samples,)
        Segment of a vibration.
    fs : float
        Sampling rate in Hz.
    resolution : float
        Target of the mean absolute error in the unit of `segment`; positive.

    Returns
    -------
    DecayingModes
        Fitted modes; no modes if the mean magnitude of the segment is below the resolution.

    Examples
    --------
    >>> t = np.arange(100) / 500
    >>> modes = fit_modes(5 * np.exp(-40 * t) * np.sin(2 * np.pi * 30 * t), 500.0, resolution=0.01)
    >>> modes.frequency_hz.round(1).tolist(), modes.decay_per_s.round(1).tolist()
    ([30.0], [40.0])
    """
    if np.mean(np.abs(segment)) < resolution:
        return NO_MODES
    x = np.pad(segment, (0, max(0, 8 - segment.size)))  # short segments are zero-padded, as in the paper
    fits: dict[int, tuple[float, DecayingModes]] = {}

    def error(order: int) -> float:
        if order not in fits:
            modes = fit_matrix_pencil(x, fs, order=order)
            if modes.decay_per_s.min(initial=MIN_DECAY) < MIN_DECAY:
                faster = np.maximum(modes.decay_per_s, MIN_DECAY)
                modes = fit_amplitudes(x, modes.frequency_hz, faster, fs)
            difference = float(np.mean(np.abs(modes.synthesize(segment.size, fs) - segment)))
            largest = np.max(modes.amplitude, initial=0.0)
            is_moderate = largest <= MAX_AMPLITUDE_RATIO * np.max(np.abs(x))
            fits[order] = difference if is_moderate else np.inf, modes
        return fits[order][0]

    low, high, highest = 0, 2, min(x.size // 2, MAX_POLES)
    while error(high) >= resolution and high < highest:
        low, high = high, min(2 * high, highest)
    while high - low > 1 and fits[high][0] < resolution:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) < resolution else (middle, high)
    best = fits[high] if fits[high][0] < resolution else min(fits.values(), key=lambda fit: fit[0])
    return best[1] if np.isfinite(best[0]) else fit_sinusoid(segment, fs)


def fit_sinusoid(segment: Samples, fs: float) -> DecayingModes:
    """Fit a(t) = A exp(-beta t) sin(omega t) to a segment by least squares, with A of either sign.

    For each beta and omega, A is the projection of the segment onto the sinusoid. Beta and omega are searched
    on a grid that is refined four times around its best point.

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), based on `okamura2001`, whose fit needs two peaks.

    Examples
    --------
    >>> t = np.arange(100) / 500
    >>> mode = fit_sinusoid(5 * np.exp(-40 * t) * np.sin(2 * np.pi * 30 * t), 500.0)
    >>> mode.frequency_hz.round().tolist(), mode.decay_per_s.round().tolist()
    ([30.0], [40.0])
    """
    if segment.size < 2 or not np.any(segment):  # every sinusoid starts at 0
        return NO_MODES
    t = np.arange(segment.size) / fs
    low = np.log([MIN_DECAY, 0.25 / max(t[-1], 1 / fs)])
    high = np.log([2 * fs, 0.49 * fs])
    for _ in range(5):
        B, f = (np.exp(axis) for axis in np.meshgrid(*np.linspace(low, high, 24).T))
        shape = np.exp(-B.ravel()[:, np.newaxis] * t) * np.sin(2 * np.pi * f.ravel()[:, np.newaxis] * t)
        size = np.maximum(np.linalg.norm(shape, axis=1), np.finfo(float).tiny)
        best = int(np.argmax(np.abs(shape @ segment / size)))
        centre, half = np.log([B.ravel()[best], f.ravel()[best]]), (high - low) / 8
        low, high = np.maximum(centre - half, low), np.minimum(centre + half, high)
    A = shape[[best]] @ segment / size[best] ** 2
    return DecayingModes(f.ravel()[[best]], B.ravel()[[best]], np.abs(A), np.where(A >= 0, -0.5, 0.5) * np.pi)


def _ring_samples(fs: float) -> int:
    """Return the number of samples in three times `RING_S`, after which a mode has decayed by 180 dB."""
    return int(3 * RING_S * fs)


# Texture ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FittedScan:
    """A texture with the intermediate results of its fit.

    Attributes
    ----------
    scan : Scan
        Scan to which the texture was fitted.
    acceleration : ndarray of shape (n_samples,)
        Acceleration normalised to the mean speed and force, without its mean.
    profile : BandedVibration
        Band-pass filtered acceleration and its segments.
    responses : Responses
        One filter per segment.
    texture : SpatialTexture
        Fitted texture.
    """

    scan: Scan
    acceleration: Samples = field(repr=False)
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
        One stroke, preferably slow and steady. Features merge if one begins before the previous one has
        decayed.
    law : LevelLaw
        Level law of the surface, from `fit_level_law` (default: no effect of speed and force).
    resolution : float
        One bit of the sensor in the unit of the acceleration (default 0.153).
    method : {"modes", "sinusoid"}
        "modes" (default): the filter of each segment has the order that the segment needs. "sinusoid": one
        decaying sinusoid per segment (baseline).
    compensated : bool
        Whether to compensate for the feature rate, see `Amplitude` (default True).
    course : {"line", "travelled"}
        Coordinate of the tip, see `SpatialTexture`.

    Returns
    -------
    FittedScan
        Texture and intermediate results.

    Raises
    ------
    ValueError
        If the tip does not move, or the acceleration never exceeds the resolution.

    References
    ----------
    `guruswamy2011`, sections III and IV.

    Examples
    --------
    Ten ridges, 4 mm apart:

    >>> t = np.arange(100) / 500
    >>> vibration = np.tile(5 * np.exp(-40 * t) * np.sin(2 * np.pi * 30 * t), 10)
    >>> texture = fit_texture(Scan.along_line(vibration, 20.0, 0.5, fs=500.0)).texture
    >>> texture.n_features, np.diff(texture.position_mm).round().tolist()[:3]
    (10, [4.0, 4.0, 4.0])
    """
    length = scan.distance_mm[-1]
    speed = float(scan.speed.mean())
    if not (length > 0 and speed > 0):
        raise ValueError(
            f"scan {scan.name!r} must contain a movement, got a path of {length:g} mm at {speed:g} mm/s"
        )
    scaling = Amplitude(law, speed, max(float(scan.force.mean()), 0.0), compensated)
    a = normalise_acceleration(scan, scaling)
    profile = extract_profile(a, scan.fs, resolution=resolution)
    bounds = profile.segmentation.bounds.tolist()
    responses = fit_responses(profile.samples, bounds, scan.fs, resolution, method=method)
    nonempty = [i for i, modes in enumerate(responses.modes) if modes.n_modes]
    if not nonempty:
        raise ValueError(
            f"scan {scan.name!r} never exceeds the resolution, {resolution:g}. Expected a stronger "
            "vibration. If the sensor is finer, pass a smaller resolution"
        )
    modes = [responses.modes[i] for i in nonempty]
    # each filter starts where its segment starts: half a sample before the first sample, along the path
    x, start = scan.distance_mm, responses.start[nonempty]
    position = (x[np.maximum(start - 1, 0)] + x[start]) / 2
    # the line is the first principal axis of the path, from start to end
    axis = np.linalg.svd(scan.position - scan.position.mean(axis=0), full_matrices=False)[2][0]
    direction = -axis if (scan.position[-1] - scan.position[0]) @ axis < 0 else axis
    f, B, A, phi = np.concatenate([m.table for m in modes]).T
    texture = (SinusoidTexture if method == "sinusoid" else SpatialTexture)(
        name=scan.name,
        fs=scan.fs,
        length_mm=max(float(x[-1]), float(np.nextafter(position[-1], np.inf))),
        position_mm=position,
        feature=np.repeat(np.arange(float(len(nonempty))), [m.n_modes for m in modes]),
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
