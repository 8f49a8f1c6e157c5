"""What a reader sees of a new feature."""

import json

import pytest
from rich.console import Console

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.new_feature import FeatureStudy, Kin, Redundancy
from texclass.experiment.paired import Paired
from texclass.experiment.result import BenchmarkResult, Gains, GroupGain, RowResult, RowSum
from texclass.features.contract import Feature, Gain
from texclass.features.examination import Behaviour, GainLaw
from texclass.reporting.feature_report import (
    facts,
    feature_card,
    feature_markdown,
    law_of,
    write_feature_report,
)


def loud(view):
    """Deviation of the movement."""


BROKEN = GainLaw(Gain(), 0.99, Gain(power=1), 1e-12, 3)


def a_study(law=BROKEN):
    paired = Paired(0.05, (0.03, 0.07), 0.001, "t-test", ((0.05, 0.0),), 3, 1)
    group = GroupGain("loud", 1, RowSum(4, 0.95, 2.5), paired, 0.001)
    gains = Gains("All", "lda", "the best", False, RowSum(3, 0.9, 1.5), 5, 10, (group,))
    rows = (
        RowResult("All", 3, {"lda": Accuracy(9, 10)}),
        RowResult("New: loud", 1, {"lda": Accuracy(4, 10)}),
    )
    result = BenchmarkResult(
        dataset={"name": "toy", "n_recordings": 10, "n_materials": 2}, pipeline="p+loud", pipeline_hash="ff",
        feature_set="f", n_folds=10, classifiers=("lda",), protocol="recording", protocol_description="folds",
        rows=rows, confusion=None, versions={"texclass": "9.9"}, seed=7, input_hash="abc", gains=gains,
    )  # fmt: skip
    behaviour = (
        Behaviour("silence", "reason", "silence: all 9 samples are 0", True),
        Behaviour("one NaN", "no reason", "nan", False),
    )
    feature = Feature("loud", loud, "movement", "g", "mine")
    kin = (Redundancy("loud", (Kin("variance", -0.98),), 0.75),)
    return FeatureStudy(feature, result, 0.5, law, behaviour, kin)


def card(study):
    console = Console(width=150)
    with console.capture() as capture:
        console.print(feature_card(study))
    return capture.get()


@pytest.mark.parametrize("text_of", [card, feature_markdown])
@pytest.mark.parametrize(
    "text",
    ["Deviation of the movement", "LDA 40.0", "All 90.0 % -> 95.0 %, +5.0 [+3.0, +7.0] points, p 0.001",
     "0.5 ms per recording alone; 1 ms more beside the best row", "BROKEN by 0.99; measured y(g x) = g y",
     "variance -0.98", "R^2 = 0.75", "1 of 2 answered as the contract asks; not: one NaN", "no reason"],
)  # fmt: skip
def test_card_and_markdown_say(text_of, text):
    assert text in text_of(a_study())


@pytest.mark.parametrize(
    ("law", "told"),
    [
        (None, "not measured"),
        (
            GainLaw(Gain(power=2), 1e-15, Gain(power=2), 1e-15, 3),
            "declared y(g x) = g^2 y; measured the same",
        ),
        (GainLaw(Gain(), 0.5, Gain(), 0.5, 3), "measured another, of no power and no shift"),
    ],
)
def test_a_gain_law_is_told_in_a_line(law, told):
    assert told in dict(facts(a_study(law)))["Gain law"]


def test_laws_are_written_as_equations():
    assert law_of(Gain(shift=-20)) == "y(g x) = y - 20 log10 g"
    assert law_of(Gain(power=0.5, shift=1)) == "y(g x) = g^0.5 y + 1 log10 g"


def test_the_report_of_the_feature_lies_beside_that_of_the_table(tmp_path):
    names = [path.name for path in write_feature_report(a_study(), tmp_path)]
    assert names[0] == "toy-p+loud-recording.json"
    assert names[-2:] == ["toy-p+loud-recording-feature.json", "toy-p+loud-recording-feature.md"]
    assert json.loads((tmp_path / names[-2]).read_text())["new_feature"]["name"] == "loud"
