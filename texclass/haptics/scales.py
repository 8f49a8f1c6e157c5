"""Define six perceptual scales: the rank of one feature of the feature set `scales` among reference surfaces.

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

Value
-----
Let r_1 <= ... <= r_n be the feature of the n reference surfaces, and R(x) the rank of x among them: the mean
rank of equal values at each r_i, and linear in between (in the logarithm of a frequency). The value is

    v(x) = 10 (R(x) - R(r_1)) / (R(r_n) - R(r_1))    for r_1 <= x <= r_n,

0 below r_1, and 10 above r_n. It is continuous and never falls with x. Outside the range of the reference
surfaces, `Scale.excess` states the distance to it: in dB for levels, and in octaves for frequencies.

Reference surfaces
------------------
By default, the reference surfaces are 100 simulated everyday surfaces, explored freehand with the simulated
tool (`texclass.simulate.surface_catalogue`). Each surface counts with the median of four recordings in m/s^2
(`reference_surfaces.csv`, written by `benchmarks/reference_surfaces.py`). For ridges per mm, only surfaces
with ridges count.

Speed, force and tool change the values. Compare values only for the same tool and similar strokes.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples

if TYPE_CHECKING:
    import pandas as pd

REFERENCES_FILE = Path(__file__).with_name("reference_surfaces.csv")
"""Features of the default reference surfaces, one row per surface."""
FREQUENCY_UNITS = ("Hz", "1/mm")
"""Units of the features that are ranked on a logarithmic axis."""
LEVEL_UNIT = "log10(m/s^2)"
"""Unit of the features that depend on the unit of the recording."""


class Scale(NamedTuple):
    """Perceptual scale from 0 to 10: the rank of one feature among reference surfaces.

    Attributes
    ----------
    low_end : str
        Name of the lower end (0). The upper end (10) has the name of the scale.
    column : str
        Column of the feature in the set `scales`.
    unit : str
        Unit of the feature. If it is log10(m/s^2), the default references apply to recordings in m/s^2 only.

    Examples
    --------
    >>> from texclass.haptics import SCALES
    >>> hard = SCALES["hard"]
    >>> hard.low_end, hard.value(20.0), round(hard.value(150.0), 1), hard.value(2000.0)
    ('soft', 0.0, 5.0, 10.0)
    >>> hard.value(200.0, references=[100.0, 200.0, 200.0, 400.0])
    5.0
    """

    low_end: str
    column: str
    unit: str

    def value(self, feature: float, references: ArrayLike | None = None) -> float:
        """Convert a feature value to a value from 0 to 10.

        Parameters
        ----------
        feature : float
            Feature value; NaN gives NaN.
        references : array_like of shape (n_surfaces,), optional
            Feature of each reference surface, with at least two different values (default: the simulated
            reference surfaces).
        """
        positions, values = self._link(references)
        return float(np.interp(self._positions(feature), positions, values))

    def feature_value(self, value: float) -> float:
        """Convert a value from 0 to 10 to a feature value (inverse of `value`)."""
        positions, values = self._link()
        position = np.interp(value, values, positions)
        return float(np.exp2(position) if self.unit in FREQUENCY_UNITS else position)

    def excess(self, feature: float, references: ArrayLike | None = None) -> float:
        """Return the distance to the range of the references in `excess_unit`, negative below the range.

        Parameters
        ----------
        feature, references
            See `value`.

        Examples
        --------
        >>> from texclass.haptics import SCALES
        >>> SCALES["rough"].excess(1.5, references=[0.0, 1.0]), SCALES["rough"].excess_unit
        (10.0, 'dB')
        >>> SCALES["fine"].excess(25.0, references=[50.0, 100.0]), SCALES["fine"].excess_unit
        (-1.0, 'octaves')
        """
        positions, _ = self._link(references)
        position = self._positions(feature)
        distance = float(position - np.clip(position, positions[0], positions[-1]))
        return 20 * distance if self.unit == LEVEL_UNIT else distance

    @property
    def excess_unit(self) -> str:
        """Unit of `excess`: dB, octaves, or "" for features without a unit."""
        if self.unit in FREQUENCY_UNITS:
            return "octaves"
        return "dB" if self.unit == LEVEL_UNIT else self.unit

    def unlimited_value(self, feature: float) -> float:
        """Return `value`, continued outside the range of the references with its mean slope.

        Unlike `value`, it is strictly monotone, which solvers require.
        """
        positions, values = self._link()
        position = self._positions(feature)
        distance = position - np.clip(position, positions[0], positions[-1])
        inside = np.interp(position, positions, values)
        return float(inside + 10 * distance / (positions[-1] - positions[0]))

    def _positions(self, features: ArrayLike) -> Samples:
        """Return the positions of feature values on the axis on which ranks are interpolated."""
        positions = np.asarray(features, dtype=np.float64)
        if self.unit not in FREQUENCY_UNITS:
            return positions
        with np.errstate(divide="ignore"):  # 0 Hz is below all references
            return np.asarray(np.log2(positions))

    def _link(self, references: ArrayLike | None = None) -> tuple[Samples, Samples]:
        """Return the positions of the references in ascending order, and their values from 0 to 10."""
        if references is None:
            return _default_link(self)
        positions, counts = np.unique(self._positions(references), return_counts=True)
        ranks = np.cumsum(counts) - (counts - 1) / 2  # equal references share their mean rank
        return positions, 10 * (ranks - ranks[0]) / (ranks[-1] - ranks[0])


@cache
def _default_link(scale: Scale) -> tuple[Samples, Samples]:
    """Return the positions and values of the default reference surfaces."""
    return scale._link(reference_surfaces()[scale.column].dropna())


SCALES = {
    "hard": Scale("soft", "damping", "Hz"),
    "rough": Scale("smooth", "vibration_level.rms", LEVEL_UNIT),
    "bumpy": Scale("even", "waviness", LEVEL_UNIT),
    "sticky": Scale("slippery", "friction", ""),
    "fine": Scale("coarse", "grain_frequency", "Hz"),
    "regular": Scale("irregular", "regularity", ""),
}
"""Scales by name."""
SPATIAL_SCALES = {
    "fine": Scale("coarse", "ridge_density", "1/mm"),
    "regular": Scale("irregular", "ridge_prominence", "dB"),
}
"""Scales that replace the scales of the same name in `SCALES` if their feature is defined."""
COLUMNS = tuple(scale.column for scale in (*SCALES.values(), *SPATIAL_SCALES.values()))


@cache
def reference_surfaces() -> "pd.DataFrame":
    """Return the features of the default reference surfaces.

    Returns
    -------
    DataFrame of shape (n_surfaces, n_columns)
        Median feature values of each simulated surface, in the columns of the set `scales`. The ridge columns
        are NaN if ridges are detected in less than half of the recordings of a surface.

    Examples
    --------
    >>> from texclass.haptics import reference_surfaces
    >>> reference_surfaces().loc["foam-04", ["damping", "friction"]].round(2).tolist()
    [76.62, 0.31]
    """
    import pandas as pd

    return pd.read_csv(REFERENCES_FILE, index_col="surface")


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
    """Return the values of recordings on the six scales, among the default reference surfaces.

    Parameters
    ----------
    features : DataFrame of shape (n_recordings, n_columns)
        Result of `texclass.extract(recordings, "scales")` for recordings in m/s^2. The ridge columns are
        optional.

    Returns
    -------
    DataFrame of shape (n_recordings, 6)
        Values from 0 to 10; NaN if the feature is undefined (`hard` requires a tap, `sticky` a friction
        channel).

    Examples
    --------
    >>> import pandas as pd
    >>> columns = [scale.column for scale in SCALES.values()]
    >>> scale_values(pd.DataFrame([[500.0, -0.3, -0.55, 0.75, 20.0, None]], columns=columns)).round(1)
       hard  rough  bumpy  sticky  fine  regular
    0  10.0    0.1    1.3     9.3   0.0      NaN
    """
    import pandas as pd

    measured = features[[column for column in COLUMNS if column in features]].astype(float)
    return pd.DataFrame(
        [
            {name: scale.value(row[scale.column]) for name in SCALES for scale in [select_scale(name, row)]}
            for row in measured.to_dict("records")
        ],
        index=features.index,
        columns=list(SCALES),
    )
