"""Trained models: answers, unknown surfaces, warnings and reproducible training."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from html import escape
from itertools import count
from zipfile import ZipFile

import numpy as np
import pytest
from toy_surfaces import FS, SURFACES, pipeline, recording, surfaces

from texclass.evaluation import cost
from texclass.recognition import average_answers, train
from texclass.recognition.model_document import model_document
from texclass.recognition.model_files import MANIFEST
from texclass.recognition.novelty import FeatureRanges
from texclass.recording import Phases

MODELS = ("kernel_model", "linear_model")


@pytest.fixture(params=MODELS)
def model(request):
    return request.getfixturevalue(request.param)


def test_trained_surfaces_are_recognised_and_others_are_unknown(model):
    answers = [model.answer(recording(surface, seed)) for surface in SURFACES for seed in range(100, 110)]
    truth = [surface for surface in SURFACES for _ in range(10)]
    assert np.mean([a.surface == t for a, t in zip(answers, truth, strict=True)]) >= 0.95
    assert np.mean([a.unknown for a in answers]) <= 0.2
    assert np.mean([model.answer(recording("stranger", seed)).unknown for seed in range(10)]) >= 0.8


def test_an_answer_is_a_distribution_over_all_surfaces(model):
    answer = model.answer(recording("oak", 77))
    assert set(answer.probabilities) == set(SURFACES)
    assert sum(answer.probabilities.values()) == pytest.approx(1)
    best, second = sorted(answer.probabilities, key=answer.probabilities.get, reverse=True)[:2]
    assert (answer.surface, answer.runner_up) == (best, second)
    assert answer.probability == answer.probabilities[best] < 1


def test_feature_values_give_the_answer_for_their_recording(model):
    stroke = recording("felt", 50)
    values = model.plan.compute(stroke).values
    assert model.answer_values(values, recording_id=stroke.recording_id) == model.answer(stroke)
    with pytest.raises(ValueError, match=r"values must have shape \(13,\), one value per column, got \(3,\)"):
        model.answer_values([1, 2, 3])


def test_a_notebook_shows_every_fact_of_the_model_card_as_escaped_text(model):
    shown = model._repr_html_()
    text = re.sub(r"<[^>]+>", "\n", shown)
    document = model_document(model)
    (facts,) = document.blocks
    assert document.title in text
    for name, fact in facts.items():
        assert f"{escape(name)}\n\n{escape(fact)}" in text
    assert shown.index("Accuracy") < shown.index("<details>") < shown.index("Held out")
    assert not re.search("color|<style|<script", shown)  # the colours of the notebook, light or dark
    manifest = model.manifest.model_copy(
        update={
            "surfaces": ("<script>alert(1)</script>", "a & b"),
            "trained_on": {**model.manifest.trained_on, "name": "<img src=x onerror=alert(1)>"},
        }
    )
    shown = replace(model, manifest=manifest)._repr_html_()
    assert "&lt;script&gt;alert(1)&lt;/script&gt;, a &amp; b" in shown
    assert "<script" not in shown
    assert "<img" not in shown


def test_only_the_features_of_the_selected_row_are_computed(model):
    assert model.manifest.features == ("mfcc",)
    assert set(model.columns) == {f"mfcc.c{i}" for i in range(1, 14)}


@pytest.mark.parametrize(
    ("change", "reason", "unknown"),
    [
        ({"fs": 2 * FS}, "wrong rate: 8000 Hz, trained at 4000 Hz; --resample 4000 converts", True),
        ({"unit": "V"}, "wrong unit: V, trained with m/s^2", True),
        (
            {"native_fs": 0.49 * FS},
            "narrow band: sampled at 1960 Hz, nothing above 980 Hz; trained up to 2000",
            True,
        ),
        (
            {"acceleration": np.random.default_rng(0).normal(size=(4000, 2)), "channels": ("y", "z")},
            "other axes: 2 axes (y, z), trained with 1 axis; --column selects",
            True,
        ),
        ({"flags": ("clipped: 3.1 % of the samples at full scale",)}, "clipped: 3.1 %", False),
        ({"phases": Phases(movement=(0, 200))}, "too short: 0.05 s of movement, trained on 0.5 s", None),
    ],
)
def test_recordings_that_differ_from_the_training_set_give_a_reason(linear_model, change, reason, unknown):
    answer = linear_model.answer(recording("oak", 3).with_(**change))
    assert any(text.startswith(reason) for text in answer.reasons), answer.reasons
    assert unknown is None or answer.unknown is unknown


def test_a_sensor_with_half_the_training_rate_is_accepted(linear_model):
    assert not linear_model.answer(recording("oak", 3).with_(native_fs=0.51 * FS)).unknown


def test_a_recording_without_any_feature_is_unknown(linear_model):
    answer = linear_model.answer(recording("oak", 3).with_(phases=Phases()))
    assert answer.unknown
    assert "no feature has a value" in answer.reasons
    assert "undefined: mfcc (no movement found)" in answer.reasons


def test_columns_far_outside_the_training_range_are_listed(linear_model):
    values = linear_model.ranges.median.copy()
    values[4] = linear_model.ranges.high[4] + 100
    reason = linear_model.answer_values(values).reasons[-1]
    assert reason.startswith(f"outside the training range: {linear_model.columns[4]} (")


def test_ranges_measure_in_widths_and_ignore_undefined_columns():
    ranges = FeatureRanges.from_features(
        np.array([[0.0, np.nan, 5.0], [2.0, np.nan, 5.0], [1.0, np.nan, 5.0]])
    )
    np.testing.assert_allclose(ranges.distance_outside(np.array([4.0, 1.0, 5.0])), [1, 0, 0])
    np.testing.assert_allclose(ranges.distance_outside(np.array([-1.0, np.nan, np.nan])), [0.5, 0, 0])
    assert ranges.distance_outside(np.array([1.0, 0.0, 5.1]))[2] > 1


def test_answers_for_windows_are_averaged(kernel_model):
    answers = [kernel_model.answer(recording("oak", seed)) for seed in (1, 2, 3)]
    whole = average_answers(answers, "oak")
    for surface in SURFACES:
        mean = np.mean([answer.probabilities[surface] for answer in answers])
        assert whole.probabilities[surface] == pytest.approx(mean)
    assert (whole.surface, whole.recording_id) == ("oak", "oak")
    odd = [replace(answers[0], p_known=p) for p in (0.5, 0.6, 0.01)]
    assert average_answers(odd, "oak").p_known == 0.5


def test_a_model_of_windows_cuts_longer_recordings(window_model):
    model = window_model
    assert model.manifest.window_s == 0.25
    assert model.manifest.accuracy["description"] == "held-out windows"
    assert model.manifest.trained_on["n_windows"] == 2 * model.manifest.trained_on["n_recordings"]
    stroke = recording("cork", 99)
    assert [window.n_samples for window in model.cut(stroke)] == [1000, 1000]
    assert model.answer_windows(stroke).surface == "cork"
    short = stroke.with_(acceleration=stroke.acceleration[:400], phases=Phases(movement=(0, 400)))
    assert any(reason.startswith("too short: 0.1 s") for reason in model.answer_windows(short).reasons)


def test_budgets_of_columns_and_latency_are_kept(kernel_model):
    limited = train(surfaces(), pipeline(), max_features=2)
    assert len(limited.columns) <= 2
    with pytest.raises(ValueError, match=r"max_ms must be at least .* got 1e-06 ms"):
        train(surfaces(), pipeline(), max_ms=1e-6)


def test_a_size_limit_reduces_the_kernel_and_is_in_the_manifest(kernel_model):
    small = train(surfaces(), pipeline(), row="Spectrum", classifier="kernel", max_kb=2)
    n_limited, n_unlimited = (len(model.classifier["dual"]) for model in (small, kernel_model))
    assert n_limited < n_unlimited
    assert small.manifest.accuracy["mean"] > 0.8
    assert small.manifest.pipeline["budget"] == "2 kB of a kernel"
    with pytest.raises(ValueError, match="max_kb = 2 has no effect: no candidate is a KernelDiscriminant"):
        train(surfaces(), pipeline(), row="Spectrum", classifier="lda", max_kb=2)
    with pytest.raises(ValueError, match=r"max_kb must be positive and finite, got 0"):
        train(surfaces(), pipeline(), max_kb=0)


def test_invalid_recordings_are_left_out_and_listed():
    model = train(surfaces(bad=("oak-3",)), pipeline(), row="Spectrum", classifier="lda", skip_bad=True)
    assert [item.recording_id for item in model.left_out] == ["oak-3"]
    assert model.manifest.trained_on["left_out"] == ["oak-3"]
    with pytest.raises(ValueError, match="oak-3: is empty"):
        train(surfaces(bad=("oak-3",)), pipeline(), row="Spectrum", classifier="lda")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"row": "Colour"}, r"no row 'Colour'. Expected one of Roughness, Spectrum"),
        ({"classifier": "svm"}, r"no classifier 'svm'. Expected one of lda, kernel"),
        ({"protocol": "paper"}, r"protocol 'paper' fits scaling and selection on the test recordings"),
        ({"protocol": "shuffled-windows"}, r"'shuffled-windows' has windows of one recording in training"),
        ({"false_alarms": 0.001}, r"requires at least 999 held-out recordings, got 40"),
        ({"false_alarms": 1.5}, r"false_alarms must be between 0 and 1, got 1.5"),
    ],
)
def test_impossible_trainings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        train(surfaces(), pipeline(), **settings)


# The same recordings give the same model: the selection does not depend on the load of the machine.


def _contents(path):
    """Return the members of a model file with their dates, and its manifest without measured costs."""
    with ZipFile(path) as archive:
        members = {m.filename: (m.date_time, archive.read(m)) for m in archive.infolist()}
    manifest = json.loads(members.pop(MANIFEST)[1])
    assert set(manifest.pop("cost")) == {"segmentation_ms", "features_ms", "classifier_ms"}
    del manifest["digest"]  # it depends on the costs
    return members, manifest


@pytest.fixture
def erratic(monkeypatch, tmp_path):
    """Simulate a load that increases (power 1) or decreases (-1) during measurements."""
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))

    def start(power):
        now, ticks = [0.0], count(1)

        def clock():
            now[0] += 1e-3 * float(next(ticks)) ** power
            return now[0]

        monkeypatch.setattr(cost, "clock", clock)

    return start


@pytest.mark.parametrize("options", [{}, {"classifier": "lda", "max_ms": 500}], ids=["free", "budget"])
def test_a_busy_machine_trains_the_same_model_file(erratic, tmp_path, options):
    """The manifest names the machine of a budget."""
    erratic(1)
    model = train(surfaces(), pipeline(), **options)
    assert model.manifest.pipeline.get("budget", "").startswith("500 ms on " if options else "")
    model.save(tmp_path / "quiet.skops")
    erratic(-1)
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        train(surfaces(), pipeline(), **options).save(tmp_path / "busy.skops")
    finally:
        busy.kill()
        busy.wait()
    assert _contents(tmp_path / "busy.skops") == _contents(tmp_path / "quiet.skops")
