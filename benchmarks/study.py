"""Shared functions of studies: one thread, command line, interleaved timing, JSON and Markdown reports."""

# ruff: noqa: E402  (the number of threads is set before the imports that use it; child processes inherit it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from texclass.provenance import code_provenance, loaded_places, versions
from texclass.reporting import Document, Table, render_markdown
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import save_figure

R = TypeVar("R")
ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "simulation": ("phases", "phases_families", "realism", "invariance", "rank_agreement", "scales"),
    "vibrations": ("score_nulls", "autoregressive", "line_spectrum", "prony"),
    "speed": ("feature_speed", "whole_path", "scaling", "two_processes", "cluster"),
    "haptics": ("scene", "scene_page", "c_renderer", "hjif", "packed_surfaces"),
    "certainty": (
        "cluster_interval",
        "calibration",
        "unknown_surfaces",
        "prediction_sets",
        "few_recordings",
        "later_recordings",
        "sensor_adaptation",
        "drift",
        "channels",
    ),
    "robot": (
        "stream",
        "borealtc-driven",
        "active_exploration",
        "dds",
        "window_baselines_biotac20",
        "onnx",
        "kernel_size",
    ),
    "tests": ("mutation", "fuzzing"),
}
"""Pages with several studies. Any other study has its own page."""
LIBRARIES = {
    "numpy": "numpy", "scipy": "scipy", "sklearn": "scikit-learn", "pywt": "PyWavelets", "librosa": "librosa",
    "numba": "numba", "onnx": "onnx", "onnxruntime": "onnxruntime", "cyclonedds": "cyclonedds",
}  # fmt: skip
"""Modules and their distributions, whose versions are written into the results."""


def command_line(description: str | None, folder: str = "studies", **options: Any) -> argparse.Namespace:
    """Parse the command line of a study with options defined by their defaults, and `--out` for the report.

    The default False defines a flag, None an optional path, and a type a required argument. A tuple or a
    range defines one or more values of its type (for strings: out of these), by default all of them.

    This also limits loaded libraries to one thread and sets the default folder of recordings
    (`set_data_folder`).
    """
    threadpool_limits(1)
    set_data_folder()
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in (options | {"out": ROOT / "reports" / folder}).items():
        settings: dict[str, Any] = {
            "type": type(default),
            "default": default,
            "help": f"{default} by default",
        }
        if default is False:
            settings = {"action": "store_true"}
        elif default is None or isinstance(default, type):
            settings = {"type": default or Path, "required": default is not None}
        elif isinstance(default, Sequence) and not isinstance(default, str):
            kind: Any = type(default[0]) if default else str
            choices = default if default and kind is str else None
            settings = {"type": kind, "nargs": "+", "action": "extend", "choices": choices}
        parser.add_argument(f"--{name.replace('_', '-')}", **settings)
    args = parser.parse_args()
    for name, default in options.items():
        if default is not None and getattr(args, name) is None:
            setattr(args, name, list(default))
    return args


def set_data_folder() -> None:
    """Set `$TEXCLASS_DATA` to `../shared/data` next to the project, unless it is set already."""
    os.environ.setdefault("TEXCLASS_DATA", str(ROOT.parent / "shared" / "data"))


def timed(call: Callable[[], R], clock: Callable[[], float] = time.thread_time) -> tuple[R, float]:
    """Return the result of a call and its run time in s: CPU time of this thread, or another clock."""
    start = clock()
    result = call()
    return result, clock() - start


def in_turns(
    calls: Mapping[str, Callable[[], object]],
    n_rounds: int,
    n_warm: int = 2,
    clock: Callable[[], float] = time.thread_time,
) -> pd.DataFrame:
    """Return the run time in s of each call (column) in each round; the calls alternate within a round.

    Other processes on the machine then slow all calls equally: compare medians or minima of the columns.
    """
    rounds = [{name: timed(call, clock)[1] for name, call in calls.items()} for _ in range(n_warm + n_rounds)]
    return pd.DataFrame(rounds[n_warm:])


def table(
    rows: pd.DataFrame | Iterable[Mapping[str, Any]], columns: str, caption: str = "", n_words: int = 1
) -> Table:
    """Return a table of rows. `columns` defines the title and the cell format of each column.

    For instance ``table([{"n": 5, "mean": 0.9}], "recordings = {n} | accuracy = {mean:.1%}")``.
    """
    titles, cells = zip(*(column.split(" = ") for column in columns.split(" | ")), strict=True)
    records = rows.to_dict("records") if isinstance(rows, pd.DataFrame) else rows
    filled = [[cell.format_map(row) for cell in cells] for row in records]
    return Table(pd.DataFrame(filled, columns=list(titles)), caption, n_words)


def interval(estimate: Mapping[str, Any], middle: str = "accuracy") -> str:
    """Return an estimate (a fraction) with its confidence interval in per cent."""
    return f"{100 * estimate[middle]:.1f} [{100 * estimate['low']:.1f}, {100 * estimate['high']:.1f}]"


def write(
    folder: Path, name: str, result: Mapping[str, Any], title: str, blocks: Sequence[Block],
    picture: Figure | None = None, provenance: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write NAME.json (with versions and a hash of the code), NAME.png if there is a picture, and the page.

    The text ends with the command, and with the seed, input hash and versions of `provenance` (default
    `result`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    used = versions(*(name for module, name in LIBRARIES.items() if module in sys.modules))
    result = {
        "kind": "study",
        "version": 1,
        "versions": used,
        **result,
        **code_provenance(*loaded_places()),
    }
    text = json.dumps(result, indent=1, default=lambda array: array.tolist())
    (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    if picture is not None:
        save_figure(picture, folder / f"{name}.png")
        blocks = [f"![{title}]({name}.png)", *blocks]
    provenance = provenance or result
    repeat = {"Command": f"`python {Path(sys.argv[0]).resolve().relative_to(ROOT)}`"}
    for key in ("seed", "input_hash", "platform", "machine"):
        if isinstance(fact := provenance.get(key, ""), Mapping):
            fact = ", ".join(f"{name} {str(digest)[:16]}" for name, digest in fact.items())
        repeat[key.replace("_", " ").capitalize()] = str(fact)
    document = Document(
        title,
        blocks,
        reproduction={name: fact for name, fact in repeat.items() if fact},
        versions=provenance["versions"],
    )
    text = render_markdown(document)
    page = next((page for page, studies in PAGES.items() if name in studies), name)
    insert_section(text, folder / f"{page}.md")
    print(text)


def insert_section(section: str, page: Path) -> None:
    """Write the section of a study into a page, in place of the section with the same title or at the end."""
    old = page.read_text(encoding="utf-8") if page.exists() else ""
    studies = {text.partition("\n")[0]: text for text in re.split(r"^(?=# )", old, flags=re.M) if text}
    studies[section.partition("\n")[0]] = section
    text = "\n".join(text.rstrip("\n") + "\n" for text in studies.values())
    page.write_text(text, encoding="utf-8")
