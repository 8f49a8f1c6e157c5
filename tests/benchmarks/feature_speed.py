"""What feature sets cost: ratio to one `np.fft.rfft` of the same recording, ms per feature, and peers.

Run it by hand from the project's root: `python tests/benchmarks/feature_speed.py [--peers-python PATH]`. It
writes reports/studies/feature_speed.json and .md. One thread; CPU time of that thread; the reference, the
sets and the peers take turns within each round, and medians over rounds are compared, so that a loaded
machine slows all alike. The recording has one axis and its phases are given, so nothing but features is
timed; peers are given the samples that features read. `--peers-python`: an interpreter that has TSFEL,
pycatch22 and aeon.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import hashlib
import json
import platform
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pywt
import scipy

from texclass import __version__
from texclass.features import FeatureSet, load_feature_set
from texclass.features.phase_view import Views
from texclass.peers.launch import ENVIRONMENT, HERE
from texclass.recording import Phases, Recording, Samples, Tap

ROOT = Path(__file__).resolve().parents[2]
FS, DURATION_S = 10_000.0, 25.0
SEED = 0
KNEE = "knee of {}, pruned"
LIMITS = {
    "strese2015": 40.0,
    "strese2015 without spectral_roughness": 12.0,
    "texclass": 15.0,
    KNEE: 5.0,
}
"""At most so many transforms, where one is asked for."""
PEERS = {"tsfel": "TSFEL", "catch22": "catch22", "minirocket": "MiniRocket transform"}
DISTRIBUTIONS = ("tsfel", "pycatch22", "aeon", "numpy", "numba")
N_WARM = 2
Timer = Callable[[], float]
"""Does a piece of work and returns its CPU seconds."""


def example(seed: int = SEED) -> tuple[Recording, Phases]:
    """Five taps before a movement of 25 s, which is what the reference transforms."""
    rng = np.random.default_rng(seed)
    n, lead = round(DURATION_S * FS), 10_000
    stroke = np.convolve(rng.standard_normal(n), [0.25, 0.5, 0.25], "same")
    t = np.arange(1000) / FS
    tap = np.concatenate([0.2 * np.sin(np.pi * t / t[-1]), 5 * np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)])
    acceleration = np.concatenate([1e-3 * rng.standard_normal(lead), stroke])
    taps = tuple(Tap(start, start + 1000, start + 2000) for start in range(0, lead, 2000))
    for i, each in enumerate(taps):
        acceleration[each.start : each.end] += (1 + 0.25 * i) * tap
    friction = 0.3 + 0.1 * rng.standard_normal(lead + n)
    phases = Phases(taps, (lead, lead + n))
    return Recording(acceleration, FS, "m/s^2", "speed", friction=friction, phases=phases), phases


def sets(knee: Path) -> dict[str, FeatureSet]:
    """Return the shipped sets, the paper's without its most expensive feature, and what a trade-off chose."""
    strese, texclass, multiscale = map(load_feature_set, ("strese2015", "texclass", "multiscale"))
    cheap = strese.restricted_to(name for name in strese.columns if name != "spectral_roughness")
    chosen = json.loads(knee.read_text(encoding="utf-8"))
    pruned = load_feature_set(chosen["features"]).restricted_to(chosen["chosen"]["columns"])
    return {
        "strese2015": strese,
        "strese2015 without spectral_roughness": cheap,
        "texclass": texclass,
        "multiscale": multiscale,
        KNEE.format(chosen["dataset"]["name"]): pruned,
    }


def fresh(recording: Recording, phases: Phases) -> Views:
    """Views that remember nothing yet, their samples conditioned."""
    views = Views(recording, phases)
    for phase in ("movement", "tap", "friction"):
        views.of(phase)
    return views


def seconds(call: Callable[[], object]) -> float:
    """CPU time of this thread."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


@contextmanager
def peers(python: Path, signal: Samples) -> Iterator[dict[str, Timer]]:
    """Return what times each peer on the recording, in a process of the other interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "signal.npy"
        np.save(path, signal)
        command = [str(python), str(Path(__file__).with_name("peer_timer.py")), str(HERE), str(path), str(FS)]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | ENVIRONMENT,
        ) as worker:
            assert worker.stdin is not None
            yield {title: lambda name=name: asked(worker, name) for name, title in PEERS.items()}  # type: ignore[misc]
            worker.stdin.close()


def asked(worker: "subprocess.Popen[str]", name: str) -> float:
    """Let the worker run a peer once; return the CPU seconds it took."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(name + "\n")
    worker.stdin.flush()
    answer = worker.stdout.readline()
    if not answer:
        raise RuntimeError(f"the worker of {name} ended; the rule is an interpreter that has the peer")
    return float(json.loads(answer)["seconds"])


def peer_versions(python: Path) -> dict[str, str]:
    """Return the versions of the peers."""
    script = (
        "import importlib.metadata as m, json, platform;"
        f"found = {{n: m.version(n) for n in {DISTRIBUTIONS}}};"
        "print(json.dumps(found | {'python': platform.python_version()}))"
    )
    found = subprocess.run([str(python), "-c", script], check=True, capture_output=True, text=True).stdout
    return dict(json.loads(found))


def rounds(
    n: int, known: dict[str, FeatureSet], others: dict[str, Timer]
) -> dict[str, list[dict[str, float]]]:
    """Return the CPU seconds of each thing in each round: a total, and the features of a set by name."""
    recording, phases = example()
    movement = np.ascontiguousarray(recording.acceleration[slice(*(phases.movement or (0, 0)))])
    found: dict[str, list[dict[str, float]]] = {
        name: [] for name in ("rfft", "conditioning", *known, *others)
    }
    for _ in range(N_WARM + n):
        references = []
        for name, feature_set in known.items():
            references.append(seconds(lambda: np.fft.rfft(movement)))
            views = fresh(recording, phases)
            costs = {m.name: seconds(lambda m=m, v=views: m.values(v)) for m in feature_set.members}  # type: ignore[misc]
            found[name].append({"": sum(costs.values())} | costs)
        found["rfft"].append({"": float(np.median(references))})
        found["conditioning"].append({"": seconds(lambda: fresh(recording, phases))})
        for name, timer in others.items():
            found[name].append({"": timer()})
    return {name: each[N_WARM:] for name, each in found.items()}


def measure(options: argparse.Namespace) -> dict[str, object]:
    """Return medians over rounds: ms and ratios of sets and peers, ms of each feature."""
    known = sets(options.knee)
    with ExitStack() as stack:
        given, others = fresh(*example()).movement.samples, {}
        if options.peers_python:
            others = stack.enter_context(peers(options.peers_python, given))
        times = rounds(options.rounds, known, others)
    ms = {name: {key: median_ms(each, key) for key in each[0]} for name, each in times.items()}
    rfft = ms["rfft"][""]
    limits = {name: LIMITS.get(KNEE if name.startswith("knee of") else name) for name in known}
    return {
        "reference_ms": rfft,
        "conditioning_ratio": ms["conditioning"][""] / rfft,
        "ms": {name: ms[name][""] for name in (*known, *others)},
        "ratio": {name: ms[name][""] / rfft for name in (*known, *others)},
        "limit": {name: limit for name, limit in limits.items() if limit},
        "times_faster": {name: {peer: ms[peer][""] / ms[name][""] for peer in others} for name in known},
        "n_columns": {name: len(each.column_names) for name, each in known.items()},
        "feature_ms": {name: {k: v for k, v in ms[name].items() if k} for name in known},
        "n_rounds": options.rounds,
        "knee": list(known[next(name for name in known if name.startswith("knee of"))].column_names),
        "input": {
            "duration_s": DURATION_S,
            "fs": FS,
            "seed": SEED,
            "sha256": hashlib.sha256(given.tobytes()).hexdigest(),
        },
        "versions": {
            "texclass": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "PyWavelets": pywt.__version__,
        },
        "peer_versions": peer_versions(options.peers_python) if options.peers_python else {},
    }


def median_ms(each: list[dict[str, float]], key: str) -> float:
    """Return a median over rounds, in ms."""
    return 1e3 * float(np.median([costs[key] for costs in each]))


def as_markdown(result: dict) -> str:  # type: ignore[type-arg]
    """Return the report for people."""
    what = result["input"]
    theirs = [name for name in result["ms"] if name not in result["n_columns"]]
    lines = [
        "# Cost of the feature sets",
        "",
        f"One recording of {what['duration_s']:g} s at {what['fs']:g} Hz, one axis, one thread, warm, median "
        f"of {result['n_rounds']} rounds in which all take turns. One `np.fft.rfft` of it took "
        f"{result['reference_ms']:.2f} ms. Conditioning the samples (mean, resting level; the same for every "
        f"set) takes {result['conditioning_ratio']:.1f} of them more.",
        "",
        "| set | columns | ms | times one rfft | at most |" + "".join(f" {name} / it |" for name in theirs),
        "|---|---:|---:|---:|---:|" + "---:|" * len(theirs),
    ]
    for name, n_columns in result["n_columns"].items():
        faster = "".join(f" {result['times_faster'][name][peer]:.0f} |" for peer in theirs)
        limit = f"{result['limit'][name]:g}" if name in result["limit"] else ""
        cost = f"{result['ms'][name]:.1f} | {result['ratio'][name]:.1f}"
        lines.append(f"| {name} | {n_columns} | {cost} | {limit} |{faster}")
    lines += [
        f"| {name} | | {result['ms'][name]:.0f} | {result['ratio'][name]:.0f} | |" + " |" * len(theirs)
        for name in theirs
    ]
    lines += ["", "The last columns say how many times longer a peer takes than the set."] if theirs else []
    counts = Counter(column.split(".")[0] for column in result["knee"])
    parts = [feature if n == 1 else f"{feature} ({n})" for feature, n in counts.items()]
    lines += ["", "The knee's features, with columns where there are several: " + ", ".join(parts) + "."]
    for name in ("strese2015", "texclass", "multiscale"):
        lines += ["", f"## {name}, per feature", "", "| feature | ms | times one rfft |", "|---|---:|---:|"]
        for feature, cost in result["feature_ms"][name].items():
            lines.append(f"| {feature} | {cost:.2f} | {cost / result['reference_ms']:.2f} |")
    lines += [
        "",
        "A transform that several features share is counted with the first that asks for it.",
        "",
        "Versions: " + listed(result["versions"]) + ".",
    ]
    if result["peer_versions"]:
        lines.append("Peers, in an interpreter of their own: " + listed(result["peer_versions"]) + ".")
    return "\n".join(lines) + "\n"


def listed(versions: dict[str, str]) -> str:
    """Return versions as text."""
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--peers-python", type=Path)
    parser.add_argument(
        "--knee", type=Path, default=ROOT / "reports" / "tables" / "simulated69-tradeoff.json"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    options = parser.parse_args()
    result = measure(options)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "feature_speed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.out / "feature_speed.md").write_text(as_markdown(result), encoding="utf-8")
    print(as_markdown(result))


if __name__ == "__main__":
    main()
