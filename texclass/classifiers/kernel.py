"""Matern kernel and feature views of the kernel discriminant, without scikit-learn."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples

BATCH = 2048
"""Number of rows of the kernel matrix that are computed at a time, to limit memory use."""


@dataclass(frozen=True, eq=False)
class View:
    """Affine map of features: standardise them, then multiply by weights.

    Attributes
    ----------
    mean, scale : ndarray of shape (n_features,)
        Mean and standard deviation of the training samples; the scale of a constant feature is infinite.
    weights : ndarray of shape (n_features, n_features), or (n_features,) if diagonal
        Weights, normalised so that the root-mean-square norm of the training samples in the view is 1.
    """

    mean: Samples
    scale: Samples
    weights: Samples

    def __call__(self, X: Samples) -> Samples:
        """Return X mapped to this view, shape (n_samples, n_features)."""
        return self.project(self.standardise(X))

    def standardise(self, X: Samples) -> Samples:
        """Return X standardised with the mean and standard deviation of the training samples."""
        return np.asarray((X - self.mean) / self.scale)

    def project(self, Z: Samples) -> Samples:
        """Return standardised samples Z multiplied by the weights."""
        return np.asarray(Z * self.weights if self.weights.ndim == 1 else Z @ self.weights)


def matern32(x1: Samples, x2: Samples, length: float) -> Samples:
    """Return the Matern 3/2 kernel (1 + s) exp(-s), shape (n_1, n_2), with s = sqrt(3) |x1 - x2| / length."""
    squared = x1 @ (-2 * x2.T)
    squared += np.square(x1).sum(axis=1)[:, np.newaxis]
    squared += np.square(x2).sum(axis=1)
    s = np.sqrt(3 * np.maximum(squared, 0)) / length
    return np.asarray((1 + s) * np.exp(-s))


def mean_kernel(projections: Iterable[Samples], prototypes: Sequence[Samples], length: float) -> Samples:
    """Return the kernel between samples and prototypes, averaged over the views, shape (n_1, n_2)."""
    pairs = zip(projections, prototypes, strict=True)
    return np.asarray(sum(matern32(x1, x2, length) for x1, x2 in pairs) / len(prototypes))


def kernel_scores(
    X: Samples, views: Sequence[View], prototypes: Sequence[Samples], dual: Samples, length: float
) -> Samples:
    """Return class scores K @ dual, shape (n_samples, n_classes).

    K is the kernel between the samples X and the prototypes, averaged over the views.
    """
    batches = (X[k : k + BATCH] for k in range(0, max(1, len(X)), BATCH))
    return np.concatenate([mean_kernel((v(b) for v in views), prototypes, length) @ dual for b in batches])
