"""Selection of the best candidate, with an accuracy that is corrected for the selection."""

import numpy as np
import pytest
from toy_surfaces import pipeline, recording, surfaces

from texclass.recognition import load_model, train
from texclass.recognition.candidates import select_best

RNG = np.random.default_rng(8)
CLUSTERS = np.arange(100).astype(str)


def test_the_corrected_accuracy_of_the_best_of_many_guesses_is_that_of_guessing():
    hits = RNG.random((200, 100)) < 0.5
    best, accuracy = select_best(hits, [1.0] * 200, CLUSTERS, 0)
    assert hits[best].mean() == hits.mean(axis=1).max() >= 0.6  # optimistic
    assert 0.45 < accuracy.mean < 0.56
    assert accuracy.interval[0] < 0.5 < accuracy.interval[1]


def test_a_better_candidate_is_selected_and_keeps_its_accuracy():
    hits = np.vstack([RNG.random((20, 100)) < 0.5, RNG.random((1, 100)) < 0.9])
    best, accuracy = select_best(hits, [1.0] * 21, CLUSTERS, 0)
    assert best == 20
    assert accuracy.mean == pytest.approx(hits[20].mean(), abs=0.02)


def test_of_equal_candidates_the_one_with_fewest_columns_is_selected():
    hits = np.ones((3, 100), dtype=bool)
    best, accuracy = select_best(hits, [3.0, 1.0, 2.0], CLUSTERS, 0)
    assert best == 1
    assert accuracy.mean == 1
    assert accuracy.interval[0] == pytest.approx(0.963, abs=0.001)  # Wilson interval of 100 hits in 100


def test_windows_of_one_recording_are_drawn_together():
    hits = np.repeat(RNG.random((1, 20)) < 0.7, 5, axis=1)
    _, clustered = select_best(hits, [1.0], np.repeat(np.arange(20), 5), 0)
    _, independent = select_best(hits, [1.0], np.arange(100), 0)
    assert np.diff(clustered.interval) > 1.5 * np.diff(independent.interval)


def test_few_groups_give_an_accuracy_although_some_draws_contain_all_of_them():
    hits = np.repeat(np.array([[1, 1, 0, 1], [1, 0, 1, 1]], dtype=bool), 5, axis=1)
    _, accuracy = select_best(hits, [1.0, 2.0], np.repeat(np.arange(4), 5), 0)
    assert 0 <= accuracy.interval[0] < accuracy.mean < accuracy.interval[1] <= 1


def test_two_surfaces_are_enough(tmp_path):
    for classifier in ("kernel", "lda"):
        model = train(surfaces(12, names=("cork", "oak")), pipeline(), row="Spectrum", classifier=classifier)
        model.save(tmp_path / "two.skops")
        answer = load_model(tmp_path / "two.skops").answer(recording("oak", 90))
        assert (answer.surface, answer.runner_up) == ("oak", "cork")


def test_separate_channels_are_saved_and_loaded(tmp_path):
    from dataclasses import replace

    dataset = surfaces(8)
    turned = replace(dataset, load=Turned(dataset.load), input_hash="turned")
    model = train(turned, pipeline(channels="all"), row="Spectrum", classifier="lda")
    model.save(tmp_path / "apart.skops")
    loaded = load_model(tmp_path / "apart.skops")
    assert loaded.columns[0].startswith("c1/")
    assert any(column.startswith("turn_z/") for column in loaded.columns)
    turned_recording = Turned(dataset.load)(dataset.entries[3])
    assert loaded.answer(turned_recording) == model.answer(turned_recording)
    with pytest.raises(ValueError, match=r"has the axes c1\. Expected c1, turn_x"):
        loaded.answer(recording("oak", 3))


class Turned:
    """Load recordings with a turn rate."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        recording = self.load(entry)
        axes = [np.roll(recording.acceleration, k) for k in (1, 2, 3)]
        return recording.with_(turn_rate=np.column_stack(axes))


def test_columns_are_selected_for_lda_but_not_for_a_kernel_by_default():
    from texclass.evaluation.pipeline import RowDefinition, Selection

    few = pipeline(rows=(RowDefinition(name="Selected", features=("mfcc",), select=Selection(n=1, folds=2)),))
    assert train(surfaces(), few).manifest.pipeline["classifier"] == "lda"
