"""Files of trained models: arrays or a skops archive, facts about the model, a digest.

A model whose steps all have an array form is JSON beside arrays: it is read without scikit-learn or skops.
Any other is an archive of skops, of classes on the allow-list.
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
from texclass.evaluation.trusted import (
    SCHEMA,
    UntrustedFileError,
    archive_of,
    check_archive,
    foreign_in,
    load_trusted,
    members_of,
    read_bounded,
)
from texclass.features.phase_view import TURN
from texclass.features.plan import Plan
from texclass.phase_settings import PhaseSettings
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.validation import StrictModel, validate

FORMAT = 4
"""Version of the format of model files: a file of another version is refused."""
MANIFEST, ARRAYS = "manifest.json", "arrays.json"
"""Members that are none of skops; the second names its arrays by their members."""
MEMBERS = frozenset({MANIFEST, ARRAYS, SCHEMA})
Positive = Annotated[float, Field(gt=0, le=1e12)]
"""A rate in Hz, or a duration in seconds."""
GOLDEN = 0.6180339887498949


class ModelFileError(ValueError):
    """A model file cannot be used; the message names the file and the rule."""


class Manifest(StrictModel):
    """The facts of a model: written as JSON beside its arrays, readable without them.

    Attributes
    ----------
    surfaces
        Surfaces it knows, sorted.
    pipeline
        name, row, classifier and hash of what was trained; few, where recordings were too few to choose by;
        the budget in ms, and whose ms they are, and in kB.
    features
        Features it computes.
    phases
        What it needs of a recording: "tap", "movement", "friction".
    fs
        Sampling rate of its recordings in Hz.
    unit
        Of their acceleration, as kept.
    input
        How files become such recordings.
    trained_on
        name, hash and number of recordings (and windows) of the dataset.
    accuracy
        mean, low, high (95 %), n_tested, protocol, why it, how: of held-out recordings, the choice included;
        untold: what of the recordings to come they cannot tell; later: low and high of later ones, by what
        became of them in other data sets, where those held out cannot tell.
    calibration
        method, beta, lapse, expected calibration error on held-out recordings, n_bins; of touches also
        correlation (of those of one recording) and n_contacts (recordings). What `KnownGesture.of` reads:
        confusion (row m: mean probabilities answered where m was felt), repetition (correlation of answers
        about one surface, by one operator in one session).
    unknown
        score, false_alarms, level (p-value of the threshold), threshold, n of held-out recordings,
        stretch (of distances, by drift).
    cost
        segmentation_ms, features_ms and classifier_ms per recording, on the machine that trained it.
    window_s
        Seconds of movement of one answer; None: whole recordings.
    versions
        Of texclass, Python and libraries.
    shortest_s
        Movement of about the shortest recording trained on, in seconds.
    loudest
        Largest acceleration of the recordings trained on, from the median of its axis.
    adapted
        Empty, or what another sensor told: references (each its name, and its surface or None), their hash,
        map (affine, shift or none), threshold_by (what the threshold of unknown surfaces stands on), scale
        (10, 50, 90 % of columns). The accuracy, calibration and n_tested above remain those of the training.
    native_fs
        Lowest rate in Hz of the sensors, below `fs` where recordings were resampled; None: as `fs`.
    phase_settings
        Settings by which phases are found; the file lists those that differ from the defaults.
    format_version
        Version of the format of the file.
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
    loudest: Annotated[float, Field(gt=0)] | None = None
    adapted: Mapping[str, Any] = {}
    native_fs: Positive | None = None
    phase_settings: PhaseSettings = PhaseSettings()
    format_version: int = FORMAT

    @field_serializer("phase_settings")
    def _only_changes(self, settings: PhaseSettings) -> dict[str, Any]:
        return settings.changes

    def to_json(self) -> str:
        """Return it as JSON."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, indent=1)


def read_manifest(text: bytes | str) -> Manifest:
    """Read the facts of a model.

    Raises
    ------
    ValueError
        If they are of another version of the format, or not the facts of a model.
    """
    try:
        stated = json.loads(text)
        version = stated.get("format_version")
        made_by = str(dict(stated.get("versions", {})).get("texclass", "?"))
        stated.pop("digest", None)
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"its manifest cannot be read ({type(error).__name__}: {error})") from error
    if version != FORMAT:
        raise ValueError(
            f"its format is {version!r:.20}, written by texclass {made_by:.20}. Expected format {FORMAT}: "
            "train the model again with `texclass train`, or update texclass"
        )
    return validate(Manifest, stated, "its manifest")


def write_model_file(
    path: str | Path, document: Mapping[str, Any], manifest: Manifest, *, is_arrays: bool
) -> None:
    """Write a model file: complete, or not at all; the same bytes for the same model.

    Parameters
    ----------
    path : str or Path
        The file.
    document : mapping
        Plain data, arrays and, unless `is_arrays`, estimators of scikit-learn.
    manifest : Manifest
        The facts.
    is_arrays : bool
        Whether it is written without skops.

    Raises
    ------
    ValueError
        If it would hold a class that nobody could load again, or the suffix is another one.
    """
    check_suffix(path, ".skops")
    if not is_arrays and (foreign := unsafe_classes(document)):
        raise ValueError(f"{path}: {foreign[0]} cannot be saved. Expected classes that load safely")
    members = _array_members(document) if is_arrays else dict(members_of(archive_of(dict(document))))
    stated = json.loads(manifest.to_json())
    stated["digest"] = digest_of(stated, members)
    members[MANIFEST] = json.dumps(stated, sort_keys=True, indent=1).encode()
    buffer = io.BytesIO()
    with ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(ZipInfo(name), content)
    write_atomic(Path(path), buffer.getvalue())


def _array_members(document: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the members of a document of plain data and arrays: each array once, however often it occurs."""
    names: dict[bytes, str] = {}

    def as_json(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return value.item() if isinstance(value, np.generic) else dict(value)
        np.save(buffer := io.BytesIO(), value, allow_pickle=False)
        return {"array": names.setdefault(buffer.getvalue(), f"{len(names) + 1}.npy")}

    text = json.dumps(document, sort_keys=True, default=as_json)
    return {**{name: content for content, name in names.items()}, ARRAYS: text.encode()}


def unsafe_classes(document: Mapping[str, Any]) -> list[str]:
    """Return the classes in a document that nobody could load again, sorted."""
    return foreign_in(archive_of(dict(document)))


def read_manifest_of(path: str | Path) -> Manifest:
    """Return what a model file says of itself, its digest checked; no object is made of it.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelFileError
        If it is no whole model file, was changed, or is of another format.
    """
    return _checked_file(path)[0]


def read_model_file(path: str | Path) -> tuple[Mapping[str, Any], Manifest]:
    """Return what `write_model_file` wrote.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelFileError
        If it is no whole model file, was changed, is of another format, or names a class that is not trusted.
    """
    manifest, members, data = _checked_file(path)

    def array_or_mapping(stated: dict[str, Any]) -> Any:
        if stated.keys() != {"array"}:
            return stated
        return np.load(io.BytesIO(members[stated["array"]]), allow_pickle=False)

    try:
        if SCHEMA in members:
            document = load_trusted(data, members=MEMBERS)
        else:
            document = json.loads(members[ARRAYS], object_hook=array_or_mapping)
        if not isinstance(document, dict):
            raise ValueError(f"it holds a {type(document).__name__}. Expected a model of texclass")
    except UntrustedFileError as error:
        raise ModelFileError(f"{path}: {error}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelFileError(f"{path}: it cannot be read ({type(error).__name__}: {error})") from error
    return document, manifest


def _checked_file(path: str | Path) -> tuple[Manifest, Mapping[str, bytes], bytes]:
    """Return the facts of a model file, its members without these, and its bytes."""
    try:
        data = read_bounded(path)
        check_archive(data, MEMBERS)
        members = dict(members_of(data))
        if MANIFEST not in members:
            raise ValueError("it has no manifest. Expected a file that `texclass train` wrote")
        text = members.pop(MANIFEST)
        manifest = read_manifest(text)
        stated = json.loads(text)
        if stated.pop("digest", None) != digest_of(stated, members):
            raise ValueError("it was changed since it was written: its digest is another; train it again")
        if (ARRAYS in members) == (SCHEMA in members):
            raise ValueError(f"it must hold either {ARRAYS} or {SCHEMA}; train it again")
    except ValueError as error:
        raise ModelFileError(f"{path}: {error}") from error
    return manifest, members, data


def digest_of(manifest: Mapping[str, Any], members: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of facts and members; it tells of damage and edits, and not who wrote the file."""
    digest = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode())
    for name in sorted(members):
        digest.update(f"\0{name}\0{len(members[name])}\0".encode() + members[name])
    return digest.hexdigest()


def probe_values(plan: Plan, fs: float, unit: str) -> Samples:
    """Return the plan's columns (n_columns,) for a made-up recording; NaN where undefined.

    They tell whether the code that computes features still gives the same values: the recording, with one tap
    and a movement, is the same on every machine. Its noise is a Weyl sequence, frac(k^2 golden): no generator
    of random numbers has to stay the same.
    """
    n = max(64, min(round(1.5 * fs), 1_000_000))  # 1.5 s
    turn = tuple(name for name in plan.channels if name in TURN)
    channels = plan.channels[: len(plan.channels) - len(turn)] or ("x", "y", "z")
    axes = np.column_stack([_noise(n, i) for i in range(len(channels))])
    first, last = n // 10, n // 5
    axes[:first] *= 0.01
    axes[first:last] *= np.exp(-np.linspace(0, 8, last - first))[:, None]
    probe = Recording(
        axes,
        fs=fs,
        unit=unit,
        recording_id="probe",
        channels=channels,
        friction=1 + 0.1 * _noise(n, 7),
        turn_rate=np.column_stack([_noise(n, 8 + i) for i in range(3)]) if turn else None,
        phases=Phases((Tap(first // 2, first, last),), (last, n), last),
    )
    return plan.compute(probe).values


def changed_value(before: Samples, now: Samples, columns: tuple[str, ...]) -> str | None:
    """Return which column differs most between two computations of the probe; None if none does."""
    scale = np.maximum(np.maximum(np.abs(before), np.abs(now)), 1e-9)
    gap = np.abs(before - now) / scale
    gap[np.isnan(before) != np.isnan(now)] = np.inf
    gap = np.nan_to_num(gap, nan=0.0, posinf=np.inf)
    worst = int(gap.argmax())
    # A relative difference of 1e-4 changes no answer: machines round otherwise, and spectra are single.
    if gap[worst] <= 1e-4:
        return None
    return f"{columns[worst]} was {before[worst]:.6g}, is {now[worst]:.6g}"


def _noise(n: int, seed: int) -> Samples:
    k = np.arange(n, dtype=np.float64)
    white = np.modf((k + 1 + 1000 * seed) ** 2 * GOLDEN)[0] - 0.5
    smooth = np.convolve(white, [0.5, 0.3, 0.2], "same")
    return np.asarray(smooth + 0.1 * np.sin(0.05 * (1 + 0.1 * seed) * k))
