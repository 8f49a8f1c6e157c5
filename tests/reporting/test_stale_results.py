"""Results whose code, pipeline or feature set has changed are listed."""

import json

import numpy as np
import pytest
from example_results import result

from texclass import provenance
from texclass.cli.evaluation_commands import report
from texclass.cli.result_files import stale_results
from texclass.evaluation import load_pipeline
from texclass.evaluation.result_facts import CODE_DEPENDENCIES
from texclass.features import load_feature_set
from texclass.provenance import code_hash, code_provenance

STUDY = {"kind": "study", "version": 1}


def todays():
    pipeline, features = load_pipeline("strese2015"), load_feature_set("strese2015")
    facts = {
        "name": "strese2015",
        "hash": pipeline.hash,
        "features": "strese2015",
        "features_hash": features.hash,
    }
    return result("benchmark") | {"pipeline": facts, **code_provenance(*CODE_DEPENDENCIES)}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: None, ""),
        (lambda data: data.pop("code_hash"), "contains no hash of its code"),
        (lambda data: data.update(code_hash="0"), "its code has changed"),
        (lambda data: data["pipeline"].update(hash="0"), "pipeline strese2015 has changed"),
        (lambda data: data["pipeline"].update(features_hash="0"), "feature set strese2015 has changed"),
        (lambda data: data["pipeline"].update(name="mine"), "pipeline mine does not exist"),
    ],
)
def test_results_of_other_code_pipelines_or_features_are_listed_with_the_reason(tmp_path, change, why):
    data, path = todays(), tmp_path / "r.json"
    change(data)
    path.write_text(json.dumps(data))
    assert stale_results([path]) == ({path: why} if why else {}, {})


def test_each_kind_of_result_names_its_pipeline_and_features_in_its_own_way(tmp_path):
    path, pipeline = tmp_path / "r.json", todays()["pipeline"]
    added = {"name": "strese2015+crest", "hash": f"{pipeline['hash']}+c0de"}  # and the feature `crest`
    by_name = {"pipeline": "strese2015", "pipeline_hash": pipeline["hash"]}
    features = {"features": "strese2015", "features_hash": pipeline["features_hash"]}
    for kind, named, changed, why in (
        ("feature", {"pipeline": pipeline | added}, {"pipeline": pipeline | added | {"hash": "0+c0de"}},
         "pipeline strese2015 has changed"),
        ("baselines", by_name, {"pipeline_hash": "0"}, "pipeline strese2015 has changed"),
        ("tradeoff", features, {"features_hash": "0"}, "feature set strese2015 has changed"),
    ):  # fmt: skip
        for facts, reason in (({}, None), (changed, why)):
            path.write_text(json.dumps(result(kind) | named | code_provenance(*CODE_DEPENDENCIES) | facts))
            assert stale_results([path])[0].get(path) == reason


def test_studies_name_the_code_that_made_them_and_are_listed_too(tmp_path):
    path = tmp_path / "study.json"
    for facts, why in (
        (code_provenance("haptics", "signals"), None),
        (code_provenance("haptics") | {"code_of": ["signals"]}, "its code has changed"),
        (code_provenance("haptics") | {"code_of": ["gone"]}, "its code has changed"),
        ({}, "contains no hash of its code"),
    ):
        path.write_text(json.dumps({**STUDY, "pipeline": ["multiscale"], "ratio": np.nan, **facts}))
        assert stale_results([path])[0].get(path) == why
    path.write_text(json.dumps({**STUDY, "code_hash": "0", "code_of": ["/"]}))
    stale, skipped = stale_results([path])
    assert not stale
    assert "code_of" in skipped[path]


def test_files_that_are_no_results_are_skipped_and_listed(tmp_path, capsys):
    stale, other = tmp_path / "stale.json", tmp_path / "other.json"
    stale.write_text(json.dumps(todays() | {"code_hash": "0"}))
    other.write_text(json.dumps({"title": "mine"}))
    (tmp_path / "page.md").write_text("# Page")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\xff")
    files = [other, tmp_path / "page.md", tmp_path / "picture.png", tmp_path, stale]
    found, skipped = stale_results(files)
    assert found == {stale: "its code has changed"}
    assert list(skipped) == files[:4]
    assert "kind" in skipped[other]
    report(files, stale=True)
    said = capsys.readouterr().out
    assert f"skipped {other}: " in said
    assert "1 of 1 results are out of date" in said
    with pytest.raises(FileNotFoundError):
        stale_results([tmp_path / "gone.json"])


def test_words_of_code_are_no_code(tmp_path):
    for name, source in (("a", '"""One."""\nx = 1  # why\n'), ("b", '"""Two."""\nx = 1\n'), ("c", "x = 2\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.py").write_text(source)
    same, words, other = (code_hash(files=[tmp_path / n / "m.py"], words=False) for n in "abc")
    assert same == words != other
    assert code_hash(files=[tmp_path / "a" / "m.py"]) != code_hash(files=[tmp_path / "b" / "m.py"])


def test_a_table_in_a_room_is_part_of_its_code(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "_PACKAGE", tmp_path)
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "m.py").write_text("x = 1\n")
    seen = {code_hash("room", words=False)}
    for table in ("a,1\n", "a,2\n"):
        (tmp_path / "room" / "known.csv").write_text(table)
        seen.add(code_hash("room", words=False))
    assert len(seen) == 3
