"""How recordings are held out of a training, and what those can tell of recordings to come, and cannot."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from texclass.evaluation.protocols import Protocol, fewest, find_protocol, splits_of
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import parents
from texclass.recognition.unknown import cautious, check_false_alarms, least_held_out
from texclass.reporting.wording import counted

FALSE_ALARMS = 0.05
ENOUGH_REPETITIONS = 20
"""Of each surface: half of them, ten, still train, as where the drift of `biotac20` was measured."""
FEW = 10
"""Recordings (or runs) of each surface below which nothing is chosen, and margins are wider."""
LATER_KEPT = 0.45
"""Of what an accuracy is above chance, the least that later recordings kept in the study `few_recordings`."""
LATER_ALARMS = 3.0
"""How many times as often later recordings are called unknown there as those held out between, the median."""
AT_RANDOM, IN_TIME = "recording", "chronological"
LATER = "later recordings"
"""What the tests cannot tell of, where this begins the list."""


def holding_out(
    asked: str | None, own: str, table: pd.DataFrame, false_alarms: float
) -> tuple[Protocol, str]:
    """Return how the recordings of a table are held out for choice, probabilities and threshold, and why so.

    A pipeline that draws recordings at random gives way to blocks in time where repetitions are numbered and
    many: a recogniser meets a sensor that is older than in its training, of which folds at random know
    nothing.

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
        return find_protocol(asked), "asked for"
    recordings = table[~parents(table).duplicated()]
    counts = recordings["surface"].value_counts()
    n_held_out = int((counts - counts // 2).sum())
    # One sequence in time, unless repetitions follow the people, not a clock.
    is_sequence = (
        table["repetition"].notna().all()
        and not recordings.duplicated(["surface", "repetition"]).any()
        and len(recordings["operator"].unique()) == 1
    )
    is_enough = counts.min() >= ENOUGH_REPETITIONS and n_held_out >= least_held_out(false_alarms)
    if own == AT_RANDOM and is_sequence and is_enough:
        why = f"{counts.min()} numbered repetitions of each surface or more: the sensor may drift"
        return find_protocol(IN_TIME), why
    return find_protocol(own), "the pipeline's"


def of_succession(share: float, n: int) -> float:
    """Return the share of hits to expect after n tests, (n share + 1) / (n + 2): the rule of succession.

    Of few tests all may be right by luck; a share of 1 would promise that none will ever be wrong (Laplace).
    """
    return (n * share + 1) / (n + 2)


def of_later(held_out: Mapping[str, float], n_classes: int) -> dict[str, float]:
    """Return between which accuracies later recordings may lie, by what became of others: `low` and `high`.

    Recordings that are made in one go are like each other: some data sets kept all of an accuracy that such
    recordings had promised, some `LATER_KEPT` of what it was above chance. Which kind a new one is, it does
    not say itself, so the upper limit is that of the interval, and the lower one is so much nearer to chance.
    """
    chance = 1 / n_classes
    low = chance + LATER_KEPT * (held_out["low"] - chance)
    return {"low": min(low, held_out["low"]), "high": held_out["high"]}


@dataclass(frozen=True, eq=False)
class HoldingOut:
    """How the recordings of a table are held out, so that they can test what others train.

    Attributes
    ----------
    table : DataFrame
        Metadata of recordings, or of windows of them.
    protocol, why
        As `holding_out` returns them.
    asked : bool
        Whether somebody asked for this protocol.
    seed : int
        Of the folds.
    """

    table: pd.DataFrame
    protocol: Protocol
    why: str
    asked: bool
    seed: int

    @cached_property
    def splits(self) -> tuple[Split, ...]:
        """Rows that train and rows that test: none where one recording of a surface is all, unless asked."""
        able = self.asked or self.n_each > 1
        return splits_of(self.protocol, self.table, self.seed) if able else ()

    @cached_property
    def n_each(self) -> int:
        """Recordings (or runs) of the surface that has fewest."""
        return fewest(self.protocol, self.table)

    @property
    def few(self) -> str:
        """How few recordings (or runs) of a surface there are, in words; nothing for `FEW` and more."""
        return f"{counted(self.n_each, self.protocol.unit)} of a surface" if self.n_each < FEW else ""

    @cached_property
    def untold(self) -> list[str]:
        """What the tests cannot tell of recordings to come, likeliest first.

        Recordings that are drawn at random were made between those that train, by the same hand in the same
        session: what changes later, or elsewhere, is in none of them.
        """
        table = self.table
        parts = [(table.iloc[train], table.iloc[test]) for train, test in self.splits]
        if not self.splits:
            return ["accuracy on other recordings (1 per surface: none could be held out)"]
        found, names = [], ("session", "operator")
        after = [
            test.groupby("surface")["repetition"].min() > learnt.groupby("surface")["repetition"].max()
            for learnt, test in parts
        ]
        if table["repetition"].isna().any() or not all(later.all() for later in after):
            n = int(table[~parents(table).duplicated()]["surface"].value_counts().min())
            found.append(
                f"{LATER} ({n} of each surface, held out at random; from {ENOUGH_REPETITIONS} numbered "
                f"repetitions on, or with `--protocol {IN_TIME}`, the later half is held out)"
            )
        if others := [
            name
            for name in names
            if table[name].isna().any() or any(set(test[name]) & set(learnt[name]) for learnt, test in parts)
        ]:
            found.append(f"another {' or '.join(others)} (`--leave-out {others[0]}`, if the card names it)")
        return found

    @property
    def in_one_go(self) -> bool:
        """Whether they are recordings drawn at random of some that time orders."""
        return self.protocol.name == AT_RANDOM and any(fact.startswith(LATER) for fact in self.untold)

    def check_vouched_for(self, false_alarms: float) -> None:
        """Refuse a rate smaller than the default, asked for, that too few held-out recordings vouch for."""
        least_held_out(false_alarms)  # a rate at all
        if self.splits and false_alarms < FALSE_ALARMS:
            check_false_alarms(false_alarms, sum(len(test) for _, test in self.splits))

    def level(self, false_alarms: float, n_held_out: int) -> float:
        """Return the rate of false alarms that is asked of so many held-out recordings."""
        if self.n_each >= (ENOUGH_REPETITIONS if self.in_one_go else FEW):
            return false_alarms
        return cautious(false_alarms, n_held_out, LATER_ALARMS if self.in_one_go else 1.0)

    def promised(self, expected: Mapping[str, Any], n_recordings: int, n_classes: int) -> dict[str, Any]:
        """Return what a manifest promises: the accuracy that is expected of the choice, and by which tests.

        Parameters
        ----------
        expected : mapping
            mean, low, high, n_tested of the choice, unless nothing was held out; n_candidates.
        n_recordings : int
            Recordings (or runs) that were held out: of few, one more counts as right, and one as wrong.
        n_classes : int
            Surfaces.
        """
        chosen = ", selection of the pipeline included" * (expected["n_candidates"] > 1)
        so_few = " (few: one correct and one wrong answer are added)" * bool(self.few)
        found = {
            "protocol": self.protocol.name,
            "why": self.why if self.splits else f"1 {self.protocol.unit} of a surface",
            "n_folds": len(self.splits),
            "untold": self.untold,
            **expected,
            "how": f"held-out {'windows' if 'parent' in self.table else 'recordings'}{chosen}{so_few}",
        }
        if self.few and self.splits:
            found["mean"] = of_succession(expected["mean"], n_recordings)
        if self.in_one_go:
            found["later"] = of_later(expected, n_classes)
        return found
