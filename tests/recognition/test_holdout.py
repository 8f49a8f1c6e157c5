"""Default protocols by which recordings are held out."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from toy_surfaces import pipeline, recording, surfaces

from texclass.evaluation.feature_table import metadata
from texclass.evaluation.protocols import find_protocol
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import load_model, train
from texclass.recognition.holdout import LIMITS, Holdout, select_protocol
from texclass.recognition.model_document import model_document


def _table(n=LIMITS.min_repetitions, surfaces=("cork", "felt"), **labels):
    entries = [Entry(f"{m}-{r}", m, repetition=r, **labels) for m in surfaces for r in range(1, n + 1)]
    return metadata(entries)


def _unnumbered(table):
    return table.assign(repetition=table["repetition"].where(table.index != 3, pd.NA))


def _windows(n):
    """Return five windows of each recording."""
    table = _table(n).loc[lambda t: t.index.repeat(5)].reset_index(drop=True)
    return table.assign(parent=table["recording_id"])


def _twice(table):
    """Return each repetition twice, so that there is no order in time."""
    both = pd.concat([table, table], ignore_index=True)
    return both.assign(recording_id=[f"r{i}" for i in range(len(both))])


ENOUGH = _table()


@pytest.mark.parametrize(
    ("table", "requested", "default", "false_alarms", "name"),
    [
        # Many numbered repetitions have a chronological split.
        (ENOUGH, None, "recording", 0.05, "chronological"),
        (_table(operator="ann"), None, "recording", 0.05, "chronological"),
        # Otherwise the protocol of the pipeline is used.
        (_table(LIMITS.min_repetitions - 1), None, "recording", 0.05, "recording"),
        (pd.concat([ENOUGH, _table(6, ("oak",))], ignore_index=True), None, "recording", 0.05, "recording"),
        (_unnumbered(ENOUGH), None, "recording", 0.05, "recording"),
        (_twice(ENOUGH), None, "recording", 0.05, "recording"),
        (
            ENOUGH.assign(operator=np.where(ENOUGH["repetition"] > 10, "ann", "ben")),
            *(None, "recording", 0.05, "recording"),
        ),
        (ENOUGH, None, "grouped", 0.05, "grouped"),
        # A requested protocol is used.
        (ENOUGH, "recording", "recording", 0.05, "recording"),
        (_table(4), "chronological", "recording", 0.05, "chronological"),
        # Half of the recordings (20) must support the rate of false alarms: 0.045 needs 22.
        (ENOUGH, None, "recording", 0.048, "chronological"),
        (ENOUGH, None, "recording", 0.045, "recording"),
        # Recordings are counted, not windows.
        (_windows(8), None, "recording", 0.05, "recording"),
        (_windows(LIMITS.min_repetitions), None, "recording", 0.05, "chronological"),
    ],
)
def test_many_numbered_repetitions_are_split_chronologically(table, requested, default, false_alarms, name):
    assert select_protocol(requested, default, table, false_alarms)[0].name == name


def test_the_reason_for_the_protocol_is_returned():
    drift = "at least 20 numbered repetitions per surface: the sensor may drift"
    for requested, reason in (("recording", "requested"), (None, drift)):
        assert select_protocol(requested, "recording", ENOUGH, 0.05)[1] == reason


class Drifting:
    """Toy surfaces recorded by a sensor whose noise increases with each repetition."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        recording = self.load(entry)
        rng = np.random.default_rng([entry.repetition, *map(ord, entry.surface)])
        noise = 0.04 * entry.repetition * rng.standard_normal(recording.n_samples)
        return recording.with_(acceleration=recording.acceleration + noise)


@pytest.fixture(scope="module")
def drifting():
    toy = surfaces(2 * LIMITS.min_repetitions)
    early = tuple(entry for entry in toy.entries if entry.repetition <= LIMITS.min_repetitions)
    late = tuple(entry for entry in toy.entries if entry.repetition > LIMITS.min_repetitions)
    load = Drifting(toy.load)
    return Dataset("early", early, load, "drift-early"), Dataset("late", late, load, "drift-late")


def _false_alarms(model, dataset):
    return np.mean([model.answer(recording).unknown for recording in dataset])


def _two_operators(dataset):
    """Return a dataset whose repetitions alternate between operators, so that they have no order in time."""
    entries = (replace(entry, operator="ab"[entry.repetition % 2]) for entry in dataset.entries)
    return replace(dataset, entries=tuple(entries), input_hash="operators")


@pytest.mark.parametrize("classifier", ["kernel", "lda"])
def test_an_order_in_time_gives_fewer_false_alarms_if_a_sensor_drifts(drifting, tmp_path, classifier):
    early, late = drifting
    options = {"row": "Spectrum", "classifier": classifier}
    models = {
        protocol: train(early, pipeline(), **options, protocol=protocol) for protocol in (None, "recording")
    }
    unordered = train(_two_operators(early), pipeline(), **options)
    accuracy = models[None].manifest.accuracy
    assert (accuracy["protocol"], accuracy["n_tested"]) == ("chronological", 4 * LIMITS.min_repetitions / 2)
    assert unordered.manifest.accuracy["protocol"] == "recording"
    for model in models.values():  # the halves are compared whatever the protocol
        assert _false_alarms(model, late) < _false_alarms(unordered, late) - 0.1
    assert np.mean([models[None].answer(recording("stranger", seed)).unknown for seed in range(10)]) >= 0.8
    models[None].save(tmp_path / "m.skops")
    (card,) = model_document(load_model(tmp_path / "m.skops")).blocks
    assert card["Held out"].startswith("protocol chronological, 1 fold (at least 20 numbered repetitions")
    assert ("drift multiplies the distances" in card["Held out"]) == (classifier == "lda")
    assert "best of" not in card["Pipeline"]  # there is one candidate


def test_without_drift_distances_are_those_of_random_folds():
    toy = surfaces(LIMITS.min_repetitions)
    default = train(toy, pipeline(), row="Spectrum", classifier="lda")
    requested = train(toy, pipeline(), row="Spectrum", classifier="lda", protocol="recording")
    assert default.manifest.unknown["n"] == 4 * LIMITS.min_repetitions
    assert 1 <= default.manifest.unknown["drift_factor"] < 1.3
    np.testing.assert_allclose(
        default.novelty.held_out / default.manifest.unknown["drift_factor"],
        requested.novelty.held_out / requested.manifest.unknown["drift_factor"],
    )
    assert default.calibration != requested.calibration


def test_the_halves_are_trained_on_the_earlier_and_on_the_later_recordings():
    table = _windows(5)

    def halves(protocol, table=table):
        return Holdout(table, find_protocol(protocol), "requested", True, 0).halves

    (((early, late),), ((later, earlier),)) = halves("recording")
    assert set(table["repetition"].iloc[early]) == {1, 2}
    assert set(table["repetition"].iloc[late]) == {3, 4, 5}
    assert set(table["repetition"].iloc[later]) == {4, 5}
    assert set(table["repetition"].iloc[earlier]) == {1, 2, 3}
    assert len(halves("chronological")) == 1  # the protocol is the other split
    assert halves("recording", _unnumbered(table)) == ()
    assert halves("operator", table.assign(operator=np.where(table["repetition"] > 2, "b", "a"))) == ()


def test_many_numbered_recordings_give_the_expected_range_of_later_ones(drifting):
    early, late = drifting
    model = train(early, pipeline(), row="Spectrum", classifier="kernel")
    later = model.manifest.accuracy["later_recordings"]
    assert later["source"] == "halves"
    hits = [model.answer(recording).surface == recording.surface for recording in late]
    assert later["low"] <= np.mean(hits) <= later["high"]
    (card,) = model_document(model).blocks
    assert card["Accuracy"].endswith("% (between the earlier and the later half)")
