"""The feature table of a dataset: one Parquet file that also holds why values are undefined."""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from texclass.experiment.windows import Window, parent_id
from texclass.features.extractor import Reason
from texclass.loaders.dataset import Entry
from texclass.recording import Samples

METADATA = ("recording_id", "material", "operator", "session", "repetition")
"""Columns of every table, before the features; tables of windows add `parent`, the recording."""


class LeftOut(NamedTuple):
    """A recording that could not be used, and why."""

    recording_id: str
    reason: str

    def __str__(self) -> str:
        return f"{self.recording_id}: {self.reason}"


class Flag(NamedTuple):
    """What a loader noticed about a recording that is used all the same ("clipped: 3.1 % ...")."""

    recording_id: str
    flag: str


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """The features of a dataset.

    Attributes
    ----------
    frame : DataFrame
        One row a recording (or window) in the dataset's order: the columns of `METADATA`, then the features
        (NaN where undefined).
    columns : tuple of str
        The feature columns.
    ms : ndarray of shape (n_recordings,)
        Milliseconds that each recording took, segmentation included, loading not.
    reasons : tuple of Reason
        Why features are undefined.
    flags : tuple of Flag
        What loaders noticed.
    left_out : tuple of LeftOut
        Bad recordings that were skipped.
    key : str
        Digest of input, feature set, code and version.
    """

    frame: pd.DataFrame
    columns: tuple[str, ...]
    ms: Samples
    reasons: tuple[Reason, ...] = ()
    flags: tuple[Flag, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    key: str = ""

    @property
    def n_recordings(self) -> int:
        """Number of rows."""
        return len(self.frame)

    @property
    def n_columns(self) -> int:
        """Number of feature columns."""
        return len(self.columns)

    @property
    def values(self) -> Samples:
        """The features, shape (n_recordings, n_columns)."""
        return self.frame[list(self.columns)].to_numpy(dtype=np.float64)

    def matching(self, base: Sequence[str]) -> tuple[str, ...]:
        """Return the columns named in `base`, under every channel prefix, in the order of `base`."""
        return tuple(c for b in base for c in self.columns if c == b or c.split("/", 1)[-1] == b)

    def reason_of(self, name: str) -> str:
        """Return the commonest reason why a feature, or the feature of a column, has no value."""
        names = (name, name.split(".", 1)[0])
        reasons = Counter(r.reason for r in self.reasons if r.feature.split("/", 1)[-1] in names)
        return reasons.most_common(1)[0][0]


def metadata(entries: Sequence[Entry]) -> pd.DataFrame:
    """Return what is known of recordings (or windows of them) before they are loaded, one row each."""
    frame = pd.DataFrame([[getattr(e, name) for name in METADATA] for e in entries], columns=METADATA)
    text = [name for name in METADATA if name != "repetition"]
    frame = frame.astype({**dict.fromkeys(text, "str"), "repetition": "Int64"})
    if any(isinstance(entry, Window) for entry in entries):
        frame["parent"] = pd.Series([parent_id(entry) for entry in entries], dtype="str")
    return frame


def read_table(path: str | Path) -> FeatureTable:
    """Read a feature table.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not a whole feature table; the message names it.
    """
    try:
        arrow = pq.read_table(path, use_threads=False)
        return _checked(arrow, json.loads((arrow.schema.metadata or {})[b"texclass"]))
    except FileNotFoundError:
        raise
    except Exception as error:  # damaged bytes make pyarrow and pandas raise almost anything
        raise ValueError(f"{path}: not a feature table of texclass ({error})") from error


def _checked(arrow: pa.Table, facts: Mapping[str, Any]) -> FeatureTable:
    """Return the table that the columns and facts of a file make, if they fit each other."""
    columns, ms = tuple(facts["columns"]), np.array(facts["ms"], dtype=np.float64)
    lacking = [name for name in (*METADATA, *columns) if arrow.schema.names.count(name) != 1]
    if lacking or ms.shape != (arrow.num_rows,) or not isinstance(facts["key"], str):
        raise ValueError(f"{lacking or ms.shape}; the rule is each column once, as many times as rows")
    frame = arrow.to_pandas()
    if list(frame.columns) != arrow.schema.names:
        raise ValueError(f"columns {list(frame.columns)!r:.80}; the rule is those of the schema")
    table = FeatureTable(
        frame,
        columns,
        ms,
        tuple(Reason(*r) for r in facts["reasons"]),
        tuple(Flag(*f) for f in facts["flags"]),
        tuple(LeftOut(*b) for b in facts["left_out"]),
        facts["key"],
    )
    np.asarray(table.values, dtype=np.float64)  # or raises: a column holds no numbers
    return table


class PartRow(NamedTuple):
    """What is kept of a recording (or window) until all are done: values (n_columns,), (feature, reason)."""

    values: Samples
    reasons: tuple[tuple[str, str], ...]
    flags: tuple[str, ...]
    ms: float


def read_part(path: Path, n_columns: int) -> list[PartRow]:
    """Read the rows of one finished recording.

    Raises
    ------
    ValueError
        If the file is damaged; the message names it.
    """
    try:
        found = [
            PartRow(
                np.array(row["values"], dtype=np.float64),
                tuple((str(name), str(reason)) for name, reason in json.loads(row["reasons"])),
                tuple(str(flag) for flag in json.loads(row["flags"])),
                float(row["ms"]),
            )
            for row in pq.read_table(path, use_threads=False).to_pylist()
        ]
        if any(np.shape(row[0]) != (n_columns,) or not np.isfinite(row.ms) for row in found):
            raise ValueError(f"the rule is {n_columns} values a row")
    except Exception as error:  # damaged bytes make pyarrow raise almost anything
        raise ValueError(f"{path}: is damaged ({error}); delete it, and it is computed again") from error
    return found


def write_table(table: FeatureTable, path: Path) -> None:
    """Write a feature table, atomically."""
    facts = {
        "key": table.key,
        "columns": table.columns,
        "ms": table.ms.tolist(),
        "reasons": table.reasons,
        "flags": table.flags,
        "left_out": table.left_out,
    }
    arrow = pa.Table.from_pandas(table.frame, preserve_index=False)
    metadata = {**(arrow.schema.metadata or {}), b"texclass": json.dumps(facts).encode()}
    write_atomically(arrow.replace_schema_metadata(metadata), path)


def write_atomically(arrow: pa.Table, path: Path) -> None:
    """Write a Parquet file that is either complete or not there, whenever the process is killed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    pq.write_table(arrow, unfinished)
    unfinished.replace(path)
