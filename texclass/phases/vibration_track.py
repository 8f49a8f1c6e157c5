"""Vibration level of a recording over time, relative to its noise floor."""

import functools
from dataclasses import dataclass, replace

import numpy as np
import scipy

from texclass.phase_settings import PhaseSettings
from texclass.phases.defects import GLITCHES, fade_length, find_data, find_glitches, interpolate_glitches
from texclass.phases.high_pass import high_pass_power
from texclass.phases.impulses import Levels, bin_means, moving_mean
from texclass.recording import Recording, Samples
from texclass.signals import butterworth

Span = tuple[int, int]
"""Half-open range [first, stop) of bins."""
MIN_LEVEL_SAMPLES = 20
"""Smallest number of samples that give a reliable level."""
NO_POWER = 1e-14
"""Smallest noise relative to the power of the strongest bin. A smaller power is a rounding error."""


@dataclass(frozen=True, eq=False)
class Track:
    """Vibration of one recording over time.

    Attributes
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        Acceleration without glitches.
    power : ndarray of shape (n_rows,)
        Squared acceleration above hand motion, summed over channels. Each row is an average of `step`
        samples.
    levels : Levels
        Power relative to the noise, per bin.
    noise : float
        Mean of `power` at rest.
    is_steady : bool
        Whether the level of the quietest window is steady, so that this window counts as quiet.
    data, full : tuple of int
        Range of the bins with data, and range of the bins between fade-in and fade-out.
    step, bin_size : int
        Number of samples per row, and number of rows per bin.
    correlation : float
        Autocorrelation of the vibration at a lag of one row, from -1 to 1.
    """

    axes: Samples
    power: Samples
    levels: Levels
    noise: float
    is_steady: bool
    data: Span
    full: Span
    step: int
    bin_size: int
    correlation: float

    @property
    def bin_samples(self) -> int:
        """Number of samples of the recording per bin."""
        return self.bin_size * self.step


def track(recording: Recording, settings: PhaseSettings) -> Track:
    """Return the vibration of a recording above tremor and hand motion, relative to the noise.

    1. Exclude padding and glitches, and remove hand motion.
    2. Average the power over bins, in all bands and in the soft band.
    3. Exclude fades, and estimate the noise floor in the quietest windows.
    4. Divide by the noise, and combine both bands.
    """
    samples = recording.acceleration.reshape(recording.n_samples, -1)
    step = max(1, int(recording.fs // settings.rate_hz))
    rate = recording.fs / step
    bin_size = max(1, round(settings.bin_s * rate))
    bin_s, bin_samples = bin_size / rate, bin_size * step

    data, glitches = find_data(samples, recording.fs), find_glitches(samples)
    GLITCHES[recording] = glitches
    axes = interpolate_glitches(samples, glitches)
    high_pass = _hand_filter(settings.hand_hz, rate)
    soft_band = _soft_filter(settings.soft_band_hz, 1 / bin_s)
    power, means, correlation = high_pass_power(axes, data.rest, data.first, high_pass, step, bin_size)
    broadband = bin_means(power, bin_size)
    soft = np.square(scipy.signal.sosfilt(soft_band, means)).sum(axis=0)

    n_bins = broadband.size
    first = -(-data.first // bin_samples)
    stop = max(first, data.stop // bin_samples) if data.stop < len(samples) else n_bins
    for level in (broadband, soft):
        level[:first] = level[stop:] = 0.0
    full = _without_fades(samples[data.first : data.stop], broadband, (first, stop), bin_samples, bin_s)

    n_quiet = max(1, min(round(settings.quiet_s / bin_s), n_bins // 16))
    usable = slice(*full) if full[1] - full[0] >= n_quiet else slice(first, max(stop, first + 1))
    noise, is_steady, is_intermittent = noise_floor(
        broadband[usable], n_quiet, bin_size * axes.shape[1], settings
    )
    noise = max(noise, NO_POWER * float(broadband.max()))
    # `axes` cannot be used here, because interpolated glitches lie between two steps of the converter.
    if not np.ptp(samples[:200], axis=0).all() or _quantisation_noise(samples[:200]) > noise:
        noise = max(noise, _quantisation_noise(samples[:50_000]))  # more samples show smaller steps
    levels = replace(
        _levels(broadband, soft, noise, usable, bin_s, settings),
        min_bins=-(-MIN_LEVEL_SAMPLES // bin_samples),
    )
    if is_intermittent:
        levels = replace(levels, strokes=settings.noisy_weight * levels.strokes)
    return Track(axes, power, levels, noise, is_steady, (first, stop), full, step, bin_size, correlation)


def _levels(
    broadband: Samples, soft: Samples, noise: float, usable: slice, bin_s: float, settings: PhaseSettings
) -> Levels:
    """Return the power relative to the noise. The soft band is scaled separately.

    A bin of the soft band counts as an impulse, even if it is weak, when it exceeds the level that noise
    reaches only once in 100,000 bins.
    """
    broadband = broadband / noise if noise > 0 else np.zeros_like(broadband)
    soft = moving_mean(soft, round(settings.soft_s / bin_s))
    calm = moving_mean(broadband, round(settings.calm_s / bin_s))
    at_rest = soft[usable][calm[usable] < settings.unrest_ratio]
    if noise == 0 or len(at_rest) * bin_s < 0.05 or (median := float(np.median(at_rest))) == 0:
        return Levels(broadband, broadband, broadband, bin_s)
    rare = median * (np.quantile(at_rest, 0.9) / median) ** settings.soft_tail
    is_impulse = soft > rare
    soft = soft / max(settings.soft_margin * median, NO_POWER * soft.max())
    strokes = np.where(calm > settings.unrest_ratio, np.maximum(broadband, soft / 2), broadband)
    soft = np.where(is_impulse, np.maximum(soft, settings.soft_impulse), soft)
    return Levels(broadband, np.maximum(broadband, soft), strokes, bin_s)


@functools.cache
def _hand_filter(hand_hz: float, rate: float) -> Samples:
    return butterworth("highpass", min(hand_hz, 0.2 * rate), rate)


@functools.cache
def _soft_filter(band_hz: tuple[float, float], rate: float) -> Samples:
    low, high = band_hz
    return butterworth("bandpass", (min(low, 0.1 * rate), min(high, 0.4 * rate)), rate, order=2)


def _without_fades(axes: Samples, broadband: Samples, data: Span, bin_samples: int, bin_s: float) -> Span:
    """Return the bins of `data` between fade-in and fade-out.

    Fades are detected in the vibration and in the unfiltered signal, which contains gravity.
    """

    def fade_bins(axes: Samples, level: Samples) -> int:
        def raw_power(start: int, stop: int) -> float:
            return float(np.square(axes[start * bin_samples : stop * bin_samples]).sum(axis=1).mean())

        n_bins = -(-len(axes) // bin_samples)
        n_vibration = fade_length(lambda start, stop: float(level[start:stop].mean()), len(level), bin_s)
        return max(n_vibration, fade_length(raw_power, n_bins, bin_s))

    level = broadband[slice(*data)]
    return data[0] + fade_bins(axes, level), data[1] - fade_bins(axes[::-1], level[::-1])


def noise_floor(
    level: Samples, n: int, samples_per_bin: int, settings: PhaseSettings
) -> tuple[float, bool, bool]:
    """Return the noise level, and whether the quietest `n` bins are steady and the noise is intermittent.

    The estimate starts with the quietest window. In four iterations, it is replaced by the average over all
    windows up to 4 dB above it. An upper limit relative to the quietest window applies, because louder
    "noise" may consist of strokes. The limit is higher if the recording also contains much stronger
    vibration. A steady start of a recording counts as noise, because an automatic gain control may reduce the
    noise later.
    """
    n = min(n, len(level))
    means = moving_mean(level, n)[n // 2 : len(level) - (n - 1) // 2]
    start = int(np.argmin(means))
    window = level[start : start + n]
    tolerance = 1 + settings.steady_samples / (n * samples_per_bin)
    noise = quietest = float(window.mean())
    window_levels = means[:: max(1, n // 5)]
    is_noisy = window_levels.max() > settings.noisy_contrast * quietest
    highest = (settings.noisy_spread if is_noisy else settings.quiet_spread) * quietest
    for _ in range(4):
        at_rest = window_levels[window_levels <= min(2.5 * noise, highest)]
        noise = max(quietest, float(at_rest.mean()) if at_rest.size else 0.0)
    opening = level[: 2 * n]
    if (
        is_noisy
        and noise < opening.mean() <= settings.opening_spread * quietest
        and _is_steady(opening, tolerance * settings.opening_ratio)
    ):
        noise = float(opening.mean())
    is_intermittent = noise > settings.quiet_spread * quietest
    return noise, _is_steady(window, tolerance * settings.steady_ratio), is_intermittent


def _is_steady(level: Samples, tolerance: float) -> bool:
    """Return whether the means of five equal parts of a level differ by at most the ratio `tolerance`."""
    fifths = [part.mean() for part in np.array_split(level, min(5, len(level)))]
    return bool(max(fifths) <= tolerance * min(fifths))


def _quantisation_noise(axes: Samples) -> float:
    """Return the quantisation noise q^2 / 12 (q: smallest step of a channel), summed over channels."""
    steps = np.abs(np.diff(np.ascontiguousarray(axes.T)))
    steps[steps == 0] = np.inf
    smallest = steps.min(axis=1, initial=np.inf)
    return float(np.square(smallest[np.isfinite(smallest)]).sum() / 12)
