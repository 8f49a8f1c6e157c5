"""The command `texclass stream`."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from toy_surfaces import FS, SURFACES
from toy_surfaces import signal as oscillation

from texclass import robot
from texclass.cli.stream_view import TerminalView, bar
from texclass.recognition import OnlineSettings, Session
from texclass.recognition.sources import source_by_name as sources

LIVE = ("--fs", FS, "--unit", "m/s^2")
"""Sampling rate and unit of standard input."""


@pytest.fixture(scope="module")
def model_file(linear_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "toy.skops"
    linear_model.save(path)
    return path


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(7)
    x = 0.001 * rng.standard_normal(12_000)
    x[4000:10_000] += oscillation(SURFACES["oak"], 3, 6000)
    return x


@pytest.fixture
def run(command, monkeypatch, model_file, samples):
    """Return a function that streams samples through standard input: exit code, output, errors."""

    def call(*arguments, x=samples, text=None):
        lines = text or "\n".join(map(repr, x.tolist()))
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(lines.encode()), encoding="utf-8"))
        return command("stream", model_file, *arguments)

    return call


def test_evidence_cannot_decay_at_once(run):
    code, _, err = run(*LIVE, "--window", 0.5, "--forget", 0)
    assert code != 0
    assert "forget_s must be positive, got 0.0 s" in err


def test_json_lines_contain_events_answers_and_the_final_answer(run):
    code, out, err = run(*LIVE, "--window", 0.5, "--jsonl")
    lines = [json.loads(line) for line in out.splitlines()]
    assert (code, err) == (0, "")
    assert [line["kind"] for line in lines if line["type"] == "event"] == ["contact"]
    answers = [line for line in lines if line["type"] == "answer"]
    assert answers[0]["start_s"] == pytest.approx(1.0, abs=0.01)
    assert answers[0]["stop_s"] - answers[0]["start_s"] == pytest.approx(0.5)
    final = lines[-1]
    assert final["type"] == "final"
    assert final["surface"] == "oak"
    assert final["probability"] == answers[-1]["probability"]


def test_the_result_file_is_written_if_the_reader_of_the_lines_stops(model_file, tmp_path, samples):
    np.savetxt(tmp_path / "oak.txt", np.tile(samples, 8))
    result = tmp_path / "contacts.json"
    arguments = [model_file, tmp_path / "oak.txt", "--fs", str(FS), "--jsonl", "--json", result]
    command = [sys.executable, "-m", "texclass", "stream", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        while b'"answer"' not in process.stdout.readline():
            pass
        process.stdout.close()
        errors = process.stderr.read()
    assert (process.returncode, errors) == (0, b"")
    assert json.loads(result.read_text())["contacts"][0]["surface"] == "oak"


def test_predict_and_stream_import_no_library_for_training(model_file, tmp_path, samples):
    np.savetxt(tmp_path / "oak.txt", samples)
    arguments = [str(model_file), str(tmp_path / "oak.txt"), "--fs", str(FS), "--unit", "m/s^2"]
    heavy = ("sklearn", "librosa", "skops", "joblib")
    code = (
        "import contextlib, sys\n"
        "from texclass.cli import main\n"
        "for command in ('predict', 'stream'):\n"
        f"    sys.argv = ['texclass', command, *{arguments}]\n"
        "    with contextlib.suppress(SystemExit):\n"
        "        main()\n"
        f"sys.exit(str([m for m in {heavy} if m in sys.modules] or ''))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert process.stdout.count("oak") >= 3  # the name of the file, and both answers
    lines = process.stderr.strip().splitlines()
    assert [line for line in lines if not line.startswith(("first run", "compiling"))][1:] == []


def test_the_result_file_has_the_last_verdict_of_each_contact(run, tmp_path, samples):
    x = np.concatenate([samples, samples])
    np.savetxt(tmp_path / "oak.txt", x)
    arguments = (tmp_path / "oak.txt", "--fs", FS, "--window", 0.5, "--json")
    assert run(*arguments, tmp_path / "contacts.json")[0] == 0
    contacts = json.loads((tmp_path / "contacts.json").read_text())["contacts"]
    assert [contact["surface"] for contact in contacts] == ["oak", "oak"]
    assert [contact["onset_s"] for contact in contacts] == pytest.approx([1.0, 4.0], abs=0.05)
    assert run(*arguments, tmp_path / "contacts.out")[0] == 1
    assert not (tmp_path / "contacts.out").exists()


def test_text_lines_show_contact_and_surface(run):
    code, out, _ = run(*LIVE, "--evidence", "majority")
    assert code == 0
    assert "contact" in out
    assert "final: oak" in out


def test_a_stream_of_another_rate_is_unknown_unless_resampled(run):
    x = np.repeat(oscillation(SURFACES["oak"], 3, 6000), 2)  # twice the rate
    options = ("--fs", 2 * FS, "--unit", "m/s^2", "--window", 0.5, "--in-contact")
    code, out, err = run(*options, "--resample", FS, x=x)
    assert code == 0
    assert "resampled" in err
    assert "final: oak" in out
    _, out, err = run(*options, x=x)
    assert f"--resample {FS:g} converts" in err
    assert "unknown surface" in out


def test_a_stream_without_contact_has_exit_code_3(run):
    code, out, err = run(*LIVE, "--at-rest", x=np.zeros(4000))
    assert (code, out) == (3, "")
    assert "no answer" in err
    assert err.startswith("listening to -")


@pytest.mark.parametrize(
    ("arguments", "text", "message"),
    [
        ((), "1\n", "sampling rate is missing"),
        (LIVE, "abc\n", "line 1, 'abc', has 0 numbers"),
        (("nothing.wav", "--fs", "4000"), "", "nothing.wav"),
        ((*LIVE, "--hop", "-1"), "1\n", "hop_s"),
    ],
)
def test_invalid_input_causes_one_line_of_error(run, arguments, text, message):
    code, _, err = run(*arguments, text=text or "\n")
    assert code == 1
    err = err.removeprefix("listening to -\n")
    assert err.startswith("error: ")
    assert message in err
    assert err.count("\n") == 1


def test_control_c_ends_with_the_answer_so_far(run, monkeypatch, tmp_path, samples):
    play = sources._play

    def interrupt(*args):
        for number, block in enumerate(play(*args)):
            if number == 90:
                raise KeyboardInterrupt
            yield block

    monkeypatch.setattr(sources, "_play", interrupt)
    np.savetxt(tmp_path / "oak.txt", samples)
    code, out, err = run(tmp_path / "oak.txt", "--fs", FS, "--window", 0.5)
    assert (code, err) == (0, f"listening to {tmp_path / 'oak.txt'}\n")
    assert "final: oak" in out


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_with_the_answer_so_far_and_its_handler_is_restored(run, monkeypatch, samples, number):
    read_text = sources._read_text
    inherited = signal.signal(number, signal.SIG_DFL)  # `nohup` ignores SIGHUP

    def end(*args):
        for k, block in enumerate(read_text(*args)):
            if k == 90:
                os.kill(os.getpid(), number)
                time.sleep(5)
            yield block

    monkeypatch.setattr(sources, "_read_text", end)
    try:
        code, out, _ = run(*LIVE, "--window", 0.5, "--jsonl")
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, inherited)
    lines = [json.loads(line) for line in out.splitlines()]
    assert (code, lines[-1]["type"], lines[-1]["surface"]) == (0, "final", "oak")
    assert lines[-1]["stop_s"] < 2.3


def test_an_ignored_sighup_stays_ignored(run, monkeypatch):
    read_text = sources._read_text

    def hang_up(*args):
        for k, block in enumerate(read_text(*args)):
            if k == 10:
                os.kill(os.getpid(), signal.SIGHUP)
            yield block

    monkeypatch.setattr(sources, "_read_text", hang_up)
    inherited = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        code, out, _ = run(*LIVE, "--window", 0.5, "--jsonl")
    finally:
        signal.signal(signal.SIGHUP, inherited)
    last = json.loads(out.splitlines()[-1])
    assert (code, last["type"]) == (0, "final")
    assert last["stop_s"] > 2.3


def test_json_lines_report_the_open_source_heartbeats_and_the_age_of_answers(run, monkeypatch, samples):
    read_text = sources._read_text

    def delay(*args):
        time.sleep(0.1)  # before the first sample
        for number, block in enumerate(read_text(*args)):
            if number == 80:
                time.sleep(0.2)
            yield replace(block, age_s=0.25)

    monkeypatch.setattr(sources, "_read_text", delay)
    _, out, _ = run(*LIVE, "--window", 0.5, "--jsonl", "--heartbeat", 0.05)
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines[0] == {"type": "open", "source": "-"}
    beats = [line for line in lines if line["type"] == "heartbeat"]
    assert beats[0]["age_s"] is None
    assert beats[0]["phase"] == "waiting"
    assert max(line["age_s"] or 0 for line in beats) > 0.25
    answers = [line for line in lines if line["type"] == "answer"]
    assert all(0.25 <= line["age_s"] < 5 for line in answers)


def test_answers_are_published_on_the_stated_topics_and_domain(run, monkeypatch):
    published = []

    class Publisher:
        def __init__(self, topic, diagnostics, *, domain):
            self.names = (topic, diagnostics, domain)

        def publish(self, answer):
            published.append((*self.names, answer))

        def close(self):
            published.append("closed")

    monkeypatch.setattr(robot, "AnswerPublisher", Publisher, raising=False)
    options = ("--publish", "/surface", "--diagnostics", "/diagnostics", "--domain", 7)
    _, out, _ = run(*LIVE, "--window", 0.5, "--jsonl", *options)
    lines = [json.loads(line) for line in out.splitlines()]
    answers = [line for line in lines if line["type"] == "answer"]
    *messages, last = published
    assert last == "closed"
    assert {message[:3] for message in messages} == {("/surface", "/diagnostics", 7)}
    assert [message[3]["surface"] for message in messages] == [answer["surface"] for answer in answers]
    assert all(message[3]["age_s"] >= 0 for message in messages)


def test_answers_and_events_are_published_as_typed_messages(run, monkeypatch):
    published = []

    class Publisher:
        def __init__(self, topic, diagnostics, *, domain):
            pass

        def publish_update(self, update, time_of):
            published.append((update, time_of(update.n_received), time_of(0)))

        def close(self):
            published.append("closed")

    monkeypatch.setattr(robot, "SurfacePublisher", Publisher, raising=False)
    before_ns = time.time_ns()
    _, out, _ = run(*LIVE, "--window", 0.5, "--jsonl", "--publish", "/surface", "--typed")
    lines = [json.loads(line) for line in out.splitlines()]
    *messages, last = published
    assert last == "closed"
    answers = [message for message in messages if hasattr(message[0], "verdict")]
    assert [m[0].verdict.surface for m in answers] == [x["surface"] for x in lines if x["type"] == "answer"]
    assert len(messages) - len(answers) == len([line for line in lines if line["type"] == "event"]) > 0
    for update, time_ns, start_ns in messages:
        assert before_ns < time_ns < time.time_ns()
        assert time_ns - start_ns == pytest.approx(update.n_received / FS * 1e9, abs=1000)


def test_typed_messages_require_a_topic(run):
    code, _, errors = run(*LIVE, "--typed")
    assert code == 2
    assert "--typed requires --publish" in errors


def test_the_picture_shows_phase_level_surfaces_and_latency(linear_model, samples):
    from texclass.recognition.sources.blocks import Block

    session = Session(linear_model, settings=OnlineSettings(window_s=0.5))
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    view = TerminalView(session, "toy", console)
    with view:
        for k in range(0, 9000, 100):
            flags = ("gaps: 3 samples interpolated",) if k == 5000 else ()
            block = Block(k / FS, samples[k : k + 100, None], FS, "m/s^2", 0, flags)
            view.show(session.push(block))
        text = Console(width=100, file=io.StringIO())
        text.print(view.picture())
    assert view.contacts is None  # only stored with --json: a stream may never end
    picture = text.file.getvalue()
    for expected in ("toy", "moving", "dB over rest", "oak", "%", "ms each", "gaps: 3 samples"):
        assert expected in picture


@pytest.mark.parametrize(("value", "n"), [(-1.0, 0), (0.0, 0), (0.25, 2), (0.5, 4), (1.0, 8), (3.0, 8)])
def test_the_length_of_a_bar_is_limited(value, n):
    assert bar(value, 8) == "█" * n + "·" * (8 - n)
