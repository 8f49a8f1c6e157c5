"""All fuzzing targets: name, module, and number of inputs per million."""

import importlib

from fuzz.contract import Target
from texclass.loaders.readers import FORMATS

SHARES: dict[str, dict[str, int]] = {
    "recordings": {
        **{suffix[1:]: 25_000 for suffix in FORMATS},
        "table of rows": 8_000,
        "table of labels": 60_000,
        "lines of standard input": 120_000,
        "float32 of standard input": 100_000,
    },
    "bags": {
        "rosbag1": 40_000,
        "rosbag2 mcap": 20_000,
        "rosbag2 sqlite3": 12_000,
        "rosbag2 compressed as a whole": 5_000,
        "ros messages": 150_000,
        "ros messages on the wire": 60_000,
    },
    "definitions": {
        "dataset card": 15_000,
        "feature set": 12_000,
        "pipeline": 8_000,
        "scene": 15_000,
        "path of a hand": 6_000,
        "result for the page": 15_000,
    },
    "exchange": {
        "texture": 20_000,
        "planned scene": 10_000,
        "taps": 8_000,
        "HaTT XML": 40_000,
        "MPEG haptics": 20_000,
        "AHAP": 20_000,
        "rendered WAV": 40_000,
    },
    "models": {
        "model": 1_500,
        "recogniser": 2_000,
        "manifest": 50_000,
        "feature table": 5_000,
        "part of an extraction": 6_000,
        "cached movements": 40_000,
        "cached recording": 10_000,
        "outcome of a baseline": 10_000,
    },
}
"""Module -> name -> parts; those that read a file in C, or many files, are slower and get fewer."""


LIBRARIES = {"robot": ("rosbags", "mcap", "cyclonedds"), "formats": ("openpyxl", "nptdms")}
"""Extra of texclass -> the libraries that its readers import."""


def parts_of() -> dict[str, int]:
    """Return the parts of every reader."""
    return {name: parts for named in SHARES.values() for name, parts in named.items()}


def target_of(name: str) -> Target:
    """Return a reader; its module is imported only now.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    module = next((module for module, named in SHARES.items() if name in named), None)
    if module is None:
        raise ValueError(f"no reader is named {name!r}. Expected one of {', '.join(parts_of())}")
    target: dict[str, Target] = {one.name: one for one in importlib.import_module(f"fuzz.{module}").TARGETS}
    return target[name]
