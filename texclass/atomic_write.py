"""Atomic writes of files, checked suffixes of output files, and the folder of caches."""

import contextlib
import os
import time
import uuid
from pathlib import Path

import platformdirs


def cache_root() -> Path:
    """Return the folder for what can be computed again: $TEXCLASS_CACHE, else the user's cache folder."""
    stated = os.environ.get("TEXCLASS_CACHE")
    return Path(stated).expanduser() if stated else platformdirs.user_cache_path("texclass")


def check_suffix(path: str | Path, *suffixes: str) -> Path:
    """Return the path of an output file after checking that its suffix, in any case, is one of some.

    Raises
    ------
    ValueError
        If it is not; the message lists them.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        formats = " or ".join(filter(None, suffixes))
        raise ValueError(f"cannot write {path}: the suffix is {path.suffix!r}. Expected {formats}")
    return path


def sibling_path(path: Path, suffix: str, prefix: str = "") -> Path:
    """Return a path beside another one, by its name; file systems end names at 255 bytes."""
    name = path.name.encode()[: 200 - len(suffix)].decode(errors="ignore")
    return path.with_name(f"{prefix}{name}{suffix}")


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write a file that is either complete or what it was before; its folders are made.

    It is written under a name of its own beside the file, so that two processes (on two machines, or in two
    containers that count processes alike) may write the same one; the last one stands. What is no regular
    file (a pipe, a terminal) is written to as it is.

    Parameters
    ----------
    path : str or Path
        The file.
    content : bytes or str
        All that is to be in it; text is stored as UTF-8.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left behind.
    """
    data = content.encode() if isinstance(content, str) else content
    path = Path(path)
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    path = path.resolve()  # what a link leads to, not the link
    for attempt in range(3):
        unfinished = sibling_path(path, f".{os.getpid()}.{uuid.uuid4().hex[:8]}", ".")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished.write_bytes(data)
            unfinished.replace(path)
            return
        except (FileNotFoundError, PermissionError):
            # Another process removed the folder, having finished; or reads the file, on Windows.
            if attempt == 2:
                raise
            time.sleep(0.05)
        except OSError as error:  # a full disk is told without the file
            raise OSError(error.errno, error.strerror, str(path)) from error
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)


def write_if_possible(path: Path, content: bytes) -> None:
    """Write a file of the cache, whole; a full or read-only disk is no error."""
    with contextlib.suppress(OSError):
        write_atomic(path, content)
