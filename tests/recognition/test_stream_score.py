"""Evaluation of the recognition in a stream against intervals of contact."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2
from sklearn.impute import SimpleImputer
from sklearn.naive_bayes import GaussianNB
from sklearn.preprocessing import StandardScaler
from toy_models import model_of, plan_of
from toy_surfaces import FS, SURFACES
from toy_surfaces import signal as oscillation

import texclass as tx
from texclass.evaluation import wilson_interval
from texclass.recognition import (
    DetectedContact,
    Event,
    Interval,
    OnlineSettings,
    StreamAnswer,
    StreamLog,
    WindowAnswer,
    listen,
    read_intervals,
    replay,
    score_recording,
    score_stream,
)
from texclass.recognition.live.intervals import assign_intervals
from texclass.recognition.live.stream_score import StreamScore, _rate, label_seconds, summarize
from texclass.recognition.live.stream_score_document import COLOURS, MAX_LINES, _lines
from texclass.recording import RecordingError
from texclass.reporting import render_markdown

TRAINED = ("cork", "oak")
INTERVALS = [
    Interval(1.0, 4.0, "oak"),
    Interval(6.0, 9.0, "cork"),
    Interval(11.0, 13.0, "tin"),  # not trained
    Interval(15.0, 17.0, "oak"),
]
CONTACTS = [
    DetectedContact(1.1, 4.05, 1.4, 4.5),
    DetectedContact(4.8, 5.2, 5.0, 5.6),  # false alarm
    DetectedContact(5.9, 9.0, 6.3, 9.5),
    DetectedContact(10.9, 13.2, 11.2, 13.7),
]
ANSWERS = [
    StreamAnswer(2.2, 1.1, 2.1, 0, "cork", sure=False),
    StreamAnswer(2.7, 1.6, 2.6, 0, "oak", sure=False),
    StreamAnswer(3.2, 2.1, 3.1, 0, "cork", sure=True),
    StreamAnswer(3.7, 2.6, 3.6, 0, "oak", sure=True),
    StreamAnswer(5.55, 4.8, 5.2, 1, "cork", sure=True),
    StreamAnswer(7.0, 5.9, 6.9, 2, "cork", sure=True),
    StreamAnswer(7.5, 6.4, 7.4, 2, "unknown", sure=False),
    StreamAnswer(12.0, 10.9, 11.9, 3, "unknown", sure=False),
]
LOG = StreamLog(20.0, CONTACTS, ANSWERS)


@pytest.fixture
def score():
    return score_recording(INTERVALS, LOG, TRAINED)


def column(score, key):
    return [row[key] for row in score["intervals"]]


def test_delays_and_answers_of_a_scripted_stream(score):
    assert column(score, "contact_delay_s") == [
        pytest.approx(0.4),
        pytest.approx(0.3),
        pytest.approx(0.2),
        None,
    ]
    assert column(score, "first_answer_s") == [
        pytest.approx(1.2),
        pytest.approx(1.0),
        pytest.approx(1.0),
        None,
    ]
    assert column(score, "first_right_s") == [
        pytest.approx(1.7),
        pytest.approx(1.0),
        pytest.approx(1.0),
        None,
    ]
    assert column(score, "right_to_end_s") == [pytest.approx(2.7), None, pytest.approx(1.0), None]
    assert column(score, "answer") == ["oak", "unknown", "unknown", None]
    assert column(score, "is_right") == [True, False, True, False]
    assert column(score, "is_sure") == [True, False, False, False]
    assert column(score, "n_sure_wrong") == [1, 0, 0, 0]
    assert column(score, "n_unknown") == [0, 1, 1, 0]
    assert column(score, "n_contacts") == [1, 1, 1, 0]
    assert column(score, "start_error_s") == [
        pytest.approx(0.1),
        pytest.approx(-0.1),
        pytest.approx(-0.1),
        None,
    ]
    assert column(score, "end_error_s") == [pytest.approx(0.05), pytest.approx(0.0), pytest.approx(0.2), None]
    (alarm,) = score["false_alarms"]
    assert (alarm["start_s"], alarm["answer"], alarm["has_sure_answer"]) == (4.8, "cork", True)


def test_confusion_over_time_of_a_scripted_stream(score):
    seconds = label_seconds(score["true"], score["answered"])
    expected = {
        "oak": {"no contact": 2.4, "no answer yet": 0.8, "cork": 1.0, "oak": 0.8},
        "cork": {"no contact": 0.3, "no answer yet": 0.7, "cork": 0.5, "unknown": 1.5},
        "tin": {"no contact": 0.2, "no answer yet": 0.8, "unknown": 1.0},
        "no contact": {"no contact": 7.7, "no answer yet": 0.55, "cork": 0.05, "oak": 0.5, "unknown": 1.2},
    }
    pairs = {(true, answer): s for true, row in expected.items() for answer, s in row.items()}
    assert seconds == pytest.approx(pairs)
    assert column(score, "right_s") == pytest.approx([0.8, 0.5, 1.0, 0.0])
    matrix = summarize([score], TRAINED)["confusion"]
    assert matrix["true"] == ["cork", "oak", "tin", "no contact"]
    assert matrix["answered"] == ["cork", "oak", "unknown", "no answer yet", "no contact"]
    assert matrix["seconds"][0] == pytest.approx([0.5, 0, 1.5, 0.7, 0.3])


def test_metrics_of_a_scripted_stream(score):
    summary = summarize([score], TRAINED)
    assert summary["unit"] == "interval"
    assert summary["missed"]["mean"] == 0.25
    assert (summary["missed"]["low"], summary["missed"]["high"]) == wilson_interval(1, 4)
    assert (summary["right"]["n_hits"], summary["right"]["n"]) == (2, 4)
    assert summary["ends_sure_wrong"]["n_hits"] == 0
    assert summary["has_sure_wrong"]["n_hits"] == 1
    assert (summary["sure_wrong_answers"]["n_hits"], summary["sure_wrong_answers"]["n"]) == (1, 3)
    # "unknown" is right for the surface that is not trained.
    assert (summary["unknown_answers"]["n_hits"], summary["unknown_answers"]["n"]) == (1, 6)
    assert summary["right_time"]["mean"] == pytest.approx(2.3 / 10)
    assert (summary["first_right_s"]["median"], summary["first_right_s"]["n_without"]) == (
        pytest.approx(1.0),
        1,
    )
    assert (summary["right_to_end_s"]["n"], summary["right_to_end_s"]["n_without"]) == (2, 2)
    assert summary["start_error_s"]["median"] == pytest.approx(-0.1)
    assert summary["start_error_s"]["p95"] == pytest.approx(0.1)
    for key in ("false_alarms", "sure_false_alarms"):  # one in 10 s without contact
        rate = summary[key]
        limits = chi2.ppf(0.025, 2) / 2, chi2.ppf(0.975, 4) / 2
        assert (rate["n"], rate["per_hour"]) == (1, pytest.approx(360))
        assert (rate["low"], rate["high"]) == pytest.approx([360 * limit for limit in limits])


def test_without_false_alarms_the_upper_limit_of_the_rate_is_finite():
    log = StreamLog(7200.0, [], [])
    rate = summarize([score_recording([], log, TRAINED)], TRAINED)["false_alarms"]
    assert (rate["per_hour"], rate["low"]) == (0.0, 0.0)
    assert rate["high"] == pytest.approx(-np.log(0.025) / 2)


def test_the_interval_of_a_rate_is_defined_if_one_recording_has_all_the_time():
    rate = _rate([1] + [0] * 9, [1.0] + [0.0] * 9)
    assert rate["low"] < 1 < rate["high"]


def test_false_alarms_in_bursts_widen_the_interval_of_the_rate():
    def rate(counts):
        logs = [
            StreamLog(600.0, [DetectedContact(10 * k, 10 * k + 1, 10 * k, 10 * k + 2) for k in range(n)], [])
            for n in counts
        ]
        return summarize([score_recording([], log, TRAINED) for log in logs], TRAINED)["false_alarms"]

    even, burst = rate([4] * 6), rate([0, 0, 0, 0, 0, 24])
    assert (even["per_hour"], burst["per_hour"]) == pytest.approx((24, 24))
    assert even["low"] == pytest.approx(chi2.ppf(0.025, 48) / 2)
    assert burst["high"] - burst["low"] > 3 * (even["high"] - even["low"])


def test_several_recordings_are_the_unit_of_the_intervals(score):
    summary = summarize([score] * 5, TRAINED)
    assert (summary["unit"], summary["n_intervals"]) == ("recording", 20)
    assert (summary["missed"]["low"], summary["missed"]["high"]) == wilson_interval(1.25, 5)
    assert summary["first_answer_s"]["low"] == summary["first_answer_s"]["median"]  # all recordings are equal


def test_a_contact_that_continues_has_no_start_or_end_between_two_intervals():
    intervals = [Interval(1.0, 3.0, "oak"), Interval(3.0, 6.0, "cork"), Interval(8.0, 9.0, "oak")]
    contacts = [DetectedContact(1.0, 6.1, 1.2, 6.6), DetectedContact(8.0, 10.0, 8.2, None)]
    answers = [
        StreamAnswer(2.1, 1.0, 2.0, 0, "oak", sure=True),
        StreamAnswer(4.1, 3.0, 4.0, 0, "oak", sure=True),  # the window ends in the second interval
        StreamAnswer(5.1, 4.0, 5.0, 0, "cork", sure=True),
    ]
    score = score_recording(intervals, StreamLog(10.0, contacts, answers), TRAINED)
    assert column(score, "is_merged") == [None, None, False]  # the first two have no gap between them
    assert column(score, "start_error_s") == [0.0, None, 0.0]
    assert column(score, "end_error_s") == [None, pytest.approx(0.1), None]  # the last contact does not end
    assert column(score, "n_sure_wrong") == [0, 1, 0]
    assert column(score, "right_to_end_s") == [pytest.approx(1.1), pytest.approx(2.1), None]
    assert score["false_alarms"] == []


def test_a_contact_that_continues_through_a_gap_is_merged():
    intervals = [Interval(1.0, 3.0, "oak"), Interval(3.3, 6.0, "oak"), Interval(8.0, 9.0, "oak")]
    log = StreamLog(10.0, [DetectedContact(1.0, 6.0, 1.2, 6.5)], [])
    score = score_recording(intervals, log, TRAINED)
    assert column(score, "is_merged") == [None, True, False]
    merged = summarize([score], TRAINED)["merged"]
    assert (merged["n_hits"], merged["n"]) == (1, 2)


def test_an_answer_after_a_short_contact_belongs_to_its_interval():
    answers = [StreamAnswer(2.3, 1.0, 1.7, 0, "oak", sure=False)]
    log = StreamLog(5.0, [DetectedContact(1.0, 1.7, 1.2, 2.3)], answers)
    score = score_recording([Interval(1.0, 1.6, "oak"), Interval(2.0, 3.0, "cork")], log, TRAINED)
    assert column(score, "is_right") == [True, False]
    assert column(score, "n_contacts") == [1, 0]
    assert score["answered"] == [
        [0.0, 1.2, "no contact"],
        [1.2, 2.3, "no answer yet"],
        [2.3, 5.0, "no contact"],
    ]


def test_a_tap_ends_the_answer_of_the_tap_before():
    contacts = [DetectedContact(1.0, 1.1, 1.2, 1.7), DetectedContact(1.4, 1.45, 1.5, 2.0)]
    answers = [
        StreamAnswer(1.2, 1.0, 1.1, 0, "oak", sure=False),
        StreamAnswer(1.5, 1.4, 1.45, 1, "cork", sure=False),
    ]
    answered = score_recording([], StreamLog(3.0, contacts, answers), TRAINED)["answered"]
    expected = [(0.0, 1.2, "no contact"), (1.2, 1.5, "oak"), (1.5, 2.0, "cork"), (2.0, 3.0, "no contact")]
    assert [tuple(segment) for segment in answered] == expected


# Tables of intervals


def test_conventional_column_names_and_other_columns_of_a_table(tmp_path):
    path = tmp_path / "intervals.csv"
    path.write_text("Operator;Onset;End;Label;file\nana;2,5;4;cork;b.wav\nana;0;1;Oak;b.wav\n;;;;c.wav\n")
    table = read_intervals(path)
    assert table.intervals == {
        "b.wav": [Interval(0.0, 1.0, "Oak", 3), Interval(2.5, 4.0, "cork", 2)],
        "c.wav": [],
    }


def test_intervals_may_follow_each_other_without_a_gap():
    frame = pd.DataFrame([(0.0, 2.5, "oak"), (2.5, 4.0, "cork")], columns=["start", "end", "surface"])
    assert len(read_intervals(frame).intervals[""]) == 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("start_s,end_s\n1,2\n", "no column `surface`"),
        ("begin,start,end,surface\n1,1,2,oak\n", "several columns for `start_s` (begin, start)"),
        ("start,end,surface\n1,x,oak\n", "row 2: end_s is 'x', not a number"),
        ("start,end,surface\n3,2,oak\n4,4,oak\n", "row 3: ends at 4 s, which is not after its start at 4 s"),
        ("start,end,surface\n-1,2,oak\n", "must be finite and not negative"),
        ("start,end,surface\n1,inf,oak\n", "must be finite"),
        ("start,end,surface\n1,2,\n", "row 2: an empty cell is not a surface"),
        ("start,end,surface\n1,2,no contact\n", "no contact is not a surface"),
        ("start,end,surface\n5,8,oak\n1,6,cork\n", "rows 3 and 2 overlap (cork until 6 s, oak from 5 s)"),
        ("start,end,surface,recording\n1,2,oak,\n", "row 2 has no recording"),
        ("start,end,surface\n", "no intervals"),
        ("", "has no rows"),
    ],
)
def test_invalid_tables_are_reported(tmp_path, text, problem):
    path = tmp_path / "intervals.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"intervals\.csv") as caught:
        read_intervals(path)
    assert problem in str(caught.value)


def test_names_in_a_table_match_paths_file_names_and_stems():
    intervals = [Interval(1.0, 2.0, "oak")]

    def assign(names, recordings, folders=("data",)):
        table = read_intervals(
            pd.DataFrame(
                [(name, 1.0, 2.0, "oak") for name in names], columns=["file", "start", "end", "label"]
            )
        )
        return assign_intervals(table, recordings, folders)

    recordings = ["data/a/x.wav", "data/b/x.wav", "data/b/y.wav"]
    for names in (["a/x.wav"], ["data/a/x.wav"], ["a/x"], ["a/x.csv"]):
        assigned, notices = assign(names, recordings)
        assert (list(assigned), notices) == (["data/a/x.wav"], [])
    assert list(assign(["y"], recordings)[0]) == ["data/b/y.wav"]
    assert list(assign(["x"], ["bag:/data/x.mcap?topic=/imu"])[0]) == ["bag:/data/x.mcap?topic=/imu"]
    bag = "data/run/metadata.yaml"
    for name in ("run", "run.mcap"):
        assert list(assign([name], [bag])[0]) == [bag]
    assigned, notices = assign(["run_0", "run_0.5"], ["data/run_0.5"])
    assert (len(assigned["data/run_0.5"]), notices) == (1, ["intervals: 1 name without a recording: run_0"])
    with pytest.raises(ValueError, match=r"no row matches metadata\.yaml"):
        assign(["run"], [bag.removeprefix("data/run/")])
    assigned, notices = assign(["y.wav", "z.wav"], recordings)
    assert notices == ["intervals: 1 name without a recording: z.wav"]
    assert [one[:3] for one in assigned["data/b/y.wav"]] == [one[:3] for one in intervals]
    with pytest.raises(ValueError, match=r"'x\.wav' matches data/a/x\.wav and data/b/x\.wav"):
        assign(["x.wav"], recordings)
    with pytest.raises(ValueError, match=r"no row matches data/a/x\.wav.*got 'z\.wav'"):
        assign(["z.wav"], recordings)
    with pytest.raises(ValueError, match="overlap"):  # two names of one recording
        assign(["y.wav", "y"], recordings)


# Whole recordings


def rest(seconds, seed):
    return 0.001 * np.random.default_rng(seed).standard_normal(round(seconds * FS))


@pytest.fixture(scope="module")
def stream():
    """Return rest, oak, rest, an unknown surface, rest, cork, rest; and its intervals."""
    parts, rows, n = [], [], 0
    for k, (surface, hz) in enumerate(
        {"oak": SURFACES["oak"], "tin": 1250.0, "cork": SURFACES["cork"]}.items()
    ):
        parts += [rest(1.5, k), oscillation(hz, 50 + k, round((2 + k) * FS))]
        start = n + len(parts[-2])
        n = start + len(parts[-1])
        rows.append((start / FS, n / FS, surface))
    samples = np.concatenate([*parts, rest(1.5, 9)])
    return samples, pd.DataFrame(rows, columns=["start_s", "end_s", "surface"])


@pytest.fixture(scope="module")
def folder(stream, window_model, tmp_path_factory):
    """Return a folder with a model, a folder of two recordings, and the table of their intervals."""
    samples, frame = stream
    root = tmp_path_factory.mktemp("score")
    window_model.save(root / "toy.skops")
    (root / "drives").mkdir()
    np.savetxt(root / "drives/one.csv", samples)
    np.savetxt(root / "drives/two.csv", samples[round(1.0 * FS) :])
    both = pd.concat(
        [
            frame.assign(recording="one.csv"),
            frame.assign(recording="two.csv", start_s=frame.start_s - 1, end_s=frame.end_s - 1),
        ]
    )
    both.to_csv(root / "drives/intervals.csv", index=False)
    return root


AT_REST = OnlineSettings(starts_in_contact=False)


def test_replay_collects_what_a_live_stream_sends(window_model, stream):
    recording = tx.Recording(stream[0], FS, "m/s^2", "stream")
    log = replay(window_model, recording, settings=AT_REST)
    updates = list(listen(window_model, recording, settings=AT_REST))
    answers = [update for update in updates if isinstance(update, WindowAnswer)]
    assert [answer.t_s for answer in log.answers] == [update.n_received / FS for update in answers]
    labels = ["unknown" if u.verdict.unknown else u.verdict.surface for u in answers]
    assert [answer.label for answer in log.answers] == labels
    events = {
        kind: [u for u in updates if isinstance(u, Event) and u.kind == kind]
        for kind in ("contact", "lift-off")
    }
    assert [contact.start_s for contact in log.contacts] == [event.sample / FS for event in events["contact"]]
    assert [contact.released_s for contact in log.contacts] == [u.n_received / FS for u in events["lift-off"]]
    assert log.duration_s == len(stream[0]) / FS


def test_a_stream_of_trained_and_other_surfaces(window_model, stream):
    recording = tx.Recording(stream[0], FS, "m/s^2", "stream")
    score = tx.score_stream(window_model, recording, stream[1], settings=AT_REST)
    assert score.table["answer"].tolist() == ["oak", "unknown", "cork"]
    assert score.table["is_right"].all()
    assert score.table["start_error_s"].abs().max() < 0.05
    assert score.table["end_error_s"].abs().max() < 0.06
    assert (score.table["first_right_s"] >= 0.24).all()  # about a window
    assert (score.table["first_right_s"] < 0.5).all()
    assert score.data["recordings"][0]["false_alarms"] == []
    assert score.confusion.to_numpy().sum() == pytest.approx(len(stream[0]) / FS)
    assert score.confusion.loc["oak", "oak"] > 1.5
    assert any("not trained on tin" in notice for notice in score.data["notices"])
    text = render_markdown(score.document())
    assert "**100.0 %**" in text
    assert "tin (not trained)" in text


def test_the_command_scores_a_folder_and_writes_the_report(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    arguments = ["score-stream", "toy.skops", "drives", "--intervals", "drives/intervals.csv", "--fs", FS]
    code, out, err = command(*arguments, "--at-rest", "-o", "score")
    assert (code, err) == (0, "")
    assert "6 intervals of contact in 2 recordings" in out
    files = sorted(path.name for path in (folder / "score").iterdir())
    suffixes = ("-confusion.png", "-intervals.csv", "-timeline.png", ".json", ".md")
    assert files == [f"toy-stream-score{suffix}" for suffix in suffixes]
    rows = pd.read_csv(folder / "score/toy-stream-score-intervals.csv")
    assert rows["recording"].tolist() == ["one.csv"] * 3 + ["two.csv"] * 3
    code, printed, _ = command(*arguments, "--at-rest", "--json", "-")
    data = json.loads(printed)
    assert (code, data["kind"], data["summary"]["missed"]["n_hits"]) == (0, "stream_score", 0)
    assert data["settings"] == {"starts_in_contact": False}
    code, out, _ = command("report", "score/toy-stream-score.json", "-o", "page.html")
    assert code == 0
    assert "Confusion over time" in (folder / "page.html").read_text(encoding="utf-8")


def test_bad_recordings_are_listed_and_the_others_are_scored(command, folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    one = folder / "drives/one.csv"
    (tmp_path / "bad.csv").write_text("")
    (tmp_path / "unlisted.csv").write_bytes(one.read_bytes())
    table = pd.read_csv(folder / "drives/intervals.csv")
    late = table.iloc[:1].assign(recording="two.csv", start_s=99.0, end_s=100.0)
    bad = table.iloc[:1].assign(recording="bad.csv")
    pd.concat([table[:3], bad, late]).to_csv("intervals.csv", index=False)
    names = [one, folder / "drives/two.csv", "bad.csv", "unlisted.csv"]
    arguments = ["score-stream", folder / "toy.skops", *names, "--intervals", "intervals.csv", "--fs", FS]
    code, out, err = command(*arguments)
    assert code == 1
    assert "3 intervals of contact in 1 recording" in out
    assert "bad.csv: is empty" in err
    assert "oak starts at 99 s (row 6), but the recording ends at" in err
    assert "intervals.csv: no row for 1 recording: unlisted.csv" in err
    assert command(*arguments, "--skip-bad")[0] == 0
    for end, problem in ((4, "no row for 1 recording"), (2, "starts at 99 s")):
        with pytest.raises(RecordingError, match=problem):
            score_stream(folder / "toy.skops", list(map(str, names[:end])), "intervals.csv", fs=FS)
    code, _, err = command(*arguments[:2], "bad.csv", *arguments[-4:])
    assert (code, err.count("bad.csv: is empty")) == (1, 1)


def test_several_recordings_require_their_column(command, folder, tmp_path):
    table = tmp_path / "plain.csv"
    table.write_text("start_s,end_s,surface\n1,2,oak\n")
    files = (folder / "drives/one.csv", folder / "drives/two.csv")
    code, _, err = command("score-stream", folder / "toy.skops", *files, "--intervals", table)
    assert code == 1
    assert "no column `recording`, but there are 2 recordings" in err


def test_evidence_cannot_decay_at_once(command, folder):
    source, table = folder / "drives", folder / "drives/intervals.csv"
    arguments = ("--intervals", table, "--fs", FS, "--forget", 0)
    code, _, err = command("score-stream", folder / "toy.skops", source, *arguments)
    assert code != 0
    assert "forget_s must be positive, got 0.0 s" in err


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("absent.csv", "absent.csv: cannot be opened"),
        ("-", "cannot score the live source -"),
        ("ros2:/imu", "cannot score the live source ros2:/imu"),
    ],
)
def test_sources_that_are_no_recordings_are_reported(command, folder, source, problem):
    table = folder / "drives/intervals.csv"
    code, _, err = command("score-stream", folder / "toy.skops", source, "--intervals", table, "--fs", FS)
    assert (code, problem in err) == (1, True), err


def test_a_folder_with_nothing_but_the_table_has_no_recordings(command, folder, tmp_path):
    table = tmp_path / "intervals.csv"
    table.write_text("start_s,end_s,surface\n1,2,oak\n")
    code, _, err = command("score-stream", folder / "toy.skops", tmp_path, "--intervals", table, "--fs", FS)
    assert (code, f"no recordings to score in {tmp_path}" in err) == (1, True), err


def test_an_interval_is_shortened_to_its_recording_with_a_notice(window_model, stream):
    recording = tx.Recording(stream[0], FS, "m/s^2", "stream")
    frame = stream[1].assign(end_s=[*stream[1]["end_s"][:2], 20.0], surface=["Oak", "tin", "cork"])
    score = score_stream(window_model, recording, frame, settings=AT_REST)
    assert score.table["end_s"].iloc[-1] == len(stream[0]) / FS
    (notice,) = score.data["recordings"][0]["notices"]
    assert "cork ends at 20 s (row 3), after the end of the recording" in notice
    assert "Rename it to oak if it is the same surface" in "".join(score.data["notices"])


def test_a_recording_without_contact_counts_false_alarms(window_model):
    noise = tx.Recording(rest(5.0, 3), FS, "m/s^2", "noise")
    frame = pd.DataFrame({"recording": ["noise"], "start_s": [None], "end_s": [None], "surface": [None]})
    score = score_stream(window_model, noise, frame, settings=AT_REST)
    assert (len(score.table), score.data["summary"]["false_alarms"]["n"]) == (0, 0)
    assert "false alarms" in render_markdown(score.document())


def test_a_single_interval_has_no_interval_of_its_delays(score):
    one = score | {"intervals": score["intervals"][:1]}
    summary = summarize([one], TRAINED)
    assert (summary["first_right_s"]["low"], summary["merged"]) == (None, None)
    model = {"name": "toy", "surfaces": TRAINED, "trained_on": "toy", "window_s": 1.0, "hop_s": 0.5}
    recordings = [one | {"recording": "one.csv", "notices": ["drift: a", "drift: b", "lost: 3 samples"]}]
    data = {"model": model, "summary": summary, "recordings": recordings, "left_out": [], "notices": []}
    more = {"settings": {}, "table": "i.csv", "seed": 0, "versions": {}, "code_hash": ""}
    text = render_markdown(StreamScore(data | more).document())
    assert "| Delay to: first right answer | 1.70 | 1.70 | 1 | 0 |" in text
    assert "one.csv: drift: a (1 similar)" in text


def test_a_tap_counts_as_contact_if_the_model_uses_taps_only():
    model = model_of(
        [SimpleImputer(), StandardScaler()], GaussianNB(), plan=plan_of(("hardness",)), undefined=0.0
    )
    model = replace(model, manifest=model.manifest.model_copy(update={"phases": ("tap",)}))
    x = rest(3.0, 1)
    for impact in (4000, 5200, 10_000):
        n = np.arange(400)
        x[impact : impact + 400] += 5 * np.exp(-n / 40) * np.sin(2 * np.pi * 600 * n / FS)
    log = replay(model, tx.Recording(x, FS, "m/s^2", "taps"), settings=AT_REST)
    assert [contact.start_s for contact in log.contacts] == pytest.approx([1.0, 1.3, 2.5], abs=0.02)
    assert [answer.contact for answer in log.answers] == [0, 1, 2]
    score = score_recording([Interval(0.9, 2.0, "oak"), Interval(2.4, 2.8, "oak")], log, TRAINED)
    assert column(score, "n_contacts") == [2, 1]
    assert column(score, "n_answers") == [2, 1]
    # The answer after the second tap is valid for 0.5 s.
    second, third = (contact.detected_s for contact in log.contacts[1:])
    ends = [end for _, end, label in score["answered"] if label not in ("no contact", "no answer yet")]
    assert ends[-2:] == pytest.approx([second + 0.5, min(third + 0.5, 3.0)])


def test_long_recordings_are_divided_into_lines(stream, tmp_path):
    rows = [Interval(10.0 * k + 1, 10.0 * k + 5, "oak") for k in range(360)]
    log = StreamLog(3600.0, [DetectedContact(*one[:2], one[0] + 0.2, one[1] + 0.5) for one in rows], [])
    data = score_recording(rows, log, TRAINED)
    lines = _lines([{"recording": "long", **data}])
    assert 1 < len(lines) <= MAX_LINES
    assert lines[-1][2] == pytest.approx(3600.0)


def test_the_plot_shows_intervals_and_answers(score):
    data = {"recordings": [score | {"recording": "one.csv"}, score | {"recording": "two.csv"}]}
    axes = StreamScore(data).plot()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one.csv", "two.csv"]
    handles, labels = axes.get_legend_handles_labels()
    assert labels[0] == "right answer"
    assert set(labels) == set(COLOURS)  # the scripted stream has all kinds
    alarms = handles[labels.index("false alarm")]
    assert [bar.get_x() for bar in alarms] == pytest.approx([5.0, 5.55] * 2)  # no answer yet, then cork


def test_a_saved_result_is_read_again(window_model, stream, tmp_path):
    recording = tx.Recording(stream[0], FS, "m/s^2", "stream")
    score = score_stream(window_model, recording, stream[1], settings=AT_REST)
    path = score.save(tmp_path)[0]
    data = json.loads(path.read_text())
    assert data.pop("kind") == "stream_score"
    again = StreamScore(data)
    pd.testing.assert_frame_equal(again.table, score.table)


def test_a_recording_of_several_marked_surfaces_is_played_as_a_whole(command, folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drives").mkdir()
    for path in (folder / "drives").iterdir():
        (tmp_path / "drives" / path.name).write_bytes(path.read_bytes())
    arguments = ["score-stream", folder / "toy.skops", "drives", "--intervals", "drives/intervals.csv"]
    arguments += ["--fs", FS, "--at-rest", "--json", "-"]
    n = len(np.loadtxt("drives/one.csv"))
    content = {
        "format": "texclass phases", "version": 1, "recording": "one.csv", "duration_s": n / FS, "fs_hz": FS,
        "taps": [], "movement": [],
        "surfaces": [
            {"start_s": 0.0, "end_s": 4.0, "surface": "oak"}, {"start_s": 4.0, "end_s": 9.0, "surface": "tin"}
        ],
    }  # fmt: skip
    _, before, _ = command(*arguments)
    (tmp_path / "drives/one.phases.json").write_text(json.dumps(content), encoding="utf-8")
    code, out, err = command(*arguments)
    assert code == 0, err
    scores = [json.loads(text)["summary"] for text in (before, out)]
    assert scores[0] == scores[1]
