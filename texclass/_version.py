"""Version of texclass, in a separate module that the build and the CLI can read without other imports."""

__version__ = "0.3.0"
