"""What a live source yields: blocks of samples, and what was wrong on the way."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from texclass.recording import Samples

BLOCK_S = 0.025
"""Seconds of a block, by default."""


@dataclass(frozen=True, eq=False)
class Block:
    """Samples that follow each other at a uniform rate.

    Attributes
    ----------
    t_s : float
        Instant of the first sample, seconds: by the clock of the stamps of a topic, else since the start.
    samples : ndarray of shape (n, n_channels)
        n is 0 in a block that only reports (nothing came for a while).
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the samples.
    lost : int
        Samples missing between the block before and this one: what is not to be bridged must start anew.
    flags : tuple of str
        What was wrong since the block before: gaps, duplicates, clock jumps, a wrong rate.
    """

    t_s: float
    samples: Samples
    fs: float
    unit: str
    lost: int = 0
    flags: tuple[str, ...] = ()


class BlockSource(Protocol):
    """Anything that yields blocks; all of one source share channels and unit."""

    def __iter__(self) -> Iterator[Block]:
        """Yield blocks until the source ends."""
        ...

    def close(self) -> None:
        """Let go of files and connections."""
        ...


def block_size(block_s: float, fs: float) -> int:
    """Return the samples of a block of so many seconds at fs Hz, at least one.

    Raises
    ------
    ValueError
        If it has no length.
    """
    if not block_s > 0:
        raise ValueError(f"block_s is {block_s}; the rule is above 0")
    return max(1, round(block_s * fs))
