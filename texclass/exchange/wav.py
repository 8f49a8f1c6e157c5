"""Rendered vibrations as WAV, with the unit and the peak inside.

A comment (LIST/INFO ICMT) holds, as JSON, the unit, the peak and the exact sampling rate. 32-bit float WAV
holds the samples in their unit; 16-bit PCM holds them divided by the peak, so that code 32767 is the peak.
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import soundfile
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic_core import from_json

from texclass.recording import UNITS, Samples, Unit
from texclass.validation import Written, checked
from texclass.whole_files import write_whole

Encoding = Literal["float32", "pcm16"]
FULL_SCALE = 32767
HIGHEST_FS = 1e9
_SUBTYPES = {"float32": "FLOAT", "pcm16": "PCM_16"}


@dataclass(frozen=True, eq=False)
class Vibration:
    """A vibration read from a WAV.

    Attributes
    ----------
    samples : ndarray of shape (n_samples,) or (n_samples, n_channels)
        In `unit`.
    fs : float
        Hz.
    unit : str
        "arbitrary" where the file does not say: full scale is 1 then.
    peak : float
        Largest magnitude before it was written, in `unit`.
    """

    samples: Samples
    fs: float
    unit: str
    peak: float


def write_wav(
    path: str | Path, samples: ArrayLike, fs: float, *, unit: str = "m/s^2", encoding: Encoding = "float32"
) -> Path:
    """Write a vibration as WAV.

    Parameters
    ----------
    path : str or Path
        Ends in `.wav`.
    samples : array_like of shape (n_samples,) or (n_samples, n_channels)
        In `unit`, at least one.
    fs : float
        Hz; the header has it rounded, the comment exactly.
    unit : str
        m/s^2, g, mg, counts, V or arbitrary.
    encoding : {"float32", "pcm16"}
        "pcm16" leaves a rounding error of at most peak / 65534.

    Raises
    ------
    ValueError
        If a value breaks a rule; the message names it.
    OSError
        If it cannot be written; nothing is left behind.
    """
    path, x = Path(path), np.asarray(samples, dtype=np.float64)
    if path.suffix.lower() != ".wav" or encoding not in get_args(Encoding) or unit not in UNITS:
        raise ValueError(
            f"{path}, {encoding!r}, {unit!r}; the rule is a name in .wav, {get_args(Encoding)} and {UNITS}"
        )
    if x.ndim not in (1, 2) or not x.size or not np.all(np.isfinite(x)):
        raise ValueError(f"samples have shape {x.shape}; the rule is (n,) or (n, channels), finite, n >= 1")
    if not 1 <= fs <= HIGHEST_FS:
        raise ValueError(f"fs is {fs}; the rule is 1 ... {HIGHEST_FS:g} Hz")
    peak = float(np.abs(x).max())
    if peak > float(np.finfo(np.float32).max):
        raise ValueError(f"peak is {peak:g}; the rule is what a 32-bit float holds")
    codes = (
        np.rint(x / (peak or 1.0) * FULL_SCALE).astype(np.int16)
        if encoding == "pcm16"
        else x.astype(np.float32)
    )
    channels = 1 if x.ndim == 1 else x.shape[1]
    note = _Note(texclass=1, unit=unit, peak=peak, fs=float(fs))
    made = io.BytesIO()
    with soundfile.SoundFile(made, "w", round(fs), channels, _SUBTYPES[encoding], format="WAV") as file:
        file.comment = json.dumps(note.model_dump())
        file.write(codes)
    write_whole(path, made.getvalue())
    return path


def read_wav(path: str | Path) -> Vibration:
    """Return the vibration of a WAV in physical units where it notes them.

    Raises
    ------
    ValueError
        If it is not a whole WAV of float or 16-bit samples, or its comment breaks a rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: is not a file; the rule is a regular file")
    with path.open("rb") as begin:
        head = begin.read(12)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little") + 8
    if head[:4] != b"RIFF" or head[8:] != b"WAVE" or announced > size:  # libsndfile would read a part
        raise ValueError(f"{path}: holds {size} bytes, no WAV of {announced}; the rule is a whole RIFF WAVE")
    try:
        with soundfile.SoundFile(path) as file:
            if file.format not in ("WAV", "WAVEX") or file.subtype not in _SUBTYPES.values():
                raise ValueError(f"{path}: is {file.format} {file.subtype}; the rule is WAV, FLOAT or PCM_16")
            stored = file.read(dtype="int16" if file.subtype == "PCM_16" else "float64")
            rate, frames, comment = float(file.samplerate), file.frames, file.comment
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise ValueError(f"{path}: not readable as WAV ({error})") from error
    if len(stored) < frames or not stored.size or not np.all(np.isfinite(stored)):
        raise ValueError(f"{path}: holds {len(stored)} of {frames} frames; the rule is all, finite, >= 1")
    if '"texclass"' not in comment:
        x = stored / 32768.0 if stored.dtype == np.int16 else stored
        return Vibration(x, rate, "arbitrary", float(np.abs(x).max()))
    try:
        content = from_json(comment, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: comment is not the JSON it should be ({error})") from error
    note = checked(_Note, content, f"{path}: comment")
    if not abs(note.fs - rate) <= 0.5:
        raise ValueError(
            f"{path}: comment has fs {note.fs!r:.40}, the header {rate:g}; the rule is the same, rounded"
        )
    x = stored * (note.peak / FULL_SCALE) if stored.dtype == np.int16 else stored
    return Vibration(x, note.fs, note.unit, note.peak)


class _Note(Written):
    """The comment in a WAV of ours."""

    texclass: int
    unit: Unit
    peak: float = Field(ge=0, lt=1e39)
    fs: float
