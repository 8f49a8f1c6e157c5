"""What a result was computed with."""

import platform
from importlib.metadata import version

from texclass import __version__


def versions(*libraries: str) -> dict[str, str]:
    """Return the versions of texclass, Python and these installed distributions."""
    return {
        "texclass": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in libraries},
    }
