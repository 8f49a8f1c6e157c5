"""Contract of a reader for arbitrary bytes, and its check on one input.

A reader returns a valid object, or raises a ValueError (of any subclass) or an OSError whose message names
the file. It warns of nothing, writes nothing, starts nothing, unpickles nothing, and leaves no file behind.
"""

import contextlib
import os
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fuzz.mutate import Mutator

MOST_SECONDS = 5.0
"""CPU time of one input; those of this study have at most 64 kB."""
MOST_GROWTH_MB = 256
"""By which one input may let the resident memory of the process grow."""
MOST_MESSAGE = 100_000
BAG_IN_FOLDER = "fuzzed_0.mcap.zstd"
"""Is read by the name of the file that stands for its folder."""
FORBIDDEN = (
    "pickle.find_class",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "os.forkpty",
    "subprocess.Popen",
    "socket.connect",
    "socket.bind",
    "ctypes.dlopen",
)
"""Audit events that no reader may cause; opening a file to write is one, too."""


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes
    ----------
    name : str
    seeds : callable
        Returns valid inputs (bytes).
    read : callable
        Takes the path of the input, or its bytes where there is no file name; raises AssertionError where
        what it got is not a valid object.
    mutate : Mutator
        Mutator for the structure of the inputs.
    file : str
        Name of the file that the bytes are put into; "" for readers of bytes.
    may_warn : tuple of type
        Documented warnings.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    mutate: Mutator
    file: str = ""
    may_warn: tuple[type[Warning], ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Outcome of an input: "accepted", "refused", or the violated part of the contract with its place."""

    kind: str
    detail: str = ""
    seconds: float = 0.0

    @property
    def broken(self) -> bool:
        return self.kind not in ("accepted", "refused")


class Watch:
    """Recorder of forbidden operations of a reader, installed once per process."""

    def __init__(self) -> None:
        self.seen: list[str] = []
        self.armed = False
        self.place = ""

    def install(self, place: Path) -> None:
        self.place = str(place)
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[object, ...]) -> None:
        if self.armed and (event in FORBIDDEN or (event == "open" and self._writes(arguments))):
            self.seen.append(f"{event} {str(arguments)[:120]}")

    def _writes(self, arguments: tuple[object, ...]) -> bool:
        flags = arguments[2] if isinstance(arguments[2], int) else 0
        writing = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        return bool(writing) and not str(arguments[0]).startswith((self.place, "/dev/null"))

    @contextlib.contextmanager
    def over(self) -> Iterator[None]:
        self.seen.clear()
        self.armed = True
        try:
            yield
        finally:
            self.armed = False


WATCH = Watch()


def judge(target: Target, data: bytes, place: Path) -> Verdict:
    """Run a reader on an input and return the verdict; the file remains in `place`."""
    given: Path | bytes = data
    if target.file:
        given = place / target.file
        given.write_bytes(data)
    before, grown = sorted(os.listdir(place)), _resident_mb()
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught, WATCH.over():
        warnings.simplefilter("always")
        kind, detail = _outcome(target, given)
    seconds = time.process_time() - start
    if kind in ("accepted", "refused"):
        warned = [w for w in caught if not issubclass(w.category, (*target.may_warn, ResourceWarning))]
        if WATCH.seen:
            kind, detail = "forbidden", WATCH.seen[0]
        elif sorted(os.listdir(place)) != before:
            kind, detail = "left files", str(sorted(set(os.listdir(place)) - set(before)))
        elif warned:
            first = warned[0]
            where = f"{Path(first.filename).name}:{first.lineno}"
            kind, detail = "warned", f"{first.category.__name__} at {where}: {str(first.message)[:80]}"
        elif _resident_mb() - grown > MOST_GROWTH_MB:
            kind, detail = "memory", f"more than {MOST_GROWTH_MB} MB"
        elif seconds > MOST_SECONDS:
            kind, detail = "slow", f"more than {MOST_SECONDS:g} s"
    return Verdict(kind, detail, seconds)


def _outcome(target: Target, given: Path | bytes) -> tuple[str, str]:
    try:
        target.read(given)
    except (ValueError, OSError) as error:
        message = str(error)
        if target.file and not _is_named(target, message):
            return "unnamed", signature(error)
        return ("refused", "") if len(message) < MOST_MESSAGE else ("long message", signature(error))
    except AssertionError as error:
        return "invalid object", f"{error} {signature(error)}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return "other exception", signature(error)
    return "accepted", ""


def _is_named(target: Target, message: str) -> bool:
    return target.file in message or (target.file == BAG_IN_FOLDER and "metadata.yaml" in message)


def signature(error: BaseException) -> str:
    """Return type, place in texclass and place of origin: findings with equal ones are one finding."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/texclass/" in f.filename.replace("\\", "/")]
    places = [f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in (*ours[-1:], *frames[-1:])]
    return f"{type(error).__name__} in {' < '.join(dict.fromkeys(places))}"


def _resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
