"""texclass: which surface is this, and how does it feel, from what a tool's accelerometer recorded."""

from texclass._version import __version__

__all__ = ["__version__"]
