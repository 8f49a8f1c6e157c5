"""Atomic writes, suffixes of output files, and the cache folder."""

import contextlib
import os
import time
import uuid
from importlib.util import find_spec
from pathlib import Path

import platformdirs


def cache_root() -> Path:
    """Return the cache folder: $TEXCLASS_CACHE, or the cache folder of the user."""
    folder = os.environ.get("TEXCLASS_CACHE")
    return Path(folder).expanduser() if folder else platformdirs.user_cache_path("texclass")


def check_suffix(path: str | Path, *suffixes: str) -> Path:
    """Return the path of an output file after checking its suffix.

    Parameters
    ----------
    path : str or Path
        Output file.
    *suffixes : str
        Valid suffixes in lower case; the case of the suffix of the path is ignored.

    Raises
    ------
    ValueError
        If the suffix is not valid, or the library that writes this format is not installed.

    Examples
    --------
    >>> check_suffix("table.CSV", ".csv", ".parquet").name
    'table.CSV'
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        formats = " or ".join(filter(None, suffixes))
        raise ValueError(f"cannot write {path}: the suffix is {path.suffix!r}. Expected {formats}")
    if path.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        raise ValueError(
            f"cannot write {path}: needs pyarrow, which is not installed: pip install 'texclass[parquet]', "
            "or write a .csv file"
        )
    return path


def sibling_path(path: Path, suffix: str, prefix: str = "") -> Path:
    """Add a prefix and suffix to the name of a file, and shorten the name to at most 255 bytes."""
    name = path.name.encode()[: 200 - len(suffix)].decode(errors="ignore")
    return path.with_name(f"{prefix}{name}{suffix}")


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write a file completely or not at all, and create missing folders.

    The content is written to a temporary file in the same folder, which then replaces the file. Several
    processes may write the same file; the last one wins. Pipes and terminals are written to directly.

    Parameters
    ----------
    path : str or Path
        File to write.
    content : bytes or str
        Complete content; text is stored as UTF-8.

    Raises
    ------
    OSError
        If the file cannot be written; the temporary file is removed.
    """
    data = content.encode() if isinstance(content, str) else content
    path = Path(path)
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    path = path.resolve()  # the target of a link, not the link itself
    for attempt in range(3):
        temporary = sibling_path(path, f".{os.getpid()}.{uuid.uuid4().hex[:8]}", ".")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(data)
            temporary.replace(path)
            return
        except (FileNotFoundError, PermissionError):
            # Another process may have removed the folder or, on Windows, may be reading the file.
            if attempt == 2:
                raise
            time.sleep(0.05)
        except OSError as error:  # the error for a full disk does not name the file
            raise OSError(error.errno, error.strerror, str(path)) from error
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_if_possible(path: Path, content: bytes) -> None:
    """Write a cache file atomically; ignore errors such as a full or read-only disk."""
    with contextlib.suppress(OSError):
        write_atomic(path, content)
