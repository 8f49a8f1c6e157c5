"""Compute the results for `guruswamy2011`: scans, recovery, other speeds, and real recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from guruswamy2011_objects import OBJECTS, ROW, TABLE_1, Samples, SimulatedObject, lay_out, simulate_scan
from scipy import ndimage, signal

from texclass import signals
from texclass.haptics.textures.guruswamy2011 import (
    RESOLUTION,
    Amplitude,
    FittedScan,
    LevelLaw,
    SpatialTexture,
    extract_profile,
    fit_level_law,
    fit_modes,
    fit_responses,
    fit_sinusoid,
    fit_texture,
    normalise_acceleration,
)
from texclass.haptics.textures.guruswamy2011.fit import LOWER_HZ
from texclass.haptics.textures.scan import Scan
from texclass.vibration import DecayingModes, PronyFilter, fit_prony
from texclass.vibration.decaying_modes import prony
from texclass.vibration.scores import goodness_of_fit, mean_absolute_difference

DURATION_S = 10.0
"""Duration in s of a scan at the speed of the object."""
N_REPEATED, N_LEVELS = 5, 40
SPEEDS = (0.5, 4.0)
"""Range of speeds of the regression, relative to the speed of the object."""
SPEED_STEPS = (1.0, 2.0, 4.0)
"""Speeds of figures 11 and 12, relative to the speed of the scan."""
BOUNDS = {"segments per mm": 0.10, "f_major": 2.0, "k_v": 0.05, "a_0": 0.05}
"""Required accuracy of the recovery: in Hz for f_major, otherwise relative."""
PRONY_ORDERS = (11, 16, 106)
"""Filter orders in figure 4."""
N_DRAWS = 2000
"""Number of bootstrap samples."""
RELATIVE_BIT = 0.17
"""Ratio of resolution to RMS, used if the sensor resolution is unknown; as in the scans of the paper."""
HIGHEST_HZ = 350.0
"""Upper band limit for `stylus6` in Hz, which excludes a device line at 400 Hz and converter noise."""
LINES_HZ = (100.0, 200.0, 300.0)
"""Other spectral lines of the device in Hz, which are present in all six recordings."""


def stream(seed: int, *keys: int) -> np.random.Generator:
    """Return the random number generator for one part of the study."""
    return np.random.default_rng([seed, 2011, *keys])


# Scans of simulated objects ---------------------------------------------------------------------------------


def repeated_scans(
    thing: SimulatedObject, rng: np.random.Generator, duration_s: float = DURATION_S
) -> list[Scan]:
    """Scan a section five times: once at the published speed and force, then with the spread of a hand."""
    section = lay_out(thing, duration_s * thing.speed, rng)
    hand = [(1.0, 1.0), *np.exp(0.12 * rng.standard_normal((N_REPEATED - 1, 2)))]
    return [simulate_scan(thing, section, rng, speed=thing.speed * v, force=thing.force * f) for v, f in hand]


def level_scans(
    thing: SimulatedObject,
    rng: np.random.Generator,
    *,
    repeatability: float = 0.01,
    force_spread: float = 0.12,
    n_scans: int = N_LEVELS,
) -> list[Scan]:
    """Scan a section at many speeds; `force_spread` is the standard deviation of the log force."""
    section = lay_out(thing, DURATION_S * thing.speed, rng)
    speeds = thing.speed * np.geomspace(*SPEEDS, n_scans)
    forces = thing.force * np.exp(force_spread * rng.standard_normal(n_scans))
    return [
        simulate_scan(thing, section, rng, speed=v, force=f, repeatability=repeatability)
        for v, f in zip(speeds, forces, strict=True)
    ]


def _amplitude(scan: Scan, law: LevelLaw) -> Amplitude:
    return Amplitude(law, float(scan.speed.mean()), float(scan.force.mean()))


# Rows of the tables -----------------------------------------------------------------------------------------


def published_row(scan: Scan, law: LevelLaw, resolution: float = RESOLUTION) -> dict[str, Any]:
    """Measure a scan as in the paper: band, segments, and Prony filters from order n_extrema upwards.

    Returns
    -------
    dict
        row (by `ROW`), unstable (fraction of unstable filters), sad_sum (difference of the sum of the stable
        filters, tails included, to the band-passed profile in mm/s^2).
    """
    scaling = _amplitude(scan, law)
    a = normalise_acceleration(scan, scaling)
    profile = extract_profile(a, scan.fs, resolution=resolution)
    filters = fit_published(profile.segmentation.split(profile.samples), resolution)
    bounds = profile.segmentation.bounds
    model = np.concatenate([f.synthesize(n)[:n] for f, n in zip(filters, np.diff(bounds), strict=True)])
    total = np.zeros_like(model)
    for f, start, stop in zip(filters, bounds[:-1], bounds[1:], strict=True):
        end = total.size if f.is_stable else stop
        total[start:end] += f.synthesize(end - start)
    values = (
        profile.band.upper_hz,
        profile.band.major_hz,
        profile.segmentation.n_segments / scan.distance_mm[-1],
        float(np.mean([f.order + 1 for f in filters])),
        1e3 * mean_absolute_difference(profile.samples, model),
        1e3 * mean_absolute_difference(a - a.mean(), model),
        scaling.speed,
        scaling.force,
    )
    return {
        "row": dict(zip(ROW, values, strict=True)),
        "unstable": float(np.mean([not f.is_stable for f in filters])),
        "sad_sum": 1e3 * mean_absolute_difference(profile.samples, total),
    }


def fit_published(segments: Sequence[Samples], resolution: float) -> list[PronyFilter]:
    """Fit each segment by Prony's method as in the paper, from order = number of extrema upwards.

    Some of these filters are unstable and are used for comparison only.
    """
    return [fit_prony(np.pad(x, (0, max(0, 2 - x.size))), resolution) for x in segments]


def modes_row(fitted: FittedScan, law: LevelLaw) -> dict[str, float]:
    """Measure the default texture of a scan and the baseline, as the sums of all filters with their tails."""
    n, fs = len(fitted.scan), fitted.scan.fs
    total = fitted.responses.sum(n, fs)
    baseline = fit_texture(fitted.scan, law, method="sinusoid").responses.sum(n, fs)
    return {
        "poles": float(np.mean([n_poles(modes) for modes in fitted.responses.modes])),
        "sad_bandpass": 1e3 * mean_absolute_difference(fitted.profile.samples, total),
        "sad_original": 1e3 * mean_absolute_difference(fitted.acceleration, total),
        "sad_sinusoid": 1e3 * mean_absolute_difference(fitted.profile.samples, baseline),
    }


def filter_losses(scan: Scan, law: LevelLaw) -> dict[str, float]:
    """Measure what the band-pass filter removes from a scan, as mean absolute differences in mm/s^2.

    Returns
    -------
    dict
        profile (between the profile and the scan), magnitude (the same if the filter changed no phases) and
        power_above (fraction of the power above the cut-off).
    """
    a = normalise_acceleration(scan, _amplitude(scan, law))
    a = a - a.mean()
    profile = extract_profile(a, scan.fs)
    is_wide = profile.cutoff_hz >= scan.fs / 2
    sos = signals.butterworth(
        "highpass" if is_wide else "bandpass",
        LOWER_HZ if is_wide else (LOWER_HZ, profile.cutoff_hz),
        scan.fs,
    )
    spectrum, f = np.fft.rfft(a), np.fft.rfftfreq(a.size, 1 / scan.fs)
    magnitude = np.fft.irfft(spectrum * np.abs(signal.freqz_sos(sos, f, fs=scan.fs)[1]), a.size)
    power = np.abs(spectrum) ** 2
    return {
        "profile": 1e3 * mean_absolute_difference(a, profile.samples),
        "magnitude": 1e3 * mean_absolute_difference(a, magnitude),
        "power_above": float(power[f > profile.cutoff_hz].sum() / power.sum()),
    }


def n_poles(modes: DecayingModes) -> int:
    """Return the order of a filter: two for a sinusoid, one for an exponential."""
    return int(np.sum(1 + (modes.frequency_hz > 0)))


def fits_by_order(segment: Samples, fs: float, resolution: float) -> list[dict[str, Any]]:
    """Fit a segment by a decaying sinusoid, by Prony's method with the orders of the paper, and by modes."""
    fits = [_of_modes("decaying sinusoid", fit_sinusoid(segment, fs), segment, fs)]
    for order in PRONY_ORDERS:
        filter_ = prony(segment, order)
        with np.errstate(over="ignore", invalid="ignore"):
            response = filter_.synthesize(segment.size)
        measures = {"pole_radius": filter_.pole_radius, "error": filter_.error, "response": response}
        fits.append({"method": "Prony", "order": order} | measures)
    return [*fits, _of_modes("stable modes", fit_modes(segment, fs, resolution), segment, fs)]


def _of_modes(method: str, modes: DecayingModes, segment: Samples, fs: float) -> dict[str, Any]:
    response = modes.synthesize(segment.size, fs)
    return {
        "method": method,
        "order": n_poles(modes),
        "pole_radius": float(np.exp(-modes.decay_per_s.min(initial=np.inf) / fs)),
        "error": float(np.mean(np.abs(segment - response))),
        "response": response,
    }


# Recovery ---------------------------------------------------------------------------------------------------


def recover(thing: SimulatedObject, seed: int, *, repeatability: float = 0.01) -> Samples:
    """Return the errors of one trial, in the order of `BOUNDS`, from one scan and forty scans for the law."""
    rng = stream(seed, 50, [each.name for each in OBJECTS].index(thing.name))
    law = fit_level_law(level_scans(thing, rng, repeatability=repeatability), thing.law.k_c).law
    section = lay_out(thing, DURATION_S * thing.speed, rng)
    scan = simulate_scan(thing, section, rng)
    profile = extract_profile(normalise_acceleration(scan, _amplitude(scan, law)), scan.fs)
    return np.array([
        profile.segmentation.n_segments / scan.distance_mm[-1] / thing.density_per_mm - 1,
        profile.band.major_hz - TABLE_1[thing.name][ROW.index("f_major_hz")],
        law.k_v / thing.law.k_v - 1,
        law.a_0 / thing.law.a_0 - 1,
    ])  # fmt: skip


def recoveries(seed: int, n_trials: int, *, repeatability: float = 0.01) -> dict[str, Samples]:
    """Return the errors over many sections of every object, shape (4, n_trials); f_major in Hz."""
    return {
        thing.name: np.stack(
            [recover(thing, seed + 1000 * i, repeatability=repeatability) for i in range(n_trials)], axis=1
        )
        for thing in OBJECTS
    }


def within_bounds(errors: Samples) -> dict[str, tuple[float, float, int]]:
    """Return median and 95th percentile of the absolute error, and the number of trials within `BOUNDS`."""
    return {
        quantity: (float(np.median(row)), float(np.quantile(row, 0.95)), int(np.sum(row <= bound)))
        for (quantity, bound), row in zip(BOUNDS.items(), np.abs(errors), strict=True)
    }


# Textures against scans at other speeds, and along random paths ---------------------------------------------


def compare_speeds(
    thing: SimulatedObject, rng: np.random.Generator, duration_s: float = DURATION_S
) -> tuple[SpatialTexture, list[dict[str, Any]]]:
    """Fit a texture to a slow scan, and render it along scans of the same section at other speeds.

    Each comparison is limited to the band of the texture. Its keys are scan, rendered, fit (GFC), level (RMS
    ratio of rendered and scanned vibration) and level_printed (level without compensation, see `Amplitude`).
    """
    section = lay_out(thing, duration_s * thing.speed, rng)
    fitted = fit_texture(simulate_scan(thing, section, rng), thing.law)
    texture, pairs = fitted.texture, []
    plain = replace(texture, scaling=replace(texture.scaling, compensated=False))
    for step in SPEED_STEPS:
        scan = simulate_scan(thing, section, rng, speed=step * thing.speed)
        a = limit_band(scan.acceleration, fitted.profile.cutoff_hz, scan.fs)
        rendered, printed = (
            each.renderer().process(scan.velocity, scan.force, scan.position) for each in (texture, plain)
        )
        levels = [float(np.sqrt(np.mean(y**2) / np.mean(a**2))) for y in (rendered, printed)]
        scores = {"fit": goodness_of_fit(a, rendered), "level": levels[0], "level_printed": levels[1]}
        pairs.append({"scan": scan, "rendered": rendered} | scores)
    return texture, pairs


def limit_band(acceleration: Samples, cutoff_hz: float, fs: float) -> Samples:
    """Filter a recording to the band of a texture."""
    a: Samples = np.asarray(acceleration - acceleration.mean())
    if cutoff_hz >= fs / 2:
        return a
    return np.asarray(signals.causal(signals.butterworth("lowpass", cutoff_hz, fs), a)[0])


def random_paths(
    textures: Sequence[SpatialTexture], rng: np.random.Generator, n_paths: int = 1000, n_samples: int = 500
) -> dict[str, Any]:
    """Render random paths: smooth motion, jumps, rest, lifting, speeds up to 5 m/s, forces up to 20 N.

    Returns n_paths, largest (output over the recorded peak), limited (fraction of samples at the limit),
    most_ringing (largest number of active modes) and finite.
    """
    largest, limited, ringing, finite = 0.0, 0, 0, True
    for i in range(n_paths):
        texture = textures[i % len(textures)]
        renderer = texture.renderer()
        fastest, hardest = 10 ** rng.uniform(0, 3.7), 10 ** rng.uniform(-1, 1.3)
        velocity = fastest * _smooth(rng.standard_normal((n_samples, 2)))
        force = hardest * (_smooth(rng.standard_normal((n_samples, 1)))[:, 0] + rng.uniform(-0.5, 1))
        position = np.cumsum(velocity, axis=0) / texture.fs
        if i % 4 == 0:  # path with jumps
            position += 100 * np.round(rng.random((n_samples, 1)) - 0.49)
        for part in np.array_split(np.arange(n_samples), 8):
            out = renderer.process(velocity[part], force[part], position[part])
            relative = np.abs(out) / texture.peak
            finite = finite and bool(np.all(np.isfinite(out)))
            largest = max(largest, float(relative.max()))
            limited += int(np.sum(relative >= 7.999))
            ringing = max(ringing, renderer.n_ringing)
    return {
        "n_paths": n_paths,
        "largest": largest,
        "limited": limited / (n_paths * n_samples),
        "most_ringing": ringing,
        "finite": finite,
    }


def _smooth(x: Samples) -> Samples:
    y = ndimage.gaussian_filter1d(x, 25, axis=0)
    return np.asarray(y / max(float(np.abs(y).max()), 1e-12))


# Real recordings: a freehand stylus with speed and force, and excerpts without ------------------------------


def clean(scan: Scan) -> Scan:
    """Remove device lines, and outliers of speed and force, from a `stylus6` scan."""
    a = signals.lowpass(scan.acceleration - scan.acceleration.mean(), HIGHEST_HZ, scan.fs)
    for line in LINES_HZ:
        a = signal.filtfilt(*signal.iirnotch(line, line / 2.0, scan.fs), a)  # 2 Hz wide
    speed = ndimage.median_filter(scan.speed, 51)
    force = ndimage.median_filter(scan.force, 51)
    return Scan.along_line(a, speed, force, scan.fs, scan.name)


def held_out(scan: Scan, *, window_s: float = 0.25) -> dict[str, Any]:
    """Fit law and texture to the first half of a freehand scan, and render its second half.

    Returns name, law and r_squared; for the first half f_max_hz, f_major_hz, segments_per_mm, poles and
    sad_bandpass (relative to the mean absolute profile); for the second half level (RMS ratio of rendered and
    recorded vibration), fit (GFC) and level_correlation (of the RMS in windows).
    """
    n = len(scan) // 2
    first, second = scan.crop(0, n), scan.crop(n, 2 * n)
    size = int(window_s * scan.fs)
    level = fit_level_law([first.crop(i, i + size) for i in range(0, n - size + 1, size)])
    resolution = RELATIVE_BIT * float(first.acceleration.std())
    fitted = fit_texture(first, level.law, resolution=resolution, course="travelled")
    rendered = fitted.texture.renderer().process(second.velocity, second.force, second.position)
    recorded = limit_band(second.acceleration, fitted.profile.cutoff_hz, scan.fs)
    levels = [
        np.sqrt(np.mean(x[: x.size // size * size].reshape(-1, size) ** 2, axis=1))
        for x in (recorded, rendered)
    ]
    return {
        "name": scan.name,
        "law": level.law,
        "r_squared": level.r_squared,
        **_band(fitted),
        "segments_per_mm": fitted.profile.segmentation.n_segments / first.distance_mm[-1],
        "poles": float(np.mean([n_poles(modes) for modes in fitted.responses.modes])),
        "sad_bandpass": _relative_difference(fitted),
        "level": float(np.sqrt(np.mean(rendered**2) / np.mean(recorded**2))),
        "fit": goodness_of_fit(recorded, rendered),
        "level_correlation": float(np.corrcoef(*levels)[0, 1]),
    }


def excerpt(acceleration: Samples, fs: float, name: str) -> dict[str, Any]:
    """Fit the filters of a recording without speed and force, in any unit."""
    scan = Scan.along_line(acceleration, 100.0, 1.0, fs, name)
    fitted = fit_texture(scan, resolution=RELATIVE_BIT * float(np.std(acceleration)))
    return {
        "name": name,
        **_band(fitted),
        "segments_per_s": fitted.profile.segmentation.n_segments / len(scan) * fs,
        "poles": float(np.mean([n_poles(modes) for modes in fitted.responses.modes])),
        "sad_bandpass": _relative_difference(fitted),
    }


# Complexity of segments -------------------------------------------------------------------------------------

COMPLEXITY_FS = 1000.0
"""Sampling rate in Hz at which segments of real and simulated scans are compared: that of `stylus6`."""
COMPLEXITY = ("order", "order_per_dof", "poles", "poles_per_dof")
"""Measures of the complexity of a segment. T s with a band of B Hz have 2 B T degrees of freedom (dof)."""


def segment_complexity(acceleration: Samples, name: str) -> dict[str, Any]:
    """Fit the segments of a scan at `COMPLEXITY_FS`, with a resolution relative to its RMS.

    Returns
    -------
    dict
        name, f_max_hz, segment_s (mean duration), order (mean order of Prony's method), order_per_dof
        (relative to the degrees of freedom 2 f_max_hz segment_s), poles (mean number of poles of the stable
        modes) and poles_per_dof.
    """
    a = acceleration - acceleration.mean()
    resolution = RELATIVE_BIT * float(a.std())
    profile = extract_profile(a, COMPLEXITY_FS, resolution=resolution)
    segments = profile.segmentation.split(profile.samples)
    order = float(np.mean([f.order for f in fit_published(segments, resolution)]))
    bounds = profile.segmentation.bounds.tolist()
    responses = fit_responses(profile.samples, bounds, COMPLEXITY_FS, resolution)
    poles = float(np.mean([n_poles(modes) for modes in responses.modes]))
    duration = a.size / COMPLEXITY_FS / len(segments)
    dof = 2 * profile.band.upper_hz * duration
    return {
        "name": name,
        "f_max_hz": profile.band.upper_hz,
        "segment_s": duration,
        "order": order,
        "order_per_dof": order / dof,
        "poles": poles,
        "poles_per_dof": poles / dof,
    }


def published_complexity(name: str) -> dict[str, Any]:
    """Return the measures of `segment_complexity` that follow from Table I; the number of poles does not."""
    row = dict(zip(ROW, TABLE_1[name], strict=True))
    duration = 1 / (row["segments_per_mm"] * row["speed"])
    order = row["order"] - 1
    per_dof = order / (2 * row["f_max_hz"] * duration)
    names = {"name": name, "f_max_hz": row["f_max_hz"], "segment_s": duration}
    return names | {"order": order, "order_per_dof": per_dof, "poles": None, "poles_per_dof": None}


def compare_complexity(
    simulated: Sequence[dict[str, Any]], real: Sequence[dict[str, Any]], rng: np.random.Generator
) -> dict[str, tuple[float, float, float]]:
    """Return the ratio of the medians of simulated and real scans, and its 95 % bootstrap interval.

    Recordings of one surface are averaged first; the surfaces are resampled.
    """
    ours, theirs = (pd.DataFrame(each).groupby("name")[list(COMPLEXITY)].mean() for each in (simulated, real))

    def ratio(first: pd.DataFrame, second: pd.DataFrame) -> Samples:
        return np.asarray(first.median() / second.median())

    draws = [
        ratio(*(each.iloc[rng.integers(len(each), size=len(each))] for each in (ours, theirs)))
        for _ in range(N_DRAWS)
    ]
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return {
        name: (float(value), float(a), float(b))
        for name, value, a, b in zip(COMPLEXITY, ratio(ours, theirs), low, high, strict=True)
    }


def simpler_verdict(ratios: Mapping[str, tuple[float, float, float]]) -> str:
    """Return whether simulated segments are simpler, which requires intervals below 1."""
    n_below = sum(high < 1 for _, _, high in ratios.values())
    if n_below == len(ratios):
        return "holds"
    return "holds in part" if n_below else "does not hold"


def _band(fitted: FittedScan) -> dict[str, float]:
    return {"f_max_hz": fitted.profile.band.upper_hz, "f_major_hz": fitted.profile.band.major_hz}


def _relative_difference(fitted: FittedScan) -> float:
    x = fitted.profile.samples
    total = fitted.responses.sum(x.size, fitted.scan.fs)
    return float(np.mean(np.abs(x - total)) / np.mean(np.abs(x)))
