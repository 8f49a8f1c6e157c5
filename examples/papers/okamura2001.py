"""Reproduce Okamura, Cutkosky, Dennerlein (2001): taps as decaying sinusoids, A v exp(-B t) sin(w t).

Run `python examples/papers/okamura2001.py --out DIR` to compare tables and figures with the published ones.
The recordings and ratings are not public. All sections except the last one are therefore simulated, with the
published parameters as ground truth.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Drawing
from okamura2001_people import (
    DESIGN,
    EFFECTS,
    FACTORS,
    MOST_SENSITIVE,
    analyse,
    are_all_correct,
    confusion,
    find_noise,
    most_sensitive,
    normalized_ratings,
    simulate_answers,
    simulate_ratings,
)
from okamura2001_taps import FS, MATERIALS, TABLE_I, TABLE_II, VELOCITIES_M_S, Samples, simulate_taps
from scipy import signal, stats
from shared import arguments, write_chapter

from texclass.haptics.textures.okamura2001 import (
    ForceDevice,
    TapLibrary,
    VirtualWall,
    find_onset,
    fit_aligned,
    scale_to_device,
    slope_through_origin,
)
from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import versions
from texclass.reporting import Document, Figure, Heading, Table
from texclass.reporting.figure_style import FAINT, INK, OTHER, OURS, legend_above, log_x
from texclass.vibration import TapModel, fit_okamura

KEY = "okamura2001"
N_SEEDS, N_TAPS = 50, 24
VELOCITY_ERRORS = (0.02, 0.06)
"""Relative errors of the velocity: for a good tracker, and for the published scatter in figure 4 (R^2 = 0.98
for rubber)."""
N_EXPERIMENTS, PUBLISHED_CORRECT, LONG_RUN = 42, 35, 20_000
TAP_DEPTH_MM, TAP_S = 3.0, 0.12
CHANNEL = 1
"""Index of the second channel of `taps5`, which is clipped least."""
DEVICE = ForceDevice()
CUTOFF_HZ = 100.0
"""Cut-off frequency (-3 dB) of our device in Hz. The paper shows the response of its device only as a curve
(figure 6)."""


def main(out: Path, seed: int = 0, small: bool = False) -> list[Path]:
    """Write the report to a folder; `small` runs few simulations."""
    n_seeds = 2 if small else N_SEEDS
    taps, digest = ({}, "") if small else real_taps()
    numbers: dict[str, Any] = {
        "key": KEY,
        "versions": versions("numpy", "scipy", "numba", "matplotlib"),
        "seed": seed,
        "input_hash": {"taps5": digest} if digest else {},
    }
    scaled = scale_to_device(TABLE_I, DEVICE, VELOCITIES_M_S[1])
    numbers["scaled"] = {m: values.tolist() for m, values in zip(MATERIALS, scaled.table, strict=True)}
    blocks = [
        "**Neither its recordings nor its ratings are public. Everything below is simulated, with the "
        "published parameters as ground truth, except the last section with real taps.** Simulated people "
        "follow the rules given here: their results validate the analysis, not human perception.",
        *report_recovery(numbers, seed, n_seeds, scaled),
        *report_wall(),
        *report_scaling(scaled),
        *report_ratings(numbers, seed, n_seeds),
        *report_identification(numbers, seed),
        *report_real_taps(numbers, taps),
    ]
    document = Document(
        "okamura2001: taps as decaying sinusoids, a(t) = A v exp(-B t) sin(w t)",
        blocks,
        subtitle='Okamura, Cutkosky, Dennerlein, "Reality-based models for vibration feedback in virtual '
        'environments", 2001',
        reproduction={
            "command": f"python examples/papers/{KEY}.py --out DIR",
            "seed": str(seed),
            "input": digest or "none",
        },
        versions=numbers["versions"],
    )
    return write_chapter(document, numbers, out, KEY)


# Table I, figures 1, 3 and 4: recovery of the parameters ----------------------------------------------------


def recover(seed: int, n_seeds: int) -> pd.DataFrame:
    """Fit taps simulated with Table I, and return relative errors of A, B and w for each velocity error.

    The velocities are used only in the last step, the regression of the amplitudes on the velocities.
    """
    true_v, rows = np.linspace(*VELOCITIES_M_S, N_TAPS), []
    for m, truth in zip(MATERIALS, TABLE_I.table, strict=True):
        for i in range(n_seeds):
            rng = np.random.default_rng((seed, i))
            taps, v = simulate_taps(TABLE_I[m], rng, FS[m], n_taps=N_TAPS, velocity_error=0.0)
            fitted = fit_aligned(taps, v, FS[m])
            v_error = rng.standard_normal(N_TAPS)
            for e in VELOCITY_ERRORS:
                A, r_squared = slope_through_origin(true_v * (1 + e * v_error), fitted.amplitude)
                values = np.array([A, fitted.model.decay_per_s, fitted.model.frequency_hz])
                rows.append((e, m, *(values / truth - 1), r_squared))
    return pd.DataFrame(rows, columns=["velocity", "material", "A", "B", "w", "r_squared"])


def recover_as_published(seed: int, n_seeds: int) -> dict[str, Samples]:
    """Fit the taps, cut at their onsets, by the steps of the paper; return relative errors of A, B and w."""
    errors: dict[str, list[Samples]] = {m: [] for m in MATERIALS}
    for m, truth in zip(MATERIALS, TABLE_I.table, strict=True):
        for i in range(n_seeds):
            rng = np.random.default_rng((seed, i))
            taps, v = simulate_taps(TABLE_I[m], rng, FS[m], n_taps=N_TAPS, velocity_error=VELOCITY_ERRORS[0])
            fast = np.flatnonzero(v > v.max() / 2)  # slow taps have only a single peak above the noise
            cut = [taps[k][max(0, round(find_onset(taps[k]))) :] for k in fast]
            model = fit_okamura(cut, v[fast], FS[m])
            values = np.array([model.amplitude_slope, model.decay_per_s, model.frequency_hz])
            errors[m].append(values / truth - 1)
    return {m: np.array(rows) for m, rows in errors.items()}


def report_recovery(numbers: dict[str, Any], seed: int, n_seeds: int, scaled: TapLibrary) -> list[Any]:
    """Report the recovery of Table I."""
    recovery = recover(seed, n_seeds)
    rows, verdict = [], []
    results = numbers["recovery_percent"] = {}
    for e, of_error in recovery.groupby("velocity", sort=False):
        by_material = results[f"velocity known to {e:.0%}"] = {}
        for m in MATERIALS:
            one = of_error[of_error["material"] == m]
            errors = 100 * one[["A", "B", "w"]].abs().to_numpy()
            r_squared = float(one["r_squared"].median())
            by_material[m] = {
                "largest": errors.max(axis=0).round(3).tolist(),
                "95 %": np.quantile(errors, 0.95, axis=0).round(3).tolist(),
                "r_squared": round(r_squared, 4),
            }
            largest = [f"≤ {x:.2f} %" for x in errors.max(axis=0)]
            rows.append((m, *format_values(TABLE_I[m]), f"{100 * e:.0f} %", *largest, f"{r_squared:.3f}"))
        errors = of_error[["A", "B", "w"]].abs().to_numpy()
        verdict.append(
            f"With a velocity error of {100 * e:.0f} % the largest error is {100 * errors.max():.2f} %, and "
            f"{100 * np.all(errors < 0.03, axis=1).mean():.0f} % of the fits have all three errors below 3 %."
        )
    columns = [
        "Material", "A (1/s)", "B (1/s)", "w (Hz)", "Velocity error", "Error of A", "B", "w", "R², figure 4",
    ]  # fmt: skip
    printed = numbers["recovery_as_published_percent"] = {
        m: {
            "median": np.median(100 * e, axis=0).round(3).tolist(),
            "largest": np.abs(100 * e).max(axis=0).round(3).tolist(),
        }
        for m, e in recover_as_published(seed, n_seeds).items()
    }
    by_steps = [
        (m, *(f"{a:+.1f} % (≤ {b:.1f} %)" for a, b in zip(e["median"], e["largest"], strict=True)))
        for m, e in printed.items()
    ]
    examples = {m: simulate_taps(TABLE_I[m], np.random.default_rng((seed, 0)), FS[m]) for m in MATERIALS}
    fits = {m: fit_aligned(*examples[m], FS[m]) for m in MATERIALS}
    largest_g = abs(TABLE_I["aluminum"].amplitude_slope) * 0.4 / 9.80665
    return [
        Heading("Table I: measured parameters and their recovery"),
        f"{N_TAPS} simulated taps per material from 0.05 to 0.4 m/s, each with rest before the impact, "
        f"which is between two samples; white noise of 1 % of the largest amplitude; {n_seeds} seeds. A, "
        "B, w and all onsets are fitted together. B is printed as 40,000 ... 1,500,000 1/s, which "
        "contradicts figure 3 (the vibration of wood lasts for milliseconds). We read 40 ... 1500 1/s.",
        Table(pd.DataFrame(rows, columns=columns)),
        " ".join(verdict) + " A velocity error of 6 % gives the published R² of 0.98.",
        Table(
            pd.DataFrame(by_steps, columns=["Material", "Error of A", "B", "w"]),
            "Steps of the paper (`fit_okamura`: maximum of the spectrum, line through the logarithms of "
            "the peaks, regression on velocity) for the taps above half the largest speed, with a "
            f"velocity error of {VELOCITY_ERRORS[0]:.0%}: median (largest) of {n_seeds} seeds. The maximum "
            "of the spectrum is at sqrt(w² - B²), slightly lower than w for a strongly damped tap.",
        ),
        f"With A = -100,000 1/s for aluminum, a tap of 0.4 m/s would reach {largest_g:,.0f} g, but the "
        "accelerometer of the paper is limited to 500 g. Either A is extrapolated from slow taps, or its "
        "unit is different.",
        Figure(
            "fig1", "Figure 1: from the tap to the device", "Measured, modelled, scaled and displayed.",
            lambda width: draw_chain(width, examples, fits, scaled),
        ),
        "Figure 2 of the paper is a photograph.",
        Figure(
            "fig3", "Figure 3: a tap and its model", "The fitted model agrees with the simulated tap.",
            lambda width: draw_taps(width, examples, fits),
        ),
        Figure(
            "fig4", "Figure 4: amplitude against velocity", "Amplitudes lie on a line through the origin.",
            lambda width: draw_slopes(width, examples, fits),
        ),
    ]  # fmt: skip


def draw_chain(width: float, examples: Any, fits: Any, scaled: TapLibrary) -> Drawing:
    """Draw figure 1: measured, modelled, scaled, published, and displayed taps at 0.2 m/s."""
    figure, grid = panels(width, 3, 5)
    fs = 20_000.0
    low_pass = signal.butter(2, CUTOFF_HZ, fs=fs, output="sos")
    for row, m in zip(grid, MATERIALS, strict=True):
        taps, velocity = examples[m]
        x = taps[np.argmin(np.abs(velocity - 0.2))]
        row[0].plot(1e3 * np.arange(x.size) / FS[m], x, color=INK, linewidth=0.8)
        models = (fits[m].model, scaled[m], TABLE_II[m])
        shapes = [model.synthesize(0.2, round(5 / model.decay_per_s * fs), fs) for model in models]
        shapes.append(signal.sosfilt(low_pass, shapes[-1]))
        for axes, shape, colour in zip(row[1:], shapes, (OURS, OURS, OURS, OTHER), strict=True):
            axes.plot(1e3 * np.arange(shape.size) / fs, shape, color=colour, linewidth=1)
        row[0].set_ylabel(f"{m} (m/s²)")
    titles = ("simulated tap", "fitted model", "scaled, our rule", "Table II", "displayed by our device")
    for column, title in zip(grid.T, titles, strict=True):
        column[0].set_title(title)
        column[-1].set_xlabel("time (ms)")
    return figure


def draw_taps(width: float, examples: Any, fits: Any) -> Drawing:
    """Draw figure 3: a simulated tap per material and the fitted model."""
    figure, (row,) = panels(width, 1, 3)
    for axes, m in zip(row, MATERIALS, strict=True):
        x, fit, fs = examples[m][0][-1], fits[m], FS[m]
        t = (np.arange(x.size) - fit.onset[-1]) / fs
        fine = np.linspace(0, t[-1], 1500)
        axes.plot(1e3 * t, x, color=OURS, linewidth=0.9, label="simulated tap")
        shape = decaying(fit.model, fine)
        axes.plot(1e3 * fine, fit.amplitude[-1] * shape, "--", color=OTHER, label="fitted model")
        axes.set(title=f"{m} at 0.4 m/s", xlabel="time since impact (ms)")
    row[0].set_ylabel("acceleration (m/s²)")
    row[0].legend(loc="upper right")
    return figure


def draw_slopes(width: float, examples: Any, fits: Any) -> Drawing:
    """Draw figure 4: amplitude against measured velocity, and the line through the origin."""
    figure, (row,) = panels(width, 1, 3)
    for axes, m in zip(row, MATERIALS, strict=True):
        fit, v = fits[m], np.linspace(0, 0.42, 2)
        A, truth = abs(fit.model.amplitude_slope), abs(TABLE_I[m].amplitude_slope)
        axes.plot(1e3 * examples[m][1], np.abs(fit.amplitude), "o", color=OURS, ms=5, label="simulated taps")
        axes.plot(1e3 * v, A * v, color=OTHER, label="|A| v, fitted")
        text = f"|A| = {A:,.1f} 1/s\nTable I: {truth:,.1f}\nR² = {fit.r_squared:.3f}"
        axes.text(0.95, 0.06, text, ha="right", transform=axes.transAxes)
        axes.set(title=m, xlabel="attack velocity (mm/s)", xlim=(0, None), ylim=(0, None))
    row[0].set_ylabel("amplitude (m/s²)")
    row[0].legend(loc="upper left")
    return figure


# Figure 5: a tap on a virtual wall --------------------------------------------------------------------------


def report_wall() -> list[Any]:
    """Report the forces of two taps on a virtual wall."""
    return [
        Heading("Figure 5: a tap on a virtual wall"),
        Figure(
            "fig5", "Figure 5: two taps on a virtual wall", "Position, velocity and force.", draw_wall
        ),
        "Penalty force k x plus the vibration of Table II at the velocity of the impact; two taps, the "
        f"second harder; {DEVICE.rate_hz:,.0f} Hz, sample by sample, clipped at the limit of the device, "
        f"{DEVICE.limit_n:g} N.",
    ]  # fmt: skip


def draw_wall(width: float) -> Drawing:
    """Draw figure 5: half sines of depth on walls of the three materials."""
    t = np.arange(round(2 * TAP_S * DEVICE.rate_hz)) / DEVICE.rate_hz
    depth = TAP_DEPTH_MM * (0.6 + 0.4 * t / t[-1]) * np.sin(2 * np.pi * t / TAP_S - np.pi / 4)
    velocity = np.gradient(depth, t)
    figure, grid = panels(width, 3, 3, sharex=True, sharey="row")
    for (above, middle, below), m in zip(grid.T, MATERIALS, strict=True):
        wall = VirtualWall(TABLE_II[m], DEVICE)
        force = wall.renderer().process(depth, velocity)
        above.plot(1e3 * t, -depth, color=INK)
        above.axhspan(-3.4, 0, color=FAINT, zorder=0)
        above.set_title(f"{m} (Table II)")
        middle.plot(1e3 * t, -velocity, color=INK)  # of the height, which is negative into the wall
        below.plot(1e3 * t, force, color=OURS, linewidth=1, label="wall and vibration")
        spring = wall.stiffness_n_mm * np.maximum(depth, 0.0)
        below.plot(1e3 * t, spring, color=OTHER, linewidth=1, label="wall alone")
        below.axhline(DEVICE.limit_n, color=INK, linewidth=0.8, linestyle=":", label="limit of the device")
        below.set_xlabel("time (ms)")
    legend_above(figure, grid[2, 0])
    figure.align_ylabels(grid[:, 0])
    for axes, label in zip(grid[:, 0], ("height (mm)", "velocity (mm/s)", "force (N)"), strict=True):
        axes.set_ylabel(label)
    return figure


# Section III-A, Table II, figure 6: scaling to a device -----------------------------------------------------


def report_scaling(scaled: TapLibrary) -> list[Any]:
    """Compare our scaling rule with the factors that the experts chose for Table I."""
    libraries = {
        "measured (Table I)": TABLE_I,
        "published for the 3GM (Table II)": TABLE_II,
        "our rule": scaled,
    }
    rows = [
        (m, name, *format_values(library[m]), f"{DEVICE.peak_force(library[m], 0.4):,.2f}")
        for m in MATERIALS
        for name, library in libraries.items()
    ]
    columns = ["Material", "Library", "A (1/s)", "B (1/s)", "w (Hz)", "Peak force at 0.4 m/s (N)"]
    cycles = [one["aluminum"].frequency_hz / one["aluminum"].decay_per_s for one in (TABLE_II, TABLE_I)]
    return [
        Heading("Section III-A, Table II: scaling to a device"),
        "The paper describes its device by a curve (figure 6); experts chose the factors. Our rule keeps "
        "order and logarithmic spacing of the frequencies and the decay per period, with peak forces "
        f"between {DEVICE.force_n[0]:g} and {DEVICE.force_n[1]:g} N at 0.4 m/s, for a device of our "
        f"choice: {DEVICE.band_hz[0]:g} to {DEVICE.band_hz[1]:g} Hz, moving mass {DEVICE.mass_kg:g} kg, "
        f"response decreasing from {CUTOFF_HZ:g} Hz on.",
        Table(pd.DataFrame(rows, columns=columns), n_words=2),
        "The rule keeps the logarithmic position of wood between the other materials; the experts chose a "
        "lower frequency. The rule keeps the oscillations per decay time, w/B; the experts gave aluminum "
        f"{cycles[0]:.1f} of them instead of {cycles[1]:.1f}, a longer vibration. The sign of the "
        "published A of rubber is missing in our copy.",
        Figure(
            "fig6", "Figure 6 and the scaled library", "The libraries in the response of the device.",
            lambda width: draw_device(width, libraries),
        ),
    ]  # fmt: skip


def response(frequency_hz: np.ndarray) -> np.ndarray:
    """Return the magnitude response of the device, a second-order low-pass with gain 1 at low frequencies.

    The Butterworth response |H| = 1 / sqrt(1 + (f / f_c)^4) describes a mass at the end of an elastic drive.
    """
    return 1 / np.sqrt(1 + (frequency_hz / CUTOFF_HZ) ** 4)


def draw_device(width: float, libraries: dict[str, TapLibrary]) -> Drawing:
    """Draw figure 6: the response of our device, and the positions of the libraries in it."""
    figure, ((curve_axes, library_axes),) = panels(width, 1, 2)
    figure.set_figheight(3.6)
    f = np.geomspace(5, 2000, 300)
    curve_axes.plot(f, response(f), color=INK, label="response")
    curve_axes.axvspan(*DEVICE.band_hz, color=FAINT, zorder=0, label="band of the device")
    curve_axes.axvline(250, color=INK, linestyle=":", linewidth=1, label="skin most sensitive (250 Hz)")
    curve_axes.set(title="response of our device", xlabel="frequency (Hz)", ylabel="normalised magnitude")
    log_x(curve_axes)
    curve_axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.1))
    looks = ((INK, "o"), (OTHER, "D"), (OURS, "s"))
    for (name, library), (colour, marker) in zip(libraries.items(), looks, strict=True):
        _, B, w = library.table.T
        library_axes.plot(w, B, marker, ls="-", lw=0.7, color=colour, label=name)
    for m, (_, B, w) in zip(MATERIALS, TABLE_I.table, strict=True):
        library_axes.annotate(m, (w, B), (-6, 4), textcoords="offset points", ha="right")
    library_axes.axvspan(*DEVICE.band_hz, color=FAINT, zorder=0)
    library_axes.set(title="the libraries", xlabel="frequency (Hz)", ylabel="decay rate (1/s)", yscale="log")
    library_axes.yaxis.set_major_formatter("{x:g}")
    log_x(library_axes)
    library_axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.1))
    return figure


# Section III-B, figure 7: the factorial design --------------------------------------------------------------


def report_ratings(numbers: dict[str, Any], seed: int, n_seeds: int) -> list[Any]:
    """Report the parameter to which simulated raters are most sensitive, and how often it is recovered."""
    ratings = {
        m: [simulate_ratings(MOST_SENSITIVE[m], np.random.default_rng((seed, i))) for i in range(n_seeds)]
        for m in MATERIALS
    }
    analyses = {m: [analyse(r) for r in ratings[m]] for m in MATERIALS}
    first = {m: of_material[0] for m, of_material in analyses.items()}
    share = {
        m: float(np.mean([most_sensitive(a) == MOST_SENSITIVE[m] for a in of_material]))
        for m, of_material in analyses.items()
    }
    numbers["factorial"] = {m: {name: a.loc[name].tolist() for name in EFFECTS} for m, a in first.items()}
    numbers["factor_found"] = share
    rows = [
        (name, *(format_effect(a, name) for a in first.values())) for name in EFFECTS
    ] + [("most sensitive, published", *MOST_SENSITIVE.values())]  # fmt: skip
    columns = ["Effect", *(f"{m}: effect (F)" for m in MATERIALS)]
    counts = ", ".join(f"{n_seeds * share[m]:.0f} ({m})" for m in MATERIALS)
    return [
        Heading("Figure 7: the 2^3 factorial design"),
        "Simulated ratings (1 to 10) of 10 raters per material, each normalised to mean 0 and standard "
        "deviation 1. The raters are most sensitive to the factor that the paper reports. Effects in "
        "standard deviations of a rater, analysis of variance with 1 and 63 degrees of freedom.",
        Table(pd.DataFrame(rows, columns=columns), n_words=4),
        f"The most sensitive factor is recovered in {counts} of {n_seeds} simulated studies. Published: "
        "decay rate for rubber, frequency for wood, amplitude slope for aluminum; effects and F values are "
        "not printed.",
        Figure(
            "fig7", "Figure 7: mean rating of the eight runs", "Each material has one best run.",
            lambda width: draw_ratings(width, {m: r[0] for m, r in ratings.items()}),
        ),
    ]  # fmt: skip


def format_effect(analysis: pd.DataFrame, name: str) -> str:
    """Format an effect with its F value; mark the largest main effect."""
    text = f"{analysis.loc[name, 'effect']:+.2f} ({analysis.loc[name, 'F']:.1f})"
    return f"{text}, largest" if name in FACTORS and name == most_sensitive(analysis) else text


def draw_ratings(width: float, ratings: dict[str, Samples]) -> Drawing:
    """Draw figure 7: the eight corners of the design and their mean normalised ratings."""
    figure, (row,) = panels(width, 1, 3, sharey=True)
    labels = ["\n".join("+" if level > 0 else "−" for level in run) for run in DESIGN]
    for axes, m in zip(row, MATERIALS, strict=True):
        mean = normalized_ratings(ratings[m]).mean(axis=0)
        axes.bar(labels, mean, color=[OTHER if i == np.argmax(mean) else OURS for i in range(8)])
        axes.axhline(0, color=INK, linewidth=0.8)
        factor = most_sensitive(analyse(ratings[m]))
        axes.set(title=f"{m}: {factor}", xlabel="A, B, w from above: low (−) or high (+)")
    row[0].set_ylabel("mean rating, deviations\n(simulated)")
    return figure


# Section IV, Table III: identification ----------------------------------------------------------------------


def report_identification(numbers: dict[str, Any], seed: int) -> list[Any]:
    """Report the confusion matrix of simulated users with the published rate of correct experiments."""
    noise = find_noise(TABLE_II, PUBLISHED_CORRECT / N_EXPERIMENTS, seed=seed)
    rngs = (np.random.default_rng((seed, i)) for i in (2, 1))
    test, long_test = (
        simulate_answers(TABLE_II, noise, rng, n_experiments=n)
        for rng, n in zip(rngs, (N_EXPERIMENTS, LONG_RUN), strict=True)
    )
    counts, long_run = confusion(test), confusion(long_test) / LONG_RUN
    n_right = int(are_all_correct(test).sum())
    interval, published = (
        tuple(map(float, stats.binomtest(n, N_EXPERIMENTS).proportion_ci(0.95)))
        for n in (n_right, PUBLISHED_CORRECT)
    )
    numbers["identification"] = {
        "noise_nepers": noise,
        "confusion": counts.tolist(),
        "correct": n_right,
        "experiments": N_EXPERIMENTS,
        "interval": interval,
        f"confusion_of_{LONG_RUN}": long_run.round(4).tolist(),
    }
    low, high = (100 * end for end in interval)
    rows = [
        ("all, published", "42", "35", "83.3"),
        ("third test only, published", "14", "12", "85.7"),
        ("experts, published", "18", "16", "88.9"),
        ("novices, published", "24", "19", "79.2"),
        (
            "all, simulated",
            "42",
            str(n_right),
            f"{100 * n_right / N_EXPERIMENTS:.1f} [{low:.1f}, {high:.1f}]",
        ),
    ]
    answers = [
        (m, *(f"{n} ({100 * p:.1f} %)" for n, p in zip(row, share, strict=True)))
        for m, row, share in zip(MATERIALS, counts, long_run, strict=True)
    ]
    low, high = (100 * end for end in published)
    return [
        Heading("Table III: identification"),
        f"{N_EXPERIMENTS} experiments (14 users, 3 times); an experiment is correct if all three surfaces "
        "are identified. Simulated users perceive ln A, ln B and ln w of Table II with Gaussian noise and "
        f"use each name once, for the nearest surface. **The noise, {noise:.2f} nepers, was chosen so that "
        f"83.3 % are correct in the long run**. Only the confusions and the scatter of {N_EXPERIMENTS} "
        "experiments are results.",
        Table(pd.DataFrame(rows, columns=["Who", "Experiments", "Correct", "Share (%)"])),
        f"The 95 % confidence interval of the published 35 of 42 is {low:.1f} to {high:.1f} %. It contains "
        "all other rows, so the published numbers show no effect of learning or experience.",
        Table(
            pd.DataFrame(answers, columns=["True material", *(f"predicted {m}" for m in MATERIALS)]),
            f"Confusion matrix of the simulated test (share in {LONG_RUN:,} experiments).",
            n_words=4,
        ),
        "Published: the most common error was the confusion of wood and rubber. Our users confuse wood "
        f"with aluminum as often ({100 * long_run[1, 2]:.1f} %) as with rubber ({100 * long_run[1, 0]:.1f} "
        "%), because both are equally distant if the three cues have equal weights. The users of the "
        "paper must weigh them differently.",
    ]


# Real taps --------------------------------------------------------------------------------------------------


def real_taps() -> tuple[dict[str, list[Samples]], str]:
    """Return the taps of `taps5` by material, without resting level, and their hash; empty if missing."""
    try:
        dataset = open_dataset("taps5")
    except DataNotFoundError:
        return {}, ""
    taps: dict[str, list[Samples]] = {}
    for entry in dataset.entries:
        taps.setdefault(entry.surface, []).append(dataset.load(entry).acceleration[:, CHANNEL])
    return taps, dataset.input_hash


def fit_each(taps: list[Samples]) -> list[Any]:
    """Fit each tap separately, with time in samples and unknown velocity; None if the fit fails."""
    fits: list[Any] = []
    for x in taps:
        try:
            fits.append(fit_aligned([x], [1.0], 1.0))
        except ValueError:
            fits.append(None)
    return fits


def report_real_taps(numbers: dict[str, Any], taps: dict[str, list[Samples]]) -> list[Any]:
    """Report the fraction of the energy of real taps that one decaying sinusoid explains."""
    numbers["taps5"] = {}
    if not taps:
        return [
            Heading("Real taps: taps5"),
            "Skipped: the recordings are not on this machine (`TEXCLASS_DATA`).",
        ]
    fits = {m: fit_each(of_plate) for m, of_plate in taps.items()}
    rows, explained = [], {}
    for m, plate_fits in fits.items():
        table = np.array(
            [
                (f.model.decay_per_s, f.model.frequency_hz, f.explained_energy) if f else (np.nan,) * 3
                for f in plate_fits
            ]
        )
        quartiles = np.nanquantile(table, [0.25, 0.5, 0.75], axis=0).T
        names = ("decay_per_sample", "cycles_per_sample", "explained")
        summary = {name: q.round(5).tolist() for name, q in zip(names, quartiles, strict=True)}
        numbers["taps5"][m] = {"n": len(plate_fits)} | summary
        cells = [
            f"{middle:.{digits}f} ({low:.{digits}f} ... {high:.{digits}f})"
            for (low, middle, high), digits in zip(quartiles, (4, 4, 2), strict=True)
        ]
        rows.append((m, str(len(plate_fits)), *cells))
        explained[m] = table[:, 2]
    share = np.median(np.concatenate(list(explained.values())))
    columns = ["Plate", "Taps", "B per sample", "w, cycles per sample", "Energy explained"]
    return [
        Heading("Real taps: taps5"),
        "The same method for real taps on five plates, second channel, resting level removed. **The "
        "sampling rate is unknown, so time is in samples; velocities are unknown, so there is no A.** "
        "Median (quartiles) over the taps of a plate.",
        Table(pd.DataFrame(rows, columns=columns), n_words=5),
        f"One decaying sinusoid explains {100 * share:.0f} % of the energy of a typical tap: these plates "
        "have several modes, strong taps are clipped, and each row contains a discontinuity of the "
        "recorder. For such taps the matrix pencil with several modes (`fit_matrix_pencil`) is the better "
        "model.",
        Figure(
            "taps5", "Real taps and the model", "A typical tap of each plate, and one decaying sinusoid.",
            lambda width: draw_plates(width, taps, fits, explained),
        ),
    ]  # fmt: skip


def draw_plates(width: float, taps: Any, fits: Any, explained: dict[str, Samples]) -> Drawing:
    """Draw a typical real tap per plate and the decaying sinusoid fitted to it."""
    figure, (row,) = panels(width, 1, len(taps))
    for axes, (m, share) in zip(row, explained.items(), strict=True):
        typical = int(np.nanargmin(np.abs(share - np.nanmedian(share))))
        x, fit = taps[m][typical], fits[m][typical]
        model = fit.amplitude[0] * decaying(fit.model, np.arange(x.size) - fit.onset[0])
        axes.plot(x, color=OURS, linewidth=1, label="recorded")
        axes.plot(model, "--", color=OTHER, linewidth=1.2, label="model")
        axes.set(title=f"{m}: {np.nanmedian(share):.0%}", xlabel="sample")
    row[0].set_ylabel("counts")
    row[0].legend(loc="upper right")
    return figure


# Helpers ----------------------------------------------------------------------------------------------------


def decaying(model: TapModel, t: Samples) -> Samples:
    """Return exp(-B t) sin(w t) after the impact and 0 before it."""
    B, w = model.decay_per_s, 2 * np.pi * model.frequency_hz
    return np.where(t >= 0, np.exp(-B * np.maximum(t, 0)) * np.sin(w * t), 0.0)


def format_values(model: TapModel) -> list[str]:
    """Return A, B and w as text."""
    return [f"{model.amplitude_slope:,.6g}", f"{model.decay_per_s:,.4g}", f"{model.frequency_hz:,.4g}"]


def panels(width: float, rows: int, columns: int, **shared: Any) -> tuple[Drawing, Any]:
    """Return a figure and its axes, shape (rows, columns)."""
    figure = Drawing(figsize=(width, 0.5 + 1.9 * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


if __name__ == "__main__":
    options = arguments(__doc__)
    main(options.out, options.seed, options.small)
