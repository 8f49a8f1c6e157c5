"""Compile functions with numba, and report which modules are compiled.

Compiled code is stored in numba's cache, so each machine compiles a function once. Callers import modules
with compiled functions late, because loading numba takes half a second.
"""

import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parent
reporters: list[Callable[[str], object]] = []
"""Functions that are called with the name of each function before it is compiled, except those of numba."""


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return `numba.njit(**options)`, whose functions are reported to `reporters` when they are compiled.

    Examples
    --------
    >>> names = []
    >>> reporters.append(names.append)
    >>> @njit()
    ... def double(x):
    ...     return 2 * x
    >>> double(4), [name.rpartition(".")[2] for name in names]
    (8, ['double'])
    >>> reporters.remove(names.append)
    """
    return _load_numba().njit(**options)  # type: ignore[no-any-return]


def has_compiled(*subpackages: str) -> bool:
    """Return whether numba's cache contains code of a module in one of the subpackages ("haptics.scene").

    Examples
    --------
    >>> has_compiled("reporting")  # has no compiled functions
    False
    """
    root = os.environ.get("NUMBA_CACHE_DIR")
    for subpackage in subpackages:
        folder = PACKAGE.joinpath(*subpackage.split("."))
        # Numba writes next to the source, or to a folder named after the source's folder and a hash.
        files = [*Path(root or _user_cache()).glob(f"{folder.name}_*/*.nbi")]
        files += [] if root else (folder / "__pycache__").glob("*.nbi")
        if files:
            return True
    return False


def _user_cache() -> str:
    """Return the folder in which numba stores compiled code if the package is read-only."""
    if sys.platform == "win32":
        return str(Path(os.environ.get("LOCALAPPDATA", "~")).expanduser() / "numba" / "numba" / "Cache")
    if sys.platform == "darwin":
        return str(Path("~/Library/Caches/numba").expanduser())
    return str(Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "numba")


@cache
def _load_numba() -> Any:
    """Import numba, and report the start of each compilation."""
    import numba
    from numba.core import event

    class Reporter(event.Listener):
        def on_start(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            if not function.__module__.startswith("numba."):
                for report in reporters:
                    report(f"{function.__module__}.{function.__qualname__}")

        def on_end(self, event: Any) -> None:
            """Do nothing: only starts are reported."""

    event.register("numba:compile", Reporter())  # type: ignore[no-untyped-call]
    return numba
