"""What the report on `oeztuerk2018` says."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from texclass.reporting.reproductions._oeztuerk2018_predictions import ABSENT, predictions, table
from texclass.textures.oeztuerk2018.intervals import speed_intervals
from texclass.textures.oeztuerk2018.speeds import PEAK_FACTOR
from texclass.textures.oeztuerk2018.study import N_PATHS, N_SEEDS, TABLE_3_1, Study
from texclass.vibration.major_frequencies import BEAT_THRESHOLDS_HZ

KEY = "oeztuerk2018"
BANDS = ("0-50", "50-100", "100-150", "150-250", "250-500", "500-1400")
TABLE_6_1 = {
    "coarse foam": (0.6, "0-4, 4-8, > 8 cm/s"),
    "fine foam": (0.6, "0-4, 4-8, > 8 cm/s"),
    "oak": (0.2, "0-4, 4-8, 8-12, 12-16, > 16 cm/s"),
    "granite tile": (0.2, "0-4, 4-8, 8-12, 12-16, > 16 cm/s"),
    "steel wool": (0.4, "0-4, 4-8, 8-12, > 12 cm/s"),
}
FIGURE_5_2 = {"coarse foam": 9.4, "granite tile": 10.2, "fine foam": 10.7, "oak": 11.8, "steel wool": 14.0}


def markdown(result: Study, numbers: dict[str, Any]) -> str:
    """Return the report."""
    return f"""\
# oeztuerk2018: signals at any speed from recordings at a few

Öztürk, "Refined methods for creating tactile signals considering speed dependency", bachelor thesis, 2018.
**Its recordings are not public.** Real recordings here are `lmt_excerpts` (other surfaces from the same lab,
one unknown speed each) and `fabric_speeds` (a finger over fabrics at four unknown speeds, v1 slow to v4
fast); what is called simulated comes from texclass's own simulated surfaces. **There are no subjects here:**
where the thesis asked people, a spectral criterion stands, and says less.

## Figure 3.2: order of the LPC model

{_orders(result)}

## Figure 3.3: recorded and synthesized

![Figure 3.3](oeztuerk2018-fig3-3.png)

Brick of `lmt_excerpts` instead of granite (a simulated surface where that is absent); time signals differ,
spectra agree.

## Tables 3.1 and 3.2: thresholds of beats

Table 3.2 takes the largest threshold of five persons in Table 3.1: {_agree(result.thresholds_agree)}.

{_thresholds()}

![Figures 3.4 and 3.5: two tones](oeztuerk2018-fig3-4.png)

{_beats(result)}

## Figures 3.6 to 3.9: major frequencies, and between two speeds

![Figures 3.6 to 3.8](oeztuerk2018-fig3-6.png)

Compressed wood of `lmt_excerpts` instead of oak. Below, figure 3.9 with a simulated wood at 40 and 160 mm/s
instead of oak at 40 and 400 mm/s: of the frequencies of either end, pairs closer than the threshold glide,
the others fade.

![Figure 3.9](oeztuerk2018-fig3-9.png)

Mirrored and repeated to 10 s, the largest jump where copies meet is {result.jump_at_joins:g} (1 s of signal,
5 mirrored copies, as printed). An example for friction 0.2, the interval from 8 to 12 cm/s between the
recorded speeds: `oeztuerk2018-between.wav` (16 bit, scaled to full scale).

## Chapter 4, Table 6.1: intervals of speed from friction

{_intervals(result)}

The thesis prints numbers of intervals, not speeds: mean speeds of figure 4.1 and the seventh, "extreme",
coefficient exist as pictures only. The simulated speeds follow a law that we chose to give about as many
bins (mean 150 mm/s exp(-friction / 0.64), gamma distribution, 240 samples); they test the rule (last bin
with at least 5 % of the samples), not the thesis.

![Figure 4.1](oeztuerk2018-fig4-1.png)

![Figure 4.2](oeztuerk2018-fig4-2.png)

{_table_6_1()}

## Figure 5.1: are synthesized signals told from recorded ones?

Published (10 subjects, 5 materials): "same" in 96 % of the comparisons for the signal transformed forth and
back, 96 % for LPC. No subjects here. Transforming forth and back is exact to rounding by construction; the
row "own LPC" below says how far an LPC sound is from its recording, beside two halves of one recording.

## Figure 5.2: how many frequencies

{_counts(result)}

## Experiment II (figure 6.2): response to speed

Published: signals of major frequencies at interpolated speeds felt "same" in 76 % (oak 100, coarse foam 90,
granite 80, fine foam 60, steel wool 50 %). Here: the slowest and fastest of four speeds are fitted, the two
between predicted and compared with their recordings. Log spectral distance (all frequencies alike, 0 to 5
kHz), energies of nine bands from 20 to 1000 Hz, goodness of fit of the amplitude spectrum, and level.
Frequencies leave all between their lines empty: their log spectral distance has no meaning. Log gain and log
level: what is mixed beside the line spectra (the thesis: the gain). "All other speeds" has three recordings
instead of two. Nothing can be expected to be nearer than "own LPC" and "other half".

{predictions(result, numbers["fabric_seconds"])}

![Predicted spectra](oeztuerk2018-predicted.png)

## Rendering

{N_PATHS:,} random paths with contact breaks over a texture of four speeds; the output is bounded by
{PEAK_FACTOR:g} times the recorded peak by construction.

{_rendering(result)}

Steps: the largest difference of neighbouring samples while the speed jumps between 40 and 160 mm/s every
0.2 s, over the largest at either speed alone: about 1 means no click. Time per sample in one block, on the
machine of this run.

---
texclass {numbers["versions"]["texclass"]}, numpy {numbers["versions"]["numpy"]}, scipy
{numbers["versions"]["scipy"]}; seed {numbers["seed"]}; input hashes
{", ".join(f"{k} {v[:12]}" for k, v in numbers["input_hash"].items()) or "none"}. Rerun: `texclass reproduce
oeztuerk2018`.
"""


def _agree(yes: bool) -> str:
    return "so it is" if yes else "it does not"


def _orders(result: Study) -> str:
    if not result.orders:
        return ABSENT
    shown = (0, 10, 50, 100, 400, 1000)
    curves = np.array([[o.curve[m] for m in shown] for o in result.orders.values()])
    other = np.array([[o.other_half[m] for m in shown] for o in result.orders.values()])
    error = {m: float(e) for m, e in zip(shown, np.median(curves, axis=0), strict=True)}
    share = 100 * (error[0] - error[400]) / (error[0] - error[1000])
    aicc = _range([o.aicc for o in result.orders.values()])
    rows = [
        ["same recording", *(f"{e:.2f}" for e in np.median(curves, axis=0))],
        ["other half", *(f"{e:.2f}" for e in np.median(other, axis=0))],
    ]
    return f"""\
Median error, eq. (3.11) on magnitudes, over {len(curves)} recordings of `lmt_excerpts`:

{table(["order", *map(str, shown)], *rows)}

Published: little is won beyond order 400 (oak, steel wool, fine foam at 5 cm/s). Here order 400 has
{share:.0f} % of what order 1000 wins on the same recording; on its other half nothing is won beyond small
orders: what high orders add is mostly the chance of one recording. AICc takes orders {aicc}.

![Figure 3.2](oeztuerk2018-fig3-2.png)"""


def _range(values: Sequence[int]) -> str:
    return f"{min(values)} to {max(values)}, median {np.median(values):.0f}"


def _thresholds() -> str:
    rows = [
        [band, *map(str, persons), f"{limit:g}"]
        for band, persons, limit in zip(BANDS, TABLE_3_1, BEAT_THRESHOLDS_HZ, strict=True)
    ]
    head = ["Hz", *(f"person {i}" for i in ("I", "II", "III", "IV", "V")), "Table 3.2, used (Hz)"]
    return table(head, *rows)


def _beats(result: Study) -> str:
    if not result.counts:
        return ABSENT
    left = [c.too_close for c in result.counts.values()]
    margin = min(c.least_margin_hz for c in result.counts.values())
    return f"""\
In {len(left)} recordings of `lmt_excerpts`, {_range(left)} of the 30 strongest lines would beat with a
stronger one and give way to weaker lines elsewhere. The least distance of two chosen lines is their
threshold plus {margin:g} Hz (lines lie on a grid of 1 Hz)."""


def _intervals(result: Study) -> str:
    rows = []
    for r in result.intervals:
        counts = np.bincount(r.found)
        found = ", ".join(f"{n} ({100 * c / N_SEEDS:.0f} %)" for n, c in enumerate(counts) if c)
        friction = f"{r.friction:g}" + (" (extreme)" if r.friction > 1 else "")
        rows.append([friction, str(r.published), found, f"{r.mean_mm_s / 10:.1f}"])
    head = [
        "friction",
        "intervals, published",
        f"found in simulated speeds, {N_SEEDS} draws",
        "their mean, cm/s",
    ]
    return table(head, *rows)


def _table_6_1() -> str:
    rows = [
        [
            material,
            f"{mu:g}",
            published,
            str(speed_intervals(mu)),
            _same(published == str(speed_intervals(mu))),
        ]
        for material, (mu, published) in TABLE_6_1.items()
    ]
    head = ["Tables 5.1 and 6.1", "friction", "intervals, published", "`speed_intervals`", ""]
    return table(head, *rows)


def _same(yes: bool) -> str:
    return "same" if yes else "different"


def _counts(result: Study) -> str:
    published = ", ".join(f"{m} {v:g}" for m, v in FIGURE_5_2.items())
    text = f"Published means of ten subjects: {published};\nall 11.22, accepted as 12."
    if not result.counts:
        return f"{text}\n\n{ABSENT}"
    rows = [
        [
            name.split("_")[0],
            *(f"{c.gfc[n - 2]:.2f}" for n in (2, 6, 12, 20, 30)),
            _number(c.fair),
            _number(c.good),
        ]
        for name, c in result.counts.items()
    ]
    too_few = sum(c.good is None for c in result.counts.values())
    fair = [c.fair if c.fair is not None else 31 for c in result.counts.values()]
    return f"""\
{text}

Ours: goodness of fit of the amplitude spectrum (20 Hz wide, 1 s of `lmt_excerpts`) with n frequencies; other
surfaces, no subjects.

{table(["recording", *(f"n = {n}" for n in (2, 6, 12, 20, 30)), "n for 0.8", "n for 0.9"], *rows)}

A fit of 0.8 needs a median of {np.median(fair):.0f} frequencies, which is near the published number, but 0.8
is our choice. By 0.9 ("a good match", `abdulali2016`) 30 frequencies are too few for {too_few} of {len(fair)}
recordings: rough surfaces have no lines, their spectra are continuous.

![Figure 5.2](oeztuerk2018-fig5-2.png)"""


def _number(n: int | None) -> str:
    return "> 30" if n is None else str(n)


def _rendering(result: Study) -> str:
    rows = [
        [r.family, "yes" if r.finite else "no", f"{r.largest:.2f}", f"{r.click:.2f}", f"{r.microseconds:.2f}"]
        for r in result.rendering
    ]
    head = ["texture", "finite and bounded", "largest / recorded peak", "steps", "microseconds per sample"]
    return table(head, *rows)
