"""Cost of feature sets: ratio to one `np.fft.rfft` of the same recording, ms per feature, and baselines.

Run it by hand from the project's root: `python benchmarks/feature_speed.py [--baselines-python PATH]`. It
writes reports/studies/feature_speed.json. One thread; CPU time of that thread; the reference, the
sets and the baselines take turns within each round, and medians over rounds are compared, so that a loaded
machine slows all alike. The recording has one axis and its phases are given, so nothing but features is
timed; baselines are given the samples that features read. `--baselines-python`: an interpreter that has
TSFEL, pycatch22 and aeon. `--knee`: what a trade-off chose.
"""

import hashlib
import json
import os
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from study import ROOT, command_line, table, timed, write

from texclass.baselines.worker_process import ENVIRONMENT, HERE
from texclass.features import FeatureSet, load_feature_set
from texclass.features.phase_view import Views
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.reporting import Heading

FS, DURATION_S = 10_000.0, 25.0
SEED = 0
SHIPPED = ("strese2015", "texclass", "multiscale")
CHEAP = "strese2015 without spectral_roughness"
KNEE = "knee of {}, pruned"
LIMITS = {"strese2015": 40.0, CHEAP: 12.0, "texclass": 15.0, KNEE: 5.0}
"""At most so many transforms, where one is asked for."""
BASELINES = {"tsfel": "TSFEL", "catch22": "catch22", "minirocket": "MiniRocket transform"}
DISTRIBUTIONS = ("tsfel", "pycatch22", "aeon", "numpy", "numba")
N_WARM = 2
Timer = Callable[[], float]
"""Does a piece of work and returns its CPU seconds."""


def example(seed: int = SEED) -> tuple[Recording, Phases]:
    """Return a signal with five taps and a movement of 25 s, which the reference transforms."""
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
    """Return the shipped sets, the paper's set without its most expensive feature, and a pruned set."""
    feature_sets = {name: load_feature_set(name) for name in SHIPPED}
    strese, chosen = feature_sets["strese2015"], json.loads(knee.read_text(encoding="utf-8"))
    feature_sets[CHEAP] = strese.restricted_to(
        name for name in strese.columns if name != "spectral_roughness"
    )
    pruned = load_feature_set(chosen["features"]).restricted_to(chosen["selection"]["columns"])
    return feature_sets | {KNEE.format(chosen["dataset"]["name"]): pruned}


def fresh(recording: Recording, phases: Phases) -> Views:
    """Views that remember nothing yet, their samples conditioned."""
    views = Views(recording, phases)
    for phase in ("movement", "vibration", "tap", "friction"):
        getattr(views, phase)
    return views


@contextmanager
def baselines(
    python: Path, signal: Samples, fs: float = FS, names: Mapping[str, str] = BASELINES
) -> Iterator[dict[str, Timer]]:
    """Return what times each baseline on the recording, by its title, in the other interpreter."""

    def request(name: str) -> float:
        worker.stdin.write(name + "\n")
        worker.stdin.flush()
        answer = worker.stdout.readline()
        if not answer:
            raise RuntimeError(f"the worker of {name} ended. Expected an interpreter that has the baseline")
        return float(json.loads(answer)["seconds"])

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "signal.npy"
        np.save(path, signal)
        command = [
            str(python),
            str(Path(__file__).with_name("baseline_timer.py")),
            str(HERE),
            str(path),
            str(fs),
        ]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command, text=True, env=os.environ | ENVIRONMENT, **pipes) as worker:
            yield {title: partial(request, name) for name, title in names.items()}
            worker.stdin.close()


def baseline_versions(python: Path) -> dict[str, str]:
    """Return the versions of the baselines."""
    script = (
        "import importlib.metadata as m, json, platform;"
        f"found = {{n: m.version(n) for n in {DISTRIBUTIONS}}};"
        "print(json.dumps(found | {'python': platform.python_version()}))"
    )
    completed = subprocess.run([str(python), "-c", script], check=True, capture_output=True, text=True)
    return dict(json.loads(completed.stdout))


def rounds(
    n: int, feature_sets: dict[str, FeatureSet], others: dict[str, Timer]
) -> dict[tuple[str, str], float]:
    """Return the median ms of each thing: (name, "") in all, (set, feature) of the features of a set."""
    recording, phases = example()
    movement = np.ascontiguousarray(recording.acceleration[slice(*phases.movement)])
    timings = []
    for _ in range(N_WARM + n):
        row, references = {}, []
        for name, feature_set in feature_sets.items():
            references.append(timed(lambda: np.fft.rfft(movement))[1])
            views = fresh(recording, phases)
            for member in feature_set.members:
                row[name, member.name] = timed(partial(member.values, views))[1]
            row[name, ""] = sum(row[name, member.name] for member in feature_set.members)
        row["rfft", ""] = float(np.median(references))
        row["conditioning", ""] = timed(lambda: fresh(recording, phases))[1]
        timings.append(row | {(name, ""): timer() for name, timer in others.items()})
    return {key: 1e3 * float(np.median([row[key] for row in timings[N_WARM:]])) for key in timings[0]}


def measure(knee: Path, n_rounds: int, python: Path | None) -> dict[str, Any]:
    """Return medians over rounds: ms and ratios of sets and baselines, ms of each feature."""
    feature_sets, example_samples = sets(knee), fresh(*example()).movement.samples
    timers: AbstractContextManager[dict[str, Timer]] = (
        baselines(python, example_samples) if python else nullcontext({})
    )
    with timers as others:
        each = rounds(n_rounds, feature_sets, others)
    ms = {name: value for (name, feature), value in each.items() if not feature}
    rfft, conditioning = ms.pop("rfft"), ms.pop("conditioning")
    chosen = list(feature_sets)[-1]
    limits = {name: LIMITS.get(KNEE if name == chosen else name) for name in feature_sets}
    return {
        "reference_ms": rfft,
        "conditioning_ratio": conditioning / rfft,
        "ms": ms,
        "ratio": {name: value / rfft for name, value in ms.items()},
        "limit": {name: limit for name, limit in limits.items() if limit},
        "times_faster": {
            name: {baseline: ms[baseline] / ms[name] for baseline in others} for name in feature_sets
        },
        "n_columns": {name: len(feature_set.column_names) for name, feature_set in feature_sets.items()},
        "feature_ms": {
            name: {feature: value for (of, feature), value in each.items() if of == name and feature}
            for name in feature_sets
        },
        "n_rounds": n_rounds,
        "knee": list(feature_sets[chosen].column_names),
        "input": {
            "duration_s": DURATION_S,
            "fs": FS,
            "seed": SEED,
            "sha256": hashlib.sha256(example_samples.tobytes()).hexdigest(),
        },
        "baseline_versions": baseline_versions(python) if python else {},
    }


def main() -> None:
    knee = ROOT / "reports" / "tables" / "simulated69-tradeoff.json"
    args = command_line(__doc__, rounds=15, knee=knee, baselines_python=None)
    result = measure(args.knee, args.rounds, args.baselines_python)
    rfft, faster = result["reference_ms"], pd.DataFrame(result["times_faster"]).T
    costs = [
        {
            "name": name,
            "columns": result["n_columns"].get(name, ""),
            "ms": ms,
            "ratio": ms / rfft,
            "limit": result["limit"].get(name, ""),
            "longer": ", ".join(
                f"{baseline} {times:.0f}" for baseline, times in faster.T.get(name, {}).items()
            ),
        }
        for name, ms in result["ms"].items()
    ]
    counts = Counter(column.split(".")[0] for column in result["knee"])
    parts = [feature if n == 1 else f"{feature} ({n})" for feature, n in counts.items()]
    blocks = [
        f"One recording of {DURATION_S:g} s at {FS:g} Hz, one axis, one thread, warm, median of "
        f"{args.rounds} rounds in which all take turns. One `np.fft.rfft` of it took {rfft:.2f} ms. "
        "Conditioning the samples (mean, resting level; the same for every set) takes "
        f"{result['conditioning_ratio']:.1f} of them more.",
        table(
            costs,
            "set = {name} | columns = {columns} | ms = {ms:.1f} | times one rfft = {ratio:.1f} | "
            "at most = {limit} | times longer = {longer}",
            "Times longer: what a baseline takes, over the set.",
        ),
        f"The knee's features, with columns where there are several: {', '.join(parts)}.",
    ]
    for name in SHIPPED:
        rows = [{"feature": k, "ms": ms, "ratio": ms / rfft} for k, ms in result["feature_ms"][name].items()]
        columns = "feature = {feature} | ms = {ms:.2f} | times one rfft = {ratio:.2f}"
        blocks += [Heading(f"{name}, per feature"), table(rows, columns)]
    blocks.append("A transform that several features share is counted with the first that asks for it.")
    if theirs := result["baseline_versions"]:
        listed = ", ".join(f"{name} {version}" for name, version in theirs.items())
        blocks.append(f"Baselines, in an interpreter of their own: {listed}.")
    write(args.out, "feature_speed", result, "Cost of the feature sets", blocks)


if __name__ == "__main__":
    main()
