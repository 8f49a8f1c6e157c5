"""Active exploration: expected information gain, duration and correlation of gestures."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from texclass.cli.stream_view import TerminalView
from texclass.recognition import (
    Block,
    Event,
    Exploration,
    ExplorationSession,
    GestureStatistics,
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
"""Confusion matrix that separates cork and felt from oak and slate."""
ROUGH = np.kron(np.full((2, 2), 0.5), np.eye(2))
"""Confusion matrix that separates cork and oak from felt and slate."""
RECIPE = Recipe(n_surfaces=3, n_recordings=7, n_operators=3, duration_s=5, fs=10_000, seed=3)


def create_exploration(confidence=0.95, **gestures):
    statistics = {name: GestureStatistics(*values) for name, values in gestures.items()}
    return Exploration(SURFACES, statistics, confidence)


def by_surface(p):
    return dict(zip(SURFACES, p, strict=True))


@pytest.fixture(scope="module")
def models(_own_cache):
    return train_gestures(RECIPE, ("tap", "slow stroke", "fast stroke"))


@pytest.fixture(scope="module")
def folder(models, tmp_path_factory):
    path = tmp_path_factory.mktemp("gestures")
    for name, model in models.items():
        model.save(path / f"{name.replace(' ', '_')}.skops")
    return path


@pytest.mark.parametrize("e", [0.0, 0.11, 0.5])
def test_information_of_a_symmetric_channel_is_its_capacity(e):
    bits = information_bits(np.array([0.5, 0.5]), np.array([[1 - e, e], [e, 1 - e]]))
    h = -sum(q * np.log2(q) for q in (e, 1 - e) if q)
    assert bits == pytest.approx(1 - h, abs=1e-9)


def test_the_recommended_gesture_separates_the_remaining_surfaces():
    exploration = create_exploration(tap=(1.0, HARD, 1.0), stroke=(1.0, ROUGH, 1.0))
    assert exploration.expected_bits() == pytest.approx({"tap": 1.0, "stroke": 1.0})
    assert str(exploration.advice()) == "tap"
    exploration.add("tap", by_surface([0.6, 0.4, 0.0, 0.0]))
    assert exploration.expected_bits() == pytest.approx({"tap": 0.0, "stroke": 0.97095}, abs=1e-4)
    assert str(exploration.advice()) == "stroke: cork or felt?"
    exploration.add("stroke", by_surface([0.01, 0.49, 0.01, 0.49]))
    assert exploration.sure
    assert exploration.advice() is None


def test_the_recommended_gesture_has_the_highest_gain_per_second():
    good, poor = np.eye(4), 0.7 * np.eye(4) + 0.075
    long = create_exploration(slow=(3.0, good, 0.0), fast=(1.0, poor, 0.0))
    short = create_exploration(slow=(1.5, good, 0.0), fast=(1.0, poor, 0.0))
    bits = long.expected_bits()
    assert 1.5 < bits["slow"] / bits["fast"] < 3.0
    assert (long.advice().gesture, short.advice().gesture) == ("fast", "slow")


def test_the_gain_of_a_repetition_depends_on_its_correlation():
    p = [0.6, 0.2, 0.15, 0.05]
    channel = 0.5 * np.eye(4) + 0.125
    for correlation, power in ((0.0, 2.0), (0.5, 4 / 3), (1.0, 1.0)):
        exploration = create_exploration(tap=(1.0, channel, correlation))
        exploration.add("tap", by_surface(p))
        once = information_bits(exploration.probabilities, channel)
        assert exploration.expected_bits()["tap"] == pytest.approx((power - 1) * once)
        exploration.add("tap", by_surface(p))
        assert exploration.probabilities == pytest.approx(np.power(p, power) / np.power(p, power).sum())
    assert exploration.advice() is None  # a repetition with correlation 1 adds no information
    exploration = create_exploration(tap=(1.0, channel, 0.2))
    exploration.add("tap", by_surface(p[::-1]))
    assert str(exploration.advice()) == "tap once more: slate or oak?"


def test_gestures_are_combined_by_bayes_rule_and_a_contact_counts_once():
    exploration = create_exploration(tap=(1.0, HARD, 0.3), stroke=(1.0, ROUGH, 0.3))
    exploration.add("tap", by_surface([0.4, 0.3, 0.2, 0.1]), contact=7)
    exploration.add("stroke", by_surface([0.97, 0.01, 0.01, 0.01]), contact=9)
    exploration.add("stroke", by_surface([0.1, 0.5, 0.2, 0.2]), contact=9)
    product = np.array([0.04, 0.15, 0.04, 0.02])
    assert exploration.probabilities == pytest.approx(product / product.sum())
    assert exploration.n_gestures == 2
    exploration.reset()
    assert exploration.probabilities == pytest.approx([0.25] * 4)


def test_training_measures_confusion_correlation_and_duration_of_a_gesture(models):
    for name, model in models.items():
        gesture = GestureStatistics.from_model(model)
        assert gesture.confusion.sum(axis=1) == pytest.approx([1.0] * 3)
        assert 0 <= gesture.correlation <= 1
        assert 0.5 < gesture.seconds < 2.5, name
    assert GestureStatistics.from_model(models["tap"], 0.2).seconds == 0.2
    slow, fast = (GestureStatistics.from_model(models[n]).seconds for n in ("slow stroke", "fast stroke"))
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


def simulate_blocks(gestures, surface=0, rest_s=0.7):
    """Yield a stream of gestures on a surface, each after a rest in which the tool turns."""
    rng = np.random.default_rng(3)
    new_operator = operator_catalogue(4, RECIPE.seed)[-1]
    rows = [np.zeros((1, 3))]
    for k, name in enumerate(gestures):
        x = record_gesture(name, RECIPE.surfaces[surface], new_operator, seed=(1, k)).acceleration
        ends = rows[-1][-100:].mean(axis=0), x[:1000].mean(axis=0)
        rest = np.linspace(*ends, round(rest_s * 1e4)) + 0.02 * rng.standard_normal((round(rest_s * 1e4), 3))
        rows += [rest, x]
    samples = np.concatenate([*rows[1:], rest - rest[0] + x[-100:].mean(axis=0)])
    for k in range(0, len(samples), 500):
        yield Block(k / 1e4, samples[k : k + 500], 1e4, "m/s^2")


def explore(models, gestures):
    """Return the answers for a stream of gestures."""
    session = ExplorationSession(models, settings=OnlineSettings(confidence=0.999))
    return [u for u in session.run(simulate_blocks(gestures)) if isinstance(u, WindowAnswer)]


def test_a_lasting_contact_counts_as_the_recommended_stroke_and_later_taps_are_ignored(models):
    answers = explore(models, ["tap", "fast stroke"])
    first, last = answers[0].verdict, answers[-1].verdict
    assert (first.gesture, first.n_windows) == ("tap", 1)
    exploration = Exploration.from_models(models, confidence=0.999)
    exploration.add("tap", first.probabilities)
    assert last.gesture == exploration.best_gesture(["slow stroke", "fast stroke"])
    assert last.n_windows == 2
    assert last.surface == RECIPE.surfaces[0].name
    # Taps do not count while a stroke is recommended.
    assert first.advice.gesture != "tap"
    assert [a.verdict.n_windows for a in explore(models, ["tap", "tap", "tap"])] == [1]
    # Every answer has an advice until the surface is sure.
    assert all((a.verdict.advice is None) == a.verdict.sure for a in answers)
    assert json.loads(json.dumps(first.to_dict()))["advice"]["gesture"] == first.advice.gesture


def test_a_contact_counts_as_the_recommended_gesture_if_another_model_answers_first(models):
    session = ExplorationSession(models, seconds={"slow stroke": 0.01})
    blocks = simulate_blocks(["tap", "slow stroke"], surface=1)
    gestures = [u.verdict.gesture for u in session.run(blocks) if isinstance(u, WindowAnswer)]
    assert gestures[:2] == ["tap", "slow stroke"]
    assert "fast stroke" not in gestures


def test_the_picture_shows_the_next_gesture_after_a_lift_off(models):
    session = ExplorationSession(models, settings=OnlineSettings(confidence=0.999))
    view = TerminalView(session, "stream", Console(file=io.StringIO(), force_terminal=True, width=100))
    events = []
    with view:
        for block in simulate_blocks(["tap", "fast stroke"]):
            updates = session.push(block)
            events += [u.kind for u in updates if isinstance(u, Event)]
            view.show(updates)
    assert events[-1] == "lift-off"
    text = Console(width=100, file=io.StringIO())
    text.print(view.picture())
    assert f"next: {view.answer.verdict.advice}" in text.file.getvalue()


def test_a_surface_is_unknown_if_it_is_unknown_to_half_of_the_gestures(models):
    session = ExplorationSession(models, settings=OnlineSettings(confidence=0.999))
    tap = next(u for u in session.run(simulate_blocks(["tap"])) if isinstance(u, WindowAnswer))
    unknown = replace(tap, verdict=replace(tap.verdict, unknown=True))
    answers = enumerate([unknown, unknown, tap, tap])
    verdicts = [session._add_answer("tap", replace(answer, onset=k)).verdict for k, answer in answers]
    # One of two, two of three, of four, of five gestures, including the tap of the stream.
    assert [verdict.unknown for verdict in verdicts] == [True, True, True, False]


def test_a_contact_after_a_sure_surface_starts_a_new_exploration(models):
    session = ExplorationSession(models, settings=OnlineSettings(confidence=0.5))
    answers = explore({"tap": models["tap"]}, ["tap", "tap"])
    assert [a.verdict.n_windows for a in answers] == [1, 2]
    exploration = session.exploration
    exploration.add("tap", dict.fromkeys(exploration.surfaces, 0.01) | {exploration.surfaces[0]: 0.98})
    session._contacts[10] = "tap", False
    assert session._gesture_of("tap", 90) == "tap"
    assert exploration.n_gestures == 0


def test_a_rehearsal_makes_the_recommended_gestures_until_the_surface_is_sure(models):
    surface = RECIPE.surfaces[1].name
    steps = list(rehearse(models, surface, recipe=RECIPE, confidence=0.99))
    assert steps[-1]["surface"] == surface
    assert steps[-1]["sure"]
    assert [step["advice"].gesture for step in steps[:-1]] == [step["gesture"] for step in steps[1:]]
    seconds = dict.fromkeys(models, 5.0) | {"slow stroke": 0.1}
    step = next(rehearse(models, surface, recipe=RECIPE, seconds=seconds))
    assert (step["gesture"], step["seconds"]) == ("slow stroke", 0.1)


def test_explore_and_stream_accept_a_folder_of_models(command, folder, tmp_path):
    code, out, err = command("explore", folder, "--surface", RECIPE.surfaces[2].name, "--jsonl")
    steps = [json.loads(line) for line in out.splitlines()]
    assert (code, err) == (0, "")
    assert steps[-1]["surface"] == steps[-1]["true_surface"] == RECIPE.surfaces[2].name
    tap = record_gesture("tap", RECIPE.surfaces[0], RECIPE.operators[0], seed=1)
    file = tmp_path / "tap.txt"
    np.savetxt(file, tap.acceleration, fmt="%.5g")
    arguments = ("stream", folder, file, "--fs", 10_000, "--unit", "m/s^2", "--column", "1,2,3")
    code, out, err = command(*arguments, "--confidence", 0.999)
    assert err == f"listening to {file}\n"
    assert code == 0
    assert "1 gesture; next: " in out
    code, out, _ = command(*arguments, "--confidence", 0.999, "--jsonl", "--gesture-time", "slow stroke=0.01")
    final = json.loads(out.splitlines()[-1])
    assert final["advice"]["text"].startswith("slow stroke: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--surface", "tin"), "cannot simulate the surface 'tin'. Expected one of stone-01"),
        (("--gesture-time", "tip=1"), "unknown gestures: tip. Expected some of"),
        (("--gesture-time", "tap=-1"), "must be positive, got -1.0 s"),
        (("--confidence", "1"), "confidence must be between 0 and 1, got 1.0"),
    ],
)
def test_invalid_options_cause_one_line_of_error(command, folder, arguments, message):
    code, _, err = command("explore", folder, *arguments)
    assert code == 1
    assert message in err
    assert err.count("\n") == 1


def test_invalid_models_and_gestures_raise_an_error_with_their_names(models, linear_model, tmp_path):
    with pytest.raises(ValueError, match=r"must have the same surfaces.* and cork, .* for oak"):
        Exploration.from_models(models | {"oak": linear_model})
    without_confusion = linear_model.manifest.model_copy(update={"calibration": {}})
    with pytest.raises(ValueError, match=r"has no confusion matrix"):
        GestureStatistics.from_model(replace(linear_model, manifest=without_confusion))
    with pytest.raises(ValueError, match=r"contains no models. Expected one file GESTURE\.skops"):
        load_gestures(tmp_path)
    with pytest.raises(ValueError, match=r"gesture must be one of tap.* got 'lick'"):
        record_gesture("lick", RECIPE.surfaces[0], RECIPE.operators[0], seed=0)
    with pytest.raises(ValueError, match=r"gesture must be one of tap.* got 'lick'"):
        Exploration.from_models(models).add("lick", {})
