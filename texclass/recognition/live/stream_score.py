"""Evaluation of the recognition in a stream against intervals of contact with known surfaces.

`replay` plays a recording through a `Session` and collects its contacts and answers. `score_recording`
compares them with the intervals, and `summarize` pools the recordings. `score_stream` does all of this.
"""

import math
import re
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import chdtri

from texclass.atomic_write import write_atomic
from texclass.evaluation.accuracy import MIN_CLUSTERS, cluster_interval, wilson_interval
from texclass.evaluation.result_facts import CODE_DEPENDENCIES
from texclass.loaders.phases_files import split_part
from texclass.loaders.readers import BAG_METADATA, LoadingOptions
from texclass.provenance import code_provenance, versions
from texclass.recognition.evaluation import UNKNOWN
from texclass.recognition.live.contact import Event
from texclass.recognition.live.intervals import (
    NO_ANSWER,
    NO_CONTACT,
    Interval,
    assign_intervals,
    read_intervals,
)
from texclass.recognition.live.online_recogniser import OnlineRecogniser, OnlineSettings, WindowAnswer
from texclass.recognition.live.session import Notice, Session
from texclass.recognition.live.stream_score_document import plot_timeline, stream_score_document
from texclass.recognition.model import Model, load_model
from texclass.recognition.sources.source_by_name import is_live, open_source
from texclass.recognition.sources.training_input import Member
from texclass.recording import Recording, RecordingError, Samples
from texclass.reporting import Document
from texclass.reporting.result_files import Result
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DELAYS = ("contact_delay_s", "first_answer_s", "first_right_s", "right_to_end_s")
"""Keys of the delays of an interval, in seconds since its start."""
ERRORS = ("start_error_s", "end_error_s")
"""Keys of the differences between a detected contact and its interval, in seconds."""
N_BOOTSTRAP, SEED = 1000, 0
"""Number of bootstrap samples of the units, and seed of their random numbers."""
ROUNDING_S = 0.01
"""Time in s by which an interval may end after its recording without a notice: labels are rounded."""
Data = dict[str, Any]


class DetectedContact(NamedTuple):
    """Contact that the stream has detected.

    Attributes
    ----------
    start_s, end_s
        Start and end in seconds since the first sample, as detected.
    detected_s
        Time at which the start was reported.
    released_s
        Time at which the end was reported; None if the recording ends before it.

    Examples
    --------
    >>> contact = DetectedContact(1.0, 3.0, detected_s=1.25, released_s=3.5)
    >>> contact.detected_s - contact.start_s
    0.25
    """

    start_s: float
    end_s: float
    detected_s: float
    released_s: float | None


class StreamAnswer(NamedTuple):
    """Answer of the stream for a contact so far.

    Attributes
    ----------
    t_s
        Time of the answer in seconds since the first sample.
    start_s, end_s
        Start and end of the last window.
    contact
        Index of the contact.
    label
        Predicted surface, or "unknown".
    sure
        Whether the answer is sure.

    Examples
    --------
    >>> StreamAnswer(2.1, 1.0, 2.0, contact=0, label="oak", sure=True).label
    'oak'
    """

    t_s: float
    start_s: float
    end_s: float
    contact: int
    label: str
    sure: bool


@dataclass(frozen=True)
class StreamLog:
    """Contacts and answers of one recording that was played like a live stream.

    Attributes
    ----------
    duration_s : float
        Duration of the recording in seconds.
    contacts : sequence of DetectedContact
        Detected contacts in order of time.
    answers : sequence of StreamAnswer
        Answers in order of time.
    notices : sequence of str
        Notices about faults of the recording.

    Examples
    --------
    >>> StreamLog(4.0, [DetectedContact(1.0, 3.0, 1.25, 3.5)], []).duration_s
    4.0
    """

    duration_s: float
    contacts: Sequence[DetectedContact]
    answers: Sequence[StreamAnswer]
    notices: Sequence[str] = ()


def replay(
    model: Model,
    recording: Recording,
    *,
    settings: OnlineSettings | None = None,
    adapt: bool = False,
    resample: float | None = None,
) -> StreamLog:
    """Play a recording like a live stream, but as fast as possible, and collect contacts and answers.

    If the model uses taps only, every tap is a contact. Its answer is valid until the next tap, or until a
    pause that counts as a lift-off has passed.

    Parameters
    ----------
    model, settings, adapt, resample
        See `listen`.
    recording : Recording
        Recording.

    Examples
    --------
    >>> replay(load_model("surfaces.skops"), recording).contacts  # doctest: +SKIP
    """
    settings = settings or OnlineSettings()
    is_tap_model = "movement" not in model.manifest.phases
    session = Session(model, raw=False, settings=settings, adapt=adapt)
    updates = list(session.run(open_source(recording, rate=resample, model=model)))
    if session.recogniser is None:
        raise RecordingError(f"{recording.source or recording.recording_id}: contains no samples")
    fs, duration_s = session.recogniser.fs, session.recogniser.n_samples / session.recogniser.fs
    contacts: list[DetectedContact] = []
    answers: list[StreamAnswer] = []
    # The recogniser uses the settings of the training recordings, unless the user changes them.
    changes = model.manifest.phase_settings.changes | settings.contact.changes
    pause_s = changes.get("pause_s", settings.contact.pause_s)
    for update in updates:
        if isinstance(update, WindowAnswer):
            verdict, times = update.verdict, (update.n_received / fs, update.start / fs, update.stop / fs)
            label = UNKNOWN if verdict.unknown else verdict.surface
            answers.append(StreamAnswer(*times, max(len(contacts) - 1, 0), label, verdict.sure))
        elif isinstance(update, Event):
            start_s, end_s, t_s = update.sample / fs, update.end / fs, update.n_received / fs
            if update.kind == "tap" and is_tap_model:
                released_s = t_s + pause_s
                contacts.append(DetectedContact(start_s, end_s, t_s, released_s))
            elif update.kind == "contact" and not is_tap_model:
                contacts.append(DetectedContact(start_s, duration_s, t_s, None))
            elif update.kind == "lift-off" and contacts and not is_tap_model:
                contacts[-1] = contacts[-1]._replace(end_s=start_s, released_s=t_s)
    notices = [update.message for update in updates if isinstance(update, Notice)]
    return StreamLog(duration_s, contacts, answers, notices)


def score_recording(intervals: Sequence[Interval], log: StreamLog, surfaces: Sequence[str]) -> Data:
    """Compare the contacts and answers of a stream with the intervals of contact of its recording.

    - A contact is found if a detected contact overlaps the interval. A detected contact that overlaps no
      interval is a false alarm.
    - A contact is merged with the previous one if a detected contact continues through the gap between their
      intervals.
    - An answer belongs to the last interval that its last window overlaps.
    - The right answer is the surface of the interval or, if the model was not trained on it, "unknown".
    - The time line consists of the answers as they are known at each time: a contact begins when its start is
      reported, and ends when its end is reported.

    Parameters
    ----------
    intervals : sequence of Interval
        Intervals of contact in order of time, which do not overlap.
    log : StreamLog
        Contacts and answers.
    surfaces : sequence of str
        Surfaces of the model.

    Returns
    -------
    dict
        JSON values: `duration_s`; `intervals`, with the outcome of each interval; `false_alarms`;
        `outside_s`, the time without contact; `true` and `answered`, the time lines as lists of
        (start, end, label).

    Examples
    --------
    >>> contact = DetectedContact(1.0, 3.0, detected_s=1.25, released_s=3.5)
    >>> answer = StreamAnswer(2.1, 1.0, 2.0, contact=0, label="oak", sure=True)
    >>> log = StreamLog(4.0, [contact], [answer])
    >>> score = score_recording([Interval(0.9, 3.0, "oak")], log, ["cork", "oak"])
    >>> score["intervals"][0]["is_right"], round(score["intervals"][0]["first_right_s"], 3)
    (True, 1.2)
    """
    own_answers = defaultdict[int | None, list[StreamAnswer]](list)
    contact_answers = defaultdict[int, list[StreamAnswer]](list)
    for answer in log.answers:
        own_answers[_interval_of(answer, intervals)].append(answer)
        contact_answers[answer.contact].append(answer)
    answered = _answered_labels(log, contact_answers)
    outcomes = []
    for i, interval in enumerate(intervals):
        previous, following = (intervals[j] if 0 <= j < len(intervals) else None for j in (i - 1, i + 1))
        right = interval.surface if interval.surface in surfaces else UNKNOWN
        outcome = _outcome(interval, previous, following, log.contacts, own_answers[i], right)
        right_s = _seconds_within(interval, [segment for segment in answered if segment[2] == right])
        outcomes.append(outcome | {"is_trained": interval.surface in surfaces, "right_s": right_s})
    false_alarms = [
        {
            "start_s": contact.start_s,
            "end_s": contact.end_s,
            "detected_s": contact.detected_s,
            "released_s": contact.released_s,
            "answer": contact_answers[k][-1].label if contact_answers[k] else None,
            "has_sure_answer": any(answer.sure for answer in contact_answers[k]),
        }
        for k, contact in enumerate(log.contacts)
        if not any(_overlap(contact, interval) for interval in intervals)
    ]
    return {
        "duration_s": log.duration_s,
        "outside_s": max(0.0, log.duration_s - sum(one.end_s - one.start_s for one in intervals)),
        "intervals": outcomes,
        "false_alarms": false_alarms,
        "true": _true_labels(intervals, log.duration_s),
        "answered": answered,
    }


def _overlap(contact: DetectedContact, interval: Interval) -> bool:
    return contact.start_s < interval.end_s and contact.end_s > interval.start_s


def _interval_of(answer: StreamAnswer, intervals: Sequence[Interval]) -> int | None:
    """Return the index of the last interval that the last window of an answer overlaps, or None."""
    i = bisect_left(intervals, answer.end_s, key=lambda interval: interval.start_s) - 1
    return i if i >= 0 and answer.start_s < intervals[i].end_s else None


def _seconds_within(interval: Interval, segments: Sequence[Sequence[Any]]) -> float:
    """Return the time in seconds that segments of a time line have in common with an interval."""
    overlaps = (min(end, interval.end_s) - max(start, interval.start_s) for start, end, _ in segments)
    return math.fsum(seconds for seconds in overlaps if seconds > 0)


def _outcome(
    interval: Interval,
    previous: Interval | None,
    following: Interval | None,
    contacts: Sequence[DetectedContact],
    answers: Sequence[StreamAnswer],
    right: str,
) -> Data:
    """Return the outcome of an interval. Delays are in seconds since its start, or None."""
    detected = [contact for contact in contacts if _overlap(contact, interval)]
    # A contact that continues from one interval to the next has no start or end of its own between them.
    joins_previous = bool(detected) and previous is not None and _overlap(detected[0], previous)
    joins_following = bool(detected) and following is not None and _overlap(detected[-1], following)
    has_gap_before = previous is not None and previous.end_s < interval.start_s
    has_start = bool(detected) and not joins_previous
    has_end = bool(detected) and not joins_following and detected[-1].released_s is not None
    right_times = [answer.t_s for answer in answers if answer.label == right]
    last_wrong = max((i for i, answer in enumerate(answers) if answer.label != right), default=-1)
    last = answers[-1] if answers else None

    def delay(t_s: float | None) -> float | None:
        return None if t_s is None else t_s - interval.start_s

    return {
        "surface": interval.surface,
        "start_s": interval.start_s,
        "end_s": interval.end_s,
        "n_contacts": len(detected),
        "is_merged": joins_previous if has_gap_before else None,
        "start_error_s": detected[0].start_s - interval.start_s if has_start else None,
        "end_error_s": detected[-1].end_s - interval.end_s if has_end else None,
        "contact_delay_s": delay(detected[0].detected_s if has_start else None),
        "first_answer_s": delay(answers[0].t_s if answers else None),
        "first_right_s": delay(right_times[0] if right_times else None),
        "right_to_end_s": delay(answers[last_wrong + 1].t_s if last_wrong + 1 < len(answers) else None),
        "answer": None if last is None else last.label,
        "is_right": last is not None and last.label == right,
        "is_sure": last is not None and last.sure,
        "n_answers": len(answers),
        "n_unknown": sum(answer.label == UNKNOWN for answer in answers),
        "n_sure": sum(answer.sure for answer in answers),
        "n_sure_wrong": sum(answer.sure and answer.label != right for answer in answers),
    }


def _true_labels(intervals: Sequence[Interval], duration_s: float) -> list[list[Any]]:
    """Return the true time line: (start, end, surface or "no contact")."""
    changes: list[tuple[float, str]] = []
    for interval in intervals:
        changes += [(interval.start_s, interval.surface), (interval.end_s, NO_CONTACT)]
    return _segments(changes, duration_s)


def _answered_labels(log: StreamLog, answers: Mapping[int, Sequence[StreamAnswer]]) -> list[list[Any]]:
    """Return the time line of the stream: (start, end, answer, "no answer yet" or "no contact")."""
    changes: list[tuple[float, str]] = []
    for k, contact in enumerate(log.contacts):
        changes.append((contact.detected_s, NO_ANSWER))
        changes += [(answer.t_s, answer.label) for answer in answers[k]]
        next_s = log.contacts[k + 1].detected_s if k + 1 < len(log.contacts) else np.inf
        if contact.released_s is not None and contact.released_s < next_s:
            changes.append((contact.released_s, NO_CONTACT))
    return _segments(changes, log.duration_s)


def _segments(changes: Sequence[tuple[float, str]], duration_s: float) -> list[list[Any]]:
    """Return the segments (start, end, label) between changes of a label, which is "no contact" at first."""
    segments: list[list[Any]] = []
    all_changes = [(0.0, NO_CONTACT), *changes, (duration_s, "")]
    for (start_s, label), (change_s, _) in pairwise(all_changes):
        end_s = min(change_s, duration_s)
        if end_s <= start_s:
            continue
        if segments and segments[-1][2] == label:
            segments[-1][1] = end_s
        else:
            segments.append([start_s, end_s, label])
    return segments


def label_seconds(
    true: Sequence[Sequence[Any]], answered: Sequence[Sequence[Any]]
) -> dict[tuple[str, str], float]:
    """Return the time in seconds that each pair of labels of two time lines has in common.

    Parameters
    ----------
    true, answered : sequence of (start, end, label)
        Time lines: consecutive segments that cover the same time.

    Examples
    --------
    >>> label_seconds([(0, 2, "oak"), (2, 4, "cork")], [(0, 3, "oak"), (3, 4, "cork")])
    {('oak', 'oak'): 2.0, ('cork', 'oak'): 1.0, ('cork', 'cork'): 1.0}
    """
    edges = np.unique([edge for line in (true, answered) for start, end, _ in line for edge in (start, end)])
    indices = [
        np.searchsorted([end for _, end, _ in line], edges[:-1], side="right") for line in (true, answered)
    ]
    seconds = defaultdict[tuple[str, str], float](float)
    for i, j, length in zip(*indices, np.diff(edges), strict=True):
        seconds[true[i][2], answered[j][2]] += float(length)
    return dict(seconds)


def summarize(recordings: Sequence[Data], surfaces: Sequence[str]) -> Data:
    """Return the metrics of all recordings together, as JSON values.

    The 95 % intervals of proportions and medians are over recordings if at least `MIN_CLUSTERS` recordings
    have intervals, otherwise over intervals.

    Parameters
    ----------
    recordings : sequence of dict
        Results of `score_recording`.
    surfaces : sequence of str
        Surfaces of the model.

    Returns
    -------
    dict
        JSON values. Proportions have `mean`, `low`, `high`, `n_hits` and `n`; delays and errors have
        `median`, `low`, `high`, `p95`, `n` and `n_without`; rates have `per_hour`, `low`, `high`, `n` and
        `hours`. They are None if they are undefined.
    """
    rows = pd.DataFrame(
        [row | {"unit": i} for i, recording in enumerate(recordings) for row in recording["intervals"]]
    )
    hours = [recording["outside_s"] / 3600 for recording in recordings]
    alarms = [recording["false_alarms"] for recording in recordings]
    n_sure = [sum(alarm["has_sure_answer"] for alarm in group) for group in alarms]
    summary: Data = {
        "n_recordings": len(recordings),
        "n_intervals": len(rows),
        "hours": sum(recording["duration_s"] for recording in recordings) / 3600,
        "false_alarms": _rate([len(group) for group in alarms], hours),
        "sure_false_alarms": _rate(n_sure, hours),
        "confusion": _confusion(recordings, surfaces),
    }
    if rows.empty:
        return summary
    has_clusters = rows["unit"].nunique() >= MIN_CLUSTERS
    units = rows["unit"] if has_clusters else pd.Series(rows.index)
    is_sure_wrong, is_trained = rows["is_sure"] & ~rows["is_right"], rows["is_trained"]
    lengths = rows["end_s"] - rows["start_s"]
    return summary | {
        "unit": "recording" if has_clusters else "interval",
        "missed": _proportion(rows["n_contacts"] == 0, units),
        "merged": _proportion(rows["is_merged"].dropna(), units[rows["is_merged"].notna()]),
        "right": _proportion(rows["is_right"], units),
        "ends_sure_wrong": _proportion(is_sure_wrong, units),
        "has_sure_wrong": _proportion(rows["n_sure_wrong"] > 0, units),
        "sure_wrong_answers": _answer_proportion(rows["n_sure_wrong"], rows["n_sure"], units),
        "unknown_answers": _answer_proportion(
            rows["n_unknown"][is_trained], rows["n_answers"][is_trained], units[is_trained]
        ),
        "right_time": {
            "mean": rows["right_s"].sum() / lengths.sum(),
            **_bootstrap(_share_of_time, np.column_stack([rows["right_s"], lengths]), units),
            "seconds": rows["right_s"].sum(),
            "of_seconds": lengths.sum(),
        },
        **{key: _quantiles(rows[key], units) for key in (*DELAYS, *ERRORS)},
    }


def _proportion(is_hit: ArrayLike, units: ArrayLike) -> Data | None:
    """Return a proportion with its 95 % interval over units."""
    hits = np.asarray(is_hit, dtype=bool)
    if not len(hits):
        return None
    has_clusters = len(np.unique(units)) < len(hits)
    low, high = cluster_interval(hits, units) if has_clusters else wilson_interval(hits.sum(), len(hits))
    return {"mean": float(hits.mean()), "low": low, "high": high, "n_hits": int(hits.sum()), "n": len(hits)}


def _answer_proportion(
    n_hits: "pd.Series[int]", n_answers: "pd.Series[int]", units: "pd.Series[int]"
) -> Data | None:
    """Return the proportion of answers with a property, given their numbers in each interval."""
    counts = np.column_stack([n_hits, n_answers - n_hits]).ravel()
    hits = np.repeat(np.tile([True, False], len(units)), counts)
    return _proportion(hits, np.repeat(np.repeat(units.to_numpy(), 2), counts))


def _share_of_time(rows: Samples) -> float:
    right_s, length_s = rows.sum(axis=0)
    return float(right_s / length_s)


def _quantiles(values: "pd.Series[float]", units: "pd.Series[int]") -> Data | None:
    """Return the median with its 95 % interval over units, and the 95th percentile of the magnitudes."""
    values = values.astype(float)
    is_defined = values.notna()
    if not is_defined.any():
        return None
    x = np.array(values[is_defined], dtype=np.float64)
    return {
        "median": float(np.median(x)),
        **_bootstrap(lambda rows: float(np.median(rows)), x, units[is_defined]),
        "p95": float(np.quantile(np.abs(x), 0.95)),
        "n": len(x),
        "n_without": int((~is_defined).sum()),
    }


def _bootstrap(statistic: Callable[[Samples], float], rows: Samples, units: "pd.Series[int]") -> Data:
    """Return the 95 % percentile interval of a statistic of rows, with resampled units."""
    groups = [rows[units.to_numpy() == unit] for unit in units.unique()]
    if len(groups) < 2:
        return {"low": None, "high": None}
    rng, n = np.random.default_rng(SEED), len(groups)
    draws = rng.integers(n, size=(N_BOOTSTRAP, n))
    low, high = np.quantile(
        [statistic(np.concatenate([groups[i] for i in draw])) for draw in draws], [0.025, 0.975]
    )
    return {"low": float(low), "high": float(high)}


def _rate(counts: Sequence[int], hours: Sequence[float]) -> Data | None:
    """Return the events per hour with the exact 95 % interval of a Poisson rate.

    If the counts of at least `MIN_CLUSTERS` recordings vary more than those of a Poisson process, the
    interval is widened: n/d events count, where d is the dispersion (Pearson's chi-square over its degrees
    of freedom).
    """
    n, total = sum(counts), sum(hours)
    if total <= 0:
        return None
    dispersion = 1.0
    if n and len(counts) >= MIN_CLUSTERS:
        expected = np.array([n * duration / total for duration in hours])
        is_possible = expected > 0
        excess = (np.array(counts)[is_possible] - expected[is_possible]) ** 2 / expected[is_possible]
        dispersion = max(1.0, float(excess.sum() / max(1, is_possible.sum() - 1)))
    m = n / dispersion
    # The limits of a Poisson mean are quantiles of chi-square distributions with 2 m and 2 m + 2 degrees.
    low, high = (float(chdtri(2 * m, 0.975)) / 2 if n else 0.0), float(chdtri(2 * m + 2, 0.025)) / 2
    return {
        "per_hour": n / total,
        "low": low * dispersion / total,
        "high": high * dispersion / total,
        "n": n,
        "hours": total,
    }


def _confusion(recordings: Sequence[Data], surfaces: Sequence[str]) -> Data:
    """Return the time in seconds for each pair of a true label and an answer."""
    seconds = defaultdict[tuple[str, str], float](float)
    for recording in recordings:
        for pair, value in label_seconds(recording["true"], recording["answered"]).items():
            seconds[pair] += value
    true = {label for label, _ in seconds}
    others = sorted(true.difference(surfaces, [NO_CONTACT]))
    rows = [*(surface for surface in surfaces if surface in true), *others, *({NO_CONTACT} & true)]
    columns = [*surfaces, UNKNOWN, NO_ANSWER, NO_CONTACT]
    return {
        "true": rows,
        "answered": columns,
        "seconds": [[seconds[row, column] for column in columns] for row in rows],
    }


@dataclass(frozen=True, eq=False, repr=False)
class StreamScore(Result, kind="stream_score"):
    """Evaluation of the recognition in a stream; returned by `score_stream`.

    `data` contains the `model` (name, surfaces, window and hop in seconds), the `summary` of all `recordings`
    (see `summarize` and `score_recording`), the recordings that are `left_out`, and `notices`.
    """

    def __repr__(self) -> str:
        summary = self.data["summary"]
        counts = f"{summary['n_intervals']} intervals in {summary['n_recordings']} recordings"
        return f"<{type(self).__name__}: {counts}>"

    @property
    def stem(self) -> str:
        """Prefix of the file names."""
        return re.sub(r"[^\w.-]+", "-", self.data["model"]["name"]) + "-stream-score"

    @property
    def table(self) -> pd.DataFrame:
        """Outcome of each interval, with times in seconds; see `score_recording`."""
        return pd.DataFrame(
            [
                {"recording": recording["recording"], **row}
                for recording in self.data["recordings"]
                for row in recording["intervals"]
            ]
        )

    @property
    def confusion(self) -> pd.DataFrame:
        """Time in seconds for each true label (rows) and each answer (columns)."""
        matrix = self.data["summary"]["confusion"]
        return pd.DataFrame(matrix["seconds"], index=matrix["true"], columns=matrix["answered"])

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot the true intervals (above) and the answers (below) of each recording over time.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on (default: axes of a new figure).

        Returns
        -------
        matplotlib.axes.Axes
            The axes, with one line per recording. Long recordings are divided into several lines.
        """
        return plot_timeline(self.data["recordings"], ax)

    def document(self) -> Document:
        """Return the evaluation as a document."""
        return stream_score_document(self.data)

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown, figures, and the table of intervals (CSV) into a folder."""
        written = super().save(folder)
        path = Path(folder) / f"{self.stem}-intervals.csv"
        write_atomic(path, self.table.to_csv(index=False, lineterminator="\n"))
        return (*written, path)


def score_stream(
    model: Model | str | Path,
    recordings: str | Path | Recording | Sequence[str | Path | Recording],
    intervals: str | Path | pd.DataFrame,
    *,
    settings: OnlineSettings | None = None,
    adapt: bool = False,
    resample: float | None = None,
    skip_bad: bool = False,
    progress: Callable[[int, int, str], None] | None = None,
    fs: float | None = None,
    unit: str | None = None,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> StreamScore:
    """Evaluate the recognition in a stream on recordings whose contacts are known.

    The recordings are played like live streams, with the same detection of contacts as `listen`.

    Parameters
    ----------
    model : Model, str or Path
        Trained model, or path of a model file.
    recordings : str, Path, Recording or sequence of these
        Recordings, files, bags, "DATASET:RECORDING", dataset cards or folders.
    intervals : str, Path or DataFrame
        Intervals of contact with their surfaces; see `read_intervals`.
    settings : OnlineSettings, optional
        Settings of the recognition.
    adapt : bool
        Whether the model is adapted to the last contacts without labels, for each recording anew (default
        False); see `Session`.
    resample : float, optional
        Rate in Hz to which the recordings are resampled, usually that of the model (default: their own rate).
    skip_bad : bool
        Whether to leave out recordings that are unreadable or have no rows in the table (default False).
    progress : callable, optional
        Function called with (n_done, n_total, "recordings").
    fs, unit : optional
        Sampling rate in Hz, and unit of the files (default: those of the training files).
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How the files are read, see `load_recording`.

    Returns
    -------
    StreamScore
        Evaluation: `table` is a DataFrame with one row per interval, and `save(folder)` writes JSON, Markdown
        and figures.

    Raises
    ------
    ValueError
        If the table of intervals is invalid or does not match the recordings, or no recording could be
        evaluated.
    RecordingError, FileNotFoundError
        If a recording is unreadable, has no rows in the table, or ends before an interval starts; with
        `skip_bad`, only if all recordings are left out.

    Examples
    --------
    >>> score = score_stream("surfaces.skops", "drives", "intervals.csv")  # doctest: +SKIP
    >>> score.table  # doctest: +SKIP
    """
    trained = model if isinstance(model, Model) else load_model(model)
    # Invalid settings fail here, not once per recording.
    used = OnlineRecogniser(trained, settings=settings)
    table = read_intervals(intervals)
    names = [recordings] if isinstance(recordings, str | Path | Recording) else recordings
    reading: LoadingOptions = {
        "fs": fs,
        "unit": unit,
        "column": column,
        "topic": topic,
        "delimiter": delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete,
    }
    members = _members(trained, names, reading, table.name)
    if not members:
        raise ValueError(f"no recordings to score in {', '.join(map(str, names))}. Expected at least one")
    paths = [Path(name).expanduser() for name in names if isinstance(name, str | Path)]
    folders = [str(path) for path in paths if path.is_dir()]
    try:
        assigned, notices = assign_intervals(table, list(members), folders)
    except ValueError:
        next(iter(members.values())).load()  # if the file does not exist, this error is the better one
        raise
    short_names = _short_names(members, folders)
    scores, left_out = _score_members(
        trained,
        {short_names[name]: member for name, member in members.items()},
        {short_names[name]: group for name, group in assigned.items()},
        table.name,
        skip_bad=skip_bad,
        progress=progress,
        settings=settings,
        adapt=adapt,
        resample=resample,
    )
    others = {row["surface"] for score in scores for row in score["intervals"] if not row["is_trained"]}
    for surface in sorted(others):
        similar = [one for one in trained.surfaces if _letters(one) == _letters(surface)]
        hint = f". Rename it to {similar[0]} if it is the same surface" if similar else ""
        notices.append(f"the model was not trained on {surface}: the right answer is {UNKNOWN!r}{hint}")
    data = {
        "model": {
            "name": trained.manifest.trained_on["name"] if isinstance(model, Model) else Path(model).stem,
            "surfaces": list(trained.surfaces),
            "trained_on": trained.manifest.trained_on["name"],
            "window_s": used.window / used.fs,
            "hop_s": used.hop / used.fs,
        },
        "settings": _changed_settings(settings, adapt=adapt, resample=resample),
        "table": table.name,
        "summary": summarize(scores, trained.surfaces),
        "recordings": scores,
        "left_out": left_out,
        "notices": notices,
        "seed": SEED,
        "versions": versions("numpy", "scipy", "scikit-learn"),
        **code_provenance(*CODE_DEPENDENCIES, "recognition"),
    }
    return StreamScore(_rounded(data))


def _letters(surface: str) -> str:
    """Return the letters and digits of a name, in lower case."""
    return re.sub(r"[\W_]", "", surface.lower())


def _score_members(
    model: Model,
    members: Mapping[str, Member],
    intervals: Mapping[str, Sequence[Interval]],
    table: str,
    *,
    skip_bad: bool,
    progress: Callable[[int, int, str], None] | None,
    **options: Any,
) -> tuple[list[Data], list[Data]]:
    """Return the scores of the recordings, and the recordings that are left out with their problems."""
    scores: list[Data] = []
    left_out: list[Data] = []
    if unlisted := [name for name in members if name not in intervals]:
        shown = ", ".join(unlisted[:5]) + (" and others" if len(unlisted) > 5 else "")
        problem = (
            f"{table}: no row for {counted(len(unlisted), 'recording')}: {shown}. Add the intervals or, for "
            "a recording without contact, a row with its name and empty cells"
        )
        if not skip_bad:
            raise RecordingError(problem)
        left_out.append({"recordings": unlisted, "problem": problem})
    for n_done, (name, group) in enumerate(intervals.items()):
        if progress is not None:
            progress(n_done, len(intervals), "recordings")
        try:
            recording = members[name].load()
            clipped, end_notices = _clip(name, group, recording.n_samples / recording.fs)
            log = replay(model, recording, **options)
            score = score_recording(clipped, log, model.surfaces)
            scores.append({"recording": name, **score, "notices": [*end_notices, *log.notices]})
        except (ValueError, OSError) as error:
            if not skip_bad:
                raise
            left_out.append({"recordings": [name], "problem": str(error)})
    if not scores:
        more = f". {len(left_out) - 1} more problems with other recordings" if len(left_out) > 1 else ""
        raise ValueError(left_out[0]["problem"] + more)
    return scores, left_out


def _members(
    model: Model, names: Iterable[str | Path | Recording], reading: LoadingOptions, table: str
) -> dict[str, Member]:
    """Return the recordings by name, without the table of intervals."""
    members: dict[str, Member] = {}
    for name in names:
        if isinstance(name, Recording):
            key = name.source or name.recording_id
            members[key] = Member(key, partial(Recording.with_, name))
            continue
        if is_live(str(name)):
            raise ValueError(f"cannot score the live source {name}. Expected recordings: record it first")
        for member in model.manifest.input.members(name, **reading):
            if Path(member.name).expanduser().resolve() != Path(table).expanduser().resolve():
                whole, part = split_part(member.name)  # the parts of a recording are played as a whole
                is_marked = part > 0 and Path(whole).expanduser().exists()
                find = partial(model.manifest.input.find, whole, **reading)
                members[whole if is_marked else member.name] = Member(whole, find) if is_marked else member
    return members


def _short_names(names: Iterable[str], folders: Iterable[str]) -> dict[str, str]:
    """Return the paths of recordings within their folders, or their full names if these are not unique."""
    short = {name: name for name in names}
    for folder in folders:
        for name in short:
            if Path(name).is_relative_to(folder):
                short[name] = Path(name).relative_to(folder).as_posix().removesuffix(f"/{BAG_METADATA}")
    return short if len(set(short.values())) == len(short) else {name: name for name in short}


def _clip(name: str, intervals: Sequence[Interval], duration_s: float) -> tuple[list[Interval], list[str]]:
    """Return the intervals up to the end of the recording, and notices about those that end after it."""
    notices = []
    for interval in intervals:
        if interval.start_s >= duration_s:
            raise RecordingError(
                f"{name}: {interval.surface} starts at {interval.start_s:g} s (row {interval.row}), but the "
                f"recording ends at {duration_s:.6g} s. Expected seconds since the first sample"
            )
        if interval.end_s > duration_s + ROUNDING_S:
            notices.append(
                f"{interval.surface} ends at {interval.end_s:g} s (row {interval.row}), after the end of the "
                f"recording at {duration_s:.6g} s: shortened"
            )
    return [interval._replace(end_s=min(interval.end_s, duration_s)) for interval in intervals], notices


def _changed_settings(settings: OnlineSettings | None, **options: bool | float | None) -> Data:
    """Return the settings that differ from their defaults, as JSON values."""
    default = OnlineSettings()
    changes = {
        name: value
        for name, value in vars(settings or default).items()
        if name != "contact" and value != getattr(default, name)
    }
    contact = (settings or default).contact
    changes |= {k: v for k, v in vars(contact).items() if v != getattr(default.contact, k)}
    return changes | {name: value for name, value in options.items() if value}


def _rounded(value: Any) -> Any:
    """Return JSON values with numbers rounded to microseconds or millionths."""
    match value:
        case Mapping():
            return {key: _rounded(item) for key, item in value.items()}
        case list() | tuple():
            return [_rounded(item) for item in value]
        case float():
            return round(float(value), 6)
        case _:
            return value
