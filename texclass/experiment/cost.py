"""What features cost: milliseconds per recording, measured, with shared transforms counted once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from texclass.features.extractor import Plan
from texclass.features.sets import FeatureSet
from texclass.features.views import Channels, channels_apart
from texclass.loaders.dataset import Dataset
from texclass.phases import segment
from texclass.recording import Recording


@dataclass(frozen=True)
class CostMeter:
    """Measures feature sets on a few recordings whose phases are known already.

    Attributes
    ----------
    recordings
        The recordings.
    channels
        Channels kept apart; see `FeatureExtractor`.
    """

    recordings: tuple[Recording, ...]
    channels: tuple[str, ...] = ()

    @classmethod
    def on(cls, dataset: Dataset, usable: Sequence[str], channels: Channels, n: int = 3) -> "CostMeter":
        """Take up to `n` usable recordings spread over a dataset."""
        wanted = {usable[i] for i in np.linspace(0, len(usable) - 1, min(n, len(usable))).astype(int)}
        loaded = [dataset.load(entry) for entry in dataset.entries if entry.recording_id in wanted]
        recordings = tuple(r.with_(phases=segment(r)) for r in loaded)
        return cls(recordings, channels_apart(recordings[0], channels))

    def milliseconds(self, feature_set: FeatureSet, n_repeats: int = 3) -> float:
        """Return the median over recordings of the best of a few runs; each run begins with fresh views.

        Segmentation is not included, being the same for every set; combining the axes is.
        """
        plan = Plan.of(feature_set, self.channels)
        with threadpool_limits(1):
            best = [min(plan.compute(r).ms for _ in range(n_repeats)) for r in self.recordings]
        return float(np.median(best))
