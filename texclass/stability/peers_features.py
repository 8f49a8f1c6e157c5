"""Public libraries of time-series features: their adapters, judged as all our features together are."""

import math
from typing import Any

import numpy as np

from texclass.stability.signals import Case, in_families, lengths
from texclass.stability.subjects_features import cases, extraction
from texclass.stability.verdict import Subject

Named = tuple[dict[str, float], dict[str, str]]


def tsfel() -> list[Subject]:
    """Return all 156 features of TSFEL."""
    import tsfel as library

    configuration = library.get_features_by_domain()

    def extract(x: Any, case: Case) -> Named:
        table = library.time_series_features_extractor(configuration, x, fs=case.fs, verbose=0)
        return {str(name): table[name].iloc[0] for name in table.columns}, {}

    return [extraction("features (all 156)", "tsfel", extract, "peers", given=_thinned)]


def pycatch22() -> list[Subject]:
    """Return catch22, with mean and deviation."""
    import pycatch22 as library

    def extract(x: Any, case: Case) -> Named:
        result = library.catch22_all(x, catch24=True)
        return dict(zip(result["names"], result["values"], strict=True)), {}

    return [extraction("catch24", "pycatch22", extract, "peers")]


def tsfresh() -> list[Subject]:
    """Return tsfresh's efficient set (777 columns), of a quarter of the samples: it takes seconds."""
    import pandas as pd
    from tsfresh.feature_extraction import EfficientFCParameters, extract_features

    settings = EfficientFCParameters()

    def extract(x: Any, case: Case) -> Named:
        n = len(x) if case.family == "length" else min(len(x), 512)
        frame = pd.DataFrame({"id": np.zeros(n, dtype=int), "t": np.arange(n), "x": x[:n]})
        table = extract_features(
            frame,
            column_id="id",
            column_sort="t",
            default_fc_parameters=settings,
            n_jobs=0,
            disable_progressbar=True,
        )
        return {name: _number(table[name].iloc[0]) for name in table.columns}, {}

    return [extraction("features (efficient, 777)", "tsfresh", extract, "peers", given=_few)]


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _thinned(quick: bool) -> list[Case]:
    """Return the battery with every tenth length."""
    if quick:
        return _few(True)
    return [case for i, case in enumerate(cases(False)) if case.family != "length" or i % 10 == 0]


def _few(quick: bool) -> list[Case]:
    """Return the battery with a few lengths; quick: a handful of inputs."""
    families = ("plain", "silent", "broken", "gain")
    if quick:
        return [*in_families(*families, quick=True)[:6]]
    return [case for case in cases(False) if case.family != "length"] + list(lengths(True))
