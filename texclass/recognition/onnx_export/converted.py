"""Steps and classifiers of scikit-learn as skl2onnx converts them, in double precision."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from texclass.recognition.onnx_export.graph import OPSETS, Graph, OnnxExportError

INPUT = "rows"


def converted_step(step: Any, graph: Graph, rows: str) -> str:
    """Add a fitted transformer and return its output.

    Raises
    ------
    OnnxExportError
        If skl2onnx does not know it.
    """
    return graph.embed(_convert(step, ({},)), rows)


def converted_decision(classifier: Any, graph: Graph, rows: str) -> str:
    """Add a fitted classifier and return its `decision_function`, (n, n_classes) or the last column of two.

    Raises
    ------
    OnnxExportError
        If skl2onnx does not know it, or only its probabilities.
    """
    decision = {"raw_scores": True}
    return graph.embed(_convert(classifier, ({"zipmap": False, **decision}, decision)), rows)


def converted_probabilities(classifier: Any, graph: Graph, rows: str) -> str:
    """Add a fitted classifier and return its `predict_proba`, (n, n_classes).

    Raises
    ------
    OnnxExportError
        If skl2onnx does not know it.
    """
    return graph.embed(_convert(classifier, ({"zipmap": False},)), rows)


def class_name(part: Any) -> str:
    """Return module and class of an object, as a message names it."""
    return f"{type(part).__module__}.{type(part).__qualname__}"


def _convert(part: Any, choices: tuple[dict[str, bool], ...]) -> Any:
    """Return an estimator as a model that computes its last output alone, the first options it knows."""
    from onnx.utils import Extractor
    from skl2onnx import to_onnx
    from skl2onnx.common.data_types import DoubleTensorType

    rows = [(INPUT, DoubleTensorType([None, part.n_features_in_]))]
    problem: Exception | None = None
    for options in choices:
        try:
            with _quiet():
                whole = to_onnx(
                    part, initial_types=rows, options={id(part): options} if options else None,
                    target_opset=dict(OPSETS),
                )  # fmt: skip
        except Exception as error:  # whatever a converter that was made for another version runs into
            problem = problem or error
        else:
            return Extractor(whole).extract_model([INPUT], [whole.graph.output[-1].name])
    said = str(problem).strip().partition("\n")[0]
    raise OnnxExportError(
        f"{class_name(part)} has no export to ONNX ({said}); "
        "the rule is what shipped pipelines name, or what skl2onnx converts"
    ) from problem


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence what scikit-learn says of fitted attributes that skl2onnx still reads."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Attribute `.+` was deprecated", FutureWarning)
        yield
