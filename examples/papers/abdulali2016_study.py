"""Cross-validate textures of `abdulali2016` next to nulls, and measure their computing times."""

from functools import partial
from time import perf_counter, thread_time_ns
from typing import NamedTuple

import numpy as np
from abdulali2016_simulated import SURFACES, get_surface, simulate_constant, simulate_scan

from texclass.haptics.textures.abdulali2016 import bake, model_scan, segment_input
from texclass.haptics.textures.abdulali2016.model_points import limit_vibration
from texclass.haptics.textures.abdulali2016.network_fit import segment_adaptively
from texclass.haptics.textures.abdulali2016.network_texture import PEAK_FACTOR
from texclass.vibration import LatticeSynthesis, fit
from texclass.vibration.null_scores import NULLS, null_scores
from texclass.vibration.perceptual_distance import perceptual_distance
from texclass.vibration.scores import goodness_of_fit

FS = 1000.0
TRAINING_S, VALIDATION_S, HELD_OUT_S = 20.0, 10.0, 5.0
WINDOW = 500
"""Length of a window in samples (at 1 kHz); windows overlap by half."""
SPEED_BAND, SPEED = (60.0, 95.0), 75.0
"""Range of mean speeds of the held-out segments, and test speed, in mm/s."""
FORCE_BAND, FORCE = (0.7, 1.2), 0.9
"""Range of mean forces of the held-out segments, and test force, in N."""
SECTOR_RAD = np.deg2rad(15.0)
"""Half width in rad of the held-out sector around the test direction and its opposite."""
SPARSITIES = (0.3, 0.1, 0.03, 0.01, 0.0)
STRONGEST_DB = 30.0
"""Assumed sensation level in dB of the strongest band, for the perceptual distance."""
CANDIDATES = ("training", *NULLS)
"""Candidates without a model: the training recording itself, and the nulls."""


class Score(NamedTuple):
    """Scores of a rendered vibration.

    Mean and standard deviation over windows of the GFC (score of the paper), RMS level error over windows in
    dB, and perceptual distance of the whole signals at equal level in dB.
    """

    gfc: float
    deviation: float
    level_db: float
    perceptual_db: float


def fit_as_published(scan, isotropic=False):
    """Fit the texture as in the paper.

    Spectra are not pooled, thresholds are those of the paper, the extra output is the variance, the network
    is sparse, and parameters jump every 16 samples.
    """
    options = {"pooling": "none", "mirror": "none", "loudness": "variance", "method": "autocorrelation"}
    modelled = model_scan(scan, isotropic=isotropic, segments=segment_input(scan), **options)
    return modelled.network("sparse", glide=False)


def compare(recorded, rendered, fs=FS):
    """Score a rendered vibration against a recorded one (`abdulali2016`, section 4, eq. (6))."""
    starts = range(0, recorded.size - WINDOW + 1, WINDOW // 2)
    gfc = [goodness_of_fit(recorded[i : i + WINDOW], rendered[i : i + WINDOW], window=WINDOW) for i in starts]
    return Score(
        float(np.mean(gfc)),
        float(np.std(gfc)),
        level_error(recorded, rendered),
        perceived_difference(recorded, rendered, fs),
    )


def level_error(recorded, rendered):
    """Return the RMS error of the level over windows, in dB."""
    windows = np.lib.stride_tricks.sliding_window_view([recorded, rendered], WINDOW, axis=1)
    power = np.mean(windows[:, :: WINDOW // 2] ** 2, axis=2)
    floor = 1e-12 * power[0].max() + np.finfo(np.float64).tiny
    level = 10 * np.diff(np.log10(np.maximum(power, floor)), axis=0)
    return float(np.sqrt(np.mean(level**2)))


def perceived_difference(recorded, rendered, fs):
    """Return the perceptual distance at equal level in dB, infinite for silence."""
    if not np.any(rendered):
        return np.inf
    return perceptual_distance(recorded, rendered, fs, strongest_db=STRONGEST_DB, equal_level=True)


def score_nulls(pairs, fs=FS):
    """Return the scores of the candidates without a model, by name of the scan and candidate.

    Parameters
    ----------
    pairs : mapping of str to tuple of array_like
        Training and validation vibrations of each surface. The end of the training vibration, as long as the
        validation, is the candidate "training".
    fs : float
        Sampling rate in Hz.
    """
    recordings = {}
    for name, (training, validation) in pairs.items():
        n = min(len(training), len(validation))
        recordings[name] = np.concatenate([training[-n:], validation[:n]])
    functions = {
        "gfc": partial(goodness_of_fit, window=WINDOW),
        "level_db": level_error,
        "perceptual_db": partial(perceived_difference, fs=fs),
    }
    tables = {
        key: null_scores(
            score, recordings, fs, higher_is_better=key == "gfc", equal_level=key != "level_db"
        ).rename(columns={"other half": "training"})
        for key, score in functions.items()
    }
    return {
        name: {
            way: Score(
                *(float(tables[key].loc[name, way]) if key in tables else None for key in Score._fields)
            )
            for way in CANDIDATES
        }
        for name in pairs
    }


def render_along(texture, scan, seed=0):
    """Render a texture along the motion of a scan."""
    return texture.renderer(seed=seed).process(scan.velocity, scan.force, scan.position)


def cross_validate(texture, scan, seed=0):
    """Score a texture along the motion of a held-out conditioned scan."""
    return compare(scan.acceleration, render_along(texture, scan, seed))


def simulate_pair(surface, seed):
    """Return a training and a validation scan of a simulated surface, and the random generator."""
    rng = np.random.default_rng([seed, SURFACES.index(surface)])
    return *(simulate_scan(surface, s, FS, rng) for s in (TRAINING_S, VALIDATION_S)), rng


def study_surface(surface, seed):
    """Fit each method to 20 s of a simulated surface, and validate it on 10 s."""
    training, validation, rng = simulate_pair(surface, seed)
    second = limit_vibration(surface.vibration(validation.velocity, validation.force, FS, rng), FS)
    result = study_scans(training, validation, isotropic=False)
    result["scores"]["the truth again"] = compare(validation.acceleration, second)
    return result | {"kind": surface.kind, "anisotropic": surface.is_anisotropic}


def study_scans(training, validation, *, isotropic):
    """Fit each method to one conditioned scan and score it on another; None if a method is not applicable."""
    modelled = model_scan(training, isotropic=isotropic)
    plain = model_scan(training, isotropic=isotropic, pooling="none", mirror="none")
    network, sparse = modelled.network(), plain.network("sparse")
    printed = segment_input(training)
    textures = {
        "network": network,
        "network, baked": bake(network, training.name),
        "exact, plain": plain.network(),
        "sparse, plain": sparse,
        "as published": fit_as_published(training, isotropic=isotropic) if len(printed) else None,
        "Delaunay": modelled.delaunay(),
        "Delaunay, plain": plain.delaunay(),
        "without direction": None if isotropic else model_scan(training, isotropic=True).network(),
    }
    scores = {way: each and cross_validate(each, validation) for way, each in textures.items()}
    rng = np.random.default_rng(0)
    lattice = LatticeSynthesis(fit(training.acceleration, 20)).settle(rng)
    single_model = lattice.process(rng.standard_normal(len(validation)))
    return {
        "name": training.name,
        "kind": "real",
        "anisotropic": False,
        "n_segments": len(modelled.segments),
        "n_centres": len(network.network.centres),
        "n_sparse": len(sparse.network.centres),
        "reach": modelled.reach,
        "symmetric": modelled.is_symmetric,
        "growth": modelled.growth,
        "coverage": float(printed.n_samples.sum() / len(training)),
        "scores": scores | {"one AR model": compare(validation.acceleration, single_model)},
    }


def study_held_out(surface, seed):
    """Return the mean GFC at a held-out speed, force and direction."""
    rng = np.random.default_rng([seed, SURFACES.index(surface), 1])
    training = simulate_scan(surface, TRAINING_S, FS, rng)
    segments = segment_adaptively(training)
    direction = float(rng.uniform(-np.pi, np.pi))
    vx, vy = segments.means(training.velocity).T
    speed, force = np.hypot(vx, vy), segments.means(training.force)
    turn = np.abs(np.angle(np.exp(2j * (np.arctan2(vy, vx) - direction)))) / 2  # modulo 180 degrees
    cases = {
        "speed": ({"speed": SPEED}, (speed > SPEED_BAND[0]) & (speed < SPEED_BAND[1])),
        "force": ({"force": FORCE}, (force > FORCE_BAND[0]) & (force < FORCE_BAND[1])),
        "direction": ({"direction": direction}, turn < SECTOR_RAD),
    }
    tests = {
        axis: simulate_constant(surface, HELD_OUT_S, FS, rng, **constant)
        for axis, (constant, _) in cases.items()
    }
    textures = {
        axis: model_scan(training, segments=segments.select(~is_held_out)).network()
        for axis, (_, is_held_out) in cases.items()
    }
    return {axis: cross_validate(textures[axis], test, seed).gfc for axis, test in tests.items()}


def study_held_out_nulls(surfaces, seed):
    """Return the GFC of the candidates without a model at the held-out conditions, by axis and surface."""
    rng = np.random.default_rng([seed, 2])
    conditions = {"speed": {"speed": SPEED}, "force": {"force": FORCE}, "direction": {"direction": 0.5}}
    return {
        axis: null_scores(
            partial(goodness_of_fit, window=WINDOW),
            {
                surface.name: simulate_constant(surface, 2 * HELD_OUT_S, FS, rng, **condition).acceleration
                for surface in surfaces
            },
            FS,
            higher_is_better=True,
        ).to_dict("index")
        for axis, condition in conditions.items()
    }


def study_sparsity(surface, seed):
    """Return rows of sparsity, number of centres and GFC; sparsity 0 is the exact network."""
    training, validation, _ = simulate_pair(surface, seed)
    modelled = model_scan(training, pooling="none", mirror="none")
    rows = []
    for sparsity in SPARSITIES:
        texture = modelled.network("sparse", sparsity=sparsity) if sparsity else modelled.network()
        rows.append((sparsity, len(texture.network.centres), cross_validate(texture, validation).gfc))
    return rows


def study_bound(texture, peak, n_paths, seed):
    """Render random paths; return the peak relative to the recorded peak, and the fraction at the limit.

    Every 25 samples, each path jumps to another velocity and force, with scales up to 10^4 mm/s and N.
    """
    rng = np.random.default_rng(seed)
    largest, n_limited, n = 0.0, 0, 0
    for i in range(n_paths):
        path = np.repeat(rng.normal(0, 10 ** rng.uniform(0, 4), (12, 3)), 25, axis=0)
        y = np.abs(texture.renderer(seed=i).process(path[:, :2], path[:, 2]))
        largest, n_limited, n = (
            max(largest, y.max() / peak),
            n_limited + int(np.sum(y >= PEAK_FACTOR * peak)),
            n + y.size,
        )
    return float(largest), n_limited / n


def time_fit(fs, order, seed=0):
    """Time the segmentation, fit and baking of 20 s at a sampling rate (Hz), after compiling the kernels."""
    scan = simulate_scan(get_surface("S2"), 20.0, fs, np.random.default_rng(seed))
    model_scan(scan.crop(0, len(scan) // 4), order=8)
    start = perf_counter()
    segment_input(scan)
    segmentation_end = perf_counter()
    texture = model_scan(scan, order=order).network()
    fit_end = perf_counter()
    bake(texture, "S2")
    seconds = {"segmenting_s": segmentation_end - start, "fitting_s": fit_end - segmentation_end}
    return {"fs": fs, "order": order, **seconds, "baking_s": perf_counter() - fit_end}


def time_rendering(texture, n_steps=10_000, n_contacts=4, seed=0):
    """Time a loop that renders one sample of each of several contacts, each on its own path.

    Returns wall-clock time and processor time in µs. On a busy machine, other programs cause the longest
    wall-clock times.
    """
    rng = np.random.default_rng(seed)
    renderers = [texture.renderer(seed=i) for i in range(n_contacts)]
    t = np.arange(n_steps) / texture.fs
    rates, phases = rng.uniform(0.3, 2, (n_contacts, 3, 1)), rng.uniform(0, 6, (n_contacts, 3, 1))
    swing = np.sin(2 * np.pi * rates * t + phases)
    velocity, force = 120 * np.moveaxis(swing[:, :2], 1, 2), 1 + swing[:, 2]
    clock, cpu = np.empty(n_steps), np.empty(n_steps)
    for i in range(n_steps):
        start, cpu_start = perf_counter(), thread_time_ns()
        for contact, renderer in enumerate(renderers):
            renderer.process(velocity[contact, i : i + 1], force[contact, i : i + 1])
        cpu[i], clock[i] = (thread_time_ns() - cpu_start) / 1e3, 1e6 * (perf_counter() - start)
    (median, tail), (cpu_median, cpu_tail) = (
        np.percentile(x[n_steps // 10 :], [50, 99.9]).tolist() for x in (clock, cpu)
    )
    result = {"family": texture.family, "order": texture.order, "n_contacts": n_contacts, "n_steps": n_steps}
    result |= {"median_us": median, "p999_us": tail, "cpu_median_us": cpu_median, "cpu_p999_us": cpu_tail}
    return result | {"operations": texture.operations}
