"""Predictions for recordings of known surfaces: accuracy and confusion matrix."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from texclass.evaluation.accuracy import score
from texclass.evaluation.confusion import write_confusion
from texclass.recognition.answers import Prediction
from texclass.reporting import Document, Table
from texclass.reporting.wording import counted, estimate

UNKNOWN = "unknown"
"""Predicted label of a recording that is reported as unknown."""


@dataclass(frozen=True)
class PredictionSummary:
    """Predicted and true surfaces of several recordings.

    Attributes
    ----------
    true, predicted : tuple of str
        Labels of the recordings whose true surface is known and that could be classified. The predicted label
        of a recording that is reported as unknown is `UNKNOWN`.
    surfaces : tuple of str
        Surfaces of the training set.

    Examples
    --------
    >>> summary = PredictionSummary(("oak", "oak", "tin"), ("oak", "cork", "unknown"), ("cork", "oak"))
    >>> summary.accuracy["mean"], summary.confusion
    (0.5, [[1, 1, 0], [0, 0, 1]])
    """

    true: tuple[str, ...]
    predicted: tuple[str, ...]
    surfaces: tuple[str, ...]

    @classmethod
    def from_predictions(
        cls, predictions: Sequence[Prediction], surfaces: Sequence[str]
    ) -> "PredictionSummary":
        """Return the summary of the predictions of a model with these surfaces."""
        pairs = [
            (one.surface, UNKNOWN if one.answer.unknown else one.answer.surface)
            for one in predictions
            if one.answer is not None and one.surface is not None
        ]
        return cls(tuple(t for t, _ in pairs), tuple(p for _, p in pairs), tuple(surfaces))

    @property
    def accuracy(self) -> dict[str, Any] | None:
        """Accuracy with a 95 % Wilson interval on recordings of trained surfaces; None if there are none.

        A recording that is reported as unknown counts as wrong.
        """
        pairs = [(t, p) for t, p in zip(self.true, self.predicted, strict=True) if t in self.surfaces]
        if not pairs:
            return None
        true, predicted = (np.array(labels) for labels in zip(*pairs, strict=True))
        return score([true], [predicted]).to_dict()

    @property
    def labels(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Labels of the rows and of the columns of the confusion matrix."""
        others = sorted(set(self.true) - set(self.surfaces))
        present = [surface for surface in self.surfaces if surface in self.true]
        return (*present, *others), (*self.surfaces, UNKNOWN)

    @property
    def confusion(self) -> list[list[int]]:
        """Number of predictions, one row per true label, one column per predicted label."""
        counts = Counter(zip(self.true, self.predicted, strict=True))
        rows, columns = self.labels
        return [[counts[row, column] for column in columns] for row in rows]

    def save_confusion(self, path: str | Path) -> Path:
        """Write the confusion matrix as CSV.

        Raises
        ------
        ValueError
            If no true surface is known.
        """
        if not self.true:
            raise ValueError(
                "cannot write the confusion matrix: no true surface is known. Expected a folder with one "
                "subfolder per surface, or a dataset card"
            )
        return write_confusion(path, *self.labels, self.confusion)

    def document(self) -> Document:
        """Return a document with accuracy and confusion matrix."""
        rows, columns = self.labels
        notes = []
        if (accuracy := self.accuracy) is not None:
            n = sum(true in self.surfaces for true in self.true)
            notes.append(f"accuracy {estimate(accuracy)} % on {counted(n, 'recording')} of trained surfaces")
        if others := sorted(set(self.true) - set(self.surfaces)):
            answers = [p for t, p in zip(self.true, self.predicted, strict=True) if t in others]
            n_unknown = f"{answers.count(UNKNOWN)} of {counted(len(answers), 'recording')}"
            notes.append(
                f"the model was not trained on {', '.join(others)}: {n_unknown} reported as unknown, "
                "not counted in the accuracy"
            )
        used = [j for j in range(len(columns)) if any(row[j] for row in self.confusion)]
        frame = {
            "True surface": rows,
            **{columns[j]: [str(row[j] or "") for row in self.confusion] for j in used},
        }
        return Document("Confusion matrix", [Table(frame, caption="Columns: predicted surface."), notes])
