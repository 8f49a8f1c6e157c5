"""The baselines: tools that users might take instead, with the classifiers they are combined with.

Each turns the signals of some recordings into a table of features. What it needs is imported when it runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.compose import ColumnTransformer
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.impute import SimpleImputer
from sklearn.linear_model import RidgeClassifierCV
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

Signal = NDArray[np.float64]
"""Shape (n_channels, n_samples)."""
Table = NDArray[np.floating[Any]]
"""Shape (n_recordings, n_columns)."""
FRAME_S, HOP, LEAST = 0.025, 0.6, 50
"""Of cepstra: frame in seconds, hop as a share of it (15 ms), and the fewest samples a frame may have."""
N_COEFFICIENTS, N_MELS = 13, 26
"""Bands and transform length: of six settings the most even one on the TEST parts of biotac20 (chronological,
few-shot), so these figures lean in the baseline's favour there."""
TSFEL_LEAST_HZ = 100.0
BATCH = 32
"""Recordings that aeon transforms at a time, so that memory does not grow with their number."""
CLASSIFIERS: dict[str, Callable[[int], Any]] = {
    "lda": lambda seed: LinearDiscriminantAnalysis(),
    "shrinkage_lda": lambda seed: LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
    "naive_bayes": lambda seed: GaussianNB(),
    "random_forest": lambda seed: RandomForestClassifier(200, random_state=seed),
    "ridge": lambda seed: RidgeClassifierCV(alphas=np.logspace(-3, 3, 10)),
    "extra_trees": lambda seed: ExtraTreesClassifier(
        200, max_features=0.1, criterion="entropy", random_state=seed
    ),
}
"""Name -> (seed -> unfitted classifier). Ridge and extra trees are set as in aeon's own classifiers."""
DISCRIMINANTS = ("lda", "shrinkage_lda", "random_forest")


@dataclass(frozen=True)
class PerRecording:
    """Features that are a function of one recording: computed channel by channel, joined.

    Parameters
    ----------
    describe : callable
        (samples of one channel, shape (n_samples,); fs in Hz) -> values, shape (n_columns,).
    fs : float
        Sampling rate in Hz.
    """

    describe: Callable[[Signal, float], Table]
    fs: float
    learns: ClassVar[bool] = False
    """Nothing is taken from the signals it is fitted on, so every recording is computed only once."""

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Learn nothing."""
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the features; what is not finite is NaN, which the scaler's training median replaces."""
        table = np.stack(
            [np.concatenate([self.describe(channel, self.fs) for channel in signal]) for signal in signals]
        )
        return np.where(np.isfinite(table), table, np.nan)

    def scaler(self) -> Any:
        """Return median imputation and standardisation."""
        return make_pipeline(SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler())


class OfEqualLength:
    """Transformers of aeon, side by side: they want signals of one length, the median of those in training.

    Parameters
    ----------
    make : callable
        () -> list of (unfitted transformer, number of signals that it is fitted on, None for all).
    scale : callable
        (columns of each transformer) -> the unfitted step that comes before the classifier.
    learns : bool
        Whether values are taken from the signals they are fitted on, beside the length.
    batch : int
        Recordings transformed at a time.
    """

    def __init__(
        self,
        make: Callable[[], list[tuple[Any, int | None]]],
        scale: Callable[[list[int]], Any],
        learns: bool = True,
        batch: int = BATCH,
    ) -> None:
        self.make, self.scale, self.learns, self.batch = make, scale, learns, batch

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Draw kernels and biases, or lay out intervals."""
        self.n_samples = int(np.median([signal.shape[1] for signal in signals]))
        self.transformers = [t.fit(equal_lengths(signals[:n], self.n_samples)) for t, n in self.make()]
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the features, those of one transformer after those of the other."""
        rows = []
        for i in range(0, len(signals), self.batch):
            X = equal_lengths(signals[i : i + self.batch], self.n_samples)
            parts = [np.asarray(t.transform(X), dtype=np.float32) for t in self.transformers]
            self.widths = [part.shape[1] for part in parts]
            rows.append(np.concatenate(parts, axis=1))
        return np.concatenate(rows)

    def scaler(self) -> Any:
        """Return the scaling of aeon's own classifier."""
        return self.scale(self.widths)


Extractor = PerRecording | OfEqualLength
"""Turns signals into features: `fit`, `transform`, and `scaler`, the step before the classifier."""


def equal_lengths(signals: Sequence[Signal], n_samples: int) -> NDArray[np.float32]:
    """Return signals as one array of shape (n_recordings, n_channels, n_samples).

    Longer ones lose equal parts at both ends, shorter ones are followed by zeros (their mean is zero).
    """
    same = np.zeros((len(signals), signals[0].shape[0], n_samples), dtype=np.float32)
    for row, signal in zip(same, signals, strict=True):
        skipped = max(signal.shape[1] - n_samples, 0) // 2
        kept = signal[:, skipped : skipped + n_samples]
        row[:, : kept.shape[1]] = kept
    return same


def cepstra(x: Signal, fs: float) -> Table:
    """Return librosa's mel-frequency cepstral coefficients, shape (n_coefficients, n_frames)."""
    import librosa

    frame = max(round(FRAME_S * fs), LEAST)
    coefficients = librosa.feature.mfcc(
        y=x, sr=fs, n_mfcc=N_COEFFICIENTS, n_mels=N_MELS, n_fft=1 << (frame - 1).bit_length(),
        win_length=frame, hop_length=max(round(HOP * frame), 1),
    )  # fmt: skip
    return np.asarray(coefficients)


def mean_and_deviation(x: Signal, fs: float) -> Table:
    """Return the mean and the standard deviation over frames of each coefficient."""
    found = cepstra(x, fs)
    return np.concatenate([found.mean(axis=1), found.std(axis=1)])


def tsfel_all(x: Signal, fs: float) -> Table:
    """Return every feature of TSFEL's default configuration, computed on the whole signal.

    TSFEL names columns by frequencies rounded to 0.01 Hz, so below `TSFEL_LEAST_HZ` time is counted in a
    shorter unit: frequencies keep their order.
    """
    import tsfel

    rate = max(fs, TSFEL_LEAST_HZ)
    found = tsfel.time_series_features_extractor(tsfel.get_features_by_domain(), x, fs=rate, verbose=0)
    return np.asarray(found.to_numpy(dtype=np.float64)[0])


def tsfresh_minimal(x: Signal, fs: float) -> Table:
    """Return the ten features of tsfresh's `MinimalFCParameters`."""
    import pandas as pd
    from tsfresh.feature_extraction import MinimalFCParameters, extract_features

    found = extract_features(
        pd.DataFrame({"id": 0, "x": x}),
        column_id="id",
        default_fc_parameters=MinimalFCParameters(),
        n_jobs=0,
        disable_progressbar=True,
    )
    return np.asarray(found.to_numpy(dtype=np.float64)[0])


def catch22(x: Signal, fs: float) -> Table:
    """Return the 22 features of catch22, which standardises the signal first."""
    import pycatch22

    return np.asarray(pycatch22.catch22_all(x)["values"], dtype=np.float64)


def quant() -> list[tuple[Any, int | None]]:
    """Return QUANT (quantiles over dyadic intervals) with its defaults; needs torch."""
    from aeon.transformations.collection.interval_based import QUANTTransformer

    return [(QUANTTransformer(), 1)]


def minirocket(seed: int) -> list[tuple[Any, int | None]]:
    """Return MiniRocket with its default 10,000 kernels; biases come from the training signals."""
    from aeon.transformations.collection.convolution_based import MiniRocket

    return [(MiniRocket(random_state=seed, n_jobs=1), None)]


def hydra_and_multirocket(seed: int) -> list[tuple[Any, int | None]]:
    """Return Hydra and MultiRocket, as in aeon's `MultiRocketHydraClassifier`; Hydra needs torch."""
    from aeon.transformations.collection.convolution_based import HydraTransformer, MultiRocket

    hydra = HydraTransformer(random_state=seed, n_jobs=1, output_type="numpy")
    return [(hydra, 1), (MultiRocket(random_state=seed, n_jobs=1), None)]


def counts_and_values(widths: list[int]) -> Any:
    """Return the scaling of Hydra's counts and of MultiRocket's pooled values."""
    counts, rest = slice(0, widths[0]), slice(widths[0], None)
    return ColumnTransformer([("hydra", CountScaler(), counts), ("rocket", StandardScaler(), rest)])


class CountScaler(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Standardise the square roots of sparse counts; a zero stays a zero.

    z = (sqrt(max(x, 0)) - mean) [x > 0] / (deviation + share of zeros^4 + 1e-8): a kernel that rarely wins
    says little. The scaling that Hydra's authors use.
    """

    def fit(self, X: Table, y: Any = None) -> Self:
        """Learn mean, deviation and the share of zeros of each column."""
        root = np.sqrt(np.maximum(X, 0))
        self.mean_ = root.mean(axis=0)
        self.deviation_ = root.std(axis=0, ddof=1) + (root == 0).mean(axis=0) ** 4 + 1e-8
        return self

    def transform(self, X: Table) -> Table:
        """Return the scaled roots."""
        root = np.sqrt(np.maximum(X, 0))
        return np.asarray((root - self.mean_) * (root != 0) / self.deviation_, dtype=np.float32)


@dataclass(frozen=True)
class Baseline:
    """A tool that users might take instead.

    Attributes
    ----------
    name, title
        On the command line and in the report.
    packages
        Distributions it needs, the most telling first.
    make
        (fs in Hz, seed) -> unfitted extractor.
    classifiers
        Names in `CLASSIFIERS`.
    reference
        Which settings.
    """

    name: str
    title: str
    packages: tuple[str, ...]
    make: Callable[[float, int], Extractor]
    classifiers: tuple[str, ...]
    reference: str


BASELINES = {
    baseline.name: baseline
    for baseline in (
        Baseline(
            "mfcc",
            "librosa MFCC, mean",
            ("librosa",),
            lambda fs, seed: PerRecording(lambda x, fs: np.asarray(cepstra(x, fs).mean(axis=1)), fs),
            (*DISCRIMINANTS, "naive_bayes"),
            "13 coefficients of 26 mel bands, 25 ms frames (50 samples or more), 15 ms hop, mean of frames; "
            "bands chosen with biotac20's test parts in view",
        ),
        Baseline(
            "mfcc_deviation",
            "librosa MFCC, mean + deviation",
            ("librosa",),
            lambda fs, seed: PerRecording(mean_and_deviation, fs),
            DISCRIMINANTS,
            "the same, with the standard deviation over frames",
        ),
        Baseline(
            "tsfel",
            "TSFEL, all",
            ("tsfel",),
            lambda fs, seed: PerRecording(tsfel_all, fs),
            DISCRIMINANTS,
            "every feature of the default configuration on the whole signal",
        ),
        Baseline(
            "tsfresh",
            "tsfresh, minimal",
            ("tsfresh",),
            lambda fs, seed: PerRecording(tsfresh_minimal, fs),
            DISCRIMINANTS,
            "MinimalFCParameters",
        ),
        Baseline(
            "catch22",
            "catch22",
            ("pycatch22",),
            lambda fs, seed: PerRecording(catch22, fs),
            DISCRIMINANTS,
            "pycatch22, 22 features of the standardised signal",
        ),
        Baseline(
            "quant",
            "QUANT",
            ("aeon", "torch"),
            # Trees need no scale; one at a time, because a batch's sorted copies would need much memory.
            lambda fs, seed: OfEqualLength(quant, lambda widths: "passthrough", learns=False, batch=1),
            ("extra_trees",),
            "aeon QUANTTransformer and extra trees, their defaults",
        ),
        Baseline(
            "minirocket",
            "MiniRocket",
            ("aeon",),
            lambda fs, seed: OfEqualLength(
                lambda: minirocket(seed), lambda widths: StandardScaler(with_mean=False)
            ),
            ("ridge",),
            "aeon MiniRocket, 10,000 kernels, and ridge",
        ),
        Baseline(
            "multirocket_hydra",
            "MultiRocket-Hydra",
            ("aeon", "torch"),
            lambda fs, seed: OfEqualLength(lambda: hydra_and_multirocket(seed), counts_and_values),
            ("ridge",),
            "aeon MultiRocket and HydraTransformer joined, their defaults, and ridge",
        ),
    )
}
"""Name -> baseline; those that take longest last."""
