"""What is known of a surface, power spectra at speeds and forces, and how far a model is from them.

The spectra are apart for fitting, choosing and proving; they are compared as the device can make them felt.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count, product
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
from texclass.recording import ACCELERATION_UNITS, Recording, Samples

LARGEST_FACTOR = 1000
LEAST_POWER = 1e-12
"""Where the device's noise is 0: powers below this part of the largest one count as that (-120 dB)."""

Piece = tuple[Samples, float, float]
"""A stretch of vibration at the device's rate, at one speed (mm/s) and force (N)."""
Felt = Callable[[float, float, int], Samples]
"""Vibration at a speed (mm/s), a force (N) and a seed, at the device's rate."""
LEAST_RATIO = 1.4
"""Slopes are judged over speeds, and forces, of at least this ratio, largest to smallest."""
Scored = dict[str, Any]
"""Of a model at held-out points: "scores", in the unit of the tolerance's score, and "levels_db" above those
of the surface, one a point; "slopes_db", how much more its level rises from one speed, and force, to twice as
much; "relative": the deciding one in parts of the tolerance; "within": at most 1."""


@dataclass(frozen=True)
class Sampling:
    """Where surfaces are felt, and which pieces of recordings count.

    Attributes
    ----------
    still_mm_s, light_n : float
        Speed (mm/s) and force (N) below which pieces of freehand recordings are left out.
    margin : float
        Pieces this part beyond the expected range are still used.
    seconds, settle_s : float
        Duration at each speed and force, and what is cut off before, s.
    n_speeds, n_forces : int
        Nodes to which models are fitted; between them, and at the corners, they are chosen.
    n_proofs : int
        Random speeds and forces at which the choice is judged.
    """

    still_mm_s: float = 5.0
    light_n: float = 0.02
    margin: float = 0.25
    seconds: float = 4.0
    settle_s: float = 0.5
    n_speeds: int = 8
    n_forces: int = 4
    n_proofs: int = 8


SAMPLING = Sampling()


@dataclass(frozen=True)
class Judge:
    """Compares power spectra within the device's band, above its noise."""

    device: Device
    tolerance: Tolerance

    @cached_property
    def n_segment(self) -> int:
        """Samples per segment of a spectrum: a power of two, at least 512 and 0.1 s."""
        return max(512, 1 << int(np.ceil(np.log2(0.1 * self.device.rate_hz))))

    @cached_property
    def frequencies(self) -> Samples:
        """Of the spectra, Hz, shape (n_segment + 1,): segments are padded, so that no lag wraps around."""
        width = self.device.rate_hz / (2 * self.n_segment)
        return np.asarray(np.arange(self.n_segment + 1) * width, dtype=np.float64)

    @cached_property
    def in_band(self) -> Samples:
        """Width of each bin within the band, Hz, shape (n_bins,)."""
        return np.asarray(self._share(np.array(self.device.band_hz))[0])

    @cached_property
    def parts(self) -> Samples:
        """Means over the parts of the band, shape (n_parts, n_bins)."""
        low, high = self.device.band_hz
        if self.tolerance.score == "band_db":
            first = max(low, 2 * self.frequencies[1])
            n = max(1, round(np.log(high / first) / np.log(2 ** (1 / 3))))
            edges = np.geomspace(first, high, n + 1)
        else:
            n = min(64, max(1, int((high - low) / (2 * self.frequencies[1]))))
            edges = np.linspace(low, high, n + 1)
        share = self._share(edges)
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    @property
    def floor(self) -> float:
        """Power density of the device's noise, unit^2/Hz."""
        low, high = self.device.band_hz
        return self.device.noise_floor**2 / (high - low)

    def spectrum(self, x: ArrayLike) -> Samples:
        """Return the power density (Welch, Hann) of a signal at the device's rate, unit^2/Hz, (n_bins,)."""
        samples = np.asarray(x, dtype=np.float64)
        n = min(self.n_segment, samples.size)
        _, P = signal.welch(
            samples, self.device.rate_hz, "hann", n, nfft=2 * self.n_segment, detrend="constant"
        )
        return np.asarray(P)

    def power(self, spectrum: Samples) -> Samples:
        """Return the power within the band of spectra (..., n_bins), unit^2."""
        return np.asarray(spectrum @ self.in_band)

    def errors(self, recorded: Samples, modelled: Samples) -> tuple[Samples, Samples]:
        """Return scores and differences of level (dB) of spectra (..., n_bins), one by one.

        Scores are those of the tolerance: dB, or GFC.
        """
        largest = (recorded @ self.parts.T).max(axis=-1, keepdims=True)
        least = np.maximum(max(self.floor, 1e-300), LEAST_POWER * largest)
        S, M = (np.maximum(P @ self.parts.T, least) for P in (recorded, modelled))
        mean = [10 * np.log10(P.mean(axis=-1)) for P in (S, M)]
        if self.tolerance.score == "gfc":
            product = np.sqrt(S * M).sum(axis=-1)
            score = product / np.sqrt(S.sum(axis=-1) * M.sum(axis=-1))
        else:
            score = np.sqrt(np.mean((10 * np.log10(M / S)) ** 2, axis=-1))
        return np.asarray(score), np.asarray(mean[1] - mean[0])

    def relative(self, scores: Samples, levels_db: Samples, slopes_db: Samples) -> Samples:
        """Return scores and levels (n_points, ...) and `slopes` in parts of the tolerance: (...)."""
        t = self.tolerance
        miss = (1 - scores) / (1 - t.limit) if t.score == "gfc" else scores / t.limit
        found = miss if t.level_db is None else np.maximum(miss, np.abs(levels_db) / t.level_db)
        decided = found.max(axis=0) if t.over == "worst" else found.mean(axis=0)
        return np.asarray(np.maximum(decided, np.abs(slopes_db).max(axis=0) / t.slope_db))

    def verdict(self, points: "Points", modelled: Samples) -> Scored:
        """Return what spectra of a model (n_points, n_bins) score against those of the surface."""
        scores, levels = self.errors(points.spectra, modelled)
        steeper = slopes(levels, points)
        relative = float(self.relative(scores, levels, steeper))
        return {
            "scores": scores.tolist(),
            "levels_db": levels.tolist(),
            "slopes_db": steeper.tolist(),
            "relative": relative,
            "within": relative <= 1,
        }

    def _share(self, edges: Samples) -> Samples:
        """Return how many Hz of each bin lie between each two edges, shape (n_edges - 1, n_bins)."""
        half = self.frequencies[1] / 2
        below = np.maximum(self.frequencies - half, 0.0)
        above = np.minimum(self.frequencies + half, self.device.rate_hz / 2)
        low, high = edges[:-1, np.newaxis], edges[1:, np.newaxis]
        return np.asarray(np.maximum(np.minimum(above, high) - np.maximum(below, low), 0.0))


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

    @classmethod
    def of(cls, pieces: Sequence[Piece], judge: Judge) -> "Points":
        """Return the spectra of pieces."""
        samples, speed, force = zip(*pieces, strict=True)
        return cls(np.array([judge.spectrum(x) for x in samples]), np.array(speed), np.array(force))

    def in_cells(self) -> "Points":
        """Return the means of neighbours in speed: at most 4 groups, of 6 or more where possible.

        One piece of a freehand recording alone scatters by 4 dB.
        """
        n = int(np.clip(len(self) // 6, 1, 4))
        groups = np.array_split(np.argsort(self.speed, kind="stable"), n)
        return Points(
            *(np.array([a[g].mean(axis=0) for g in groups]) for a in (self.spectra, self.speed, self.force))
        )


def slopes(levels_db: Samples, points: Points) -> Samples:
    """Return how many dB levels (n_points, ...) rise at twice the speed, and at twice the force: (2, ...).

    Least squares over both logarithms at once. 0 over what is nearly the same at all points, see
    `LEAST_RATIO`: there, nothing tells a slope.
    """
    axes = np.log2([points.speed, points.force])
    X = (axes - axes.mean(axis=1, keepdims=True)) * (np.ptp(axes, axis=1) >= np.log2(LEAST_RATIO))[
        :, np.newaxis
    ]
    return np.asarray(np.tensordot(np.linalg.pinv(X.T), levels_db, axes=1))


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
    """

    name: str
    fit: Points
    choose: Points
    prove: Points
    peak: float
    how: str


def observe(name: str, surface: SurfaceDefinition, scene: SceneDefinition, judge: Judge) -> Observed:
    """Return what is known of a surface.

    Raises
    ------
    ValueError
        If its files are bad or too short, its unit is not the device's, or its name is unknown.
    OSError
        If a file cannot be read.
    """
    if surface.texture is not None:
        return _felt(name, scene, judge, _texture(surface.texture, scene))
    if surface.simulated is not None:
        return _felt(name, scene, judge, _simulated(surface.simulated, scene))
    if surface.dataset is not None:
        from texclass.loaders import open_dataset

        label = surface.surface or name
        pieces: list[Piece] = []
        found = [r for r in open_dataset(str(surface.dataset)) if r.surface == label]
        for r in found:
            if r.speed is None or r.normal_force is None:
                raise ValueError(f"surface {name}: {r.recording_id} lacks speed or force. Expected both")
            pieces += _cut(r, r.speed, r.normal_force, scene, judge)
        if not found:
            raise ValueError(
                f"surface {name}: dataset {surface.dataset} has no surface {label!r}. "
                "Expected one of its surfaces"
            )
        return divide_in_time(name, pieces, judge)
    steady = [not isinstance(r.speed, str) and not isinstance(r.force, str) for r in surface.recordings]
    pieces = [p for r in surface.recordings for p in _recorded(r, scene, judge)]
    return (divide_by_speed if all(steady) else divide_in_time)(name, pieces, judge)


def _felt(name: str, scene: SceneDefinition, judge: Judge, felt: Felt) -> Observed:
    """Feel a texture on a grid, between its nodes and at its corners, and at random."""
    ranges = scene.expected.speeds_mm_s, scene.expected.forces_n
    grid = [
        np.geomspace(low, high, n if low < high else 1)
        for (low, high), n in zip(ranges, (SAMPLING.n_speeds, SAMPLING.n_forces), strict=True)
    ]
    between = [np.sqrt(axis[:-1] * axis[1:]) if axis.size > 1 else axis for axis in grid]
    corners = [np.unique(axis[[0, -1]]) for axis in grid]
    low, high = np.log(ranges).T
    drawn = np.exp(np.random.default_rng((scene.seed, 1)).uniform(low, high, (SAMPLING.n_proofs, 2)))
    seeds = count(1)
    pieces = [
        [(felt(float(v), float(f), next(seeds)), float(v), float(f)) for v, f in places]
        for places in (product(*grid), [*product(*between), *product(*corners)], drawn)
    ]
    return _observed(name, pieces, judge, f"{SAMPLING.n_proofs} random speeds and forces")


def _observed(name: str, parts: Sequence[Sequence[Piece]], judge: Judge, how: str) -> Observed:
    peak = max(float(np.abs(x).max()) for pieces in parts for x, _, _ in pieces)
    fit, choose, proved = (Points.of(pieces, judge) for pieces in parts)
    return Observed(name, fit, choose, proved, peak, how)


def divide_in_time(name: str, pieces: Sequence[Piece], judge: Judge) -> Observed:
    """Divide pieces of freehand recordings in time: of four, two to fit, one to choose, one to prove."""
    seconds = judge.n_segment / judge.device.rate_hz
    if len(pieces) < 8:
        raise ValueError(
            f"surface {name}: {len(pieces)} pieces of {seconds:.2g} s within the expected speeds and forces. "
            "Expected at least 8"
        )
    how = f"pieces 2 and 4 of every 4, {seconds:.2g} s each"
    found = _observed(name, (pieces[::2], pieces[1::4], pieces[3::4]), judge, how)
    return replace(found, choose=found.choose.in_cells(), prove=found.prove.in_cells())


def divide_by_speed(name: str, pieces: Sequence[Piece], judge: Judge) -> Observed:
    """Divide recordings at known speeds: every second speed is held out, if there are three or more."""
    out = set(sorted({speed for _, speed, _ in pieces})[1:-1:2])
    held = [piece for piece in pieces if piece[1] in out] or pieces
    begin, middle = (0.0, 0.5) if out else (0.5, 0.75)
    parts = (
        [p for p in pieces if p[1] not in out] if out else _parts(pieces, 0.0, 0.5),
        _parts(held, begin, middle),
        _parts(held, middle, 1.0),
    )
    if min(x.size for part in parts for x, _, _ in part) < judge.n_segment:
        raise ValueError(
            f"surface {name}: a part of a recording is shorter than {judge.n_segment} samples at the "
            "device's rate. Expected longer recordings"
        )
    how = f"speeds {', '.join(f'{v:g}' for v in sorted(out))} mm/s" if out else "the later halves"
    return _observed(name, parts, judge, how)


def _parts(pieces: Sequence[Piece], begin: float, end: float) -> list[Piece]:
    return [(x[int(begin * x.size) : int(end * x.size)], v, f) for x, v, f in pieces]


def _texture(path: Path, scene: SceneDefinition) -> Felt:
    from texclass.haptics.exchange import describe, load_texture

    texture = load_texture(path)
    factor = _factor(describe(path)["unit"], scene.device.unit, path)

    def felt(speed: float, force: float, seed: int) -> Samples:
        settled = round(SAMPLING.settle_s * texture.fs)
        n = round((SAMPLING.seconds + SAMPLING.settle_s) * texture.fs)
        x = constant_stroke(texture, speed, force, n - settled, n_settling=settled, seed=seed)
        return at_rate(factor * x, texture.fs, scene.device.rate_hz)

    return felt


def _simulated(name: str, scene: SceneDefinition) -> Felt:
    family, _, which = name.partition("/")
    if scene.device.unit != "m/s^2":
        raise ValueError(f"unit of the device is {scene.device.unit}. Expected m/s^2 for simulations")
    if family == "catalogue" and which.isdecimal():
        return _catalogued(int(which), scene)
    if family != "abdulali2016":
        raise ValueError(f"simulated is {name!r}. Expected abdulali2016/S1 ... S9 or catalogue/0, 1, ...")

    from texclass.haptics.textures.resonant_surfaces import get_surface

    what, fs = get_surface(which), scene.device.rate_hz

    def felt(speed: float, force: float, seed: int) -> Samples:
        n = round(SAMPLING.seconds * fs)
        rng = np.random.default_rng((scene.seed, seed))
        x = what.vibration(np.tile([speed, 0.0], (n, 1)), np.full(n, force), fs, rng)
        return at_rate(x, fs, fs)

    return felt


def _catalogued(which: int, scene: SceneDefinition) -> Felt:
    from texclass.signals import combine, remove_hand_motion
    from texclass.simulate import operator_catalogue, record_rising_speed, surface_catalogue

    what, operator = surface_catalogue(which + 1, 0)[which], operator_catalogue(1, 0)[0]
    fs = max(2000.0, scene.device.rate_hz)

    def felt(speed: float, force: float, seed: int) -> Samples:
        plate = record_rising_speed(
            what,
            operator,
            duration_s=SAMPLING.seconds + SAMPLING.settle_s,
            fs=fs,
            seed=(scene.seed, which, seed),
            speed_mm_s=(speed, speed),
            force_n=force,
        )
        moving = combine(plate.acceleration[round(SAMPLING.settle_s * fs) :])
        return at_rate(remove_hand_motion(moving, fs), fs, scene.device.rate_hz)

    return felt


def _recorded(recording: RecordingDefinition, scene: SceneDefinition, judge: Judge) -> list[Piece]:
    from texclass.loaders import load_recording

    given = {"speed": recording.speed, "normal_force": recording.force}
    named = {field: column for field, column in given.items() if isinstance(column, str)}
    unit = recording.unit or scene.device.unit
    found = load_recording(
        recording.file, fs=recording.fs_hz, unit=unit, column=recording.column, auxiliary=named
    )
    if not named:
        return [(_vibration(found, scene), float(recording.speed), float(recording.force))]
    n = len(found.acceleration)
    speed, force = (getattr(found, f) if f in named else np.full(n, value) for f, value in given.items())
    return _cut(found, speed, force, scene, judge)


def _cut(
    found: Recording, speed: Samples, force: Samples, scene: SceneDefinition, judge: Judge
) -> list[Piece]:
    """Cut a freehand recording into pieces of one segment each, within what is expected of the hand."""
    x, n = _vibration(found, scene), judge.n_segment
    when, clock = np.arange(x.size) / scene.device.rate_hz, np.arange(len(found.acceleration)) / found.fs
    v, f = (np.interp(when, clock, one) for one in (speed, force))
    cut = [slice(i, i + n) for i in range(0, x.size - n + 1, n)]
    pieces = [(x[s], float(v[s].mean()), float(f[s].mean())) for s in cut]
    (slow, fast), (light, hard) = scene.expected.speeds_mm_s, scene.expected.forces_n
    return [
        piece
        for piece in pieces
        if max(SAMPLING.still_mm_s, slow * (1 - SAMPLING.margin)) <= piece[1] <= fast * (1 + SAMPLING.margin)
        and max(SAMPLING.light_n, light * (1 - SAMPLING.margin)) <= piece[2] <= hard * (1 + SAMPLING.margin)
    ]


def _vibration(found: Recording, scene: SceneDefinition) -> Samples:
    from texclass.signals import combine

    where = found.source or found.recording_id
    if found.fs < 2 * scene.device.band_hz[1]:
        raise ValueError(
            f"{where}: fs is {found.fs:g} Hz. Expected twice the end of the band, "
            f"{2 * scene.device.band_hz[1]:g} Hz, at least"
        )
    x = combine(np.asarray(found.acceleration, dtype=np.float64))
    return at_rate(_factor(found.unit, scene.device.unit, where) * x, found.fs, scene.device.rate_hz)


def _factor(unit: str, wanted: str, where: object) -> float:
    if unit == wanted:
        return 1.0
    if unit in ACCELERATION_UNITS and wanted in ACCELERATION_UNITS:
        return ACCELERATION_UNITS[unit] / ACCELERATION_UNITS[wanted]
    raise ValueError(f"{where}: unit is {unit}, the device's {wanted}. Expected the same, or both known")


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
            f"rates are {fs:g} and {rate:g} Hz. Expected a ratio of whole numbers up to {LARGEST_FACTOR}"
        )
    return np.asarray(signal.resample_poly(centred, up, down))
