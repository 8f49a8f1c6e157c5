"""How recordings are split to choose among candidates: tests stay unseen, no material goes short."""

import pandas as pd

from texclass.experiment.protocols import Protocol, Split, runs
from texclass.experiment.windows import parents

N_FOLDS = 5
"""Folds of a protocol that draws them; fewer where a material has fewer recordings (or runs)."""


def splits_of(protocol: Protocol, table: pd.DataFrame, seed: int) -> tuple[Split, ...]:
    """Return how a protocol holds the rows of a table out.

    Raises
    ------
    ValueError
        If it cannot, or lets test recordings be seen.
    """
    require_unseen(protocol)
    return protocol.split(table, max(2, min(N_FOLDS, fewest(protocol, table))), seed)


def require_unseen(protocol: Protocol) -> None:
    """Refuse a protocol that fits scaling and selection on its test recordings, too."""
    if not protocol.nested:
        raise ValueError(f"protocol is {protocol.name!r}; the rule is one whose test recordings stay unseen")


def fewest(protocol: Protocol, table: pd.DataFrame) -> int:
    """Return the number of recordings (or runs, as the protocol counts) of the material that has fewest."""
    unit = runs(table) if protocol.unit == "run" else parents(table)
    return int(unit.groupby(table["material"]).nunique().min())
