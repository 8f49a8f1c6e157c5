"""What studies share: one thread, a command line, timing in turns, and reports in JSON and Markdown."""

# ruff: noqa: E402  (the number of threads is set before what reads it; children inherit it)
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

from texclass.provenance import code_provenance, versions
from texclass.reporting import Document, Table, render_markdown
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import save_figure

R = TypeVar("R")
ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "simulation": ("phases", "phases_families", "realism", "invariance", "rank_agreement", "scales"),
    "vibrations": ("autoregressive", "line_spectrum", "prony"),
    "speed": ("feature_speed", "whole_path", "scaling", "cluster"),
    "felt": ("scene", "scene_page", "hjif", "packed_surfaces"),
    "certainty": (
        "cluster_interval",
        "calibration",
        "unknown_surfaces",
        "sets",
        "few_recordings",
        "another_sensor",
        "channels",
    ),
    "robot": (
        "stream",
        "borealtc-driven",
        "next_movement",
        "dds",
        "touch_baselines_biotac20",
        "onnx",
        "kernel_size",
    ),
    "tests": ("mutation", "fuzzing"),
}
"""Pages, and the studies that they tell; any other study has a page of its own."""
LIBRARIES = {
    "numpy": "numpy", "scipy": "scipy", "sklearn": "scikit-learn", "pywt": "PyWavelets", "librosa": "librosa",
    "numba": "numba", "onnx": "onnx", "onnxruntime": "onnxruntime", "cyclonedds": "cyclonedds",
}  # fmt: skip
"""Modules on whose versions figures depend, and their distributions."""
WORDS = {"cli", "front_door", "provenance", "reporting", "_version"}
"""Rooms and modules on which no figure depends."""


def command_line(about: str | None, folder: str = "studies", **options: Any) -> argparse.Namespace:
    """Return what is asked for on the command line, by the defaults of options, and `out` for the report.

    False stands for a flag, None for a path that may be left out, a type for what may not, and a tuple or a
    range for one or more of its kind (of texts: of these texts), all of them by default.

    From here on the libraries that are loaded already have one thread, too, and recordings are looked for
    beside the project, unless `$TEXCLASS_DATA` says where they are.
    """
    threadpool_limits(1)
    own_data()
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (options | {"out": ROOT / "reports" / folder}).items():
        given: dict[str, Any] = {"type": type(default), "default": default, "help": f"{default} by default"}
        if default is False:
            given = {"action": "store_true"}
        elif default is None or isinstance(default, type):
            given = {"type": default or Path, "required": default is not None}
        elif isinstance(default, Sequence) and not isinstance(default, str):
            kind: Any = type(default[0]) if default else str
            among = default if default and kind is str else None
            given = {"type": kind, "nargs": "+", "action": "extend", "choices": among}
        parser.add_argument(f"--{name.replace('_', '-')}", **given)
    asked = parser.parse_args()
    for name, default in options.items():
        if default is not None and getattr(asked, name) is None:
            setattr(asked, name, list(default))
    return asked


def own_data() -> None:
    """Look for recordings beside the project, unless `$TEXCLASS_DATA` says where they are."""
    os.environ.setdefault("TEXCLASS_DATA", str(ROOT.parent / "shared" / "data"))


def timed(call: Callable[[], R], clock: Callable[[], float] = time.thread_time) -> tuple[R, float]:
    """Return what a call returns, and the seconds it takes: CPU time of this thread, or by another clock."""
    start = clock()
    found = call()
    return found, clock() - start


def in_turns(
    calls: Mapping[str, Callable[[], object]],
    n_rounds: int,
    n_warm: int = 2,
    clock: Callable[[], float] = time.thread_time,
) -> pd.DataFrame:
    """Return the seconds of each call (a column) in each round, in which all take turns.

    A machine that others use slows all alike: compare medians or least ones of the columns.
    """
    rounds = [{name: timed(call, clock)[1] for name, call in calls.items()} for _ in range(n_warm + n_rounds)]
    return pd.DataFrame(rounds[n_warm:])


def table(
    rows: pd.DataFrame | Iterable[Mapping[str, Any]], columns: str, caption: str = "", n_words: int = 1
) -> Table:
    """Return a table of rows by its columns, each a title and the format of its cells.

    >>> table([{"n": 5, "mean": 0.9}], "recordings = {n} | right = {mean:.1%}")
    """
    titles, cells = zip(*(column.split(" = ") for column in columns.split(" | ")), strict=True)
    told = rows.to_dict("records") if isinstance(rows, pd.DataFrame) else rows
    filled = [[cell.format_map(row) for cell in cells] for row in told]
    return Table(pd.DataFrame(filled, columns=list(titles)), caption, n_words)


def interval(estimate: Mapping[str, Any], middle: str = "accuracy") -> str:
    """Return an estimate, a fraction, with its interval in per cents."""
    return f"{100 * estimate[middle]:.1f} [{100 * estimate['low']:.1f}, {100 * estimate['high']:.1f}]"


def write(
    folder: Path, name: str, result: Mapping[str, Any], title: str, blocks: Sequence[Block],
    picture: Figure | None = None, made: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write NAME.json (with versions and a hash of the code), perhaps NAME.png; put the text into its page.

    The text ends with the command, and with what `made` (`result`) holds of seed, input hash and versions.
    """
    folder.mkdir(parents=True, exist_ok=True)
    loaded = {name.split(".")[1] for name in sys.modules if name.startswith("texclass.")}
    used = versions(*(name for module, name in LIBRARIES.items() if module in sys.modules))
    result = {"kind": "study", "version": 1, "versions": used, **result, **code_provenance(*loaded - WORDS)}
    text = json.dumps(result, indent=1, default=lambda array: array.tolist())
    (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    if picture is not None:
        save_figure(picture, folder / f"{name}.png")
        blocks = [f"![{title}]({name}.png)", *blocks]
    made = made or result
    again = {"Command": f"`python {Path(sys.argv[0]).resolve().relative_to(ROOT)}`"}
    for key in ("seed", "input_hash", "platform", "machine"):
        if isinstance(fact := made.get(key, ""), Mapping):
            fact = ", ".join(f"{name} {str(digest)[:16]}" for name, digest in fact.items())
        again[key.replace("_", " ").capitalize()] = str(fact)
    document = Document(
        title,
        blocks,
        reproduction={name: fact for name, fact in again.items() if fact},
        versions=made["versions"],
    )
    text = render_markdown(document)
    page = next((page for page, studies in PAGES.items() if name in studies), name)
    put(text, folder / f"{page}.md")
    print(text)


def put(told: str, page: Path) -> None:
    """Write what a study tells, a title first, into a page: where it stood before, or at the end."""
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    studies = {text.partition("\n")[0]: text for text in re.split(r"^(?=# )", before, flags=re.M) if text}
    studies[told.partition("\n")[0]] = told
    text = "\n".join(text.rstrip("\n") + "\n" for text in studies.values())
    page.write_text(text, encoding="utf-8")
