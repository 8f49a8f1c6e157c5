"""Hold-out protocols of training, and the conditions for which their accuracy is valid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from texclass.evaluation.protocols import Protocol, find_protocol, make_splits, min_per_surface
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import parents
from texclass.recognition.model_files import LATER_RECORDINGS
from texclass.recognition.novelty import check_false_alarms, conservative_rate, min_held_out
from texclass.reporting.wording import counted

DEFAULT_FALSE_ALARMS = 0.05
"""Accepted share of recordings of trained surfaces that are reported as unknown."""
RANDOM_PROTOCOL, RUN_PROTOCOL, CHRONOLOGICAL_PROTOCOL = "recording", "grouped", "chronological"


@dataclass(frozen=True)
class HoldoutLimits:
    """Numbers of recordings that determine the protocol, and the loss to expect for later recordings.

    Attributes
    ----------
    min_repetitions : int
        Minimum number of repetitions per surface for a chronological split, so that at least ten remain for
        training.
    few_recordings : int
        Number of recordings (or runs) per surface below which no candidate is selected by accuracy, and
        thresholds are more conservative.
    later_share : float
        Smallest fraction of the accuracy above chance level that later recordings retained in the study
        `few_recordings`, if recordings were held out at random.
    later_share_of_halves : float
        The same fraction of the accuracy between the earlier and the later half of the training recordings,
        slightly below the smallest mean over models of a dataset in the study `later_recordings`.
    later_alarm_factor : float
        Median ratio of the false alarms of later recordings to those of held-out ones in the study
        `few_recordings`.
    later_shift : float
        Shift of the log odds in prediction sets of models from few recordings without an order in time. In
        the study `later_recordings`, sets with this shift cover later recordings on average over datasets.
    later_coverage : tuple of float
        Lowest and highest coverage of 90 % sets for later recordings, over the datasets in the study
        `later_recordings`, for models from fewer than `few_recordings` recordings.
    """

    min_repetitions: int = 20
    few_recordings: int = 10
    later_share: float = 0.45
    later_share_of_halves: float = 0.65
    later_alarm_factor: float = 3.0
    later_shift: float = 0.5
    later_coverage: tuple[float, float] = (0.77, 0.99)


LIMITS = HoldoutLimits()


def select_protocol(
    protocol_name: str | None, default: str, table: pd.DataFrame, false_alarms: float
) -> tuple[Protocol, str]:
    """Return the protocol by which recordings are held out, and the reason.

    With many numbered repetitions, a chronological split replaces the random folds: a deployed model is used
    with a sensor that has aged since training, and random folds do not reflect this.

    Parameters
    ----------
    protocol_name : str or None
        Protocol that the user requested.
    default : str
        Protocol of the pipeline.
    table : DataFrame
        Metadata of recordings, or of their windows.
    false_alarms : float
        Accepted rate of false alarms, which determines the required number of held-out recordings.

    Returns
    -------
    protocol : Protocol
        Protocol for selection, calibration and threshold.
    reason : str
        Reason, for the model card.
    """
    if not (protocol := find_protocol(protocol_name or default)).separates_recordings:
        raise ValueError(
            f"protocol {protocol.name!r} has windows of one recording in training set and test set, so its "
            "accuracy does not hold for other recordings. Use another protocol, for example 'recording'"
        )
    if protocol_name is not None:
        return protocol, "requested"
    counts = table.loc[~parents(table).duplicated(), "surface"].value_counts()
    n_held_out = int((counts - counts // 2).sum())
    is_enough = counts.min() >= LIMITS.min_repetitions and n_held_out >= min_held_out(false_alarms)
    if default == RANDOM_PROTOCOL and is_sequence(table) and is_enough:
        reason = f"at least {counts.min()} numbered repetitions per surface: the sensor may drift"
        return find_protocol(CHRONOLOGICAL_PROTOCOL), reason
    return protocol, "default of the pipeline"


def is_sequence(table: pd.DataFrame) -> bool:
    """Return whether the repetitions of each surface are in chronological order.

    Repetition numbers are an order in time only if one operator made the repetitions one after the other.

    Parameters
    ----------
    table : DataFrame
        Metadata of recordings, or of their windows.
    """
    recordings = table[~parents(table).duplicated()]
    return bool(
        table["repetition"].notna().all()
        and not recordings.duplicated(["surface", "repetition"]).any()
        and len(recordings["operator"].unique()) == 1
    )


def rule_of_succession(share: float, n: int) -> float:
    """Return Laplace's estimate of the share of hits, (n share + 1) / (n + 2).

    A few predictions may all be correct by chance. The observed share of 1 would imply that errors are
    impossible.

    Parameters
    ----------
    share : float
        Share of hits.
    n : int
        Number of tests.

    Examples
    --------
    >>> rule_of_succession(1.0, 8)
    0.9
    """
    return (n * share + 1) / (n + 2)


def later_accuracy(low: float, high: float, n_classes: int, share: float) -> dict[str, float]:
    """Return the expected range of the accuracy on later recordings, `low` and `high`.

    Recordings of one session resemble each other. In some datasets, later recordings were classified as
    accurately as held-out ones. In others, a part of the accuracy above chance level was lost. The lower
    limit is therefore moved towards the chance level.

    Parameters
    ----------
    low, high : float
        Confidence interval of the accuracy on held-out recordings.
    n_classes : int
        Number of surfaces.
    share : float
        Smallest fraction of the accuracy above chance level that later recordings retain.

    Examples
    --------
    >>> later_accuracy(0.9, 1.0, n_classes=2, share=0.5)
    {'low': 0.7, 'high': 1.0}
    """
    chance = 1 / n_classes
    return {"low": min(low, chance + share * (low - chance)), "high": high}


@dataclass(frozen=True, eq=False)
class Holdout:
    """Protocol by which the recordings of a table are held out, with its folds.

    Attributes
    ----------
    table : DataFrame
        Metadata of recordings, or of their windows.
    protocol : Protocol
        Protocol.
    reason : str
        Reason for the protocol.
    is_requested : bool
        Whether the user requested the protocol.
    seed : int
        Seed of the folds.
    """

    table: pd.DataFrame
    protocol: Protocol
    reason: str
    is_requested: bool
    seed: int

    @cached_property
    def splits(self) -> tuple[Split, ...]:
        """Rows of the training set and the test set of each fold; empty for one recording per surface."""
        can_split = self.is_requested or self.n_per_surface > 1
        return make_splits(self.protocol, self.table, self.seed) if can_split else ()

    @cached_property
    def halves(self) -> tuple[tuple[Split, ...], ...]:
        """Splits that train on the earlier half of the recordings and test on the later half, and vice versa.

        They show how the predictions change with time. Empty if the recordings have no order in time, or
        there is one recording per surface.
        """
        counts = self.table.loc[~parents(self.table).duplicated(), "surface"].value_counts()
        if not self.splits or counts.min() < 2 or not is_sequence(self.table):
            return ()
        forward, backward = (
            find_protocol(CHRONOLOGICAL_PROTOCOL).split(
                self.table.assign(repetition=sign * self.table["repetition"]), 1, self.seed
            )
            for sign in (1, -1)
        )
        return (backward,) if self.protocol.name == CHRONOLOGICAL_PROTOCOL else (forward, backward)

    @cached_property
    def n_per_surface(self) -> int:
        """Number of recordings (or runs) of the rarest surface."""
        return min_per_surface(self.protocol, self.table)

    @property
    def shortage(self) -> str:
        """Number of recordings (or runs) of the rarest surface as text; empty if there are enough."""
        if self.n_per_surface >= LIMITS.few_recordings:
            return ""
        return f"{counted(self.n_per_surface, self.protocol.unit)} of a surface"

    @cached_property
    def not_evaluated(self) -> list[str]:
        """Conditions of use that the test sets do not cover, the most common one first.

        Recordings that are held out at random were made between those of the training set, by the same
        operator in the same session.
        """
        table = self.table
        folds = [(table.iloc[train], table.iloc[test]) for train, test in self.splits]
        if not self.splits:
            return ["accuracy on other recordings (1 per surface: none could be held out)"]
        conditions = []
        is_later = [
            (test.groupby("surface")["repetition"].min() > train.groupby("surface")["repetition"].max()).all()
            for train, test in folds
        ]
        if table["repetition"].isna().any() or not all(is_later):
            n = int(table[~parents(table).duplicated()]["surface"].value_counts().min())
            conditions.append(
                f"{LATER_RECORDINGS} ({n} of each surface, held out at random; from {LIMITS.min_repetitions} "
                f"numbered repetitions on, or with `--protocol {CHRONOLOGICAL_PROTOCOL}`, the later half is "
                "held out)"
            )
        shared = [
            name
            for name in ("session", "operator")
            if table[name].isna().any() or any(set(test[name]) & set(train[name]) for train, test in folds)
        ]
        if shared:
            conditions.append(
                f"another {' or '.join(shared)} (`--leave-out {shared[0]}`, if the card names it)"
            )
        return conditions

    @property
    def is_random_order(self) -> bool:
        """Whether recordings are held out at random although later ones may differ."""
        return (
            bool(self.splits)
            and self.protocol.name in (RANDOM_PROTOCOL, RUN_PROTOCOL)
            and any(condition.startswith(LATER_RECORDINGS) for condition in self.not_evaluated)
        )

    def check_rate(self, false_alarms: float) -> None:
        """Check that there are enough held-out recordings for a rate of false alarms below the default.

        Raises
        ------
        ValueError
            If there are too few, or the rate is not between 0 and 1.
        """
        min_held_out(false_alarms)
        if self.splits and false_alarms < DEFAULT_FALSE_ALARMS:
            check_false_alarms(false_alarms, sum(len(test) for _, test in self.splits))

    def p_threshold(self, false_alarms: float, n_held_out: int) -> float:
        """Return the p-value up to which recordings are unknown; it is lower if few are held out."""
        is_unordered = self.is_random_order and not self.halves
        if self.n_per_surface >= (LIMITS.min_repetitions if is_unordered else LIMITS.few_recordings):
            return false_alarms
        return conservative_rate(false_alarms, n_held_out, LIMITS.later_alarm_factor if is_unordered else 1.0)

    def later_entry(
        self, accuracy: Mapping[str, Any], halves: Sequence[Mapping[str, float]], n_classes: int
    ) -> dict[str, Any]:
        """Return the expected accuracy on later recordings: low, high, source of the range, halves.

        Many numbered repetitions give the range themselves: the accuracies of the protocol, from the earlier
        half to the later half, and back. With fewer repetitions, the lower limit allows for a loss as in
        other datasets.

        Parameters
        ----------
        accuracy : mapping
            Entry `accuracy` of the manifest.
        halves : sequence of mapping
            mean, low and high of the accuracy of each split in `halves`.
        n_classes : int
            Number of surfaces.
        """
        if not (halves or self.is_random_order):
            return {}
        low = min(one["low"] for one in (accuracy, *halves))
        high = max(one["high"] for one in (accuracy, *halves))
        entry = {"halves": [one["mean"] for one in halves]}
        if halves and self.n_per_surface >= LIMITS.min_repetitions:
            return {"low": low, "high": high, "source": "halves", **entry}
        share = LIMITS.later_share_of_halves if halves else LIMITS.later_share
        return {**later_accuracy(low, high, n_classes, share), "source": "other datasets", **entry}

    def accuracy_entry(self, estimate: Mapping[str, Any], n_recordings: int) -> dict[str, Any]:
        """Return the entry `accuracy` of a manifest: expected accuracy, protocol, conditions not covered.

        Parameters
        ----------
        estimate : mapping
            n_candidates and, if recordings were held out, mean, low, high and n_tested of the selected
            candidate.
        n_recordings : int
            Number of held-out recordings (or runs). If there are few, one correct and one wrong answer are
            added.
        """
        selection = ", selection of the pipeline included" * (estimate["n_candidates"] > 1)
        correction = " (few: one correct and one wrong answer are added)" * bool(self.shortage)
        unit = "windows" if "parent" in self.table else "recordings"
        entry = {
            "protocol": self.protocol.name,
            "reason": self.reason if self.splits else f"1 {self.protocol.unit} of a surface",
            "n_folds": len(self.splits),
            "not_evaluated": self.not_evaluated,
            **estimate,
            "description": f"held-out {unit}{selection}{correction}",
        }
        if self.shortage and self.splits:
            entry["mean"] = rule_of_succession(estimate["mean"], n_recordings)
        return entry
