"""How recordings are held out when nobody says how: at random, or the later ones where a sensor may drift."""

from dataclasses import dataclass

import pandas as pd

from texclass.experiment.protocols import Protocol, find_protocol
from texclass.experiment.windows import parents
from texclass.recognition.unknown import least_held_out

ENOUGH_REPETITIONS = 20
"""Of each material: half of them, ten, still train, as where the drift of `biotac20` was measured."""
AT_RANDOM, IN_TIME = "recording", "blocks"


@dataclass(frozen=True)
class HoldingOut:
    """How recordings are held out for the choice, the probabilities and the threshold, and why so."""

    protocol: Protocol
    why: str

    @property
    def is_in_time(self) -> bool:
        """Whether later recordings are held out: a sensor that drifts is then allowed for."""
        return self.protocol.name == IN_TIME


def holding_out(asked: str | None, own: str, table: pd.DataFrame, false_alarms: float) -> HoldingOut:
    """Return how the recordings of a table are held out.

    A pipeline that draws recordings at random gives way to blocks in time where repetitions are numbered and
    many: a recogniser meets a sensor that is older than in its training. Folds at random promise 5 % false
    alarms and give 16.8 % on later recordings of `biotac20`, blocks 7.7 %.

    Parameters
    ----------
    asked : str or None
        Protocol that the user asked for.
    own : str
        Protocol of the pipeline.
    table : DataFrame
        Metadata of recordings, or of windows of them.
    false_alarms : float
        Share that may be called unknown; it takes a number of held-out recordings.
    """
    if asked is not None:
        return HoldingOut(find_protocol(asked), "asked for")
    if own == AT_RANDOM and (fewest := _in_time(table, false_alarms)):
        why = f"{fewest} numbered repetitions of each surface or more: the sensor may drift"
        return HoldingOut(find_protocol(IN_TIME), why)
    return HoldingOut(find_protocol(own), "the pipeline's")


def _in_time(table: pd.DataFrame, false_alarms: float) -> int:
    """Return how many repetitions each material has at least, if they are one sequence in time; else 0."""
    recordings = table[~parents(table).duplicated()]
    if table["repetition"].isna().any() or recordings.duplicated(["material", "repetition"]).any():
        return 0
    if len(recordings["operator"].unique()) > 1:  # repetitions then follow the people, not a clock
        return 0
    counts = recordings["material"].value_counts()
    n_held_out = int((counts - counts // 2).sum())
    is_enough = counts.min() >= ENOUGH_REPETITIONS and n_held_out >= least_held_out(false_alarms)
    return int(counts.min()) if is_enough else 0
