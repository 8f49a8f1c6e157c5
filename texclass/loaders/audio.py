"""WAV and FLAC.

Integer audio says nothing of its unit. With `options.codes` (a card's or user's unit "counts") the integer
codes are kept, -32768 ... 32767 for 16 bit; else full scale is 1. Floating-point audio is kept as stored.
"""

from pathlib import Path

import numpy as np
import soundfile

from texclass.loaders.columns import UNNAMED, Columns, ReadOptions, as_samples, check_held
from texclass.recording import RecordingError

CODE_BITS = {"PCM_S8": 8, "PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32}
"""Bits of a code, by libsndfile's name of the encoding; libsndfile aligns codes to the top of 32 bit."""
_STREAMED = 0xFFFFFFFF


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the one name under which all channels are read."""
    return (UNNAMED,)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read all channels and the sampling rate of the header.

    Raises
    ------
    RecordingError
        If it is not audio, or is shorter than its header says.
    """
    _check_whole(path)
    try:
        with soundfile.SoundFile(path) as file:
            check_held(file.frames * file.channels, path)
            bits = CODE_BITS.get(file.subtype) if options.codes else None
            samples = file.read(dtype="int32" if bits else "float64")
            frames, fs = file.frames, float(file.samplerate)
    except (soundfile.SoundFileError, RuntimeError, MemoryError) as error:
        raise RecordingError(f"{path}: not readable as audio ({error})") from error
    if len(samples) < frames:
        raise RecordingError(
            f"{path}: holds {len(samples)} of {frames} frames that its header announces; the rule is all"
        )
    codes = np.right_shift(samples, 32 - bits, out=samples) if bits else samples
    return Columns({UNNAMED: as_samples(codes, UNNAMED, path)}, fs)


def _check_whole(path: Path) -> None:
    """Refuse a truncated RIFF file, which libsndfile would read without a word."""
    with path.open("rb") as file:
        head = file.read(8)
    size, announced = path.stat().st_size, int.from_bytes(head[4:8], "little")
    if head[:4] == b"RIFF" and announced != _STREAMED and announced + 8 > size:
        raise RecordingError(
            f"{path}: holds {size} of {announced + 8} bytes that its header announces; the rule is all"
        )
