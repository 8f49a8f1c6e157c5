"""Six scales of how a surface feels, each a monotone link to one measured feature of the set `scales`.

| scale | its other end | measured | of the simulated surfaces it follows |
|---|---|---|---|
| hard | soft | spectral centroid of a tap | stiffness of the contact |
| rough | smooth | level of the movement's vibration | heights of structures below 1 mm |
| bumpy | even | waviness: how the level below 100 Hz varies | heights of all structures |
| sticky | slippery | kinetic friction | the same |
| fine | coarse | frequency of the grain | period of ribs, read backwards |
| regular | irregular | rises of the autocorrelation | - |

0 and 10 are where the lowest and the highest twentieth of simulated everyday surfaces begin
(`texclass.simulate.surface_catalogue`), explored freehand with its tool. Values go on beyond them.
Frequencies are compared by their logarithm, and so are levels. What hands do (speed, force) and what tools do
moves them: values of one tool and usual strokes compare.
"""

from typing import TYPE_CHECKING, NamedTuple

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


SCALES = {
    "hard": Scale("soft", "damping", 45.0, 370.0, "Hz"),
    "rough": Scale("smooth", "vibration_level.rms", -0.3, 1.0, "log10(m/s^2)"),
    "bumpy": Scale("even", "waviness", -1.0, -0.1, "log10(m/s^2)"),
    "sticky": Scale("slippery", "friction", 0.25, 0.75, ""),
    "fine": Scale("coarse", "grain_frequency", 36.0, 76.0, "Hz"),
    "regular": Scale("irregular", "regularity", 0.07, 0.18, ""),
}


def scale_values(measured: "pd.DataFrame") -> "pd.DataFrame":
    """Return what the features of the set `scales` say on each scale.

    (m - m_0) / (m_10 - m_0) * 10 with m the feature, or its logarithm where it is a frequency.

    Parameters
    ----------
    measured : DataFrame of shape (n_recordings, n_columns)
        As `texclass.extract(recordings, "scales")` gives it, of recordings in m/s^2.

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

    found = {}
    for name, scale in SCALES.items():
        linked = np.log if scale.unit == "Hz" else np.asarray
        m, low, high = (linked(x) for x in (measured[scale.column].astype(float), scale.at_0, scale.at_10))
        found[name] = 10 * (m - low) / (high - low)
    return pd.DataFrame(found, index=measured.index)
