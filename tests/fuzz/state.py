"""What a worker and the driver share: counts and the input at hand in memory that outlives the worker."""

import mmap
import struct
from dataclasses import dataclass
from pathlib import Path

_HEAD = struct.Struct("<4Q2d2Q")
MOST_INPUT = 1 << 20


@dataclass
class Counts:
    """Of one target; `slowest_s` is CPU time, of an input of `slowest_bytes`; `size` is that at hand."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    broken: int = 0
    slowest_s: float = 0.0
    peak_mb: float = 0.0
    slowest_bytes: int = 0
    size: int = 0


class Shared:
    """Counts and the input at hand, in a mapped file."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(_HEAD.size + MOST_INPUT))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)

    def read(self) -> Counts:
        return Counts(*_HEAD.unpack_from(self._map))

    def write(self, counts: Counts) -> None:
        _HEAD.pack_into(self._map, 0, *vars(counts).values())

    def put(self, data: bytes, counts: Counts) -> None:
        """Remember an input before a reader has it."""
        counts.size = min(len(data), MOST_INPUT)
        self._map[_HEAD.size : _HEAD.size + counts.size] = data[:MOST_INPUT]
        self.write(counts)

    @property
    def at_hand(self) -> bytes:
        return bytes(self._map[_HEAD.size : _HEAD.size + self.read().size])
