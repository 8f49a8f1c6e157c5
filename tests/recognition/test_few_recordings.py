"""With few recordings nothing is chosen by chance, margins are wider, and what cannot be told is said."""

from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import pipeline, surfaces

from texclass.experiment.feature_table import metadata
from texclass.experiment.protocols import find_protocol, splits_of
from texclass.loaders import open_dataset
from texclass.recognition import train
from texclass.recognition.model_document import model_document
from texclass.recognition.training import FEW, untold
from texclass.recognition.unknown import Novelty, cautious


@pytest.fixture(scope="module")
def few():
    return train(surfaces(FEW - 2), pipeline())


def test_nothing_is_chosen_below_ten_recordings_of_a_surface(few):
    assert (few.manifest.accuracy["n_candidates"], len(few.columns)) == (1, 13)
    assert few.manifest.pipeline["classifier"] == "kernel"  # weighs columns itself
    (told,) = model_document(few).blocks
    assert told["Pipeline"].endswith("8 recordings of a surface: too few to choose by, margins are wider")
    assert train(surfaces(FEW), pipeline()).manifest.accuracy["n_candidates"] == 4


def test_what_is_named_is_trained_from_few_recordings_too():
    model = train(surfaces(FEW - 2), pipeline(), row="Roughness", classifier="lda")
    assert (model.manifest.pipeline["row"], model.manifest.pipeline["classifier"]) == ("Roughness", "lda")
    assert train(surfaces(FEW - 2), pipeline(), classifier="lda").manifest.accuracy["n_candidates"] == 2


def test_a_promise_says_that_later_recordings_and_other_sessions_cannot_be_told(few):
    (told,) = model_document(few).blocks
    assert told["Accuracy"].endswith("; later ones: cannot be told")
    assert told["Unknown surfaces"].endswith("from 32 held out; so few that strangers often pass")
    assert told["Cannot be told"].startswith(
        "later recordings (8 of each surface, held out at random; from 20"
    )
    assert "another session or operator" in told["Cannot be told"]


def test_what_is_held_out_decides_what_can_be_told():
    table = metadata(surfaces(4).entries)

    def told_not(protocol, **facts):
        labelled = table.assign(**facts)
        return [
            fact.split("(")[0].strip()
            for fact in untold(splits_of(find_protocol(protocol), labelled, 0), labelled)
        ]

    late = np.where(table["repetition"] > 2, "b", "a")
    assert told_not("recording") == ["later recordings", "another session or operator"]
    assert told_not("blocks") == ["another session or operator"]
    assert told_not("repetition=1,2 -> repetition=4") == ["another session or operator"]
    assert told_not("operator", operator=late) == ["later recordings", "another session"]
    assert told_not("run", session=table["recording_id"]) == ["later recordings", "another operator"]
    assert told_not("leave-out session", session=late) == ["later recordings", "another operator"]


@pytest.mark.parametrize(("n", "rate"), [(60, 0.05), (150, 0.05), (60, 0.1)])
def test_few_held_out_recordings_keep_the_rate_of_false_alarms_in_95_of_100_trainings(n, rate):
    """A recording that comes is above a threshold t with probability 1 - t: scores are uniform."""
    held_out = np.sort(np.random.default_rng(0).random((4000, n)), axis=1)
    plain, wide = (
        np.array([1 - Novelty("decision", scores, level).threshold for scores in held_out])
        for level in (rate, cautious(rate, n))
    )
    assert 0.93 < (wide <= rate).mean() <= 1
    assert (plain <= rate).mean() < 0.7  # in the mean over trainings only
    assert plain.mean() <= rate


def test_the_widest_margin_is_the_strangest_recording_held_out():
    assert cautious(0.05, 58) == 1 / 59 < cautious(0.05, 5000) < 0.05
    scores = np.arange(30.0)
    assert Novelty("decision", scores, cautious(0.05, 30)).threshold == 29


def test_the_kernel_learns_from_three_real_recordings_of_each_surface(data_root):
    """Sixty recordings of 180 columns: most eigenvalues are equal, and LAPACK's default driver failed."""
    felt = open_dataset("biotac20")
    three = replace(felt, entries=tuple(e for e in felt.entries if 11 <= e.repetition <= 13))
    model = train(three, "multiscale", row="Spectrum", classifier="kernel")
    assert model.manifest.accuracy["mean"] > 0.9
    assert model.manifest.accuracy["untold"][0].startswith("later recordings (3 of each surface")
