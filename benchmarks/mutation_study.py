"""Mutation study: draw random mutants of texclass and record which tests kill them.

`nice python benchmarks/mutation_study.py --seed 2718` draws mutants from the last commit and runs each
of them. A second call continues reports/studies/mutation.json. `--again survived --files 25` runs the
survivors against more tests. `--equivalent 17 --reason "..."` records why no test can kill a mutant.

A mutant changes one line: a comparison (reversed, or moved by its boundary), an operator, a number (plus 1),
a boolean or condition, a reduction (min for max, mean for sum), an axis, a dropped statement or a dropped
return value. Messages and annotations stay. mutmut and cosmic-ray run the whole suite, or the same tests, for
every mutant: days here.

A mutant meets its five nearest test files in a copy of the last commit: the file that mirrors its module
first, then the files that use most names of the module and of its callers. Tests run until one fails, and the
failing file must pass without the mutation. Tests on real recordings are skipped where these are absent.
Other tests may kill a survivor: the rate is a lower bound.
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
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

# One thread; and what the children need is loaded once, but nothing of the package.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

for _name in ("librosa.feature", "numba", "matplotlib.pyplot", "pandas", "pywt", "scipy.signal",
              "sklearn.discriminant_analysis", "sklearn.ensemble", "sklearn.pipeline"):  # fmt: skip
    importlib.import_module(_name)

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = ("haptics",)
"""Subpackages of rendering, which this study does not mutate."""
CPU_S, WALL_S = 240, 900
FLIPS = {
    "comparison": {"<": ">=", "<=": "<", ">": "<=", ">=": ">", "==": "!=", "!=": "==", "in": "not in",
                   "not in": "in", "is": "is not", "is not": "is"},
    "arithmetic": {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "/", "**": "*"},
    "boundary": {"<": "<=", "<=": "<", ">": ">=", ">=": ">"},
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
KILLED = ("killed", "timeout")
PRINTED = ("status", "seconds", "file", "number", "before", "after", "by")
COMMON = {"fit", "predict", "predict_proba", "transform", "__init__", "__post_init__", "main", "table"}
"""Names of functions that many classes have: a test that uses one is no nearer."""
Mutant = dict[str, Any]


def mutants_of(path: Path) -> list[Mutant]:
    """Return every mutant of one line in the functions and classes of a module."""
    lines = path.read_bytes().split(b"\n")
    found = []
    for where, node in _nodes(ast.parse(path.read_bytes()), ""):
        for kind, number, start, stop, new in _changes(node, lines):
            old = lines[number - 1]
            changed = old[:start] + new.encode() + old[stop:]
            texts = {"before": old.decode().strip(), "after": changed.decode().strip()}
            found.append({"kind": kind, "function": where, "number": number, **texts})
    for mutant in found:  # which of the equal lines of a function
        same = {m["number"] for m in found if all(m[k] == mutant[k] for k in ("function", "before"))}
        mutant["occurrence"] = sorted(same).index(mutant["number"])
    return found


def _nodes(parent: ast.AST, where: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield the nodes inside functions and classes, with the name; messages and annotations are left out."""
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


def _changes(  # noqa: PLR0912  (one case per mutation)
    node: ast.AST, lines: list[bytes]
) -> Iterator[tuple[str, int, int, int, str]]:
    """Yield each mutation of a node: kind, line, first byte, last byte, new text."""
    gaps: list[tuple[str, Any, Any, ast.AST]] = []
    match node:
        case ast.Compare(left, ops, comparators):
            terms = list(zip([left, *comparators], comparators, ops, strict=False))
            gaps = [(flip, *term) for flip in ("comparison", "boundary") for term in terms]
        case ast.BinOp(left, op, right) if not _is_text(node):
            gaps = [("arithmetic", left, right, op)]
        case ast.BoolOp(op, values):
            gaps = [("boolean", a, b, op) for a, b in itertools.pairwise(values)]
        case ast.Constant(bool() as value):
            yield "constant", node.lineno, node.col_offset, node.end_col_offset or 0, repr(not value)
        case ast.Constant(int() | float() as value):
            yield "constant", node.lineno, node.col_offset, node.end_col_offset or 0, repr(value + 1)
        case ast.If(test) | ast.While(test) if test.lineno == test.end_lineno:
            condition = lines[test.lineno - 1][test.col_offset : test.end_col_offset].decode()
            yield "boolean", test.lineno, test.col_offset, test.end_col_offset or 0, f"not ({condition})"
        case ast.Return(ast.expr() as value) if node.lineno == node.end_lineno and not _is_none(value):
            yield "return", node.lineno, node.col_offset, node.end_col_offset or 0, "return None"
        case ast.stmt() if _has_effect(node) and node.lineno == node.end_lineno:
            yield "statement", node.lineno, node.col_offset, node.end_col_offset or 0, "pass"
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
    for flip, left, right, op in gaps:
        # A sign on another line than its operands is left alone.
        if left.end_lineno == right.lineno and (old := SIGNS.get(type(op), "")) in FLIPS[flip]:
            start = left.end_col_offset
            gap = lines[right.lineno - 1][start : right.col_offset].decode()
            kind = "comparison" if flip == "boundary" else flip
            yield kind, right.lineno, start, right.col_offset, gap.replace(old, FLIPS[flip][old], 1)


def _is_none(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is None


def _has_effect(node: ast.AST) -> bool:
    """Return whether a statement can be dropped and leave all names defined."""
    match node:
        case (
            ast.Expr(ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Delete() | ast.Continue() | ast.Break()
        ):
            return True
        case ast.Assign([ast.Attribute() | ast.Subscript()]):
            return True
    return False


def _is_text(node: ast.AST) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or isinstance(getattr(n, "value", 0), str) for n in ast.walk(node)
    )


def draw(root: Path, n: int, seed: int) -> list[Mutant]:
    """Return n mutants in random order, each on a line of its own.

    Subpackages are drawn in proportion to their possible mutants. All kinds of mutation are equally likely.
    """
    rng, pools = random.Random(seed), dict[str, list[Mutant]]()
    for path in sorted((root / "texclass").rglob("*.py")):
        module = path.relative_to(root)
        room = module.parts[1] if len(module.parts) > 2 else "texclass"
        if room not in LEFT_OUT:
            pools.setdefault(room, []).extend(
                {"room": room, "file": str(module), **mutant} for mutant in mutants_of(path)
            )
    rooms = rng.choices(list(pools), [len(pool) for pool in pools.values()], k=n)
    drawn: dict[tuple[str, int], Mutant] = {}
    for room in rooms:
        left = [mutant for mutant in pools[room] if (mutant["file"], mutant["number"]) not in drawn]
        kind = rng.choice(sorted({mutant["kind"] for mutant in left}))
        mutant = rng.choice([mutant for mutant in left if mutant["kind"] == kind])
        drawn[mutant["file"], mutant["number"]] = mutant
    return [
        {"id": i, **mutant, "status": "", "by": "", "reason": ""} for i, mutant in enumerate(drawn.values())
    ]


def nearest_tests(mutant: Mutant, root: Path, n: int) -> list[str]:
    """Return the n test files that use most names of a mutant's module and of its callers, nearest first."""
    module = Path(mutant["file"])
    public = _defined(root / module)
    users: set[str] = set()
    for other in (root / "texclass").rglob("*.py"):
        if re.search(rf"\b{module.stem}\b", other.read_text(encoding="utf-8")):
            users |= _defined(other)
    scores = []
    for path in sorted((root / "tests").rglob("test_*.py")):
        text = path.read_text(encoding="utf-8")
        words = set(re.findall(r"\w+", text))
        if re.search("dds|ros2|browser", path.stem) and module.stem not in path.stem:  # seconds each
            continue
        near = mutant["room"] in path.parts
        score = 20 * (path.stem == f"test_{module.stem}" and (near or mutant["room"] == "texclass"))
        score += 6 * bool(re.search(rf"(from|import) [\w., ]*\b{module.stem}\b", text))
        score += 3 * len(words & {name for name in mutant["function"].split(".") if name not in COMMON})
        score += 2 * min(3, len(words & public)) + (1 + near) * min(2, len(words & users)) + 2 * near
        scores.append((-score, path.stat().st_size, str(path.relative_to(root))))
    return [path for score, _, path in sorted(scores)[:n] if score < 0]


def _defined(path: Path) -> set[str]:
    nodes = ast.parse(path.read_bytes()).body
    return {n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name[0] != "_"}


def meet(root: Path, files: list[str]) -> tuple[str, str]:
    """Run test files in a child process until a test fails; return the status and the name of that test."""
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
    while not (wait_status := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < end:
        time.sleep(0.1)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # and what tests started
    code = os.waitstatus_to_exitcode(wait_status[1] if wait_status[0] else os.waitpid(child, 0)[1])
    summary_lines = [
        line for line in log.read_text(errors="replace").splitlines() if line.startswith(("FAILED", "ERR"))
    ]
    status = {0: "survived", 5: "survived"}.get(code, "killed" if code > 0 else "timeout")
    return status, re.sub(r" - .*", "", summary_lines[0].partition(" ")[2]) if summary_lines else ""


def judge(mutant: Mutant, root: Path, n_files: int, sound: dict[str, bool]) -> Mutant:
    """Return a mutant with its status.

    It is killed, timeout, survived, gone (no such line) or untested (its tests fail without it).
    """
    path = root / mutant["file"]
    place = [
        same for same in (mutants_of(path) if path.exists() else ())
        if all(same[k] == mutant[k] for k in ("function", "before", "after", "occurrence"))
    ]  # fmt: skip
    if not place:
        return mutant | {"status": "gone", "by": "", "seconds": 0.0}
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
        if status == "timeout" and meet(root, files)[0] == "survived":
            break
        # Without a name of a test, a conftest failed: then every file must pass without the mutation.
        blamed = [by.partition("::")[0]] if by else files
        for file in blamed:
            if file not in sound:
                sound[file] = meet(root, [file])[0] == "survived"
        if status != "timeout" and all(sound[file] for file in blamed):
            break
        files = [file for file in files if sound.get(file, True)] if status != "timeout" else files[:-1]
    else:
        status, by = "untested", ""
    seconds = round(time.monotonic() - started, 1)
    return mutant | {"number": number, "status": status, "by": by, "tests": files, "seconds": seconds}


def report(folder: Path, result: dict[str, Any]) -> None:
    """Write JSON and Markdown. Loads texclass, so it is called after the last mutant."""
    from study import table, write

    ran = [m for m in result["mutants"] if m["status"] not in ("", "gone")]
    first = sum(m["first"] in KILLED for m in ran)
    now = sum(m["status"] in KILLED for m in ran)
    blocks: list[Any] = [
        f"{first} of {len(ran)} random mutants ({first / max(1, len(ran)):.1%}, seed {result['seed']}) were "
        f"killed at the first meeting with their nearest test files, {now} to date; "
        f"{len(result['mutants'])} were drawn. "
        f"{(__doc__ or '').rpartition(chr(10) * 2)[2].strip()}"
    ]
    for key in ("room", "kind"):
        rows = []
        for value in (*sorted({m[key] for m in ran}), "all"):
            chosen = [m for m in ran if value in (m[key], "all")]
            of = Counter(m["status"] for m in chosen)
            first = sum(m["first"] in KILLED for m in chosen)
            rows.append({"what": value, "n": len(chosen), "first": first, "part": first / max(1, len(chosen)),
                         "now": sum(of[s] for s in KILLED), "same": of["equivalent"]})  # fmt: skip
        counted = "mutants = {n} | killed first = {first} | rate = {part:.1%}"
        counted += " | killed now = {now} | equivalent = {same}"
        title = {"room": "subpackage", "kind": "mutation"}[key]
        blocks.append(table(rows, f"{title} = {{what}} | {counted}"))
    captions = {"equivalent": "Equivalent mutants: no test can kill them", "survived": "Survivors",
                "untested": "Mutants without a passing test file"}  # fmt: skip
    for status, caption in captions.items():
        rows = [m for m in ran if m["status"] == status]
        if rows:
            columns = "mutant = {id} | where = {file}:{number} | line = `{before}` | mutation = `{after}`"
            blocks.append(table(rows, f"{columns} | reason = {{reason}}", caption))
    write(folder, "mutation", result, "Mutation study", blocks)


def main() -> None:
    """Draw mutants or continue with the kept ones until the minutes are over, and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    defaults = {
        "mutants": 200,
        "seed": 2718,
        "files": 5,
        "minutes": 120.0,
        "jobs": 1,
        "equivalent": -1,
        "reason": "",
    }
    for name, default in (defaults | {"out": ROOT / "reports/studies"}).items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    parser.add_argument("--again", nargs="*", default=[], help="statuses or ids of mutants to run again")
    args = parser.parse_args()
    end = time.monotonic() + 60 * args.minutes
    result_file = args.out / "mutation.json"
    with tempfile.TemporaryDirectory() as folder:
        commit = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=ROOT, text=True).strip()
        archive = subprocess.check_output(["git", "archive", commit], cwd=ROOT)
        roots = [Path(folder) / str(job) for job in range(args.jobs)]
        for root in roots:
            with tarfile.open(fileobj=io.BytesIO(archive)) as files:
                files.extractall(root, filter="data")
        if result_file.exists():
            result = json.loads(result_file.read_text(encoding="utf-8"))
        else:
            result = {"seed": args.seed, "mutants": draw(roots[0], args.mutants, args.seed)}
        mutants, sound = result["mutants"], dict[str, bool]()
        if args.equivalent >= 0:
            mutants[args.equivalent] |= {"status": "equivalent", "reason": args.reason}
        mutant_ids = iter(sorted(m["id"] for m in mutants if {m["status"], str(m["id"])} & {"", *args.again}))
        lock = threading.Lock()

        def work(root: Path) -> None:
            """Test mutants in one copy of the project until all are tested or the time is over."""
            while time.monotonic() < end:
                with lock:
                    i = next(mutant_ids, None)
                if i is None:
                    return
                met = judge(mutants[i], root, args.files, sound)
                with lock:
                    mutants[i] = {"first": met["status"], **met, "commit": commit}
                    result_file.write_text(json.dumps(result, indent=1), encoding="utf-8")
                    print(i, *(met[k] for k in PRINTED), flush=True)

        with ThreadPoolExecutor(args.jobs) as pool:
            list(pool.map(work, roots))
    report(args.out, result)


if __name__ == "__main__":
    main()
