"""Line spectral frequencies: round-trip accuracy on twelve hard signals, and time against `np.roots`.

`python benchmarks/line_spectrum_speed.py [--rounds N] [--largest P]` writes
reports/studies/line_spectrum. One thread; CPU time of that thread; the three ways take turns within each
round, and medians over rounds are compared.
"""

import numpy as np
import pandas as pd
from scipy import signal
from study import command_line, in_turns, table, write

from texclass.reporting import Heading
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.line_spectrum import conditioning, from_reflection, to_reflection

N_SAMPLES, N_FREQUENCIES = 8192, 4096
ORDERS = (16, 32, 64, 128, 400, 1000)
LIMITS_DB = {128: 1e-8, 400: 1e-6, 1000: 1e-3}
SPEED_LIMITS = {400: 10.0, 1000: 30.0}


def hard_signals(seed: int = 0) -> dict[str, np.ndarray]:
    """Twelve signals whose models are hard to hold."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(N_SAMPLES)
    sine = np.sin(0.3 * np.arange(N_SAMPLES))

    def resonant(distance: float) -> np.ndarray:
        radius = 1 - distance
        return np.asarray(signal.lfilter([1.0], [1.0, -2 * radius * np.cos(0.7), radius**2], noise))

    spectrum = np.fft.rfft(noise)
    spectrum[len(spectrum) // 20 :] = 0
    low_passed = np.fft.irfft(spectrum)
    return {
        "white": noise,
        **{f"resonant, radius 1 - 1e-{n}": resonant(10.0**-n) for n in (2, 4, 6, 9)},
        "sine + 1e-8 noise": sine + 1e-8 * noise,
        "two sines + 1e-8 noise": sine + np.cos(2.9 * np.arange(N_SAMPLES)) + 1e-8 * noise,
        "low-passed by 20": low_passed,
        "low-passed by 20 + 1e-6 noise": low_passed + 1e-6 * rng.standard_normal(N_SAMPLES),
        "gain 1e-160": 1e-160 * resonant(0.01),
        "gain 1e150": 1e150 * resonant(0.01),
        "DC 1e6 + noise 1e-3": 1e6 + 1e-3 * noise,
    }


def burg(x: np.ndarray, order: int) -> np.ndarray:
    """Reflection coefficients by Burg's recursion, scaled by a power of two first."""
    x = np.ldexp(x, -np.frexp(np.abs(x).max())[1])
    f, b, k = x[1:].copy(), x[:-1].copy(), np.zeros(order)
    below_one = np.nextafter(1.0, 0.0)
    for m in range(order):
        k[m] = np.clip(-2 * np.dot(f, b) / (np.dot(f, f) + np.dot(b, b)), -below_one, below_one)
        f, b = (f + k[m] * b)[1:], (b + k[m] * f)[:-1]
    return k


def accuracy(orders: list[int]) -> pd.DataFrame:
    """Return, per signal and order, what k -> LSF -> k does."""
    omega = (np.arange(N_FREQUENCIES) + 0.5) * np.pi / N_FREQUENCIES
    rows = []
    for name, x in hard_signals().items():
        whole = burg(x, max(orders))
        for p in orders:
            k = whole[:p]  # Burg's first p are the model of order p
            lsf = from_reflection(k)
            back = to_reflection(lsf)
            model, recovered = Autoregression(k, 1.0), Autoregression(back, 1.0)
            error = recovered.log_spectrum_db(omega) - model.log_spectrum_db(omega)
            midpoints = (lsf[1:] + lsf[:-1]) / 2  # where the resonances are
            at_peaks = recovered.log_spectrum_db(midpoints) - model.log_spectrum_db(midpoints)
            rows.append(
                {
                    "signal": name,
                    "p": p,
                    "stable": bool(np.all(np.abs(back) < 1)),
                    "interlaced": bool(np.all(np.diff(lsf) > 0) and lsf[0] > 0 and lsf[-1] < np.pi),
                    "rms_db": np.sqrt(np.mean(error**2)),
                    "max_db": np.abs(error).max(),
                    "max_db_at_resonances": np.abs(at_peaks).max(),
                    "max_k_error": np.abs(back - k).max(),
                    "conditioning": conditioning(lsf),
                }
            )
    return pd.DataFrame(rows)


def speed(orders: list[int], n_rounds: int) -> list[dict[str, float]]:
    """Return, per order, medians in ms of `np.roots` of P and Q, of k -> LSF, and of LSF -> k."""
    whole = burg(hard_signals()["resonant, radius 1 - 1e-2"], max(orders))
    rows = []
    for p in orders:
        k, a = whole[:p], np.ones(1)
        lsf = from_reflection(k)
        for k_m in k:  # step up to the coefficients of A
            a = np.append(a, 0.0)
            a = a + k_m * a[::-1]
        a = np.append(a, 0.0)
        ways = {
            "roots_ms": lambda a=a: (np.roots(a + a[::-1]), np.roots(a - a[::-1])),
            "forward_ms": lambda k=k: from_reflection(k),
            "inverse_ms": lambda lsf=lsf: to_reflection(lsf),
        }
        times = in_turns(ways, n_rounds if p <= 400 else max(n_rounds // 3, 2), n_warm=0)
        row = (1e3 * times.median()).to_dict()
        rows.append({"p": p, **row, "times_faster": row["roots_ms"] / row["forward_ms"]})
    return rows


def main() -> None:
    args = command_line(__doc__, rounds=9, largest=max(ORDERS))
    orders = [p for p in ORDERS if p <= args.largest]
    errors = accuracy(orders)
    result = {
        "accuracy": errors.to_dict("records"),
        "speed": speed(orders, args.rounds),
        "n_rounds": args.rounds,
        "input": {"n_samples": N_SAMPLES, "n_frequencies": N_FREQUENCIES, "seed": 0},
    }
    of_p = errors.groupby("p")
    worst = of_p[["rms_db", "max_db", "conditioning"]].max().join(of_p[["stable", "interlaced"]].sum())
    worst["n"], worst["limit"] = of_p.size(), [LIMITS_DB.get(p, "") for p in worst.index]
    blocks = [
        f"Twelve signals of {N_SAMPLES} samples, Burg; k -> LSF -> k. Log spectra by the lattice "
        f"at {N_FREQUENCIES} frequencies. Worst over the twelve signals:",
        table(
            worst.reset_index(),
            "p = {p} | stable = {stable}/{n} | interlaced = {interlaced}/{n} | "
            "RMS difference (dB) = {rms_db:.1e} | at most = {limit} | largest (dB) = {max_db:.1e} | "
            "conditioning = {conditioning:.1e}",
        ),
        "`conditioning` is the part of the narrowest gap between two frequencies that is rounding: where it "
        "comes near 1, the spectrum is kept but for the tip of that resonance, and k is not. Per signal, at "
        "the resonances (midway between neighbours):",
        table(
            errors[errors["p"].isin(LIMITS_DB)],
            "signal = {signal} | p = {p} | RMS (dB) = {rms_db:.1e} | "
            "largest at resonances (dB) = {max_db_at_resonances:.1e} | "
            "largest error of k = {max_k_error:.1e} | conditioning = {conditioning:.1e}",
        ),
        Heading("Time"),
        table(
            ({"limit": SPEED_LIMITS.get(row["p"], ""), **row} for row in result["speed"]),
            "p = {p} | `np.roots` of P and Q (ms) = {roots_ms:.2f} | k -> LSF (ms) = {forward_ms:.3f} | "
            "times faster = {times_faster:.0f} | at least = {limit} | LSF -> k (ms) = {inverse_ms:.3f}",
        ),
    ]
    write(args.out, "line_spectrum", result, "Line spectral frequencies: round trip", blocks)


if __name__ == "__main__":
    main()
