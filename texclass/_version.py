"""The version, alone in its module so that the build and the CLI read it without importing anything."""

__version__ = "0.3.0"
