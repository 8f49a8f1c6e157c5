"""Estimate power spectra of a surface at many speeds and forces, and score models against them.

The spectra are divided into a fitting set, a selection set and a test set. Only the part within the band of
the device and above its noise is compared.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.haptics.scene.definition import (
    Device,
    RecordingDefinition,
    SceneDefinition,
    SurfaceDefinition,
    Tolerance,
)
from texclass.haptics.textures.contract import constant_stroke
from texclass.haptics.textures.scan import motion_at_acceleration
from texclass.phases import exclude_outliers
from texclass.recording import ACCELERATION_UNITS, Recording, Samples

MAX_RESAMPLING_FACTOR = 1000
"""Largest numerator and denominator of a resampling ratio; this limits the length of the polyphase filter."""
MIN_RELATIVE_POWER = 1e-12
"""Floor of spectra relative to their largest power (-120 dB), needed because the device noise can be 0."""
MIN_SLOPE_RATIO = 1.4
"""Smallest ratio between the largest and the smallest speed (or force) for which a slope is computed."""

Window = tuple[Samples, float, float]
"""Vibration at the device's sampling rate, its speed (mm/s) and its force (N)."""
VibrationSource = Callable[[Sequence[tuple[float, float]], int], list[Samples]]
"""Function of pairs of speed (mm/s) and force (N), and of the seed of the first pair, that returns the
vibration at each pair at the device's sampling rate."""
Score = dict[str, Any]
"""Result of `SpectralScorer.score`:

- "scores": score of each point, in the unit of the tolerance;
- "level_errors_db": level of the model minus level of the surface, one per point;
- "slope_errors_db": error of the level change per doubling of speed and of force;
- "tolerance_ratio": the largest of these errors, relative to its limit;
- "within_tolerance": whether that ratio is at most 1.
"""


@dataclass(frozen=True)
class SamplingSettings:
    """Speeds and forces at which surfaces are sampled, and the windows of recordings that are used.

    Attributes
    ----------
    min_speed_mm_s, min_force_n : float
        Windows of freehand recordings below this speed (mm/s) or force (N) are excluded.
    margin : float
        Windows are used if they exceed the motion range of the scene by at most this fraction.
    duration_s : float
        Duration of the vibration at each speed and force in s.
    settle_s : float
        Duration in s that is rendered first and discarded.
    step_s, step_settle_s : float
        The same durations for surfaces of the simulated catalogue, which are shorter because the simulation
        of their contact takes most of the time of a plan.
    n_speeds, n_forces : int
        Grid size of the fitting set. The selection set consists of the points midway between the grid points,
        and the corners of the grid.
    n_test_points : int
        Number of random speed-force pairs in the test set.
    """

    min_speed_mm_s: float = 5.0
    min_force_n: float = 0.02
    margin: float = 0.25
    duration_s: float = 4.0
    settle_s: float = 0.5
    step_s: float = 1.5
    step_settle_s: float = 0.2
    n_speeds: int = 8
    n_forces: int = 4
    n_test_points: int = 8


SAMPLING = SamplingSettings()


@dataclass(frozen=True)
class SpectralScorer:
    """Score model spectra against surface spectra, within the band of a device and above its noise.

    Parameters
    ----------
    device : Device
        Device that renders the scene.
    tolerance : Tolerance
        Score and limits.
    """

    device: Device
    tolerance: Tolerance

    @cached_property
    def n_segment(self) -> int:
        """Samples per Welch segment: a power of two, at least 512 and 0.1 s."""
        return max(512, 1 << int(np.ceil(np.log2(0.1 * self.device.rate_hz))))

    @cached_property
    def frequencies(self) -> Samples:
        """Frequencies of the bins in Hz, shape (n_segment + 1,).

        Segments are zero-padded to twice their length, which prevents circular autocorrelation.
        """
        width = self.device.rate_hz / (2 * self.n_segment)
        return np.asarray(np.arange(self.n_segment + 1) * width, dtype=np.float64)

    @cached_property
    def bin_widths(self) -> Samples:
        """Width of each bin within the band in Hz, shape (n_bins,)."""
        return np.asarray(self._overlap(np.array(self.device.band_hz))[0])

    @cached_property
    def subbands(self) -> Samples:
        """Weights of the bins in the mean of each subband, shape (n_subbands, n_bins)."""
        low, high = self.device.band_hz
        if self.tolerance.score == "band_db":
            first = max(low, 2 * self.frequencies[1])
            n = max(1, round(np.log(high / first) / np.log(2 ** (1 / 3))))
            edges = np.geomspace(first, high, n + 1)
        else:
            n = min(64, max(1, int((high - low) / (2 * self.frequencies[1]))))
            edges = np.linspace(low, high, n + 1)
        overlap = self._overlap(edges)
        return np.asarray(overlap / overlap.sum(axis=1, keepdims=True))

    @property
    def noise_density(self) -> float:
        """Power density of the device's noise in unit^2/Hz."""
        low, high = self.device.band_hz
        return self.device.noise_floor**2 / (high - low)

    def spectrum(self, x: ArrayLike) -> Samples:
        """Return the power spectral density of a signal (Welch's method, Hann window).

        Parameters
        ----------
        x : array_like of shape (n,)
            Vibration at the device's sampling rate.

        Returns
        -------
        ndarray of shape (n_bins,)
            Power density in unit^2/Hz.
        """
        samples = np.asarray(x, dtype=np.float64)
        n = min(self.n_segment, samples.size)
        _, P = signal.welch(
            samples, self.device.rate_hz, "hann", n, nfft=2 * self.n_segment, detrend="constant"
        )
        return np.asarray(P)

    def power(self, spectrum: Samples) -> Samples:
        """Return the power of spectra (..., n_bins) within the band, in unit^2."""
        return np.asarray(spectrum @ self.bin_widths)

    def errors(self, surface: Samples, model: Samples) -> tuple[Samples, Samples]:
        """Return the score and the level error of each model spectrum.

        Parameters
        ----------
        surface, model : ndarray of shape (..., n_bins)
            Power densities of the surface and of the model.

        Returns
        -------
        scores : ndarray of shape (...)
            Scores in dB, or goodness of fit; see `Tolerance.score`.
        level_errors_db : ndarray of shape (...)
            Level of the model minus level of the surface in dB.
        """
        S, M = (P @ self.subbands.T for P in (surface, model))
        largest = S.max(axis=-1, keepdims=True)
        lowest = np.maximum(max(self.noise_density, 1e-300), MIN_RELATIVE_POWER * largest)
        S, M = np.maximum(S, lowest), np.maximum(M, lowest)
        mean = [10 * np.log10(P.mean(axis=-1)) for P in (S, M)]
        if self.tolerance.score == "gfc":
            product = np.sqrt(S * M).sum(axis=-1)
            score = product / np.sqrt(S.sum(axis=-1) * M.sum(axis=-1))
        else:
            score = np.sqrt(np.mean((10 * np.log10(M / S)) ** 2, axis=-1))
        return np.asarray(score), np.asarray(mean[1] - mean[0])

    def tolerance_ratio(self, scores: Samples, level_errors_db: Samples, slope_errors_db: Samples) -> Samples:
        """Return the largest ratio of an error to its limit; models with at most 1 are within the tolerance.

        Parameters
        ----------
        scores, level_errors_db : ndarray of shape (n_points, ...)
            Result of `errors`.
        slope_errors_db : ndarray of shape (2, ...)
            Slopes of the level errors, computed by `level_slopes`.

        Returns
        -------
        ndarray of shape (...)
            Ratio of each model.
        """
        t = self.tolerance
        ratio = (1 - scores) / (1 - t.limit) if t.score == "gfc" else scores / t.limit
        if t.level_db is not None:
            ratio = np.maximum(ratio, np.abs(level_errors_db) / t.level_db)
        overall = ratio.max(axis=0) if t.aggregate == "worst" else ratio.mean(axis=0)
        return np.asarray(np.maximum(overall, np.abs(slope_errors_db).max(axis=0) / t.slope_db))

    def score(self, points: "OperatingPoints", model: Samples) -> Score:
        """Return the score of model spectra at operating points of the surface.

        Parameters
        ----------
        points : OperatingPoints
            Spectra of the surface.
        model : ndarray of shape (n_points, n_bins)
            Power densities of the model at the same speeds and forces.

        Returns
        -------
        dict
            See `Score`.
        """
        scores, level_errors = self.errors(points.spectra, model)
        slope_errors = level_slopes(level_errors, points)
        ratio = float(self.tolerance_ratio(scores, level_errors, slope_errors))
        return {
            "scores": scores.tolist(),
            "level_errors_db": level_errors.tolist(),
            "slope_errors_db": slope_errors.tolist(),
            "tolerance_ratio": ratio,
            "within_tolerance": ratio <= 1,
        }

    def _overlap(self, edges: Samples) -> Samples:
        """Return the overlap in Hz of each bin with each interval of edges, shape (n_edges - 1, n_bins)."""
        half = self.frequencies[1] / 2
        bin_low = np.maximum(self.frequencies - half, 0.0)
        bin_high = np.minimum(self.frequencies + half, self.device.rate_hz / 2)
        low, high = edges[:-1, np.newaxis], edges[1:, np.newaxis]
        return np.asarray(np.maximum(np.minimum(bin_high, high) - np.maximum(bin_low, low), 0.0))


@dataclass(frozen=True, eq=False)
class OperatingPoints:
    """Power spectra of a surface at some speeds and forces.

    Attributes
    ----------
    spectra : ndarray of shape (n, n_bins)
        Power densities in unit^2/Hz.
    speed : ndarray of shape (n,)
        Speeds in mm/s.
    force : ndarray of shape (n,)
        Normal forces in N.
    """

    spectra: Samples
    speed: Samples
    force: Samples

    def __len__(self) -> int:
        return int(self.speed.size)

    @classmethod
    def from_windows(cls, windows: Sequence[Window], scorer: SpectralScorer) -> "OperatingPoints":
        """Return one point per window."""
        samples, speed, force = zip(*windows, strict=True)
        return cls(np.array([scorer.spectrum(x) for x in samples]), np.array(speed), np.array(force))

    def average_by_speed(self) -> "OperatingPoints":
        """Average the points in at most 4 groups of neighbouring speeds, of at least 6 points if possible.

        Averaging is needed because the spectrum of a single window of a freehand recording scatters by 4 dB.
        """
        n = int(np.clip(len(self) // 6, 1, 4))
        groups = np.array_split(np.argsort(self.speed, kind="stable"), n)
        return OperatingPoints(
            *(np.array([a[g].mean(axis=0) for g in groups]) for a in (self.spectra, self.speed, self.force))
        )


def level_slopes(levels_db: Samples, points: OperatingPoints) -> Samples:
    """Return the level change per doubling of the speed and per doubling of the force.

    Both slopes are fitted jointly by least squares over the logarithms of speed and force. A slope is 0 if
    its variable is almost constant, see `MIN_SLOPE_RATIO`.

    Parameters
    ----------
    levels_db : ndarray of shape (n_points, ...)
        Levels in dB.
    points : OperatingPoints
        Speeds and forces of the levels.

    Returns
    -------
    ndarray of shape (2, ...)
        Slopes in dB over speed and over force.
    """
    axes = np.log2([points.speed, points.force])
    varies = np.ptp(axes, axis=1) >= np.log2(MIN_SLOPE_RATIO)
    X = (axes - axes.mean(axis=1, keepdims=True)) * varies[:, np.newaxis]
    return np.asarray(np.tensordot(np.linalg.pinv(X.T), levels_db, axes=1))


@dataclass(frozen=True, eq=False)
class SurfaceSpectra:
    """Spectra of one surface, divided into three sets.

    Attributes
    ----------
    name : str
        Name of the surface.
    fitting : OperatingPoints
        Fitting set, to which the models are fitted.
    selection : OperatingPoints
        Selection set, on which order and grid of the model are selected.
    test : OperatingPoints
        Test set, on which the selected model is accepted or rejected. It is excluded from the fit.
    peak : float
        Largest magnitude of the vibration.
    test_set : str
        Description of the test set.
    """

    name: str
    fitting: OperatingPoints
    selection: OperatingPoints
    test: OperatingPoints
    peak: float
    test_set: str


def load_surface_spectra(
    name: str, surface: SurfaceDefinition, scene: SceneDefinition, scorer: SpectralScorer
) -> SurfaceSpectra:
    """Compute the spectra of a surface from the source in its definition.

    Raises
    ------
    ValueError
        If a file is damaged or too short, a unit does not match the device, or a name is unknown.
    OSError
        If a file cannot be read.
    """
    if surface.texture is not None:
        return _sample_source(name, scene, scorer, _texture_source(surface.texture, scene))
    if surface.simulated is not None:
        return _sample_source(name, scene, scorer, _simulated_source(surface.simulated, scene))
    if surface.dataset is not None:
        return split_by_time(name, _dataset_windows(name, surface, scene, scorer), scorer)
    has_constant_motion = [
        not isinstance(r.speed, str) and not isinstance(r.force, str) for r in surface.recordings
    ]
    windows = [w for r in surface.recordings for w in _recording_windows(r, scene, scorer)]
    return (split_by_speed if all(has_constant_motion) else split_by_time)(name, windows, scorer)


def _sample_source(
    name: str, scene: SceneDefinition, scorer: SpectralScorer, source: VibrationSource
) -> SurfaceSpectra:
    """Sample a source on a grid (fitting), at its midpoints and corners (selection) and at random (test)."""
    ranges = scene.motion.speeds_mm_s, scene.motion.forces_n
    grid = [
        np.geomspace(low, high, n if low < high else 1)
        for (low, high), n in zip(ranges, (SAMPLING.n_speeds, SAMPLING.n_forces), strict=True)
    ]
    midpoints = [np.sqrt(axis[:-1] * axis[1:]) if axis.size > 1 else axis for axis in grid]
    corners = [np.unique(axis[[0, -1]]) for axis in grid]
    low, high = np.log(ranges).T
    rng = np.random.default_rng((scene.seed, 1))
    random_points = np.exp(rng.uniform(low, high, (SAMPLING.n_test_points, 2)))
    window_sets, seed = [], 1
    for points in (product(*grid), [*product(*midpoints), *product(*corners)], random_points):
        conditions = [(float(v), float(f)) for v, f in points]
        signals = source(conditions, seed)
        window_sets.append([(x, v, f) for x, (v, f) in zip(signals, conditions, strict=True)])
        seed += len(conditions)
    return _build_sets(name, window_sets, scorer, f"{SAMPLING.n_test_points} random speeds and forces")


def _build_sets(
    name: str, window_sets: Sequence[Sequence[Window]], scorer: SpectralScorer, test_set: str
) -> SurfaceSpectra:
    peak = max(float(np.abs(x).max()) for windows in window_sets for x, _, _ in windows)
    fitting, selection, test = (OperatingPoints.from_windows(windows, scorer) for windows in window_sets)
    return SurfaceSpectra(name, fitting, selection, test, peak, test_set)


def split_by_time(name: str, windows: Sequence[Window], scorer: SpectralScorer) -> SurfaceSpectra:
    """Divide windows of freehand recordings: of every four, 2 for fitting, 1 for selection, 1 for test."""
    seconds = scorer.n_segment / scorer.device.rate_hz
    if len(windows) < 8:
        raise ValueError(
            f"surfaces.{name}: recordings must have at least 8 windows of {seconds:.2g} s within [motion], "
            f"got {len(windows)}. Add recordings, or widen [motion]"
        )
    test_set = f"window 4 of every 4, {seconds:.2g} s each"
    spectra = _build_sets(name, (windows[::2], windows[1::4], windows[3::4]), scorer, test_set)
    return replace(
        spectra, selection=spectra.selection.average_by_speed(), test=spectra.test.average_by_speed()
    )


def split_by_speed(name: str, windows: Sequence[Window], scorer: SpectralScorer) -> SurfaceSpectra:
    """Divide recordings at constant speeds; every second inner speed is held out.

    With fewer than three speeds, the recordings are divided by time.
    """
    test_speeds = set(sorted({speed for _, speed, _ in windows})[1:-1:2])
    held_out = [window for window in windows if window[1] in test_speeds] or windows
    begin, middle = (0.0, 0.5) if test_speeds else (0.5, 0.75)
    window_sets = (
        [w for w in windows if w[1] not in test_speeds] if test_speeds else _time_range(windows, 0.0, 0.5),
        _time_range(held_out, begin, middle),
        _time_range(held_out, middle, 1.0),
    )
    n_shortest = min(x.size for window_set in window_sets for x, _, _ in window_set)
    if n_shortest < scorer.n_segment:
        raise ValueError(
            f"surfaces.{name}: each part of a recording must have at least {scorer.n_segment} samples at "
            f"{scorer.device.rate_hz:g} Hz, got {n_shortest}. Use longer recordings"
        )
    speeds = ", ".join(f"{v:g}" for v in sorted(test_speeds))
    test_set = f"second half at {speeds} mm/s" if test_speeds else "last quarter of each recording"
    return _build_sets(name, window_sets, scorer, test_set)


def _time_range(windows: Sequence[Window], begin: float, end: float) -> list[Window]:
    return [(x[int(begin * x.size) : int(end * x.size)], v, f) for x, v, f in windows]


def _texture_source(path: Path, scene: SceneDefinition) -> VibrationSource:
    from texclass.haptics.exchange import describe, load_texture

    texture = load_texture(path)
    factor = unit_factor(describe(path)["unit"], scene.device.unit, path)

    def render(speed: float, force: float, seed: int) -> Samples:
        settled = round(SAMPLING.settle_s * texture.fs)
        n = round((SAMPLING.duration_s + SAMPLING.settle_s) * texture.fs)
        x = constant_stroke(texture, speed, force, n - settled, n_settling=settled, seed=seed)
        return resample(factor * x, texture.fs, scene.device.rate_hz)

    return lambda conditions, seed: [render(v, f, seed + i) for i, (v, f) in enumerate(conditions)]


def _simulated_source(name: str, scene: SceneDefinition) -> VibrationSource:
    family, _, index = name.partition("/")
    if scene.device.unit != "m/s^2":
        raise ValueError(f"device.unit must be m/s^2 for simulated surfaces, got {scene.device.unit}")
    if family == "catalogue" and index.isdecimal():
        return _catalogue_source(int(index), scene)
    if family != "abdulali2016":
        raise ValueError(f"simulated must be abdulali2016/S1 ... S9 or catalogue/0, 1, ..., got {name!r}")

    from texclass.haptics.textures.resonant_surfaces import get_surface

    simulated, fs = get_surface(index), scene.device.rate_hz

    def render(speed: float, force: float, seed: int) -> Samples:
        n = round(SAMPLING.duration_s * fs)
        rng = np.random.default_rng((scene.seed, seed))
        x = simulated.vibration(np.tile([speed, 0.0], (n, 1)), np.full(n, force), fs, rng)
        return resample(x, fs, fs)

    return lambda conditions, seed: [render(v, f, seed + i) for i, (v, f) in enumerate(conditions)]


def _catalogue_source(index: int, scene: SceneDefinition) -> VibrationSource:
    from texclass.signals import combine, remove_hand_motion
    from texclass.simulate import operator_catalogue, record_steps, surface_catalogue

    simulated, operator = surface_catalogue(index + 1, 0)[index], operator_catalogue(1, 0)[0]
    fs = max(2000.0, scene.device.rate_hz)
    step_s = SAMPLING.step_settle_s + SAMPLING.step_s

    def vibration(conditions: Sequence[tuple[float, float]], seed: int) -> list[Samples]:
        recording = record_steps(
            simulated, operator, conditions, step_s=step_s, fs=fs, seed=(scene.seed, index, seed)
        )
        # the last step ends at the end of the recording
        ends_s = len(recording.acceleration) / fs - step_s * np.arange(len(conditions))[::-1]
        slices = [slice(round((end - SAMPLING.step_s) * fs), round(end * fs)) for end in ends_s]
        windows = [combine(recording.acceleration[window]) for window in slices]
        return [resample(remove_hand_motion(x, fs), fs, scene.device.rate_hz) for x in windows]

    return vibration


def _dataset_windows(
    name: str, surface: SurfaceDefinition, scene: SceneDefinition, scorer: SpectralScorer
) -> list[Window]:
    from texclass.loaders import open_dataset

    label = surface.surface or name
    dataset = open_dataset(str(surface.dataset))
    recordings = [r for r in dataset if r.surface == label]
    if not recordings:
        names = ", ".join(dataset.surfaces)
        raise ValueError(
            f"surfaces.{name}: surface must be one of dataset {surface.dataset} ({names:.200}), got {label!r}"
        )
    windows: list[Window] = []
    for r in map(motion_at_acceleration, recordings):
        if r.speed is None or r.normal_force is None:
            raise ValueError(
                f"surfaces.{name}: recordings must contain speed and force, but {r.recording_id} does not. "
                "Define both channels in the dataset card"
            )
        windows += _cut_windows(r, r.speed, r.normal_force, scene, scorer)
    return windows


def _recording_windows(
    definition: RecordingDefinition, scene: SceneDefinition, scorer: SpectralScorer
) -> list[Window]:
    from texclass.loaders import load_recording

    motion = {"speed": definition.speed, "normal_force": definition.force}
    columns = {field: column for field, column in motion.items() if isinstance(column, str)}
    unit = definition.unit or scene.device.unit
    recording = load_recording(
        definition.file, fs=definition.fs_hz, unit=unit, column=definition.column, auxiliary=columns
    )
    if not columns:
        return [(_vibration(recording, scene), float(definition.speed), float(definition.force))]
    n = len(recording.acceleration)
    speed, force = (
        getattr(recording, field) if field in columns else np.full(n, value)
        for field, value in motion.items()
    )
    return _cut_windows(recording, speed, force, scene, scorer)


def _cut_windows(
    recording: Recording, speed: Samples, force: Samples, scene: SceneDefinition, scorer: SpectralScorer
) -> list[Window]:
    """Cut a freehand recording into windows of `n_segment` samples within the motion range of the scene."""
    x, n = _vibration(recording, scene), scorer.n_segment
    time_s = np.arange(x.size) / scene.device.rate_hz
    recorded_s = np.arange(len(recording.acceleration)) / recording.fs
    place = recording.source or recording.recording_id
    v, f = (
        np.interp(time_s, recorded_s, exclude_outliers(channel, recording.fs, channel_name, unit, place))
        for channel, channel_name, unit in ((speed, "speed", "mm/s"), (force, "normal_force", "N"))
    )
    slices = [slice(i, i + n) for i in range(0, x.size - n + 1, n)]
    windows = [(x[s], float(v[s].mean()), float(f[s].mean())) for s in slices]
    (slow, fast), (light, hard) = scene.motion.speeds_mm_s, scene.motion.forces_n
    low_factor, high_factor = 1 - SAMPLING.margin, 1 + SAMPLING.margin
    return [
        window
        for window in windows
        if max(SAMPLING.min_speed_mm_s, slow * low_factor) <= window[1] <= fast * high_factor
        and max(SAMPLING.min_force_n, light * low_factor) <= window[2] <= hard * high_factor
    ]


def _vibration(recording: Recording, scene: SceneDefinition) -> Samples:
    """Return one axis of vibration at the device's sampling rate and in its unit."""
    from texclass.signals import combine

    place = recording.source or recording.recording_id
    band_end = scene.device.band_hz[1]
    if recording.fs < 2 * band_end:
        raise ValueError(
            f"{place}: fs must be at least {2 * band_end:g} Hz, twice the end of device.band_hz, got "
            f"{recording.fs:g} Hz"
        )
    x = combine(np.asarray(recording.acceleration, dtype=np.float64))
    factor = unit_factor(recording.unit, scene.device.unit, place)
    return resample(factor * x, recording.fs, scene.device.rate_hz)


def unit_factor(unit: str, device_unit: str, place: object) -> float:
    """Return the factor that converts a unit to the device unit; `place` is the source in error messages."""
    if unit == device_unit:
        return 1.0
    if unit in ACCELERATION_UNITS and device_unit in ACCELERATION_UNITS:
        return ACCELERATION_UNITS[unit] / ACCELERATION_UNITS[device_unit]
    raise ValueError(
        f"{place}: unit must be convertible to {device_unit}, the unit of the device, got {unit}. "
        "Change device.unit or the unit of the recording"
    )


def resample(x: Samples, fs: float, rate: float) -> Samples:
    """Remove the mean of a signal and resample it to another sampling rate.

    Parameters
    ----------
    x : ndarray of shape (n,)
        Signal.
    fs, rate : float
        Sampling rates of the signal and of the result in Hz.

    Returns
    -------
    ndarray of shape (m,)
        Resampled signal.

    Raises
    ------
    ValueError
        If the ratio of the rates is not a fraction with numerator and denominator of at most 1000.
    """
    centred = np.asarray(x - x.mean(), dtype=np.float64)
    if fs == rate:
        return centred
    up, down = (np.rint(np.array([rate, fs]) / np.gcd(round(rate), round(fs)))).astype(int)
    if max(up, down) > MAX_RESAMPLING_FACTOR or abs(up * fs - down * rate) > 1e-9 * up * fs:
        raise ValueError(
            "the ratio of the sampling rates must be a fraction of integers up to "
            f"{MAX_RESAMPLING_FACTOR}, got {fs:g} Hz and {rate:g} Hz. Change device.rate_hz"
        )
    return np.asarray(signal.resample_poly(centred, up, down))
