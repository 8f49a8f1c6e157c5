"""Document of the evaluation of the recognition in a stream: tables, time line and confusion over time."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.plots import axes_or_new
from texclass.recognition.evaluation import UNKNOWN
from texclass.recognition.live.intervals import NO_ANSWER, NO_CONTACT
from texclass.reporting import Document, Figure, Finding, Heading, HeatMap, Shade, Table
from texclass.reporting.figure_style import (
    FAINT,
    FOURTH,
    INK,
    OTHER,
    OURS,
    PALETTE,
    WIDTH,
    label_rows,
    legend_above,
    row_axes,
)
from texclass.reporting.wording import MINUS, counted, digits, estimate, interval, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

Data = Mapping[str, Any]
Line = tuple[str, float, float, Data]
"""Line of the time line: name, start and end in seconds, and recording."""
DELAY_TITLES = {
    "contact_delay_s": "contact reported",
    "first_answer_s": "first answer",
    "first_right_s": "first right answer",
    "right_to_end_s": "right answer that stays right",
}
ERROR_TITLES = {"start_error_s": "start of the contact", "end_error_s": "end of the contact"}
COLOURS = {
    "right answer": OURS,
    "wrong answer": OTHER,
    f"{UNKNOWN} instead of a trained surface": FOURTH,
    NO_ANSWER: FAINT,
    "false alarm": PALETTE["e3"],
    "contact reported outside of its interval": PALETTE["e1"],
}
"""Colour of each kind of answer in the time line."""
LINE_INTERVALS = 20
"""Number of intervals of median length in one line of the time line, so that they remain visible."""
MAX_LINES = 40
"""Largest number of lines of the time line, which limits the height of the figure."""
MAX_ROWS = 200
"""Largest number of intervals in the table of the time line. A CSV file contains all intervals."""


def stream_score_document(data: Data) -> Document:
    """Return the evaluation of the recognition in a stream as a document.

    Parameters
    ----------
    data : mapping
        JSON values of a `StreamScore`.
    """
    summary, model = data["summary"], data["model"]
    n_intervals, n_recordings = summary["n_intervals"], summary["n_recordings"]
    rows = pd.DataFrame(
        [
            {"recording": recording["recording"], **row}
            for recording in data["recordings"]
            for row in recording["intervals"]
        ]
    )
    blocks: list[Any] = [Heading("Contacts and answers"), _main_table(summary)]
    if n_intervals:
        blocks += [Heading("Delays and errors of contacts"), _delay_table(summary)]
        blocks += [Heading("Every surface"), _surface_table(rows)]
    if n_recordings > 1:
        blocks += [Heading("Every recording"), _recording_table(data["recordings"])]
    blocks += [Heading("Time line"), _timeline(data["recordings"], rows), Heading("Confusion over time")]
    blocks.append(_confusion(summary["confusion"], model["surfaces"]))
    if notices := _notices(data):
        blocks += [Heading("Notices"), notices]
    settings = ", ".join(f"{name} = {value}" for name, value in data["settings"].items())
    return Document(
        f"Recognition in streams with the model {model['name']}",
        blocks,
        subtitle=(
            f"{counted(n_intervals, 'interval')} of contact in {counted(n_recordings, 'recording')}, "
            f"{_duration(3600 * summary['hours'])}; "
            f"windows of {model['window_s']:g} s every {model['hop_s']:g} s"
        ),
        finding=_finding(summary),
        reproduction={
            "Model": f"{model['name']}, trained on {model['trained_on']}",
            "Intervals": data["table"],
            "Settings": settings or "default",
            "Seed": str(data["seed"]),
            "Code": data["code_hash"],
        },
        versions=data["versions"],
    )


def _finding(summary: Data) -> Finding | None:
    alarms = summary["false_alarms"]
    count = ""
    if alarms is not None:
        count = f", with {_rate_basis(alarms, counted(alarms['n'], 'false alarm'))} without contact"
    if not summary["n_intervals"]:
        return alarms and Finding(digits(alarms["per_hour"]), "per hour", _limits(alarms), "false alarms.")
    right, missed = summary["right"], summary["missed"]
    return Finding(
        percent(right["mean"]),
        "%",
        interval(right),
        "of the intervals end with the right answer.",
        f"{percent(missed['mean'])} % of the contacts are missed{count}.",
    )


def _limits(estimated: Data) -> str:
    """Return the 95 % interval of a number that is not a proportion."""
    if estimated["low"] is None:
        return ""
    return f"[{digits(estimated['low'])}, {digits(estimated['high'])}]"


def _rate_basis(rate: Data, count: str = "") -> str:
    """Return the number of events and the time of a rate."""
    return f"{count or rate['n']} in {_duration(3600 * rate['hours'])}"


def _duration(seconds: float) -> str:
    """Return a duration in s, min or h."""
    size, unit = (1, "s") if seconds < 120 else (60, "min") if seconds < 7200 else (3600, "h")
    return f"{digits(seconds / size)} {unit}"


def _main_table(summary: Data) -> Table:
    """Return the table of proportions and rates."""
    rows: list[tuple[str, str, str]] = []

    def add(title: str, key: str, noun: str) -> None:
        if (value := summary.get(key)) is not None:
            rows.append(
                (f"{title} (%)", estimate(value), f"{value['n_hits']} of {counted(value['n'], noun)}")
            )

    add("Missed contacts", "missed", "interval")
    add("Merged with the previous contact", "merged", "interval")
    add("Right answer at the end", "right", "interval")
    add("Sure but wrong at the end", "ends_sure_wrong", "interval")
    add("Sure but wrong at any time", "has_sure_wrong", "interval")
    add("Wrong answers among the sure ones", "sure_wrong_answers", "answer")
    add('Answers "unknown" on trained surfaces', "unknown_answers", "answer")
    if (share := summary.get("right_time")) is not None:
        limits = "" if share["low"] is None else f" {interval(share)}"
        seconds = f"{digits(share['seconds'])} of {digits(share['of_seconds'])} s"
        rows.append(("Contact time with the right answer (%)", f"{percent(share['mean'])}{limits}", seconds))
    for key, title in (
        ("false_alarms", "False alarms per hour"),
        ("sure_false_alarms", "False alarms with a sure answer, per hour"),
    ):
        if (rate := summary[key]) is not None:
            rows.append((title, f"{digits(rate['per_hour'])} {_limits(rate)}", _rate_basis(rate)))
    unit = f" Confidence intervals are over {summary['unit']}s." if "unit" in summary else ""
    return Table(
        pd.DataFrame(rows, columns=["Result", "Value", "Based on"]),
        "A contact is missed if no detected contact overlaps its interval. A false alarm is a detected "
        "contact that overlaps no interval; its rate refers to the time outside of the intervals. A contact "
        f"is merged if a detected contact continues through the gap before its interval.{unit} "
        "The confidence intervals of rates assume that false alarms within a recording are independent.",
    )


def _delay_table(summary: Data) -> Table:
    """Return the table of delays since the start of an interval, and of errors of detected contacts."""
    rows = []
    for titles, kind in ((DELAY_TITLES, "Delay to"), (ERROR_TITLES, "Error of")):
        for key, title in titles.items():
            if (value := summary[key]) is None:
                rows.append((f"{kind}: {title}", "", "", 0, summary["n_intervals"]))
                continue
            limits = "" if value["low"] is None else f" [{value['low']:.2f}, {value['high']:.2f}]"
            median = f"{value['median']:.2f}{limits}".replace("-", MINUS)
            p95 = f"{value['p95']:.2f}"
            rows.append((f"{kind}: {title}", median, p95, value["n"], value["n_without"]))
    return Table(
        pd.DataFrame(rows, columns=["Seconds", "Median", "95th percentile", "Intervals", "Without"]),
        "Delays count from the start of the interval. Errors are positive if the detected contact starts or "
        "ends too late; their 95th percentile is that of the magnitude. Without: intervals without such an "
        "answer or contact, or whose contact continues from or into the neighbouring interval.",
    )


def _surface_table(rows: pd.DataFrame) -> Table:
    """Return the table of the outcomes of each surface."""
    cells = []
    for surface, group in rows.groupby("surface", sort=True):
        name = surface if group["is_trained"].all() else f"{surface} (not trained)"
        cells.append((name, *_outcome_cells(group)))
    return Table(pd.DataFrame(cells, columns=["Surface", *OUTCOME_COLUMNS]), OUTCOME_CAPTION)


OUTCOME_COLUMNS = (
    "Intervals",
    "Missed",
    "Right at the end",
    "Right (s)",
    "Sure but wrong",
    "Most frequent wrong answer",
)
OUTCOME_CAPTION = (
    "Right (s): median delay to the right answer that stays right. Sure but wrong: intervals with a "
    "sure wrong answer at any time. The last column is about the answers at the end."
)


def _outcome_cells(group: pd.DataFrame) -> tuple[Any, ...]:
    """Return numbers of intervals, and the delay to the right answer, of some intervals."""
    delays = group["right_to_end_s"].dropna()
    wrong = group["answer"][~group["is_right"] & group["answer"].notna()]
    frequent = wrong.value_counts()
    return (
        len(group),
        int((group["n_contacts"] == 0).sum()),
        int(group["is_right"].sum()),
        f"{delays.median():.2f}" if len(delays) else "",
        int((group["n_sure_wrong"] > 0).sum()),
        f"{frequent.index[0]} ({frequent.iloc[0]})" if len(frequent) else "",
    )


def _recording_table(recordings: Sequence[Data]) -> Table:
    """Return the table of the outcomes of each recording."""
    cells = []
    for recording in recordings:
        rows = pd.DataFrame(recording["intervals"])
        outcome = (0, 0, 0, "", 0, "") if rows.empty else _outcome_cells(rows)
        seconds, n_alarms = digits(recording["duration_s"]), len(recording["false_alarms"])
        cells.append((recording["recording"], seconds, n_alarms, *outcome))
    columns = ["Recording", "Duration (s)", "False alarms", *OUTCOME_COLUMNS]
    return Table(pd.DataFrame(cells, columns=columns), OUTCOME_CAPTION)


def _interval_table(rows: pd.DataFrame, recordings: Sequence[Data]) -> Table:
    """Return the table of the first intervals and false alarms."""
    cells = []
    for row in rows.head(MAX_ROWS).to_dict("records"):
        answer = row["answer"] or ("no answer" if row["n_contacts"] else "missed")
        delays = ["" if pd.isna(row[key]) else f"{row[key]:.2f}" for key in DELAY_TITLES]
        times = (f"{row['start_s']:.2f}", f"{row['end_s']:.2f}")
        cells.append((row["recording"], row["surface"], answer, *times, *delays))
    alarms = [(recording["recording"], one) for recording in recordings for one in recording["false_alarms"]]
    for name, one in alarms[:MAX_ROWS]:
        times = (f"{one['start_s']:.2f}", f"{one['end_s']:.2f}")
        cells.append((name, NO_CONTACT, one["answer"] or "no answer", *times, *[""] * len(DELAY_TITLES)))
    n_omitted = len(rows) + len(alarms) - len(cells)
    more = f" {n_omitted:,} rows are left out: see the CSV and JSON files." if n_omitted else ""
    titles = [f"{title[0].upper()}{title[1:]} (s)" for title in DELAY_TITLES.values()]
    columns = ["Recording", "Surface", "Answer at the end", "Start (s)", "End (s)", *titles]
    caption = f"Intervals, then false alarms.{more}"
    return Table(pd.DataFrame(cells, columns=columns), caption, n_words=3)


def _notices(data: Data) -> list[str]:
    """Return the notices about the table and the recordings."""
    left_out = [f"left out: {one['problem']}" for one in data["left_out"]]
    notices = []
    for recording in data["recordings"]:
        kinds: dict[str, list[str]] = {}
        for notice in recording["notices"]:
            kinds.setdefault(notice.partition(":")[0], []).append(notice)
        for similar in kinds.values():
            more = f" ({len(similar) - 1} similar)" if len(similar) > 1 else ""
            notices.append(f"{recording['recording']}: {similar[0]}{more}")
    return [*left_out, *data["notices"], *notices]


def _confusion(matrix: Data, surfaces: Sequence[str]) -> HeatMap:
    """Return the confusion over time as a heat map. Columns without any time are left out."""
    rows, seconds = {}, np.array(matrix["seconds"])
    used = [j for j, name in enumerate(matrix["answered"]) if seconds[:, j].any() or name in matrix["true"]]
    wrong: list[tuple[str, str, float, float]] = []
    for i, true in enumerate(matrix["true"]):
        right = true if true in (*surfaces, NO_CONTACT) else UNKNOWN
        total, shades = seconds[i].sum(), []
        for j in used:
            answered, value = matrix["answered"][j], seconds[i, j]
            share = value / total if total else 0.0
            fifth = max(1, int(np.ceil(5 * share - 1e-9)))
            colour = f"{'d' if answered == right else 'e'}{fifth}"
            text = f"{value:.0f}" if value >= 10 else f"{value:.1f}"
            shades.append(
                Shade(colour, text, f"{value:.2f} s ({100 * share:.0f} %)") if value >= 0.05 else Shade()
            )
            if answered != right and value >= 0.05:
                wrong.append((true, answered, value, share))
        rows[true if right != UNKNOWN else f"{true} (not trained)"] = shades
    wrong.sort(key=lambda error: -error[2])
    summary = f"{digits(sum(error[2] for error in wrong))} of {digits(float(seconds.sum()))} s are wrong"
    if wrong:
        summary += f"; the longest: {wrong[0][1]!r} during {wrong[0][0]!r}, {wrong[0][2]:.3g} s"
    cells = [(true, answered, f"{value:.1f}", f"{100 * share:.0f}") for true, answered, value, share in wrong]
    return HeatMap(
        "confusion",
        "Confusion over time, in seconds",
        f"{summary}. Answers count from the time at which they are available.",
        dict.fromkeys((matrix["answered"][j] for j in used), ""),
        rows,
        {"d1 d2 d3 d4 d5": "correct", "e1 e2 e3 e4 e5": "wrong; each step is a fifth of the time of a row"},
        "never",
        "True label (rows), answer (columns)",
        " answered as ",
        Table(pd.DataFrame(cells, columns=["True label", "Answer", "Seconds", "% of its time"]), n_words=2),
        row_label="True label",
        column_label="Answer at the same time",
    )


def _timeline(recordings: Sequence[Data], rows: pd.DataFrame) -> Figure:
    """Return the figure of the true intervals and the answers over time."""
    lines, n_hidden = _shown_lines(recordings)
    hidden = f" The {counted(n_hidden, 'recording')} with fewest errors are not shown." if n_hidden else ""
    n_errors = sum(map(_n_errors, recordings))
    return Figure(
        "timeline",
        "True intervals (above) and answers (below)",
        f"{counted(n_errors, 'error')}: intervals that are missed or end with a wrong answer, and false "
        f"alarms.{hidden}",
        lambda width: _draw_timeline(lines, width),
        _interval_table(rows, recordings),
    )


def plot_timeline(recordings: Sequence[Data], ax: "Axes | None" = None) -> "Axes":
    """Plot the true intervals and the answers over time on axes; see `StreamScore.plot`."""
    lines = _shown_lines(recordings)[0]
    ax = axes_or_new(ax, WIDTH, 1.2 + 0.5 * len(lines))
    label_rows(ax, [name for name, *_ in lines], _x_title(lines))
    figure = ax.get_figure(root=True)
    _draw_lines(ax, lines, WIDTH if figure is None else figure.get_figwidth())
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False)
    return ax


def _shown_lines(recordings: Sequence[Data]) -> tuple[list[Line], int]:
    """Return the lines of the time line, and the number of recordings that do not fit."""
    shown = sorted(recordings, key=lambda recording: -_n_errors(recording))
    lines = _lines(recordings)
    while len(lines) > MAX_LINES and len(shown) > 1:  # the recordings with most errors
        shown = shown[: max(1, len(shown) * MAX_LINES // len(lines))]
        lines = _lines([recording for recording in recordings if recording in shown])
    return lines, len(recordings) - len(shown)


def _n_errors(recording: Data) -> int:
    return len(recording["false_alarms"]) + sum(not row["is_right"] for row in recording["intervals"])


def _lines(recordings: Sequence[Data]) -> list[Line]:
    """Return name, start, end and recording of each line of the time line; long recordings are divided."""
    longest = max(recording["duration_s"] for recording in recordings)
    total = sum(recording["duration_s"] for recording in recordings)
    lengths = [row["end_s"] - row["start_s"] for recording in recordings for row in recording["intervals"]]
    readable = LINE_INTERVALS * float(np.median(lengths)) if lengths else longest
    shortest = max(readable, total / MAX_LINES)
    round_numbers = [digit * 10.0**power for power in range(-3, 7) for digit in (1, 2, 5)]
    line_s = min(longest, next(number for number in round_numbers if number >= shortest))
    lines = []
    for recording in recordings:
        n = max(1, int(np.ceil(recording["duration_s"] / line_s - 1e-9)))
        for k in range(n):
            name = recording["recording"] if n == 1 else f"{recording['recording']}, from {k * line_s:.4g} s"
            lines.append((name, k * line_s, (k + 1) * line_s, recording))
    return lines


def _x_title(lines: Sequence[Line]) -> str:
    is_divided = any(start > 0 for _, start, _, _ in lines)
    return "time since the start of the line (s)" if is_divided else "time (s)"


def _draw_timeline(lines: Sequence[Line], width: float) -> "Drawing":
    figure, axes = row_axes(width, [name for name, *_ in lines], _x_title(lines), n_marks=2)
    _draw_lines(axes, lines, width)
    legend_above(figure, axes)
    return figure


def _draw_lines(axes: "Axes", lines: Sequence[Line], width: float) -> None:
    """Draw intervals and answers; `width` is the width of the figure in inches."""
    line_s = max(end - start for _, start, end, _ in lines)
    axes.set_xlim(0, line_s)
    # A character of this size is about 0.06 inches wide; names take about a quarter of a wide figure.
    seconds_per_character = 0.06 * line_s / (0.75 * width)
    bars: dict[str, list[tuple[int, float, float]]] = {kind: [] for kind in COLOURS}
    for y, (_, start, end, recording) in enumerate(lines):
        surfaces = {row["surface"] for row in recording["intervals"] if row["is_trained"]}
        alarms = [(one["detected_s"], one["released_s"] or math.inf) for one in recording["false_alarms"]]
        for a, b, label in _clipped(recording["true"], start, end):
            if label != NO_CONTACT:
                axes.barh(y - 0.19, b - a, 0.3, a - start, color=PALETTE["d2"])
                if (b - a) > seconds_per_character * len(label):
                    middle = (a + b) / 2 - start
                    axes.text(middle, y - 0.19, label, fontsize=6, ha="center", va="center", color=INK)
        for a, b, true, label in _pairs(recording, start, end):
            if kind := _kind(true, label, surfaces, is_alarm=any(x <= a < z for x, z in alarms)):
                bars[kind].append((y, a - start, b - a))
    for kind, rows in bars.items():
        if rows:
            y_values, lefts, widths = np.transpose(rows)
            axes.barh(y_values + 0.17, widths, 0.3, lefts, color=COLOURS[kind], label=kind)


def _clipped(segments: Iterable[Sequence[Any]], start: float, end: float) -> list[tuple[float, float, str]]:
    """Return the parts of segments between two times."""
    return [(max(a, start), min(b, end), label) for a, b, label in segments if a < end and b > start]


def _pairs(recording: Data, start: float, end: float) -> list[tuple[float, float, str, str]]:
    """Return the parts of a line with one true label and one answer: start, end, true label, answer."""
    return [
        (a, b, true, label)
        for first, last, label in _clipped(recording["answered"], start, end)
        for a, b, true in _clipped(recording["true"], first, last)
    ]


def _kind(true: str, label: str, trained: Iterable[str], *, is_alarm: bool) -> str:
    """Return the kind of an answer in the time line, or "" if nothing is drawn."""
    if label == NO_CONTACT:
        return ""
    if true == NO_CONTACT:
        return "false alarm" if is_alarm else "contact reported outside of its interval"
    if label == NO_ANSWER:
        return NO_ANSWER
    if label == (true if true in trained else UNKNOWN):
        return "right answer"
    return f"{UNKNOWN} instead of a trained surface" if label == UNKNOWN else "wrong answer"
