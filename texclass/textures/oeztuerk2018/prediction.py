"""How well a speed that was left out is predicted, against playing the recording of the nearest speed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.textures.oeztuerk2018.frequencies import fit_frequencies
from texclass.textures.oeztuerk2018.lpc import ORDER, fit_lpc
from texclass.vibration.scores import band_energy_distance, goodness_of_fit, log_spectral_distance

N_SEGMENT, GFC_WINDOW, GFC_SEGMENT = 512, 2800, 500
N_DRAWS = 3
N_LINES = 30


@dataclass(frozen=True)
class Score:
    """A prediction beside the recording of the speed.

    Attributes
    ----------
    log_spectral_db : float
        RMS difference of the power spectra, dB, all frequencies alike.
    band_db : float
        RMS difference of the energies in nine bands, 20 ... 1000 Hz, dB.
    gfc : float
        Goodness of fit of the amplitude spectra, at 20 Hz; blind to level.
    level_db : float
        Level of the prediction above that of the recording, dB.
    """

    log_spectral_db: float
    band_db: float
    gfc: float
    level_db: float


@dataclass(frozen=True)
class Prediction:
    """All ways to one left-out speed of one surface."""

    surface: str
    speed: float
    fitted: tuple[float, ...]
    scores: dict[str, Score]


def score(recorded: Samples, predicted: Samples, fs: float) -> Score:
    """Compare two signals of any lengths."""
    n = min(recorded.size, predicted.size)
    return Score(
        log_spectral_distance(recorded, predicted, n_segment=N_SEGMENT),
        band_energy_distance(recorded, predicted, fs),
        goodness_of_fit(recorded[:n], predicted[:n], window=GFC_WINDOW, n_hamming=GFC_SEGMENT),
        float(20 * np.log10(np.std(predicted) / np.std(recorded))),
    )


def predict_left_out(
    signals: Sequence[Samples],
    speeds: Sequence[float],
    fs: float,
    *,
    surface: str,
    order: int = ORDER,
    seed: int = 0,
) -> list[Prediction]:
    """Fit the slowest and the fastest recording, and predict those between.

    Parameters
    ----------
    signals : sequence of ndarray, each of shape (n_samples,)
        Without means, from slow to fast.
    speeds : sequence of float
        Rising.
    fs : float
        Hz.
    surface : str
        Its name.
    order : int
        Of the LPC models.
    seed : int
        Of the noise that drives them.

    Returns
    -------
    list of Prediction
        With the ways "LPC, log gain" (as in the thesis), "LPC, log level", "LPC, all other speeds" (fitted
        to all recordings but the left-out one, log gain), "frequencies", "nearest speed", and two
        that no prediction can be expected to beat: "own LPC", fitted to the left-out recording, and "other
        half", one half of that recording against the other.
    """
    ends, fitted = [signals[0], signals[-1]], (float(speeds[0]), float(speeds[-1]))
    by_gain = fit_lpc(ends, fitted, fs, order=order)
    by_level = fit_lpc(ends, fitted, fs, order=order, loudness="level")
    lines = fit_frequencies(ends, fitted, fs, n_frequencies=N_LINES)
    found = []
    for i, (x, v) in enumerate(zip(signals[1:-1], speeds[1:-1], strict=True), start=1):
        others = [j for j in range(len(signals)) if j != i]
        by_others = fit_lpc([signals[j] for j in others], [speeds[j] for j in others], fs, order=order)
        own = fit_lpc([x, x], (v, 2 * v), fs, order=order)
        first, second = np.array_split(x, 2)
        nearer = ends[0] if v - fitted[0] <= fitted[1] - v else ends[1]
        drawn = {
            "LPC, log gain": by_gain,
            "LPC, log level": by_level,
            "LPC, all other speeds": by_others,
            "own LPC": own,
        }
        scores = {
            way: _mean([score(x, t.signal(v, x.size, seed=seed + k), fs) for k in range(N_DRAWS)])
            for way, t in drawn.items()
        }
        scores["frequencies"] = score(x, lines.signal(v, x.size), fs)
        scores["nearest speed"] = score(x, nearer, fs)
        scores["other half"] = score(first, second, fs)
        found.append(Prediction(surface, float(v), fitted, scores))
    return found


def mean_scores(predictions: Sequence[Prediction]) -> dict[str, Score]:
    """Return the mean score of each way over the predictions; of levels, the mean magnitude."""
    found = {}
    for way in predictions[0].scores:
        rows = [p.scores[way] for p in predictions]
        found[way] = _mean([Score(s.log_spectral_db, s.band_db, s.gfc, abs(s.level_db)) for s in rows])
    return found


def _mean(scores: Sequence[Score]) -> Score:
    rows = np.array([(s.log_spectral_db, s.band_db, s.gfc, s.level_db) for s in scores])
    return Score(*map(float, rows.mean(axis=0)))
