"""aeon's random convolutional kernels: MiniRocket, and MultiRocket with Hydra."""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.compose import ColumnTransformer
from sklearn.preprocessing import StandardScaler

from .extractor import Signal, Table, common_length, equal_lengths

BATCH = 32
"""Recordings transformed at a time, so that memory does not grow with their number."""


class MiniRocketFeatures:
    """MiniRocket with its default 10,000 kernels; biases come from the training signals."""

    learns = True

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Draw the biases."""
        from aeon.transformations.collection.convolution_based import MiniRocket

        self.n_samples = common_length(signals)
        self.kernels = MiniRocket(random_state=self.seed, n_jobs=1)
        self.kernels.fit(equal_lengths(signals, self.n_samples))
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the shares of positive values."""
        return _in_batches(signals, self.n_samples, self.kernels.transform)

    def scaler(self) -> Any:
        """Return the scaling of aeon's classifier."""
        return StandardScaler(with_mean=False)


class MultiRocketHydraFeatures:
    """MultiRocket with Hydra, as in aeon's `MultiRocketHydraClassifier`; Hydra needs torch."""

    learns = True

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Draw kernels and biases."""
        from aeon.transformations.collection.convolution_based import HydraTransformer, MultiRocket

        self.n_samples = common_length(signals)
        X = equal_lengths(signals, self.n_samples)
        self.hydra = HydraTransformer(random_state=self.seed, n_jobs=1, output_type="numpy").fit(X[:1])
        self.multirocket = MultiRocket(random_state=self.seed, n_jobs=1).fit(X)
        self.n_hydra = self.hydra.transform(X[:1]).shape[1]
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return Hydra's counts, then MultiRocket's pooled values."""
        return _in_batches(signals, self.n_samples, self._both)

    def scaler(self) -> Any:
        """Return the scaling of aeon's classifier."""
        counts = slice(0, self.n_hydra)
        rest = slice(self.n_hydra, None)
        return ColumnTransformer([("hydra", CountScaler(), counts), ("rocket", StandardScaler(), rest)])

    def _both(self, X: NDArray[np.float32]) -> Table:
        parts = (self.hydra.transform(X), self.multirocket.transform(X))
        return np.concatenate([np.asarray(part, dtype=np.float32) for part in parts], axis=1)


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


def _in_batches(signals: Sequence[Signal], n_samples: int, transform: Any) -> Table:
    starts = range(0, len(signals), BATCH)
    parts = (transform(equal_lengths(signals[i : i + BATCH], n_samples)) for i in starts)
    return np.concatenate([np.asarray(part, dtype=np.float32) for part in parts])
