"""One thread for one recording: starting more takes longer than the work they would share."""

import functools
from typing import Any

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]


def single_threaded() -> Any:
    """Return a context in which linear algebra and scikit-learn use one thread."""
    return _libraries().limit(limits=1)


@functools.cache
def _libraries() -> Any:
    """Return the libraries with threads of their own; looking for them takes milliseconds."""
    return ThreadpoolController()
