"""Rendered vibrations as WAV, for ears or for devices, with the unit and the peak inside.

A comment (LIST/INFO ICMT) holds, as JSON, the unit, the peak and the exact sampling rate. 32-bit float WAV
holds the samples in their unit; 16-bit PCM holds them divided by the peak, so that code 32767 is the peak.
An audible one is such a PCM at 48 kHz, which any player takes; it also states the gain, 1 / peak.
"""

import io
import json
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import soundfile
from numpy.typing import ArrayLike, NDArray
from pydantic import Field
from pydantic_core import from_json
from scipy.fft import next_fast_len
from scipy.signal import hilbert, resample_poly

from texclass.atomic_write import check_suffix, write_atomic
from texclass.recording import UNITS, Samples, Unit
from texclass.validation import StrictModel, validate

Encoding = Literal["float32", "pcm16", "audible"]
FULL_SCALE = 32767
HIGHEST_FS = 1e9
AUDIBLE_FS = 48_000.0
HEARD_FROM, HIGHEST_SHIFT = (20.0, 1e6), 10_000.0
"""Sampling rates that are brought to 48 kHz, and what is added to frequencies at most, Hz."""
_SUBTYPES = {"float32": "FLOAT", "pcm16": "PCM_16", "audible": "PCM_16"}


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
    shift_hz : float
        By which all frequencies were moved up for ears; 0: not at all.
    """

    samples: Samples
    fs: float
    unit: str
    peak: float
    shift_hz: float = 0.0


def write_wav(
    path: str | Path,
    samples: ArrayLike,
    fs: float,
    *,
    unit: str = "m/s^2",
    encoding: Encoding = "float32",
    shift_hz: float = 0.0,
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
    encoding : {"float32", "pcm16", "audible"}
        "pcm16" leaves a rounding error of at most peak / 65534. "audible" is "pcm16" of what `audible`
        returns.
    shift_hz : float
        For "audible", see there.

    Raises
    ------
    ValueError
        If a value breaks a rule; the message names it.
    OSError
        If it cannot be written; nothing is left behind.
    """
    path, x = check_suffix(path, ".wav"), np.asarray(samples, dtype=np.float64)
    if encoding not in get_args(Encoding) or unit not in UNITS:
        raise ValueError(f"{encoding!r}, {unit!r}. Expected one of {get_args(Encoding)} and of {UNITS}")
    if x.ndim not in (1, 2) or not x.size or not np.all(np.isfinite(x)):
        raise ValueError(f"samples have shape {x.shape}. Expected (n,) or (n, channels), finite, n >= 1")
    if not 1 <= fs <= HIGHEST_FS:
        raise ValueError(f"fs is {fs}. Expected 1 ... {HIGHEST_FS:g} Hz")
    if encoding == "audible":
        x, fs = audible(x, fs, shift_hz=shift_hz), AUDIBLE_FS
    elif shift_hz:
        raise ValueError(f"shift_hz is {shift_hz} for {encoding!r}. Expected 0, but for 'audible'")
    peak = float(np.abs(x).max())
    if peak > float(np.finfo(np.float32).max):
        raise ValueError(f"peak is {peak:g}. Expected what a 32-bit float holds")
    if encoding == "float32":
        codes: NDArray[Any] = x.astype(np.float32)
    else:
        codes = np.rint(x / (peak or 1.0) * FULL_SCALE).astype(np.int16)
    channels = 1 if x.ndim == 1 else x.shape[1]
    gain = 1 / max(peak, 1e-300) if encoding == "audible" else None
    note = _Note(texclass=1, unit=unit, peak=peak, fs=float(fs), gain=gain, shift_hz=float(shift_hz))
    made = io.BytesIO()
    with soundfile.SoundFile(made, "w", round(fs), channels, _SUBTYPES[encoding], format="WAV") as file:
        file.comment = json.dumps(note.model_dump(exclude_defaults=True))
        file.write(codes)
    write_atomic(path, made.getvalue())
    return path


def audible(samples: ArrayLike, fs: float, *, shift_hz: float = 0.0) -> Samples:
    """Return a vibration at 48 kHz, its band moved up if asked: small loudspeakers play little below 200 Hz.

    Parameters
    ----------
    samples : array_like of shape (n_samples,) or (n_samples, n_channels)
    fs : float
        Hz.
    shift_hz : float
        Added to every frequency, Hz (one sideband of the analytic signal: the level and the duration stay).

    Returns
    -------
    ndarray of shape (ceil(n_samples * 48000 / fs),) or (the same, n_channels)
        In the unit of the samples.

    Raises
    ------
    ValueError
        If the rate is not 20 Hz ... 1 MHz, or the shift not 0 ... 10000 Hz.
    """
    if not HEARD_FROM[0] <= fs <= HEARD_FROM[1]:
        raise ValueError(f"fs is {fs} Hz. Expected 20 to 1e6 Hz for audible files, or encoding 'float32'")
    if not 0 <= shift_hz <= HIGHEST_SHIFT:
        raise ValueError(f"shift_hz is {shift_hz}. Expected 0 ... {HIGHEST_SHIFT:g} Hz")
    x = np.asarray(samples, dtype=np.float64)
    x = resampled(x, fs, AUDIBLE_FS)
    if not shift_hz:
        return x
    both = hilbert(x, next_fast_len(len(x)), axis=0)[: len(x)]
    turned = np.exp(2j * np.pi * shift_hz / AUDIBLE_FS * np.arange(len(x)))
    return np.asarray((both.T * turned).T.real)


def resampled(x: Samples, fs: float, wanted: float) -> Samples:
    """Return samples (n, ...) at another rate (Hz) without what lies above half of the lower one."""
    ratio = Fraction(wanted / fs).limit_denominator(1000)
    return np.asarray(resample_poly(x, ratio.numerator, ratio.denominator, axis=0))


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
        raise ValueError(f"{path}: is not a file. Expected a regular file")
    with path.open("rb") as begin:
        head = begin.read(12)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little") + 8
    if head[:4] != b"RIFF" or head[8:] != b"WAVE" or announced > size:  # libsndfile would read a part
        raise ValueError(f"{path}: holds {size} bytes, no WAV of {announced}. Expected a whole RIFF WAVE")
    try:
        with soundfile.SoundFile(path) as file:
            if file.format not in ("WAV", "WAVEX") or file.subtype not in _SUBTYPES.values():
                raise ValueError(f"{path}: is {file.format} {file.subtype}. Expected WAV, FLOAT or PCM_16")
            stored = file.read(dtype="int16" if file.subtype == "PCM_16" else "float64")
            rate, frames, comment = float(file.samplerate), file.frames, file.comment
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise ValueError(f"{path}: not readable as WAV ({error})") from error
    if len(stored) < frames or not stored.size or not np.all(np.isfinite(stored)):
        raise ValueError(f"{path}: holds {len(stored)} of {frames} frames. Expected all, finite, >= 1")
    if '"texclass"' not in comment:
        x = stored / 32768.0 if stored.dtype == np.int16 else stored
        return Vibration(x, rate, "arbitrary", float(np.abs(x).max()))
    try:
        content = from_json(comment, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: comment is not the JSON it should be ({error})") from error
    note = validate(_Note, content, f"{path}: comment")
    if not abs(note.fs - rate) <= 0.5:
        raise ValueError(
            f"{path}: comment has fs {note.fs!r:.40}, the header {rate:g}. Expected the same, rounded"
        )
    x = stored * (note.peak / FULL_SCALE) if stored.dtype == np.int16 else stored
    return Vibration(x, note.fs, note.unit, note.peak, note.shift_hz)


class _Note(StrictModel):
    """The comment in a WAV of ours."""

    texclass: int
    unit: Unit
    peak: float = Field(ge=0, lt=1e39)
    fs: float
    gain: float | None = Field(default=None, gt=0)
    shift_hz: float = Field(default=0.0, ge=0, le=HIGHEST_SHIFT)
