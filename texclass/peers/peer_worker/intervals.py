"""aeon's QUANT: quantiles over dyadic intervals."""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from .extractor import Signal, Table, common_length, equal_lengths


class QuantFeatures:
    """QUANT with its defaults (depth 6, every fourth quantile); needs torch.

    It takes nothing but the common length from the signals it is fitted on.
    """

    learns = False

    def fit(self, signals: Sequence[Signal]) -> Self:
        """Lay out the intervals for the median length."""
        from aeon.transformations.collection.interval_based import QUANTTransformer

        self.n_samples = common_length(signals)
        self.quantiles = QUANTTransformer().fit(equal_lengths(signals[:1], self.n_samples))
        return self

    def transform(self, signals: Sequence[Signal]) -> Table:
        """Return the quantiles, one recording at a time: a batch's sorted copies would need much memory."""
        rows = (self.quantiles.transform(equal_lengths([signal], self.n_samples)) for signal in signals)
        return np.concatenate([np.asarray(row, dtype=np.float32) for row in rows])

    def scaler(self) -> Any:
        """Return nothing to do: trees need no scale."""
        return "passthrough"
