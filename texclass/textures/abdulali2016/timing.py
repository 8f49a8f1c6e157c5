"""How long fitting and rendering take."""

from dataclasses import dataclass
from time import perf_counter, thread_time_ns

import numpy as np

from texclass.textures.abdulali2016.baked import bake
from texclass.textures.abdulali2016.fitting import model_scan
from texclass.textures.abdulali2016.segmentation import segment_input
from texclass.textures.abdulali2016.simulated import simulate_scan, surface
from texclass.textures.contract import Texture


@dataclass(frozen=True)
class FitTime:
    """Seconds to segment and to fit a 20 s recording.

    Attributes
    ----------
    fs : float
        Hz.
    order : int
    segmenting_s, fitting_s : float
        The second includes the first.
    baking_s : float
        To read the network at the nodes of the grid.
    """

    fs: float
    order: int
    segmenting_s: float
    fitting_s: float
    baking_s: float


@dataclass(frozen=True)
class RenderTime:
    """Time of one step of several contacts, one sample per call.

    Attributes
    ----------
    family : str
    order, n_contacts, n_steps : int
    median_us, p999_us : float
        By the clock; on a busy machine the tail is that of other programs.
    cpu_median_us, cpu_p999_us : float
        Time of this thread on the processor.
    operations : float
        Counted, per sample of one contact.
    """

    family: str
    order: int
    n_contacts: int
    n_steps: int
    median_us: float
    p999_us: float
    cpu_median_us: float
    cpu_p999_us: float
    operations: float


def time_fit(fs: float, order: int, seed: int = 0) -> FitTime:
    """Time the fit of 20 s at a rate (Hz) and order; kernels are compiled before."""
    scan = simulate_scan(surface("S2"), 20.0, fs, np.random.default_rng(seed))
    model_scan(scan.part(0, len(scan) // 4), order=8)
    start = perf_counter()
    segment_input(scan)
    segmented = perf_counter()
    texture = model_scan(scan, order=order).network()
    fitted = perf_counter()
    bake(texture, "S2")
    return FitTime(fs, order, segmented - start, fitted - segmented, perf_counter() - fitted)


def time_rendering(
    texture: Texture, *, n_contacts: int = 4, n_steps: int = 10_000, seed: int = 0
) -> RenderTime:
    """Time a loop that asks each of several contacts for one sample at a time, each on a path of its own."""
    rng = np.random.default_rng(seed)
    renderers = [texture.renderer(seed=i) for i in range(n_contacts)]
    t = np.arange(n_steps) / texture.fs
    swing = np.sin(
        2 * np.pi * rng.uniform(0.3, 2, (n_contacts, 3, 1)) * t + rng.uniform(0, 6, (n_contacts, 3, 1))
    )
    velocity, force = 120 * np.moveaxis(swing[:, :2], 1, 2), 1 + swing[:, 2]
    clock, cpu = np.empty(n_steps), np.empty(n_steps)
    for i in range(n_steps):
        start, cpu_start = perf_counter(), thread_time_ns()
        for contact, renderer in enumerate(renderers):
            renderer.process(velocity[contact, i : i + 1], force[contact, i : i + 1])
        cpu[i], clock[i] = (thread_time_ns() - cpu_start) / 1e3, 1e6 * (perf_counter() - start)
    (median, tail), (cpu_median, cpu_tail) = (
        np.percentile(x[n_steps // 10 :], [50, 99.9]).tolist() for x in (clock, cpu)
    )
    order = int(getattr(texture, "order", 0))
    return RenderTime(
        texture.family, order, n_contacts, n_steps, median, tail, cpu_median, cpu_tail, texture.operations
    )
