"""How recordings feel: six scales, and their places among reference surfaces."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from texclass.evaluation.feature_table import cached_table
from texclass.evaluation.workers import Progress
from texclass.features.extractor import FeatureExtractor
from texclass.features.sets import load_feature_set
from texclass.haptics.scales import COLUMNS, OVER_THE_WAY, SCALES, Scale, link_of, scale_values
from texclass.loaders import find_recording, open_dataset
from texclass.loaders.dataset import Dataset
from texclass.recording import Recording
from texclass.reporting import Document, Table
from texclass.reporting.blocks import Block, Heading
from texclass.reporting.wording import digits

NOMINAL_FS = 1.0
"""Rate of recordings whose rate nobody knows."""
LITTLE, MUCH = 3.0, 7.0
"""Below and above these a surface is called by the name of the scale's end."""


def describe(
    recordings: "Recording | str | Path | Iterable[Recording | str | Path]",
    references: Dataset | str | Path = "simulated",
    *,
    fs: float | None = None,
    unit: str | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
    **reading: Any,
) -> pd.DataFrame:
    """Say how recordings feel: hard, rough, bumpy, sticky, fine, regular, and among which surfaces.

    Parameters
    ----------
    recordings : Recording, str, Path or sequence of these
        Recordings, files, or "DATASET:RECORDING"; a dataset is a sequence of recordings.
    references : Dataset, str or Path
        Labelled recordings, or what `open_dataset` opens; each surface counts by the median of its
        recordings. By default the 24 simulated surfaces, which are made at the first call and remembered.
    fs, unit : optional
        As `load_recording` takes them, for the files; `reading` is what else it takes.
    n_jobs : int
        Processes for the references.
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    DataFrame
        Six rows a recording: `recording`, `scale`, `value` (see `texclass.haptics.scales`), `measured`,
        `unit`, `feature` (what was measured; `fine` and `regular` over the way of the tool, where its speed
        is known), `below` (how many reference surfaces lie below), `of` (how many have it), `between` (the
        nearest of them), and `why` where something is not told.

    Raises
    ------
    RecordingError
        If a recording breaks a rule.
    """
    listed = [recordings] if isinstance(recordings, Recording | str | Path) else recordings
    given = [
        one if isinstance(one, Recording) else find_recording(one, fs=fs, unit=unit, **reading)
        for one in listed
    ]
    dataset = references if isinstance(references, Dataset) else open_dataset(references)
    surfaces, known_unit = _surfaces(dataset, n_jobs, progress), dataset[0].unit
    found = FeatureExtractor("scales").fit(given).extract(given)
    measured = found.table.set_axis(range(len(given)))
    values, reasons = scale_values(measured), {(r.recording_id, r.feature): r.reason for r in found.reasons}
    rows, told = [], measured.to_dict("records")
    for (at, recording), name in product(enumerate(given), SCALES):
        scale = link_of(name, told[at])
        alike = known_unit if scale.unit.startswith("log10") else recording.unit
        why = reasons.get((recording.recording_id, scale.column.partition(".")[0]), "")
        if not why and (why := _not_absolute(scale, recording)):
            values.loc[at, name] = np.nan
        m, among = float(told[at][scale.column]), surfaces[scale.column].dropna().sort_values()
        rows.append(
            {"recording": recording.recording_id, "scale": name, "value": values.loc[at, name], "measured": m}
            | {"unit": scale.unit.replace("m/s^2", recording.unit), "feature": scale.column, "why": why}
            | _place(m, among if recording.unit == alike and recording.fs != NOMINAL_FS else among[:0])
        )
    columns = ["recording", "scale", "value", "measured", "unit", "feature", "below", "of", "between", "why"]
    return pd.DataFrame(rows, columns=columns).astype({"below": "Int64", "of": "Int64"})


def _place(m: float, among: "pd.Series[float]") -> dict[str, Any]:
    """Return how many of the sorted reference surfaces lie below, of how many, and the nearest of them."""
    if np.isnan(m) or among.empty:
        return {"below": None, "of": None, "between": ()}
    below = int((among < m).sum())
    return {"below": below, "of": len(among), "between": tuple(among.index[max(below - 1, 0) : below + 1])}


def _not_absolute(scale: Scale, recording: Recording) -> str:
    """Return why a value of a recording cannot be put between 0 and 10, if it cannot."""
    if scale.unit == "Hz" and recording.fs == NOMINAL_FS:
        return "fs is 1 Hz. Expected the sampling rate of the recording"
    if scale.unit.startswith("log10") and recording.unit != "m/s^2":
        return f"the unit is {recording.unit}. Expected m/s^2: places alone, among references of this unit"
    return ""


def _surfaces(dataset: Dataset, n_jobs: int, progress: Progress | None) -> pd.DataFrame:
    """Return the features of the set `scales`, the median of each reference surface.

    Ribs, which not every surface has, are those of at least half of its recordings.
    """
    table = cached_table(dataset, load_feature_set("scales"), n_jobs=n_jobs, progress=progress)
    surfaces = table.frame.groupby("surface")[list(COLUMNS)]
    ribs = [scale.column for scale in OVER_THE_WAY.values()]
    often = (2 * surfaces.count()).ge(surfaces.size(), axis=0)
    return surfaces.median().where(often | ~often.columns.isin(ribs))


def felt_document(felt: pd.DataFrame) -> Document:
    """Return what `describe` found, one table a recording."""
    blocks: list[Block] = []
    for recording, rows in felt.groupby("recording", sort=False):
        ends = [
            scale if value > MUCH else SCALES[scale].other_end
            for scale, value in zip(rows["scale"], rows["value"], strict=True)
            if value > MUCH or value < LITTLE
        ]
        shown = pd.DataFrame(
            [
                (
                    f"{row['scale']} (0: {SCALES[row['scale']].other_end})",
                    "" if np.isnan(row["value"]) else f"{row['value']:.1f}",
                    f"{row['below']} of {row['of']}" if row["between"] else "",
                    "" if np.isnan(row["measured"]) else f"{digits(row['measured'])} {row['unit']}".strip(),
                    " and ".join(row["between"]),
                )
                for row in rows.to_dict("records")
            ],
            columns=["scale", "0-10", "above", "measured", "nearest"],
        )
        blocks += [Heading(str(recording)), f"{', '.join(ends) or 'nothing stands out'}.".capitalize()]
        blocks.append(Table(shown, n_kept=3))
        why = rows[rows["why"] != ""].groupby("why", sort=False)["scale"].agg(", ".join)
        blocks.append([f"{scales}: {reason}" for reason, scales in why.items()])
    blocks.append(
        [
            "0 and 10: the lowest and the highest twentieth of simulated everyday surfaces, freehand.",
            "Above: how many reference surfaces lie below.",
            "Fine in 1/mm: ribs along the way of the tool, by its recorded speed; in Hz: none, or no speed.",
        ]
    )
    return Document("How it feels", blocks)
