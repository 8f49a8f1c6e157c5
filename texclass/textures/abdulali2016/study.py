"""The figures of `abdulali2016` as numbers: cross-validation, what was held out, real recordings, times."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.textures.abdulali2016.baked import bake
from texclass.textures.abdulali2016.cross_validation import CrossValidation, compare, cross_validate
from texclass.textures.abdulali2016.fitting import fit_as_published, model_scan, segment_enough
from texclass.textures.abdulali2016.frame import LIMIT
from texclass.textures.abdulali2016.preprocessing import limit_vibration
from texclass.textures.abdulali2016.segmentation import InputSegments, segment_input
from texclass.textures.abdulali2016.simulated import SURFACES, Surface, simulate_constant, simulate_scan
from texclass.textures.contract import Texture
from texclass.textures.scan import Scan
from texclass.vibration import LatticeSynthesis, fit

Kept = Literal["speed", "force", "direction"]

FS = 1000.0
TRAINING_S, VALIDATION_S = 20.0, 10.0
HELD_OUT_S = 5.0
SPEED_BAND, SPEED = (60.0, 95.0), 75.0
"""Mean speeds (mm/s) of the segments left out, and the speed of the test."""
FORCE_BAND, FORCE = (0.7, 1.2), 0.9
"""The same for the force, N."""
SECTOR_RAD = np.deg2rad(15.0)
"""Directions this close to that of the test, or to its opposite, are left out."""
SPARSITIES = (0.3, 0.1, 0.03, 0.01, 0.0)


class Score(NamedTuple):
    """GFC over windows, mean and deviation, and the RMS error of the level, dB."""

    gfc: float
    deviation: float
    level_db: float

    @classmethod
    def of(cls, result: CrossValidation) -> "Score":
        """Return the score of a cross-validation."""
        return cls(result.mean, result.deviation, result.level_rms_db)


@dataclass(frozen=True)
class SurfaceScores:
    """One surface, one training and one validation recording.

    Attributes
    ----------
    name, kind : str
    anisotropic : bool
        Whether the surface is; simulated ones only.
    n_segments, n_centres, n_sparse : int
        Segments, centres of the exact and of the sparse network.
    reach : float
        Of pooling.
    symmetric : bool
        Whether strokes there and back were found to be alike.
    growth : tuple of float
        Exponents of speed and force in the level; the truth of simulated surfaces is `simulated.GROWTH`.
    coverage : float
        Part of the training that segments cover with the printed thresholds.
    scores : dict of str to Score
        By way of modelling.
    """

    name: str
    kind: str
    anisotropic: bool
    n_segments: int
    n_centres: int
    n_sparse: int
    reach: float
    symmetric: bool
    growth: tuple[float, float]
    coverage: float
    scores: dict[str, Score | None]


def study_surface(what: Surface, seed: int) -> SurfaceScores:
    """Train on 20 s and validate on 10 s of a simulated surface, in every way there is."""
    rng = np.random.default_rng([seed, SURFACES.index(what)])
    training = simulate_scan(what, TRAINING_S, FS, rng)
    validation = simulate_scan(what, VALIDATION_S, FS, rng)
    again = limit_vibration(what.vibration(validation.velocity, validation.force, FS, rng), FS)
    ceiling = Score.of(compare(validation.acceleration, again))
    return study_scans(training, validation, isotropic=False, more={"the truth again": ceiling}, what=what)


def study_scans(
    training: Scan,
    validation: Scan,
    *,
    isotropic: bool,
    more: dict[str, Score | None] | None = None,
    what: Surface | None = None,
) -> SurfaceScores:
    """Fit one conditioned scan and score another, in every way there is.

    A way that cannot be gone with this scan has no score.
    """
    modelled = model_scan(training, isotropic=isotropic)
    apart = model_scan(training, isotropic=isotropic, pooling="none", mirror="none")
    network, sparse = modelled.network(), apart.network("sparse")
    textures: dict[str, Texture | None] = {
        "network": network,
        "network, baked": bake(network, training.name),
        "exact, plain": apart.network(),
        "sparse, plain": sparse,
        "as published": _as_published(training, isotropic),
        "Delaunay": modelled.delaunay(),
        "Delaunay, plain": apart.delaunay(),
        "without direction": None if isotropic else model_scan(training, isotropic=True).network(),
    }
    scores: dict[str, Score | None] = {
        way: None if each is None else Score.of(cross_validate(each, validation))
        for way, each in textures.items()
    }
    scores["one AR model"] = Score.of(compare(validation.acceleration, _one_model(training, len(validation))))
    covered = float(segment_input(training).n_samples.sum() / len(training))
    counts = len(modelled.segments), len(network.network.centres), len(sparse.network.centres)
    kind, anisotropic = (what.kind, what.anisotropic) if what else ("real", False)
    return SurfaceScores(
        training.name, kind, anisotropic, *counts, modelled.reach, modelled.symmetric, modelled.growth,
        covered, scores | (more or {}),
    )  # fmt: skip


def _as_published(training: Scan, isotropic: bool) -> Texture | None:
    """Return the texture of the printed method, if its segmentation leaves anything."""
    try:
        return fit_as_published(training, isotropic=isotropic)
    except ValueError:
        return None


def _one_model(training: Scan, n: int) -> Samples:
    """Return n samples of one AR model of the whole scan, deaf to speed and force."""
    rng = np.random.default_rng(0)
    lattice = LatticeSynthesis(fit(training.acceleration, 20)).settle(rng)
    return np.asarray(lattice.process(rng.standard_normal(n)))


def study_held_out(what: Surface, seed: int) -> dict[Kept, float]:
    """Return the mean GFC at a speed, a force and a direction around which no segment was used."""
    rng = np.random.default_rng([seed, SURFACES.index(what), 1])
    training = simulate_scan(what, TRAINING_S, FS, rng)
    segments = segment_enough(training)
    direction = float(rng.uniform(-np.pi, np.pi))
    tests: dict[Kept, Scan] = {
        "speed": simulate_constant(what, HELD_OUT_S, FS, rng, speed=SPEED),
        "force": simulate_constant(what, HELD_OUT_S, FS, rng, force=FORCE),
        "direction": simulate_constant(what, HELD_OUT_S, FS, rng, direction=direction),
    }
    left_out = _left_out(training, segments, direction)
    result: dict[Kept, float] = {}
    for kept, test in tests.items():
        texture = model_scan(training, segments=segments.chosen(~left_out[kept])).network()
        result[kept] = cross_validate(texture, test, seed=seed).mean
    return result


def _left_out(scan: Scan, segments: InputSegments, direction: float) -> dict[Kept, NDArray[np.bool_]]:
    """Return which segments lie around the speed, force and direction of the tests."""
    vx, vy = segments.means(scan.velocity).T
    speed, force = np.hypot(vx, vy), segments.means(scan.force)
    turn = np.abs(np.angle(np.exp(2j * (np.arctan2(vy, vx) - direction)))) / 2  # either way
    return {
        "speed": (speed > SPEED_BAND[0]) & (speed < SPEED_BAND[1]),
        "force": (force > FORCE_BAND[0]) & (force < FORCE_BAND[1]),
        "direction": turn < SECTOR_RAD,
    }


def study_sparsity(what: Surface, seed: int) -> list[tuple[float, int, float]]:
    """Return sparsity, number of centres and GFC of sparse networks; sparsity 0 is the exact one."""
    rng = np.random.default_rng([seed, SURFACES.index(what)])
    training = simulate_scan(what, TRAINING_S, FS, rng)
    validation = simulate_scan(what, VALIDATION_S, FS, rng)
    modelled = model_scan(training, pooling="none", mirror="none")
    rows = []
    for sparsity in SPARSITIES:
        texture = modelled.network("sparse", sparsity=sparsity) if sparsity else modelled.network()
        gfc = cross_validate(texture, validation).mean
        rows.append((sparsity, len(texture.network.centres), gfc))
    return rows


def study_bound(texture: Texture, peak: float, n_paths: int, seed: int) -> tuple[float, float]:
    """Render wild paths; return the largest sample over the recorded peak, and the share held at the limit.

    Each path jumps every 25 samples to another velocity and force, of scales up to 10^4 mm/s and N.
    """
    rng = np.random.default_rng(seed)
    largest, n_held, n = 0.0, 0, 0
    for i in range(n_paths):
        path = np.repeat(rng.normal(0, 10 ** rng.uniform(0, 4), (12, 3)), 25, axis=0)
        y = np.abs(texture.renderer(seed=i).process(path[:, :2], path[:, 2]))
        if not np.isfinite(y).all():
            return float("nan"), float("nan")
        largest, n_held, n = max(largest, y.max() / peak), n_held + int(np.sum(y >= LIMIT * peak)), n + y.size
    return float(largest), n_held / n
