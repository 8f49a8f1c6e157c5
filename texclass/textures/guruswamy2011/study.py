"""The tables of `guruswamy2011`, computed: one scan, repeated scans, and what simulated scans give back."""

from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.textures.guruswamy2011 import published
from texclass.textures.guruswamy2011.fit import FittedScan, fit_texture
from texclass.textures.guruswamy2011.level import Amplitude, LevelLaw, fit_level_law, normalised
from texclass.textures.guruswamy2011.profile import RESOLUTION, Profile, profile_of
from texclass.textures.guruswamy2011.published import ScanRow
from texclass.textures.guruswamy2011.responses import fit_published
from texclass.textures.guruswamy2011.simulated import OBJECTS, SimulatedObject, lay_out, simulate_scan
from texclass.textures.scan import Scan
from texclass.vibration.scores import mean_absolute_difference

DURATION_S = 10.0
"""Of a scan at the object's own speed."""
N_REPEATED = 5
N_LEVELS = 40
SPEEDS = (0.5, 4.0)
"""Range of speeds of the regression, relative to the object's own."""
BOUNDS = {"segments per mm": 0.10, "f_major": 2.0, "k_v": 0.05, "a_0": 0.05}
"""Within which truth is to be found: relative, but f_major in Hz."""


@dataclass(frozen=True)
class ModesRow:
    """One scan with the default filters, and with the baseline.

    Attributes
    ----------
    poles : float
        Mean order of the stable filters.
    sad_bandpass, sad_original : float
        Of the *sum* of all filters, tails included, mm/s^2.
    sad_sinusoid : float
        Of the sum of one decaying sinusoid per segment to the band-passed profile, mm/s^2.
    """

    poles: float
    sad_bandpass: float
    sad_original: float
    sad_sinusoid: float


@dataclass(frozen=True)
class PronyRow:
    """Prony's filters as published.

    Attributes
    ----------
    row : ScanRow
        As a row of Table I.
    unstable : float
        Part of the filters that are unstable.
    sad_sum : float
        Of the sum of the stable filters, tails included, to the band-passed profile, mm/s^2.
    """

    row: ScanRow
    unstable: float
    sad_sum: float


@dataclass(frozen=True, eq=False)
class Recovery:
    """Errors of what was found in simulated scans of one object, a row per quantity of `BOUNDS`.

    Attributes
    ----------
    name : str
    error : ndarray of shape (4, n_trials)
        Relative; that of f_major in Hz.
    """

    name: str
    error: Samples

    def summary(self) -> dict[str, tuple[float, float, int]]:
        """Return median and 95th percentile of the absolute error, and how many trials lie within."""
        size = np.abs(self.error)
        return {
            quantity: (float(np.median(row)), float(np.quantile(row, 0.95)), int(np.sum(row <= bound)))
            for (quantity, bound), row in zip(BOUNDS.items(), size, strict=True)
        }


def stream(seed: int, *keys: int) -> np.random.Generator:
    """Return the random numbers of one part of the study."""
    return np.random.default_rng([seed, 2011, *keys])


def published_row(scan: Scan, law: LevelLaw, resolution: float = RESOLUTION) -> PronyRow:
    """Measure a scan as the paper does: band, segments, Prony's filters from order n_extrema upwards."""
    scaling = Amplitude(law, float(scan.speed.mean()), float(scan.force.mean()))
    a = normalised(scan, scaling)
    profile = profile_of(a, scan.fs, resolution=resolution)
    filters = fit_published(profile.segmentation.pieces(profile.samples), resolution)
    bounds = profile.segmentation.bounds
    model = np.concatenate([f.synthesize(n)[:n] for f, n in zip(filters, np.diff(bounds), strict=True)])
    total = np.zeros_like(model)
    for f, start, stop in zip(filters, bounds[:-1], bounds[1:], strict=True):
        end = total.size if f.is_stable else stop
        total[start:end] += f.synthesize(end - start)
    row = ScanRow(
        f_max_hz=profile.band.upper_hz,
        f_major_hz=profile.band.major_hz,
        segments_per_mm=profile.segmentation.n_segments / scan.distance_mm[-1],
        order=float(np.mean([f.order + 1 for f in filters])),
        sad_bandpass=1e3 * mean_absolute_difference(profile.samples, model),
        sad_original=1e3 * mean_absolute_difference(a - a.mean(), model),
        speed=scaling.speed,
        force=scaling.force,
    )
    unstable = float(np.mean([not f.is_stable for f in filters]))
    return PronyRow(row, unstable, 1e3 * mean_absolute_difference(profile.samples, total))


def modes_row(fitted: FittedScan, law: LevelLaw) -> ModesRow:
    """Measure the default texture of a scan, and the baseline."""
    n, fs = len(fitted.scan), fitted.scan.fs
    total = fitted.responses.sum(n, fs)
    baseline = fit_texture(fitted.scan, law, method="sinusoid").responses.sum(n, fs)
    return ModesRow(
        poles=float(fitted.responses.n_poles.mean()),
        sad_bandpass=1e3 * mean_absolute_difference(fitted.profile.samples, total),
        sad_original=1e3 * mean_absolute_difference(fitted.normalised, total),
        sad_sinusoid=1e3 * mean_absolute_difference(fitted.profile.samples, baseline),
    )


def repeated_scans(thing: SimulatedObject, rng: np.random.Generator) -> list[Scan]:
    """Scan one section five times: once as published, then with speed and force as a hand repeats them."""
    section = lay_out(thing, DURATION_S * thing.speed, rng)
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
    """Scan one section at many speeds; the spread of the force is the logarithm's standard deviation."""
    section = lay_out(thing, DURATION_S * thing.speed, rng)
    speeds = thing.speed * np.geomspace(*SPEEDS, n_scans)
    forces = thing.force * np.exp(force_spread * rng.standard_normal(n_scans))
    return [
        simulate_scan(thing, section, rng, speed=v, force=f, repeatability=repeatability)
        for v, f in zip(speeds, forces, strict=True)
    ]


def recover(thing: SimulatedObject, seed: int, *, repeatability: float = 0.01) -> Samples:
    """Return the errors of one trial, in the order of `BOUNDS`: a section and a scan, forty for the law."""
    which = [each.name for each in OBJECTS].index(thing.name)
    rng = stream(seed, 50, which)
    fit = fit_level_law(level_scans(thing, rng, repeatability=repeatability), thing.law.k_c)
    section = lay_out(thing, DURATION_S * thing.speed, rng)
    scan = simulate_scan(thing, section, rng)
    profile = _profile(scan, fit.law)
    truth = published.TABLE_1[thing.name]
    return np.array([
        profile.segmentation.n_segments / scan.distance_mm[-1] / thing.density_per_mm - 1,
        profile.band.major_hz - truth.f_major_hz,
        fit.law.k_v / thing.law.k_v - 1,
        fit.law.a_0 / thing.law.a_0 - 1,
    ])  # fmt: skip


def recoveries(seed: int, n_trials: int = 50, *, repeatability: float = 0.01) -> list[Recovery]:
    """Return the errors over many sections of every object."""
    return [
        Recovery(
            thing.name,
            np.array(
                [recover(thing, seed + 1000 * i, repeatability=repeatability) for i in range(n_trials)]
            ).T,
        )
        for thing in OBJECTS
    ]


def _profile(scan: Scan, law: LevelLaw) -> Profile:
    scaling = Amplitude(law, float(scan.speed.mean()), float(scan.force.mean()))
    return profile_of(normalised(scan, scaling), scan.fs)
