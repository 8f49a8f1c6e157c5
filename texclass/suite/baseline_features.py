"""Features of a baseline for all folds of a dataset, computed by another interpreter and read from files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from texclass.baselines import Baseline
from texclass.baselines.baseline_worker.baselines import CLASSIFIERS, EqualLength, Extractor
from texclass.baselines.baseline_worker.run import write_task
from texclass.baselines.comparison import every_channel
from texclass.baselines.worker_process import run_worker
from texclass.evaluation.splits import Split
from texclass.loaders.dataset import Dataset
from texclass.recording import Samples
from texclass.suite.fold_scores import Choice
from texclass.suite.stored_folds import SEED


@dataclass(frozen=True, eq=False)
class BaselineFeatures:
    """Features of a baseline in the files of a worker.

    Attributes
    ----------
    baseline : Baseline
        The baseline.
    folder : Path
        Output folder of the worker.
    extractor : Extractor
        Unfitted extractor, whose `scaler` precedes the classifiers.
    outcome : mapping
        Outcome of the worker; see `read_outcome`.
    """

    baseline: Baseline
    folder: Path
    extractor: Extractor
    outcome: Mapping[str, Any]

    @property
    def ms(self) -> float:
        """Latency of the features in ms, averaged over folds."""
        return 1e3 * float(np.mean([facts["feature_s"] for facts in self.outcome["folds"]]))

    @property
    def kb(self) -> float:
        """Size of the fitted transformers in kB, averaged over folds."""
        return float(np.mean([facts["kb"] for facts in self.outcome["folds"]]))

    @property
    def versions(self) -> dict[str, str]:
        """Versions of the packages of the baseline."""
        return dict(self.outcome["versions"])

    @property
    def message(self) -> str:
        """Status of the worker, with the error message."""
        return f"{self.outcome['status']}: {self.outcome['message']}"

    def matrix(self, fold: int, first: int = 0) -> Samples | None:
        """Return the features of all recordings in a fold, or None if the worker did not finish the fold.

        Parameters
        ----------
        fold : int
            Number of the fold in its protocol.
        first : int
            Number of the first fold of the protocol in the task of the worker (default 0).
        """
        if not self.extractor.depends_on_training:
            return np.asarray(np.load(self.folder / "features.npy", mmap_mode="r"))
        number = first + fold
        if number >= len(self.outcome["folds"]):
            return None
        return np.asarray(np.load(self.folder / f"features_{number}.npy", mmap_mode="r"))

    def choices(self, fold: int, first: int = 0) -> list[Choice]:
        """Return the classifiers of the baseline with its scaling; see `matrix` for the parameters."""
        if (X := self.matrix(fold, first)) is None:
            return []
        if isinstance(self.extractor, EqualLength):
            facts = self.outcome["folds"]
            self.extractor.widths = facts[first + fold if self.extractor.depends_on_training else 0]["widths"]
        return [
            Choice(name, np.arange(X.shape[1]), self.extractor.scaler(), CLASSIFIERS[name](SEED))
            for name in self.baseline.classifiers
        ]


def compute_features(
    baseline: Baseline,
    dataset: Dataset,
    frame: pd.DataFrame,
    splits: Sequence[Split],
    folder: Path,
    python: Path,
    time_limit_s: float,
) -> BaselineFeatures:
    """Compute the features of a baseline from every channel of the recordings.

    Parameters
    ----------
    baseline : Baseline
        The baseline.
    dataset : Dataset
        Recordings or windows.
    frame : DataFrame
        Labels of the recordings, in the order of the rows of the splits.
    splits : sequence of (train, test)
        Folds of all protocols.
    folder : Path
        Folder for signals and features.
    python : Path
        Interpreter with the packages of the baseline.
    time_limit_s : float
        Time limit in s of wall-clock time.

    Raises
    ------
    RuntimeError
        If the worker finished no fold.
    """
    entries = {entry.recording_id: entry for entry in dataset.entries}
    fs = dataset.load(dataset.entries[0]).fs
    y = frame["surface"].to_numpy(dtype=str)
    signals = (every_channel(dataset.load(entries[name])) for name in frame["recording_id"])
    write_task(folder / "task", signals, np.unique(y, return_inverse=True)[1], splits, fs, SEED)
    out = folder / "out"
    outcome = run_worker(python, folder / "task", baseline.name, out, time_limit_s, features_only=True)
    if not outcome["folds"]:
        raise RuntimeError(f"{outcome['status']}: {outcome['message']}")
    return BaselineFeatures(baseline, out, baseline.make(fs, SEED), outcome)
