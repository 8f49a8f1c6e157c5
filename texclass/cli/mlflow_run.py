"""Log the result of a command as a run of MLflow (option --mlflow), which is not a dependency."""

import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from texclass.reporting.result_files import Result

PARAMETERS = (
    "protocol", "n_folds", "seed", "movement", "channels", "axes", "signals", "time_limit_s",
    "nested_cv_skipped",
)  # fmt: skip
"""Settings of a result that are logged as parameters, besides dataset, pipeline and feature set."""
TAGS = ("input_hash", "code_hash", "pipeline_hash")
"""Hashes of a result that are logged as tags."""


def require_mlflow(is_requested: bool) -> bool:
    """Return the argument, or raise an error if MLflow is requested and not installed.

    Raises
    ------
    ImportError
        If MLflow is not installed.
    """
    if is_requested and find_spec("mlflow") is None:
        raise ImportError("--mlflow requires the package mlflow. Install it with: pip install mlflow")
    return is_requested


def log_run(result: "Result", files: Iterable[Path]) -> str:
    """Log a result as a run of MLflow, and return a sentence that names the run.

    The environment selects the server (MLFLOW_TRACKING_URI) and the experiment (MLFLOW_EXPERIMENT_NAME).

    Parameters
    ----------
    result : Result
        Result of a benchmark or of a comparison with baselines.
    files : iterable of Path
        Files that are logged as artifacts, besides the report page.

    Raises
    ------
    ValueError
        If MLflow cannot log the run.
    """
    import mlflow

    from texclass.reporting import render_page

    document = result.document()
    page_text = render_page([document], document.title, written_by="texclass")
    try:
        with mlflow.start_run(run_name=result.stem) as run, tempfile.TemporaryDirectory() as folder:
            mlflow.log_params(parameters(result.data))
            mlflow.log_metrics(dict(metrics(result.data)))
            mlflow.set_tags(tags(result))
            page = Path(folder) / "report.html"
            page.write_text(page_text, encoding="utf-8")
            for path in (page, *files):
                mlflow.log_artifact(str(path))
    except mlflow.MlflowException as error:
        raise ValueError(
            f"the result is written, but MLflow cannot log it to {mlflow.get_tracking_uri()}: {error}"
        ) from error
    return f"logged run {run.info.run_id} ({result.stem}) to {mlflow.get_tracking_uri()}"


def parameters(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a result by name."""
    pipeline = data["pipeline"]
    names = {"pipeline": pipeline}
    if isinstance(pipeline, Mapping):
        names = {"pipeline": pipeline["name"], "features": pipeline["features"]}
    settings = {key: data[key] for key in PARAMETERS if data.get(key) not in (None, "")}
    return {"dataset": data["dataset"]["name"], **names, **settings}


def tags(result: "Result") -> dict[str, str]:
    """Return kind, hashes and versions of a result by name."""
    data = result.data
    hashes = {key: data.get(key) for key in TAGS}
    if isinstance(data["pipeline"], Mapping):
        hashes["pipeline_hash"] = data["pipeline"]["hash"]
        hashes["features_hash"] = data["pipeline"].get("features_hash")
    versions = {**data["versions"], **data.get("baseline_versions", {})}
    return {
        "kind": result.kind,
        **{name: value for name, value in hashes.items() if value},
        **{f"version.{name}": version for name, version in versions.items()},
    }


def metrics(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, float]]:
    """Yield name and value of each accuracy in a result, with the limits of its interval (fractions).

    The name consists of the keys and of the names of rows and tools, such as `rows/Hardness/lda/mean`.

    Examples
    --------
    >>> accuracy = {"mean": 0.9, "low": 0.8, "high": 0.95, "n_clusters": 20}
    >>> dict(metrics({"rows": [{"name": "Hardness", "accuracy": {"lda": accuracy}}]}))
    {'rows/Hardness/lda/mean': 0.9, 'rows/Hardness/lda/low': 0.8, 'rows/Hardness/lda/high': 0.95}
    """
    limits = ("mean", "low", "high")
    if isinstance(value, Mapping) and set(limits) <= set(value):
        name = re.sub(r"[^\w ./-]", "_", "/".join(path))
        yield from ((f"{name}/{key}", float(value[key])) for key in limits)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from metrics(item, path if key == "accuracy" else (*path, key))
    elif isinstance(value, list):
        for item in value:
            if isinstance(item, Mapping) and "name" in item:
                parts = [str(item["name"]), *([item["classifier"]] if item.get("classifier") else [])]
                yield from metrics(item, (*path, *(part.replace("/", "-") for part in parts)))
