"""The best candidate is found, and what it owes to luck is not counted as accuracy."""

import numpy as np
import pytest
from toy_surfaces import pipeline, recording, surfaces

from texclass.recognition import load_model, train
from texclass.recognition.candidates import accuracy_of_choice

RNG = np.random.default_rng(8)
APART = np.arange(100).astype(str)


def test_the_best_of_many_guesses_is_still_a_guess():
    hits = RNG.random((200, 100)) < 0.5
    best, accuracy = accuracy_of_choice(hits, [1.0] * 200, APART, 0)
    assert hits[best].mean() == hits.mean(axis=1).max() >= 0.6  # what the luckiest seems to be
    assert 0.45 < accuracy.mean < 0.56
    assert accuracy.interval[0] < 0.5 < accuracy.interval[1]


def test_a_candidate_that_is_really_better_is_known_to_be():
    hits = np.vstack([RNG.random((20, 100)) < 0.5, RNG.random((1, 100)) < 0.9])
    best, accuracy = accuracy_of_choice(hits, [1.0] * 21, APART, 0)
    assert best == 20
    assert accuracy.mean == pytest.approx(hits[20].mean(), abs=0.02)


def test_of_equals_the_cheapest_is_taken():
    hits = np.ones((3, 100), dtype=bool)
    best, accuracy = accuracy_of_choice(hits, [3.0, 1.0, 2.0], APART, 0)
    assert best == 1
    assert accuracy.mean == 1
    assert accuracy.interval[0] == pytest.approx(0.963, abs=0.001)  # Wilson's of 100 out of 100


def test_windows_of_one_recording_are_drawn_together():
    hits = np.repeat(RNG.random((1, 20)) < 0.7, 5, axis=1)
    _, together = accuracy_of_choice(hits, [1.0], np.repeat(np.arange(20), 5), 0)
    _, apart = accuracy_of_choice(hits, [1.0], np.arange(100), 0)
    assert np.diff(together.interval) > 1.5 * np.diff(apart.interval)


def test_of_few_runs_there_is_an_accuracy_though_some_draws_hold_them_all():
    hits = np.repeat(np.array([[1, 1, 0, 1], [1, 0, 1, 1]], dtype=bool), 5, axis=1)
    _, accuracy = accuracy_of_choice(hits, [1.0, 2.0], np.repeat(np.arange(4), 5), 0)
    assert 0 <= accuracy.interval[0] < accuracy.mean < accuracy.interval[1] <= 1


def test_two_surfaces_are_enough(tmp_path):
    for classifier in ("kernel", "lda"):
        model = train(surfaces(12, names=("cork", "oak")), pipeline(), row="Spectrum", classifier=classifier)
        model.save(tmp_path / "two.skops")
        answer = load_model(tmp_path / "two.skops").answer(recording("oak", 90))
        assert (answer.surface, answer.runner_up) == ("oak", "cork")


def test_channels_that_are_kept_apart_come_back(tmp_path):
    from dataclasses import replace

    dataset = surfaces(8)
    turned = replace(dataset, load=Turned(dataset.load), input_hash="turned")
    model = train(turned, pipeline(channels="all"), row="Spectrum", classifier="lda")
    model.save(tmp_path / "apart.skops")
    loaded = load_model(tmp_path / "apart.skops")
    assert loaded.columns[0].startswith("c1/")
    assert any(column.startswith("turn_z/") for column in loaded.columns)
    given = Turned(dataset.load)(dataset.entries[3])
    assert loaded.answer(given) == model.answer(given)
    with pytest.raises(ValueError, match=r"axes are c1\. Expected c1, turn_x"):
        loaded.answer(recording("oak", 3))


class Turned:
    """Loads recordings with a turn rate."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        made = self.load(entry)
        return made.with_(turn_rate=np.column_stack([np.roll(made.acceleration, k) for k in (1, 2, 3)]))


def test_columns_are_not_selected_for_a_kernel_unless_asked_for():
    from texclass.evaluation.pipeline import RowDefinition, Selection

    few = pipeline(rows=(RowDefinition(name="Selected", features=("mfcc",), select=Selection(n=1, folds=2)),))
    assert train(surfaces(), few).manifest.pipeline["classifier"] == "lda"
