"""Whether a graph gives the answers of scikit-learn: label by label, probability by probability."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texclass.recognition.model import Model
from texclass.recognition.onnx_export.answers import FEATURES, OUTPUTS, UNDEFINED
from texclass.recognition.onnx_export.check_rows import CheckRows, check_rows
from texclass.recognition.onnx_export.differences import Found, apart, differences
from texclass.recognition.onnx_export.graph import OnnxExportError
from texclass.recognition.onnx_export.reference import TOLERANCE, judge
from texclass.recognition.onnx_export.remembered import remembered
from texclass.recording import Samples

SEED = 2015
BATCH = 256
"""Rows that the graph is asked at a time: distances take memory."""


class ParityError(OnnxExportError):
    """A graph gives other answers than scikit-learn; the message says where and by how much."""


@dataclass(frozen=True)
class Parity:
    """How a graph was compared with scikit-learn, and found the same.

    Attributes
    ----------
    rows
        How many were compared, of each kind; see `check_rows`.
    n_answered, n_materials : int
        Materials that were answered at least once, of how many there are.
    n_unknown : int
        Rows called unknown.
    n_ties : int
        Rows where rounding decides, and decided differently.
    difference : float
        Largest difference of a probability.
    tolerance : float
        What it may be.
    """

    rows: dict[str, int]
    n_answered: int
    n_materials: int
    n_unknown: int
    n_ties: int
    difference: float
    tolerance: float = TOLERANCE

    def __str__(self) -> str:
        kinds = ", ".join(f"{n} {kind}" for kind, n in self.rows.items())
        return (
            f"as scikit-learn on {sum(self.rows.values())} rows ({kinds}): no label differs, probabilities "
            f"by at most {self.difference:.1e} (tolerance {self.tolerance:g}), {self.n_ties} ties; "
            f"{self.n_answered} of {self.n_materials} materials were answered, {self.n_unknown} rows unknown"
        )


def check_parity(model: Model, graph: bytes, *, seed: int = SEED) -> Parity:
    """Compare a graph with the model it was made of.

    Parameters
    ----------
    model : Model
        What scikit-learn answers.
    graph : bytes
        The ONNX model.
    seed : int
        Of the rows.

    Raises
    ------
    ParityError
        If a label, a verdict or a probability differs, apart from provable ties: of two labels whose
        probabilities are equal within the tolerance, of neighbours equally far, and of a strangeness equal to
        one that was held out.
    OnnxExportError
        If onnxruntime cannot run it.
    """
    rows = rows_for(model, seed)
    expected, found = judge(model, rows.X), run(graph, rows.X)
    for one in differences(model, rows.X, expected, found):
        if one.where.any():
            i = int(np.flatnonzero(one.where)[0])
            raise ParityError(
                f"ONNX differs from scikit-learn in {int(one.where.sum())} of {len(rows.X)} rows; row {i} "
                f"({rows.kind[i]}) has {one.what} {one.found[i]} in ONNX, {one.expected[i]} in scikit-learn; "
                f"the rule is the same label and verdict, and probabilities within {TOLERANCE:g}"
            )
    gap = apart(expected, found)
    decided = (found["label"] != expected.labels) | (gap > TOLERANCE)
    decided |= expected.defined & (found["p_known"] != expected.p_known)
    kinds, counts = np.unique(rows.kind, return_counts=True)
    return Parity(
        rows=dict(zip(kinds.tolist(), counts.tolist(), strict=True)),
        n_answered=len(set(expected.labels.tolist()) - {UNDEFINED}),
        n_materials=len(model.materials),
        n_unknown=int(expected.unknown.sum()),
        n_ties=int(decided.sum()),
        difference=float(gap[gap <= TOLERANCE].max(initial=0.0)),
    )


def rows_for(model: Model, seed: int = SEED) -> CheckRows:
    """Return the rows on which a model and its graph are compared."""
    order = (UNDEFINED, *sorted(model.materials))

    def numbered(X: Samples) -> NDArray[np.intp]:
        judged = judge(model, X)
        return 2 * np.searchsorted(order, judged.labels) + judged.unknown

    return check_rows(model.ranges, remembered(model), numbered, seed)


def run(graph: bytes, X: Samples) -> Found:
    """Return what onnxruntime answers of rows (n, n_columns), by output.

    Raises
    ------
    OnnxExportError
        If it cannot.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        batches = (np.ascontiguousarray(X[k : k + BATCH]) for k in range(0, len(X), BATCH))
        found = [session.run(list(OUTPUTS), {FEATURES: batch}) for batch in batches]
    except Exception as error:  # its exceptions have no class in common
        said = f"onnxruntime {onnxruntime.__version__} cannot run the graph ({error})"
        raise OnnxExportError(f"{said}; the rule is operators that it has in double precision") from error
    return {name: np.concatenate(parts) for name, *parts in zip(OUTPUTS, *found, strict=True)}
