"""Reproduce the figures of Abdulali and Jeon, "Data-driven modeling of anisotropic haptic textures" (2016).

Run `python examples/papers/abdulali2016.py --out DIR`. It takes 15 minutes, or one minute with `--small`.
Real recordings are used if they are available (`TEXCLASS_DATA`).
"""

import abdulali2016_study as study
import numpy as np
import pandas as pd
import shared
from abdulali2016_simulated import SURFACES, get_surface, simulate_scan
from abdulali2016_study import CANDIDATES
from matplotlib.figure import Figure as Drawing
from scipy import signal
from threadpoolctl import threadpool_limits

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import bake, condition, model_scan
from texclass.haptics.textures.abdulali2016.network_fit import segment_adaptively
from texclass.haptics.textures.resonant_surfaces import GROWTH
from texclass.provenance import versions
from texclass.reporting import Heading, new_figure
from texclass.reporting.figure_style import FAINT, FOURTH, INK, LOOKS, OTHER, OURS, THIRD
from texclass.vibration.null_scores import NULLS, distance_to_null

KEY, FS = "abdulali2016", study.FS
WAYS = (
    "network", "network, baked", "exact, plain", "sparse, plain", "as published", "Delaunay",
    "Delaunay, plain", "without direction", "one AR model", "the truth again",
)  # fmt: skip
REAL_WAYS = tuple(way for way in WAYS if way not in ("the truth again", "without direction"))
COLOURS = (OURS, OTHER, THIRD, FOURTH)
GOOD_GFC, HELD_OUT_GFC, LIMIT_US = 0.9, 0.95, 100.0
"""GFC of a good model in the paper, required GFC at held-out conditions, and limit for p99.9 in µs (ours)."""


def main():
    """Compute the results and write the report."""
    options = shared.arguments(__doc__)
    with threadpool_limits(1):  # threads do not speed up operations on small matrices
        numbers = compute(options.seed, options.small)
    document = write(numbers, options.seed, ("S3",) if options.small else ("S3", "S1", "S7"))
    numbers |= {"seed": options.seed, "versions": versions("numpy", "scipy", "scikit-learn", "numba")}
    shared.write_chapter(document, numbers, options.out, KEY)


def compute(seed, small):
    """Compute the results: simulated and real surfaces, held-out conditions, sparsity and times."""
    surfaces = (get_surface("S4"),) if small else SURFACES
    orders, rates = ((20,), (FS,)) if small else ((20, 400), (FS, 10_000.0))
    n_seeds, n_steps = (1, 500) if small else (50, 4000)
    recordings, input_hash = ({}, "") if small else shared.recordings("stylus6")
    scans = [condition(Scan.from_recording(recording)) for recording in recordings.values()]
    halves = [(scan.crop(0, len(scan) // 2), scan.crop(len(scan) // 2, len(scan))) for scan in scans]
    runs = [study.study_held_out(SURFACES[i % len(SURFACES)], seed + i) for i in range(n_seeds)]
    compared = SURFACES[2:5] if small else SURFACES
    pairs = {surface.name: vibrations(study.simulate_pair(surface, seed)) for surface in compared}
    training, renders = simulate_scan(get_surface("S2"), 20.0, FS, np.random.default_rng(seed)), []
    for order in orders:
        network = model_scan(training, order=order).network()
        renders += [study.time_rendering(texture, n_steps) for texture in (network, bake(network, "S2"))]
    return {
        "simulated": with_nulls([study.study_surface(s, seed) for s in surfaces], pairs),
        "real": with_nulls(
            [study.study_scans(*pair, isotropic=True) for pair in halves],
            {pair[0].name: vibrations(pair) for pair in halves},
        ),
        "held_out_nulls": study.study_held_out_nulls(compared, seed),
        "held_out": {axis: [run[axis] for run in runs] for axis in ("speed", "force", "direction")},
        "sparsity": np.mean([study.study_sparsity(s, seed) for s in surfaces], axis=0).tolist(),
        "fits": [study.time_fit(fs, order) for fs in rates for order in orders],
        "renders": renders,
        "input_hash": input_hash,
    }


def vibrations(pair):
    """Return the vibrations of a training and a validation scan."""
    return tuple(scan.acceleration for scan in pair[:2])


def with_nulls(rows, pairs):
    """Add the scores of nulls to the scores of each surface."""
    nulls = study.score_nulls(pairs) if rows else {}
    for row in rows:
        row["scores"] |= nulls[row["name"]]
    return rows


def write(numbers, seed, shown):
    """Return the report with the published results and ours."""
    scan, training = (
        simulate_scan(get_surface("S3"), s, FS, np.random.default_rng(seed)) for s in (10.0, 20.0)
    )
    return shared.document(
        "abdulali2016: anisotropic textures",
        [
            "Abdulali and Jeon, Data-Driven Modeling of Anisotropic Haptic Textures, 2016.",
            """What is simulated: the recordings of the paper are not public. S1 ... S9 are simulated,
            autoregressive processes whose resonances and level vary smoothly with velocity and force, and for
            all but S4 with direction; a simulated hand strokes them freely. Frequencies and levels are our
            choice, so the numbers below do not describe the surfaces of the paper. Real recordings:
            `stylus6`, isotropic.""",
            *_claims(numbers),
            """The paper has no table. According to its Fig. 5(a) the GFC is above 0.90 for every sample but
            S1, and close to it for S1.""",
            *_cross_validated(numbers["simulated"], seed, shown),
            Heading("Fig. 2(b) and 4: segments and input space (simulated)"),
            shared.figure("fig2b", draw_segments, scan),
            shared.figure("fig4", draw_input_space, training),
            *_held_out(numbers["held_out"], numbers["held_out_nulls"]),
            *_real(numbers["real"]),
            *_sparse_and_times(numbers),
        ],
    )


def _claims(numbers):
    """Return the table of claims: what the network reaches, and what candidates without a model reach."""
    ways = ("network", "one AR model", *NULLS)
    rows = []
    for title, key in (("simulated", "simulated"), ("`stylus6`", "real")):
        scores = [row["scores"] for row in numbers[key]]
        if scores:
            n_good = (f"{sum(s[way].gfc > GOOD_GFC for s in scores)} of {len(scores)}" for way in ways)
            rows.append((f"GFC above {GOOD_GFC:g}, {title}", *n_good))
            n_better = (
                f"{sum(s[way].gfc > s['network'].gfc for s in scores)} of {len(scores)}" for way in ways[1:]
            )
            rows.append((f"GFC above that of the network, {title}", "", *n_better))
            distances = (f"{np.mean([s[way].perceptual_db for s in scores]):.1f} dB" for way in ways)
            rows.append((f"perceptual distance, mean, {title}", *distances))
    runs = [gfc for values in numbers["held_out"].values() for gfc in values]
    nulls = [row for axis in numbers["held_out_nulls"].values() for row in axis.values()]
    reached = f"{sum(gfc > HELD_OUT_GFC for gfc in runs)} of {len(runs)}"
    counts = (f"{sum(row[way] > HELD_OUT_GFC for row in nulls)} of {len(nulls)}" for way in NULLS)
    rows.append((f"GFC above {HELD_OUT_GFC:g}, held-out conditions, simulated", reached, "-", *counts))
    tails = [t["cpu_p999_us"] for t in numbers["renders"]]
    n_fast = sum(tail < LIMIT_US for tail in tails)
    range_us = f"{min(tails):,.0f} to {max(tails):,.0f} µs"
    rows.append((f"CPU p99.9 below {LIMIT_US:g} µs", f"{n_fast} of {len(tails)} ({range_us})", *4 * ["-"]))
    return [
        Heading("What the claims prove"),
        shared.table(("claim", *ways), rows),
        *(
            _margins(numbers[key], title)
            for title, key in (("S1 ... S9", "simulated"), ("`stylus6`", "real"))
        ),
        f"""White noise and the mean spectrum of the other surfaces have the level of the training vibration;
        the next surface is the best of the others. A GFC above {GOOD_GFC:g} proves nothing where a null
        reaches it. The perceptual distance is computed at equal level; differences in level below 1.6 to 4 dB
        are not perceived.""",
    ]


def _margins(rows, title):
    """Return by how much the network is better than the best null."""
    if len(rows) < 2:
        return f"{title}: the distance to the nulls needs at least two surfaces."
    margins = {}
    for key, sign in (("gfc", 1), ("perceptual_db", -1)):
        values = {
            way: np.array([getattr(row["scores"][way], key) for row in rows]) for way in ("network", *NULLS)
        }
        best = np.max([sign * values[way] for way in NULLS], axis=0)
        nulls = pd.DataFrame({"best null": sign * best})
        margins[key] = distance_to_null(pd.Series(values["network"]), nulls, higher_is_better=sign > 0)
    gfc, perceptual = margins["gfc"], margins["perceptual_db"]
    is_proof = gfc["low"] > 0 or perceptual["low"] > 0
    return f"""{title}: the GFC of the network minus that of the best null is {gfc["mean"]:+.3f}
        [{gfc["low"]:+.3f}, {gfc["high"]:+.3f}] (95 % interval over surfaces; the network is better on
        {gfc["n_better"]} of {gfc["n"]}). The perceptual distance of the best null minus that of the network
        is {perceptual["mean"]:+.1f} [{perceptual["low"]:+.1f}, {perceptual["high"]:+.1f}] dB (better on
        {perceptual["n_better"]} of {perceptual["n"]}). This
        {"distinguishes the network from the nulls" if is_proof else "proves nothing"}."""


def _cross_validated(rows, seed, shown):
    pooled = ", ".join(f"{row['name']} with a reach of {row['reach']:g}" for row in rows if row["reach"])
    symmetric = ", ".join(row["name"] for row in rows if row["symmetric"])
    n_good = sum(row["scores"]["network"].gfc > GOOD_GFC for row in rows)
    return [
        Heading("Fig. 5(a): cross-validation, 20 s of training, 10 s of validation (simulated)"),
        f"""Published: 8 of 9 samples above 0.90. Ours: {n_good} of {len(rows)}. Mean GFC over windows of 500
        samples ± standard deviation over windows. "The truth again" is the true process along the same motion
        with other noise, an upper bound for any model.""",
        _score_table(rows, (*WAYS, *CANDIDATES)),
        f"""RMS error of the
        level per window in dB, and fitted exponents of the level (true values: {GROWTH[0]}, {GROWTH[1]}):""",
        _score_table(rows, (*WAYS, *CANDIDATES), "level_db"),
        "Perceptual distance in dB of the whole validation, at equal level:",
        _score_table(rows, (*WAYS, *CANDIDATES), "perceptual_db"),
        """The last four rows contain no model: the training vibration itself, white noise, the next surface
        and the mean spectrum of the others. For the level error, other surfaces keep their levels.""",
        shared.figure("fig5a", draw_scores, rows),
        shared.figure("fig5bcd", draw_spectra, seed, shown),
        f"""Network: exact solution of eq. (5). Spectra
        are pooled where that predicts held-out segments better (here {pooled or "nowhere"}), and segments are
        used for both directions of a stroke where that fits (here {symmetric or "nowhere"}: the simulated
        grain has a period of 180°); "plain" does neither. The extra output is the residual of the level from
        a power law of speed and force, and parameters change linearly. As published: Yule-Walker, variance as
        extra output, sparse network, parameters that jump every 16 samples. Where the variance becomes
        negative the output is silent, and such windows have a GFC of 0, which causes most of its loss.""",
    ]


def _held_out(results, nulls):
    (slow, fast), (light, hard), sector = study.SPEED_BAND, study.FORCE_BAND, np.rad2deg(study.SECTOR_RAD)
    names = {
        "speed": f"speeds {slow:g}-{fast:g} mm/s, tested at {study.SPEED:g}",
        "force": f"forces {light:g}-{hard:g} N, tested at {study.FORCE:g}",
        "direction": f"directions ± {sector:.0f}° around the tested one and its opposite",
    }
    rows, misses = [], []
    for axis, gfc in results.items():
        values = f"{np.mean(gfc):.4f}", f"{np.percentile(gfc, 5):.4f}", f"{min(gfc):.4f}"
        row_nulls = nulls[axis].values()
        best = (f"{np.mean([row[way] for row in row_nulls]):.4f}" for way in ("best null", "other half"))
        n_good = f"{sum(x > HELD_OUT_GFC for x in gfc)} of {len(gfc)}"
        n_null = f"{sum(row['best null'] > HELD_OUT_GFC for row in row_nulls)} of {len(row_nulls)}"
        rows.append((names[axis], *values, n_good, *best, n_null))
        below = [(SURFACES[i % len(SURFACES)].name, x) for i, x in enumerate(gfc) if x <= HELD_OUT_GFC]
        misses += [f"{name} {axis} {x:.3f}" for name, x in below]
    return [
        Heading(f"Held-out speed, force and direction, {len(results['speed'])} seeds (simulated)"),
        """Each seed draws another hand motion, noise and held-out direction; the surfaces alternate.
        Required: above 0.95. Best null and other half: mean over the surfaces under the same condition.""",
        shared.table(
            (
                "held out",
                "mean",
                "5 %",
                "minimum",
                "runs above 0.95",
                "best null",
                "other half",
                "nulls above 0.95",
            ),
            rows,
        ),
        f"Misses: {'; '.join(misses) or 'none'}.",
        shared.figure("held-out", draw_held_out, results),
    ]


def _real(rows):
    if not rows:
        return [Heading("Real recordings"), f"`stylus6`: {shared.ABSENT}"]
    coverage = [row["coverage"] for row in rows]
    pairs = [(row["scores"]["network"], row["scores"]["one AR model"]) for row in rows]
    n_gfc, n_level = sum(a.gfc > b.gfc for a, b in pairs), sum(a.level_db < b.level_db for a, b in pairs)
    return [
        Heading("Real recordings: `stylus6`, first half for training, second for validation, isotropic"),
        _score_table(rows, (*REAL_WAYS, *CANDIDATES)),
        "RMS error of the level per window, dB:",
        _score_table(rows, (*REAL_WAYS, *CANDIDATES), "level_db"),
        "Perceptual distance in dB of the whole validation, at equal level:",
        _score_table(rows, (*REAL_WAYS, *CANDIDATES), "perceptual_db"),
        f"""The motion is never steady: with the printed tau_2 = 0.08 segments cover
        {min(coverage):.0%} to {max(coverage):.0%} of the training set (- if there is none); by default tau_2
        is doubled until half is covered. "One AR model" is a single model at a constant level. The network
        has a higher GFC on {n_gfc} and a smaller level error on {n_level} of {len(rows)}: spectra and levels
        of these textures hardly depend on speed and force (see the exponents), so a single model is nearly as
        good.""",
        shared.figure("stylus6", draw_scores, rows),
    ]


def _sparse_and_times(numbers):
    sparse = [
        (f"{tau:g}" if tau else "exact", f"{n:.0f}", f"{gfc:.4f}") for tau, n, gfc in numbers["sparsity"]
    ]
    fits = [
        (f"{fs:g} Hz", str(order), f"{segmenting:.3f} s", f"{fitting:.2f} s", f"{baking:.2f} s")
        for fs, order, segmenting, fitting, baking in (t.values() for t in numbers["fits"])
    ]
    times = ("median_us", "p999_us", "cpu_median_us", "cpu_p999_us")
    renders = [
        (t["family"], str(t["order"]), *(f"{t[time]:.0f} µs" for time in times), f"{t['operations']:,.0f}")
        for t in numbers["renders"]
    ]
    header = ("median", "p99.9", "CPU median", "CPU p99.9", "operations per sample")
    return [
        Heading("Sparse or exact (simulated, mean over the surfaces, plain)"),
        shared.table(("tau / largest tau", "centres", "GFC"), sparse),
        """The sparse solution minimises the objective of SpaRSA (MultiTaskLasso of scikit-learn: one set of
        centres for all outputs) and fits the selected centres again. SpaRSA itself finds the same optimum in
        two to three times the time: see [comparisons](abdulali2016-comparisons.md).""",
        Heading("Times"),
        "Fit of 20 s (limit: 5 s):",
        shared.table(("rate", "order", "segmentation", "total fit", "baking"), fits),
        """Four contacts, one sample per call, in total, on a shared machine (limit: p99.9 below 100 µs). The
        buffered network computes LSF and k every 16 samples, the baked texture interpolates k at each
        sample:""",
        shared.table(("texture", "order", *header), renders),
        f"""The limit is missed in {sum(t["cpu_p999_us"] >= LIMIT_US for t in numbers["renders"])} of
        {len(renders)} rows by CPU time, and in {sum(t["p999_us"] >= LIMIT_US for t in numbers["renders"])} by
        the clock.""",
    ]


def _score_table(rows, ways, key="gfc"):
    def cell(score):
        if score is None:
            return "-"
        if key != "gfc":
            return f"{getattr(score, key):.1f}"
        return f"{score.gfc:.3f}" + (f" ± {score.deviation:.3f}" if score.deviation is not None else "")

    table_rows = [(way, *(cell(row["scores"][way]) for row in rows)) for way in ways]
    if key == "level_db":
        exponents = ("{:.2f}, {:.2f}".format(*row["growth"]) for row in rows)
        table_rows.insert(0, ("exponents of speed, force", *exponents))
    elif key == "gfc":
        table_rows.insert(0, ("segments", *(str(row["n_segments"]) for row in rows)))
    return shared.table(("", *(row["name"] for row in rows)), table_rows)


def draw_segments(scan, width):
    """Path, speed and force of a scan and its segments (Fig. 2b).

    Segments in colour with their means; samples that are in no segment in grey.
    """
    segments = segment_adaptively(scan)
    figure = Drawing(figsize=(width, 0.44 * width), layout="constrained")
    panels = figure.subplot_mosaic([["path", "speed"], ["path", "force"]], width_ratios=(1, 1.5))
    path, signals = panels["path"], ((panels["speed"], scan.speed), (panels["force"], scan.force))
    path.plot(*scan.position.T, color=FAINT, linewidth=1, zorder=1)
    for axes, x in signals:
        axes.plot(scan.time_s, x, color=FAINT, linewidth=1)
    for i, (a, b) in enumerate(zip(segments.start, segments.stop, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        path.plot(*scan.position[a:b].T, color=colour, linewidth=2)
        for axes, x in signals:
            axes.plot(scan.time_s[a:b], x[a:b], color=colour, linewidth=2)
            axes.plot([scan.time_s[a], scan.time_s[b - 1]], 2 * [x[a:b].mean()], color=INK, linewidth=0.6)
    path.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title="position")
    panels["speed"].set(ylabel="speed (mm/s)", ylim=(0, None), title=f"{len(segments)} segments")
    panels["force"].set(ylabel="normal force (N)", xlabel="time (s)", ylim=(0, None))
    return figure


def draw_input_space(training, width):
    """Model points in the input space, without and with the silent ones (Fig. 4).

    Silent points at zero force and at zero speed bound the cloud of the segments from below.
    """
    modelled = model_scan(training)
    figure = Drawing(figsize=(width, 0.48 * width), layout="constrained")
    looks = (("segment", OURS, "o"), ("zero force", OTHER, "^"), ("zero speed", THIRD, "s"))
    for column, title in enumerate(("(a) segments", "(b) with points of zero force and of zero speed")):
        axes = figure.add_subplot(1, 2, column + 1, projection="3d")
        points = modelled.points.concatenate(modelled.silent) if column else modelled.points
        u = points.u * modelled.frame.deviation + modelled.frame.mean
        is_still, is_lifted = np.hypot(u[:, 0], u[:, 1]) < 1e-9, np.abs(u[:, 2]) < 1e-9
        kinds = (~is_still & ~is_lifted, is_lifted & ~is_still, is_still)
        for kind, (label, colour, marker) in zip(kinds[: 3 if column else 1], looks, strict=False):
            axes.scatter(*u[kind].T, color=colour, marker=marker, label=label, depthshade=False)
        axes.set(xlabel="v_x (mm/s)", ylabel="v_y (mm/s)", zlabel="f_n (N)", title=title)
        axes.locator_params(nbins=5)
        axes.set_zlim(0, None)
        axes.view_init(elev=22, azim=-60)
        axes.set_box_aspect(None, zoom=0.95)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def draw_scores(rows, width):
    """GFC of each surface (Fig. 5a).

    Mean and standard deviation over windows for the network, the published method, the triangulation and a
    single model; lines: the true process with other noise; dashed: the best null; dotted: 0.90, the limit of
    a good model in the paper.
    """
    figure, axes = new_figure(width, 0.5 * width)
    ways = ("network", "as published", "Delaunay", "one AR model")
    x, spacing = np.arange(len(rows)), 0.2
    for i, (way, (colour, shape)) in enumerate(zip(ways, LOOKS, strict=True)):
        pairs = [(j, row["scores"][way]) for j, row in enumerate(rows) if row["scores"][way] is not None]
        place, mean, deviation = np.array([(j, s.gfc, s.deviation) for j, s in pairs]).T
        error = [np.minimum(deviation, mean), np.minimum(deviation, 1 - mean)]
        position = place + (i - 1.5) * spacing
        axes.errorbar(position, mean, error, fmt=shape, color=colour, label=way, ms=5, lw=1)
    truth = [row["scores"].get("the truth again") for row in rows]
    if all(truth):
        axes.hlines([s.gfc for s in truth], x - 0.45, x + 0.45, color=INK, label="true process, other noise")
    nulls = [max(row["scores"][way].gfc for way in NULLS) for row in rows]
    axes.hlines(nulls, x - 0.45, x + 0.45, color=OTHER, linestyle="--", label="best null")
    axes.axhline(GOOD_GFC, color=INK, linewidth=0.8, linestyle=":", label="0.90: good model in the paper")
    isotropic = [not row["anisotropic"] and row["kind"] != "real" for row in rows]
    labels = [row["name"] + "\nisotropic" * flag for row, flag in zip(rows, isotropic, strict=True)]
    axes.set_xticks(x, labels)
    axes.set(ylim=(None, 1.0), ylabel="GFC, mean and deviation over windows")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def draw_spectra(seed, names, width):
    """Power spectra of recorded and rendered vibrations (Fig. 5b-d).

    Rendered spectra should agree with the recorded ones.
    """
    figure = Drawing(figsize=(width, 0.32 * width), layout="constrained")
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    for letter, name, axes in zip("bcd", names, panels, strict=False):
        rng = np.random.default_rng(seed)
        training, validation = (simulate_scan(get_surface(name), s, FS, rng) for s in (20.0, 10.0))
        output = study.render_along(model_scan(training).network(), validation, seed)
        for x, label, colour in ((validation.acceleration, "recorded", INK), (output, "rendered", OTHER)):
            f, power = signal.welch(x, FS, window="hamming", nperseg=250)
            axes.plot(f, 10 * np.log10(power), color=colour, label=label, linewidth=1.4)
        axes.set(xlabel="frequency (Hz)", title=f"({letter}) sample {name}", xlim=(0, FS / 2))
    panels[0].set_ylabel("power (dB re 1 m²/s⁴/Hz)")
    panels[0].legend()
    return figure


def draw_held_out(results, width):
    """GFC of the runs at held-out speeds, forces and directions.

    Cumulative fraction of runs against the mean GFC; dotted: 0.95, the required value.
    """
    figure, axes = new_figure(0.7 * width, 0.36 * width)
    for (label, values), colour in zip(results.items(), COLOURS, strict=False):
        share = np.arange(1, len(values) + 1) / len(values)
        axes.step(np.sort(values), share, where="post", color=colour, label=f"held-out {label}")
    axes.axvline(0.95, color=INK, linestyle=":", linewidth=0.8)
    axes.set(xlabel="mean GFC of a run", ylabel="share of runs at or below", ylim=(0, 1))
    axes.legend()
    return figure


if __name__ == "__main__":
    main()
