"""What the report on `okamura2001` says."""

from typing import Any

import numpy as np
from scipy import stats

from texclass.recording import Samples
from texclass.reporting.words import line_of
from texclass.textures.okamura2001.factorial import EFFECTS, FACTORS
from texclass.textures.okamura2001.library import TapLibrary
from texclass.textures.okamura2001.simulated import MATERIALS, MOST_SENSITIVE, TABLE_I, TABLE_II
from texclass.textures.okamura2001.study import N_EXPERIMENTS, N_SEEDS, N_TAPS, PUBLISHED_CORRECT, Study
from texclass.vibration import TapModel

KEY = "okamura2001"


def markdown(result: Study, numbers: dict[str, Any]) -> str:
    """Return the report."""
    d = result.device
    test = result.identification
    low, high = test.interval
    return f"""\
# okamura2001: taps as decaying sinusoids, a(t) = A v exp(-B t) sin(w t)

Okamura, Cutkosky, Dennerlein, "Reality-based models for vibration feedback in virtual environments", 2001.
**Neither its recordings nor its ratings are public. Everything below is simulated, with the published
parameters as truth, except the last section, which is real taps.** Simulated people follow rules stated
here: what they do shows that the analysis works, not what people feel.

## Table I: measured parameters, and what is recovered of them

{N_TAPS} simulated taps per material from 0.05 to 0.4 m/s, each with rest before the impact, which falls
between two samples; white noise of 1 % of the largest amplitude; {N_SEEDS} seeds. Found together: A, B, w
and the moment of each impact. B is printed as 40,000 ... 1,500,000 1/s, which contradicts figure 3 (the
vibration of wood lasts for milliseconds): read as 40 ... 1500 1/s.

{_recovery_table(result)}

{_recovery_verdict(result)}

With aluminum's A = -100,000 1/s a tap of 0.4 m/s would reach {_largest_g():,.0f} g; the paper's accelerometer
ends at 500 g. Its A is therefore an extrapolation from slow taps, or the unit is another one.

![Figure 1: from the tap to the device](okamura2001-fig1.png)

Figure 2 of the paper is a photograph.

![Figure 3: a tap and its model](okamura2001-fig3.png)

![Figure 4: amplitude against velocity](okamura2001-fig4.png)

## Figure 5: a tap on a virtual wall

![Figure 5: two taps on a virtual wall](okamura2001-fig5.png)

Penalty force k x plus the vibration of Table II at the velocity of the impact; two taps, the second one
harder; {d.rate_hz:,.0f} Hz, sample by sample, cut at the device's {d.limit_n:g} N.

## Section III-A, Table II: scaled into a device

The paper's device is described by a curve (figure 6), and its factors are experts' judgements. Ours is a
rule (order and logarithmic spacing kept, decays per period kept, peak forces between {d.force_n[0]:g} and
{d.force_n[1]:g} N at 0.4 m/s) for a device of our choice: {d.band_hz[0]:g} to {d.band_hz[1]:g} Hz, moving
mass {d.mass_kg:g} kg, response falling from {d.cutoff_hz:g} Hz on.

{_scaling_table(result)}

The rule keeps wood where it lies between the others on a logarithmic scale; the experts put it lower. The
rule keeps the oscillations per decay time, w/B; the experts gave aluminum {_ringing(TABLE_II):.1f} of them
instead of {_ringing(TABLE_I):.1f}: it shall ring. The sign of rubber's published A is lost in our copy.

![Figure 6 and the scaled library](okamura2001-fig6.png)

## Figure 7: the 2^3 factorial design

Simulated ratings (1 to 10) of 10 raters per material, each normalised to mean 0 and deviation 1; the raters
are most sensitive to the factor that the paper found. Effects in deviations of a rater, analysis of variance
with 1 and 63 degrees of freedom.

{_factorial_table(result)}

The most sensitive factor is found again in {_found(result)} of {N_SEEDS} simulated
studies. Published: decay rate for rubber, frequency for wood, amplitude slope for aluminum; effects and F
values are not printed.

![Figure 7: mean rating of the eight runs](okamura2001-fig7.png)

## Table III: identification

{N_EXPERIMENTS} experiments (14 users, 3 times); an experiment is correct when all three surfaces are named
right. Simulated users feel ln A, ln B and ln w of Table II with Gaussian noise and give each name once, the
nearest way. **The noise, {result.noise:.2f} nepers, was chosen so that 83.3 % are correct in the long run**;
free are only which surfaces are confused, and the scatter of {N_EXPERIMENTS} experiments.

{
        _table(
            ["", "experiments", "correct", "share"],
            ["all, published", "42", "35", "83.3 %"],
            ["third test only, published", "14", "12", "85.7 %"],
            ["experts, published", "18", "16", "88.9 %"],
            ["novices, published", "24", "19", "79.2 %"],
            [
                "all, simulated",
                str(len(test.answers)),
                str(test.n_correct),
                f"{100 * test.correct:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)",
            ],
        )
    }

The 95 % interval of the published 35 of 42 is {_published_interval()}; it holds all other rows, so the
published numbers alone show neither learning nor experience.

{_confusion_table(result)}

Published: the most common error was to take wood for rubber or the reverse. Our users take wood for
aluminum as often ({100 * result.long_run[1, 2]:.1f} %) as for rubber ({
        100 * result.long_run[1, 0]:.1f} %): by equal
weights of the three cues both lie equally near. The paper's users must weigh them
otherwise.

![Table III: confusion](okamura2001-table3.png)

## Real taps: `taps5`

{_real_section(result)}

---
texclass {numbers["versions"]["texclass"]}, numpy {numbers["versions"]["numpy"]}, scipy
{numbers["versions"]["scipy"]}; seed {numbers["seed"]}; input hash
{numbers["input_hash"].get("taps5", "none")[:12]}. Rerun: `texclass reproduce okamura2001`.
"""


def _table(*rows: list[str]) -> str:
    head, *rest = rows
    return "\n".join(line_of(tuple(row)) for row in [head, ["---"] * len(head), *rest])


def _recovery_table(result: Study) -> str:
    rows = [
        [
            "material",
            "A (1/s)",
            "B (1/s)",
            "w (Hz)",
            "velocity known to",
            "A off by",
            "B",
            "w",
            "R² of figure 4",
        ]
    ]
    for e, one in result.recovery.items():
        for m in MATERIALS:
            errors = 100 * np.abs(one.errors[m]).max(axis=0)
            rows.append(
                [
                    m,
                    *_values(TABLE_I[m]),
                    f"{100 * e:.0f} %",
                    *(f"≤ {x:.2f} %" for x in errors),
                    f"{one.r_squared[m]:.3f}",
                ]
            )
    return _table(*rows)


def _recovery_verdict(result: Study) -> str:
    lines = []
    for e, one in result.recovery.items():
        worst = 100 * max(np.abs(errors).max() for errors in one.errors.values())
        within = np.mean([np.all(np.abs(errors) < 0.03, axis=1).mean() for errors in one.errors.values()])
        lines.append(
            f"With velocities known to {100 * e:.0f} % the largest error of all is {worst:.2f} %, and\n"
            f"{100 * within:.0f} % of the fits have all three within 3 %."
        )
    return " ".join(lines) + " The scatter of 6 % has the published R² of 0.98."


def _ringing(library: TapLibrary) -> float:
    return library["aluminum"].frequency_hz / library["aluminum"].decay_per_s


def _published_interval() -> str:
    found = stats.binomtest(PUBLISHED_CORRECT, N_EXPERIMENTS).proportion_ci(0.95)
    return f"{100 * found.low:.1f} to {100 * found.high:.1f} %"


def _largest_g() -> float:
    return abs(TABLE_I["aluminum"].amplitude_slope) * 0.4 / 9.80665


def _scaling_table(result: Study) -> str:
    libraries: dict[str, TapLibrary] = {
        "measured (Table I)": TABLE_I,
        "published for the 3GM (Table II)": TABLE_II,
        "our rule": result.scaled,
    }
    rows = [["material", "", "A (1/s)", "B (1/s)", "w (Hz)", "peak force at 0.4 m/s (N)"]]
    for m in MATERIALS:
        for name, library in libraries.items():
            force = result.device.peak_force(library[m], 0.4)
            rows.append([m, name, *_values(library[m]), f"{force:,.2f}"])
    return _table(*rows)


def _factorial_table(result: Study) -> str:
    rows = [["effect", *(f"{m}: effect (F)" for m in MATERIALS)]]
    for name in EFFECTS:
        cells = []
        for m in MATERIALS:
            r = result.factorial[m]
            text = f"{r.effect[name]:+.2f} ({r.f_value[name]:.1f})"
            cells.append(f"**{text}**" if name in FACTORS and name == r.most_sensitive else text)
        rows.append([name, *cells])
    rows.append(["most sensitive, published", *(MOST_SENSITIVE[m] for m in MATERIALS)])
    return _table(*rows)


def _found(result: Study) -> str:
    return ", ".join(f"{N_SEEDS * result.factor_found[m]:.0f} ({m})" for m in MATERIALS)


def _confusion_table(result: Study) -> str:
    rows = [["displayed", *(f"named {m}" for m in MATERIALS)]]
    for m, counts, share in zip(MATERIALS, result.identification.confusion, result.long_run, strict=True):
        rows.append([m, *(f"{n} ({100 * p:.1f} %)" for n, p in zip(counts, share, strict=True))])
    return "Counts of the simulated test (share in 20,000 experiments):\n\n" + _table(*rows)


def _real_section(result: Study) -> str:
    if not result.real:
        return "Skipped: the recordings are not on this machine (`TEXCLASS_DATA`)."
    rows = [["plate", "taps", "B per sample", "w, cycles per sample", "energy explained"]]
    for m, r in result.real.items():
        cells = [_quartiles(r.decay, 4), _quartiles(r.frequency, 4), _quartiles(r.explained, 2)]
        rows.append([m, str(r.decay.size), *cells])
    share = np.median(np.concatenate([r.explained for r in result.real.values()]))
    return f"""\
The same code on real taps on five plates, second channel, resting level removed. **The sampling rate is
unknown: time is in samples; velocities are unknown: no A.** Median (quartiles) over the taps of a plate.

{_table(*rows)}

One decaying sinusoid explains {100 * share:.0f} % of the energy of a typical tap: these plates ring with
several modes, strong taps reach the converter's rail, and each row has a seam of the recorder. For such taps
the matrix pencil with several modes (`fit_matrix_pencil`) is the better model.

![Real taps and the model](okamura2001-taps5.png)"""


def _quartiles(values: Samples, digits: int) -> str:
    low, middle, high = np.nanquantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.{digits}f} ({low:.{digits}f} ... {high:.{digits}f})"


def _values(model: TapModel) -> list[str]:
    return [f"{model.amplitude_slope:,.6g}", f"{model.decay_per_s:,.4g}", f"{model.frequency_hz:,.4g}"]
