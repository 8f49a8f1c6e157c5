"""Write vibrations as WAV files for haptic devices or for listening, and read such files.

A JSON comment (LIST/INFO ICMT) contains the unit, the peak and the exact sampling rate. 32-bit float files
contain the samples in this unit. 16-bit PCM files contain the samples divided by the peak, which has the code
32767. Audible files are 16-bit PCM at 48 kHz, which any player accepts. Their comment also contains the gain,
1 / peak.
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
"""Integer code of the peak in 16-bit files."""
MAX_FS = 1e9
"""Largest sampling rate of a file in Hz."""
AUDIBLE_FS = 48_000.0
"""Sampling rate of audible files in Hz."""
AUDIBLE_INPUT_FS, MAX_SHIFT_HZ = (20.0, 1e6), 10_000.0
"""Range of sampling rates in Hz that can be converted to 48 kHz, and largest frequency shift in Hz."""
_SUBTYPES = {"float32": "FLOAT", "pcm16": "PCM_16", "audible": "PCM_16"}


@dataclass(frozen=True, eq=False)
class Vibration:
    """A vibration read from a WAV file.

    Attributes
    ----------
    samples : ndarray of shape (n_samples,) or (n_samples, n_channels)
        Vibration in `unit`.
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit; "arbitrary" (with full scale 1) if the file contains no texclass comment.
    peak : float
        Largest magnitude before writing, in `unit`.
    shift_hz : float
        Frequency shift of audible files in Hz (default 0).
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
    """Write a vibration as a WAV file.

    Parameters
    ----------
    path : str or Path
        File to write; must end in `.wav`.
    samples : array_like of shape (n_samples,) or (n_samples, n_channels)
        Vibration in `unit`, at least one sample.
    fs : float
        Sampling rate in Hz. The header contains the rounded value, the comment the exact value.
    unit : str
        Unit: m/s^2 (default), g, mg, counts, V or arbitrary.
    encoding : {"float32", "pcm16", "audible"}
        Sample format. "pcm16" has a rounding error of at most peak / 65534. "audible" applies `to_audible`
        and then "pcm16".
    shift_hz : float
        Frequency shift in Hz (default 0), for "audible" only; see `to_audible`.

    Raises
    ------
    ValueError
        If an argument is invalid.
    OSError
        If the file cannot be written; no partial file remains.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "tone.wav"
    >>> tone = np.sin(2 * np.pi * 100 * np.arange(500) / 1000)
    >>> vibration = read_wav(write_wav(path, 3 * tone, 1000, unit="m/s^2"))
    >>> vibration.fs, vibration.unit, vibration.samples.shape
    (1000.0, 'm/s^2', (500,))
    """
    path, x = check_suffix(path, ".wav"), np.asarray(samples, dtype=np.float64)
    if encoding not in get_args(Encoding) or unit not in UNITS:
        raise ValueError(
            f"encoding must be one of {get_args(Encoding)} and unit one of {UNITS}, "
            f"got {encoding!r} and {unit!r}"
        )
    if x.ndim not in (1, 2) or not x.size or not np.all(np.isfinite(x)):
        raise ValueError(
            f"samples must be finite and of shape (n,) or (n, n_channels) with n >= 1, got shape {x.shape}"
        )
    if not 1 <= fs <= MAX_FS:
        raise ValueError(f"fs must be between 1 and {MAX_FS:g} Hz, got {fs}")
    if encoding == "audible":
        x, fs = to_audible(x, fs, shift_hz=shift_hz), AUDIBLE_FS
    elif shift_hz:
        raise ValueError(f"shift_hz requires encoding 'audible', got {shift_hz} Hz with {encoding!r}")
    peak = float(np.abs(x).max())
    if peak > float(np.finfo(np.float32).max):
        raise ValueError(f"the peak must be representable as a 32-bit float, got {peak:g}")
    if encoding == "float32":
        codes: NDArray[Any] = x.astype(np.float32)
    else:
        codes = np.rint(x / (peak or 1.0) * FULL_SCALE).astype(np.int16)
    channels = 1 if x.ndim == 1 else x.shape[1]
    gain = 1 / max(peak, 1e-300) if encoding == "audible" else None
    comment = _Comment(texclass=1, unit=unit, peak=peak, fs=float(fs), gain=gain, shift_hz=float(shift_hz))
    buffer = io.BytesIO()
    with soundfile.SoundFile(buffer, "w", round(fs), channels, _SUBTYPES[encoding], format="WAV") as file:
        file.comment = json.dumps(comment.model_dump(exclude_defaults=True))
        file.write(codes)
    write_atomic(path, buffer.getvalue())
    return path


def to_audible(samples: ArrayLike, fs: float, *, shift_hz: float = 0.0) -> Samples:
    """Resample a vibration to 48 kHz, and shift its frequencies into the range of small loudspeakers.

    Parameters
    ----------
    samples : array_like of shape (n_samples,) or (n_samples, n_channels)
        Vibration in any unit.
    fs : float
        Sampling rate in Hz.
    shift_hz : float
        Frequency shift in Hz (default 0) by single-sideband modulation, which preserves level and duration.

    Returns
    -------
    ndarray of shape (m,) or (m, n_channels)
        Vibration in the unit of the samples, with m = ceil(n_samples * 48000 / fs).

    Raises
    ------
    ValueError
        If `fs` is not between 20 Hz and 1 MHz, or the shift is not between 0 and 10,000 Hz.
    """
    if not AUDIBLE_INPUT_FS[0] <= fs <= AUDIBLE_INPUT_FS[1]:
        raise ValueError(
            f"fs must be between 20 and 1e6 Hz for audible files, got {fs} Hz. Use encoding 'float32'"
        )
    if not 0 <= shift_hz <= MAX_SHIFT_HZ:
        raise ValueError(f"shift_hz must be between 0 and {MAX_SHIFT_HZ:g} Hz, got {shift_hz}")
    x = np.asarray(samples, dtype=np.float64)
    x = resample(x, fs, AUDIBLE_FS)
    if not shift_hz:
        return x
    analytic = hilbert(x, next_fast_len(len(x)), axis=0)[: len(x)]
    carrier = np.exp(2j * np.pi * shift_hz / AUDIBLE_FS * np.arange(len(x)))
    return np.asarray((analytic.T * carrier).T.real)


def resample(x: Samples, fs: float, new_fs: float) -> Samples:
    """Resample samples (n, ...) to another rate in Hz, band-limited to half the lower of the two rates."""
    ratio = Fraction(new_fs / fs).limit_denominator(1000)
    return np.asarray(resample_poly(x, ratio.numerator, ratio.denominator, axis=0))


def read_wav(path: str | Path) -> Vibration:
    """Read a vibration from a WAV file, in physical units if the file contains a texclass comment.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the file is not a complete WAV file of float or 16-bit samples, or its comment is invalid.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = write_wav(pathlib.Path(tempfile.mkdtemp()) / "pulse.wav", [0.0, 2.5, 0.0], 1000, unit="g")
    >>> vibration = read_wav(path)
    >>> vibration.samples.tolist(), vibration.unit, vibration.peak
    ([0.0, 2.5, 0.0], 'g', 2.5)
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a regular file. Expected a file, not a folder, pipe or device")
    with path.open("rb") as file:
        head = file.read(12)
    size, declared_size = path.stat().st_size, int.from_bytes(head[4:8], "little") + 8
    if (
        head[:4] != b"RIFF" or head[8:] != b"WAVE" or declared_size > size
    ):  # libsndfile accepts incomplete files
        raise ValueError(
            f"{path} is not a complete WAV file: it has {size} bytes, but the header declares "
            f"{declared_size}. Expected a RIFF WAVE file"
        )
    try:
        with soundfile.SoundFile(path) as file:
            if file.format not in ("WAV", "WAVEX") or file.subtype not in _SUBTYPES.values():
                raise ValueError(
                    f"{path} has the format {file.format} {file.subtype}. Expected WAV with FLOAT or PCM_16"
                )
            codes = file.read(dtype="int16" if file.subtype == "PCM_16" else "float64")
            rate, frames, comment = float(file.samplerate), file.frames, file.comment
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise ValueError(f"{path} cannot be read as WAV ({error}). Expected a WAV file") from error
    if len(codes) < frames or not codes.size or not np.all(np.isfinite(codes)):
        raise ValueError(
            f"{path} must contain {frames} frames, as declared in its header, and at least one, with finite "
            f"samples, got {len(codes)} frames"
        )
    if '"texclass"' not in comment:
        x = codes / 32768.0 if codes.dtype == np.int16 else codes
        return Vibration(x, rate, "arbitrary", float(np.abs(x).max()))
    try:
        content = from_json(comment, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: the comment is not valid JSON ({error}). Write the file again") from error
    note = validate(_Comment, content, f"{path}: comment")
    if not abs(note.fs - rate) <= 0.5:
        raise ValueError(
            f"{path}: fs is {note.fs!r:.40} in the comment but {rate:g} in the header. Write the file again"
        )
    x = codes * (note.peak / FULL_SCALE) if codes.dtype == np.int16 else codes
    return Vibration(x, note.fs, note.unit, note.peak, note.shift_hz)


class _Comment(StrictModel):
    """JSON comment in WAV files written by texclass."""

    texclass: int
    unit: Unit
    peak: float = Field(ge=0, lt=1e39)
    fs: float
    gain: float | None = Field(default=None, gt=0)
    shift_hz: float = Field(default=0.0, ge=0, le=MAX_SHIFT_HZ)
