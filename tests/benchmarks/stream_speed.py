"""What listening costs, whether a stream says what a batch says, and how soon it is right.

Run it by hand from the project's root: `python tests/benchmarks/stream_speed.py [--part NAME]
[--models DIR]`. Each part (speed, memory, equality-simulated, equality-biotac20, accuracy) writes its section
of reports/studies/stream.json; reports/studies/stream.md is then written from all of them. One thread.
`--models` keeps trained models in a folder. Times are those of single pushes, the same blocks pushed several
times and the least taken of each, for the machine may be shared; beside them stands what one `np.fft.rfft`
of 250,000 samples took in the same run (2.6 ms on this machine when nothing else runs).
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stream_accuracy import accuracy_after_seconds
from stream_equality import equality
from stream_models import PRUNED_TOUCH_S, biotac_model, pruned_model, spectrum_model
from stream_report import markdown

from texclass.loaders import open_dataset
from texclass.provenance import versions
from texclass.recognition import Model, OnlineRecogniser, OnlineSettings, WindowAnswer, load_model
from texclass.recording import Samples

ROOT = Path(__file__).resolve().parents[2]
LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba")
BLOCK_S, HOUR_S = 0.025, 3600.0
SPEED_S, N_ROUNDS = 30.0, 41
N_REFERENCE = 250_000
SEED = 2015


def speed(models: dict[str, tuple[Model, float | None]], seconds: float) -> dict[str, Any]:
    """Push simulated recordings, one after the other, in blocks of 25 ms; each block several times."""
    dataset = open_dataset("simulated")
    found: dict[str, Any] = {"dataset": dataset.name, "input_hash": dataset.input_hash, "models": {}}
    for name, (model, hop_s) in models.items():
        settings = OnlineSettings(hop_s=hop_s)
        live = OnlineRecogniser(model)
        blocks = _blocks(live, seconds)
        rounds: list[tuple[Samples, Samples]] = []
        reference = []
        for _ in range(N_ROUNDS):
            live = OnlineRecogniser(model, settings=settings)
            taken, answered = [], []
            for block in blocks:
                start = time.perf_counter()
                updates = live.push(block)
                taken.append(1e3 * (time.perf_counter() - start))
                answered.append(any(isinstance(update, WindowAnswer) for update in updates))
            rounds.append((np.array(taken), np.array(answered)))
            reference.append(_reference_ms())
        ms, busy = np.min([r[0] for r in rounds[1:]], axis=0), rounds[0][1]  # the first round warms up
        found["models"][name] = {
            "n_axes": live.n_columns, "fs": live.fs, "n_blocks": len(blocks), "columns": len(model.columns),
            "window_s": live.window / live.fs, "hop_s": live.hop / live.fs,
            "with_answers": float(busy.mean()),
            **{f"p{q:g}": float(np.percentile(ms, q)) for q in (50, 90, 99, 99.9)},
            "mean": float(ms.mean()),
            "quiet": float(np.median(ms[~busy])), "busy": float(np.median(ms[busy])),
            "times_real_time": float(1e3 * BLOCK_S / ms.mean()), "reference_ms": min(reference),
            "load": os.getloadavg()[0], "accuracy_of_a_window": model.manifest.accuracy["mean"],
        }  # fmt: skip
    return found


def memory(model: Model, seconds: float) -> dict[str, Any]:
    """Push an hour of simulated recordings and look at the memory of the process a dozen times."""
    live = OnlineRecogniser(model)
    blocks = itertools.cycle(_blocks(live, 60.0))
    n_blocks, held = round(seconds / BLOCK_S), []
    start = time.process_time()
    for i, block in enumerate(itertools.islice(blocks, n_blocks)):
        live.push(block)
        if (i + 1) % (n_blocks // 12) == 0:
            held.append(_resident_mb())
    took = time.process_time() - start
    return {
        "seconds": seconds, "memory_mb": held, "rings_mb": live.n_bytes / 1e6,
        "cpu_times_real_time": seconds / took, "reference_ms": _reference_ms(),
    }  # fmt: skip


def _blocks(live: OnlineRecogniser, seconds: float) -> list[Samples]:
    """Return so many seconds of simulated recordings in blocks of 25 ms."""
    dataset, n = open_dataset("simulated"), round(BLOCK_S * live.fs)
    blocks: list[Samples] = []
    for index in itertools.cycle(range(0, len(dataset), 7)):
        signal = dataset[index].acceleration
        blocks += [signal[k : k + n] for k in range(0, len(signal) - n + 1, n)]
        if len(blocks) * BLOCK_S >= seconds:
            return blocks
    raise AssertionError("there is no end")


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _reference_ms() -> float:
    x, found = np.random.default_rng(SEED).standard_normal(N_REFERENCE), []
    for _ in range(5):
        start = time.thread_time()
        np.fft.rfft(x)
        found.append(1e3 * (time.thread_time() - start))
    return min(found)


def _kept(make: Callable[[], Model], folder: Path | None) -> Model:
    """Return a model, trained unless it stands in the folder."""
    if folder is None:
        return make()
    path = folder / f"{make.__name__}.skops"
    if not path.is_file():
        make().save(path)
    return load_model(path)


def main() -> None:
    """Compute the parts asked for and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "speed": lambda: speed(
            {
                "several time scales": (_kept(pruned_model, asked.models), None),
                "spectrum": (_kept(spectrum_model, asked.models), None),
                "spectrum, half as often": (_kept(spectrum_model, asked.models), PRUNED_TOUCH_S),
            },
            SPEED_S,
        ),
        "memory": lambda: memory(_kept(spectrum_model, asked.models), HOUR_S),
        "equality-simulated": lambda: equality(
            _kept(pruned_model, asked.models), open_dataset("simulated"), asked.every
        ),
        "equality-biotac20": lambda: equality(
            _kept(biotac_model, asked.models), open_dataset("biotac20"), asked.every
        ),
        "accuracy": lambda: accuracy_after_seconds(_kept(biotac_model, asked.models), asked.every),
    }
    parser.add_argument("--part", action="append", choices=list(parts))
    parser.add_argument("--models", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every n-th recording only")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    asked = parser.parse_args()
    path = asked.out / "stream.json"
    result = json.loads(path.read_text()) if path.is_file() else {}
    for name in asked.part or parts:
        found = parts[name]()
        result[name] = found | {"versions": versions(*LIBRARIES), "seed": SEED, "every": asked.every}
        path.write_text(json.dumps(result, indent=1, sort_keys=True) + "\n")
        print(name, json.dumps(found)[:800])
    (asked.out / "stream.md").write_text(markdown(result))


if __name__ == "__main__":
    main()
