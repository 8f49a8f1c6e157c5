"""Read WAV and FLAC.

Integer audio does not state its unit: with the unit "counts" its codes are kept, -32768 ... 32767 for 16 bit;
else full scale is 1. Floating-point audio is kept as stored.
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
"""Bits of a code, by libsndfile's name of the encoding; libsndfile aligns codes to the top of 32 bit."""


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the name that all channels have."""
    return (ACCELERATION,)


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read all channels and the sampling rate.

    Raises
    ------
    RecordingError
        If the file is unreadable or shorter than its header says.
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
            raise reader_error(
                path, f"holds {len(samples)} of {frames} frames that its header announces", "all"
            )
        if bits:
            np.right_shift(samples, 32 - bits, out=samples)
        return ReadSignals({ACCELERATION: as_samples(samples, ACCELERATION, path)}, fs)


def _check_length(path: Path) -> None:
    """Refuse a RIFF file that is shorter than it announces, which libsndfile would read without a word."""
    with path.open("rb") as file:
        head = file.read(8)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little")
    is_piped = announced == 0xFFFFFFFF  # its length was not known when the header was written
    if head[:4] == b"RIFF" and not is_piped and announced + 8 > size:
        raise reader_error(path, f"holds {size} of {announced + 8} bytes that its header announces", "all")
