"""Confusion matrices as CSV."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from texclass.atomic_write import write_atomic


def write_confusion(
    path: str | Path, true: Sequence[str], predicted: Sequence[str], counts: Sequence[Sequence[int]]
) -> Path:
    """Write a confusion matrix as CSV, one line per true label, and return its path.

    Parameters
    ----------
    path : str or Path
        File to write.
    true, predicted : sequence of str
        Labels of the rows and of the columns.
    counts : sequence of sequence of int
        Number of predictions, shape (n_true, n_predicted).
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["true label", *predicted])
    writer.writerows([label, *row] for label, row in zip(true, counts, strict=True))
    write_atomic(Path(path), text.getvalue())
    return Path(path)
