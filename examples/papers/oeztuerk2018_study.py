"""Compute the results for `oeztuerk2018`: model orders, frequencies, speed intervals, predictions."""

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
from texclass.vibration.null_scores import NULLS, distance_to_null, null_scores
from texclass.vibration.order import spectral_error
from texclass.vibration.perceptual_distance import perceptual_distance
from texclass.vibration.scores import band_energy_distance, goodness_of_fit, log_spectral_distance

FS = 10_000.0
LARGEST_ORDER, ERROR_LIMIT = 1000, 0.4
"""Largest order, and target error of the order selection; figure 3.2."""
N_DFT = 2800
"""Points of the DFT; section 3.1."""
LINE_COUNTS = tuple(range(2, 31))
"""Numbers of frequencies, 2 to 30; section 3.2."""
FAIR_FIT, GOOD_FIT = 0.8, 0.9
"""Required goodness of fit: our choice, and the value of "a good match" in `abdulali2016`."""
FRICTIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.0)
SPEEDS_MM_S = (40.0, 80.0, 120.0, 160.0)
MEAN_MM_S, FRICTION_SCALE, GAMMA_SHAPE = 150.0, 0.64, 4.0
"""Parameters of our speed model: gamma distribution of shape 4, mean 150 mm/s exp(-friction / 0.64)."""
N_SPEEDS = 240
"""Samples per friction coefficient, one every 0.2 s; figure 4.2."""
SETTLE_S = 0.6
"""Duration in s that is discarded at the beginning of a simulated recording."""
N_SEEDS = 50
"""Number of simulated histograms per friction coefficient."""
PATH_SAMPLES = 2000
"""Samples of a random path."""
NOTABLE_SHARE = 0.05
"""Smallest share of the samples in a notable bin. The thesis uses visual inspection instead."""
STRONGEST_DB = 30.0
"""Assumed sensation level in dB of the strongest band, for the perceptual distance."""
DURATION_S = 10.0
N_COPIES = 5
"""Number of mirrored copies in a seamless signal; section 3.2."""


def order_curves(x, largest=LARGEST_ORDER):
    """Return the spectral error of all orders for a zero-mean recording, and selected orders.

    Returns
    -------
    dict
        - "same_recording": error of orders 0 ... largest, eq. (3.11), on the recording used for the fit;
        - "other_half": error of a model of one half on the other half, averaged over both directions;
        - "floor" and "floor_of_half": expected error of the true model;
        - "aicc": order with the smallest AICc;
        - "small_gain_order": order beyond which the error hardly decreases;
        - "order_at_limit": first order with an error of at most 0.4, or None.
    """
    small_gain, limited = select_order(x, largest), select_order(x, largest, max_error=ERROR_LIMIT)
    halves = np.array_split(x, 2)
    half_errors = [spectral_error(test, fit(training, largest)) for training, test in (halves, halves[::-1])]
    return {
        "same_recording": small_gain.values,  # noqa: PD011, no DataFrame
        "other_half": np.mean(half_errors, axis=0),
        "floor": error_floor(x.size // N_DFT),
        "floor_of_half": error_floor(x.size // 2 // N_DFT),
        "aicc": select_order(x, largest, criterion="aicc").order,
        "small_gain_order": small_gain.order,
        "order_at_limit": limited.order if limited.is_met else None,
    }


def error_floor(n_segments):
    """Return the expected error of the true model, which is caused by averaging over M segments only.

    For a Gaussian process E |X| / |G| = Gamma(M + 1/2) / (Gamma(M) sqrt(M)), so C^2 = 2 - 2 E |X| / |G|.
    """
    return float(np.sqrt(2 - 2 * special.poch(n_segments, 0.5) / np.sqrt(n_segments)))


def frequency_count(x):
    """Return the number of frequencies needed for 1 s of a recording, and the effect of Table 3.2.

    Returns
    -------
    dict
        - "gfc": goodness of fit of the spectrum with 2 ... 30 lines;
        - "n_for_0.8", "n_for_0.9": smallest number of lines with this goodness of fit, or None;
        - "n_excluded_as_beating": lines among the 30 strongest that would beat with a stronger one;
        - "smallest_margin_hz": smallest amount by which two selected lines exceed their threshold, in Hz.
    """
    x = x[: round(FS)]
    models = [fit_major_frequencies(x, FS, n_frequencies=n) for n in LINE_COUNTS]
    synthesized = [model.synthesize(x.size, FS) for model in models]
    gfc = np.array([goodness_of_fit(x, y, window=min(2800, x.size), n_hamming=500) for y in synthesized])
    f = models[-1].frequency_hz
    X = np.abs(np.fft.rfft(x))[1 : round(1400 * x.size / FS) + 1]
    selected_bins = np.round(f * x.size / FS).astype(int) - 1
    n_strongest_selected = np.isin(selected_bins, np.argsort(-X)[: LINE_COUNTS[-1]]).sum()
    fair, good = (
        LINE_COUNTS[int(np.argmax(gfc >= limit))] if np.any(gfc >= limit) else None
        for limit in (FAIR_FIT, GOOD_FIT)
    )
    return {
        "gfc": gfc.round(4).tolist(),
        "n_for_0.8": fair,
        "n_for_0.9": good,
        "n_excluded_as_beating": int(LINE_COUNTS[-1] - n_strongest_selected),
        "smallest_margin_hz": float(np.min(np.diff(f) - beat_threshold_hz(f[:-1]), initial=np.inf)),
    }


def stroking_speeds(friction, rng):
    """Simulate the speeds (mm/s) of a person on a surface with this friction coefficient, shape (240,).

    The thesis shows only histograms and the number of notable bins, not the mean speeds. We chose a
    distribution that gives approximately the same number of bins. It tests the rule for the intervals, not
    the thesis.
    """
    mean = MEAN_MM_S * np.exp(-friction / FRICTION_SCALE)
    return rng.gamma(GAMMA_SHAPE, mean / GAMMA_SHAPE, N_SPEEDS)


def intervals_from_speeds(speed, notable_share=NOTABLE_SHARE):
    """Return the speed intervals for speeds (mm/s) recorded on a surface at equal time steps.

    As in figure 4.2, the last interval is the last bin with a notable share of the samples. It also includes
    faster samples.
    """
    share = np.bincount(np.floor(np.asarray(speed) / BIN_MM_S).astype(int)) / len(speed)
    last_bin = np.flatnonzero(share >= notable_share)[-1:]
    return SpeedIntervals.equal(int(last_bin.sum()) + 1)


def mirror(x):
    """Return a signal followed by its reflection: x_0 ... x_n-1 x_n-1 ... x_0.

    Adjacent copies join without a jump, because the samples at the joint are equal.
    """
    return np.concatenate([x, x[::-1]])


def seamless_signal(x, fs, duration_s=DURATION_S, peak=None):
    """Return the mirrored signal, repeated to a duration and scaled to a peak.

    Five mirrored copies of 1 s result in 10 s, as in the thesis. The peak is the peak of the reference signal
    (`oeztuerk2018`, end of section 3.2).
    """
    repeated = np.resize(mirror(x), round(duration_s * fs))
    largest = np.abs(repeated).max()
    return repeated if peak is None or largest == 0 else repeated * (peak / largest)


def interval_signals(texture, friction, duration_s=DURATION_S, peaks=None, seed=0):
    """Return a seamless signal for each speed interval of a friction coefficient, from slow to fast.

    The speed of each signal is the centre of its interval. A tenth of the duration is rendered, mirrored,
    repeated 5 times, and scaled to the peak of its reference, if available; sections 3.2 and 6.1, Table 6.1.
    """
    speeds = speed_intervals(friction).centres_mm_s
    n = max(1, round(duration_s * texture.fs / (2 * N_COPIES)))
    return [
        seamless_signal(texture.signal(v, n, seed=seed + i), texture.fs, duration_s, peak)
        for i, (v, peak) in enumerate(zip(speeds, peaks or [None] * len(speeds), strict=True))
    ]


def count_intervals(friction, seed):
    """Return the numbers of intervals, published and in 50 simulated histograms, and the mean speed."""
    samples = [stroking_speeds(friction, np.random.default_rng((seed, i))) for i in range(N_SEEDS)]
    return {
        "published": speed_intervals(friction).n_intervals,
        "simulated": np.bincount([intervals_from_speeds(v).n_intervals for v in samples]).tolist(),
        "mean_speed_mm_s": round(float(np.mean(samples)), 2),
    }


def simulate_recordings(seed, n_surfaces):
    """Simulate surfaces at `SPEEDS_MM_S` and 1 N: one axis without hand motion, in m/s^2.

    Each speed has a separate part of the surface and separate noise.
    """
    operator = operator_catalogue(1, seed)[0]
    signals = {}
    for i, surface in enumerate(surface_catalogue(n_surfaces, seed)):
        signals[surface.name] = []
        for j, v in enumerate(SPEEDS_MM_S):
            recording = record_rising_speed(
                surface, operator, duration_s=3.0 + SETTLE_S, fs=FS, seed=(seed + i, j), speed_mm_s=(v, v)
            )
            x = combine(recording.acceleration[round(SETTLE_S * FS) :])
            signals[surface.name].append(remove_hand_motion(x, FS))
    return signals


def score(recorded, predicted):
    """Compare two signals of any length: spectra, nine bands, 20 Hz wide bands, level and perception.

    The perceptual distance is computed at equal level.
    """
    n = min(recorded.size, predicted.size)
    return {
        "log_spectral_db": log_spectral_distance(recorded, predicted, n_segment=512),
        "band_db": band_energy_distance(recorded, predicted, FS),
        "gfc": goodness_of_fit(recorded[:n], predicted[:n], window=2800, n_hamming=500),
        "level_db": float(20 * np.log10(np.std(predicted) / np.std(recorded))),
        "perceptual_db": perceptual_distance(
            recorded, predicted, FS, strongest_db=STRONGEST_DB, equal_level=True
        ),
    }


def predict_held_out_speeds(signals, speeds, surface, *, order=400, seed=0, n_draws=3):
    """Fit textures to the slowest and fastest recordings, and predict the recordings in between.

    The methods are "LPC, log gain" (as in the thesis), "LPC, log level", "LPC, all other speeds" (fitted to
    all recordings except the held-out one, log gain), "frequencies" and "nearest speed". Two references limit
    the achievable scores: "own LPC", fitted to the held-out recording itself, and "other half", one half of
    that recording compared with the other.
    """
    ends, fitting_speeds = [signals[0], signals[-1]], (float(speeds[0]), float(speeds[-1]))
    by_gain = fit_lpc(ends, fitting_speeds, FS, order=order)
    by_level = fit_lpc(ends, fitting_speeds, FS, order=order, loudness="level")
    lines = fit_frequencies(ends, fitting_speeds, FS, n_frequencies=30)
    predictions = []
    for i, (x, v) in enumerate(zip(signals[1:-1], speeds[1:-1], strict=True), start=1):
        others = [j for j in range(len(signals)) if j != i]
        random_textures = {
            "LPC, log gain": by_gain,
            "LPC, log level": by_level,
            "LPC, all other speeds": fit_lpc(
                [signals[j] for j in others], [speeds[j] for j in others], FS, order=order
            ),
            "own LPC": fit_lpc([x, x], (v, 2 * v), FS, order=order),
        }
        scores = {}
        for method, texture in random_textures.items():
            draws = [score(x, texture.signal(v, x.size, seed=seed + k)) for k in range(n_draws)]
            scores[method] = pd.DataFrame(draws).mean().to_dict()
        scores["frequencies"] = score(x, lines.signal(v, x.size))
        is_slow_nearer = v - fitting_speeds[0] <= fitting_speeds[1] - v
        scores["nearest speed"] = score(x, ends[0] if is_slow_nearer else ends[1])
        scores["other half"] = score(*np.array_split(x, 2))
        predictions.append(
            {"surface": surface, "speed": float(v), "fitting_speeds": fitting_speeds, "scores": scores}
        )
    return predictions


def add_nulls(predictions, signals):
    """Add the scores of the nulls to predictions of held-out speeds.

    Parameters
    ----------
    predictions : list of dict
        Results of `predict_held_out_speeds` for all surfaces.
    signals : mapping of str to list of array_like
        Recordings of each surface at all speeds.
    """
    keys = next(iter(predictions[0]["scores"].values()))
    for i in (1, 2):
        recordings = {name: x[i] for name, x in signals.items()}
        tables = {
            key: null_scores(
                lambda x, y, key=key: abs(score(x, y)[key]), recordings, FS,
                higher_is_better=key == "gfc", equal_level=key != "level_db", n_draws=1,
            )
            for key in keys
        }  # fmt: skip
        held_out = [p for p in predictions if p["speed"] == sorted({p["speed"] for p in predictions})[i - 1]]
        for prediction in held_out:
            prediction["scores"] |= {
                way: {key: float(table.loc[prediction["surface"], way]) for key, table in tables.items()}
                for way in (*NULLS, "best null")
            }


def distance_of(predictions, method, key):
    """Return by how much a method is better than the best null, with its interval over surfaces."""
    rows = [(p["surface"], p["scores"][method][key], p["scores"]["best null"][key]) for p in predictions]
    means = pd.DataFrame(rows, columns=["surface", "score", "best null"]).groupby("surface").mean()
    return distance_to_null(means["score"], means[["best null"]], higher_is_better=key == "gfc")


def fit_of_nulls(excerpts):
    """Return the median goodness of fit (bands of 20 Hz) of nulls and of the other half, for 1 s excerpts."""
    nulls = null_scores(
        lambda x, y: goodness_of_fit(x, y, window=2800, n_hamming=500),
        {name: x[: round(FS)] for name, x in excerpts.items()},
        FS,
        surfaces={name: name.partition("_")[0] for name in excerpts},
        higher_is_better=True,
    )
    return nulls.median().to_dict()


def mean_scores(predictions):
    """Return the mean scores over the predictions, one row per method; level errors enter as magnitudes."""
    scores = pd.concat([pd.DataFrame(prediction["scores"]).T for prediction in predictions])
    scores["level_db"] = scores["level_db"].abs()
    return scores.groupby(level=0, sort=False).mean()


def check_rendering(texture, seed, n_paths):
    """Render a texture along random paths and along speed jumps, and measure the time in one block.

    Returns
    -------
    dict
        - "family": family of the texture;
        - "is_bounded": whether all samples are finite and within `PEAK_FACTOR` times the recorded peak;
        - "relative_peak": largest sample relative to the recorded peak;
        - "relative_step": result of `relative_step`;
        - "microseconds": time per sample.
    """
    rng = np.random.default_rng(seed)
    renderer = texture.renderer(seed=seed)
    force = np.ones(PATH_SAMPLES)
    renderer.process(np.zeros((1, 2)), force[:1])
    largest, is_finite, start = 0.0, True, time.perf_counter()
    for _ in range(n_paths):
        knots = rng.exponential(120.0, (8, 2)) * rng.choice([-1, 1], (8, 2))
        t = np.linspace(0, 7, PATH_SAMPLES)
        path = np.column_stack([np.interp(t, np.arange(8), k) for k in knots.T])
        y = renderer.process(path, np.where(np.sin(t * rng.uniform(0, 5)) > -0.9, force, 0.0))
        largest, is_finite = max(largest, float(np.abs(y).max())), is_finite and bool(np.isfinite(y).all())
    seconds = time.perf_counter() - start
    return {
        "family": texture.family,
        "is_bounded": is_finite and largest <= PEAK_FACTOR * texture.peak,
        "relative_peak": largest / texture.peak,
        "relative_step": relative_step(texture, seed),
        "microseconds": 1e6 * seconds / (n_paths * PATH_SAMPLES),
    }


def relative_step(texture, seed):
    """Return the largest step between samples during speed jumps, relative to the one at constant speed."""
    n, slow, fast = 2000, float(texture.speeds[0]), float(texture.speeds[-1])

    def largest_step(speed):
        y = texture.renderer(seed=seed).process(np.column_stack([speed, 0 * speed]), np.ones(speed.size))
        return float(np.abs(np.diff(y[n:])).max())

    jumps = np.where(np.arange(20 * n) // n % 2 == 0, slow, fast)
    return largest_step(jumps) / max(largest_step(np.full(20 * n, v)) for v in (slow, fast))
