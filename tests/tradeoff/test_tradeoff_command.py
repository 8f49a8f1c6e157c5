"""Tests of the command `texclass tradeoff`."""

import json

import numpy as np
import pytest
from toy_noises import write_plates

from texclass.loaders import open_dataset
from texclass.tradeoff.recogniser import load_recogniser

FEATURE_SET = """
name = "few"
reference = "a test"
[features.variance]
[features.spikiness]
[features.mean_magnitude]
"""


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """Three surfaces that differ in level, six recordings of 0.6 s at 2 kHz each."""
    folder = tmp_path_factory.mktemp("work")
    write_plates(folder / "plates", 2000, louder=3)
    (folder / "few.toml").write_text(FEATURE_SET)
    return folder


@pytest.fixture
def tradeoff(command, plates, monkeypatch):
    """Run the command in the folder of the recordings; return exit code, standard output, standard error."""
    monkeypatch.chdir(plates)
    monkeypatch.setenv("TEXCLASS_CACHE", str(plates / "cache"))
    common = ("--unit", "arbitrary", "--features", "few.toml", "--no-curves", "--jobs", "1")

    def call(*options, dataset="plates"):
        return command("tradeoff", dataset, *common, *options)

    return call


def test_without_limits_the_recogniser_at_the_knee_point_is_saved(tradeoff, plates):
    code, out, err = tradeoff("--output", "knee")
    assert (code, err) == (0, "")
    written = json.loads((plates / "knee" / "plates-tradeoff.json").read_text())
    assert written["selection"]["reason"].startswith("knee")
    assert written["dataset"]["n_surfaces"] == 3
    recogniser = load_recogniser(plates / "knee" / "plates-tradeoff.skops")
    assert list(recogniser[0].plan_.columns) == written["selection"]["columns"]
    recordings = open_dataset("plates", unit="arbitrary")
    truth = [entry.surface for entry in recordings.entries]
    assert np.mean(recogniser.predict(list(recordings)) == truth) > 0.9
    for suffix in ("json", "md", "skops"):
        assert f"wrote knee/plates-tradeoff.{suffix}" in out


def test_every_limit_is_respected_and_appears_in_the_files(tradeoff, plates):
    code, out, err = tradeoff(
        "--max-ms", 1000, "--max-seconds", 0.25, "--max-features", 2, "--surfaces", "cork, oak",
        "--protocol", "recording", "--backend", "local", "--output", "here", "--json", "there/x.json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    stem = "plates-2-surfaces-0.25s-tradeoff"
    assert {f"{stem}.json", f"{stem}.md", f"{stem}.skops"} <= {f.name for f in (plates / "here").iterdir()}
    written = json.loads((plates / "there" / "x.json").read_text())
    assert written == json.loads((plates / "here" / f"{stem}.json").read_text())
    assert written["dataset"]["surfaces"] == ["cork", "oak"]
    assert written["dataset"]["max_seconds"] == 0.25
    assert written["dataset"]["n_recordings"] == 12
    assert len(written["smallest_subsets"]) == 2
    assert 1 <= len(written["selection"]["columns"]) <= 2
    assert written["selection"]["predicted_ms"] <= 1000
    assert written["curves"] == []
    assert f"wrote here/{stem}.md" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--max-ms", 0), "max_ms must be positive and finite, got 0.0"),
        (("--max-ms", "nan"), "max_ms must be positive and finite, got nan"),
        (("--max-ms", 1e-9), "max_ms must be at least"),
        (("--max-features", 0), "max_features must be positive and finite, got 0"),
        (("--max-seconds", -1), "seconds must be positive and finite, got -1.0"),
        (("--max-seconds", 9), "no recording can be used"),
        (("--surfaces", "cork,silk"), "no surface 'silk'. Expected at least two of cork, felt, oak"),
        (("--surfaces", "cork"), "must contain at least two surfaces"),
        (("--protocol", "operator"), "operator"),
        (("--features", "none.toml"), "none.toml"),
    ],
)
def test_invalid_input_gives_one_line_with_value_and_expectation(tradeoff, options, message):
    code, out, err = tradeoff(*options, "--output", "bad")
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err
