"""Definitions of the baselines: feature extractors of other libraries, and the classifiers used with each.

A baseline converts signals to a table of features. Its packages are imported only when it runs.
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
"""Samples of a recording, shape (n_channels, n_samples)."""
Table = NDArray[np.floating[Any]]
"""Features, shape (n_recordings, n_columns)."""
FRAME_S, HOP, MIN_FRAME = 0.025, 0.6, 50
"""Frames of the cepstra: length in s, hop as a fraction of the length, and smallest length in samples."""
N_COEFFICIENTS, N_MELS = 13, 26
"""Numbers of coefficients and mel bands. They are the best of six settings on the TEST sets of biotac20
(chronological and few-shot), so the results of this baseline on biotac20 are optimistic."""
N_BANDS = 24
"""Number of bands of the band energies."""
TSFEL_MIN_HZ = 100.0
"""Smallest sampling rate in Hz passed to TSFEL; see `tsfel_all`."""
BATCH = 32
"""Number of recordings that aeon transforms at a time. It limits the memory."""
CLASSIFIERS: dict[str, Callable[[int], Any]] = {
    "lda": lambda seed: LinearDiscriminantAnalysis(),
    "shrinkage_lda": lambda seed: LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
    "naive_bayes": lambda seed: GaussianNB(),
    "random_forest": lambda seed: RandomForestClassifier(200, random_state=seed),
    "random_forest_third": lambda seed: RandomForestClassifier(200, max_features=1 / 3, random_state=seed),
    "ridge": lambda seed: RidgeClassifierCV(alphas=np.logspace(-3, 3, 10)),
    "extra_trees": lambda seed: ExtraTreesClassifier(
        200, max_features=0.1, criterion="entropy", random_state=seed
    ),
}
"""Functions from a seed to an unfitted classifier, by name. Ridge and extra trees have aeon's settings."""
DISCRIMINANTS = ("lda", "shrinkage_lda", "random_forest")


@dataclass(frozen=True)
class PerRecording:
    """Extractor that computes features from each channel of a recording and concatenates them.

    Parameters
    ----------
    describe : callable
        Function that takes the samples of one channel, shape (n_samples,), and the sampling rate in Hz. It
        returns the feature values, shape (n_columns,).
    fs : float
        Sampling rate in Hz.
    """

    describe: Callable[[Signal, float], Table]
    fs: float
    depends_on_training: ClassVar[bool] = False
    """False, because the features of a recording do not depend on the training set and are computed once."""

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Return the extractor unchanged, because its features do not depend on training signals."""
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the features, with NaN for non-finite values. `scaler` imputes NaN by training medians."""
        table = np.stack(
            [np.concatenate([self.describe(channel, self.fs) for channel in signal]) for signal in signals]
        )
        return np.where(np.isfinite(table), table, np.nan)

    def scaler(self) -> Any:
        """Return unfitted steps for median imputation and standardisation."""
        return make_pipeline(SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler())


class EqualLength:
    """Extractor that concatenates aeon features of signals cut or padded to the median training length.

    Parameters
    ----------
    make : callable
        Function without arguments that returns a list of pairs: an unfitted transformer, and the number of
        training signals on which it is fitted (None: all).
    scale : callable
        Function that takes the number of columns of each transformer and returns the unfitted scaling step
        that precedes the classifier.
    depends_on_training : bool
        Whether the features depend on the training signals, and not only on their length (default True).
    batch : int
        Number of recordings transformed at a time.
    """

    def __init__(
        self,
        make: Callable[[], list[tuple[Any, int | None]]],
        scale: Callable[[list[int]], Any],
        depends_on_training: bool = True,
        batch: int = BATCH,
    ) -> None:
        self.make, self.scale, self.batch = make, scale, batch
        self.depends_on_training = depends_on_training

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Fit each transformer, which draws kernels and biases or defines intervals."""
        self.n_samples = int(np.median([signal.shape[1] for signal in signals]))
        self.transformers = [t.fit(equal_lengths(signals[:n], self.n_samples)) for t, n in self.make()]
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the features of all transformers, concatenated."""
        rows = []
        for i in range(0, len(signals), self.batch):
            X = equal_lengths(signals[i : i + self.batch], self.n_samples)
            parts = [np.asarray(t.transform(X), dtype=np.float32) for t in self.transformers]
            self.widths = [part.shape[1] for part in parts]
            rows.append(np.concatenate(parts, axis=1))
        return np.concatenate(rows)

    def scaler(self) -> Any:
        """Return the unfitted scaling step that aeon's classifier uses for these features."""
        return self.scale(self.widths)


Extractor = PerRecording | EqualLength
"""Conversion of signals to features. `scaler` returns the step between the features and the classifier."""


def equal_lengths(signals: Sequence[Signal], n_samples: int) -> NDArray[np.float32]:
    """Return signals as one array of shape (n_recordings, n_channels, n_samples).

    Longer signals are cut equally at both ends. Shorter signals are padded with zeros, which is the mean of
    the signals.
    """
    array = np.zeros((len(signals), signals[0].shape[0], n_samples), dtype=np.float32)
    for row, signal in zip(array, signals, strict=True):
        start = max(signal.shape[1] - n_samples, 0) // 2
        section = signal[:, start : start + n_samples]
        row[:, : section.shape[1]] = section
    return array


def cepstra(x: Signal, fs: float) -> Table:
    """Return librosa's mel-frequency cepstral coefficients, shape (n_coefficients, n_frames)."""
    import librosa

    frame = max(round(FRAME_S * fs), MIN_FRAME)
    coefficients = librosa.feature.mfcc(
        y=x, sr=fs, n_mfcc=N_COEFFICIENTS, n_mels=N_MELS, n_fft=1 << (frame - 1).bit_length(),
        win_length=frame, hop_length=max(round(HOP * frame), 1),
    )  # fmt: skip
    return np.asarray(coefficients)


def mean_and_deviation(x: Signal, fs: float) -> Table:
    """Return the mean and the standard deviation of each cepstral coefficient over the frames."""
    coefficients = cepstra(x, fs)
    return np.concatenate([coefficients.mean(axis=1), coefficients.std(axis=1)])


def tsfel_all(x: Signal, fs: float) -> Table:
    """Return every feature of TSFEL's default configuration, computed on the whole signal.

    TSFEL names columns after frequencies rounded to 0.01 Hz. At sampling rates below `TSFEL_MIN_HZ`, several
    columns would have the same name. `TSFEL_MIN_HZ` is then used instead, which does not change the order of
    the frequencies.
    """
    import tsfel

    rate = max(fs, TSFEL_MIN_HZ)
    table = tsfel.time_series_features_extractor(tsfel.get_features_by_domain(), x, fs=rate, verbose=0)
    return np.asarray(table.to_numpy(dtype=np.float64)[0])


def tsfresh_minimal(x: Signal, fs: float) -> Table:
    """Return the ten features of tsfresh's `MinimalFCParameters`."""
    import pandas as pd
    from tsfresh.feature_extraction import MinimalFCParameters, extract_features

    table = extract_features(
        pd.DataFrame({"id": 0, "x": x}),
        column_id="id",
        default_fc_parameters=MinimalFCParameters(),
        n_jobs=0,
        disable_progressbar=True,
    )
    return np.asarray(table.to_numpy(dtype=np.float64)[0])


def band_energies(x: Signal, fs: float) -> Table:
    """Return the logarithms of the energies in `N_BANDS` bands, equally spaced in log frequency.

    The bands cover the positive frequencies of a Welch spectrum with segments of at most 1024 samples. A band
    that is narrower than a bin contains the nearest bin.
    """
    from scipy.signal import welch

    f, power = welch(x, fs, nperseg=min(1024, len(x)))
    edges = np.geomspace(f[1], f[-1], N_BANDS + 1)
    first = np.searchsorted(f, edges[:-1])
    stop = np.maximum(np.searchsorted(f, edges[1:], side="right"), first + 1)
    energies = [power[a:b].sum() for a, b in zip(first, stop, strict=True)]
    return np.log(np.maximum(energies, np.finfo(np.float64).tiny))


def catch22(x: Signal, fs: float) -> Table:
    """Return the 22 features of catch22, which standardises the signal first."""
    import pycatch22

    return np.asarray(pycatch22.catch22_all(x)["values"], dtype=np.float64)


def quant() -> list[tuple[Any, int | None]]:
    """Return QUANT (quantiles over dyadic intervals) with its default parameters. It requires torch."""
    from aeon.transformations.collection.interval_based import QUANTTransformer

    return [(QUANTTransformer(), 1)]


def minirocket(seed: int) -> list[tuple[Any, int | None]]:
    """Return MiniRocket with its default 10,000 kernels. Its biases are drawn from the training signals."""
    from aeon.transformations.collection.convolution_based import MiniRocket

    return [(MiniRocket(random_state=seed, n_jobs=1), None)]


def hydra_and_multirocket(seed: int) -> list[tuple[Any, int | None]]:
    """Return Hydra and MultiRocket as in aeon's `MultiRocketHydraClassifier`. Hydra requires torch."""
    from aeon.transformations.collection.convolution_based import HydraTransformer, MultiRocket

    hydra = HydraTransformer(random_state=seed, n_jobs=1, output_type="numpy")
    return [(hydra, 1), (MultiRocket(random_state=seed, n_jobs=1), None)]


def counts_and_values(widths: list[int]) -> Any:
    """Return a transformer that scales the counts of Hydra and the pooled values of MultiRocket."""
    counts, rest = slice(0, widths[0]), slice(widths[0], None)
    return ColumnTransformer([("hydra", CountScaler(), counts), ("rocket", StandardScaler(), rest)])


class CountScaler(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Standardise the square roots of sparse counts, and leave zeros unchanged.

    A count x becomes z = (sqrt(max(x, 0)) - m) [x > 0] / (s + f^4 + 1e-8). Here m and s are the mean and the
    standard deviation of the square roots in the column, and f is the fraction of zeros. Kernels that rarely
    have the largest response get a small weight. The authors of Hydra use the same scaling.
    """

    def fit(self, X: Table, y: Any = None) -> Self:
        """Compute the mean and the scale of each column."""
        root = np.sqrt(np.maximum(X, 0))
        self.mean_ = root.mean(axis=0)
        self.deviation_ = root.std(axis=0, ddof=1) + (root == 0).mean(axis=0) ** 4 + 1e-8
        return self

    def transform(self, X: Table) -> Table:
        """Return the scaled square roots."""
        root = np.sqrt(np.maximum(X, 0))
        return np.asarray((root - self.mean_) * (root != 0) / self.deviation_, dtype=np.float32)


@dataclass(frozen=True)
class Baseline:
    """Feature extractor of another library, used as a baseline.

    Attributes
    ----------
    name, title
        Name on the command line, and title in reports.
    packages
        Names of the required distributions, beginning with the main one.
    make
        Function that takes the sampling rate in Hz and a seed, and returns an unfitted extractor.
    classifiers
        Names in `CLASSIFIERS` of the classifiers used with the baseline.
    reference
        Description of its settings.

    Examples
    --------
    >>> from texclass.baselines import BASELINES
    >>> BASELINES["catch22"].packages
    ('pycatch22',)
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
            "bands selected on the test sets of biotac20 (optimistic there)",
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
            "bands",
            "Band energies, random forest",
            ("scipy",),
            lambda fs, seed: PerRecording(band_energies, fs),
            ("random_forest", "random_forest_third"),
            "logarithms of the energies in 24 bands, equally spaced in log frequency; 200 trees",
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
            # Trees need no scaling. Batches of one, because QUANT sorts copies of the signals.
            lambda fs, seed: EqualLength(
                quant, lambda widths: "passthrough", depends_on_training=False, batch=1
            ),
            ("extra_trees",),
            "aeon QUANTTransformer and extra trees, their defaults",
        ),
        Baseline(
            "minirocket",
            "MiniRocket",
            ("aeon",),
            lambda fs, seed: EqualLength(
                lambda: minirocket(seed), lambda widths: StandardScaler(with_mean=False)
            ),
            ("ridge",),
            "aeon MiniRocket, 10,000 kernels, and ridge",
        ),
        Baseline(
            "multirocket_hydra",
            "MultiRocket-Hydra",
            ("aeon", "torch"),
            lambda fs, seed: EqualLength(lambda: hydra_and_multirocket(seed), counts_and_values),
            ("ridge",),
            "aeon MultiRocket and HydraTransformer joined, their defaults, and ridge",
        ),
    )
}
"""Baselines by name, with the slowest last."""
