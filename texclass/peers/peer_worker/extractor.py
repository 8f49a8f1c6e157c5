"""What every peer looks like to the worker: signals of some recordings in, a table of features out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.impute import SimpleImputer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

Signal = NDArray[np.float64]
"""Shape (n_channels, n_samples)."""
Table = NDArray[np.floating[Any]]
"""Shape (n_recordings, n_columns)."""


class Extractor(Protocol):
    """Turns signals into features."""

    @property
    def learns(self) -> bool:
        """Whether `fit` takes values from its signals; if not, every recording is computed only once."""

    def fit(self, signals: Sequence[Signal]) -> Any:
        """Learn from training signals."""

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the features, one row a recording."""

    def scaler(self) -> Any:
        """Return the unfitted scikit-learn step that comes before the classifier."""


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
    learns: bool = False

    def fit(self, signals: Sequence[Signal]) -> "PerRecording":
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


def common_length(signals: Sequence[Signal]) -> int:
    """Return the median length of the training signals."""
    return int(np.median([signal.shape[1] for signal in signals]))
