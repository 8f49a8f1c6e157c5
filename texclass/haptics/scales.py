"""Define six perceptual scales, each a monotonic function of one feature of the feature set `scales`.

| scale | low end | feature | related property of simulated surfaces |
|---|---|---|---|
| hard | soft | spectral centroid of a tap | stiffness of the contact |
| rough | smooth | vibration level of the movement | height of structures below 1 mm |
| bumpy | even | waviness: variation of the level below 100 Hz | height of all structures |
| sticky | slippery | kinetic friction | kinetic friction |
| fine | coarse | ridges per mm; otherwise frequency of the grain | period of the ridges, inverted |
| regular | irregular | prominence of the ridges; otherwise of the autocorrelation | presence of ridges |

Ridges are detected over the position of the tool, which requires its recorded speed. If the speed is not
recorded or the movement is too short, and for `fine` on surfaces without ridges, the scale uses a feature
computed over time instead of position. This feature ranks surfaces less well (`reports/studies/scales`).

The values 0 and 10 are the 5th and 95th percentiles over simulated everyday surfaces
(`texclass.simulate.surface_catalogue`), explored freehand with the simulated tool. For ridges per mm, only
surfaces with ridges count. Values below 0 and above 10 are possible. Frequencies and levels are
logarithmic.

Speed, force and tool change the values. Compare values only for the same tool and similar strokes.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd


class Scale(NamedTuple):
    """Perceptual scale from 0 to 10, as a function of one feature.

    Attributes
    ----------
    low_end : str
        Name of the lower end (0). The upper end (10) has the name of the scale.
    column : str
        Column of the feature in the set `scales`.
    at_0, at_10 : float
        Feature values that correspond to 0 and 10.
    unit : str
        Unit of the feature. If it is log10(m/s^2), `at_0` and `at_10` apply to recordings in m/s^2 only.

    Examples
    --------
    >>> from texclass.haptics import SCALES
    >>> SCALES["hard"].low_end, SCALES["hard"].value(370.0), SCALES["hard"].feature_value(0.0)
    ('soft', 10.0, 45.0)
    """

    low_end: str
    column: str
    at_0: float
    at_10: float
    unit: str

    def value(self, feature: float) -> float:
        """Convert a feature value to a value on the scale."""
        if self.unit in ("Hz", "1/mm"):
            return float(10 * np.log(feature / self.at_0) / np.log(self.at_10 / self.at_0))
        return 10 * (feature - self.at_0) / (self.at_10 - self.at_0)

    def feature_value(self, value: float) -> float:
        """Convert a value on the scale to a feature value (inverse of `value`)."""
        if self.unit in ("Hz", "1/mm"):
            return float(self.at_0 * (self.at_10 / self.at_0) ** (value / 10))
        return self.at_0 + (self.at_10 - self.at_0) * value / 10


SCALES = {
    "hard": Scale("soft", "damping", 45.0, 370.0, "Hz"),
    "rough": Scale("smooth", "vibration_level.rms", -0.3, 1.0, "log10(m/s^2)"),
    "bumpy": Scale("even", "waviness", -1.0, -0.1, "log10(m/s^2)"),
    "sticky": Scale("slippery", "friction", 0.25, 0.75, ""),
    "fine": Scale("coarse", "grain_frequency", 36.0, 76.0, "Hz"),
    "regular": Scale("irregular", "regularity", 0.07, 0.18, ""),
}
"""Scales by name."""
SPATIAL_SCALES = {
    "fine": Scale("coarse", "ridge_density", 0.2, 1.45, "1/mm"),
    "regular": Scale("irregular", "ridge_prominence", 2.2, 9.0, "dB"),
}
"""Scales that replace the scales of the same name in `SCALES` if their feature is defined."""
COLUMNS = tuple(scale.column for scale in (*SCALES.values(), *SPATIAL_SCALES.values()))


def select_scale(name: str, features: Mapping[Any, Any]) -> Scale:
    """Select the scale for one recording: the spatial scale if its feature is defined, else the default.

    Parameters
    ----------
    name : str
        Name of the scale.
    features : mapping of str to float
        Column of the feature set `scales` -> value; NaN if the feature is undefined.

    Returns
    -------
    Scale
        Scale from `SPATIAL_SCALES` or `SCALES`.

    Examples
    --------
    >>> from texclass.haptics import select_scale
    >>> select_scale("fine", {"ridge_density": 0.6}).unit, select_scale("fine", {}).unit
    ('1/mm', 'Hz')
    """
    spatial = SPATIAL_SCALES.get(name)
    return spatial if spatial and np.isfinite(features.get(spatial.column, np.nan)) else SCALES[name]


def scale_values(features: "pd.DataFrame") -> "pd.DataFrame":
    """Return the values of recordings on the six scales.

    The value is 10 (m - m_0) / (m_10 - m_0), where m is the feature of `select_scale`, or its logarithm if
    the feature is a frequency.

    Parameters
    ----------
    features : DataFrame of shape (n_recordings, n_columns)
        Result of `texclass.extract(recordings, "scales")` for recordings in m/s^2. The ridge columns are
        optional.

    Returns
    -------
    DataFrame of shape (n_recordings, 6)
        Values; NaN if the feature is undefined (`hard` requires a tap, `sticky` a friction channel).

    Examples
    --------
    >>> import pandas as pd
    >>> columns = [scale.column for scale in SCALES.values()]
    >>> scale_values(pd.DataFrame([[370.0, -0.3, -0.55, 0.75, 36.0, None]], columns=columns)).round(1)
       hard  rough  bumpy  sticky  fine  regular
    0  10.0    0.0    5.0    10.0   0.0      NaN
    """
    import pandas as pd

    def values_of(scale: Scale) -> "pd.Series[float]":
        return features[scale.column].astype(float).map(scale.value)

    values = pd.DataFrame({name: values_of(scale) for name, scale in SCALES.items()}, index=features.index)
    for name, scale in SPATIAL_SCALES.items():
        if scale.column in features:
            values[name] = values_of(scale).fillna(values[name])
    return values
