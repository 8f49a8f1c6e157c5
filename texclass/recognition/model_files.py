"""Model files: arrays or a skops archive, with a manifest and a digest.

A model whose steps all have an array form is stored as JSON and arrays, and is read without scikit-learn and
skops. Other models are skops archives of classes on the allow-list.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any
from zipfile import ZipFile, ZipInfo

import numpy as np
from pydantic import Field, field_serializer

from texclass.atomic_write import check_suffix, write_atomic
from texclass.evaluation.skops_archive import (
    SCHEMA,
    UnsafeFileError,
    check_archive,
    dump_archive,
    find_disallowed,
    load_archive,
    read_bounded,
    read_members,
)
from texclass.features.phase_view import SOUND_CHANNEL, TURN_CHANNELS
from texclass.features.plan import Plan
from texclass.phase_settings import PhaseSettings
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.validation import StrictModel, validate

FORMAT = 7
"""Version of the format of model files; files of other versions are refused."""
MANIFEST, ARRAYS = "manifest.json", "arrays.json"
"""Members of the archive that are not written by skops; the second one refers to the arrays."""
MEMBERS = frozenset({MANIFEST, ARRAYS, SCHEMA})
Positive = Annotated[float, Field(gt=0, le=1e12)]
"""Sampling rate in Hz, or duration in s."""
LATER_RECORDINGS = "later recordings"
"""Start of a condition in `accuracy["not_evaluated"]`: the tests do not cover later recordings."""
GOLDEN = 0.6180339887498949
"""Fractional part of the golden ratio, for the noise of the probe recording."""
PROBE_S = 1.5
"""Duration of the probe recording in s."""
PROBE_SAMPLES = (64, 1_000_000)
"""Smallest and largest length of the probe recording in samples."""
MAX_RELATIVE_CHANGE = 1e-4
"""Largest relative difference of a feature that is attributed to rounding on another machine."""


class ModelFileError(ValueError):
    """A model file cannot be used; the message names the file and the reason.

    Examples
    --------
    >>> from pathlib import Path
    >>> n_bytes = Path("damaged.skops").write_bytes(b"not a model")
    >>> read_manifest_of("damaged.skops")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    texclass.recognition.model_files.ModelFileError: damaged.skops: ...
    """


class Manifest(StrictModel):
    """Description of a model, which is stored as JSON in its file and shown by `texclass model`.

    Attributes
    ----------
    surfaces : tuple of str
        Surfaces of the training set, sorted.
    pipeline : mapping
        name, hash, feature_set, row, classifier; shortage (if there were too few recordings for a selection);
        budget (limits of latency and size).
    features : tuple of str
        Names of the features.
    phases : tuple of str
        Phases that a recording must have: "tap", "movement", "friction".
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit of the acceleration.
    input : TrainingFiles
        Settings that read other files like the training files.
    trained_on : mapping
        name and hash of the dataset, n_recordings, n_windows, left_out (skipped recordings).
    accuracy : mapping
        mean, low, high (95 % confidence interval) and n_tested of held-out recordings, corrected for the
        selection among n_candidates; protocol, reason, n_folds, description; not_evaluated (conditions that
        the tests do not cover); later_recordings (low, high and source of the range for later recordings);
        not_exportable and with_all_features of an exportable model.
    calibration : mapping
        method, beta, lapse, n, expected_error and error_by_chance on held-out recordings; prediction_sets
        (n, thresholds, n_halves, shift of the log odds, later_coverage in other datasets).
        Models of windows: correlation between windows of one recording, n_contacts (recordings). For
        exploration: confusion (row m contains the mean probabilities for recordings of surface m) and
        repetition_correlation (between repetitions by one operator in one session).
    unknown : mapping
        score, false_alarms, p_threshold, threshold, n held-out recordings, drift_factor (of distances).
    cost : mapping
        segmentation_ms, features_ms and classifier_ms per recording, on the training machine.
    window_s : float or None
        Length of a window in s; None for whole recordings.
    versions : mapping
        Versions of texclass, Python and libraries.
    shortest_s : float or None
        Duration of the shortest movement among some of the training recordings in s.
    peak_acceleration : float or None
        Largest deviation of the acceleration from the median of its axis, among some of the training
        recordings.
    contact : mapping
        level and spread of the training recordings, below which a recording has no contact; see
        `ContactLimits`. Empty if they have neither taps nor movements.
    adapted : mapping
        Empty, or the domain adaptation: references (name, and surface or None), hash, map ("affine", "shift"
        or "none"), threshold_from and sets_from (recordings that calibrate the threshold and the prediction
        sets), has_trained_variation (False if the variation within a surface is from other datasets), and the
        change of the columns (`texclass.recognition.adaptation.describe_map`). Accuracy and probabilities
        still describe the original model.
    auxiliary_fs : mapping
        Sampling rates in Hz of the signals that the model needs and whose rate differs from `fs`.
    native_fs : float or None
        Lowest native sampling rate of the sensors in Hz; below `fs` if recordings were resampled.
    phase_settings : PhaseSettings
        Settings of the segmentation; the file contains those that differ from the defaults.
    format_version : int
        Version of the file format.

    Examples
    --------
    >>> read_manifest_of("surface.skops").fs  # doctest: +SKIP
    10000.0
    """

    surfaces: tuple[str, ...]
    pipeline: Mapping[str, str]
    features: tuple[str, ...]
    phases: tuple[str, ...]
    fs: Positive
    unit: str
    input: TrainingFiles
    trained_on: Mapping[str, Any]
    accuracy: Mapping[str, Any]
    calibration: Mapping[str, Any]
    unknown: Mapping[str, Any]
    cost: Mapping[str, float]
    window_s: Positive | None
    versions: Mapping[str, str]
    shortest_s: Positive | None = None
    peak_acceleration: Annotated[float, Field(gt=0)] | None = None
    contact: Mapping[str, float] = {}
    adapted: Mapping[str, Any] = {}
    auxiliary_fs: Mapping[str, Positive] = {}
    native_fs: Positive | None = None
    phase_settings: PhaseSettings = PhaseSettings()
    format_version: int = FORMAT

    @field_serializer("phase_settings")
    def _only_changes(self, settings: PhaseSettings) -> dict[str, Any]:
        return settings.changes

    def to_json(self) -> str:
        """Return the manifest as JSON."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, indent=1)


def read_manifest(text: bytes | str) -> Manifest:
    """Read a manifest from JSON.

    Raises
    ------
    ValueError
        If it has another format version, or is not a manifest.
    """
    try:
        values = json.loads(text)
        version = values.get("format_version")
        writer = str(dict(values.get("versions", {})).get("texclass", "?"))
        values.pop("digest", None)
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"its manifest cannot be read ({type(error).__name__}: {error})") from error
    if version != FORMAT:
        raise ValueError(
            f"its format is {version!r:.20}, written by texclass {writer:.20}. Expected format {FORMAT}: "
            "train the model again with `texclass train`, or update texclass"
        )
    return validate(Manifest, values, "its manifest")


def write_model_file(
    path: str | Path, document: Mapping[str, Any], manifest: Manifest, *, is_arrays: bool
) -> None:
    """Write a model file atomically, with the same bytes for the same model.

    Parameters
    ----------
    path : str or Path
        File with the suffix `.skops`.
    document : mapping
        Plain data, arrays and, unless `is_arrays`, scikit-learn estimators.
    manifest : Manifest
        Description of the model.
    is_arrays : bool
        Whether the model is stored as arrays, without skops.

    Raises
    ------
    ValueError
        If the document contains a class that is not on the allow-list, or the suffix is wrong.
    """
    check_suffix(path, ".skops")
    if not is_arrays and (foreign := unsafe_classes(document)):
        raise ValueError(
            f"{path}: {foreign[0]} cannot be saved: it is not on the allow-list of model files. "
            "Use another classifier"
        )
    members = _array_members(document) if is_arrays else dict(read_members(dump_archive(dict(document))))
    values = json.loads(manifest.to_json())
    values["digest"] = digest_of(values, members)
    members[MANIFEST] = json.dumps(values, sort_keys=True, indent=1).encode()
    buffer = io.BytesIO()
    with ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(ZipInfo(name), content)
    write_atomic(Path(path), buffer.getvalue())


def _array_members(document: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the members of a document of plain data and arrays; equal arrays are stored once."""
    names: dict[bytes, str] = {}

    def as_json(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return value.item() if isinstance(value, np.generic) else dict(value)
        np.save(buffer := io.BytesIO(), value, allow_pickle=False)
        return {"array": names.setdefault(buffer.getvalue(), f"{len(names) + 1}.npy")}

    text = json.dumps(document, sort_keys=True, default=as_json)
    return {**{name: content for content, name in names.items()}, ARRAYS: text.encode()}


def unsafe_classes(document: Mapping[str, Any]) -> list[str]:
    """Return the classes in a document that are not on the allow-list, sorted."""
    return find_disallowed(dump_archive(dict(document)))


def read_manifest_of(path: str | Path) -> Manifest:
    """Read the manifest of a model file, and check its digest, without loading the model.

    Parameters
    ----------
    path : str or Path
        File written by `Model.save`.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ModelFileError
        If the file is not a complete model file, was changed, or has another format version.

    Examples
    --------
    >>> read_manifest_of("surface.skops").surfaces  # doctest: +SKIP
    ('cork', 'oak')
    """
    return _read_checked(path)[0]


def read_model_file(path: str | Path) -> tuple[Mapping[str, Any], Manifest]:
    """Return the document and manifest of a model file.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ModelFileError
        If the file is not a complete model file, was changed, has another format version, or contains a class
        that is not on the allow-list.
    """
    manifest, members, data = _read_checked(path)

    def array_or_mapping(values: dict[str, Any]) -> Any:
        if values.keys() != {"array"}:
            return values
        return np.load(io.BytesIO(members[values["array"]]), allow_pickle=False)

    try:
        if SCHEMA in members:
            document = load_archive(data, members=MEMBERS)
        else:
            document = json.loads(members[ARRAYS], object_hook=array_or_mapping)
        if not isinstance(document, dict):
            raise ValueError(f"it contains a {type(document).__name__}. Expected a model of texclass")
    except UnsafeFileError as error:
        raise ModelFileError(f"{path}: {error}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelFileError(f"{path}: it cannot be read ({type(error).__name__}: {error})") from error
    return document, manifest


def _read_checked(path: str | Path) -> tuple[Manifest, Mapping[str, bytes], bytes]:
    """Return the manifest of a model file, its other members, and its bytes, after checking the digest."""
    try:
        data = read_bounded(path)
        check_archive(data, MEMBERS)
        members = dict(read_members(data))
        if MANIFEST not in members:
            raise ValueError("it has no manifest. Expected a file written by `texclass train`")
        text = members.pop(MANIFEST)
        manifest = read_manifest(text)
        values = json.loads(text)
        if values.pop("digest", None) != digest_of(values, members):
            raise ValueError(
                "it was changed since it was written (wrong digest). Restore it, or train the model again"
            )
        if (ARRAYS in members) == (SCHEMA in members):
            raise ValueError(f"it must contain either {ARRAYS} or {SCHEMA}. Train the model again")
    except ValueError as error:
        raise ModelFileError(f"{path}: {error}") from error
    return manifest, members, data


def digest_of(manifest: Mapping[str, Any], members: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of manifest and members. It detects damage and edits, but is not a signature."""
    digest = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode())
    for name in sorted(members):
        digest.update(f"\0{name}\0{len(members[name])}\0".encode() + members[name])
    return digest.hexdigest()


def probe_values(plan: Plan, fs: float, unit: str) -> Samples:
    """Return the features (n_columns,) of a synthetic probe recording; NaN where undefined.

    The values reveal changes of the code of the features, because the probe recording (one tap and a
    movement) is the same on every machine. Its noise is a Weyl sequence, frac(k^2 golden), which does not
    depend on the version of a random number generator.

    Parameters
    ----------
    plan : Plan
        Features to compute.
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit of the acceleration.
    """
    n = max(PROBE_SAMPLES[0], min(round(PROBE_S * fs), PROBE_SAMPLES[1]))
    turn = tuple(name for name in plan.channels if name in TURN_CHANNELS)
    sound = SOUND_CHANNEL in plan.channels
    channels = plan.channels[: len(plan.channels) - len(turn) - sound] or ("x", "y", "z")
    axes = np.column_stack([_noise(n, i) for i in range(len(channels))])
    tap_start, tap_stop = n // 10, n // 5
    axes[:tap_start] *= 0.01
    axes[tap_start:tap_stop] *= np.exp(-np.linspace(0, 8, tap_stop - tap_start))[:, None]
    probe = Recording(
        axes,
        fs=fs,
        unit=unit,
        recording_id="probe",
        channels=channels,
        friction=1 + 0.1 * _noise(n, 7),
        turn_rate=np.column_stack([_noise(n, 8 + i) for i in range(3)]) if turn else None,
        sound=_noise(n, 11) if sound else None,
        phases=Phases((Tap(tap_start // 2, tap_start, tap_stop),), (tap_stop, n), tap_stop),
    )
    return plan.compute(probe).values


def changed_value(reference: Samples, current: Samples, columns: tuple[str, ...]) -> str | None:
    """Describe the column that differs most between two computations of the probe; None if none differs.

    Parameters
    ----------
    reference, current : ndarray of shape (n_columns,)
        Features of the probe at training, and with the current code.
    columns : tuple of str
        Names of the columns.
    """
    scale = np.maximum(np.maximum(np.abs(reference), np.abs(current)), 1e-9)
    gap = np.abs(reference - current) / scale
    gap[np.isnan(reference) != np.isnan(current)] = np.inf
    gap = np.nan_to_num(gap, nan=0.0, posinf=np.inf)
    worst = int(gap.argmax())
    if gap[worst] <= MAX_RELATIVE_CHANGE:
        return None
    return f"{columns[worst]} was {reference[worst]:.6g}, is {current[worst]:.6g}"


def _noise(n: int, seed: int) -> Samples:
    k = np.arange(n, dtype=np.float64)
    white = np.modf((k + 1 + 1000 * seed) ** 2 * GOLDEN)[0] - 0.5
    smooth = np.convolve(white, [0.5, 0.3, 0.2], "same")
    return np.asarray(smooth + 0.1 * np.sin(0.05 * (1 + 0.1 * seed) * k))
