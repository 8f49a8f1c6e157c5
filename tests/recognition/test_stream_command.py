"""`texclass stream`, run as a user runs it."""

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
from toy_surfaces import signal as felt

from texclass import robot
from texclass.cli.stream_view import TerminalView, bar
from texclass.recognition import OnlineSettings, Session
from texclass.recognition.sources import source_by_name as sources

LIVE = ("--fs", FS, "--unit", "m/s^2")
"""What standard input does not say."""


@pytest.fixture(scope="module")
def model_file(linear_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "toy.skops"
    linear_model.save(path)
    return path


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(7)
    x = 0.001 * rng.standard_normal(12_000)
    x[4000:10_000] += felt(SURFACES["oak"], 3, 6000)
    return x


@pytest.fixture
def run(command, monkeypatch, model_file, samples):
    """Stream samples through standard input; give exit code, output, errors."""

    def call(*arguments, x=samples, text=None):
        written = text or "\n".join(map(repr, x.tolist()))
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(written.encode()), encoding="utf-8"))
        return command("stream", model_file, *arguments)

    return call


def test_json_lines_hold_events_answers_and_the_final_answer(run):
    code, out, err = run(*LIVE, "--window", 0.5, "--jsonl")
    lines = [json.loads(line) for line in out.splitlines()]
    assert (code, err) == (0, "")
    assert [one["kind"] for one in lines if one["type"] == "event"] == ["contact"]
    answers = [one for one in lines if one["type"] == "answer"]
    assert answers[0]["start_s"] == pytest.approx(1.0, abs=0.01)
    assert answers[0]["stop_s"] - answers[0]["start_s"] == pytest.approx(0.5)
    final = lines[-1]
    assert final["type"] == "final"
    assert final["surface"] == "oak"
    assert final["probability"] == answers[-1]["probability"]


def test_the_result_of_a_stream_is_written_although_nobody_reads_its_lines(model_file, tmp_path, samples):
    np.savetxt(tmp_path / "oak.txt", np.tile(samples, 8))
    asked = [model_file, tmp_path / "oak.txt", "--fs", str(FS), "--jsonl", "--json", tmp_path / "felt.json"]
    command = [sys.executable, "-m", "texclass", "stream", *asked]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as listening:
        while b'"answer"' not in listening.stdout.readline():
            pass
        listening.stdout.close()
        said = listening.stderr.read()
    assert (listening.returncode, said) == (0, b"")
    assert json.loads((tmp_path / "felt.json").read_text())["contacts"][0]["surface"] == "oak"


def test_answers_need_no_library_that_trains(model_file, tmp_path, samples):
    np.savetxt(tmp_path / "oak.txt", samples)
    asked = [str(model_file), str(tmp_path / "oak.txt"), "--fs", str(FS), "--unit", "m/s^2"]
    heavy = ("sklearn", "pandas", "librosa", "skops", "joblib")
    code = (
        "import contextlib, sys\n"
        "from texclass.cli import main\n"
        "for command in ('predict', 'stream'):\n"
        f"    sys.argv = ['texclass', command, *{asked}]\n"
        "    with contextlib.suppress(SystemExit):\n"
        "        main()\n"
        f"sys.exit(str([m for m in {heavy} if m in sys.modules] or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.count("oak") >= 3  # the name of the file, and what both say
    assert done.stderr.strip().splitlines()[1:] == []


def test_the_result_of_a_stream_is_what_was_said_last_of_each_contact(run, tmp_path, samples):
    x = np.concatenate([samples, samples])
    np.savetxt(tmp_path / "oak.txt", x)
    asked = (tmp_path / "oak.txt", "--fs", FS, "--window", 0.5, "--json", tmp_path / "felt.json")
    assert run(*asked)[0] == 0
    contacts = json.loads((tmp_path / "felt.json").read_text())["contacts"]
    assert [contact["surface"] for contact in contacts] == ["oak", "oak"]
    assert [contact["onset_s"] for contact in contacts] == pytest.approx([1.0, 4.0], abs=0.05)
    assert run(*asked[:-1], tmp_path / "felt.out")[0] == 1
    assert not (tmp_path / "felt.out").exists()


def test_lines_say_contact_and_surface(run):
    code, out, _ = run(*LIVE, "--evidence", "majority")
    assert code == 0
    assert "contact" in out
    assert "final: oak" in out


def test_another_rate_is_resampled_when_asked(run):
    up = np.repeat(felt(SURFACES["oak"], 3, 6000), 2)  # twice the rate
    options = ("--fs", 2 * FS, "--unit", "m/s^2", "--window", 0.5, "--in-contact")
    code, out, err = run(*options, "--resample", x=up)
    assert code == 0
    assert "resampled" in err
    assert "final: oak" in out
    _, out, err = run(*options, x=up)
    assert "--resample converts" in err
    assert "unknown surface" in out


def test_nothing_felt_ends_with_its_own_exit_code(run):
    code, out, err = run(*LIVE, "--at-rest", x=np.zeros(4000))
    assert (code, out) == (3, "")
    assert "no answer" in err
    assert err.startswith("listening to -")


@pytest.mark.parametrize(
    ("arguments", "text", "message"),
    [
        ((), "1\n", "fs is missing"),
        (LIVE, "abc\n", "line 1 is 'abc'"),
        (("nothing.wav", "--fs", "4000"), "", "nothing.wav"),
        ((*LIVE, "--hop", "-1"), "1\n", "hop_s"),
    ],
)
def test_a_bad_input_ends_in_one_line(run, arguments, text, message):
    code, _, err = run(*arguments, text=text or "\n")
    assert code == 1
    err = err.removeprefix("listening to -\n")
    assert err.startswith("error: ")
    assert message in err
    assert err.count("\n") == 1


def test_control_c_ends_with_the_answer_so_far(run, monkeypatch, tmp_path, samples):
    whole = sources._played

    def interrupted(*given, **asked):
        for number, block in enumerate(whole(*given, **asked)):
            if number == 90:
                raise KeyboardInterrupt
            yield block

    monkeypatch.setattr(sources, "_played", interrupted)
    np.savetxt(tmp_path / "oak.txt", samples)
    code, out, err = run(tmp_path / "oak.txt", "--fs", FS, "--window", 0.5)
    assert (code, err) == (0, f"listening to {tmp_path / 'oak.txt'}\n")
    assert "final: oak" in out


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_with_the_answer_so_far_and_is_given_back(run, monkeypatch, samples, number):
    whole = sources._text
    inherited = signal.signal(number, signal.SIG_DFL)  # `nohup` ignores SIGHUP

    def ended(*given):
        for k, block in enumerate(whole(*given)):
            if k == 90:
                os.kill(os.getpid(), number)
                time.sleep(5)
            yield block

    monkeypatch.setattr(sources, "_text", ended)
    try:
        code, out, _ = run(*LIVE, "--window", 0.5, "--jsonl")
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, inherited)
    lines = [json.loads(line) for line in out.splitlines()]
    assert (code, lines[-1]["type"], lines[-1]["surface"]) == (0, "final", "oak")
    assert lines[-1]["stop_s"] < 2.3


def test_an_ignored_sighup_stays_ignored(run, monkeypatch):
    whole = sources._text

    def hung_up(*given):
        for k, block in enumerate(whole(*given)):
            if k == 10:
                os.kill(os.getpid(), signal.SIGHUP)
            yield block

    monkeypatch.setattr(sources, "_text", hung_up)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        code, out, _ = run(*LIVE, "--window", 0.5, "--jsonl")
    finally:
        signal.signal(signal.SIGHUP, before)
    last = json.loads(out.splitlines()[-1])
    assert (code, last["type"]) == (0, "final")
    assert last["stop_s"] > 2.3


def test_json_tells_that_it_listens_that_it_lives_and_how_old_answers_are(run, monkeypatch, samples):
    whole = sources._text

    def stuck(*given):
        time.sleep(0.1)  # before the first sample
        for number, block in enumerate(whole(*given)):
            if number == 80:
                time.sleep(0.2)
            yield replace(block, age_s=0.25)

    monkeypatch.setattr(sources, "_text", stuck)
    _, out, _ = run(*LIVE, "--window", 0.5, "--jsonl", "--heartbeat", 0.05)
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines[0] == {"type": "listening", "source": "-"}
    beats = [one for one in lines if one["type"] == "heartbeat"]
    assert beats[0]["age_s"] is None
    assert beats[0]["phase"] == "waiting"
    assert max(one["age_s"] or 0 for one in beats) > 0.25
    answers = [one for one in lines if one["type"] == "answer"]
    assert all(0.25 <= one["age_s"] < 5 for one in answers)


def test_answers_are_published_where_the_command_says(run, monkeypatch):
    published = []

    class Publisher:
        def __init__(self, topic, diagnostics, *, domain):
            self.named = (topic, diagnostics, domain)

        def publish(self, answer):
            published.append((*self.named, answer))

        def close(self):
            published.append("closed")

    monkeypatch.setattr(robot, "AnswerPublisher", Publisher, raising=False)
    options = ("--publish", "/surface", "--diagnostics", "/diagnostics", "--domain", 7)
    _, out, _ = run(*LIVE, "--window", 0.5, "--jsonl", *options)
    answers = [one for line in out.splitlines() if (one := json.loads(line))["type"] == "answer"]
    *told, last = published
    assert last == "closed"
    assert {one[:3] for one in told} == {("/surface", "/diagnostics", 7)}
    assert [one[3]["surface"] for one in told] == [one["surface"] for one in answers]
    assert all(one[3]["age_s"] >= 0 for one in told)


def test_the_picture_shows_phase_level_surfaces_and_latency(linear_model, samples):
    from texclass.recognition.sources.blocks import Block

    session = Session(linear_model, settings=OnlineSettings(window_s=0.5))
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    shown = TerminalView(session, "toy", console)
    with shown:
        for k in range(0, 9000, 100):
            flags = ("gaps: 3 samples interpolated",) if k == 5000 else ()
            block = Block(k / FS, samples[k : k + 100, None], FS, "m/s^2", 0, flags)
            shown.show(session.take(block))
        text = Console(width=100, file=io.StringIO())
        text.print(shown.picture())
    assert shown.contacts is None  # kept where a result is asked for: a stream may not end
    drawn = text.file.getvalue()
    for part in ("toy", "moving", "dB over rest", "oak", "%", "ms each", "gaps: 3 samples"):
        assert part in drawn


@pytest.mark.parametrize(("share", "n"), [(-1.0, 0), (0.0, 0), (0.25, 2), (0.5, 4), (1.0, 8), (3.0, 8)])
def test_a_bar_is_filled_to_its_share_and_never_longer(share, n):
    assert bar(share, 8) == "█" * n + "·" * (8 - n)
