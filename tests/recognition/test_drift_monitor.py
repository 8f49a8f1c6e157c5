"""Drift in a stream of contacts: notices, and slow adaptation of the model."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter
from toy_surfaces import FS, SURFACES, recording, signal

from texclass.recognition import Block, Notice, OnlineSettings, Session, WindowAnswer
from texclass.recognition.answers import ContactVerdict
from texclass.recognition.live.drift_monitor import DriftMonitor, DriftMonitorSettings

RESONANCE = [1, -2 * 0.97 * np.cos(0.3), 0.97**2]
"""Mount of the sensor after the drift, at 191 Hz."""
FAST = OnlineSettings(window_s=0.25)
NAMES = sorted(SURFACES)


def stream(surfaces, changes=True):
    """Return contacts of 1 s with rests of 1.5 s, and the surface of each contact."""
    rng = np.random.default_rng(5)
    parts = []
    for k, surface in enumerate(surfaces):
        x = signal(SURFACES[surface], [9, k], 4000)
        x = 0.1 * lfilter([1], RESONANCE, x) if changes else x
        parts += [np.zeros(6000), x]
    x = np.concatenate([*parts, np.zeros(6000)])
    return x + 0.001 * rng.standard_normal(len(x))


def run(model, x, **options):
    session = Session(model, settings=FAST, **options)
    blocks = [Block(k / FS, x[k : k + 100, None], FS, "m/s^2") for k in range(0, len(x), 100)]
    updates = list(session.run(blocks))
    notices = [update.message for update in updates if isinstance(update, Notice)]
    answers = [update for update in updates if isinstance(update, WindowAnswer)]
    return session, answers, [message for message in notices if message.startswith("drift:")]


def hits(answers, surfaces, last):
    """Return the share of correct final answers of the last contacts."""
    final = {answer.onset: answer.verdict for answer in answers}
    verdicts = [final[onset] for onset in sorted(final)]
    pairs = list(zip(verdicts, surfaces, strict=True))[-last:]
    return np.mean([verdict.surface == surface and not verdict.unknown for verdict, surface in pairs])


MANY = NAMES * 5


def test_drift_is_reported_once_in_a_stream(window_model):
    model, answers, notices = run(window_model, stream(MANY))
    assert model.model is window_model
    assert len(notices) == 1
    assert "have shifted as a whole" in notices[0]
    assert notices[0].endswith("Adapt the model with --adapt")
    assert hits(answers, MANY, 8) < 0.8


def test_a_stream_without_drift_causes_no_notice(window_model):
    assert run(window_model, stream(MANY, changes=False))[2] == []


def test_the_model_of_a_stream_follows_the_drift(window_model):
    session, answers, notices = run(window_model, stream(MANY), adapt=True)
    assert notices[0].startswith("drift: adapted to the last 10 contacts: ")
    assert "standard deviations within a surface" in notices[0]
    assert hits(answers, MANY, 8) > 0.9
    assert session.model is session.recogniser.model
    assert len(session.model.manifest.adapted["references"]) == len(MANY)
    sets = session.recogniser.evidence.set_calibrations
    assert sets.keys() == session.model.contact_calibrations.keys()


def test_the_model_of_a_stream_does_not_follow_one_surface(window_model):
    session, _, notices = run(window_model, stream(["oak"] * 24), adapt=True)
    assert (session.model is window_model, notices) == (True, [])
    assert run(window_model, stream(["oak"] * 24))[2] == []


def test_windows_of_another_length_are_not_tested(window_model):
    x = stream(MANY)
    session = Session(window_model, settings=OnlineSettings(window_s=0.5), adapt=True)
    updates = list(session.run([Block(0.0, x[:, None], FS, "m/s^2")]))
    (notice,) = [u.message for u in updates if isinstance(u, Notice) and "adapted" in u.message]
    assert notice.startswith("not adapted: windows of 0.5 s, trained on 0.25 s. Train with")
    assert session.model is window_model


def window_answer(model, surface, seed, onset):
    answer = model.answer(recording(surface, seed))
    verdict = ContactVerdict(surface, 0.9, "", unknown=False, sure=True, n_windows=1, contact_s=1.0)
    return WindowAnswer(0, 1000, 1000, answer, verdict, onset, 0.0)


@pytest.mark.parametrize("is_always_in_contact", [False, True])
def test_contacts_are_counted_once(kernel_model, is_always_in_contact):
    """A contact ends with a lift-off or, for wheels, when the predicted surface changes."""
    monitor = DriftMonitor(
        kernel_model,
        adapts=True,
        is_always_in_contact=is_always_in_contact,
        settings=DriftMonitorSettings(n_contacts=12, n_between=10, n_windows=2),
    )
    for k in range(20):
        for seed in range(3):
            monitor.add(window_answer(kernel_model, NAMES[k % 4], 10 * k + seed, 100 * k))
        if not is_always_in_contact:
            monitor.end_contact()
    monitor.end_contact(is_last=True)
    assert len(monitor.model.manifest.adapted["references"]) == 12
    assert [len(answer.rows) for answer in monitor._contacts] == [2] * 12


def test_the_stream_command_adapts(command, window_model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    window_model.save("windows.skops")
    np.savetxt("stream.csv", stream(MANY), fmt="%.6f")
    arguments = ("stream", "windows.skops", "stream.csv", "--jsonl", "--heartbeat", "0", "--window", "0.25")
    for adapt, text in ((("--adapt",), "drift: adapted to the last"), ((), "have shifted as a whole")):
        code, out, _ = command(*arguments, *adapt)
        assert code == 0
        lines = [json.loads(line) for line in out.splitlines()]
        messages = [line["message"] for line in lines if line["type"] == "notice"]
        assert any(text in message for message in messages)
    (tmp_path / "gestures").mkdir()
    window_model.save("gestures/tap.skops")
    code, _, err = command("stream", "gestures", "stream.csv", "--adapt")
    assert (code, "--adapt requires a model file" in err) == (2, True)
