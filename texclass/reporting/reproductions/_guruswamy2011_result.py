"""What the report on `guruswamy2011` is written from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from texclass.textures.guruswamy2011.comparison import PathsResult
from texclass.textures.guruswamy2011.level import LevelLaw
from texclass.textures.guruswamy2011.recorded import Excerpt, HeldOut
from texclass.textures.guruswamy2011.study import ModesRow, PronyRow


@dataclass(frozen=True)
class Study:
    """Everything the report says.

    Attributes
    ----------
    seed, n_trials : int
    scans : dict of str to list of PronyRow
        Five scans of each object, by Prony's method as published.
    modes : dict of str to ModesRow
        The default and the baseline, first scan.
    zero_phase : dict of str to float
        Segments per mm of the first scan with a filter that runs backwards, too.
    orders : list of (str, int, float, float)
        Method, order, outermost pole and error (m/s^2) of figure 4.
    laws : dict of str to (LevelLaw, float)
        Found from forty scans, k_c given, and R^2.
    force_laws : dict of str to LevelLaw
        k_c regressed, too, from scans of widely spread force.
    recovery : dict of str to dict of str to (float, float, int)
        Object, quantity -> median, 95th percentile, number within the bound.
    recovery_loose : the same
        With scans that repeat to 3 % instead of 1 %, ten trials.
    speeds : dict of str to list of (float, float, float, float)
        Speed, GFC, level, level as printed.
    paths : PathsResult
    held_out : list of HeldOut
    excerpts : list of Excerpt
    input_hash : dict of str to str
    versions : dict of str to str
    """

    seed: int
    n_trials: int
    scans: Mapping[str, list[PronyRow]]
    modes: Mapping[str, ModesRow]
    zero_phase: Mapping[str, float]
    orders: list[tuple[str, int, float, float]]
    laws: Mapping[str, tuple[LevelLaw, float]]
    force_laws: Mapping[str, LevelLaw]
    recovery: Mapping[str, Mapping[str, tuple[float, float, int]]]
    recovery_loose: Mapping[str, Mapping[str, tuple[float, float, int]]]
    speeds: Mapping[str, list[tuple[float, float, float, float]]]
    paths: PathsResult
    held_out: list[HeldOut]
    excerpts: list[Excerpt]
    input_hash: Mapping[str, str]
    versions: Mapping[str, str] = field(default_factory=dict)
