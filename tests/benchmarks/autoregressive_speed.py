"""What autoregressive fits and lattices cost beside librosa and scipy, and what each makes of hard signals.

Run it by hand from the project's root: `python tests/benchmarks/autoregressive_speed.py`. It writes
reports/studies/autoregressive.json and .md. One thread; CPU time of that thread; all candidates take turns
within each round, and medians over rounds are compared.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import platform
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import librosa
import numba
import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import fft, linalg, signal

from texclass import __version__
from texclass.vibration.autoregressive import Autoregression, fit, from_direct_form
from texclass.vibration.lattice import Lattice, LatticeInverse, LatticeSynthesis

FS, N, ORDER = 10_000.0, 250_000, 400
WANTED = {18: 5000.0, 400: 300.0}
Real = NDArray[np.float64]


def solve_toeplitz(x: Real, order: int) -> Real:
    """Autocorrelation method as scipy offers it, with the autocorrelation by FFT."""
    size = fft.next_fast_len(2 * x.size, real=True)
    r = fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[: order + 1]
    return np.concatenate([[1.0], linalg.solve_toeplitz(r[:-1], -r[1:])])


def burg_of_librosa(x: Real, order: int) -> Real:
    """Burg's method as librosa offers it."""
    return np.asarray(librosa.lpc(x, order=order))


def medians(candidates: dict[str, Callable[[], object]], n_rounds: int) -> dict[str, float]:
    """Median CPU time of each candidate in s, all taking turns, after two rounds of warming up."""
    spent: dict[str, list[float]] = {name: [] for name in candidates}
    for i in range(n_rounds + 2):
        for name, call in candidates.items():
            start = time.thread_time()
            call()
            if i >= 2:
                spent[name].append(time.thread_time() - start)
    return {name: float(np.median(values)) for name, values in spent.items()}


def fits(n_rounds: int) -> dict[str, float]:
    """Milliseconds per fit of one recording."""
    x = signal.lfilter([1.0], [1.0, -1.6, 0.8], np.random.default_rng(0).standard_normal(N))
    hard = np.hanning(N) * oversampled(N)
    candidates: dict[str, Callable[[], object]] = {
        "burg": lambda: fit(x, ORDER, method="burg"),
        "librosa.lpc": lambda: burg_of_librosa(x, ORDER),
        "autocorrelation": lambda: fit(x, ORDER, method="autocorrelation"),
        "autocorrelation, windowed and oversampled": lambda: fit(hard, ORDER, method="autocorrelation"),
        "solve_toeplitz": lambda: solve_toeplitz(x, ORDER),
    }
    return {name: 1e3 * value for name, value in medians(candidates, n_rounds).items()}


def real_time(n_rounds: int) -> dict[str, dict[str, float]]:
    """How many times faster than real time at 10 kHz, per order and arithmetic."""
    result = {}
    for order in WANTED:
        for dtype in (np.float64, np.float32):
            times = medians(lattices(order, dtype), n_rounds)
            result[f"{order}, {np.dtype(dtype)}"] = {k: 100_000 / FS / v for k, v in times.items()}
    return result


def lattices(order: int, dtype: type) -> dict[str, Callable[[], object]]:
    """Ten seconds of sound each way."""
    rng = np.random.default_rng(order)
    model = Autoregression(rng.uniform(-0.9, 0.9, order) * np.exp(-np.arange(order) / 5), np.asarray(1.0))
    other = Autoregression(-model.reflection, np.asarray(2.0))
    e, a = rng.standard_normal(100_000).astype(dtype), model.direct_form().astype(dtype)
    forth, back, gliding = (
        kind(model, dtype=dtype) for kind in (LatticeSynthesis, LatticeInverse, LatticeSynthesis)
    )

    def live() -> None:
        for start in range(0, e.size, 100):
            forth.process(e[start : start + 100])

    def glide(lattice: Lattice) -> None:
        for start in range(0, e.size, 1000):
            lattice.move_to(other if start // 1000 % 2 else model, 1000)
            lattice.process(e[start : start + 1000])

    return {
        "synthesis": lambda: forth.process(e),
        "synthesis, calls of 10 ms": live,
        "synthesis, always gliding": lambda: glide(gliding),
        "inverse": lambda: back.process(e),
        "scipy.signal.lfilter (direct form)": lambda: signal.lfilter(np.ones(1, dtype), a, e),
    }


def oversampled(n: int) -> Real:
    """Noise below 1/20 of the Nyquist frequency."""
    noise = np.random.default_rng(1).standard_normal(n)
    return np.asarray(signal.sosfilt(signal.butter(8, 1 / 20, output="sos"), noise))


def hard_signals(n: int = 20_000) -> dict[str, Real]:
    """Where fits break."""
    noise, sine = np.random.default_rng(2).standard_normal(n), np.sin(0.3 * np.arange(n))
    return {
        "zeros": np.zeros(n),
        "constant": np.ones(n),
        "pure sine": sine,
        "sine + 1e-8 noise": sine + 1e-8 * noise,
        "oversampled 20 times": oversampled(n),
        "oversampled, Hann window": np.hanning(n) * oversampled(n),
        "offset 1e6 + 1e-3 noise": 1e6 + 1e-3 * noise,
        "noise, gain 1e-160": 1e-160 * noise,
        "noise, gain 1e150": 1e150 * noise,
    }


def verdict(fitted: Callable[[Real, int], Autoregression | Real], x: Real, order: int) -> str:
    """Say whether a fit gave a stable model, and how much of the signal's RMS it leaves unpredicted."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = fitted(x, order)
        if not isinstance(model, Autoregression):
            if not np.all(np.isfinite(model)):
                return "NaN"
            model = from_direct_form(model, np.asarray(1.0))
    except ValueError as error:
        return "not stable" if "reflection" in str(error) else type(error).__name__
    except Exception as error:  # a report of what others do, whatever they do
        return type(error).__name__
    return f"stable, {residual(model, x):.1e}"


def residual(model: Autoregression, x: Real) -> float:
    """RMS of the forward residual over that of the signal, without the first p samples."""
    peak = np.abs(x).max()
    if peak == 0:
        return 0.0
    unit = x / peak
    error = LatticeInverse(Autoregression(model.reflection, np.asarray(0.0)), level=1.0).process(unit)
    gain = np.exp((np.log1p(model.reflection) + np.log1p(-model.reflection)).sum() / 2)
    return float(gain * np.sqrt(np.mean(error[model.order :] ** 2) / np.mean(unit**2)))


def hard(order: int = 32) -> dict[str, dict[str, str]]:
    """Verdicts of all candidates on all hard signals."""
    candidates: dict[str, Callable[[Real, int], Autoregression | Real]] = {
        "burg": lambda x, p: fit(x, p, method="burg"),
        "librosa.lpc": burg_of_librosa,
        "autocorrelation": lambda x, p: fit(x, p, method="autocorrelation"),
        "solve_toeplitz": solve_toeplitz,
    }
    return {
        name: {who: verdict(call, x, order) for who, call in candidates.items()}
        for name, x in hard_signals().items()
    }


def as_markdown(result: dict) -> str:  # type: ignore[type-arg]
    """Return the report for people."""
    ms, hard_rows, factors = result["fit_ms"], result["hard"], result["real_time"]
    lines = [
        "# Autoregressive fits and lattices",
        "",
        f"Order {ORDER}, one recording of {N} samples, one thread.",
    ]
    lines += ["", "| fit | ms |", "|---|---|", *(f"| {name} | {value:.1f} |" for name, value in ms.items())]
    lines += [
        "",
        f"Burg takes {ms['burg'] / ms['librosa.lpc']:.2f} of the time of `librosa.lpc`, autocorrelation "
        f"{ms['autocorrelation'] / ms['solve_toeplitz']:.2f} of that of `solve_toeplitz` + FFT (limit: 1).",
        "",
        "## Times real time at 10 kHz",
        "",
    ]
    names = list(next(iter(factors.values())))
    lines += ["| order, arithmetic | wanted | " + " | ".join(names) + " |", "|---" * (len(names) + 2) + "|"]
    for key, row in factors.items():
        wanted = WANTED[int(key.split(",")[0])]
        lines.append(f"| {key} | {wanted:.0f} | " + " | ".join(f"{row[n]:.0f}" for n in names) + " |")
    who = list(next(iter(hard_rows.values())))
    lines += [
        "",
        "## Hard signals, order 32",
        "",
        "What is left of the signal (RMS) by the model returned.",
        "",
    ]
    lines += ["| signal | " + " | ".join(who) + " |", "|---" * (len(who) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(row[w] for w in who) + " |" for name, row in hard_rows.items()]
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
        "fit_ms": fits(options.rounds),
        "real_time": real_time(options.rounds),
        "hard": hard(),
        "n_rounds": options.rounds,
        "input": {"fs": FS, "n": N, "order": ORDER},
        "versions": {
            "texclass": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "librosa": librosa.__version__,
            "numba": numba.__version__,
        },
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "autoregressive.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.out / "autoregressive.md").write_text(as_markdown(result), encoding="utf-8")
    print(as_markdown(result))


if __name__ == "__main__":
    main()
