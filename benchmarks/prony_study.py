"""Stability and accuracy of fits of decaying modes: matrix pencil and Prony's method as published.

`python benchmarks/prony_study.py` (some minutes) writes reports/studies/prony. `--segments`: fitted by
the pencil; `--published`, `--grown`: the first of them, fitted by Prony with an order drawn, and grown.
"""

import os
import time
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy.io import wavfile
from study import command_line, timed, write

from texclass.recording import Samples
from texclass.reporting import Heading, Table
from texclass.vibration import DecayingModes, fit_matrix_pencil, fit_prony
from texclass.vibration.decaying_modes import prony

SEED = 90217
"""Drawn for this study; the method was developed on other seeds.

One thing was learnt on it: a decomposition that did not converge, which changed the driver of the SVD.
"""
FS = 10_000.0
ONE = DecayingModes(np.array([100.0]), np.array([60.0]), np.array([1.0]), np.array([-np.pi / 2]))
N_ACCURACY = 400
SNRS_DB = (0, 5, 10, 15, 20, 30, 40, 60)
AIM_RATIO, AIM_BIAS = 1.5, 1.0
PENCIL, PRONY = "pencil, rank found", "Prony, order 2"


def noisy(clean: Samples, snr_db: float, rng: np.random.Generator) -> Samples:
    """Add white noise; the ratio is that of the mean powers over the segment."""
    return clean + level(clean) * 10 ** (-snr_db / 20) * rng.standard_normal(clean.size)


def level(x: Samples) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(x**2)))


def is_stable(modes: DecayingModes) -> bool:
    """Test the stored denominators in rational arithmetic: |a2| < 1 and |a1| < 1 + a2."""
    pairs = [(Fraction(a1), Fraction(a2)) for a1, a2 in modes.sections(FS)[:, 4:].tolist()]
    return all(abs(a2) < 1 and abs(a1) < 1 + a2 for a1, a2 in pairs)


def stability(n_segments: int, n_published: int, n_grown: int) -> pd.DataFrame:
    """Count unstable fits of each method; the published ones on the first segments only (their cost).

    Segments have 40-400 samples, 1-4 modes and noise at 0-60 dB; the order is drawn up to n/2.
    """
    rng, rows = np.random.default_rng(SEED), []
    for i in range(n_segments):
        n, n_modes = int(rng.integers(40, 401)), int(rng.integers(1, 5))
        clean = DecayingModes(
            rng.uniform(20, 2000, n_modes),
            rng.uniform(10, 800, n_modes),
            rng.uniform(0.3, 1, n_modes),
            rng.uniform(-np.pi, np.pi, n_modes),
        ).synthesize(n, FS)
        x = noisy(clean, rng.uniform(0, 60), rng)
        order = int(rng.integers(1, n // 2 + 1))
        ways = {
            PENCIL: partial(fit_matrix_pencil, x, FS),
            "pencil, order drawn": partial(fit_matrix_pencil, x, FS, order=order),
        }
        if i < n_published:
            ways["Prony, order drawn"] = partial(prony, x, order)
        if i < n_grown:
            ways["Prony, order grown to the noise"] = partial(fit_prony, x, float(np.mean(np.abs(x - clean))))
        for name, way in ways.items():
            fitted, seconds = timed(way, time.perf_counter)
            with np.errstate(over="ignore", invalid="ignore"):  # an unstable response may overflow
                if isinstance(fitted, DecayingModes):
                    sound, stable = fitted.synthesize(n, FS), is_stable(fitted)
                else:
                    sound, stable = fitted.synthesize(n), fitted.is_stable
                error = level(sound - clean) / level(clean)
            rows.append((name, not stable, error if np.isfinite(error) else np.inf, 1e3 * seconds))
    methods = pd.DataFrame(rows, columns=["method", "unstable", "error", "ms"]).groupby("method", sort=False)
    return pd.DataFrame(
        {
            "segments": methods.size(),
            "unstable": methods["unstable"].sum(),
            "error median": methods["error"].median(),
            "error 95 %": methods["error"].quantile(0.95, interpolation="lower"),
            "ms median": methods["ms"].median(),
        }
    )


def accuracy(n_trials: int) -> pd.DataFrame:
    """Error of frequency and decay of one mode at several noise levels, against the Cramer-Rao bound."""

    def pencil(x: Samples) -> tuple[float, float]:
        modes = fit_matrix_pencil(x, FS)
        return (modes.frequency_hz[0], modes.decay_per_s[0]) if modes.n_modes else (np.nan, np.nan)

    def published(x: Samples) -> tuple[float, float]:
        pole = np.roots(prony(x, 2).a)[0]
        return abs(np.angle(pole)) * FS / (2 * np.pi), -np.log(abs(pole)) * FS

    t = np.arange(N_ACCURACY)[:, np.newaxis] / FS
    angle = 2 * np.pi * ONE.frequency_hz * t + ONE.phase
    c, s = (ONE.amplitude * np.exp(-ONE.decay_per_s * t) * part(angle) for part in (np.cos, np.sin))
    J = np.hstack([-2 * np.pi * t * s, -t * c, c / ONE.amplitude, -s])
    of_unit_noise = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[:2]  # least errors of frequency and decay
    rng, rows = np.random.default_rng((SEED, 1)), []
    clean = ONE.synthesize(N_ACCURACY, FS)
    for snr in SNRS_DB:
        bound = level(clean) * 10 ** (-snr / 20) * of_unit_noise
        xs = [noisy(clean, snr, rng) for _ in range(n_trials)]
        for name, way in ((PENCIL, pencil), (PRONY, published)):
            values = np.array([way(x) for x in xs])
            is_finite = np.isfinite(values[:, 0])
            errors = values[is_finite] - [ONE.frequency_hz[0], ONE.decay_per_s[0]]
            rmse = np.sqrt(np.mean(errors**2, axis=0))
            rows.append(
                {
                    "SNR dB": snr,
                    "method": name,
                    "found": int(is_finite.sum()),
                    "RMSE Hz": rmse[0],
                    "of bound (f)": rmse[0] / bound[0],
                    "RMSE 1/s": rmse[1],
                    "of bound (B)": rmse[1] / bound[1],
                    "bound 1/s": bound[1],
                    "bias 1/s": errors[:, 1].mean(),
                }
            )
    return pd.DataFrame(rows)


def real_segments() -> dict[str, Samples]:
    """Return 150 samples from the largest extremum of each recorded tool signal on, if they are at hand."""
    summary_table = {}
    for path in sorted((Path(os.environ["TEXCLASS_DATA"]) / "lmt_excerpts").glob("*.wav")):
        fs, counts = wavfile.read(path)
        x = counts.astype(np.float64) - counts.mean()
        start = int(np.argmax(np.abs(x[:-150])))
        if fs == FS:
            summary_table[path.stem] = x[start : start + 150] / np.abs(x[start])
    return summary_table


def recorded(name: str, x: Samples) -> dict[str, object]:
    """Fit a recorded segment by all methods; Prony's resolution is 1 % of the largest sample."""
    published = fit_prony(x, 0.01)
    reflected, projected = fit_matrix_pencil(x, FS), fit_matrix_pencil(x, FS, unstable_poles="project")
    return {
        "segment": name,
        "Prony order": published.order,
        "Prony stable": published.is_stable,
        "Prony mean abs error": published.error,
        "modes": reflected.n_modes,
        "reflected mean abs error": np.mean(np.abs(reflected.synthesize(x.size, FS) - x)),
        "projected mean abs error": np.mean(np.abs(projected.synthesize(x.size, FS) - x)),
    }


def draw(summary_table: pd.DataFrame, name: str, x: Samples) -> Figure:
    """Draw error against noise, and a segment with its fits."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    axes_left, axes_right = figure.subplots(1, 2)
    for (method, rows), style in zip(summary_table.groupby("method", sort=False), ("o-", "s--"), strict=True):
        axes_left.semilogy(rows["SNR dB"], rows["RMSE 1/s"], style, label=method)
    axes_left.semilogy(rows["SNR dB"], rows["bound 1/s"], color="0.4", label="Cramer-Rao bound")
    axes_left.set(xlabel="signal to noise (dB)", ylabel="RMSE of the decay rate (1/s)")
    axes_left.set(title=f"One mode, 100 Hz, 60 1/s, {N_ACCURACY} samples at 10 kHz")
    t, published, modes = 1e3 * np.arange(x.size) / FS, fit_prony(x, 0.01), fit_matrix_pencil(x, FS)
    axes_right.plot(t, x, "x", color="0.5", markersize=3, label=name)
    axes_right.plot(t, modes.synthesize(x.size, FS), label=f"pencil, {modes.n_modes} modes")
    axes_right.plot(t, np.clip(published.synthesize(x.size), -2, 2), label=f"Prony, order {published.order}")
    axes_right.set(xlabel="time (ms)", title="A segment and its fits")
    axes_left.legend()
    axes_right.legend()
    return figure


def main() -> None:
    args = command_line(__doc__, segments=10_000, published=2000, grown=300, trials=500)
    methods, summary_table = stability(args.segments, args.published, args.grown), accuracy(args.trials)
    segments = real_segments()
    real = [recorded(name, x) for name, x in segments.items()]
    result = {
        "seed": SEED,
        "trials": args.trials,
        "stability": methods.to_dict("index"),
        "accuracy": summary_table.to_dict("records"),
        "recorded": real,
    }
    at_20 = summary_table[(summary_table["SNR dB"] == 20) & (summary_table["method"] == PENCIL)].iloc[0]
    blocks = [
        "Segments: 1 to 4 modes of 20-2000 Hz and 10-800 1/s at 10 kHz, 40 to 400 samples, white noise at "
        "0 to 60 dB (mean power over the segment), orders drawn from 1 to n/2. A fit is unstable if a pole "
        "of the filter as stored lies on or outside the unit circle (tested in rational arithmetic for the "
        "pencil). The error is the RMS difference to the segment without its noise, relative to that "
        "segment. One thread. Prony's method ran on the first segments only.",
        Heading("Stability"),
        Table(methods.reset_index()),
        Heading("Accuracy: one mode of 100 Hz and 60 1/s"),
        f"{N_ACCURACY} samples at 10 kHz, {args.trials} trials at each level; the bound is that of Cramer "
        f"and Rao for all four parameters. Aim at 20 dB: at most {AIM_RATIO:g} times the bound, bias under "
        f"{AIM_BIAS:g} 1/s. Reached: {at_20['of bound (f)']:.2f} (frequency) and {at_20['of bound (B)']:.2f} "
        f"(decay) times the bound, bias {at_20['bias 1/s']:+.3f} 1/s. `found` counts the trials in which any "
        "mode stood out of the noise; the strongest one is compared. A fit of Prony's method with two real "
        "poles has the frequency 0.",
        Table(summary_table, n_words=2),
    ]
    if real:
        blocks += [
            Heading("Recorded tool signals"),
            "150 samples from the largest extremum on, scaled to it. Prony's order is grown from the number "
            "of extrema until the mean absolute error is below 0.01. These segments do not decay throughout: "
            "some poles of the pencil lie outside the circle, and stability costs fit, reflected poles "
            "usually more than projected ones, which in turn never end.",
            Table(pd.DataFrame(real)),
        ]
    simulated = noisy(ONE.synthesize(150, FS), 20.0, np.random.default_rng(SEED))
    picture = draw(summary_table, *next(iter(segments.items()), ("simulated, 20 dB", simulated)))
    write(args.out, "prony", result, "Decaying modes: matrix pencil and Prony's method", blocks, picture)


@pytest.mark.benchmark
def test_the_pencil_is_stable_and_near_the_cramer_rao_bound():
    unstable = stability(1000, 20, 5)["unstable"]
    assert unstable[PENCIL] == unstable["pencil, order drawn"] == 0
    summary_table = accuracy(200)
    row = summary_table[(summary_table["SNR dB"] == 20) & (summary_table["method"] == PENCIL)].iloc[0]
    assert max(row["of bound (f)"], row["of bound (B)"]) < AIM_RATIO
    assert abs(row["bias 1/s"]) < AIM_BIAS


if __name__ == "__main__":
    main()
