"""The numbers of the chapter on `oeztuerk2018`: orders, frequencies, intervals of speed, predictions."""

import time

import numpy as np
import pandas as pd
from scipy import special

from texclass.haptics.textures.oeztuerk2018 import (
    BIN_MM_S,
    PEAK_FACTOR,
    SpeedIntervals,
    fit_frequencies,
    fit_lpc,
    speed_intervals,
)
from texclass.signals import combine, remove_hand_motion
from texclass.simulate import operator_catalogue, record_rising_speed, surface_catalogue
from texclass.vibration import fit, fit_major_frequencies, select_order
from texclass.vibration.major_frequencies import beat_threshold_hz
from texclass.vibration.order import spectral_error
from texclass.vibration.scores import band_energy_distance, goodness_of_fit, log_spectral_distance

FS = 10_000.0
LARGEST, AT_MOST, N_DFT = 1000, 0.4, 2800
"""Of figure 3.2: largest order, the error looked for, and points of the DFT (section 3.1)."""
COUNTS, GOOD, FAIR = tuple(range(2, 31)), 0.9, 0.8
FRICTIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.0)
SPEEDS_MM_S = (40.0, 80.0, 120.0, 160.0)
MEAN_MM_S, FRICTION_SCALE, SHAPE = 150.0, 0.64, 4.0
"""Ours: mean speed 150 mm/s exp(-friction / 0.64), gamma distribution of shape 4 about it."""
N_SPEEDS = 240
"""`oeztuerk2018`, figure 4.2: samples per friction coefficient, one each 0.2 s."""
REST_S = 0.6
"""What is cut off a simulated plate's start."""
N_SEEDS, PATH_SAMPLES = 50, 2000
NOTABLE = 0.05
"""Share of the samples that makes a bin notable; the thesis judges by eye."""
DURATION_S = 10.0
N_COPIES = 5
"""Mirrored copies in an endless signal."""


def order_curves(x, largest=LARGEST):
    """Return the spectral error of the orders 0 ... largest on a recording without its mean, and choices.

    "curve": fitted to and compared with the whole, eq. (3.11); "other_half": fitted to one half and compared
    with the other, mean of both ways; "floor", "floor_of_half": what the true model would keep; orders chosen
    by "aicc", beyond which "little" is gained, and the first with an error "at_most" 0.4, if any has.
    """
    little, met = select_order(x, largest), select_order(x, largest, max_error=AT_MOST)
    halves = np.array_split(x, 2)
    both_ways = [spectral_error(b, fit(a, largest)) for a, b in (halves, halves[::-1])]
    return {
        "curve": little.values,  # noqa: PD011, no DataFrame
        "other_half": np.mean(both_ways, axis=0),
        "floor": floor(x.size // N_DFT),
        "floor_of_half": floor(x.size // 2 // N_DFT),
        "aicc": select_order(x, largest, criterion="aicc").order,
        "little": little.order,
        "at_most": met.order if met.is_met else None,
    }


def floor(n_segments):
    """Error that the true model keeps: |X|, the RMS over M segments of a Gaussian process, is not its mean.

    E |X| / |G| = Gamma(M + 1/2) / (Gamma(M) sqrt(M)), so C^2 = 2 - 2 E |X| / |G|.
    """
    return float(np.sqrt(2 - 2 * special.poch(n_segments, 0.5) / np.sqrt(n_segments)))


def frequency_count(x):
    """Return how many frequencies 1 s of a recording needs, and what Table 3.2 leaves out of 30.

    Goodness of fit of the spectrum with 2 ... 30 lines; the smallest numbers for 0.8 and 0.9; lines that
    would beat with a stronger one; the least distance of two chosen lines beyond their threshold, Hz.
    """
    x = x[: round(FS)]
    models = [fit_major_frequencies(x, FS, n_frequencies=n) for n in COUNTS]
    made = [model.synthesize(x.size, FS) for model in models]
    gfc = np.array([goodness_of_fit(x, y, window=min(2800, x.size), n_hamming=500) for y in made])
    f = models[-1].frequency_hz
    X = np.abs(np.fft.rfft(x))[1 : round(1400 * x.size / FS) + 1]
    kept = np.isin(np.round(f * x.size / FS).astype(int) - 1, np.argsort(-X)[: COUNTS[-1]]).sum()
    fair, good = (COUNTS[int(np.argmax(gfc >= v))] if np.any(gfc >= v) else None for v in (FAIR, GOOD))
    return {
        "gfc": gfc.round(4).tolist(),
        "0.8": fair,
        "0.9": good,
        "left out as beating": int(COUNTS[-1] - kept),
        "least margin (Hz)": float(np.min(np.diff(f) - beat_threshold_hz(f[:-1]), initial=np.inf)),
    }


def stroking_speeds(friction, rng):
    """Draw speeds (mm/s) of a person on a surface of this friction coefficient, shape (240,).

    The thesis prints no mean speeds, only histograms as pictures and the number of notable bins. The law here
    was chosen by us so that the histograms have about as many bins: it tests the rule, not the thesis.
    """
    return rng.gamma(SHAPE, MEAN_MM_S * np.exp(-friction / FRICTION_SCALE) / SHAPE, N_SPEEDS)


def intervals_from_speeds(speed, notable=NOTABLE):
    """Return the intervals that speeds (mm/s) of people on a surface ask for, one speed each step of time.

    The histogram of figure 4.2: intervals up to the last bin that holds a notable share of the samples; what
    is faster belongs to the last interval.
    """
    share = np.bincount(np.floor(np.asarray(speed) / BIN_MM_S).astype(int)) / len(speed)
    last = np.flatnonzero(share >= notable)[-1:]
    return SpeedIntervals.equal(int(last.sum()) + 1)


def mirrored(x):
    """Return the signal with its reflection behind it: x_0 ... x_n-1 x_n-1 ... x_0.

    Wherever copies of it meet, one sample stands beside its equal: no join has a jump.
    """
    return np.concatenate([x, x[::-1]])


def seamless(x, fs, duration_s=DURATION_S, peak=None):
    """Return a signal of the duration: the mirrored one, as often as needed, scaled to a peak.

    Of 1 s, 5 mirrored copies make 10 s, as printed. The peak is that of the reference it is compared with;
    `oeztuerk2018`, end of section 3.2.
    """
    endless = np.resize(mirrored(x), round(duration_s * fs))
    largest = np.abs(endless).max()
    return endless if peak is None or largest == 0 else endless * (peak / largest)


def displayed_signals(texture, friction, duration_s=DURATION_S, peaks=None, seed=0):
    """Return a seamless signal for each of the `speed_intervals` of a friction, from slow to fast.

    Each is that of the texture at the centre of its interval: a tenth of the duration, mirrored and repeated
    5 times, and scaled to the peak of its reference, if given; sections 3.2 and 6.1, Table 6.1.
    """
    speeds = speed_intervals(friction).centres_mm_s
    n = max(1, round(duration_s * texture.fs / (2 * N_COPIES)))
    return [
        seamless(texture.signal(v, n, seed=seed + i), texture.fs, duration_s, peak)
        for i, (v, peak) in enumerate(zip(speeds, peaks or [None] * len(speeds), strict=True))
    ]


def intervals_of(friction, seed):
    """Return the number of intervals as published, of 50 draws of speeds, and the mean speed (mm/s)."""
    drawn = [stroking_speeds(friction, np.random.default_rng((seed, i))) for i in range(N_SEEDS)]
    return {
        "published": speed_intervals(friction).n_intervals,
        "simulated": np.bincount([intervals_from_speeds(v).n_intervals for v in drawn]).tolist(),
        "mean speed (mm/s)": round(float(np.mean(drawn)), 2),
    }


def simulated_plates(seed, n_surfaces):
    """Simulate surfaces at `SPEEDS_MM_S` under 1 N: axes combined, without the hand's motion, m/s^2.

    Each speed has its own stretch of the surface and its own noise.
    """
    operator = operator_catalogue(1, seed)[0]
    plates = {}
    for i, surface in enumerate(surface_catalogue(n_surfaces, seed)):
        plates[surface.name] = []
        for j, v in enumerate(SPEEDS_MM_S):
            plate = record_rising_speed(
                surface, operator, duration_s=3.0 + REST_S, fs=FS, seed=(seed + i, j), speed_mm_s=(v, v)
            )
            moving = combine(plate.acceleration[round(REST_S * FS) :])
            plates[surface.name].append(remove_hand_motion(moving, FS))
    return plates


def score(recorded, predicted):
    """Compare two signals of any lengths: spectra, energies in nine bands, lines 20 Hz wide, level."""
    n = min(recorded.size, predicted.size)
    return {
        "log_spectral_db": log_spectral_distance(recorded, predicted, n_segment=512),
        "band_db": band_energy_distance(recorded, predicted, FS),
        "gfc": goodness_of_fit(recorded[:n], predicted[:n], window=2800, n_hamming=500),
        "level_db": float(20 * np.log10(np.std(predicted) / np.std(recorded))),
    }


def predict_left_out(signals, speeds, surface, *, order=400, seed=0, n_draws=3):
    """Fit the slowest and the fastest recording, and predict those between.

    The ways are "LPC, log gain" (as in the thesis), "LPC, log level", "LPC, all other speeds" (fitted to all
    recordings but the left-out one, log gain), "frequencies", "nearest speed", and two that no prediction can
    be expected to beat: "own LPC", fitted to the left-out recording, and "other half", one half of that
    recording against the other.
    """
    ends, fitted = [signals[0], signals[-1]], (float(speeds[0]), float(speeds[-1]))
    by_gain = fit_lpc(ends, fitted, FS, order=order)
    by_level = fit_lpc(ends, fitted, FS, order=order, loudness="level")
    lines = fit_frequencies(ends, fitted, FS, n_frequencies=30)
    found = []
    for i, (x, v) in enumerate(zip(signals[1:-1], speeds[1:-1], strict=True), start=1):
        others = [j for j in range(len(signals)) if j != i]
        drawn = {
            "LPC, log gain": by_gain,
            "LPC, log level": by_level,
            "LPC, all other speeds": fit_lpc(
                [signals[j] for j in others], [speeds[j] for j in others], FS, order=order
            ),
            "own LPC": fit_lpc([x, x], (v, 2 * v), FS, order=order),
        }
        scores = {}
        for way, texture in drawn.items():
            draws = [score(x, texture.signal(v, x.size, seed=seed + k)) for k in range(n_draws)]
            scores[way] = pd.DataFrame(draws).mean().to_dict()
        scores["frequencies"] = score(x, lines.signal(v, x.size))
        scores["nearest speed"] = score(x, ends[0] if v - fitted[0] <= fitted[1] - v else ends[1])
        scores["other half"] = score(*np.array_split(x, 2))
        found.append({"surface": surface, "speed": float(v), "fitted": fitted, "scores": scores})
    return found


def mean_scores(predictions):
    """Return the mean score of each way over the predictions, a row each; of levels, the mean magnitude."""
    every = pd.concat([pd.DataFrame(p["scores"]).T for p in predictions])
    every["level_db"] = every["level_db"].abs()
    return every.groupby(level=0, sort=False).mean()


def render_check(texture, seed, n_paths):
    """Play a texture over random paths, and over one whose speed jumps; µs per sample, in one block."""
    rng = np.random.default_rng(seed)
    renderer = texture.renderer(seed=seed)
    force = np.ones(PATH_SAMPLES)
    renderer.process(np.zeros((1, 2)), force[:1])
    largest, finite, start = 0.0, True, time.perf_counter()
    for _ in range(n_paths):
        knots = rng.exponential(120.0, (8, 2)) * rng.choice([-1, 1], (8, 2))
        t = np.linspace(0, 7, PATH_SAMPLES)
        path = np.column_stack([np.interp(t, np.arange(8), k) for k in knots.T])
        y = renderer.process(path, np.where(np.sin(t * rng.uniform(0, 5)) > -0.9, force, 0.0))
        largest, finite = max(largest, float(np.abs(y).max())), finite and bool(np.isfinite(y).all())
    seconds = time.perf_counter() - start
    return {
        "family": texture.family,
        "finite": finite and largest <= PEAK_FACTOR * texture.peak,
        "largest": largest / texture.peak,
        "click": click(texture, seed),
        "microseconds": 1e6 * seconds / (n_paths * PATH_SAMPLES),
    }


def click(texture, seed):
    """Return the largest step between samples while the speed jumps to and fro, over that at either speed."""
    n, slow, fast = 2000, float(texture.speeds[0]), float(texture.speeds[-1])

    def largest_step(speed):
        y = texture.renderer(seed=seed).process(np.column_stack([speed, 0 * speed]), np.ones(speed.size))
        return float(np.abs(np.diff(y[n:])).max())

    jumping = np.where(np.arange(20 * n) // n % 2 == 0, slow, fast)
    return largest_step(jumping) / max(largest_step(np.full(20 * n, v)) for v in (slow, fast))
