"""Time per sample of `texclass_render.h`, compiled on this machine, next to `SceneRenderer` in Python.

`python benchmarks/c_renderer.py` (half a minute, needs a C compiler) writes reports/studies/c_renderer. Times
are medians over 7 runs of 200,000 samples of one contact at varying speed and force, at 1 kHz.
"""

import os
import platform
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from study import command_line, table, write

from texclass.haptics.scene import PlannedScene, SceneRenderer, write_c_header
from texclass.haptics.textures.grid import GridModel

N, N_RUNS = 200_000, 7
PROGRAM = r"""
#include <stdio.h>
#include <time.h>
#include "scene.h"

static double voices[SCENE_VOICES];
static texclass_contact contact;

int main(void) {
  double sum = 0;
  texclass_start(&contact, &scene_scene, voices, SCENE_SEED);
  texclass_touch(&contact, 0);
  const clock_t start = clock();
  for (int t = 0; t < %d; t++) {
    sum += texclass_step(&contact, 60.0 + 1e-3 * (t %% 100000), 0.0, 1.0 + 1e-5 * (t %% 50000));
  }
  printf("%%.3f\n", 1e9 * (double)(clock() - start) / CLOCKS_PER_SEC / %d);
  return sum != sum;
}
"""


def make_scene(order: int, n_lines: int) -> PlannedScene:
    """Return a scene with one surface of 4 x 2 nodes at 1 kHz."""
    rng, nodes = np.random.default_rng(0), (np.geomspace(40, 250, 4), np.array([0.5, 2.0]))
    rows = np.concatenate([rng.uniform(-0.4, 0.4, (4, 2, order)), np.full((4, 2, n_lines), 0.1)], axis=-1)
    lines = np.linspace(50, 400, n_lines)
    model = GridModel(nodes, rows, np.ones((4, 2)), 4.0, lines, np.zeros(n_lines))
    return PlannedScene.of_model("scene", 1000.0, "m/s^2", model)


def time_c(scene: PlannedScene) -> list[float]:
    """Return the nanoseconds per sample of each run of a compiled program."""
    compiler = shutil.which("cc") or "gcc"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_c_header(folder / "scene.h", scene)
        (folder / "main.c").write_text(PROGRAM % (N, N))
        program = folder / "main"
        subprocess.run([compiler, "-std=c99", "-O2", folder / "main.c", "-o", program, "-lm"], check=True)
        return [float(subprocess.check_output([program])) for _ in range(N_RUNS)]


def time_python(scene: PlannedScene) -> list[float]:
    """Return the nanoseconds per sample of blocks and of single steps in Python."""
    renderer, n = SceneRenderer(scene), N // 20
    renderer.touch(0, "scene")
    speed = np.full((1, n, 2), 60.0)
    start = time.thread_time()
    renderer.process(speed, np.ones((1, n)))
    middle = time.thread_time()
    for _ in range(n):
        renderer.step(0, 60.0, 0.0, 1.0)
    return [1e9 * (middle - start) / n, 1e9 * (time.thread_time() - middle) / n]


def main() -> None:
    """Time all models, and write the report."""
    args, rows = command_line(__doc__), []
    for order, n_lines in ((4, 0), (8, 0), (24, 0), (100, 0), (400, 0), (0, 8), (8, 8)):
        scene = make_scene(order, n_lines)
        block, step = np.median([time_python(scene) for _ in range(N_RUNS)], axis=0)
        ns = float(np.median(time_c(scene)))
        rows.append({"order": order, "lines": n_lines, "c": ns, "block": float(block), "step": float(step)})
    machine = f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    blocks = [
        table(
            rows,
            "order = {order} | lines = {lines} | C = {c:.0f} | Python, blocks = {block:.0f} | "
            "Python, one sample per call = {step:.0f}",
            f"Nanoseconds per sample of one contact at 1 kHz, 4 x 2 nodes, `cc -O2`. Machine: {machine}.",
        )
    ]
    write(args.out, "c_renderer", {"rows": rows, "machine": machine}, "Time per sample in C", blocks)


if __name__ == "__main__":
    main()
