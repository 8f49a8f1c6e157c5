"""Rate recordings on six perceptual scales, and rank them among reference surfaces."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from texclass.evaluation.feature_table import cached_table
from texclass.evaluation.workers import Progress
from texclass.features.extractor import FeatureExtractor
from texclass.features.sets import load_feature_set
from texclass.haptics.scales import (
    COLUMNS,
    LEVEL_UNIT,
    SCALES,
    SPATIAL_SCALES,
    Scale,
    reference_surfaces,
    select_scale,
)
from texclass.loaders import find_recording, open_dataset
from texclass.loaders.dataset import Dataset
from texclass.loaders.readers import LoadingOptions
from texclass.phases import find_phases, resolution_problem
from texclass.recording import Phases, Recording
from texclass.reporting import Document, Table
from texclass.reporting.blocks import Block, Heading
from texclass.reporting.wording import digits
from texclass.signals import combine

PLACEHOLDER_FS = 1.0
"""Sampling rate in Hz that loaders use if the true rate is unknown."""
FRAME_S, REST_DB = 0.02, 20.0
"""Length of a frame in s, and level in dB below the strongest frame at which a recording counts as at rest.
Taps decay by more than this in most frames of a recording. A vibration that does not is a movement."""
LOW, HIGH = 3.0, 7.0
"""Values below and above which a surface is described by the name of the low or high end of a scale."""


def describe(
    recordings: "Recording | str | Path | Iterable[Recording | str | Path]",
    references: Dataset | str | Path | None = None,
    *,
    fs: float | None = None,
    unit: str | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
    resample: float | None = None,
) -> pd.DataFrame:
    """Rate recordings on the scales hard, rough, bumpy, sticky, fine and regular, among reference surfaces.

    Parameters
    ----------
    recordings : Recording, str, Path or sequence of these
        Recordings, files, or names of the form "DATASET:RECORDING". A dataset counts as a sequence of
        recordings.
    references : Dataset, str or Path, optional
        Labelled recordings, or an argument of `open_dataset` (default: 100 simulated surfaces, see
        `texclass.haptics.scales`). Each surface is represented by the median of its recordings.
    fs : float, optional
        Sampling rate of the files in Hz, see `load_recording`.
    unit : str, optional
        Unit of the files, see `load_recording`.
    n_jobs : int
        Number of processes for the references (default 1).
    progress : callable, optional
        Callback `progress(n_done, n_total, label)`, which counts recordings.
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How the files are read, see `load_recording`.
    resample : float, optional
        Target sampling rate of the files in Hz.

    Returns
    -------
    DataFrame
        Six rows per recording with the columns

        - `recording` and `scale`;
        - `value`: rank among the reference surfaces, from 0 to 10, see `texclass.haptics.scales`;
        - `feature_value`, `unit` and `feature`: value, unit and name of the measured feature;
        - `n_below`: number of reference surfaces with a lower feature value;
        - `n_references`: total number of reference surfaces;
        - `nearest`: the next lower and the next higher reference surface;
        - `excess` and `excess_unit`: distance of the feature to the range of the reference surfaces, 0 inside
          and negative below it, in dB or octaves;
        - `reason`: reason for a missing value, or "".

    Raises
    ------
    RecordingError
        If a recording is invalid.

    Notes
    -----
    If only taps are detected but the vibration never rests, the whole recording is rated as a movement.

    A recording with too few distinct values, or whose vibration is below one quantisation step, has no
    values; see `texclass.phases.resolution_problem`.

    Examples
    --------
    Rate a tone whose level is above that of all reference surfaces:

    >>> import numpy as np
    >>> import texclass as tx
    >>> x = 60.0 * np.sin(2 * np.pi * 200.0 * np.arange(20_000) / 10_000)
    >>> tone = tx.Recording(x, 10_000.0, "m/s^2", phases=tx.Phases(movement=(0, x.size)))
    >>> rough = tx.haptics.describe(tone).set_index("scale").loc["rough"]
    >>> print(f"{rough['value']:.1f}, {rough['excess']:.1f} {rough['excess_unit']} above the highest")
    10.0, 5.0 dB above the highest
    """
    inputs = [recordings] if isinstance(recordings, Recording | str | Path) else recordings
    reading: LoadingOptions = {
        "fs": fs,
        "unit": unit,
        "resample": resample,
        "column": column,
        "topic": topic,
        "delimiter": delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete,
    }
    loaded = [one if isinstance(one, Recording) else find_recording(one, **reading) for one in inputs]
    loaded = [_with_movement(recording) for recording in loaded]
    if references is None:
        reference_table, reference_unit = reference_surfaces(), "m/s^2"
    else:
        dataset = references if isinstance(references, Dataset) else open_dataset(references)
        reference_table, reference_unit = reference_features(dataset, n_jobs, progress), dataset[0].unit
    # Ranks need at least two different references.
    ranked_columns = [column for column in COLUMNS if reference_table[column].dropna().unique().size > 1]
    extraction = FeatureExtractor("scales").fit(loaded).extract(loaded)
    reasons = {(r.recording_id, r.feature): r.reason for r in extraction.reasons}
    rows = []
    for recording, features in zip(loaded, extraction.table.to_dict("records"), strict=True):
        resolution = _phase_resolution(recording)
        for name in SCALES:
            scale = select_scale(name, {column: features[column] for column in ranked_columns})
            reason = (
                resolution
                or reasons.get((recording.recording_id, scale.column.partition(".")[0]), "")
                or _rank_problem(scale, recording, reference_unit, scale.column in ranked_columns)
            )
            feature = np.nan if resolution else float(features[scale.column])
            ranked = reference_table[scale.column].dropna().sort_values()
            rows.append(
                {
                    "recording": recording.recording_id,
                    "scale": name,
                    "feature_value": feature,
                    "unit": scale.unit.replace("m/s^2", recording.unit),
                    "feature": scale.column,
                    "excess_unit": scale.excess_unit,
                    "reason": reason,
                    **({} if reason or np.isnan(feature) else _rank(scale, feature, ranked)),
                }
            )
    columns = [
        "recording", "scale", "value", "feature_value", "unit", "feature", "n_below", "n_references",
        "nearest", "excess", "excess_unit", "reason",
    ]  # fmt: skip
    description = pd.DataFrame(rows, columns=columns)
    description["nearest"] = [
        nearest if isinstance(nearest, tuple) else () for nearest in description["nearest"]
    ]
    return description.astype({"n_below": "Int64", "n_references": "Int64"})


def _rank(scale: Scale, feature: float, ranked: "pd.Series[float]") -> dict[str, Any]:
    """Return value, excess and neighbours of a feature value among sorted references."""
    n_below = int((ranked < feature).sum())
    return {
        "value": scale.value(feature, ranked),
        "n_below": n_below,
        "n_references": len(ranked),
        "nearest": tuple(ranked.index[max(n_below - 1, 0) : n_below + 1]),
        "excess": scale.excess(feature, ranked),
    }


def _with_movement(recording: Recording) -> Recording:
    """Return a recording of detected taps alone, whose vibration never rests, as one movement."""
    if recording.phases or recording.fs == PLACEHOLDER_FS or find_phases(recording).kind != "taps only":
        return recording
    x, n = combine(recording.acceleration), max(round(FRAME_S * recording.fs), 8)
    levels = x[: x.size // n * n].reshape(-1, n).std(axis=1)
    if levels.size < 2 or not np.median(levels) > levels.max() * 10 ** (-REST_DB / 20):
        return recording
    return recording.with_(phases=Phases(movement=(0, recording.n_samples)))


def _phase_resolution(recording: Recording) -> str:
    """Return why the resolution of the movement is too low, or ""; without a movement, that of the taps."""
    phases = find_phases(recording)
    parts = [phases.movement] if phases.movement else [(tap.start, tap.end) for tap in phases.taps]
    samples = [recording.acceleration[start:stop] for start, stop in parts or [(0, recording.n_samples)]]
    return resolution_problem(np.concatenate(samples), recording.fs)


def _rank_problem(scale: Scale, recording: Recording, reference_unit: str, has_references: bool) -> str:
    """Return why a feature value cannot be ranked among the references, or ""."""
    if recording.fs == PLACEHOLDER_FS:
        return "the sampling rate is missing. Pass fs"
    if scale.unit == LEVEL_UNIT and recording.unit != reference_unit:
        return (
            f"the unit must be that of the references, {reference_unit}, got {recording.unit}. "
            f"Pass the unit, or references in {recording.unit}"
        )
    return "" if has_references else "fewer than two different reference surfaces have this feature"


def reference_features(dataset: Dataset, n_jobs: int = 1, progress: Progress | None = None) -> pd.DataFrame:
    """Return the median features of each surface of a dataset.

    A surface has ridges if ridges are detected in at least half of its recordings.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings.
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Callback `progress(n_done, n_total, label)`, which counts recordings.
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
    ...     [["oak", "hard", 10.0, 500.0, "Hz", "damping", 24, 24, ("metal",), 0.5, "octaves", ""]],
    ...     columns=["recording", "scale", "value", "feature_value", "unit", "feature", "n_below",
    ...              "n_references", "nearest", "excess", "excess_unit", "reason"],
    ... )
    >>> report = description_document(description)
    >>> report.blocks[1], report.blocks[3]
    ('Hard.', ['hard: outside the reference surfaces, 0.5 octaves above the highest (metal)'])
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
        has_values = rows["value"].notna().any()
        summary = ", ".join(adjectives) or ("average" if has_values else "no values")
        blocks += [Heading(str(recording)), f"{summary}.".capitalize(), Table(table, n_narrow=3)]
        outside = [_outside_text(row) for row in rows.to_dict("records") if abs(row["excess"]) > 0]
        reasons = rows[rows["reason"] != ""].groupby("reason", sort=False)["scale"].agg(", ".join)
        blocks.append([*outside, *(f"{scales}: {reason}" for reason, scales in reasons.items())])
    blocks.append(
        [
            "0-10: rank among the reference surfaces; 0 is the lowest of them, 10 the highest.",
            "Above: number of reference surfaces with a lower value.",
            "Fine in 1/mm: ridges over the position of the tool, from its recorded speed; in Hz: no ridges, "
            "or no speed.",
        ]
    )
    return Document("Perceptual scales", blocks)


def _outside_text(row: Mapping[Any, Any]) -> str:
    """Return by how much a feature is outside the range of the references."""
    distance = f"{digits(abs(row['excess']))} {row['excess_unit']}".strip()
    end = "above the highest" if row["excess"] > 0 else "below the lowest"
    return f"{row['scale']}: outside the reference surfaces, {distance} {end} ({row['nearest'][0]})"
