"""Evaluation protocols: which recordings train and which test; windows of one recording are never parted."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.model_selection import LeaveOneGroupOut, StratifiedKFold

Indices = NDArray[np.intp]
Split = tuple[Indices, Indices]


@dataclass(frozen=True)
class Protocol:
    """A named way to evaluate.

    Attributes
    ----------
    name
        As given on the command line.
    description
        One line for the report.
    split
        (table, n_folds, seed) -> (train, test) row numbers for each fold.
    nested
        Whether scaling and selection are fitted inside each fold. Only `paper` is not.
    """

    name: str
    description: str
    split: Callable[[pd.DataFrame, int, int], tuple[Split, ...]]
    nested: bool = True


def stratified(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Split recordings into folds with equal shares of each material.

    Raises
    ------
    ValueError
        If a material has fewer recordings than there are folds, or there is one material.
    """
    counts = _counts(table)
    if counts.min() < n_folds:
        raise ValueError(
            f"material {counts.idxmin()} has {counts.min()} recording{'s' if counts.min() > 1 else ''}; "
            f"{n_folds} folds need at least {n_folds} of each"
        )
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed)
    return tuple(folds.split(table, table["material"]))


def leave_operator_out(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Test on each operator in turn (each session, if the table names sessions and no operators).

    Raises
    ------
    ValueError
        If there are not two groups, or a material would be tested without having been trained.
    """
    _counts(table)
    group = _grouping(table)
    split = tuple(LeaveOneGroupOut().split(table, groups=table[group]))
    for train, test in split:
        _require_known(table, train, test, f"without {group} {table[group].iloc[test[0]]}")
    return split


def first_half_trains(table: pd.DataFrame, n_folds: int, seed: int) -> tuple[Split, ...]:
    """Train on the first half of each material's repetitions, test on the second (the larger, if odd).

    Raises
    ------
    ValueError
        If repetitions are not numbered, or a material has only one recording.
    """
    counts = _counts(table)
    if table["repetition"].isna().any():
        without = table.loc[table["repetition"].isna(), "recording_id"].iloc[0]
        raise ValueError(
            f"recording {without} has no repetition number; the protocol `blocks` needs it on each"
        )
    if counts.min() < 2:
        raise ValueError(f"material {counts.idxmin()} has 1 recording; the protocol `blocks` needs 2 of each")
    rank = table.groupby("material")["repetition"].rank(method="first").to_numpy()
    half = table["material"].map(counts // 2).to_numpy()
    return ((np.flatnonzero(rank <= half), np.flatnonzero(rank > half)),)


PROTOCOLS = {
    p.name: p
    for p in (
        Protocol(
            "recording",
            "stratified folds over recordings; scaling and selection fitted inside each fold",
            stratified,
        ),
        Protocol(
            "operator",
            "leave one operator (or session) out; scaling and selection fitted inside each fold",
            leave_operator_out,
        ),
        Protocol(
            "blocks",
            "first half of each material's repetitions trains, second half tests",
            first_half_trains,
        ),
        Protocol(
            "paper",
            "stratified folds as in `recording`, but scaling and selection are fitted once on ALL "
            "recordings, test folds included: optimistic, for comparison with the paper only",
            stratified,
            nested=False,
        ),
    )
}


def find_protocol(name: str) -> Protocol:
    """Return the protocol of that name.

    Raises
    ------
    ValueError
        If there is none; the message lists the known names.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"no protocol is named {name!r}; the protocols are {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]


def _counts(table: pd.DataFrame) -> "pd.Series[int]":
    counts = table["material"].value_counts()
    if len(counts) < 2:
        raise ValueError(f"the dataset has {len(counts)} material; classification needs at least 2")
    return counts


def _grouping(table: pd.DataFrame) -> str:
    for group in ("operator", "session"):
        known = table[group].notna().all()
        if known and table[group].nunique() >= 2:
            return group
    n_operators, n_sessions = table["operator"].nunique(), table["session"].nunique()
    raise ValueError(
        f"the dataset names {n_operators} operators and {n_sessions} sessions; the protocol `operator` needs "
        "at least 2 of one of them, named for every recording"
    )


def _require_known(table: pd.DataFrame, train: Indices, test: Indices, how: str) -> None:
    untrained = sorted(set(table["material"].iloc[test]) - set(table["material"].iloc[train]))
    if untrained:
        raise ValueError(
            f"material {untrained[0]} has no recording {how}; "
            "the protocol needs every tested material trained"
        )
