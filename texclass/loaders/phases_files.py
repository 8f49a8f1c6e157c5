"""Files NAME.phases.json with the phases that a user marked in a recording; they replace the detection.

`texclass inspect FILE --edit` writes a page on which users mark taps, movement and surfaces. A file lies next
to its recording, and the loaders use it whenever they read the recording.
"""

import hashlib
import json
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from texclass.loaders.data_files import PHASES_SUFFIX, normalize_name
from texclass.loaders.exports import find_export
from texclass.loaders.readers import BAG_METADATA, reader_error
from texclass.loaders.source_files import axis_files, recording_name, recording_path
from texclass.recording import Phases, Recording, RecordingError, Tap
from texclass.reporting.wording import counted
from texclass.validation import StrictModel, validate

MAX_BYTES = 1 << 24
"""Largest size of a file in bytes, enough for 100 000 taps."""
REMEDY = "Correct or remove this file; without it, the phases are detected"
MARKED = "phases from "
"""Start of the note of phases that were read from a file."""


class Interval(StrictModel):
    """Part of a recording, in s from its first sample.

    Attributes
    ----------
    start_s, end_s
        Time of the first sample, and time after the last sample.
    """

    start_s: float = Field(ge=0, description="a time of at least 0 s")
    end_s: float


class MarkedTap(Interval):
    """Tap: hand motion from `start_s` to `impact_s`, impact and decay from `impact_s` to `end_s`.

    Attributes
    ----------
    impact_s
        Time of the first sample of the contact.
    width_s, quality
        Fields `width` (in s) and `quality` of a detected `Tap`.
    """

    impact_s: float
    width_s: float = Field(default=0.0, ge=0)
    quality: float = Field(default=1.0, ge=0, le=1)


class MarkedSurface(Interval):
    """Part of a recording in which the tool explores one surface.

    Attributes
    ----------
    surface
        Surface label.
    """

    surface: str = Field(max_length=200, pattern=r"\S", description="a name")


class PhasesFile(StrictModel):
    """Content of a file NAME.phases.json.

    Attributes
    ----------
    format, version
        Kind of the file, and its version.
    recording
        Name of the recording's file or folder.
    duration_s
        Duration of the recording in s.
    fs_hz
        Sampling rate in Hz of the recording in which the phases were marked.
    taps
        Taps in order of time.
    movement
        Intervals of movement in order of time. Several intervals require `surfaces`.
    surfaces
        Parts of the recording with different surfaces, in order of time; empty if there is one surface. Each
        part becomes a recording, which has the taps and at most one interval of movement within the part.
    sha256
        SHA-256 of the files of the recording; "" if unknown.
    """

    format: Literal["texclass phases"]
    version: Literal[1]
    recording: str = Field(min_length=1)
    duration_s: float = Field(gt=0)
    fs_hz: float = Field(gt=0)
    taps: tuple[MarkedTap, ...]
    movement: tuple[Interval, ...]
    surfaces: tuple[MarkedSurface, ...] = ()
    sha256: str = Field(default="", pattern=r"^([0-9a-f]{64})?$", description="64 hexadecimal digits")

    @model_validator(mode="after")
    def _is_consistent(self) -> "PhasesFile":
        problems = []
        end = self.duration_s + 1 / self.fs_hz
        lists: dict[str, Sequence[Interval]] = {"movement": self.movement, "surfaces": self.surfaces}
        for key, intervals in {"taps": self.taps, **lists}.items():
            for number, interval in enumerate(intervals, start=1):
                where = f"{key}.{number}"
                if not interval.start_s < interval.end_s:
                    problems.append(
                        f"{where}.end_s is {interval.end_s:g}. Expected a time after start_s, "
                        f"{interval.start_s:g} s"
                    )
                if interval.end_s > end:
                    problems.append(
                        f"{where}.end_s is {interval.end_s:g}. Expected at most the duration of the "
                        f"recording, {self.duration_s:g} s"
                    )
                if isinstance(interval, MarkedTap) and not (
                    interval.start_s <= interval.impact_s < interval.end_s
                ):
                    problems.append(
                        f"{where}.impact_s is {interval.impact_s:g}. Expected a time from start_s, "
                        f"{interval.start_s:g} s, to end_s, {interval.end_s:g} s"
                    )
            for number, (one, other) in enumerate(pairwise(intervals), start=2):
                if other.start_s < one.end_s - 0.5 / self.fs_hz:
                    problems.append(
                        f"{key}.{number}.start_s is {other.start_s:g}. Expected at least the end of "
                        f"{key}.{number - 1}, {one.end_s:g} s: intervals in order of time, no overlap"
                    )
        if not problems and (problem := self._movement_problem()):
            problems.append(problem)
        if problems:
            n_more = len(problems) - 3
            raise ValueError("; ".join(problems[:3]) + (f" (and {n_more} more)" if n_more > 0 else ""))
        return self

    def _movement_problem(self) -> str:
        expected = "Expected one interval per surface: mark each surface, or join the intervals"
        if len(self.movement) > 1 and not self.surfaces:
            return f"movement has {len(self.movement)} intervals, but surfaces is empty. {expected}"
        for number, part in enumerate(self.surfaces, start=1):
            n = sum(one.start_s < part.end_s and part.start_s < one.end_s for one in self.movement)
            if n > 1:
                return f"surfaces.{number} contains {n} intervals of movement. {expected}"
        return ""

    @classmethod
    def read(cls, path: Path) -> "PhasesFile":
        """Read a file.

        Raises
        ------
        RecordingError
            If the file is unreadable or not valid; the message names the keys and values.
        """
        try:
            with path.open("rb") as file:
                data = file.read(MAX_BYTES + 1)
            if len(data) > MAX_BYTES:
                raise ValueError(f"{path}: larger than {MAX_BYTES} bytes. Expected a file of marked phases")
            try:
                content = json.loads(data.decode("utf-8-sig"))
            except (ValueError, RecursionError) as error:
                raise ValueError(f"{path}: not valid JSON ({error})") from error
            return validate(cls, content, path)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
        except ValueError as error:
            raise RecordingError(f"{error}. {REMEDY}") from error

    @classmethod
    def from_phases(cls, phases: Phases, recording: Recording, path: Path) -> "PhasesFile":
        """Return the content for the phases of a recording, which was read from `path`."""
        fs = recording.fs
        # A later tap may begin during the decay.
        starts = [*(tap.start for tap in phases.taps[1:]), recording.n_samples]
        taps = [
            MarkedTap(
                start_s=tap.start / fs,
                impact_s=tap.impact / fs,
                end_s=max(min(tap.end, start), tap.impact + 1) / fs,
                width_s=tap.width / fs,
                quality=tap.quality,
            )
            for tap, start in zip(phases.taps, starts, strict=False)
        ]
        movement = [] if phases.movement is None else [phases.movement]
        spans = tuple(Interval(start_s=start / fs, end_s=stop / fs) for start, stop in movement)
        return cls(
            format="texclass phases",
            version=1,
            recording=file_name(path),
            duration_s=recording.duration_s,
            fs_hz=fs,
            taps=tuple(taps),
            movement=spans,
            sha256=_sha256(path),
        )

    def check(self, recording: Recording, path: Path, where: Path) -> None:
        """Check that the phases belong to a recording.

        Parameters
        ----------
        recording : Recording
            Recording, read from `path`.
        path : Path
            File of the recording.
        where : Path
            File of the phases, for messages.

        Raises
        ------
        RecordingError
            If the duration or the content of the recording differs.
        """
        # Resampling may add or drop a sample at either rate.
        if abs(recording.duration_s - self.duration_s) > 2 / min(recording.fs, self.fs_hz):
            raise reader_error(
                where,
                f"was saved for a recording of {self.duration_s:.6g} s at {self.fs_hz:g} Hz, but {path} has "
                f"{recording.duration_s:.6g} s at {recording.fs:g} Hz",
                f"the same recording and sampling rate. {REMEDY}",
            )
        name = file_name(path)
        if self.sha256 and self.sha256 != _sha256(path):
            what = f"for {self.recording!r}" if self.recording != name else f"before {name!r} changed"
            raise reader_error(
                where,
                f"was saved {what}: the content of {path} differs",
                f"the same content. {REMEDY}",
            )
        if not self.sha256 and self.recording != name:
            raise reader_error(where, f"recording is {self.recording!r}", f"{name!r}. {REMEDY}")

    def phases(self, recording: Recording, part: int = 0, notes: tuple[str, ...] = ()) -> Phases:
        """Return the phases of a recording, or of one of its marked surfaces.

        Parameters
        ----------
        recording : Recording
            Whole recording.
        part : int
            Number of the marked surface, from 1; 0 (default) for the whole recording.
        notes : tuple of str
            Notes of the phases.

        Returns
        -------
        Phases
            Phases in samples from the start of the recording or part. If the whole recording has several
            intervals of movement, its movement reaches from the first to the last.
        """
        first, last = self.span(recording, part)

        def sample(time_s: float) -> int:
            return min(max(round(time_s * recording.fs), first), last) - first

        taps = [
            Tap(
                sample(tap.start_s),
                sample(tap.impact_s),
                max(sample(tap.end_s), sample(tap.impact_s) + 1),
                round(tap.width_s * recording.fs),
                tap.quality,
            )
            for tap in self.taps
            if first <= round(tap.impact_s * recording.fs) < last
        ]
        spans = [(sample(one.start_s), sample(one.end_s)) for one in self.movement]
        spans = [(start, stop) for start, stop in spans if start < stop]
        movement = (spans[0][0], spans[-1][1]) if spans else None
        onset = movement[0] if movement and movement[0] > 0 else None
        return Phases(tuple(taps), movement, onset, notes)

    def span(self, recording: Recording, part: int) -> tuple[int, int]:
        """Return the samples [start, stop) of a marked surface, or of the whole recording for part 0."""
        if part == 0:
            return 0, recording.n_samples
        interval = self.surfaces[part - 1]
        start, stop = (round(time_s * recording.fs) for time_s in (interval.start_s, interval.end_s))
        return start, min(max(stop, start + 1), recording.n_samples)

    def to_json(self) -> str:
        """Return the content of the file."""
        return json.dumps(self.model_dump(), indent=1, ensure_ascii=False) + "\n"


def phases_path(path: Path) -> Path:
    """Return the path of the phases file of a recording, which may not exist.

    Parameters
    ----------
    path : Path
        Any file of the recording, or its folder.

    Returns
    -------
    Path
        `oak_01.phases.json` for `oak_01.txt`, for `oak_01_X.txt` with its other axes, and for the folder of a
        bag or export `oak_01`.
    """
    path = recording_path(path)
    name = path.name if path.is_dir() else recording_name(path, axis_files(path))
    return path.with_name(f"{name}{PHASES_SUFFIX}")


def find_phases_file(path: Path) -> PhasesFile | None:
    """Read the phases file of a recording; None if there is none.

    If two recordings have the same name and different suffixes, the file belongs to the one that it names.

    Parameters
    ----------
    path : Path
        Any file of the recording, or its folder.

    Raises
    ------
    RecordingError
        If the file is not valid.
    """
    file = phases_path(path)
    if not file.is_file():
        return None
    content = PhasesFile.read(file)
    is_of_other = (
        content.recording != file_name(path) and file.with_name(Path(content.recording).name).exists()
    )
    return None if is_of_other else content


def use_marked_phases(recording: Recording, path: Path, part: int = 0) -> Recording:
    """Return a recording with the phases that a user marked, if there is a phases file.

    Parameters
    ----------
    recording : Recording
        Whole recording.
    path : Path
        Any file of the recording, or its folder.
    part : int
        Number of the marked surface to cut out, from 1; 0 (default) for the whole recording.

    Raises
    ------
    RecordingError
        If the phases file is not valid, belongs to another recording, or has no such part.
    """
    content = find_phases_file(path)
    n_parts = len(content.surfaces) if content else 0
    if part > n_parts:
        expected = f"a number from 1 to {n_parts}" if n_parts else f"{recording.source or path} without #"
        problem = f"there is no part {part}: {counted(n_parts, 'surface')} marked in {phases_path(path)}"
        raise reader_error(f"{path}#{part}", problem, expected)
    if content is None:
        return recording
    content.check(recording, path, phases_path(path))
    note = f"{MARKED}{phases_path(path).name}, not detected"
    if part == 0 and n_parts:
        name = Path(recording.source or path).name
        note += f"; {counted(n_parts, 'surface')} marked, {name}#1 is the first"
    phases = content.phases(recording, part, (note,))
    if part == 0:
        return recording.with_(phases=phases)
    start, stop = content.span(recording, part)
    return recording.cut(start, stop, f"{recording.recording_id}#{part}").with_(
        phases=phases, surface=normalize_name(content.surfaces[part - 1].surface)
    )


def is_marked(recording: Recording) -> bool:
    """Return whether the phases of a recording are from a phases file."""
    phases = recording.phases
    return phases is not None and any(note.startswith(MARKED) for note in phases.notes)


def marked_note(n: int, unit: str = "recording") -> str:
    """Return the note that the phases of `n` recordings are from phases files."""
    return f"phases of {counted(n, unit)} from NAME{PHASES_SUFFIX}, not detected"


def split_part(name: str | Path) -> tuple[str, int]:
    """Split the name of one marked surface into the name of the recording and the number of the surface.

    Examples
    --------
    >>> split_part("session.csv#2"), split_part("session.csv")
    (('session.csv', 2), ('session.csv', 0))
    """
    match = re.fullmatch(r"(.+)#([1-9]\d{0,5})", str(name))
    if match is None or Path(name).expanduser().exists():
        return str(name), 0
    return match[1], int(match[2])


def file_name(path: Path) -> str:
    """Return the name of the file or folder of a recording; with several axes, of the first file."""
    path = recording_path(path)
    return path.name if path.is_dir() else next(iter(axis_files(path).values())).name


def _sha256(path: Path) -> str:
    """Return the SHA-256 of the files with the acceleration of a recording."""
    path = recording_path(path)
    files = list(axis_files(path).values())
    if path.is_dir():
        export = find_export(path)
        files = [path / (export.acceleration if export else BAG_METADATA)]
    digest = hashlib.sha256()
    for name in files:
        with name.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()
