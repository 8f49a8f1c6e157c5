"""Results whose code, pipeline or features have changed are listed."""

import json

import pytest
from told import result

from texclass.experiment import load_pipeline
from texclass.experiment.result import COMPUTED_BY
from texclass.features import load_feature_set
from texclass.provenance import code_hash
from texclass.reporting import stale_results


def todays():
    pipeline, features = load_pipeline("strese2015"), load_feature_set("strese2015")
    facts = {
        "name": "strese2015",
        "hash": pipeline.hash,
        "features": "strese2015",
        "features_hash": features.hash,
    }
    return result("benchmark") | {"pipeline": facts, "code_hash": code_hash(*COMPUTED_BY, words=False)}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: None, ""),
        (lambda data: data.pop("code_hash"), "made before results carried a hash of their code"),
        (lambda data: data.update(code_hash="0"), "made by other code"),
        (lambda data: data["pipeline"].update(hash="0"), "pipeline strese2015 has changed"),
        (lambda data: data["pipeline"].update(features_hash="0"), "feature set strese2015 has changed"),
        (lambda data: data["pipeline"].update(name="mine"), "pipeline mine is not here"),
    ],
)
def test_results_of_other_code_pipelines_or_features_are_listed_with_the_reason(tmp_path, change, why):
    data, path = todays(), tmp_path / "r.json"
    change(data)
    path.write_text(json.dumps(data))
    assert stale_results([path]) == ({path: why} if why else {})


def test_words_of_code_are_no_code(tmp_path):
    for name, source in (("a", '"""One."""\nx = 1  # why\n'), ("b", '"""Two."""\nx = 1\n'), ("c", "x = 2\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.py").write_text(source)
    same, words, other = (code_hash(files=[tmp_path / n / "m.py"], words=False) for n in "abc")
    assert same == words != other
    assert code_hash(files=[tmp_path / "a" / "m.py"]) != code_hash(files=[tmp_path / "b" / "m.py"])
