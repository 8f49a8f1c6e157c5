"""Whether a change of the code changed any result: record what comes out, compare again after the change.

    python benchmarks/same_as_before.py record            # writes benchmarks/same_as_before/
    python benchmarks/same_as_before.py compare           # exit code 1 if anything differs
    python benchmarks/same_as_before.py compare --only vibration scene
    python benchmarks/same_as_before.py list

The parts (`same_as_before_parts.py`) return nested results. `flatten` names each value by the names above it,
never by its place in a list, so that another order is no difference. Phases, selected columns, confusion
matrices and words must be equal, floating-point numbers within the tolerance of their part. Measured times,
versions and prose are left out. Parts that need recordings which are not here (`TEXCLASS_DATA`, or
`../shared/data` beside the project) are skipped. Everything is computed anew, in a cache of its own.

Whoever changes a figure on purpose records the parts it changes again (`record --only PART`), and says in the
commit what changed and why.
"""

import argparse
import dataclasses
import json
import lzma
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import same_as_before_parts
from same_as_before_parts import PARTS
from study import own_data
from threadpoolctl import threadpool_limits

RECORD = Path(__file__).resolve().with_suffix("")
TITLES = ("name", "surface", "column", "input", "feature")
"""Keys that name the rows of a table, the first that all have; points of a curve have none."""
LEFT_OUT = {
    # times and places
    "age_s", "bytes", "classifiers", "classifiers_ms", "costs_of", "file", "fit_ms", "measured_ms", "met",
    "ms", "ms_added", "ms_alone", "ms_per_recording", "predict_ms", "seconds", "segmentation_ms", "source",
    "window.ms",
    # code
    "code_hash", "code_of", "features_hash", "hash", "input_hash", "machine", "model_check", "versions",
    # prose
    "accuracy_unit", "detail", "example", "flags", "licence", "note", "notes", "protocol_description",
    "reason", "reasons", "title", "undefined", "why",
}  # fmt: skip
"""Keys of results that are neither recorded nor compared."""


def flatten(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of every scalar and every list of numbers or words in nested results.

    Fields of objects, columns of tables and members of mappings are named by their names, rows by theirs; the
    columns of a table are lists in the order of its sorted index. Of an array of more than 40 numbers 40 are
    kept, evenly spread, and the root mean square.
    """
    if isinstance(value, pd.DataFrame):
        table = value.sort_index().astype(object)
        value = {"index": list(table.index), **table.where(table.notna(), None).to_dict("list")}
    elif dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif isinstance(value, list | tuple) and value and all(isinstance(row, Mapping) for row in value):
        title = next((title for title in TITLES if all(title in row for row in value)), None)
        names = [str(row[title] if title else i) for i, row in enumerate(value)]
        names = [name if name not in names[:i] else f"{name} ({i})" for i, name in enumerate(names)]
        value = dict(zip(names, value, strict=True))
    elif isinstance(value, np.ndarray) and value.size > 40:
        x = value.ravel().astype(np.float64)
        some = x[np.linspace(0, x.size - 1, 40).astype(int)]
        value = {"shape": list(value.shape), "some": some, "rms": np.sqrt(np.mean(x**2))}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in LEFT_OUT:
                yield from flatten(inner, f"{path} > {key}" if path else str(key))
    elif isinstance(value, np.ndarray | np.generic):
        yield path, value.tolist()
    elif isinstance(value, tuple | list):
        yield path, [dataclasses.astuple(one) if dataclasses.is_dataclass(one) else one for one in value]
    else:
        yield path, value


def differences(before: Mapping[str, Any], now: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """Yield what differs: path, before and now."""
    for path in dict.fromkeys((*before, *now)):
        if path not in now or path not in before:
            yield f"{path}: {'is new' if path in now else 'is gone'}"
        elif not equal(before[path], now[path], tolerance):
            yield f"{path}: {before[path]!r:.150} before, {now[path]!r:.150} now"


def equal(old: Any, new: Any, tolerance: float) -> bool:
    """Whether values are equal, floating-point numbers up to the tolerance times their typical size."""
    if old == new:
        return True
    try:
        x, y = np.array(old, dtype=np.float64), np.array(new, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    if x.shape != y.shape or np.array(old).dtype.kind in "biU":
        return False
    finite = np.abs(x[np.isfinite(x)])
    size = np.maximum(np.abs(x), np.median(finite) if finite.size else 0.0)
    with np.errstate(invalid="ignore"):
        return bool(np.all((x == y) | (np.isnan(x) & np.isnan(y)) | (np.abs(x - y) <= tolerance * size)))


def rounded(value: Any) -> Any:
    """Return a value with 12 digits of its floating-point numbers, as JSON holds it."""
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def outcome(name: str, what: str, most: int) -> str:
    """Compute a part, record or compare it, and return what came out."""
    part, file = PARTS[name], RECORD / f"{name}.json.xz"
    if not all((Path(os.environ["TEXCLASS_DATA"]) / folder).is_dir() for folder in part.needs):
        return "skipped, the recordings are not here"
    if what == "compare" and not file.exists():
        return f"there is no record; `record --only {name}` makes one"
    try:
        leaves = {path: rounded(value) for path, value in flatten(part.results())}
    except Exception:
        return f"failed\n{traceback.format_exc(limit=-3)}"
    if what == "record":
        RECORD.mkdir(exist_ok=True)
        file.write_bytes(lzma.compress(json.dumps(leaves, ensure_ascii=False).encode()))
        return f"recorded {len(leaves)} values"
    lines = list(differences(json.loads(lzma.decompress(file.read_bytes())), leaves, part.tolerance))
    more = [f"and {len(lines) - most} more"] * (len(lines) > most)
    return "\n    ".join([f"{len(lines)} differences" if lines else "same", *lines[:most], *more])


def main() -> int:
    """Record or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("record", "compare", "list"))
    parser.add_argument("--only", nargs="+", metavar="PART", help="parts, or what their names begin with")
    parser.add_argument("--most", type=int, default=20, help="differences that are printed for each part")
    args = parser.parse_args()
    names = [name for name in PARTS if not args.only or name.startswith(tuple(args.only))]
    if not names:
        parser.error(f"no part begins with {args.only}; the parts are {', '.join(PARTS)}")
    if args.what == "list":
        print("\n".join(names))
        return 0
    own_data()
    threadpool_limits(1)  # sums would depend on their number
    failed = False
    with tempfile.TemporaryDirectory(prefix="same_as_before_") as scratch:
        same_as_before_parts.SCRATCH = Path(scratch)
        os.environ["TEXCLASS_CACHE"] = str(Path(scratch) / "cache")
        for name in names:
            started = time.process_time()
            text = outcome(name, args.what, args.most)
            failed |= not text.startswith(("same", "skipped", "recorded"))
            print(f"{name} ({time.process_time() - started:.0f} s): {text}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
