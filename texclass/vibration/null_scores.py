"""Nulls and ceiling of a score of synthesized vibrations, and how well the score separates surfaces."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import fft, signal, stats

from texclass.recording import Samples
from texclass.signals import one_channel
from texclass.vibration.perceptual_distance import band_powers

Score: TypeAlias = Callable[[Samples, Samples], float]
"""Score of a candidate (second argument) against a recording (first argument), of equal lengths."""

NULLS = ("white noise", "next surface", "mean of others")


def null_scores(
    score: Score, recordings: Mapping[str, ArrayLike], fs: float, *, higher_is_better: bool,
    surfaces: Mapping[str, str] | None = None, equal_level: bool = True, n_draws: int = 3, seed: int = 0,
) -> pd.DataFrame:  # fmt: skip
    """Return the scores of candidates that contain nothing of the surface, and of the recording itself.

    The score is computed on the second half of each recording. The ceiling is its first half: a model of the
    first half is not expected to predict more. The nulls are white noise, the first half of another surface
    (the best one), and Gaussian noise with the mean power spectrum of the other surfaces. A score proves
    something only by its distance to the best null.

    Parameters
    ----------
    score : callable
        Function of a recording and a candidate, of equal lengths, that returns a number.
    recordings : mapping of str to array_like of shape (n_samples,)
        Recordings of at least two surfaces, by name. If two recordings have different lengths, the longer one
        is truncated.
    fs : float
        Sampling rate in Hz of all recordings.
    higher_is_better : bool
        Whether a higher score is better (True for the goodness-of-fit criterion, False for a distance).
    surfaces : mapping of str to str, optional
        Surface of each recording. By default, each recording has its own surface.
    equal_level : bool
        Whether the nulls are scaled to the level of the first half from 20 to 1000 Hz (default True). If not,
        only white noise is scaled, and other surfaces keep their levels.
    n_draws : int
        Number of noise signals per null; scores are averaged (default 3).
    seed : int
        Seed of the noise (default 0).

    Returns
    -------
    DataFrame
        One row per recording, with the columns "other half", "white noise", "next surface", "mean of others"
        and "best null".

    Raises
    ------
    ValueError
        If there are fewer than two surfaces, or a recording is silent from 20 to 1000 Hz, is too short, or
        contains NaN or infinity.

    Examples
    --------
    >>> from texclass.vibration.scores import goodness_of_fit
    >>> noise = np.random.default_rng(0).standard_normal((2, 4000))
    >>> textures = {"smooth": noise[0], "ridged": signal.lfilter([1], [1, -1.5, 0.9], noise[1])}
    >>> nulls = null_scores(goodness_of_fit, textures, 1000.0, higher_is_better=True)
    >>> nulls.loc["ridged", ["other half", "best null"]].round(1).tolist()
    [1.0, 0.6]
    """
    halves = _halves(recordings)
    labels = _labels(halves, surfaces)
    best = max if higher_is_better else min
    rng = np.random.default_rng(seed)
    rows = {}
    for name, (known, target) in halves.items():
        others = [halves[other][0] for other in halves if labels[other] != labels[name]]
        level = _level(known, fs)
        nexts = [_scaled(x, level, fs) if equal_level else x for x in others]
        spectrum, mean_level = _mean_spectrum(others, fs)
        draws = [rng.standard_normal((2, target.size)) for _ in range(n_draws)]
        white = [_scaled(noise[0], level, fs) for noise in draws]
        means = [
            _scaled(_shaped(noise[1], spectrum), level if equal_level else mean_level, fs) for noise in draws
        ]
        rows[name] = {
            "other half": _scored(score, target, known),
            "white noise": np.mean([_scored(score, target, x) for x in white]),
            "next surface": best(_scored(score, target, x) for x in nexts),
            "mean of others": np.mean([_scored(score, target, x) for x in means]),
        }
    table = pd.DataFrame.from_dict(rows, orient="index")
    nulls = table[list(NULLS)]
    return table.assign(**{"best null": nulls.max(axis=1) if higher_is_better else nulls.min(axis=1)})


def distance_to_null(
    scores: pd.Series, nulls: pd.DataFrame, *, higher_is_better: bool, column: str = "best null"
) -> dict[str, float]:
    """Return by how much scores are better than a null, with a 95 % confidence interval over recordings.

    Parameters
    ----------
    scores : Series
        Score of each recording.
    nulls : DataFrame
        Result of `null_scores` for the same score and recordings.
    higher_is_better : bool
        Whether a higher score is better.
    column : str
        Null to compare with (default "best null").

    Returns
    -------
    dict
        - "mean", "low", "high": mean distance, positive if the scores are better, and its interval (t
          distribution), in the unit of the score; the interval is NaN for one recording;
        - "n_better", "n": recordings with a score better than the null, and all recordings.

    Raises
    ------
    ValueError
        If a recording has no null.

    Examples
    --------
    >>> nulls = pd.DataFrame({"best null": [0.97, 0.95, 0.96]}, index=["oak", "cork", "slate"])
    >>> gfc = pd.Series([0.98, 0.97, 0.95], index=nulls.index)
    >>> distance = distance_to_null(gfc, nulls, higher_is_better=True)
    >>> round(distance["mean"], 4), distance["n_better"], distance["n"]
    (0.0067, 2, 3)
    """
    missing = scores.index.difference(nulls.index)
    if len(missing):
        raise ValueError(
            f"nulls must contain all recordings of scores, but lack {', '.join(map(str, missing))}"
        )
    margin = (scores - nulls.loc[scores.index, column]) * (1 if higher_is_better else -1)
    half = stats.t.ppf(0.975, len(margin) - 1) * margin.sem() if len(margin) > 1 else np.nan
    mean = float(margin.mean())
    counts = {"n_better": int((margin > 0).sum()), "n": len(margin)}
    return {"mean": mean, "low": mean - float(half), "high": mean + float(half)} | counts


def same_or_different(
    score: Score, recordings: Mapping[str, ArrayLike], fs: float, *, higher_is_better: bool,
    surfaces: Mapping[str, str] | None = None, equal_level: bool = True, n_resamples: int = 1000,
    seed: int = 0,
) -> dict[str, float]:  # fmt: skip
    """Return how well a score distinguishes halves of one recording from halves of different surfaces.

    Parameters
    ----------
    score, recordings, fs, higher_is_better, surfaces, equal_level
        As in `null_scores`; with equal levels, the first half is scaled to the level of the second.
    n_resamples : int
        Number of bootstrap samples of recordings (default 1000).
    seed : int
        Seed of the bootstrap (default 0).

    Returns
    -------
    dict
        - "auroc", "low", "high": area under the ROC curve with its 95 % confidence interval over recordings.
          1 means that every pair of halves of one recording is scored better than every pair of different
          surfaces; 0.5 is the chance level;
        - "n_same", "n_different": pairs.

    Raises
    ------
    ValueError
        If there are fewer than two surfaces, or a recording is silent from 20 to 1000 Hz, is too short, or
        contains NaN or infinity.

    Examples
    --------
    >>> from texclass.vibration.scores import log_spectral_distance
    >>> noise = np.random.default_rng(0).standard_normal((2, 4000))
    >>> textures = {"smooth": noise[0], "ridged": signal.lfilter([1], [1, -1.5, 0.9], noise[1])}
    >>> same_or_different(log_spectral_distance, textures, 1000.0, higher_is_better=False)["auroc"]
    1.0
    """
    halves = _halves(recordings)
    labels = np.array(list(_labels(halves, surfaces).values()))
    scores = np.array(
        [
            [
                _scored(score, y, _scaled(x, _level(y, fs), fs) if equal_level else x)
                for x, _ in halves.values()
            ]
            for _, y in halves.values()
        ]
    )
    scores *= 1 if higher_is_better else -1
    everything = np.arange(len(labels))
    rng = np.random.default_rng(seed)
    samples = [rng.choice(everything, everything.size) for _ in range(n_resamples)]
    resampled = [_auroc(scores, labels, i) for i in samples if np.unique(labels[i]).size > 1]
    low, high = np.percentile(resampled, [2.5, 97.5])
    n_different = int(np.sum(labels[:, np.newaxis] != labels))
    estimate = {"auroc": _auroc(scores, labels, everything), "low": float(low), "high": float(high)}
    return estimate | {"n_same": len(labels), "n_different": n_different}


def _auroc(scores: Samples, labels: np.ndarray, i: np.ndarray) -> float:
    """Return the AUROC of the recordings i: the diagonal against the pairs of different surfaces."""
    is_different = labels[i][:, np.newaxis] != labels[i]
    same, different = scores[i, i], scores[np.ix_(i, i)][is_different]
    ranks = stats.rankdata(np.concatenate([same, different]))[: same.size]
    return float((ranks.mean() - (same.size + 1) / 2) / different.size)


def _halves(recordings: Mapping[str, ArrayLike]) -> dict[str, tuple[Samples, Samples]]:
    halves = {}
    for name, recording in recordings.items():
        x = one_channel(recording, f"recordings[{name!r}]", at_least=8)
        n = x.size // 2
        halves[name] = (x[:n], x[n : 2 * n])
    return halves


def _labels(halves: Mapping[str, object], surfaces: Mapping[str, str] | None) -> dict[str, str]:
    labels = {name: surfaces[name] if surfaces else name for name in halves}
    if len(set(labels.values())) < 2:
        raise ValueError(f"recordings must contain at least two surfaces, got {sorted(set(labels.values()))}")
    return labels


def _scored(score: Score, target: Samples, candidate: Samples) -> float:
    n = min(target.size, candidate.size)
    return float(score(target[:n], candidate[:n]))


def _level(x: Samples, fs: float) -> float:
    """Return the RMS from 20 to 1000 Hz."""
    level = float(np.sqrt(band_powers(x, fs).sum()))
    if level == 0:
        raise ValueError("recordings must not be silent from 20 to 1000 Hz. Remove silent recordings")
    return level


def _scaled(x: Samples, level: float, fs: float) -> Samples:
    return np.asarray(x * (level / _level(x, fs)))


def _mean_spectrum(others: list[Samples], fs: float) -> tuple[Samples, float]:
    """Return the mean of the power spectra, each divided by its power, and the mean level in dB as RMS."""
    n = min(round(fs / 2), *(x.size for x in others))
    densities = [signal.welch(x, fs, nperseg=n)[1] for x in others]
    levels = np.array([_level(x, fs) for x in others])
    return np.mean([p / p.sum() for p in densities], axis=0), float(np.exp(np.mean(np.log(levels))))


def _shaped(noise: Samples, power: Samples) -> Samples:
    """Return noise with a power spectrum given at equally spaced frequencies from 0 to fs/2."""
    X = fft.rfft(noise)
    gain = np.interp(np.linspace(0, 1, X.size), np.linspace(0, 1, power.size), np.sqrt(power))
    return np.asarray(fft.irfft(gain * X, noise.size))
