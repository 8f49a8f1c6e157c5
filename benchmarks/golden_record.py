"""Golden record: record the results of the code, and compare them after a change.

    python benchmarks/golden_record.py record            # writes benchmarks/golden_record/
    python benchmarks/golden_record.py compare           # exit code 1 if anything differs
    python benchmarks/golden_record.py compare --only vibration scene
    python benchmarks/golden_record.py list

The parts (`golden_record_parts.py`) return nested results. `flatten` identifies each value by the names of
its parents and not by its index in a list, so that the order does not matter. Phases, selected columns,
confusion matrices and strings must be equal, and floating-point numbers must agree within the tolerance of
their part. Run times, versions and prose are omitted. Parts are skipped if their recordings are missing (in
`TEXCLASS_DATA`, or in `../shared/data` next to the project). Everything is computed again, with an empty
cache.

If you change a result on purpose, record its parts again (`record --only PART`), and state in the commit what
changed and why.
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

import golden_record_parts
import numpy as np
import pandas as pd
from golden_record_parts import PARTS
from study import set_data_folder
from threadpoolctl import threadpool_limits

RECORD = Path(__file__).resolve().with_suffix("")
TITLES = ("name", "surface", "column", "input", "feature")
"""Keys that identify the rows of a table; the first key that all rows have is used."""
OMITTED_KEYS = {
    # times and places
    "age_s", "bytes", "classifiers", "classifiers_ms", "costs_of", "file", "fit_ms", "is_met", "measured_ms",
    "ms", "ms_added", "ms_alone", "ms_per_recording", "predict_ms", "seconds", "segmentation_ms", "source",
    "window.ms", "compute_ms",
    # code
    "code_hash", "code_of", "features_hash", "hash", "input_hash", "machine", "model_check", "versions",
    # prose
    "accuracy_unit", "detail", "example", "flags", "licence", "note", "notes", "protocol_description",
    "reason", "reasons", "title", "undefined", "why",
}  # fmt: skip
"""Keys of results that are not recorded."""


def flatten(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of every scalar and every list of numbers or strings in nested results.

    The path consists of the names of fields, columns, keys and rows. Columns of a table are lists in the
    order of the sorted index. An array of more than 40 numbers is reduced to 40 evenly spaced ones and the
    RMS.
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
        sample = x[np.linspace(0, x.size - 1, 40).astype(int)]
        value = {"shape": list(value.shape), "some": sample, "rms": np.sqrt(np.mean(x**2))}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in OMITTED_KEYS:
                yield from flatten(inner, f"{path} > {key}" if path else str(key))
    elif isinstance(value, np.ndarray | np.generic):
        yield path, value.tolist()
    elif isinstance(value, tuple | list):
        yield path, [dataclasses.astuple(one) if dataclasses.is_dataclass(one) else one for one in value]
    else:
        yield path, value


def differences(recorded: Mapping[str, Any], computed: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """Yield a line with the path and both values for each difference."""
    for path in dict.fromkeys((*recorded, *computed)):
        if path not in computed or path not in recorded:
            yield f"{path}: {'is new' if path in computed else 'is gone'}"
        elif not equal(recorded[path], computed[path], tolerance):
            yield f"{path}: {recorded[path]!r:.150} before, {computed[path]!r:.150} now"


def equal(old: Any, new: Any, tolerance: float) -> bool:
    """Whether values are equal; floating-point numbers within the tolerance times their typical size."""
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
    """Return a value with floating-point numbers rounded to 12 digits, as in JSON."""
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def run_part(name: str, what: str, max_lines: int) -> str:
    """Compute a part, record or compare it, and return the result as text."""
    part, file = PARTS[name], RECORD / f"{name}.json.xz"
    if not all((Path(os.environ["TEXCLASS_DATA"]) / folder).is_dir() for folder in part.needs):
        return "skipped, the recordings are missing"
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
    more = [f"and {len(lines) - max_lines} more"] * (len(lines) > max_lines)
    return "\n    ".join([f"{len(lines)} differences" if lines else "same", *lines[:max_lines], *more])


def main() -> int:
    """Record or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("record", "compare", "list"))
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help="parts, or the first letters of their names"
    )
    parser.add_argument(
        "--max-lines", type=int, default=20, help="differences that are printed for each part"
    )
    args = parser.parse_args()
    names = [name for name in PARTS if not args.only or name.startswith(tuple(args.only))]
    if not names:
        parser.error(f"no part begins with {args.only}; the parts are {', '.join(PARTS)}")
    if args.what == "list":
        print("\n".join(names))
        return 0
    set_data_folder()
    threadpool_limits(1)  # sums depend on the number of threads
    failed = False
    with tempfile.TemporaryDirectory(prefix="golden_record_") as scratch:
        golden_record_parts.SCRATCH = Path(scratch)
        os.environ["TEXCLASS_CACHE"] = str(Path(scratch) / "cache")
        for name in names:
            started = time.process_time()
            text = run_part(name, args.what, args.max_lines)
            failed |= not text.startswith(("same", "skipped", "recorded"))
            print(f"{name} ({time.process_time() - started:.0f} s): {text}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
