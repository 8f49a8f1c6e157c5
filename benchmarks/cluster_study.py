"""Cost of many recordings on a Dask cluster: one table of all recordings, or separate partitions.

Run it by hand from the project's root, on a machine that does nothing else: `python
benchmarks/cluster_study.py`. It writes reports/studies/cluster.json. Each run has a scheduler
and two workers of its own, processes of this machine, and goes the real way: WAV files of a card are opened,
loaded, segmented, computed (set `texclass`) and written to Parquet by `texclass.evaluation`. Bytes are what
passed the loopback interface meanwhile; memory is the most that a process ever held. Beyond the largest run
figures are a line through the runs of each way, and said to be that.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
from distributed import Client
from scaling_study import FS, SEED, card_of
from study import command_line, table, write

from texclass.evaluation import extract_partitions, extract_table, use_backend
from texclass.features import load_feature_set
from texclass.loaders import open_dataset
from texclass.provenance import versions
from texclass.reporting import Heading

NUMBERS, SIZE, SECONDS, N_WORKERS = (500, 1000, 2000, 5000), 100, 1.5, 2
FAR = (100_000, 1_000_000)
WAYS = {"table": "one table, a task each", "partitions": f"partitions of {SIZE}"}
FIGURES = ("seconds", "scheduler_mb", "caller_mb", "moved_mb")


def peak_mb(pid: int | str = "self") -> float:
    """Return the most memory that a process ever held, in MB."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def measure(card: Path, way: str, output: Path) -> dict[str, float]:
    """Extract all recordings of a card on a cluster of its own."""
    features, dataset, quiet = load_feature_set("texclass"), open_dataset(card), subprocess.DEVNULL
    with tempfile.TemporaryDirectory() as folder:
        dask = [sys.executable, "-m", "dask"]
        file = ["--scheduler-file", "s.json", "--no-dashboard"]
        commands = [[*dask, "scheduler", *file, "--port", "0"]]
        commands += [[*dask, "worker", *file, "--nthreads", "1", "--no-nanny"]] * N_WORKERS
        processes = [
            subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet) for command in commands
        ]
        try:
            with Client(scheduler_file=f"{folder}/s.json", timeout="60s") as client:
                client.wait_for_workers(N_WORKERS, timeout=60)
                for _ in range(2):  # imports, compiled code
                    list(client.map(lambda i: features.column_names and i, range(N_WORKERS)))
                idle = peak_mb(processes[0].pid)
                address = client.scheduler.address
                moved, start = psutil.net_io_counters(pernic=True)["lo"].bytes_sent, time.perf_counter()
                with use_backend("dask", address):
                    if way == "table":
                        extract_table(dataset, features, output)
                    else:
                        extract_partitions(dataset, features, output, SIZE, suffix=".parquet")
                seconds = time.perf_counter() - start
                moved = psutil.net_io_counters(pernic=True)["lo"].bytes_sent - moved
                busy = peak_mb(processes[0].pid)
        finally:
            for process in processes:
                process.kill()
                process.wait()
    return {
        "seconds": seconds,
        "scheduler_mb": busy - idle,
        "scheduler_idle_mb": idle,
        "caller_mb": peak_mb(),
        "moved_mb": moved / 2**20,
    }


def main() -> None:
    args = command_line(__doc__, largest=NUMBERS[-1], child=())
    if args.child:
        card, way, output = args.child
        print(json.dumps(measure(Path(card), way, Path(output))))
        return
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = {"TEXCLASS_DATA": name, "TEXCLASS_CACHE": str(folder / "cache")}
        cards = {n: card_of(folder, n, SECONDS, folder / "pool") for n in NUMBERS if n <= args.largest}
        for n, card in cards.items():
            for way in WAYS:
                child = [
                    sys.executable,
                    __file__,
                    "--child",
                    str(card),
                    way,
                    str(folder / f"{n}-{way}.parquet"),
                ]
                completed = subprocess.run(
                    child, check=True, capture_output=True, text=True, env=os.environ | settings
                )
                rows.append({"n": n, "way": way, **json.loads(completed.stdout)})
                print(rows[-1], flush=True)
    frame = pd.DataFrame(rows)
    far = []
    for way, runs in frame.groupby("way", sort=False):
        for n in FAR:
            lines = {k: float(np.polynomial.Polynomial.fit(runs["n"], runs[k], 1)(n)) for k in FIGURES}
            far.append({"n": n, "way": way, **lines})
    result = {
        "runs": rows,
        "extrapolated": far,
        "recording_s": SECONDS,
        "n_workers": N_WORKERS,
        "seed": SEED,
        "input_hash": f"n recordings of {SECONDS:g} s at {FS} Hz from seed {SEED}",
        "versions": versions("numpy", "scipy", "distributed", "joblib", "pyarrow"),
    }
    columns = (
        "recordings = {n:,} | way = {title} | s = {seconds:.1f} | recordings a second = {rate:.0f} | "
        "scheduler, MB more = {scheduler_mb:.0f} | caller, MB at most = {caller_mb:.0f} | "
        "moved, MB = {moved_mb:.1f}"
    )
    table_rows = [
        [row | {"title": WAYS[row["way"]], "rate": row["n"] / row["seconds"]} for row in group]
        for group in (rows, far)
    ]
    blocks = [
        f"Recordings of {SECONDS:g} s from WAV files to Parquet, {N_WORKERS} workers of one thread on this "
        f"machine. A scheduler at rest holds {frame['scheduler_idle_mb'].median():.0f} MB.",
        table(table_rows[0], columns),
        Heading("Extrapolated"),
        "Straight lines through the runs above: not measured.",
        table(table_rows[1], columns),
    ]
    write(args.out, "cluster", result, "Many recordings on a cluster", blocks)


if __name__ == "__main__":
    main()
