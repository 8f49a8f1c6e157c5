"""Functions that split the rows of a feature table into training and test sets by the label columns.

A table has one row per recording or one row per window. Windows of one recording are never divided between
training set and test set, except by `shuffled_windows`.
"""

import functools
import re
import warnings
from collections.abc import Callable, Sequence
from typing import Concatenate, ParamSpec

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.model_selection import LeaveOneGroupOut, StratifiedGroupKFold, StratifiedKFold

from texclass.evaluation.protocols import Terms
from texclass.evaluation.windows import files, is_testable, parents

Indices = NDArray[np.intp]
Split = tuple[Indices, Indices]
"""Row indices of a training set and of its test set."""
Splits = tuple[Split, ...]
P = ParamSpec("P")
_NUMBER = r"\d{1,9}(?:\.\d{1,9})?"
"""Pattern of a limit of a range of label values."""


def runs(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the session of each row as its run, or its whole recording unless there are two sessions."""
    is_named = table["session"].notna().all() and table["session"].nunique() >= 2
    return table["session"].astype(str) if is_named else files(table)


def left_out_label(table: pd.DataFrame, labels: Sequence[str]) -> str:
    """Return the first label that has a value in every row and at least two different values.

    Raises
    ------
    ValueError
        If there is no such label.
    """
    _require_labels(table, labels)
    for label in labels:
        if table[label].notna().all() and table[label].nunique() >= 2:
            return label
    counts = " and ".join(f"{table[label].nunique()} {label}s" for label in labels)
    unnamed = table[list(labels)].isna().all(axis=1).sum()
    raise ValueError(
        f"the dataset has {counts}, and {unnamed} recordings without a label. Leave-one-out needs a label "
        f"({', '.join(labels)}) that has a value for every recording and at least 2 different values"
    )


def label_combinations(table: pd.DataFrame, labels: Sequence[str]) -> "pd.Series[str]":
    """Return the value of a label, or the combination of the values of several labels, in each row.

    Raises
    ------
    ValueError
        If the table has no such label, a recording has no value, or there is only one combination.
    """
    _require_labels(table, labels)
    for label in labels:
        if (unnamed := parents(table)[table[label].isna()].unique()).size:
            raise ValueError(
                f"{unnamed.size} of {parents(table).nunique()} recordings have no {label}, for example "
                f"{unnamed[0]!r}. The protocol `leave-out` needs a value for every recording"
            )
    values = table[list(labels)].astype(str)
    if len(labels) > 1:  # a comma in a value must not look like the comma between two values
        values = values.apply(lambda column: column.str.replace("\\", "\\\\").str.replace(",", "\\,"))
    combinations = values.agg(", ".join, axis=1)
    if combinations.nunique() < 2:
        raise ValueError(
            f"all recordings have the same {' and '.join(labels)}, {combinations.iloc[0]!r}. The protocol "
            "`leave-out` needs at least 2 different values"
        )
    return combinations


def _require_labels(table: pd.DataFrame, labels: Sequence[str]) -> None:
    """Raise ValueError if a table has no column of a label. The message lists the labels with values."""
    identifiers = {"recording_id", "parent", "file_id", "is_train_only"}
    if unknown := [label for label in labels if label not in table or label in identifiers]:
        label_names = [
            str(name)
            for name, column in table.items()
            if name not in identifiers and column.notna().any() and not pd.api.types.is_float_dtype(column)
        ]
        raise ValueError(
            f"no recording has the label {unknown[0]!r}. Expected one of {', '.join(label_names)}"
        )


def split_testable(split: Callable[[pd.DataFrame], Splits], table: pd.DataFrame) -> Splits:
    """Split the testable rows. Then add overlapping windows to the training sets of their recordings.

    If several recordings were cut from one file, those of the test set's files are removed from the training
    set.
    """
    rows, recording = np.flatnonzero(is_testable(table)), parents(table)
    splits = split(table if len(rows) == len(table) else table.iloc[rows].reset_index(drop=True))
    if "file_id" in table:
        file = files(table).to_numpy()[rows]
        splits = tuple((train[~np.isin(file[train], file[test])], test) for train, test in splits)
        for train, test in splits:
            _require_trained(table, (rows[train], rows[test]), "in files outside the test set")
    if len(rows) == len(table):
        return splits
    return tuple(
        (np.flatnonzero(recording.isin(recording.iloc[rows[train]])), rows[test]) for train, test in splits
    )


def of_recordings(
    split: Callable[Concatenate[pd.DataFrame, P], Splits],
) -> Callable[Concatenate[pd.DataFrame, P], Splits]:
    """Extend a function that splits recordings so that it also splits windows, grouped by recording."""

    @functools.wraps(split)
    def of_rows(table: pd.DataFrame, /, *args: P.args, **kwargs: P.kwargs) -> Splits:
        recording_of_row, recording_ids = pd.factorize(parents(table))
        if len(recording_ids) == len(table):
            return split(table, *args, **kwargs)
        _, first = np.unique(recording_of_row, return_index=True)
        recordings = table.iloc[first].assign(recording_id=recording_ids).reset_index(drop=True)
        return tuple(
            (
                np.flatnonzero(np.isin(recording_of_row, train)),
                np.flatnonzero(np.isin(recording_of_row, test)),
            )
            for train, test in split(recordings, *args, **kwargs)
        )

    return of_rows


@of_recordings
def stratified(table: pd.DataFrame, n_folds: int, seed: int) -> Splits:
    """Split recordings into stratified folds, which contain all surfaces in equal proportions.

    Recordings that were cut from one file are in the same fold.

    Raises
    ------
    ValueError
        If a surface has fewer recordings (or files) than folds, or there is only one surface.
    """
    if "file_id" in table:
        return _split_groups(table, table["file_id"], "file", n_folds, seed)
    _require_folds(table["surface"].value_counts(), n_folds)
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed)
    return tuple(folds.split(table, table["surface"]))


def shuffled_windows(table: pd.DataFrame, n_folds: int, seed: int) -> Splits:
    """Split windows into stratified folds, whichever recording they are from.

    Raises
    ------
    ValueError
        If the table contains whole recordings, or a surface has fewer windows than folds.
    """
    if "parent" not in table:
        raise ValueError(
            "the protocol `shuffled-windows` splits windows, but the dataset contains whole recordings. Cut "
            "them into windows: `texclass benchmark --window SECONDS`, in Python `cut_windows`"
        )
    _require_folds(table["surface"].value_counts(), n_folds, "window")
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed)
    return tuple(folds.split(table, table["surface"]))


def grouped(table: pd.DataFrame, n_folds: int, seed: int) -> Splits:
    """Split runs into stratified folds, so that no run is in both training set and test set.

    Raises
    ------
    ValueError
        If a surface has fewer runs than folds, or would be missing from a training set.
    """
    return _split_groups(table, runs(table), "run", n_folds, seed)


def _split_groups(table: pd.DataFrame, group: "pd.Series[str]", unit: str, n_folds: int, seed: int) -> Splits:
    """Split groups of rows into stratified folds; `unit` names a group in messages."""
    _require_folds(group.groupby(table["surface"]).nunique(), n_folds, unit)
    folds = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        # scikit-learn counts rows per surface and warns. `_require_folds` has checked the number of groups.
        warnings.filterwarnings("ignore", message="The least populated class", category=UserWarning)
        splits = tuple(s for s in folds.split(table, table["surface"], group) if s[1].size)
    for number, split in enumerate(splits, start=1):
        _require_trained(table, split, f"outside fold {number}")
    return splits


@of_recordings
def leave_one_out(table: pd.DataFrame, labels: Sequence[str]) -> Splits:
    """Use the recordings with each value of a label once as the test set, and all others for training.

    Several labels define one test set for each combination of their values.

    Raises
    ------
    ValueError
        If a surface of a test set would be missing from the training set, there is only one surface, or the
        labels do not divide the recordings.
    """
    _require_each(table["surface"].value_counts())
    splits = tuple(LeaveOneGroupOut().split(table, groups=label_combinations(table, labels)))
    for train, test in splits:
        left_out = " and ".join(f"{label} {table[label].iloc[test[0]]}" for label in labels)
        _require_trained(table, (train, test), f"without {left_out}")
    return splits


@of_recordings
def chronological(table: pd.DataFrame) -> Splits:
    """Train on the first half of the repetitions of each surface, test on the second half.

    If the number of repetitions is odd, the second half is the larger one.

    Raises
    ------
    ValueError
        If repetitions are not numbered, or a surface has only one recording.
    """
    unnumbered = table["repetition"].isna()
    if unnumbered.any():
        raise ValueError(
            f"recording {table.loc[unnumbered, 'recording_id'].iloc[0]} has no repetition number. The "
            "protocol `chronological` needs a repetition number for every recording"
        )
    counts = table["surface"].value_counts()
    _require_each(counts, 2, protocol="chronological")
    rank = table.groupby("surface")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    half = table["surface"].map(counts // 2).to_numpy(dtype=np.intp)
    return ((np.flatnonzero(rank <= half), np.flatnonzero(rank > half)),)


@of_recordings
def few_shot(table: pd.DataFrame, n_shots: int, n_starts: int, seed: int) -> Splits:
    """Train on a few consecutive repetitions of each surface, and test on the later half.

    A single training set is not representative, because sensors warm up and operators learn. Up to `n_starts`
    training sets therefore begin at equally spaced repetitions within the first half: with 40 repetitions and
    `n_shots=3`, at repetitions 1, 6, 11 and 16. Every training set is tested on the third and on the fourth
    quarter of the repetitions, so all training sets have the same test sets, which were recorded later. If
    repetition numbers are missing, training runs are drawn at random `n_starts` times, and the remaining runs
    are the test set.

    Raises
    ------
    ValueError
        If a surface has fewer than `2 * n_shots` numbered repetitions, or fewer than `n_shots + 1` runs.
    """
    if table["repetition"].isna().any():
        return _random_shots(table, n_shots, n_starts, seed)
    counts = table["surface"].value_counts()
    _require_each(counts, 2 * n_shots, protocol="few-shot")
    rank = table.groupby("surface")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    count = table["surface"].map(counts).to_numpy(dtype=np.intp)
    half, n_early = count // 2, int(counts.min()) // 2
    later = half + (count - half) // 2
    tests = [np.flatnonzero(quarter) for quarter in ((rank > half) & (rank <= later), rank > later)]
    distance = max(1, n_early // n_starts)
    starts = [1 + k * distance for k in range(n_starts) if k * distance + n_shots <= n_early]
    trains = [np.flatnonzero((rank >= start) & (rank < start + n_shots)) for start in starts]
    return tuple((train, test) for train in trains for test in tests if test.size)


def _random_shots(table: pd.DataFrame, n_shots: int, n_starts: int, seed: int) -> Splits:
    """Draw `n_shots` training runs of each surface `n_starts` times, and test on all remaining runs."""
    run_of_row = pd.DataFrame({"surface": table["surface"], "run": runs(table)})
    all_runs = run_of_row.drop_duplicates().sort_values(["surface", "run"])
    _require_each(all_runs["surface"].value_counts(), n_shots + 1, "run", protocol="few-shot")
    rng, splits = np.random.default_rng(seed), []
    for _ in range(n_starts):
        sample = all_runs.groupby("surface").sample(n_shots, random_state=rng)
        in_train = run_of_row.merge(sample, how="left", indicator=True)["_merge"].eq("both").to_numpy()
        splits.append((np.flatnonzero(in_train), np.flatnonzero(~in_train)))
    return tuple(splits)


def by_labels(table: pd.DataFrame, train: Terms, test: Terms) -> Splits:
    """Select training set and test set by the values of labels.

    Raises
    ------
    ValueError
        If a label or a value does not occur in any recording, a set is empty, a recording is in both sets, or
        a surface of the test set is not in the training set.
    """
    in_train, in_test = _select_rows(table, train), _select_rows(table, test)
    for name, rows in (("training", in_train), ("test", in_test)):
        if not rows.any():
            raise ValueError(
                f"the {name} set is empty: no recording meets all of its conditions. Select at least one "
                "recording"
            )
    if (both := in_train & in_test).any():
        name = table["recording_id"][both].iloc[0]
        raise ValueError(
            f"recording {name} is in the training set and in the test set. Select sets without common "
            "recordings"
        )
    split = np.flatnonzero(in_train), np.flatnonzero(in_test)
    _require_each(table["surface"].value_counts())
    _require_trained(table, split, "in the training set")
    return (split,)


def _select_rows(table: pd.DataFrame, terms: Terms) -> NDArray[np.bool_]:
    """Return, for each row, whether every label in `terms` has one of the listed values."""
    _require_labels(table, [label for label, _ in terms])
    selection = np.ones(len(table), dtype=bool)
    for label, values in terms:
        column = table[label].astype("string").fillna("")
        numbers = pd.to_numeric(column, errors="coerce")
        has_value = np.zeros(len(table), dtype=bool)
        for value in values:
            limits = re.fullmatch(rf"({_NUMBER})-({_NUMBER})", value)  # for example repetitions 1-20
            is_range = limits is not None and not (column == value).any()
            rows = (
                numbers.between(float(limits[1]), float(limits[2]))
                if limits and is_range
                else column == value
            )
            if not rows.any():
                choices = ", ".join(sorted(set(column) - {""}, key=lambda v: (len(v), v))[:8]) or "none"
                raise ValueError(f"no recording has {label} {value!r}. Expected one of: {choices}")
            has_value |= rows.to_numpy(dtype=bool)
        selection &= has_value
    return selection


def n_starts(splits: Sequence[Split]) -> int | None:
    """Return the number of different training sets if any row is tested repeatedly, otherwise None."""
    times_tested = np.bincount(np.concatenate([test for _, test in splits]))
    return len({train.tobytes() for train, _ in splits}) if times_tested.max() > 1 else None


def _require_each(
    counts: "pd.Series[int]", minimum: int = 1, unit: str = "recording", protocol: str = ""
) -> None:
    """Raise ValueError unless there are at least two surfaces, each with `minimum` recordings (or runs)."""
    if len(counts) < 2:
        raise ValueError(f"the dataset has {len(counts)} surface. Classification needs at least 2")
    if (n := int(counts.min())) < minimum:
        raise ValueError(
            f"surface {counts.idxmin()} has {n} {unit}{'' if n == 1 else 's'}. "
            f"The protocol `{protocol}` needs {minimum} per surface"
        )


def _require_folds(counts: "pd.Series[int]", n_folds: int, unit: str = "recording") -> None:
    """Raise ValueError unless there are two surfaces or more, each with at least `n_folds` units."""
    _require_each(counts)
    if (n := int(counts.min())) < n_folds:
        hint = f". Use 2 to {n} folds: `--folds {n}`" if n >= 2 else ""
        raise ValueError(
            f"surface {counts.idxmin()} has {n} {unit}{'' if n == 1 else 's'}; {n_folds} folds"
            f"{f' grouped by {unit}' * (unit in {'run', 'file'})} need at least {n_folds} of each{hint}"
        )


def _require_trained(table: pd.DataFrame, split: Split, where: str) -> None:
    """Raise ValueError if a surface of the test set is not in the training set."""
    train, test = (set(table["surface"].iloc[rows]) for rows in split)
    if missing := sorted(test - train):
        raise ValueError(
            f"surface {missing[0]} has no recording {where}. The training set must contain every surface of "
            "the test set: record this surface there, or exclude it"
        )
