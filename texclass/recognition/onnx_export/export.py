"""A trained model in, an ONNX file out: checked against scikit-learn before it is written."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from texclass.recognition.files import write_whole
from texclass.recognition.model import Model
from texclass.recognition.onnx_export.answers import build
from texclass.recognition.onnx_export.facts import facts_of, single_precision
from texclass.recognition.onnx_export.graph import OnnxExportError
from texclass.recognition.onnx_export.parity import Parity, check_parity

NEEDED = ("onnx", "onnxruntime", "skl2onnx")


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    path
        The file.
    parity
        How it was compared with scikit-learn.
    single_precision
        Operators that compute in single precision; none of what shipped pipelines name.
    """

    path: Path
    parity: Parity
    single_precision: tuple[str, ...]


def export_onnx(model: Model, path: str | Path) -> Exported:
    """Write the part of a model that follows the features as an ONNX file: complete, or not at all.

    The graph takes float64 features (n, n_columns), and gives labels, calibrated probabilities, p-values of
    "known" and verdicts; its documentation and metadata say the rest. It computes in double precision.

    Parameters
    ----------
    model : Model
        Trained.
    path : str or Path
        File to write (.onnx).

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If a step or the classifier has no export.
    ParityError
        If the graph gives other answers than scikit-learn.
    """
    _require()
    try:
        graph = build(model)
        parity = check_parity(model, graph.SerializeToString())
    except OnnxExportError as error:
        raise type(error)(f"{path}: not written: {error}") from error
    single = single_precision(graph)
    for name, value in facts_of(model, parity, single).items():
        graph.metadata_props.add(key=name, value=value)
    graph.producer_name, graph.producer_version = "texclass", model.manifest.versions.get("texclass", "")
    write_whole(Path(path), graph.SerializeToString())
    return Exported(Path(path), parity, single)


def _require() -> None:
    for name in NEEDED:
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"exporting to ONNX needs {error.name}, which is not installed: pip install 'texclass[onnx]'",
                name=error.name,
            ) from error
