"""Confusion matrices: CSV files and figures."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from texclass.atomic_write import write_atomic


def write_confusion(
    path: str | Path, true: Sequence[str], predicted: Sequence[str], counts: Sequence[Sequence[int]]
) -> Path:
    """Write a confusion matrix as CSV, one line per true label.

    Parameters
    ----------
    path : str or Path
        Output file.
    true, predicted : sequence of str
        Labels of the rows and of the columns.
    counts : sequence of sequence of int
        Numbers of predictions, shape (n_true, n_predicted).
    """
    matrix = pd.DataFrame(counts, index=pd.Index(true, name="true label"), columns=pd.Index(predicted))
    write_atomic(Path(path), matrix.to_csv(lineterminator="\n"))
    return Path(path)
