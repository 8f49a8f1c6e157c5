"""Sources of blocks by name: standard input, a recording, a bag, a ROS 2 topic."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from texclass.loaders import find_recording
from texclass.loaders.single import checked_unit
from texclass.recognition.blocks import BLOCK_S, Block, BlockSource, block_size
from texclass.recognition.model import Model
from texclass.recognition.needs import ACCELERATION_ONLY, Needs
from texclass.recognition.resampling import Resampled
from texclass.recognition.source import Source, find_like
from texclass.recognition.standard_input import LineSource, RawSource
from texclass.recording import Recording, RecordingError

ROS2 = "ros2:"


class RecordingSource:
    """A recording as if it were live.

    Parameters
    ----------
    recording : Recording
        Its acceleration is what is yielded, its flags come with the first block.
    block_s : float
        Seconds a block.
    paced : bool
        Wait until each block would have been recorded; else as fast as they are taken.
    needs : Needs
        Signals beside the acceleration that are yielded, too.

    Raises
    ------
    RecordingError
        If the recording lacks one of these.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        block_s: float = BLOCK_S,
        paced: bool = False,
        needs: Needs = ACCELERATION_ONLY,
    ) -> None:
        self.recording, self.paced = recording, paced
        self._n = block_size(block_s, recording.fs)
        self._signal = needs.columns_of(recording)

    def __iter__(self) -> Iterator[Block]:
        """Yield the blocks of the recording."""
        recording, signal = self.recording, self._signal
        start = time.monotonic()
        for first in range(0, len(signal), self._n):
            samples = signal[first : first + self._n]
            if self.paced:
                time.sleep(max(0.0, start + (first + len(samples)) / recording.fs - time.monotonic()))
            flags = recording.flags if first == 0 else ()
            yield Block(first / recording.fs, samples, recording.fs, recording.unit, 0, flags)

    def close(self) -> None:
        """Nothing is open."""


def open_source(
    spec: str,
    *,
    fs: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    block_s: float = BLOCK_S,
    paced: bool = False,
    raw_channels: int | None = None,
    file: BinaryIO | None = None,
    model: Model | None = None,
) -> BlockSource:
    """Return the source of a name.

    Parameters
    ----------
    spec : str
        "-" (standard input), "FILE" or "DATASET:RECORDING", "bag:FILE?topic=/name", "ros2:/topic".
    fs : float, optional
        Sampling rate in Hz; needed for standard input, measured on a topic, else checked against the file.
    unit : str, optional
        Of the acceleration; needed where the source does not state it.
    rate : float, optional
        Rate in Hz to resample to, band-limited.
    block_s : float
        Seconds a block, of files and standard input.
    paced : bool
        Play a file at its own speed.
    raw_channels : int, optional
        Standard input is float32 of so many channels, not text.
    file : BinaryIO, optional
        In place of standard input.
    model : Model, optional
        Whose columns are wanted: with turn rate or friction beside the acceleration if it needs them. Files
        and bags are then read and conditioned as those it was trained on; what `is_live` is as it comes.

    Returns
    -------
    source : BlockSource

    Raises
    ------
    RecordingError
        If a fact is missing or contradicted, the file is bad, or the source has not what the model needs.
    """
    needs = ACCELERATION_ONLY if model is None else Needs.of(model)
    source: BlockSource
    if spec == "-":
        source = _standard_input(fs, unit, block_s, raw_channels, file or sys.stdin.buffer, needs)
    elif spec.startswith(ROS2):
        source = _topic(spec.removeprefix(ROS2), fs, unit, needs)
    else:
        found = (
            find_recording(spec, fs=fs, unit=unit)
            if model is None
            else find_like(Source.of_dict(model.manifest.input), spec, fs=fs, unit=unit)
        )
        source = RecordingSource(found, block_s=block_s, paced=paced, needs=needs)
    return source if rate is None else Resampled(source, rate)


def is_live(spec: str) -> bool:
    """Whether the samples of a source are as they come, not yet conditioned as a model's training files."""
    return spec == "-" or spec.startswith(ROS2)


def _standard_input(
    fs: float | None,
    unit: str | None,
    block_s: float,
    raw_channels: int | None,
    file: BinaryIO,
    needs: Needs,
) -> BlockSource:
    stated = checked_unit(Path("standard input"), fs, unit)
    if fs is None:
        raise RecordingError(
            "standard input: fs is missing; the rule is a rate in Hz, never guessed: give --fs"
        )
    if raw_channels is None:
        return LineSource(file, fs=fs, unit=stated, block_s=block_s)
    source = RawSource(file, fs=fs, unit=stated, n_channels=raw_channels, block_s=block_s)
    needs.n_axes(raw_channels)
    return source


def _topic(topic: str, fs: float | None, unit: str | None, needs: Needs) -> BlockSource:
    try:
        from texclass.recognition.robot.live import TopicSource
    except ImportError as error:
        raise RecordingError(
            f"{ROS2}{topic}: needs the extra `robot` ({error}): pip install texclass[robot]"
        ) from error
    return TopicSource(topic, fs=fs, unit=unit, needs=needs)
