"""texclass benchmark --baselines, with a fake interpreter."""

import json

import pytest

PIPELINE = """
name = "small"
features = "strese2015"
seed = 1
[protocol]
folds = 4
[classifiers.lda]
use = "sklearn.discriminant_analysis.LinearDiscriminantAnalysis"
[[rows]]
name = "Cepstrum"
features = ["mfcc_constant"]
"""


@pytest.fixture
def run(command, monkeypatch, tmp_path, noises):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(PIPELINE)

    def call(*options):
        facts = ("--fs", "1000", "--unit", "m/s^2", "--pipeline", "small.toml")
        return command("benchmark", noises, *facts, *options)

    return call


@pytest.mark.usefixtures("ours_here")
def test_baselines_are_run_printed_and_reported(run, interpreter, tmp_path):
    code, out, err = run(
        "--jobs", "1", "--output", "here", "--baselines", "--baseline", "quant", "--baseline", "minirocket",
        "--baselines-python", interpreter("perfect"),
    )  # fmt: skip
    assert code == 0, err
    assert "minus the best baseline (QUANT" in " ".join(out.split())
    assert "MiniRocket" in out
    comparison = json.loads(next((tmp_path / "here").glob("*-baselines.json")).read_text())
    assert [c["name"] for c in comparison["contestants"]] == ["Cepstrum", "quant", "minirocket"]
    assert comparison["contestants"][1]["accuracy"]["mean"] == 1.0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--baselines", "--baseline", "weka"), "weka"),
        (("--baselines", "--baselines-limit", "3"), "limit must be at least"),
    ],
)
def test_bad_options_end_with_one_line(run, options, told):
    code, _, err = run(*options)
    assert code == 1
    assert err.startswith("error: ")
    assert told in err
