"""Which recordings are held out when nobody says which."""

import numpy as np
import pandas as pd
import pytest
from toy_surfaces import pipeline, recording, surfaces

from texclass.evaluation.feature_table import metadata
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import load_model, train
from texclass.recognition.holding_out import ENOUGH_REPETITIONS, holding_out
from texclass.recognition.model_document import model_document


def _table(n=ENOUGH_REPETITIONS, surfaces=("cork", "felt"), **facts):
    entries = [Entry(f"{m}-{r}", m, repetition=r, **facts) for m in surfaces for r in range(1, n + 1)]
    return metadata(entries)


def _unnumbered(table):
    return table.assign(repetition=table["repetition"].where(table.index != 3, pd.NA))


def _windows(n):
    """Return five windows of each recording."""
    table = _table(n).loc[lambda t: t.index.repeat(5)].reset_index(drop=True)
    return table.assign(parent=table["recording_id"])


def _twice(table):
    """Return each number twice: no order in time."""
    both = pd.concat([table, table], ignore_index=True)
    return both.assign(recording_id=[f"r{i}" for i in range(len(both))])


ENOUGH = _table()


@pytest.mark.parametrize(
    ("table", "asked", "own", "false_alarms", "name"),
    [
        # Many numbered repetitions are held out in time.
        (ENOUGH, None, "recording", 0.05, "chronological"),
        (_table(operator="ann"), None, "recording", 0.05, "chronological"),
        # Else recordings are held out as the pipeline says.
        (_table(ENOUGH_REPETITIONS - 1), None, "recording", 0.05, "recording"),
        (pd.concat([ENOUGH, _table(6, ("oak",))], ignore_index=True), None, "recording", 0.05, "recording"),
        (_unnumbered(ENOUGH), None, "recording", 0.05, "recording"),
        (_twice(ENOUGH), None, "recording", 0.05, "recording"),
        (
            ENOUGH.assign(operator=np.where(ENOUGH["repetition"] > 10, "ann", "ben")),
            *(None, "recording", 0.05, "recording"),
        ),
        (ENOUGH, None, "grouped", 0.05, "grouped"),
        # What is asked for counts.
        (ENOUGH, "recording", "recording", 0.05, "recording"),
        (_table(4), "chronological", "recording", 0.05, "chronological"),
        # Half of the recordings, 20, must do for the rate of false alarms: 0.045 takes 22.
        (ENOUGH, None, "recording", 0.048, "chronological"),
        (ENOUGH, None, "recording", 0.045, "recording"),
        # Windows count as their recordings.
        (_windows(8), None, "recording", 0.05, "recording"),
        (_windows(ENOUGH_REPETITIONS), None, "recording", 0.05, "chronological"),
    ],
)
def test_recordings_are_held_out_in_time_where_that_can_be_told(table, asked, own, false_alarms, name):
    assert holding_out(asked, own, table, false_alarms)[0].name == name


def test_why_recordings_are_held_out_so_is_said():
    drift = "20 numbered repetitions of each surface or more: the sensor may drift"
    for asked, why in (("recording", "asked for"), (None, drift)):
        assert holding_out(asked, "recording", ENOUGH, 0.05)[1] == why


class Drifting:
    """The toy surfaces, felt by a sensor whose noise grows from repetition to repetition."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        found = self.load(entry)
        noise = np.random.default_rng([entry.repetition, *map(ord, entry.surface)])
        worn = 0.04 * entry.repetition * noise.standard_normal(found.n_samples)
        return found.with_(acceleration=found.acceleration + worn)


@pytest.fixture(scope="module")
def drifting():
    toy = surfaces(2 * ENOUGH_REPETITIONS)
    early = tuple(entry for entry in toy.entries if entry.repetition <= ENOUGH_REPETITIONS)
    late = tuple(entry for entry in toy.entries if entry.repetition > ENOUGH_REPETITIONS)
    load = Drifting(toy.load)
    return Dataset("early", early, load, "drift-early"), Dataset("late", late, load, "drift-late")


def _false_alarms(model, dataset):
    return np.mean([model.answer(recording).unknown for recording in dataset])


@pytest.mark.parametrize("classifier", ["kernel", "lda"])
def test_blocks_raise_fewer_false_alarms_when_a_sensor_drifts(drifting, tmp_path, classifier):
    early, late = drifting
    made = {
        protocol: train(early, pipeline(), row="Spectrum", classifier=classifier, protocol=protocol)
        for protocol in (None, "recording")
    }
    facts = made[None].manifest
    assert (facts.accuracy["protocol"], facts.accuracy["n_tested"]) == (
        "chronological",
        4 * ENOUGH_REPETITIONS / 2,
    )
    assert _false_alarms(made[None], late) < _false_alarms(made["recording"], late) - 0.1
    assert np.mean([made[None].answer(recording("stranger", seed)).unknown for seed in range(10)]) >= 0.8
    made[None].save(tmp_path / "m.skops")
    (told,) = model_document(load_model(tmp_path / "m.skops")).blocks
    assert told["Held out"].startswith("protocol chronological, 1 fold (20 numbered repetitions")
    assert ("drift makes distances" in told["Held out"]) == (classifier == "lda")
    assert "best of" not in told["Pipeline"]  # one candidate was asked for


def test_without_drift_distances_are_those_of_folds_at_random():
    toy = surfaces(ENOUGH_REPETITIONS)
    default = train(toy, pipeline(), row="Spectrum", classifier="lda")
    asked = train(toy, pipeline(), row="Spectrum", classifier="lda", protocol="recording")
    assert default.manifest.unknown["n"] == 4 * ENOUGH_REPETITIONS
    assert 1 <= default.manifest.unknown["stretch"] < 1.3
    np.testing.assert_allclose(
        default.novelty.held_out, default.manifest.unknown["stretch"] * asked.novelty.held_out
    )
    assert default.calibration != asked.calibration
