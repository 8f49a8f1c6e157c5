"""Training and test rows of a feature table: plain functions of its label columns, without any protocol.

A table has one row per recording, or one per window of a recording: windows of one recording are never
separated.
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
from texclass.evaluation.windows import asked, parents

Indices = NDArray[np.intp]
Split = tuple[Indices, Indices]
"""Row numbers of a training set and of its test set."""
Splits = tuple[Split, ...]
P = ParamSpec("P")


def runs(table: pd.DataFrame) -> "pd.Series[str]":
    """Return the run (session) of each row; its recording, unless every row names a session."""
    is_named = table["session"].notna().all() and table["session"].nunique() >= 2
    return table["session"].astype(str) if is_named else parents(table)


def left_out_label(table: pd.DataFrame, labels: Sequence[str]) -> str:
    """Return the first label that every row names and that has at least two groups.

    Raises
    ------
    ValueError
        If there is none.
    """
    for label in labels:
        if table[label].notna().all() and table[label].nunique() >= 2:
            return label
    counts = " and ".join(f"{table[label].nunique()} {label}s" for label in labels)
    unnamed = table[list(labels)].isna().all(axis=1).sum()
    raise ValueError(
        f"the dataset names {counts}, {unnamed} recordings without one; leaving one out needs at least 2 of "
        f"one label ({', '.join(labels)}), named for every recording"
    )


def split_tested(split: Callable[[pd.DataFrame], Splits], table: pd.DataFrame) -> Splits:
    """Split the rows that may be tested; windows between them train where their recording does."""
    rows, recording = np.flatnonzero(asked(table)), parents(table)
    if len(rows) == len(table):
        return split(table)
    return tuple(
        (np.flatnonzero(recording.isin(recording.iloc[rows[train]])), rows[test])
        for train, test in split(table.iloc[rows].reset_index(drop=True))
    )


def of_recordings(
    split: Callable[Concatenate[pd.DataFrame, P], Splits],
) -> Callable[Concatenate[pd.DataFrame, P], Splits]:
    """Let a split of recordings split their windows, too: each window goes where its recording goes."""

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
    """Split recordings into folds with equal shares of each surface.

    Raises
    ------
    ValueError
        If a surface has fewer recordings than there are folds, or there is one surface.
    """
    _require_folds(table["surface"].value_counts(), n_folds)
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed)
    return tuple(folds.split(table, table["surface"]))


def grouped(table: pd.DataFrame, n_folds: int, seed: int) -> Splits:
    """Split runs into folds with about equal shares of each surface; no run both trains and tests.

    Raises
    ------
    ValueError
        If a surface has fewer runs than there are folds, or a run's absence leaves a surface untrained.
    """
    run = runs(table)
    _require_folds(run.groupby(table["surface"]).nunique(), n_folds, "run")
    folds = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        # A surface with fewer rows than folds: there are enough runs, which is what counts.
        warnings.filterwarnings("ignore", message="The least populated class", category=UserWarning)
        splits = tuple(s for s in folds.split(table, table["surface"], run) if s[1].size)
    for number, split in enumerate(splits, start=1):
        _require_trained(table, split, f"outside fold {number}")
    return splits


@of_recordings
def leave_one_out(table: pd.DataFrame, label: str) -> Splits:
    """Test on each group of a label in turn.

    Raises
    ------
    ValueError
        If a surface would be tested without having been trained, or there is one surface.
    """
    _require_each(table["surface"].value_counts())
    splits = tuple(LeaveOneGroupOut().split(table, groups=table[label]))
    for train, test in splits:
        _require_trained(table, (train, test), f"without {label} {table[label].iloc[test[0]]}")
    return splits


@of_recordings
def chronological(table: pd.DataFrame) -> Splits:
    """Train on the first half of each surface's repetitions, test on the second (the larger, if odd).

    Raises
    ------
    ValueError
        If repetitions are not numbered, or a surface has only one recording.
    """
    unnumbered = table["repetition"].isna()
    if unnumbered.any():
        raise ValueError(
            f"recording {table.loc[unnumbered, 'recording_id'].iloc[0]} has no repetition number; the "
            "protocol `chronological` needs it on each"
        )
    counts = table["surface"].value_counts()
    _require_each(counts, 2, protocol="chronological")
    rank = table.groupby("surface")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    half = table["surface"].map(counts // 2).to_numpy(dtype=np.intp)
    return ((np.flatnonzero(rank <= half), np.flatnonzero(rank > half)),)


@of_recordings
def few_shot(table: pd.DataFrame, n_shots: int, n_starts: int, seed: int) -> Splits:
    """Train on few repetitions of each surface in a row, from several starts on; test on much later ones.

    One start says little: a sensor warms up, a hand learns. Starts are a quarter of the first half of the
    repetitions apart, as many of `n_starts` as leave `n_shots` of them within that half: of forty, three
    train from 1, 6, 11 and 16 on. The third and the fourth quarter test, each a fold of every start, so that
    every start has the same tests, and none trains on what comes after one. Where a recording has no
    number, recordings (or runs) are drawn with the seed as often, and the others test.

    Raises
    ------
    ValueError
        If a surface has fewer than twice as many numbered repetitions as train, or no run besides those.
    """
    if table["repetition"].isna().any():
        return _random_shots(table, n_shots, n_starts, seed)
    counts = table["surface"].value_counts()
    _require_each(counts, 2 * n_shots, protocol="few-shot")
    rank = table.groupby("surface")["repetition"].rank(method="first").to_numpy(dtype=np.float64)
    count = table["surface"].map(counts).to_numpy(dtype=np.intp)
    half, fewest_early = count // 2, int(counts.min()) // 2
    later = half + (count - half) // 2
    tests = [np.flatnonzero(quarter) for quarter in ((rank > half) & (rank <= later), rank > later)]
    apart = max(1, fewest_early // n_starts)
    starts = [1 + k * apart for k in range(n_starts) if k * apart + n_shots <= fewest_early]
    trains = [np.flatnonzero((rank >= start) & (rank < start + n_shots)) for start in starts]
    return tuple((train, test) for train in trains for test in tests if test.size)


def _random_shots(table: pd.DataFrame, n_shots: int, n_starts: int, seed: int) -> Splits:
    """Train on so many runs of each surface, drawn `n_starts` times; test on all others."""
    run_of_row = pd.DataFrame({"surface": table["surface"], "run": runs(table)})
    every_run = run_of_row.drop_duplicates().sort_values(["surface", "run"])
    _require_each(every_run["surface"].value_counts(), n_shots + 1, "run", protocol="few-shot")
    rng, splits = np.random.default_rng(seed), []
    for _ in range(n_starts):
        sample = every_run.groupby("surface").sample(n_shots, random_state=rng)
        trains = run_of_row.merge(sample, how="left", indicator=True)["_merge"].eq("both").to_numpy()
        splits.append((np.flatnonzero(trains), np.flatnonzero(~trains)))
    return tuple(splits)


def by_labels(table: pd.DataFrame, train: Terms, test: Terms) -> Splits:
    """Train on the recordings that some labels choose, test on those that others do.

    Raises
    ------
    ValueError
        If a value is absent, nothing trains or tests, a recording does both, or a tested surface does not
        train.
    """
    trains, tests = _selected(table, train), _selected(table, test)
    for name, rows in (("train", trains), ("test", tests)):
        if not rows.any():
            raise ValueError(f"no recording would {name}: none has all of these labels. Choose at least one")
    if (both := trains & tests).any():
        raise ValueError(f"recording {table['recording_id'][both].iloc[0]} would train and test. Choose one")
    split = np.flatnonzero(trains), np.flatnonzero(tests)
    _require_each(table["surface"].value_counts())
    _require_trained(table, split, "that trains")
    return (split,)


def _selected(table: pd.DataFrame, terms: Terms) -> NDArray[np.bool_]:
    """Return which rows have one of the values of every label."""
    selected = np.ones(len(table), dtype=bool)
    for label, values in terms:
        present = table[label].astype("string").fillna("")
        numbers = pd.to_numeric(present, errors="coerce")
        has_one = np.zeros(len(table), dtype=bool)
        for value in values:
            span = re.fullmatch(r"(\d{1,9})-(\d{1,9})", value)  # repetitions 1-20
            is_range = span is not None and not (present == value).any()
            rows = numbers.between(int(span[1]), int(span[2])) if span and is_range else present == value
            if not rows.any():
                known = ", ".join(sorted(set(present) - {""}, key=lambda v: (len(v), v))[:8]) or "none"
                raise ValueError(f"no recording has {label} {value!r}; there are {known}")
            has_one |= rows.to_numpy(dtype=bool)
        selected &= has_one
    return selected


def n_starts(splits: Sequence[Split]) -> int | None:
    """Return from how many training sets recordings are tested; None where each is tested at most once."""
    times_tested = np.bincount(np.concatenate([test for _, test in splits]))
    return len({train.tobytes() for train, _ in splits}) if times_tested.max() > 1 else None


def _require_each(
    counts: "pd.Series[int]", least: int = 1, unit: str = "recording", protocol: str = ""
) -> None:
    """Refuse fewer than two surfaces, and a surface with fewer recordings (or runs) than needed."""
    if len(counts) < 2:
        raise ValueError(f"the dataset has {len(counts)} surface; classification needs at least 2")
    if (n := int(counts.min())) < least:
        raise ValueError(
            f"surface {counts.idxmin()} has {n} {unit}{'' if n == 1 else 's'}; "
            f"the protocol `{protocol}` needs {least} of each"
        )


def _require_folds(counts: "pd.Series[int]", n_folds: int, unit: str = "recording") -> None:
    """Refuse fewer than two surfaces, and a surface with fewer recordings (or runs) than folds."""
    _require_each(counts)
    if (n := int(counts.min())) < n_folds:
        possible = f"; 2 to {n} folds are possible: `--folds {n}`" if n >= 2 else ""
        raise ValueError(
            f"surface {counts.idxmin()} has {n} {unit}{'' if n == 1 else 's'}; {n_folds} folds"
            f"{' grouped by run' * (unit == 'run')} need at least {n_folds} of each{possible}"
        )


def _require_trained(table: pd.DataFrame, split: Split, where: str) -> None:
    """Refuse a split that tests a surface without training it."""
    train, test = (set(table["surface"].iloc[rows]) for rows in split)
    if untrained := sorted(test - train):
        raise ValueError(
            f"surface {untrained[0]} has no recording {where}; "
            "the protocol needs every tested surface trained"
        )
