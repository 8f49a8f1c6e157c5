"""Fit a texture that follows speed and force to recordings, and select its size on held-out halves.

Candidates are autoregressive models whose level and spectrum depend on speed and force through nodes of a
grid. The level may be constant, a power law of speed, of force or of both, or free at more nodes. The
spectrum may be constant, or change with the speed or with both. Each candidate is fitted to one half of the
recordings and scored on the other half.
"""

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import resample_poly

from texclass.haptics.scene.fits import node_powers
from texclass.haptics.textures.grid import GridModel, interpolation_weights
from texclass.haptics.textures.grid_texture import LIGHT_N, REST_MM_S, GridTexture
from texclass.haptics.textures.packing import FRAME_S
from texclass.haptics.textures.scan import Scan
from texclass.phases import find_glitches, interpolate_glitches
from texclass.recording import Recording, Samples
from texclass.reporting import Document
from texclass.signals import combine, remove_hand_motion
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation

MAX_FS = 2000.0
"""Sampling rate in Hz above which recordings are decimated; vibration above 1 kHz is hardly perceived."""
MIN_FS = 100.0
"""Smallest sampling rate in Hz, at which a frame has 12 samples."""
LOWEST_HZ = 20.0
"""Frequency in Hz below which the score ignores the spectrum, because hand motion dominates."""
QUANTILES = 0.05, 0.95
"""Quantiles of speed and force that are the range of the texture. Fits beyond them rest on few samples."""
MIN_OCTAVES = 0.5
"""Smallest range of speed or force in octaves for a dependence on it, as in packed textures."""
MIN_FRAMES = 32
"""Smallest number of frames; with 16 per half, a level that follows speed and force can be scored."""
MIN_R_SQUARED = 0.1
"""Fraction of the variance of the level, below which a notice states that it hardly depends on the motion."""

Size = tuple[int, int]
"""Numbers of nodes along speed and force; 1 means no dependence."""
Axes = tuple[Samples, Samples]
"""Speeds (mm/s) and forces (N) of the nodes."""
Errors = tuple[float, float]
"""RMS errors of level and spectrum in dB."""


@dataclass(frozen=True)
class FitSettings:
    """Candidates of the fit.

    Attributes
    ----------
    level_sizes : tuple of (int, int)
        Numbers of nodes of the level along speed and force. Two nodes are a power law.
    spectrum_speeds, spectrum_forces : tuple of int
        Numbers of nodes of the spectrum along speed and along force.
    orders : tuple of int
        Orders of the autoregressive models.
    """

    level_sizes: tuple[Size, ...] = (
        (1, 1), (2, 1), (1, 2), (2, 2), (3, 1), (1, 3), (3, 2), (2, 3), (3, 3), (4, 2), (6, 2),
    )  # fmt: skip
    spectrum_speeds: tuple[int, ...] = (1, 2, 3, 4, 6)
    spectrum_forces: tuple[int, ...] = (1, 2)
    orders: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)


SETTINGS = FitSettings()


class Frames(NamedTuple):
    """Frames of recordings with nearly constant speed and force.

    Attributes
    ----------
    spectra : ndarray of shape (n_frames, n_bins)
        Power of each bin in unit^2 from 0 Hz to fs/2, of periodograms zero-padded to twice their length.
    speed, force : ndarray of shape (n_frames,)
        Mean speed in mm/s and force in N.
    is_second_half : ndarray of bool, shape (n_frames,)
        Whether the frame belongs to the second half of its recording.
    """

    spectra: Samples
    speed: Samples
    force: Samples
    is_second_half: Any

    @property
    def power(self) -> Samples:
        """Power of each frame in unit^2, shape (n_frames,)."""
        return np.asarray(self.spectra.sum(axis=1))

    def select(self, mask: Any) -> "Frames":
        """Return the frames selected by a boolean mask."""
        return Frames(*(values[mask] for values in self))


class Candidate(NamedTuple):
    """Numbers of nodes of level and spectrum along speed and force, and order of the models."""

    level: Size
    spectrum: Size
    order: int

    @property
    def nodes(self) -> Size:
        """Numbers of nodes of a grid that contains those of level and spectrum."""
        return max(self.level[0], self.spectrum[0]), max(self.level[1], self.spectrum[1])

    def describe(self) -> str:
        """Return a description such as "AR models of order 8, level by speed (2 nodes), one spectrum"."""
        level = _describe_nodes("level", self.level) or "constant level"
        spectrum = _describe_nodes("spectrum", self.spectrum) or "one spectrum"
        return f"AR models of order {self.order}, {level}, {spectrum}"


def _describe_nodes(what: str, size: tuple[int, int]) -> str:
    pairs = [f"{name} ({n} nodes)" for name, n in zip(("speed", "force"), size, strict=True) if n > 1]
    return f"{what} by {' and '.join(pairs)}" if pairs else ""


@dataclass(frozen=True, eq=False)
class RecordingFit:
    """Texture that was fitted to recordings, and its errors on held-out halves.

    Attributes
    ----------
    texture : GridTexture
        Texture, fitted to all frames. Its range is the range of the recordings between the 5th and the 95th
        percentile of speed and force.
    unit : str
        Unit of the vibration.
    candidate : Candidate
        Selected numbers of nodes and order.
    n_candidates, n_frames, n_rest : int
        Number of candidates, and numbers of frames used and frames at rest.
    level_r_squared : float
        Adjusted R^2 of the level in dB, regressed on the logarithms of speed and force.
    level_errors_db, spectrum_errors_db : (float, float)
        Errors on the held-out halves, of the texture and of models of the same order that ignore speed and
        force: RMS error of the level of frames, and RMS error of third-octave levels, averaged over the
        frames of each third of the speeds.
    notices : tuple of str
        What the user should know.
    """

    texture: GridTexture
    unit: str
    candidate: Candidate
    n_candidates: int
    n_frames: int
    n_rest: int
    level_r_squared: float
    level_errors_db: tuple[float, float]
    spectrum_errors_db: tuple[float, float]
    notices: tuple[str, ...] = field(default=())

    def document(self) -> Document:
        """Return a report of the fit."""
        (slow, fast), (light, hard) = ((x[0], x[-1]) for x in (self.texture.speeds, self.texture.forces))
        level, spectrum = self.level_errors_db, self.spectrum_errors_db
        facts = {
            "model": self.candidate.describe(),
            "selected": f"from {self.n_candidates} candidates, by likelihood on held-out halves",
            "speed": f"{slow:.4g} to {fast:.4g} mm/s",
            "force": f"{light:.3g} to {hard:.3g} N",
            "sampling rate": f"{self.texture.fs:g} Hz",
            "motion": f"{self.n_frames} frames of {FRAME_S:g} s, {self.n_rest} more at rest or in air",
            "level error": f"{level[0]:.1f} dB on held-out halves, {level[1]:.1f} dB if constant",
            "spectrum error": f"{spectrum[0]:.1f} dB on held-out halves, {spectrum[1]:.1f} dB if constant",
            "level explained": f"{100 * self.level_r_squared:.0f} % by speed and force (adjusted R²)",
        }
        notices = [f"Notice: {notice}." for notice in self.notices]
        return Document(f"Texture {self.texture.name}", [facts, *notices])

    def to_json(self) -> str:
        """Return the report as JSON."""
        content = {
            "name": self.texture.name,
            "order": self.candidate.order,
            "level_nodes": self.candidate.level,
            "spectrum_nodes": self.candidate.spectrum,
            "n_candidates": self.n_candidates,
            "speeds_mm_s": self.texture.speeds[[0, -1]].tolist(),
            "forces_n": self.texture.forces[[0, -1]].tolist(),
            "fs_hz": self.texture.fs,
            "unit": self.unit,
            "n_frames": self.n_frames,
            "n_frames_at_rest": self.n_rest,
            "level_error_db": self.level_errors_db[0],
            "level_error_db_constant": self.level_errors_db[1],
            "spectrum_error_db": self.spectrum_errors_db[0],
            "spectrum_error_db_constant": self.spectrum_errors_db[1],
            "level_r_squared": self.level_r_squared,
            "notices": self.notices,
        }
        return json.dumps(content, indent=1)


def fit_recordings(
    recordings: Sequence[Recording],
    *,
    name: str = "",
) -> RecordingFit:
    """Fit a texture that follows speed and force to recordings of one surface.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings with speed and normal force, in the same unit and at the same sampling rate.
    name : str
        Name of the surface (default: that of the first recording).

    Returns
    -------
    RecordingFit
        Texture and its errors on held-out halves.

    Raises
    ------
    ValueError
        If speed or force is missing, units or rates differ, or the recordings contain too little motion.

    Notes
    -----
    1. Hand motion is removed, and the recordings are cut into frames of `FRAME_S`. Frames at rest or in the
       air are excluded.
    2. Powers at the nodes are maximum-likelihood estimates of a gamma regression: the power of frames for the
       level, and the power of each frequency, relative to the frame, for the spectrum.
    3. Candidates are fitted to the first halves of the recordings and scored on the second halves, and vice
       versa. The score is the Whittle likelihood of the periodograms [Whittle, "Estimation and information in
       stationary time series", 1953]. First the level is selected, then the spectrum: each time the candidate
       with fewest parameters within one standard error of the best score [Breiman et al., "Classification and
       regression trees", 1984, section 3.4.3].
    4. The selected candidate is fitted to all frames.

    The errors are measured on the halves that were also used for the selection, so they are slightly
    optimistic.

    Examples
    --------
    >>> rng, t = np.random.default_rng(0), np.arange(20_000) / 1000
    >>> speed = 100 * 2 ** np.sin(2 * np.pi * 0.2 * t)
    >>> vibration = speed / 100 * rng.standard_normal(t.size)
    >>> recording = Recording(vibration, 1000, "m/s^2", speed=speed, normal_force=np.ones(t.size))
    >>> fit = fit_recordings([recording], name="oak")
    >>> fit.candidate.level, fit.texture.speeds.round(-1).tolist()
    ((2, 1), [50.0, 200.0])
    """
    if not recordings:
        raise ValueError("recordings must contain at least one recording, got none")
    with warnings.catch_warnings(record=True) as caught:  # outliers are notices of the result
        warnings.simplefilter("always")
        scans = [_scan(recording) for recording in recordings]
    places = [recording.source or recording.recording_id for recording in recordings]
    for attribute in ("fs", "unit"):
        if len({getattr(recording, attribute) for recording in recordings}) > 1:
            values = [
                f"{place}: {getattr(r, attribute)}" for place, r in zip(places, recordings, strict=True)
            ]
            raise ValueError(f"recordings must have the same {attribute}, got {', '.join(values)}")
    factor = max(1, int(scans[0].fs // MAX_FS))
    fs = scans[0].fs / factor
    if fs < MIN_FS:
        raise ValueError(f"{', '.join(places)}: fs must be at least {MIN_FS:g} Hz, got {fs:g} Hz")
    frames_of_scans = [_moving_frames(scan, factor) for scan in scans]
    frames = Frames(*map(np.concatenate, zip(*frames_of_scans, strict=True)))
    n_frames = len(frames.speed)
    n_rest = sum(len(scan) // (round(FRAME_S * fs) * factor) for scan in scans) - n_frames
    if n_frames < MIN_FRAMES:
        raise ValueError(
            f"{', '.join(places)}: recordings must have at least {MIN_FRAMES} frames of {FRAME_S} s with a "
            f"speed of {REST_MM_S:g} mm/s and a force of {LIGHT_N:g} N or more, got {n_frames}. Record "
            "longer strokes, or check the columns and units of speed and force"
        )
    ranges = [np.quantile(x, QUANTILES) for x in (frames.speed, frames.force)]
    level, n_levels = select_level(frames, ranges)
    spectrum, order, n_spectra = select_spectrum(frames, ranges, level)
    candidate = Candidate(level, spectrum, order)
    errors = [
        held_out_errors(frames, ranges, fs, each) for each in (candidate, Candidate((1, 1), (1, 1), order))
    ]
    peak = max(float(np.abs(scan.acceleration).max()) for scan in scans)
    grid = fit_grid(frames, ranges, candidate, peak)
    r_squared = _level_r_squared(frames)
    messages = [str(warning.message) for warning in caught if warning.category is UserWarning]
    notices = [message.removesuffix(". Check the sensor") for message in messages]
    notices += _notices(recordings, ranges, r_squared)
    return RecordingFit(
        GridTexture(name or scans[0].name, fs, grid), recordings[0].unit, candidate, n_levels + n_spectra,
        n_frames, n_rest, r_squared,
        (errors[0][0], errors[1][0]), (errors[0][1], errors[1][1]), tuple(notices),
    )  # fmt: skip


def _scan(recording: Recording) -> Scan:
    """Return one axis without glitches and hand motion, with speed and force without outliers.

    A force that is negative while the tool presses changes its sign.
    """
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    axes = interpolate_glitches(axes, find_glitches(axes))
    if recording.normal_force is not None and _is_reversed(recording):
        recording = recording.with_(normal_force=-recording.normal_force)
    return Scan.from_recording(recording, remove_hand_motion(combine(axes), recording.fs))


def _is_reversed(recording: Recording) -> bool:
    return recording.normal_force is not None and float(np.median(recording.normal_force)) < 0


def _moving_frames(scan: Scan, factor: int) -> Frames:
    """Return the frames of a scan in which the tool moves and presses, decimated by a factor."""
    x = resample_poly(scan.acceleration, 1, factor) if factor > 1 else scan.acceleration
    fs = scan.fs / factor
    n = round(FRAME_S * fs)
    n_rows = len(scan) // (n * factor)
    window = np.hanning(n + 2)[1:-1]
    rows = x[: n_rows * n].reshape(n_rows, n)
    spectra = np.abs(np.fft.rfft((rows - rows.mean(axis=1, keepdims=True)) * window, 2 * n)) ** 2
    spectra *= 2 / (2 * n * (window @ window))
    speed, force = (
        signal[: n_rows * n * factor].reshape(n_rows, n * factor).mean(axis=1)
        for signal in (scan.speed, scan.force)
    )
    is_moving = (speed >= REST_MM_S) & (force >= LIGHT_N) & (spectra.sum(axis=1) > 0)
    n_moving = int(is_moving.sum())
    is_second_half = np.arange(n_moving) >= n_moving / 2
    return Frames(spectra[is_moving], speed[is_moving], force[is_moving], is_second_half)


def grid_axes(ranges: Sequence[Samples], size: Size) -> Axes:
    """Return the nodes along speed and force; a range without a dependence has its two ends."""
    axes = [
        np.geomspace(low, high, max(n, 2)) if high > 1.01 * low else np.array([np.sqrt(low * high)])
        for (low, high), n in zip(ranges, size, strict=True)
    ]
    return axes[0], axes[1]


def fit_nodes(frames: Frames, power: Samples, ranges: Sequence[Samples], size: Size) -> tuple[Axes, Samples]:
    """Fit powers (n_frames, ...) at the nodes of a grid, see `node_powers`.

    Parameters
    ----------
    frames : Frames
        Frames, of which the speeds and forces are used.
    power : ndarray of shape (n_frames, ...)
        Positive powers.
    ranges : sequence of ndarray
        Range of speed (mm/s) and of force (N).
    size : (int, int)
        Numbers of nodes; along an axis with size 1, the power is constant.

    Returns
    -------
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.
    powers : ndarray of shape (n_speeds, n_forces, ...)
        Powers at the nodes.
    """
    axes = grid_axes(ranges, size)
    fitted = [axis if n > 1 else axis[:1] for axis, n in zip(axes, size, strict=True)]
    weights = interpolation_weights(fitted, (frames.speed, frames.force))
    powers = node_powers(weights, power, (fitted[0], fitted[1]))
    shape = fitted[0].size, fitted[1].size, *power.shape[1:]
    return axes, np.broadcast_to(powers.reshape(shape), (axes[0].size, axes[1].size, *shape[2:]))


def fit_reflection(frames: Frames, ranges: Sequence[Samples], size: Size, order: int) -> tuple[Axes, Samples]:
    """Fit autoregressive models to frames of unit power; return axes and (n_speeds, n_forces, order)."""
    relative = np.maximum(frames.spectra / frames.power[:, np.newaxis], 1e-12 / frames.spectra.shape[1])
    axes, spectra = fit_nodes(frames, relative, ranges, size)
    r = np.fft.irfft(spectra, axis=-1)[..., : order + 1]
    k = from_autocorrelation(r.reshape(-1, r.shape[-1])).reflection
    return axes, k.reshape(*spectra.shape[:2], -1)


def fit_grid(frames: Frames, ranges: Sequence[Samples], candidate: Candidate, peak: float) -> GridModel:
    """Fit one candidate to frames; `peak` is the largest magnitude of the vibration."""
    axes = grid_axes(ranges, candidate.nodes)
    points = [grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")]
    level_axes, power = fit_nodes(frames, frames.power, ranges, candidate.level)
    k_axes, k = fit_reflection(frames, ranges, candidate.spectrum, candidate.order)
    ln_power = interpolation_weights(level_axes, points) @ np.log(power).ravel()
    rows = interpolation_weights(k_axes, points) @ k.reshape(-1, k.shape[-1])
    shape = axes[0].size, axes[1].size
    return GridModel(axes, rows.reshape(*shape, -1), np.exp(ln_power).reshape(shape), peak)


# Selection on held-out halves -------------------------------------------------------------------------------


def predict_power(frames: Frames, ranges: Sequence[Samples], size: Size) -> Samples:
    """Return the power of each frame (n_frames,), predicted by a fit to the other half."""
    predicted = np.empty_like(frames.power)
    for test in (frames.is_second_half, ~frames.is_second_half):
        axes, power = fit_nodes(frames.select(~test), frames.power[~test], ranges, size)
        weights = interpolation_weights(axes, (frames.speed[test], frames.force[test]))
        predicted[test] = np.exp(weights @ np.log(power).ravel())
    return predicted


def predict_spectra(frames: Frames, ranges: Sequence[Samples], size: Size, orders: Sequence[int]) -> Samples:
    """Return the spectra of unit power (n_orders, n_frames, n_bins), predicted by a fit to the other half."""
    omega = np.linspace(0, np.pi, frames.spectra.shape[1])
    predicted = np.empty((len(orders), *frames.spectra.shape))
    for test in (frames.is_second_half, ~frames.is_second_half):
        axes, k = fit_reflection(frames.select(~test), ranges, size, max(orders))
        weights = interpolation_weights(axes, (frames.speed[test], frames.force[test]))
        for frame, row in zip(np.flatnonzero(test), weights @ k.reshape(-1, k.shape[-1]), strict=True):
            ln_a = recursions.log_magnitudes(np.ascontiguousarray(row), omega)
            ln_g2 = np.concatenate([[0.0], np.cumsum(np.log1p(-row) + np.log1p(row))])
            predicted[:, frame] = np.exp(ln_g2[:, np.newaxis] - 2 * ln_a)[list(orders)]
    return predicted / (omega.size - 1)  # the sum over the bins is 1


def select_level(frames: Frames, ranges: Sequence[Samples]) -> tuple[Size, int]:
    """Return the numbers of nodes of the level, and the number of candidates."""
    scores = {}
    for size in filter(partial(_can_be_fitted, frames, ranges), SETTINGS.level_sizes):
        power = predict_power(frames, ranges, size)
        scores[size] = np.log(power) + frames.power / power
    return _smallest_close(scores, lambda size: int(np.prod(size))), len(scores)


def select_spectrum(frames: Frames, ranges: Sequence[Samples], level: Size) -> tuple[Size, int, int]:
    """Return the numbers of nodes of the spectrum, the order, and the number of candidates."""
    orders = [order for order in SETTINGS.orders if order < frames.spectra.shape[1] // 4]
    # The nodes of the level must be among those of the spectrum, or vice versa.
    n_speeds = SETTINGS.spectrum_speeds if level[0] <= 2 else (1, 2, level[0])
    in_band = slice(int(np.ceil(LOWEST_HZ * 2 * FRAME_S)), None, 2)  # independent bins
    relative = frames.spectra[:, in_band] / frames.power[:, np.newaxis]
    scores: dict[tuple[Size, int], Samples] = {}
    for size in filter(partial(_can_be_fitted, frames, ranges), product(n_speeds, SETTINGS.spectrum_forces)):
        predicted = predict_spectra(frames, ranges, size, orders)[..., in_band]
        deviance = (np.log(predicted) + relative / predicted).mean(axis=-1)
        scores |= {(size, order): row for order, row in zip(orders, deviance, strict=True)}
    size, order = _smallest_close(scores, lambda key: key[1] * int(np.prod(key[0])))
    return size, order, len(scores)


def _can_be_fitted(frames: Frames, ranges: Sequence[Samples], size: Size) -> bool:
    """Return whether speed and force vary enough for a grid, and half of the frames determine it."""
    varies = [high >= 2**MIN_OCTAVES * low for low, high in ranges]
    return all(n == 1 or can for n, can in zip(size, varies, strict=True)) and (
        int(np.prod(size)) <= len(frames.speed) // 8
    )


def _smallest_close(scores: Mapping[Any, Samples], n_parameters: Callable[[Any], int]) -> Any:
    """Return the key with fewest parameters whose mean score is within one standard error of the lowest."""
    best = min(scores.values(), key=lambda score: float(score.mean()))
    is_close = {
        key: np.mean(score - best) <= np.std(score - best) / np.sqrt(best.size)
        for key, score in scores.items()
    }
    return min((key for key in scores if is_close[key]), key=n_parameters)


def held_out_errors(frames: Frames, ranges: Sequence[Samples], fs: float, candidate: Candidate) -> Errors:
    """Return the RMS errors in dB of level and spectrum on the held-out halves; see `RecordingFit`."""
    power = predict_power(frames, ranges, candidate.level)
    spectra = power[:, np.newaxis] * predict_spectra(frames, ranges, candidate.spectrum, [candidate.order])[0]
    hz = np.linspace(0, fs / 2, spectra.shape[1])
    edges = LOWEST_HZ * 2.0 ** np.arange(0, np.log2(fs / 2 / LOWEST_HZ), 1 / 3)
    band = np.digitize(hz, edges)
    is_in_band = band[:, np.newaxis] == np.unique(band[band > 0])
    thirds = np.array_split(np.argsort(frames.speed), 3)
    predicted, observed = (
        10 * np.log10(np.array([S[third].mean(axis=0) for third in thirds]) @ is_in_band)
        for S in (spectra, frames.spectra)
    )
    level_error_db = 10 * np.log10(power / frames.power)
    return float(np.sqrt(np.mean(level_error_db**2))), float(np.sqrt(np.mean((predicted - observed) ** 2)))


def _level_r_squared(frames: Frames) -> float:
    """Return the adjusted R^2 of the level in dB, regressed on the logarithms of speed and force."""
    level = 10 * np.log10(frames.power)
    H = np.column_stack([np.ones_like(level), np.log(frames.speed), np.log(frames.force)])
    theta, _, rank, _ = np.linalg.lstsq(H, level, rcond=1e-6)
    residual, n = level - H @ theta, level.size
    total = float(np.sum((level - level.mean()) ** 2))
    explained = 1 - float(residual @ residual) / total if total else 0.0
    return float(max(0.0, 1 - (1 - explained) * (n - 1) / (n - rank)))


def _notices(recordings: Sequence[Recording], ranges: Sequence[Samples], r_squared: float) -> Iterator[str]:
    """Yield what the user should know about the fit."""
    if any(map(_is_reversed, recordings)):
        yield "normal_force is negative while the tool presses, so its sign was changed"
    constants = [
        name
        for name, (low, high) in zip(("speed", "force"), ranges, strict=True)
        if high < 2**MIN_OCTAVES * low
    ]
    if constants:
        yield (
            f"{' and '.join(constants)} hardly varied in the recording, so the texture does not depend on "
            f"{'them' if len(constants) > 1 else 'it'}. Record slow and fast, light and firm strokes"
        )
    if len(constants) < 2 and r_squared < MIN_R_SQUARED:
        yield (
            f"speed and force explain only {100 * r_squared:.0f} % of the variance of the level (R² "
            f"{r_squared:.2f}), so the level hardly follows them. Check the columns, or record larger "
            "differences"
        )
