"""Line spectral frequencies there and back: accuracy on twelve hard signals, time against `np.roots`.

Run it by hand from the project's root: `python tests/benchmarks/line_spectrum_speed.py`. It writes
reports/studies/line_spectrum.json and .md. One thread; CPU time of that thread; the three ways take turns
within each round and medians over rounds are compared, so that a loaded machine slows all alike.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy
from scipy import signal

from texclass import __version__
from texclass.vibration.line_spectrum import conditioning, from_reflection, log_spectrum, to_reflection

N_SAMPLES, N_FREQUENCIES = 8192, 4096
ORDERS = (16, 32, 64, 128, 400, 1000)
LIMITS_DB = {128: 1e-8, 400: 1e-6, 1000: 1e-3}
SPEED_LIMITS = {400: 10.0, 1000: 30.0}


def hard_signals(seed: int = 0) -> dict[str, np.ndarray]:
    """Twelve signals whose models are hard to hold."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(N_SAMPLES)
    sine = np.sin(0.3 * np.arange(N_SAMPLES))

    def resonant(radius: float) -> np.ndarray:
        return np.asarray(signal.lfilter([1.0], [1.0, -2 * radius * np.cos(0.7), radius**2], noise))

    def oversampled(factor: int) -> np.ndarray:
        spectrum = np.fft.rfft(noise)
        spectrum[len(spectrum) // factor :] = 0
        return np.fft.irfft(spectrum)

    return {
        "white": noise,
        "resonant, radius 1 - 1e-2": resonant(1 - 1e-2),
        "resonant, radius 1 - 1e-4": resonant(1 - 1e-4),
        "resonant, radius 1 - 1e-6": resonant(1 - 1e-6),
        "resonant, radius 1 - 1e-9": resonant(1 - 1e-9),
        "sine + 1e-8 noise": sine + 1e-8 * noise,
        "two sines + 1e-8 noise": sine + np.cos(2.9 * np.arange(N_SAMPLES)) + 1e-8 * noise,
        "low-passed by 20": oversampled(20),
        "low-passed by 20 + 1e-6 noise": oversampled(20) + 1e-6 * rng.standard_normal(N_SAMPLES),
        "gain 1e-160": 1e-160 * resonant(0.99),
        "gain 1e150": 1e150 * resonant(0.99),
        "DC 1e6 + noise 1e-3": 1e6 + 1e-3 * noise,
    }


def burg(x: np.ndarray, order: int) -> np.ndarray:
    """Reflection coefficients by Burg's recursion, scaled by a power of two first."""
    x = np.ldexp(x, -np.frexp(np.abs(x).max())[1])
    f, b, k = x[1:].copy(), x[:-1].copy(), np.zeros(order)
    for m in range(order):
        below_one = np.nextafter(1.0, 0.0)
        k[m] = np.clip(-2 * np.dot(f, b) / (np.dot(f, f) + np.dot(b, b)), -below_one, below_one)
        f, b = (f + k[m] * b)[1:], (b + k[m] * f)[:-1]
    return k


def accuracy() -> list[dict[str, object]]:
    """Return, per signal and order, what k -> LSF -> k does."""
    omega = (np.arange(N_FREQUENCIES) + 0.5) * np.pi / N_FREQUENCIES
    rows: list[dict[str, object]] = []
    for name, x in hard_signals().items():
        whole = burg(x, max(ORDERS))
        for p in ORDERS:
            k = whole[:p]  # Burg's first p are the model of order p
            lsf = from_reflection(k)
            back = to_reflection(lsf)
            error = log_spectrum(back, omega) - log_spectrum(k, omega)
            between = (lsf[1:] + lsf[:-1]) / 2  # where the resonances are
            at_peaks = log_spectrum(back, between) - log_spectrum(k, between)
            rows.append(
                {
                    "signal": name,
                    "p": p,
                    "stable": bool(np.all(np.abs(back) < 1)),
                    "interlaced": bool(np.all(np.diff(lsf) > 0) and lsf[0] > 0 and lsf[-1] < np.pi),
                    "rms_db": float(np.sqrt(np.mean(error**2))),
                    "max_db": float(np.abs(error).max()),
                    "max_db_at_resonances": float(np.abs(at_peaks).max()),
                    "max_k_error": float(np.abs(back - k).max()),
                    "conditioning": float(conditioning(lsf)),
                }
            )
    return rows


def seconds(call: Callable[[], object]) -> float:
    """CPU time of this thread."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


def step_up(k: np.ndarray) -> np.ndarray:
    """Coefficients of A."""
    a = np.ones(1)
    for k_m in k:
        a = np.append(a, 0.0)
        a = a + k_m * a[::-1]
    return a


def speed(n_rounds: int) -> list[dict[str, float]]:
    """Return, per order, medians in ms of `np.roots` of P and Q, of k -> LSF, and of LSF -> k."""
    whole = burg(hard_signals()["resonant, radius 1 - 1e-2"], max(ORDERS))
    rows = []
    for p in ORDERS:
        k = whole[:p]
        lsf = from_reflection(k)
        a = np.append(step_up(k), 0.0)
        ways: dict[str, Callable[[], object]] = {
            "roots": lambda a=a: (np.roots(a + a[::-1]), np.roots(a - a[::-1])),  # type: ignore[misc]
            "forward": lambda k=k: from_reflection(k),  # type: ignore[misc]
            "inverse": lambda lsf=lsf: to_reflection(lsf),  # type: ignore[misc]
        }
        rounds = n_rounds if p <= 400 else max(n_rounds // 3, 2)
        taken: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(rounds):
            for name, way in ways.items():
                taken[name].append(seconds(way))
        row = {f"{name}_ms": 1e3 * float(np.median(times)) for name, times in taken.items()}
        rows.append({"p": p, **row, "times_faster": row["roots_ms"] / row["forward_ms"]})
    return rows


def as_markdown(result: dict) -> str:  # type: ignore[type-arg]
    """Return the report for people."""
    rows = result["accuracy"]
    lines = [
        "# Line spectral frequencies, there and back",
        "",
        f"Twelve signals of {N_SAMPLES} samples, Burg; k -> LSF -> k. Log spectra by the lattice "
        f"at {N_FREQUENCIES} frequencies. Worst over the twelve signals:",
        "",
        "| p | stable | interlaced | RMS difference (dB) | at most | largest (dB) | conditioning |",
        "|---|---|---|---|---|---|---|",
    ]
    for p in ORDERS:
        of_p = [row for row in rows if row["p"] == p]
        worst = {key: max(row[key] for row in of_p) for key in ("rms_db", "max_db", "conditioning")}
        counts = [f"{sum(row[key] for row in of_p)}/{len(of_p)}" for key in ("stable", "interlaced")]
        limit = f"{LIMITS_DB[p]:g}" if p in LIMITS_DB else ""
        lines.append(
            f"| {p} | {counts[0]} | {counts[1]} | {worst['rms_db']:.1e} | {limit} | {worst['max_db']:.1e} "
            f"| {worst['conditioning']:.1e} |"
        )
    lines += [
        "",
        "`conditioning` is the part of the narrowest gap between two frequencies that is rounding: where it "
        "comes near 1, the spectrum is kept but for the tip of that resonance, and k is not. Per signal, at "
        "the resonances (midway between neighbours):",
        "",
        "| signal | p | RMS (dB) | largest at resonances (dB) | largest error of k | conditioning |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        if row["p"] in LIMITS_DB:
            lines.append(
                f"| {row['signal']} | {row['p']} | {row['rms_db']:.1e} | {row['max_db_at_resonances']:.1e} "
                f"| {row['max_k_error']:.1e} | {row['conditioning']:.1e} |"
            )
    lines += [
        "",
        "## Time",
        "",
        "| p | `np.roots` of P and Q (ms) | k -> LSF (ms) | times faster | at least | LSF -> k (ms) |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["speed"]:
        limit = f"{SPEED_LIMITS[row['p']]:g}" if row["p"] in SPEED_LIMITS else ""
        lines.append(
            f"| {row['p']} | {row['roots_ms']:.2f} | {row['forward_ms']:.3f} | {row['times_faster']:.0f} "
            f"| {limit} | {row['inverse_ms']:.3f} |"
        )
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return "\n".join([*lines, "", f"Versions: {versions}."]) + "\n"


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).resolve().parents[2] / "reports" / "studies"
    )
    options = parser.parse_args()
    result = {
        "accuracy": accuracy(),
        "speed": speed(options.rounds),
        "n_rounds": options.rounds,
        "input": {"n_samples": N_SAMPLES, "n_frequencies": N_FREQUENCIES, "seed": 0},
        "versions": {
            "texclass": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "line_spectrum.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.out / "line_spectrum.md").write_text(as_markdown(result), encoding="utf-8")
    print(as_markdown(result))


if __name__ == "__main__":
    main()
