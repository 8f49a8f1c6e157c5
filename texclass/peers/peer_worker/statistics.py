"""Libraries of general features of a time series: TSFEL, tsfresh (minimal), catch22."""

import numpy as np

from .extractor import Signal, Table

TSFEL_LEAST_HZ = 100.0


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
