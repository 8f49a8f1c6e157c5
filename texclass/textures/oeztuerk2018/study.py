"""The numbers behind the figures and tables of `oeztuerk2018`; nothing is drawn here."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.simulate import operator_catalogue, surface_catalogue
from texclass.textures.oeztuerk2018.frequencies import FrequencyTexture, fit_frequencies
from texclass.textures.oeztuerk2018.intervals import histogram, intervals_from_speeds, n_intervals
from texclass.textures.oeztuerk2018.lpc import LpcTexture, fit_lpc
from texclass.textures.oeztuerk2018.orders import OrderCurves, order_curves
from texclass.textures.oeztuerk2018.prediction import Prediction, predict_left_out
from texclass.textures.oeztuerk2018.seamless import largest_jump_at_joins, seamless
from texclass.textures.oeztuerk2018.simulated import plate_recordings, stroking_speeds
from texclass.textures.oeztuerk2018.speeds import PEAK_FACTOR
from texclass.vibration import fit_major_frequencies
from texclass.vibration.major_frequencies import BEAT_THRESHOLDS_HZ, beat_threshold_hz
from texclass.vibration.scores import goodness_of_fit

TABLE_3_1 = (
    (4, 6, 6, 5, 3),
    (5, 7, 6, 4, 3),
    (6, 9, 9, 7, 6),
    (7, 9, 7, 7, 7),
    (15, 12, 15, 15, 14),
    (60, 30, 80, 30, 30),
)
"""Published: threshold of each person (Hz) in the six bands of frequency."""
COUNTS = tuple(range(2, 31))
GOOD, FAIR = 0.9, 0.8
FRICTIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.0)
SPEEDS_MM_S = (40.0, 80.0, 120.0, 160.0)
N_SURFACES, N_SEEDS, N_PATHS, PATH_SAMPLES = 8, 50, 1000, 2000


@dataclass(frozen=True, eq=False)
class FrequencyCount:
    """How many major frequencies one recording needs, by a spectral criterion.

    Attributes
    ----------
    gfc : ndarray of shape (29,)
        Goodness of fit of the spectrum with 2 ... 30 lines.
    fair, good : int or None
        Smallest number with a goodness of 0.8 and 0.9, if 30 are enough.
    too_close : int
        Of the 30 strongest lines, those that would beat with a stronger one and are left out.
    least_margin_hz : float
        Least distance of two chosen lines beyond their threshold in Table 3.2, at least 0.
    """

    gfc: Samples
    fair: int | None
    good: int | None
    too_close: int
    least_margin_hz: float


@dataclass(frozen=True, eq=False)
class IntervalRow:
    """Intervals at one friction coefficient: published, and found in simulated speeds over 50 seeds."""

    friction: float
    published: int
    found: tuple[int, ...]
    mean_mm_s: float
    share: Samples


@dataclass(frozen=True)
class RenderCheck:
    """A texture played over random paths.

    Attributes
    ----------
    family : str
    finite : bool
    largest : float
        Largest rendered magnitude over the recorded peak; `PEAK_FACTOR` bounds it.
    click : float
        Largest step between samples while the speed jumps, over the largest at the two speeds.
    microseconds : float
        Per sample, in one block.
    """

    family: str
    finite: bool
    largest: float
    click: float
    microseconds: float


@dataclass(frozen=True, eq=False)
class Study:
    """All numbers. What needs recordings that are absent is empty."""

    orders: dict[str, OrderCurves]
    counts: dict[str, FrequencyCount]
    intervals: tuple[IntervalRow, ...]
    real: tuple[Prediction, ...]
    simulated: tuple[Prediction, ...]
    rendering: tuple[RenderCheck, ...]
    jump_at_joins: float
    thresholds_agree: bool


def study(
    *, excerpts: Mapping[str, Samples], fabrics: Mapping[str, Sequence[Samples]], fs: float, seed: int = 0
) -> Study:
    """Compute everything.

    Parameters
    ----------
    excerpts : mapping of str to ndarray of shape (n_samples,)
        Real recordings of surfaces, without means; may be empty.
    fabrics : mapping of str to sequence of four ndarrays
        One real surface at four speeds, from slow to fast, which are not known: 1, 2, 3, 4 stand for them.
    fs : float
        Of the real recordings, Hz.
    seed : int
        Of what is simulated.
    """
    plates = simulated_plates(seed)
    real = [predict_left_out(x, (1, 2, 3, 4), fs, surface=name, seed=seed) for name, x in fabrics.items()]
    simulated = [
        predict_left_out(x, SPEEDS_MM_S, 10_000.0, surface=name, seed=seed) for name, x in plates.items()
    ]
    one = next(iter(plates.values()))
    endless = seamless(one[0][:10_000], 10_000.0)
    return Study(
        {name: order_curves(x) for name, x in excerpts.items()},
        {name: frequency_count(x, fs) for name, x in excerpts.items()},
        tuple(interval_row(mu, seed) for mu in FRICTIONS),
        tuple(p for group in real for p in group),
        tuple(p for group in simulated for p in group),
        tuple(render_check(make(one, SPEEDS_MM_S, 10_000.0), seed) for make in (fit_lpc, fit_frequencies)),
        largest_jump_at_joins(endless, 10_000),
        tuple(map(max, TABLE_3_1)) == BEAT_THRESHOLDS_HZ,
    )


def simulated_plates(seed: int) -> dict[str, list[Samples]]:
    """Simulate `N_SURFACES` surfaces at the speeds of `SPEEDS_MM_S`, 10 kHz."""
    operator = operator_catalogue(1, seed)[0]
    return {
        surface.name: plate_recordings(surface, operator, SPEEDS_MM_S, seed=seed + i)
        for i, surface in enumerate(surface_catalogue(N_SURFACES, seed))
    }


def frequency_count(x: Samples, fs: float) -> FrequencyCount:
    """Return how many frequencies a recording needs, and what Table 3.2 leaves out of its strongest 30."""
    x = x[: round(fs)]
    models = {n: fit_major_frequencies(x, fs, n_frequencies=n) for n in COUNTS}
    gfc = np.array(
        [
            goodness_of_fit(x, m.synthesize(x.size, fs), window=min(2800, x.size), n_hamming=500)
            for m in models.values()
        ]
    )
    f = models[COUNTS[-1]].frequency_hz
    X = np.abs(np.fft.rfft(x))[1 : round(1400 * x.size / fs) + 1]
    strongest = np.argsort(-X)[: COUNTS[-1]]
    kept = np.isin(np.round(f * x.size / fs).astype(int) - 1, strongest).sum()
    fair, good = (
        COUNTS[int(np.argmax(gfc >= least))] if np.any(gfc >= least) else None for least in (FAIR, GOOD)
    )
    margin = np.diff(f) - beat_threshold_hz(f[:-1])
    return FrequencyCount(gfc, fair, good, int(COUNTS[-1] - kept), float(np.min(margin, initial=np.inf)))


def interval_row(friction: float, seed: int) -> IntervalRow:
    """Return the intervals at a friction coefficient, as published and from simulated speeds."""
    drawn = [stroking_speeds(friction, np.random.default_rng((seed, i))) for i in range(N_SEEDS)]
    return IntervalRow(
        friction,
        n_intervals(friction),
        tuple(intervals_from_speeds(v).n_intervals for v in drawn),
        float(np.mean(drawn)),
        histogram(drawn[0]),
    )


def render_check(texture: LpcTexture | FrequencyTexture, seed: int) -> RenderCheck:
    """Play a texture over random paths, and over one whose speed jumps."""
    rng = np.random.default_rng(seed)
    renderer = texture.renderer(seed=seed)
    force = np.ones(PATH_SAMPLES)
    renderer.process(np.zeros((1, 2)), force[:1])
    largest, finite, start = 0.0, True, time.perf_counter()
    for _ in range(N_PATHS):
        knots = rng.exponential(120.0, (8, 2)) * rng.choice([-1, 1], (8, 2))
        t = np.linspace(0, 7, PATH_SAMPLES)
        path = np.column_stack([np.interp(t, np.arange(8), k) for k in knots.T])
        y = renderer.process(path, np.where(np.sin(t * rng.uniform(0, 5)) > -0.9, force, 0.0))
        largest, finite = max(largest, float(np.abs(y).max())), finite and bool(np.isfinite(y).all())
    seconds = time.perf_counter() - start
    return RenderCheck(
        texture.family,
        finite and largest <= PEAK_FACTOR * texture.peak,
        largest / texture.peak,
        click(texture, seed),
        1e6 * seconds / (N_PATHS * PATH_SAMPLES),
    )


def click(texture: LpcTexture | FrequencyTexture, seed: int) -> float:
    """Return the largest step between samples while the speed jumps to and fro, over that at either speed."""
    n, slow, fast = 2000, float(texture.speeds[0]), float(texture.speeds[-1])

    def largest_step(speed: Samples) -> float:
        renderer = texture.renderer(seed=seed)
        y = renderer.process(np.column_stack([speed, 0 * speed]), np.ones(speed.size))
        return float(np.abs(np.diff(y[n:])).max())

    jumping = np.where(np.arange(20 * n) // n % 2 == 0, slow, fast)
    steady = max(largest_step(np.full(20 * n, v)) for v in (slow, fast))
    return largest_step(jumping) / steady
