"""Version of texclass, alone in its module so that the build and the CLI can read it without imports."""

__version__ = "0.3.0"
