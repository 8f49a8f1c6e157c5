"""A scene of 20 surfaces: saving by the plan, time per sample, and bound of the output.

Run it by hand from the project's root, best on a quiet machine: `python
benchmarks/scene_render.py`. It writes reports/studies/scene.json. `--paced` adds a run that
waits for each millisecond, as a haptic loop does (2 minutes). `--samples`, `--paths`: timed and tried.
"""

import hashlib
import json
import os
import platform
from dataclasses import replace

import numpy as np
from study import command_line, table, write

from texclass.haptics.scene import PlannedScene, SceneRenderer, plan_scene, read_scene
from texclass.haptics.scene.measurement import garbage_collection_off, time_quantiles, time_steps
from texclass.haptics.scene.renderer import PEAK_FACTOR
from texclass.haptics.textures.grid import GridModel
from texclass.reporting import Heading

SCENE, CONTACTS, ORDER = "twenty", 4, 400
N_RUNS, PATH_SAMPLES = 5, 2000
LIMITS = {"planned": 10.0, f"order {ORDER}": 100.0}


def order_400(seed: int) -> PlannedScene:
    """A scene of one surface whose model has order 400 at 4 by 3 nodes."""
    k = np.random.default_rng(seed).uniform(-0.3, 0.3, (4, 3, ORDER))
    speeds, forces = np.geomspace(40, 200, 4), np.geomspace(0.4, 2, 3)
    model = GridModel((speeds, forces), k, np.ones((4, 3)), 4.0)
    return PlannedScene("400", 1000.0, "m/s^2", (20.0, 450.0), 30.0, CONTACTS, {"it": 0}, (model,))


def timings(scene: PlannedScene, n: int, *, paced: bool) -> dict[str, dict[str, float]]:
    """Microseconds of one sample of all contacts, over n of them at the scene's rate."""
    renderer, names = SceneRenderer(scene, n_contacts=CONTACTS), list(scene.model_indices)
    motion = (40.0, 200.0), (0.4, 2.0)
    with garbage_collection_off():
        runs = np.stack([time_steps(renderer, names, *motion, n) for _ in range(N_RUNS)])
        quantiles = {"quiet": time_quantiles(runs.min(axis=0)), "one run": time_quantiles(runs[0])}
        if paced:
            alone = time_steps(renderer, names, *motion, n, real_time=True)
            quantiles["paced"] = time_quantiles(alone)
    return quantiles


def random_path(
    rng: np.random.Generator, names: list[str | None], n: int
) -> tuple[np.ndarray, np.ndarray, list[list[str | None]]]:
    """Jumps of speed (0.01 to 10,000 mm/s), force, direction and surface of all contacts, and lifts."""
    pieces = rng.integers(5, 60, n // 5)
    stay = np.repeat(np.arange(pieces.size), pieces)[:n]
    size = CONTACTS, pieces.size
    speed, angle = 10.0 ** rng.uniform(-2, 4, size), rng.uniform(0, 2 * np.pi, size)
    velocity = np.stack([speed * np.cos(angle), speed * np.sin(angle)], axis=-1)[:, stay]
    force = rng.choice([-1.0, 0.0, 0.01, 0.5, 2.0, 100.0], size)[:, stay]
    which = rng.integers(0, len(names), size)[:, stay]
    return velocity, force, [[names[i] for i in row] for row in which]


def largest_output(scene: PlannedScene, seed: int, n_paths: int) -> dict[str, float | bool]:
    """Return the largest sample over random paths without the limit of the device, and the bound."""
    scene = replace(scene, largest_output=1e6)
    renderer, rng = SceneRenderer(scene, n_contacts=CONTACTS, seed=seed), np.random.default_rng(seed)
    names: list[str | None] = [*scene.model_indices, None]
    peak, finite = 0.0, True
    for _ in range(n_paths):
        x = renderer.process(*random_path(rng, names, PATH_SAMPLES))
        peak, finite = max(peak, float(np.abs(x).max())), finite and bool(np.isfinite(x).all())
    bound = float(np.sqrt(2) * PEAK_FACTOR * max(m.peak for m in scene.models))
    return {"paths": n_paths, "finite": finite, "peak": peak, "bound": bound, "within": peak <= bound}


def main() -> None:
    args = command_line(__doc__, seed=0, paced=False, samples=60_000, paths=1000)
    definition = read_scene(SCENE)
    plan = plan_scene(definition)
    scenes = {"planned": plan.scene, f"order {ORDER}": order_400(args.seed)}
    result = {
        "plan": json.loads(plan.to_json()),
        "microseconds": {
            name: timings(scene, args.samples, paced=args.paced) for name, scene in scenes.items()
        },
        "bounded": (b := largest_output(plan.scene, args.seed, args.paths)),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        "seed": args.seed,
        "input_sha256": hashlib.sha256(definition.source.read_bytes()).hexdigest(),
    }
    t = definition.tolerance
    planned = [
        {
            "s": s,
            "m": s.model,
            "nodes": "x".join(map(str, s.model.n_nodes)),
            "worst": (min if t.score == "gfc" else max)(s.score["scores"]),
            "operations": s.model.operations(plan.scene.fs),
            "shared_from": s.shared_from or "",
        }
        for s in plan.surfaces
    ]
    clocks = [
        {"scene": scene, "clock": clock, "limit": LIMITS[scene], **quantiles}
        for scene, of_scene in result["microseconds"].items()
        for clock, quantiles in of_scene.items()
    ]
    blocks = [
        f"Scene `{SCENE}` (simulated surfaces), tolerance {t.score} {t.limit:g} "
        f"({t.aggregate} over the test set, level within {t.level_db:g} dB).",
        f"**{plan.saving:.1f} times fewer operations per sample** than order 400 everywhere "
        f"({plan.scene.operations:.0f} against {plan.operations_at_order_400:.0f} per contact, mean over the "
        f"surfaces); {sum(s.score['within_tolerance'] for s in plan.surfaces)} of {len(plan.surfaces)} "
        f"surfaces within the tolerance on held-out speeds and forces; {len(plan.scene.models)} models, "
        f"{plan.scene.n_bytes} bytes.",
        table(
            planned,
            "surface = {s.name} | family = {m.kind} | order = {m.order} | lines = {m.n_lines} | "
            "nodes = {nodes} | worst score = {worst:.3f} | "
            "of the tolerance = {s.score[tolerance_ratio]:.0%} | operations = {operations:.0f} | "
            "shared from = {shared_from}",
            n_words=2,
        ),
        Heading(f"Microseconds per sample, {CONTACTS} contacts, {args.samples / 1000:g} s at 1 kHz"),
        table(
            clocks,
            "scene = {scene} | clock = {clock} | p50 = {p50:.1f} | p99 = {p99:.1f} | p99.9 = {p999:.1f} | "
            "worst = {worst:.1f} | limit for p99.9 = {limit:g}",
            "One sample a call, one thread. quiet: each sample counts with the least of five runs of the "
            "same path, which leaves out what else the machine did; one run: the clock as it was. Python's "
            "call and the clock are within both; the garbage collector is frozen and off, as in a haptic "
            "loop.",
            n_words=2,
        ),
        f"Over {b['paths']} random paths of {CONTACTS} contacts: "
        f"{'all finite' if b['finite'] else 'NOT finite'}, largest {b['peak']:.2f} m/s^2, stated bound "
        f"{b['bound']:.2f} ({PEAK_FACTOR:g} x the recorded peak, sqrt(2) x that in a crossfade; the device's "
        "largest output bounds it further).",
    ]
    write(args.out, "scene", result, "A scene of 20 surfaces: planned, tested, rendered", blocks)


if __name__ == "__main__":
    main()
