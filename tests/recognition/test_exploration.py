"""Which gesture to make next: what it is expected to tell, what it costs, what repeating it adds."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from texclass.cli.stream_view import TerminalView
from texclass.recognition import (
    AskingSession,
    Block,
    Event,
    Exploration,
    KnownGesture,
    OnlineSettings,
    WindowAnswer,
    load_gestures,
    rehearse,
    train_gestures,
)
from texclass.recognition.exploration import information_bits
from texclass.simulate import Recipe, operator_catalogue, record_gesture

SURFACES = ("cork", "felt", "oak", "slate")
HARD = np.kron(np.eye(2), np.full((2, 2), 0.5))
"""Tells cork and felt from oak and slate."""
ROUGH = np.kron(np.full((2, 2), 0.5), np.eye(2))
"""Tells cork and oak from felt and slate."""
FEW = Recipe(n_surfaces=3, n_recordings=7, n_operators=3, duration_s=5, fs=10_000, seed=6)


def exploring(confidence=0.95, **gestures):
    made = {name: KnownGesture(*known) for name, known in gestures.items()}
    return Exploration(SURFACES, made, confidence)


def named(p):
    return dict(zip(SURFACES, p, strict=True))


@pytest.fixture(scope="module")
def models(_own_cache):
    return train_gestures(FEW, ("tap", "slow stroke", "fast stroke"))


@pytest.fixture(scope="module")
def folder(models, tmp_path_factory):
    path = tmp_path_factory.mktemp("gestures")
    for name, model in models.items():
        model.save(path / f"{name.replace(' ', '_')}.skops")
    return path


@pytest.mark.parametrize("e", [0.0, 0.11, 0.5])
def test_information_of_a_symmetric_channel_is_its_capacity(e):
    told = information_bits(np.array([0.5, 0.5]), np.array([[1 - e, e], [e, 1 - e]]))
    h = -sum(q * np.log2(q) for q in (e, 1 - e) if q)
    assert told == pytest.approx(1 - h, abs=1e-9)


def test_of_two_gestures_the_one_is_asked_for_that_parts_what_is_left():
    known = exploring(tap=(1.0, HARD, 1.0), stroke=(1.0, ROUGH, 1.0))
    assert known.expected_bits() == pytest.approx({"tap": 1.0, "stroke": 1.0})
    assert str(known.advice()) == "tap"
    known.add("tap", named([0.6, 0.4, 0.0, 0.0]))
    assert known.expected_bits() == pytest.approx({"tap": 0.0, "stroke": 0.97095}, abs=1e-4)
    assert str(known.advice()) == "stroke: cork or felt?"
    known.add("stroke", named([0.01, 0.49, 0.01, 0.49]))
    assert known.sure
    assert known.advice() is None


def test_a_gesture_that_costs_more_than_it_tells_is_not_asked_for():
    good, poor = np.eye(4), 0.7 * np.eye(4) + 0.075
    dear = exploring(slow=(3.0, good, 0.0), fast=(1.0, poor, 0.0))
    cheap = exploring(slow=(1.5, good, 0.0), fast=(1.0, poor, 0.0))
    bits = dear.expected_bits()
    assert 1.5 < bits["slow"] / bits["fast"] < 3.0
    assert (dear.advice().gesture, cheap.advice().gesture) == ("fast", "slow")


def test_repeating_tells_by_how_far_repetitions_are_independent():
    p = [0.6, 0.2, 0.15, 0.05]
    channel = 0.5 * np.eye(4) + 0.125
    for correlation, power in ((0.0, 2.0), (0.5, 4 / 3), (1.0, 1.0)):
        known = exploring(tap=(1.0, channel, correlation))
        known.add("tap", named(p))
        once = information_bits(known.probabilities, channel)
        assert known.expected_bits()["tap"] == pytest.approx((power - 1) * once)
        known.add("tap", named(p))
        assert known.probabilities == pytest.approx(np.power(p, power) / np.power(p, power).sum())
    assert known.advice() is None  # of a repetition that says the same nothing is to be learnt
    known = exploring(tap=(1.0, channel, 0.2))
    known.add("tap", named(p[::-1]))
    assert str(known.advice()) == "tap once more: slate or oak?"


def test_gestures_are_put_together_by_bayes_rule_and_a_contact_counts_once():
    known = exploring(tap=(1.0, HARD, 0.3), stroke=(1.0, ROUGH, 0.3))
    known.add("tap", named([0.4, 0.3, 0.2, 0.1]), contact=7)
    known.add("stroke", named([0.97, 0.01, 0.01, 0.01]), contact=9)
    known.add("stroke", named([0.1, 0.5, 0.2, 0.2]), contact=9)
    product = np.array([0.04, 0.15, 0.04, 0.02])
    assert known.probabilities == pytest.approx(product / product.sum())
    assert known.n_gestures == 2
    known.reset()
    assert known.probabilities == pytest.approx([0.25] * 4)


def test_training_says_what_a_gesture_confuses_and_what_it_costs(models):
    for name, model in models.items():
        gesture = KnownGesture.of(model)
        assert gesture.confusion.sum(axis=1) == pytest.approx([1.0] * 3)
        assert 0 <= gesture.correlation <= 1
        assert 0.5 < gesture.seconds < 2.5, name
    assert KnownGesture.of(models["tap"], 0.2).seconds == 0.2
    slow, fast = (KnownGesture.of(models[name]).seconds for name in ("slow stroke", "fast stroke"))
    assert slow > fast + 0.5


def test_the_confusion_matrix_is_that_of_held_out_probabilities():
    import pandas as pd

    from texclass.recognition.held_out_predictions import HeldOutPredictions
    from texclass.recognition.training import _exploration_entry

    labels = np.array([0, 0, 1, 1])
    p = np.array([[0.8, 0.2], [0.8, 0.2], [0.1, 0.9], [0.0, 1.0]])
    frame = pd.DataFrame({"surface": list("aabb"), "operator": [None] * 4, "session": [None] * 4})
    held_out = HeldOutPredictions(np.arange(4), np.log(p + 1e-9), np.zeros(4), labels)
    entry = _exploration_entry(p, held_out, frame)
    # One uniform answer is added to the two of each surface.
    assert entry["confusion"] == [[0.7, 0.3], [0.2, 0.8]]
    # One operator made both repetitions of `a`, with equal answers.
    assert entry["repetition_correlation"] > 0
    frame["operator"] = list("wxyz")
    assert _exploration_entry(p, held_out, frame)["repetition_correlation"] == 1.0


def blocks_of(pieces, surface=0, rest_s=0.7):
    """Yield what a tool feels of gestures on a surface, each after a rest in which the tool turns."""
    rng = np.random.default_rng(3)
    stranger = operator_catalogue(4, FEW.seed)[-1]
    rows = [np.zeros((1, 3))]
    for k, name in enumerate(pieces):
        made = record_gesture(name, FEW.surfaces[surface], stranger, seed=(1, k)).acceleration
        ends = rows[-1][-100:].mean(axis=0), made[:1000].mean(axis=0)
        rest = np.linspace(*ends, round(rest_s * 1e4)) + 0.02 * rng.standard_normal((round(rest_s * 1e4), 3))
        rows += [rest, made]
    samples = np.concatenate([*rows[1:], rest - rest[0] + made[-100:].mean(axis=0)])
    for k in range(0, len(samples), 500):
        yield Block(k / 1e4, samples[k : k + 500], 1e4, "m/s^2")


def stream(models, pieces):
    """Listen to gestures on a surface; return answers."""
    session = AskingSession(models, settings=OnlineSettings(confidence=0.999))
    return [u for u in session.run(blocks_of(pieces)) if isinstance(u, WindowAnswer)]


def test_a_stream_takes_a_contact_for_the_stroke_it_asked_for_and_no_tap_then(models):
    answers = stream(models, ["tap", "fast stroke"])
    first, last = answers[0].verdict, answers[-1].verdict
    assert (first.gesture, first.n_windows) == ("tap", 1)
    exploration = Exploration.of(models, confidence=0.999)
    exploration.add("tap", first.probabilities)
    assert last.gesture == exploration.best(["slow stroke", "fast stroke"])
    assert last.n_windows == 2
    assert last.surface == FEW.surfaces[0].name
    # Taps that were felt when a stroke was asked for do not count.
    assert first.advice.gesture != "tap"
    assert [a.verdict.n_windows for a in stream(models, ["tap", "tap", "tap"])] == [1]
    # The advice stands beside every answer that leaves the surface open.
    assert all((a.verdict.advice is None) == a.verdict.sure for a in answers)
    assert json.loads(json.dumps(first.to_dict()))["advice"]["gesture"] == first.advice.gesture


def test_a_contact_is_taken_for_what_was_asked_for_although_another_model_answers_first(models):
    session = AskingSession(models, seconds={"slow stroke": 0.01})
    answers = [u for u in session.run(blocks_of(["tap", "slow stroke"], 1)) if isinstance(u, WindowAnswer)]
    assert [a.verdict.gesture for a in answers][:2] == ["tap", "slow stroke"]
    assert "fast stroke" not in {a.verdict.gesture for a in answers}


def test_the_picture_says_what_to_do_next_after_the_tool_has_left_the_surface(models):
    session = AskingSession(models, settings=OnlineSettings(confidence=0.999))
    shown = TerminalView(session, "felt", Console(file=io.StringIO(), force_terminal=True, width=100))
    events = []
    with shown:
        for block in blocks_of(["tap", "fast stroke"]):
            found = session.take(block)
            events += [u.kind for u in found if isinstance(u, Event)]
            shown.show(found)
    assert events[-1] == "lift-off"
    text = Console(width=100, file=io.StringIO())
    text.print(shown.picture())
    assert f"next: {shown.answer.verdict.advice}" in text.file.getvalue()


def test_a_surface_is_unknown_if_half_of_the_gestures_are(models):
    session = AskingSession(models, settings=OnlineSettings(confidence=0.999))
    felt = next(u for u in session.run(blocks_of(["tap"])) if isinstance(u, WindowAnswer))
    strange = replace(felt, verdict=replace(felt.verdict, unknown=True))
    more = enumerate([strange, strange, felt, felt])
    said = [session._explored("tap", replace(one, onset=k)).verdict.unknown for k, one in more]
    # One of two, two of three, of four, of five: the tap that was felt counts, too.
    assert said == [True, True, True, False]


def test_after_a_surface_is_sure_the_next_contact_is_with_another(models):
    session = AskingSession(models, settings=OnlineSettings(confidence=0.5))
    answers = stream({"tap": models["tap"]}, ["tap", "tap"])
    assert [a.verdict.n_windows for a in answers] == [1, 2]
    known = session.exploration
    known.add("tap", dict.fromkeys(known.surfaces, 0.01) | {known.surfaces[0]: 0.98})
    session._taken[10] = "tap", False
    assert session._taken_for("tap", 90) == "tap"
    assert known.n_gestures == 0


def test_a_rehearsal_makes_what_is_asked_for_until_it_is_sure(models):
    surface = FEW.surfaces[1].name
    steps = list(rehearse(models, surface, recipe=FEW, confidence=0.99))
    assert steps[-1]["surface"] == surface
    assert steps[-1]["sure"]
    assert [step["advice"].gesture for step in steps[:-1]] == [step["gesture"] for step in steps[1:]]
    costs = dict.fromkeys(models, 5.0) | {"slow stroke": 0.1}
    cheap = next(rehearse(models, surface, recipe=FEW, seconds=costs))
    assert (cheap["gesture"], cheap["seconds"]) == ("slow stroke", 0.1)


def test_the_command_explores_and_the_stream_takes_the_folder(command, folder, tmp_path):
    code, out, err = command("explore", folder, "--surface", FEW.surfaces[2].name, "--jsonl")
    steps = [json.loads(line) for line in out.splitlines()]
    assert (code, err) == (0, "")
    assert steps[-1]["surface"] == steps[-1]["felt"] == FEW.surfaces[2].name
    made = record_gesture("tap", FEW.surfaces[0], FEW.operators[0], seed=1)
    np.savetxt(tmp_path / "felt.txt", made.acceleration, fmt="%.5g")
    asked = ("stream", folder, tmp_path / "felt.txt", "--fs", 10_000, "--unit", "m/s^2", "--column", "1,2,3")
    code, out, err = command(*asked, "--confidence", 0.999)
    assert err == f"listening to {asked[2]}\n"
    assert code == 0
    assert "1 gesture; next: " in out
    code, out, _ = command(*asked, "--confidence", 0.999, "--jsonl", "--gesture-time", "slow stroke=0.01")
    final = json.loads(out.splitlines()[-1])
    assert final["advice"]["text"].startswith("slow stroke: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--surface", "tin"), "to be simulated. Expected one of stone-01"),
        (("--gesture-time", "tip=1"), "seconds of 'tip'. Expected one of"),
        (("--gesture-time", "tap=-1"), "must be positive, got -1.0 s"),
        (("--confidence", "1"), "confidence 1.0. Expected"),
    ],
)
def test_bad_words_end_in_one_line(command, folder, arguments, message):
    code, _, err = command("explore", folder, *arguments)
    assert code == 1
    assert message in err
    assert err.count("\n") == 1


def test_models_that_do_not_fit_together_are_named(models, linear_model, tmp_path):
    with pytest.raises(ValueError, match=r"oak knows cork.*one set of surfaces"):
        Exploration.of(models | {"oak": linear_model})
    older = linear_model.manifest.model_copy(update={"calibration": {}})
    with pytest.raises(ValueError, match=r"has no confusion matrix"):
        KnownGesture.of(replace(linear_model, manifest=older))
    with pytest.raises(ValueError, match=r"holds no model. Expected a file GESTURE\.skops"):
        load_gestures(tmp_path)
    with pytest.raises(ValueError, match=r"gesture must be one of tap.* got 'lick'"):
        record_gesture("lick", FEW.surfaces[0], FEW.operators[0], seed=0)
    with pytest.raises(ValueError, match=r"gesture is 'lick'. Expected one of tap"):
        Exploration.of(models).add("lick", {})
