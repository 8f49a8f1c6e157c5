"""The numbers behind the figures and tables of `okamura2001`; nothing is drawn here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.textures.okamura2001.device import Device, scale_into
from texclass.textures.okamura2001.factorial import FactorialResult, analyse
from texclass.textures.okamura2001.identification import IdentificationTest, noise_for, simulate_test
from texclass.textures.okamura2001.library import TapLibrary
from texclass.textures.okamura2001.onset import AlignedTaps, fit_aligned, slope_through_origin
from texclass.textures.okamura2001.simulated import (
    FS,
    MATERIALS,
    MOST_SENSITIVE,
    TABLE_I,
    TABLE_II,
    VELOCITIES_M_S,
    SimulatedTaps,
    simulate_ratings,
    simulate_taps,
)
from texclass.textures.okamura2001.wall import VirtualWall

N_SEEDS = 50
N_TAPS = 24
VELOCITY_ERRORS = (0.02, 0.06)
"""Relative: a good tracker, and one with which figure 4 scatters as published (R^2 = 0.98 for rubber)."""
N_EXPERIMENTS, PUBLISHED_CORRECT, N_EXPERTS = 42, 35, 18
TAP_DEPTH_MM, TAP_S = 3.0, 0.12


@dataclass(frozen=True, eq=False)
class Recovery:
    """Errors of A, B and w, relative to the truth, over the seeds.

    Attributes
    ----------
    errors : dict of str to ndarray of shape (n_seeds, 3)
        By material.
    r_squared : dict of str to float
        Of amplitude on velocity, median over the seeds.
    """

    errors: dict[str, Samples]
    r_squared: dict[str, float]


@dataclass(frozen=True, eq=False)
class RealTaps:
    """The same fit on real taps whose rate is unknown: time in samples.

    Attributes
    ----------
    decay, frequency : ndarray of shape (n_taps,)
        B per sample and w in cycles per sample of each tap, NaN where no fit was possible.
    explained : ndarray of shape (n_taps,)
        Part of the tap's energy that one decaying sinusoid accounts for.
    example, fitted : ndarray of shape (n_samples,)
        One tap, and what its model makes of it.
    """

    decay: Samples
    frequency: Samples
    explained: Samples
    example: Samples
    fitted: Samples


@dataclass(frozen=True, eq=False)
class WallTrace:
    """Two taps on a virtual wall: time (s), depth (mm), velocity (mm/s), force (N) and that of the spring."""

    time_s: Samples
    depth_mm: Samples
    velocity_mm_s: Samples
    force_n: Samples
    spring_n: Samples


@dataclass(frozen=True, eq=False)
class Study:
    """All numbers. `real` is empty where the recordings are absent."""

    recovery: dict[float, Recovery]
    examples: dict[str, tuple[SimulatedTaps, AlignedTaps]]
    device: Device
    scaled: TapLibrary
    walls: dict[str, WallTrace]
    factorial: dict[str, FactorialResult]
    factor_found: dict[str, float]
    noise: float
    identification: IdentificationTest
    long_run: NDArray[np.float64]
    real: dict[str, RealTaps]


def study(*, taps: Mapping[str, Sequence[Samples]], seed: int = 0) -> Study:
    """Compute everything.

    Parameters
    ----------
    taps : mapping of str to sequence of ndarray, each of shape (n_samples,)
        Real taps by material, without resting level; may be empty.
    seed : int
        Of what is simulated.
    """
    device = Device()
    scaled = scale_into(TABLE_I, device, VELOCITIES_M_S[1])
    noise = noise_for(TABLE_II, PUBLISHED_CORRECT / N_EXPERIMENTS, seed=seed)
    many = simulate_test(TABLE_II, noise, np.random.default_rng((seed, 1)), n_experiments=20_000)
    examples = {m: simulate_taps(TABLE_I[m], np.random.default_rng((seed, 0)), FS[m]) for m in MATERIALS}
    ratings = {m: rate_many(m, seed) for m in MATERIALS}
    return Study(
        recover(seed, n_seeds=N_SEEDS),
        {m: (one, fit_aligned(one.taps, one.velocity, FS[m])) for m, one in examples.items()},
        device,
        scaled,
        {m: tap_wall(VirtualWall(TABLE_II[m], device)) for m in MATERIALS},
        {m: found[0] for m, found in ratings.items()},
        {m: float(np.mean([r.most_sensitive == MOST_SENSITIVE[m] for r in rs])) for m, rs in ratings.items()},
        noise,
        simulate_test(TABLE_II, noise, np.random.default_rng((seed, 2)), n_experiments=N_EXPERIMENTS),
        many.confusion / len(many.answers),
        {material: fit_real(those) for material, those in taps.items()},
    )


def recover(seed: int, *, n_seeds: int) -> dict[float, Recovery]:
    """Simulate taps with Table I as truth and fit them, many times; by error of the measured velocities.

    The velocities count only in the last step, the regression of the amplitudes on them.
    """
    errors = {e: {m: np.empty((n_seeds, 3)) for m in MATERIALS} for e in VELOCITY_ERRORS}
    r_squared = {e: {m: np.empty(n_seeds) for m in MATERIALS} for e in VELOCITY_ERRORS}
    true_v = np.linspace(*VELOCITIES_M_S, N_TAPS)
    for m, i in product(MATERIALS, range(n_seeds)):
        rng = np.random.default_rng((seed, i))
        one = simulate_taps(TABLE_I[m], rng, FS[m], n_taps=N_TAPS, velocity_error=0.0)
        found = fit_aligned(one.taps, one.velocity, FS[m])
        wrong = rng.standard_normal(N_TAPS)
        for e in VELOCITY_ERRORS:
            A, r_squared[e][m][i] = slope_through_origin(true_v * (1 + e * wrong), found.amplitude)
            values = np.array([A, found.model.decay_per_s, found.model.frequency_hz])
            errors[e][m][i] = values / _truth(m) - 1
    return {
        e: Recovery(errors[e], {m: float(np.median(r)) for m, r in r_squared[e].items()})
        for e in VELOCITY_ERRORS
    }


def rate_many(material: str, seed: int) -> list[FactorialResult]:
    """Analyse simulated ratings of one material, whose most sensitive factor is the published one."""
    return [
        analyse(simulate_ratings(MOST_SENSITIVE[material], np.random.default_rng((seed, i))))
        for i in range(N_SEEDS)
    ]


def tap_wall(wall: VirtualWall) -> WallTrace:
    """Tap a wall twice, gently and harder: half sines of depth, as in figure 5."""
    fs = wall.device.rate_hz
    t = np.arange(round(2 * TAP_S * fs)) / fs
    strength = 0.6 + 0.4 * t / t[-1]
    depth = TAP_DEPTH_MM * strength * np.sin(2 * np.pi * t / TAP_S - np.pi / 4)
    velocity = np.gradient(depth, t)
    force = wall.renderer().process(depth, velocity)
    return WallTrace(t, depth, velocity, force, wall.stiffness_n_mm * np.maximum(depth, 0.0))


def fit_real(taps: Sequence[Samples]) -> RealTaps:
    """Fit each tap of one material by itself, time in samples, velocities unknown."""
    fits: list[AlignedTaps | None] = []
    for x in taps:
        try:
            fits.append(fit_aligned([x], [1.0], 1.0))
        except ValueError:
            fits.append(None)
    decay, frequency, explained = np.array(
        [
            (f.model.decay_per_s, f.model.frequency_hz, f.explained) if f else (np.nan, np.nan, np.nan)
            for f in fits
        ]
    ).T
    at = int(np.nanargmin(np.abs(explained - np.nanmedian(explained))))
    return RealTaps(decay, frequency, explained, taps[at], _drawn(fits[at], taps[at].size))


def _drawn(found: AlignedTaps | None, n: int) -> Samples:
    if found is None:
        return np.zeros(n)
    t = np.arange(n) - found.onset[0]
    B, w = found.model.decay_per_s, 2 * np.pi * found.model.frequency_hz
    return np.where(t >= 0, found.amplitude[0] * np.exp(-B * np.maximum(t, 0)) * np.sin(w * t), 0.0)


def _truth(material: str) -> Samples:
    m = TABLE_I[material]
    return np.array([m.amplitude_slope, m.decay_per_s, m.frequency_hz])
