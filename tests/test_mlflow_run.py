"""The option --mlflow, with a stand-in for MLflow that records what is logged."""

import contextlib
import sys
import types
from pathlib import Path

import pytest
from toy_noises import TINY

from texclass.cli.mlflow_run import log_run, metrics, parameters, require_mlflow, tags
from texclass.evaluation import BenchmarkResult
from texclass.reporting.result_files import read_result

SMALL = Path(__file__).parent / "reporting" / "data" / "benchmark.json"
PIPELINE = """
features = "strese2015"
seed = 1
[classifiers.euclidean]
use = "sklearn.neighbors.NearestCentroid"
[[rows]]
name = "Level / variance"
features = ["variance"]
"""


@pytest.fixture
def logged(monkeypatch):
    """Replace MLflow by a module that records what is logged."""
    records = {"params": {}, "metrics": {}, "tags": {}, "artifacts": {}, "runs": []}
    module = types.ModuleType("mlflow")
    module.__spec__ = types.SimpleNamespace(name="mlflow")

    @contextlib.contextmanager
    def start_run(run_name):
        records["runs"].append(run_name)
        yield types.SimpleNamespace(info=types.SimpleNamespace(run_id="4711"))

    def log_artifact(path):
        records["artifacts"][Path(path).name] = Path(path).read_bytes()

    module.MlflowException = RuntimeError
    module.start_run, module.log_artifact = start_run, log_artifact
    module.log_params, module.log_metrics = records["params"].update, records["metrics"].update
    module.set_tags, module.get_tracking_uri = records["tags"].update, lambda: "file:runs"
    monkeypatch.setitem(sys.modules, "mlflow", module)
    return records


def test_benchmark_logs_parameters_accuracies_hashes_and_report(logged, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    (tmp_path / "few.toml").write_text(PIPELINE)
    options = ("--pipeline", "few.toml", "--folds", "2", "--jobs", "1", "-o", "out", "--mlflow")
    code, out, err = command("benchmark", "tiny.toml", *options)
    assert code == 0, err
    assert "logged run 4711 (tiny-few-recording) to file:runs" in out
    (file,) = (tmp_path / "out").glob("*.json")
    data = read_result(file).data
    assert logged["runs"] == ["tiny-few-recording"]
    assert logged["params"]["pipeline"] == "few"
    assert (logged["params"]["n_folds"], logged["params"]["protocol"]) == (2, "recording")
    accuracy = data["nested_cv"]["accuracy"]
    for key in ("mean", "low", "high"):
        assert logged["metrics"][f"nested_cv/{key}"] == accuracy[key]
        assert logged["metrics"][f"rows/Level - variance/euclidean/{key}"] == accuracy[key]
    assert logged["tags"]["input_hash"] == data["input_hash"]
    assert logged["tags"]["code_hash"] == data["code_hash"]
    assert logged["tags"]["version.numpy"] == data["versions"]["numpy"]
    assert logged["artifacts"]["report.html"].lstrip().startswith(b"<!")
    assert logged["artifacts"][file.name] == file.read_bytes()


def test_without_mlflow_the_command_stops_at_once_with_the_package_to_install(command, monkeypatch):
    monkeypatch.setitem(sys.modules, "mlflow", None)
    monkeypatch.setattr("texclass.cli.mlflow_run.find_spec", lambda name: None)
    with pytest.raises(ImportError, match="pip install mlflow"):
        require_mlflow(True)
    code, out, err = command("benchmark", "absent", "--mlflow")
    assert (code, out) == (1, "")
    assert err == "error: --mlflow requires the package mlflow. Install it with: pip install mlflow\n"


def test_an_error_of_mlflow_is_reported_after_the_result_is_written(logged, monkeypatch):
    def refuse(params):
        raise RuntimeError("no server")

    monkeypatch.setattr(sys.modules["mlflow"], "log_params", refuse)
    with pytest.raises(ValueError, match="the result is written, but MLflow cannot log it to file:runs: no"):
        log_run(BenchmarkResult(read_result(SMALL).data), [])


def test_names_contain_only_characters_that_mlflow_accepts():
    result = BenchmarkResult(read_result(SMALL).data)
    names = dict(metrics(result.data))
    assert names["rows/All/lda/mean"] == 0.9
    assert not [name for name in names if set("<>()\"'=,") & set(name)]
    assert parameters(result.data)["dataset"] == "toy"
    assert tags(result)["kind"] == "benchmark"
