"""What a study found: plain JSON values, tables of them, and the document they make."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.experiment.result_words import best_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from texclass.document import Document

ACCURACY_KEYS = ("mean", "low", "high", "interval", "clusters", "n_clusters", "balanced")
COMPUTED_BY = ("recording", "signals", "phases", "features", "vibration", "experiment")
"""Rooms and modules whose code the figures of a result depend on."""


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a study found.

    Attributes
    ----------
    data : mapping
        Plain JSON values, accuracies as fractions: what a saved result holds, what its document is made of.
    """

    data: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.data['dataset']['name']}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain JSON values."""
        return dict(self.data)

    def to_json(self) -> str:
        """Return the result as JSON text."""
        return json.dumps(self.data, indent=1, allow_nan=False) + "\n"

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
        named = re.sub(r"[^\w.+-]+", "-", self.data["protocol"].replace("->", "to"))
        return f"{self.data['dataset']['name']}-{self.data['pipeline']['name']}-{named}"

    def document(self) -> "Document":
        """Return the result as a document."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown and pictures into a folder; their names begin with `stem`."""
        from texclass.document import write_document

        return write_document(self.document(), folder, self.stem, json=self.to_json())


class BenchmarkResult(Result):
    """A pipeline evaluated on a dataset; see `run_benchmark`.

    `data` holds `dataset` (facts and numbers), `pipeline`, `protocol`, `rows` (accuracies by classifier,
    published ones, milliseconds, what is missing), `confusion` of the best row, `gains` (what additions
    add), `choice` (made inside training parts), `example` (a recording and its phases), `left_out`, `flags`,
    `undefined`, and what is needed to do it again.
    """

    def __repr__(self) -> str:
        named = f"{self.data['dataset']['name']}, {self.data['pipeline']['name']}, {self.data['protocol']}"
        if self.best is None:
            return f"<{type(self).__name__}: {named}; no row was computed>"
        mean = 100 * self.table["mean"].max()
        return f"<{type(self).__name__}: {named}; best {mean:.1f} %, {' with '.join(self.best)}>"

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        return self.table.to_html(index=False, float_format="{:.3g}".format)

    @property
    def table(self) -> pd.DataFrame:
        """One line a row and classifier: accuracy with its interval, published accuracy, milliseconds."""
        lines = [
            {
                "row": row["name"],
                "classifier": name,
                "n_features": row["n_features"],
                **{key: accuracy[key] for key in ACCURACY_KEYS},
                "paper": row["paper"].get(name),
                "ms_per_recording": row["ms_per_recording"],
            }
            for row in self.data["rows"]
            for name, accuracy in row["accuracy"].items()
        ]
        return pd.DataFrame(lines)

    def document(self) -> "Document":
        """Return the benchmark as a document."""
        from texclass.experiment.benchmark_document import benchmark_document

        return benchmark_document(self.data)

    def plot(self, classifier: str | None = None, width: float = 8.0) -> "Figure":
        """Draw each row's accuracy beside the published figure.

        Parameters
        ----------
        classifier : str, optional
            Whose; every one by default.
        width : float
            In inches.

        Raises
        ------
        ValueError
            If no row was computed.
        """
        from texclass.experiment.benchmark_document import draw_rows

        if self.best is None:
            raise ValueError("no row was computed; the rule is at least one accuracy to draw")
        return draw_rows(self.data, [classifier] if classifier else None, width)

    @property
    def best(self) -> tuple[str, str] | None:
        """Row and classifier of the highest accuracy, the first of equals; None if no row was computed."""
        return best_of(self.data)
