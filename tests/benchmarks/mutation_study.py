"""Would the tests notice: random faults of the code, and which test sees each.

`nice python tests/benchmarks/mutation_study.py` goes on with reports/studies/mutation.json, or draws new
faults where there is none; `--again survived --files 25` runs those that survived against more tests;
`--equivalent 17 --reason "..."` says why no test can see a fault. Faults are those of mutmut (operators,
numbers, booleans), and what array code invites: min for max, a mean that becomes a sum, another axis.
mutmut and cosmic-ray themselves run the whole suite, or the same tests, for every fault: days here.

A fault meets the test files nearest to it by the names they use, in a copy of the last commit, one after the
other until a test fails. That test has to pass without the fault. A survivor may be seen by a test further
away, so that what is told is a lower bound.
"""

import argparse
import ast
import contextlib
import importlib
import io
import itertools
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# One thread; and what the children need is loaded once, but nothing of the package.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

for _name in ("librosa.feature", "numba", "matplotlib.pyplot", "pandas", "pywt", "scipy.signal",
              "sklearn.discriminant_analysis", "sklearn.ensemble", "sklearn.pipeline"):  # fmt: skip
    importlib.import_module(_name)

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("features", "phases", "vibration", "experiment", "tradeoff", "recognition", "scene", "loaders")
CPU_S, WALL_S = 240, 900
FLIPS = {
    "comparison": {"<": ">=", "<=": "<", ">": "<=", ">=": ">", "==": "!=", "!=": "==", "in": "not in",
                   "not in": "in", "is": "is not", "is not": "is"},
    "arithmetic": {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "/", "**": "*"},
    "boolean": {"and": "or", "or": "and"},
    "function": {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax",
                 "argmax": "argmin", "any": "all", "all": "any", "mean": "sum", "median": "mean",
                 "ceil": "floor", "floor": "ceil", "cumsum": "asarray"},
}  # fmt: skip
SIGNS = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.In: "in",
    ast.NotIn: "not in", ast.Is: "is", ast.IsNot: "is not", ast.Add: "+", ast.Sub: "-", ast.Mult: "*",
    ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**", ast.And: "and", ast.Or: "or",
}  # fmt: skip
SEEN = ("killed", "timeout")
Mutant = dict[str, Any]


def faults_of(path: Path) -> list[Mutant]:
    """Return every fault of a module, of one line in a function or class, the words of messages aside."""
    lines = path.read_bytes().split(b"\n")
    found = []
    for where, node in _nodes(ast.parse(path.read_bytes()), ""):
        for kind, number, start, stop, new in _changes(node, lines):
            old = lines[number - 1]
            changed = old[:start] + new.encode() + old[stop:]
            texts = {"before": old.decode().strip(), "after": changed.decode().strip()}
            found.append({"kind": kind, "function": where, "number": number, **texts})
    for fault in found:  # which of the equal lines of a function
        same = {f["number"] for f in found if all(f[k] == fault[k] for k in ("function", "before"))}
        fault["occurrence"] = sorted(same).index(fault["number"])
    return found


def _nodes(parent: ast.AST, where: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield what a function or class holds, with its name; neither messages nor annotations."""
    for name, value in ast.iter_fields(parent):
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or name in ("annotation", "returns", "decorator_list"):
                continue
            if isinstance(node, ast.JoinedStr | ast.Assert):
                continue
            inner = where
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                inner = f"{where}.{node.name}".strip(".")
            if inner:
                yield inner, node
            yield from _nodes(node, inner)


def _changes(node: ast.AST, lines: list[bytes]) -> Iterator[tuple[str, int, int, int, str]]:
    """Yield (kind, line, first byte, last byte, new text)."""
    gaps: list[tuple[str, Any, Any, ast.AST]] = []
    match node:
        case ast.Compare(left, ops, comparators):
            gaps = [("comparison", *g) for g in zip([left, *comparators], comparators, ops, strict=False)]
        case ast.BinOp(left, op, right) if not _is_text(node):
            gaps = [("arithmetic", left, right, op)]
        case ast.BoolOp(op, values):
            gaps = [("boolean", a, b, op) for a, b in itertools.pairwise(values)]
        case ast.Constant(bool() as value):
            yield "constant", node.lineno, node.col_offset, node.end_col_offset or 0, repr(not value)
        case ast.Constant(int() | float() as value):
            yield "constant", node.lineno, node.col_offset, node.end_col_offset or 0, repr(value + 1)
        case ast.UnaryOp(ast.Not()):
            yield "boolean", node.lineno, node.col_offset, node.col_offset + len("not"), ""
        case ast.Call(ast.Name() | ast.Attribute() as called, _, keywords):
            name, end = getattr(called, "id", "") or getattr(called, "attr", ""), called.end_col_offset or 0
            if name in FLIPS["function"]:
                yield "function", called.end_lineno or 0, end - len(name), end, FLIPS["function"][name]
            for value in (word.value for word in keywords if word.arg == "axis"):
                if isinstance(value, ast.Constant | ast.UnaryOp):
                    new = "-1" if ast.unparse(value) == "0" else "0"
                    yield "axis", value.lineno, value.col_offset, value.end_col_offset or 0, new
    for kind, left, right, op in gaps:
        if left.end_lineno == right.lineno and (old := SIGNS.get(type(op), "")) in FLIPS[kind]:
            start = left.end_col_offset
            gap = lines[right.lineno - 1][start : right.col_offset].decode()
            yield kind, right.lineno, start, right.col_offset, gap.replace(old, FLIPS[kind][old], 1)


def _is_text(node: ast.AST) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or isinstance(getattr(n, "value", 0), str) for n in ast.walk(node)
    )


def draw(root: Path, n: int, seed: int) -> list[Mutant]:
    """Return n faults in random order: rooms by their faults, in each all kinds alike, no two on one line."""
    rng, pools = random.Random(seed), {}
    for room in ROOMS:
        pools[room] = [
            {"room": room, "file": str(path.relative_to(root)), **fault}
            for path in sorted((root / "texclass" / room).rglob("*.py"))
            for fault in faults_of(path)
        ]
    rooms = rng.choices(ROOMS, [len(pools[room]) for room in ROOMS], k=n)
    drawn: dict[tuple[str, int], Mutant] = {}
    for room in rooms:
        left = [fault for fault in pools[room] if (fault["file"], fault["number"]) not in drawn]
        kind = rng.choice(sorted({fault["kind"] for fault in left}))
        fault = rng.choice([fault for fault in left if fault["kind"] == kind])
        drawn[fault["file"], fault["number"]] = fault
    return [
        {"id": i, **fault, "status": "", "by": "", "reason": ""} for i, fault in enumerate(drawn.values())
    ]


def nearest_tests(mutant: Mutant, root: Path, n: int) -> list[str]:
    """Return the test files that name most of what leads to a fault, nearest first."""
    module = Path(mutant["file"])
    public = _defined(root / module)
    users: set[str] = set()
    for other in (root / "texclass").rglob("*.py"):
        if re.search(rf"\b{module.stem}\b", other.read_text(encoding="utf-8")):
            users |= _defined(other)
    scores = []
    for path in sorted((root / "tests").rglob("test_*.py")):
        words = set(re.findall(r"\w+", path.read_text(encoding="utf-8")))
        if re.search("dds|ros2|browser", path.stem) and module.stem not in path.stem:  # seconds each
            continue
        near = mutant["room"] in path.parts
        score = 8 * (path.stem == f"test_{module.stem}") + 3 * len(words & set(mutant["function"].split(".")))
        score += 2 * min(3, len(words & public)) + (1 + near) * min(2, len(words & users)) + 2 * near
        scores.append((-score, path.stat().st_size, str(path.relative_to(root))))
    return [path for score, _, path in sorted(scores)[:n] if score < 0]


def _defined(path: Path) -> set[str]:
    nodes = ast.parse(path.read_bytes()).body
    return {n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name[0] != "_"}


def meet(root: Path, files: list[str]) -> tuple[str, str]:
    """Run tests in a child until one fails; return (status, which). Libraries are loaded before, once."""
    log = root / "told"
    child = os.fork()
    if not child:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 5))
        os.chdir(root)
        out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        os.environ["PYTHONPATH"] = str(root)
        sys.path[:] = [str(root), *(p for p in sys.path if ROOT not in (Path(p), *Path(p).parents))]
        os._exit(pytest.main(["-x", "-q", "-n0", "-pno:cacheprovider", "--tb=line", *files]))
    end = time.monotonic() + WALL_S
    while not (done := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < end:
        time.sleep(0.1)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # and what tests started
    code = os.waitstatus_to_exitcode(done[1] if done[0] else os.waitpid(child, 0)[1])
    told = [
        line for line in log.read_text(errors="replace").splitlines() if line.startswith(("FAILED", "ERR"))
    ]
    status = {0: "survived", 5: "survived"}.get(code, "killed" if code > 0 else "timeout")
    return status, re.sub(r" - .*", "", told[0].partition(" ")[2]) if told else ""


def judge(mutant: Mutant, root: Path, n_files: int, sound: dict[str, bool]) -> Mutant:
    """Return a fault with its status: killed, timeout, survived, gone, untested (its tests fail anyway)."""
    path = root / mutant["file"]
    place = [
        fault for fault in (faults_of(path) if path.exists() else ())
        if all(fault[k] == mutant[k] for k in ("function", "before", "after", "occurrence"))
    ]  # fmt: skip
    if not place:
        return mutant | {"status": "gone", "by": ""}
    number, files = place[0]["number"], nearest_tests(mutant, root, n_files)
    lines, times = path.read_text(encoding="utf-8").split("\n"), path.stat()
    indent = re.match(r"\s*", lines[number - 1])[0]
    mutated = "\n".join([*lines[: number - 1], indent + mutant["after"], *lines[number:]])
    started = time.monotonic()
    while files:
        path.write_text(mutated, encoding="utf-8")
        status, by = meet(root, files)
        path.write_text("\n".join(lines), encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        if status == "survived":
            break
        blamed = [by.partition("::")[0]] if by else files
        for file in blamed:
            if file not in sound:
                sound[file] = meet(root, [file])[0] == "survived"
        if all(sound[file] for file in blamed):
            break
        files, status = [file for file in files if sound.get(file, True)], "untested"
    else:
        status, by = "untested", ""
    seconds = round(time.monotonic() - started, 1)
    return mutant | {"number": number, "status": status, "by": by, "tests": files, "seconds": seconds}


def report(folder: Path, result: dict[str, Any]) -> None:
    """Write JSON and Markdown; loads the package, so after the last fault."""
    from study import table, write

    ran = [m for m in result["mutants"] if m["status"] not in ("", "gone")]
    at_once = sum(m["first"] in SEEN for m in ran)
    blocks: list[Any] = [
        f"{len(ran)} of {len(result['mutants'])} faults drawn at random (seed {result['seed']}) have met "
        f"the tests, which noticed {at_once} at the first meeting. Tests were written for others since: "
        f"only that figure tells of faults to come. {(__doc__ or '').rpartition(chr(10) * 2)[2].strip()}"
    ]
    for key in ("room", "kind"):
        rows = []
        for value in (*sorted({m[key] for m in ran}), "all"):
            of = Counter(m["status"] for m in ran if value in (m[key], "all"))
            dead, rest = sum(of[s] for s in SEEN), of.total() - of["equivalent"]
            rows.append({"what": value, "n": of.total(), "dead": dead, "same": of["equivalent"],
                         "part": dead / max(1, rest)})  # fmt: skip
        counted = "faults = {n} | noticed = {dead} | equivalent = {same} | noticed of the others = {part:.1%}"
        blocks.append(table(rows, f"{key} = {{what}} | {counted}"))
    for status, caption in (("equivalent", "No test can see"), ("survived", "Not noticed"),
                            ("untested", "Without a test that passes")):  # fmt: skip
        rows = [m for m in ran if m["status"] == status]
        if rows:
            columns = "fault = {id} | where = {file}:{number} | line = `{before}` | changed to = `{after}`"
            blocks.append(table(rows, f"{columns} | why = {{reason}}", caption))
    write(folder, "mutation", result, "Would the tests notice", blocks)


def main() -> None:
    """Draw or go on until the minutes are over, and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    defaults = {"faults": 300, "seed": 13, "files": 6, "minutes": 60.0, "equivalent": -1, "reason": ""}
    for name, default in (defaults | {"out": ROOT / "reports/studies"}).items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    parser.add_argument("--again", nargs="*", default=[], help="statuses or numbers to run once more")
    asked = parser.parse_args()
    end = time.monotonic() + 60 * asked.minutes
    kept = asked.out / "mutation.json"
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        commit = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=ROOT, text=True).strip()
        archive = subprocess.check_output(["git", "archive", commit], cwd=ROOT)
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(root, filter="data")
        if kept.exists():
            result = json.loads(kept.read_text(encoding="utf-8"))
        else:
            result = {"seed": asked.seed, "mutants": draw(root, asked.faults, asked.seed)}
        mutants, sound = result["mutants"], dict[str, bool]()
        if asked.equivalent >= 0:
            mutants[asked.equivalent] |= {"status": "equivalent", "reason": asked.reason}
        again = {m["id"] for m in mutants if {m["status"], str(m["id"])} & {"", *asked.again}}
        for i in sorted(again):
            if time.monotonic() > end:
                break
            met = judge(mutants[i], root, asked.files, sound)
            mutants[i] = {"first": met["status"], **met, "commit": commit}
            kept.write_text(json.dumps(result, indent=1), encoding="utf-8")
            told = mutants[i]
            print(i, *(told[k] for k in ("status", "file", "number", "before", "after", "by")), flush=True)
    report(asked.out, result)


if __name__ == "__main__":
    main()
