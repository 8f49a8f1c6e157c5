"""Folds of the suite: drawn once per dataset and protocol, stored as JSON, and used by every method."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.atomic_write import write_atomic
from texclass.evaluation.benchmark import inner_splits
from texclass.evaluation.protocols import Protocol, find_protocol
from texclass.evaluation.splits import Split, Splits, runs, split_testable

SEED = 2015
"""Seed of all folds of the suite."""
N_INNER_FOLDS = 3
"""Largest number of folds inside a training set."""


@dataclass(frozen=True, eq=False)
class StoredFolds:
    """Folds of one dataset under one protocol.

    Attributes
    ----------
    frame : DataFrame
        Labels of the recordings or windows, without overlapping training windows.
    protocol : Protocol
        Protocol.
    splits : tuple of (train, test)
        Rows of the frame.
    """

    frame: pd.DataFrame
    protocol: Protocol
    splits: Splits

    @property
    def hash(self) -> str:
        """Digest of the recordings and of the splits."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:16]

    @property
    def tests(self) -> NDArray[np.intp]:
        """Rows of all tests, in fold order."""
        return np.concatenate([test for _, test in self.splits])

    @property
    def tested_units(self) -> NDArray[np.str_]:
        """Sorted names of the independent units that are tested."""
        return np.unique(self.units[1][self.tests])

    @property
    def units(self) -> tuple[str, NDArray[np.str_]]:
        """Kind of the independent units, and the unit of each row of the frame.

        Those of shuffled windows are runs, as in the protocol `grouped`, so that both can be paired.
        """
        if not self.protocol.separates_recordings:
            return "run", runs(self.frame).to_numpy(dtype=str)
        return self.protocol.independent(self.frame)

    def splits_of(self, table: pd.DataFrame) -> Splits:
        """Return the same splits for a feature table, which may also have overlapping training windows.

        Raises
        ------
        ValueError
            If the table lacks recordings of the folds.
        """
        is_train_only = table.get("is_train_only", pd.Series(False, index=table.index)).to_numpy(dtype=bool)
        names = table["recording_id"].to_numpy(dtype=str)[~is_train_only]
        expected = self.frame["recording_id"].to_numpy(dtype=str)
        if not np.array_equal(names, expected):
            missing = sorted(set(expected) - set(names))
            raise ValueError(
                f"the method computed {len(names)} of {len(expected)} recordings of the folds"
                f"{f', without {missing[0]}' if missing else ''}. Expected a result for every recording"
            )
        if not self.protocol.separates_recordings:  # overlapping windows would contain parts of the tests
            rows = np.flatnonzero(~is_train_only)
            return tuple((rows[train], rows[test]) for train, test in self.splits)
        return split_testable(lambda rows: self.splits, table)

    def inner(self, table: pd.DataFrame, split: Split) -> Sequence[Split]:
        """Return splits of a training set, as rows of the table; empty if it has too few recordings."""
        try:
            ((_, splits),) = inner_splits(self.protocol, table, [split], SEED)
        except ValueError:
            return ()
        train = split[0]
        return [(train[a], train[b]) for a, b in splits[:N_INNER_FOLDS]]

    def to_json(self) -> str:
        """Return recordings and folds as JSON text."""
        folds = [{"train": train.tolist(), "test": test.tolist()} for train, test in self.splits]
        recordings = self.frame["recording_id"].tolist()
        content = {"protocol": self.protocol.name, "seed": SEED, "recordings": recordings, "folds": folds}
        return json.dumps(content) + "\n"


def load_folds(frame: pd.DataFrame, protocol: str, n_folds: int, path: Path) -> StoredFolds:
    """Read stored folds, or draw and store them.

    Parameters
    ----------
    frame : DataFrame
        Labels of the recordings or windows.
    protocol : str
        Name of the protocol.
    n_folds : int
        Number of folds, for protocols that draw folds.
    path : Path
        JSON file of the folds.

    Raises
    ------
    ValueError
        If the stored folds are damaged or belong to other recordings, or the protocol cannot split the
        dataset.
    """
    definition = find_protocol(protocol)
    if path.is_file():
        splits = _read_splits(path, frame, definition)
    else:
        splits = definition.split(frame, n_folds, SEED)
    folds = StoredFolds(frame, definition, splits)
    if not path.is_file():
        write_atomic(path, folds.to_json())
    return folds


def _read_splits(path: Path, frame: pd.DataFrame, protocol: Protocol) -> Splits:
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        splits = tuple(
            (np.array(fold["train"], dtype=np.intp), np.array(fold["test"], dtype=np.intp))
            for fold in content["folds"]
        )
        is_same = content["recordings"] == frame["recording_id"].tolist()
        is_same &= content["protocol"] == protocol.name
    except (ValueError, TypeError, LookupError) as error:
        raise ValueError(f"{path}: damaged folds ({error}). Delete the file to draw them again") from error
    if not is_same:
        raise ValueError(
            f"{path}: the folds belong to other recordings. Delete the folder of results, or write to "
            "another folder with -o"
        )
    if any(row.max(initial=0) >= len(frame) or row.min(initial=0) < 0 for split in splits for row in split):
        raise ValueError(f"{path}: damaged folds (rows outside 0 to {len(frame) - 1}). Delete the file")
    return splits
