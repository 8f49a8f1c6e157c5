"""Rate recordings on six perceptual scales, and rank them among reference surfaces."""

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
from texclass.haptics.scales import COLUMNS, SCALES, SPATIAL_SCALES, Scale, scale_values, select_scale
from texclass.loaders import find_recording, open_dataset
from texclass.loaders.dataset import Dataset
from texclass.recording import Recording
from texclass.reporting import Document, Table
from texclass.reporting.blocks import Block, Heading
from texclass.reporting.wording import digits

PLACEHOLDER_FS = 1.0
"""Sampling rate in Hz that loaders use if the true rate is unknown."""
LOW, HIGH = 3.0, 7.0
"""Values below and above which a surface is described by the name of the low or high end of a scale."""


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
    """Rate recordings on the scales hard, rough, bumpy, sticky, fine and regular, among reference surfaces.

    Parameters
    ----------
    recordings : Recording, str, Path or sequence of these
        Recordings, files, or names of the form "DATASET:RECORDING". A dataset counts as a sequence of
        recordings.
    references : Dataset, str or Path
        Labelled recordings, or an argument of `open_dataset` (default: the 24 simulated surfaces, which are
        simulated once and cached). Each surface is represented by the median of its recordings.
    fs : float, optional
        Sampling rate of the files in Hz, see `load_recording`.
    unit : str, optional
        Unit of the files, see `load_recording`.
    n_jobs : int
        Number of processes for the references (default 1).
    progress : callable, optional
        Callback `progress(n_done, n_total, label)`, which counts recordings.
    **reading
        Other arguments of `load_recording`.

    Returns
    -------
    DataFrame
        Six rows per recording with the columns

        - `recording` and `scale`;
        - `value`: value on the scale, see `texclass.haptics.scales`;
        - `feature_value`, `unit` and `feature`: value, unit and name of the measured feature;
        - `n_below`: number of reference surfaces with a lower feature value;
        - `n_references`: total number of reference surfaces;
        - `nearest`: the next lower and the next higher reference surface;
        - `reason`: reason for a missing value, or "".

    Raises
    ------
    RecordingError
        If a recording is invalid.
    """
    inputs = [recordings] if isinstance(recordings, Recording | str | Path) else recordings
    loaded = [
        one if isinstance(one, Recording) else find_recording(one, fs=fs, unit=unit, **reading)
        for one in inputs
    ]
    dataset = references if isinstance(references, Dataset) else open_dataset(references)
    reference_features = _reference_features(dataset, n_jobs, progress)
    reference_unit = dataset[0].unit
    extraction = FeatureExtractor("scales").fit(loaded).extract(loaded)
    features = extraction.table.set_axis(range(len(loaded)))
    values, feature_rows = scale_values(features), features.to_dict("records")
    reasons = {(r.recording_id, r.feature): r.reason for r in extraction.reasons}
    rows = []
    for (i, recording), name in product(enumerate(loaded), SCALES):
        scale = select_scale(name, feature_rows[i])
        reason = reasons.get((recording.recording_id, scale.column.partition(".")[0]), "")
        if not reason and (reason := _missing_value_reason(scale, recording)):
            values.loc[i, name] = np.nan
        feature_value = float(feature_rows[i][scale.column])
        ranked = reference_features[scale.column].dropna().sort_values()
        has_same_unit = not scale.unit.startswith("log10") or recording.unit == reference_unit
        is_comparable = has_same_unit and recording.fs != PLACEHOLDER_FS
        rows.append(
            {
                "recording": recording.recording_id,
                "scale": name,
                "value": values.loc[i, name],
                "feature_value": feature_value,
                "unit": scale.unit.replace("m/s^2", recording.unit),
                "feature": scale.column,
                **_rank(feature_value, ranked if is_comparable else ranked[:0]),
                "reason": reason,
            }
        )
    columns = [
        "recording", "scale", "value", "feature_value", "unit", "feature", "n_below", "n_references",
        "nearest", "reason",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=columns).astype({"n_below": "Int64", "n_references": "Int64"})


def _rank(feature_value: float, ranked: "pd.Series[float]") -> dict[str, Any]:
    """Return the number of references below a value, their total number, and the nearest references."""
    if np.isnan(feature_value) or ranked.empty:
        return {"n_below": None, "n_references": None, "nearest": ()}
    n_below = int((ranked < feature_value).sum())
    nearest = tuple(ranked.index[max(n_below - 1, 0) : n_below + 1])
    return {"n_below": n_below, "n_references": len(ranked), "nearest": nearest}


def _missing_value_reason(scale: Scale, recording: Recording) -> str:
    """Return the reason why a recording has no value on a scale, or "" if it has one."""
    if scale.unit == "Hz" and recording.fs == PLACEHOLDER_FS:
        return "the sampling rate is missing. Pass fs"
    if scale.unit.startswith("log10") and recording.unit != "m/s^2":
        return (
            f"the unit must be m/s^2 for a value, got {recording.unit}. References in this unit give a rank"
        )
    return ""


def _reference_features(dataset: Dataset, n_jobs: int, progress: Progress | None) -> pd.DataFrame:
    """Return the median features of each reference surface.

    A surface has ridges if ridges are detected in at least half of its recordings.
    """
    table = cached_table(dataset, load_feature_set("scales"), n_jobs=n_jobs, progress=progress)
    surfaces = table.frame.groupby("surface")[list(COLUMNS)]
    ridge_columns = [scale.column for scale in SPATIAL_SCALES.values()]
    is_frequent = (2 * surfaces.count()).ge(surfaces.size(), axis=0)
    return surfaces.median().where(is_frequent | ~is_frequent.columns.isin(ridge_columns))


def description_document(description: pd.DataFrame) -> Document:
    """Return a report with one table per recording.

    Parameters
    ----------
    description : DataFrame
        Result of `describe`.

    Returns
    -------
    Document
        Report.

    Examples
    --------
    >>> import pandas as pd
    >>> from texclass.haptics import description_document
    >>> description = pd.DataFrame(
    ...     [["oak", "hard", 8.0, 260.0, "Hz", "damping", 20, 24, ("cork", "metal"), ""]],
    ...     columns=["recording", "scale", "value", "feature_value", "unit", "feature", "n_below",
    ...              "n_references", "nearest", "reason"],
    ... )
    >>> description_document(description).blocks[1]
    'Hard.'
    """
    blocks: list[Block] = []
    for recording, rows in description.groupby("recording", sort=False):
        adjectives = [
            scale if value > HIGH else SCALES[scale].low_end
            for scale, value in zip(rows["scale"], rows["value"], strict=True)
            if value > HIGH or value < LOW
        ]
        table = pd.DataFrame(
            [
                (
                    f"{row['scale']} (0: {SCALES[row['scale']].low_end})",
                    "" if np.isnan(row["value"]) else f"{row['value']:.1f}",
                    f"{row['n_below']} of {row['n_references']}" if row["nearest"] else "",
                    ""
                    if np.isnan(row["feature_value"])
                    else f"{digits(row['feature_value'])} {row['unit']}".strip(),
                    " and ".join(row["nearest"]),
                )
                for row in rows.to_dict("records")
            ],
            columns=["scale", "0-10", "above", "feature", "nearest"],
        )
        blocks += [Heading(str(recording)), f"{', '.join(adjectives) or 'average'}.".capitalize()]
        blocks.append(Table(table, n_narrow=3))
        reasons = rows[rows["reason"] != ""].groupby("reason", sort=False)["scale"].agg(", ".join)
        blocks.append([f"{scales}: {reason}" for reason, scales in reasons.items()])
    blocks.append(
        [
            "0 and 10: the 5th and 95th percentile of simulated everyday surfaces, explored freehand.",
            "Above: number of reference surfaces with a lower value.",
            "Fine in 1/mm: ridges over the position of the tool, from its recorded speed; in Hz: no ridges, "
            "or no speed.",
        ]
    )
    return Document("Perceptual scales", blocks)
