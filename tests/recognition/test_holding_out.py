"""Which recordings are held out when nobody says which."""

import numpy as np
import pandas as pd
import pytest
from toy_surfaces import pipeline, recording, surfaces

from texclass.experiment.feature_table import metadata
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition import load_model, train
from texclass.recognition.holding_out import ENOUGH_REPETITIONS, holding_out
from texclass.recognition.model_document import model_document


def _table(n=ENOUGH_REPETITIONS, materials=("cork", "felt"), **facts):
    entries = [Entry(f"{m}-{r}", m, repetition=r, **facts) for m in materials for r in range(1, n + 1)]
    return metadata(entries)


def _name(table, asked=None, own="recording", false_alarms=0.05):
    return holding_out(asked, own, table, false_alarms)[0].name


def test_many_numbered_repetitions_are_held_out_in_time():
    protocol, why = holding_out(None, "recording", _table(), 0.05)
    assert protocol.name == "blocks"
    assert why == "20 numbered repetitions of each surface or more: the sensor may drift"
    assert _name(_table(operator="ann")) == "blocks"


def test_else_recordings_are_held_out_as_the_pipeline_says():
    assert _name(_table(ENOUGH_REPETITIONS - 1)) == "recording"
    one_is_rare = pd.concat([_table(), _table(6, ("oak",))], ignore_index=True)
    assert _name(one_is_rare) == "recording"
    unnumbered = _table()
    unnumbered.loc[3, "repetition"] = pd.NA
    assert _name(unnumbered) == "recording"
    several = pd.concat([_table(), _table()], ignore_index=True)  # each number twice: no order in time
    several["recording_id"] = [f"r{i}" for i in range(len(several))]
    assert _name(several) == "recording"
    by_people = _table()
    by_people["operator"] = np.where(by_people["repetition"] > 10, "ann", "ben")
    assert _name(by_people) == "recording"
    assert _name(_table(), own="run") == "run"


def test_what_is_asked_for_counts():
    protocol, why = holding_out("recording", "recording", _table(), 0.05)
    assert (protocol.name, why) == ("recording", "asked for")
    assert _name(_table(4), asked="blocks") == "blocks"


def test_half_of_the_recordings_must_do_for_the_rate_of_false_alarms():
    assert _name(_table(), false_alarms=0.048) == "blocks"  # 20 held out
    assert _name(_table(), false_alarms=0.045) == "recording"  # 22 needed: 40 held out are enough


def test_windows_count_as_their_recordings():
    windows = _table(8).loc[lambda t: t.index.repeat(5)].reset_index(drop=True)
    windows["parent"] = windows["recording_id"]
    assert _name(windows) == "recording"
    windows = _table().loc[lambda t: t.index.repeat(5)].reset_index(drop=True)
    windows["parent"] = windows["recording_id"]
    assert _name(windows) == "blocks"


class Drifting:
    """The toy surfaces, felt by a sensor whose noise grows from repetition to repetition."""

    def __init__(self, load):
        self.load = load

    def __call__(self, entry):
        found = self.load(entry)
        noise = np.random.default_rng([entry.repetition, *map(ord, entry.material)])
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
    assert (facts.accuracy["protocol"], facts.accuracy["n_tested"]) == ("blocks", 4 * ENOUGH_REPETITIONS / 2)
    assert _false_alarms(made[None], late) < _false_alarms(made["recording"], late) - 0.1
    assert np.mean([made[None].answer(recording("stranger", seed)).unknown for seed in range(10)]) >= 0.8
    made[None].save(tmp_path / "m.skops")
    (told,) = model_document(load_model(tmp_path / "m.skops")).blocks
    assert told["Held out"].startswith("protocol blocks, 1 fold (20 numbered repetitions")
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
