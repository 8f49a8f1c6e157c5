"""Speed-up of `extract` and `benchmark` with two processes instead of one, on `biotac20`.

`python benchmarks/two_processes.py` (5 minutes) writes reports/studies/two_processes. Runs with one and two
processes take turns, each with an empty cache and compiled functions. Each process counts its CPU time. The
speed-up is the CPU time with one process over that of the busiest of two: what wall time shows on a machine
with two idle cores, and what other work on the machine hardly changes. Wall times are given beside it.
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
from study import command_line, table, write

from texclass.loaders import open_dataset

COMMANDS = {"extract": "table.parquet", "benchmark": "results"}
AIM = 1.6


def run(command: str, n_jobs: int) -> dict[str, float]:
    """Run a command in a process of its own; return wall time and CPU time of both processes in s."""
    with tempfile.TemporaryDirectory() as folder:
        child = [sys.executable, __file__, "--child", command, str(n_jobs), folder]
        load, start = os.getloadavg()[0], time.perf_counter()
        env = os.environ | {"TEXCLASS_CACHE": f"{folder}/cache"}
        subprocess.run(child, check=True, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wall_s = time.perf_counter() - start
        cpu_s = json.loads(Path(folder, "cpu.json").read_text(encoding="utf-8"))
    return {"jobs": n_jobs, "load": load, "wall_s": wall_s, "main_s": cpu_s[0], "worker_s": sum(cpu_s[1:])}


def run_here(command: str, n_jobs: int, folder: Path) -> None:
    """Run a command in this process, and write the CPU time of this process and of its worker."""
    from texclass.cli import main
    from texclass.evaluation import workers

    output = str(folder / COMMANDS[command])
    sys.argv = ["texclass", command, "biotac20", "--jobs", str(n_jobs), "-o", output]
    try:
        main()
    except SystemExit as stop:
        if stop.code:
            raise
    cpu_s = [time.process_time()]
    if n_jobs > 1:
        cpu_s.append(workers._executor(n_jobs - 1).submit(time.process_time).result())
    (folder / "cpu.json").write_text(json.dumps(cpu_s), encoding="utf-8")


def speed_up(runs: pd.DataFrame) -> dict[str, Any]:
    """Return the median over rounds of CPU times in s, and of the speed-up with its range."""
    one, two = (runs[runs["jobs"] == n].reset_index(drop=True) for n in (1, 2))
    busiest = two[["main_s", "worker_s"]].max(axis=1)
    ratios, wall = one["main_s"] / busiest, one["wall_s"] / two["wall_s"]
    return {
        "one_s": one["main_s"].median(),
        "main_s": two["main_s"].median(),
        "worker_s": two["worker_s"].median(),
        "speed_up": ratios.median(),
        "low": ratios.min(),
        "high": ratios.max(),
        "balanced": float(np.median(2 * one["main_s"] / (two["main_s"] + two["worker_s"]))),
        "wall": wall.median(),
        "load": runs["load"].median(),
    }


def main() -> None:
    args = command_line(__doc__, rounds=5)
    for command in COMMANDS:
        run(command, 1)  # compiles functions
    runs = pd.DataFrame(
        {"command": command, **run(command, n_jobs)}
        for _ in range(args.rounds)
        for command in COMMANDS
        for n_jobs in (1, 2)
    )
    rows = [{"command": name, **speed_up(group)} for name, group in runs.groupby("command", sort=False)]
    dataset = open_dataset("biotac20")
    result = {"rows": rows, "runs": runs.to_dict("records"), "input_hash": dataset.input_hash, "aim": AIM}
    blocks = [
        f"`texclass extract biotac20` and `texclass benchmark biotac20`, {len(dataset)} recordings, nothing "
        f"cached, from start to end; medians of {args.rounds} rounds in turns, CPU time in s. The speed-up "
        "(smallest to largest of the rounds) is the CPU time of one process over that of the busiest of two; "
        f"the aim is {AIM}. Balanced: if both processes shared the same total equally.",
        table(
            rows,
            "command = {command} | one process = {one_s:.1f} | two: calling process = {main_s:.1f} | "
            "two: worker = {worker_s:.1f} | speed-up = {speed_up:.2f} ({low:.2f} to {high:.2f}) | "
            "balanced = {balanced:.2f} | wall time = {wall:.2f} | load average = {load:.1f}",
        ),
        "Wall time: ratio of the wall times of the same runs. With a load average above 1, other work took "
        "part of the two cores, and the ratio says little.",
    ]
    write(args.out, "two_processes", result, "Speed-up with two processes", blocks)


if __name__ == "__main__":
    if "--child" in sys.argv:
        run_here(sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]))
    else:
        main()
