"""What a piece of work costs: CPU seconds of this process, and its peak memory."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
MEGABYTE = 2**20


@dataclass
class Clock:
    """CPU seconds of this process (all threads), once the block that it times has ended."""

    seconds: float = 0.0


@contextmanager
def timed() -> Iterator[Clock]:
    """Time a block."""
    clock = Clock()
    start = time.process_time()
    yield clock
    clock.seconds = time.process_time() - start


class PeakMemory:
    """By how much the process has grown, at its largest, since this was made.

    Linux forgets the earlier peak when asked to. Elsewhere the peak of the whole life of the process counts,
    imports and compilation included, so the figure may be too low, never too high.
    """

    def __init__(self) -> None:
        try:
            RESET.write_text("5")
        except OSError:
            self.start = _lifelong_peak()
        else:
            self.start = _status("VmRSS")

    @property
    def megabytes(self) -> float:
        """Growth in MB (2^20 bytes)."""
        peak = _status("VmHWM") if STATUS.exists() else _lifelong_peak()
        return max(peak - self.start, 0) / MEGABYTE


def _status(field: str) -> int:
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith(field))
    return 1024 * int(line.split()[1])


def _lifelong_peak() -> int:
    import resource  # not on Windows

    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
