"""The toy dataset, feature set and pipeline."""

from toy_noises import feature_set, own_cache, pipeline, toy_dataset

__all__ = ["feature_set", "own_cache", "pipeline", "toy_dataset"]
