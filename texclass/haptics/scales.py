"""Six scales of how a surface feels, each a monotone link to one measured feature of the set `scales`.

| scale | its other end | measured | of the simulated surfaces it follows |
|---|---|---|---|
| hard | soft | spectral centroid of a tap | stiffness of the contact |
| rough | smooth | level of the movement's vibration | heights of structures below 1 mm |
| bumpy | even | waviness: how the level below 100 Hz varies | heights of all structures |
| sticky | slippery | kinetic friction | the same |
| fine | coarse | ribs per mm; without: frequency of the grain | period of ribs, read backwards |
| regular | irregular | how far ribs stand out; without: rises of the autocorrelation | that there are ribs |

Ribs are looked for along the way of the tool: that needs its recorded speed. Without a speed, on a way that
is too short, and for `fine` where no ribs stand out, the scale is linked to what is felt over time, which
ranks surfaces less well (`reports/studies/scales`).

0 and 10 are where the lowest and the highest twentieth of simulated everyday surfaces begin
(`texclass.simulate.surface_catalogue`), explored freehand with its tool; of ribs per mm, those with ribs.
Values go on beyond them.
Frequencies are compared by their logarithm, and so are levels. What hands do (speed, force) and what tools do
moves them: values of one tool and usual strokes compare.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd


class Scale(NamedTuple):
    """A scale, from what it is at 0 to what it is at 10.

    Attributes
    ----------
    other_end : str
        Its name is that of 10.
    column : str
        Of the set `scales`.
    at_0, at_10 : float
        The feature there.
    unit : str
        Of the feature. Where it is log10(m/s^2), 0 and 10 are for recordings in m/s^2.
    """

    other_end: str
    column: str
    at_0: float
    at_10: float
    unit: str

    def told(self, m: float) -> float:
        """Return what a value of the feature says on the scale."""
        if self.unit in ("Hz", "1/mm"):
            return float(10 * np.log(m / self.at_0) / np.log(self.at_10 / self.at_0))
        return 10 * (m - self.at_0) / (self.at_10 - self.at_0)

    def measured(self, told: float) -> float:
        """Return the value of the feature at a place of the scale."""
        if self.unit in ("Hz", "1/mm"):
            return float(self.at_0 * (self.at_10 / self.at_0) ** (told / 10))
        return self.at_0 + (self.at_10 - self.at_0) * told / 10


SCALES = {
    "hard": Scale("soft", "damping", 45.0, 370.0, "Hz"),
    "rough": Scale("smooth", "vibration_level.rms", -0.3, 1.0, "log10(m/s^2)"),
    "bumpy": Scale("even", "waviness", -1.0, -0.1, "log10(m/s^2)"),
    "sticky": Scale("slippery", "friction", 0.25, 0.75, ""),
    "fine": Scale("coarse", "grain_frequency", 36.0, 76.0, "Hz"),
    "regular": Scale("irregular", "regularity", 0.07, 0.18, ""),
}

OVER_THE_WAY = {
    "fine": Scale("coarse", "ridge_density", 0.2, 1.45, "1/mm"),
    "regular": Scale("irregular", "ridge_prominence", 2.2, 9.0, "dB"),
}
"""Links that hold instead where their feature is defined."""
COLUMNS = tuple(scale.column for scale in (*SCALES.values(), *OVER_THE_WAY.values()))


def link_of(name: str, measured: Mapping[Any, Any]) -> Scale:
    """Return the link by which a scale is told of one recording.

    Parameters
    ----------
    name : str
        Of the scale.
    measured : mapping of str to float
        Column of the set `scales` -> value, NaN where it is undefined.
    """
    by_way = OVER_THE_WAY.get(name)
    return by_way if by_way and np.isfinite(measured.get(by_way.column, np.nan)) else SCALES[name]


def scale_values(measured: "pd.DataFrame") -> "pd.DataFrame":
    """Return what the features of the set `scales` say on each scale.

    (m - m_0) / (m_10 - m_0) * 10 with m the feature of `link_of`, or its logarithm where it is a frequency.

    Parameters
    ----------
    measured : DataFrame of shape (n_recordings, n_columns)
        As `texclass.extract(recordings, "scales")` gives it, of recordings in m/s^2; columns of ribs may be
        missing.

    Returns
    -------
    DataFrame of shape (n_recordings, 6)
        NaN where the feature is undefined: without a tap `hard`, without friction `sticky`.

    Examples
    --------
    >>> import pandas as pd
    >>> columns = [scale.column for scale in SCALES.values()]
    >>> scale_values(pd.DataFrame([[370.0, -0.3, -0.55, 0.75, 36.0, None]], columns=columns)).round(1)
       hard  rough  bumpy  sticky  fine  regular
    0  10.0    0.0    5.0    10.0   0.0      NaN
    """
    import pandas as pd

    def told(scale: Scale) -> "pd.Series[float]":
        return measured[scale.column].astype(float).map(scale.told)

    found = pd.DataFrame({name: told(scale) for name, scale in SCALES.items()}, index=measured.index)
    for name, scale in OVER_THE_WAY.items():
        if scale.column in measured:
            found[name] = told(scale).fillna(found[name])
    return found
