"""Read WAV and FLAC files.

With the unit "counts", integer audio keeps its integer values (-32768 to 32767 for 16 bit). With any other
unit, integer audio is scaled so that full scale is 1. Floating-point audio is unchanged.
"""

from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from texclass.loaders.columns import ACCELERATION
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    as_samples,
    check_announced_size,
    reader_error,
    require_columns,
    wrap_library_errors,
)

_BITS = {"PCM_S8": 8, "PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32}
"""Bits per sample by encoding; libsndfile left-aligns samples in 32-bit integers."""


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the name of the only signal, which contains all channels."""
    return (ACCELERATION,)


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read all channels and the sampling rate.

    Raises
    ------
    RecordingError
        If the file is unreadable or truncated.
    """
    require_columns(wanted, (ACCELERATION,), path)
    with wrap_library_errors(path, "audio"):
        _check_length(path)
        with soundfile.SoundFile(path) as file:
            check_announced_size(file.frames * file.channels, path)
            bits = _BITS.get(file.subtype) if settings.unit == "counts" else None
            samples: Any = file.read(dtype="int32" if bits else "float64")
            frames, fs = file.frames, float(file.samplerate)
        if len(samples) < frames:
            problem = f"contains {len(samples)} of the {frames} frames stated in its header"
            raise reader_error(path, problem, "a complete file")
        if bits:
            np.right_shift(samples, 32 - bits, out=samples)
        return ReadSignals({ACCELERATION: as_samples(samples, ACCELERATION, path)}, fs)


def _check_length(path: Path) -> None:
    """Raise an error for a truncated RIFF file, which libsndfile would read without an error."""
    with path.open("rb") as file:
        head = file.read(8)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little")
    is_piped = announced == 0xFFFFFFFF  # a streamed file has no length in its header
    if head[:4] == b"RIFF" and not is_piped and announced + 8 > size:
        raise reader_error(
            path, f"contains {size} of the {announced + 8} bytes stated in its header", "a complete file"
        )
