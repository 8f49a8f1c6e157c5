"""Accuracy of `KernelDiscriminant(max_kb=...)` with a few kilobytes on 1 s windows of `biotac20`.

Repetitions 1 to 20 are the training set, 21 to 40 the test set, with all columns of a row of the pipeline
`texclass`; kilobytes are those of the exported discriminant's constants. `python benchmarks/kernel_size.py`
(a minute, once features are cached) writes reports/studies/kernel_size.
"""

import numpy as np
from onnx import numpy_helper
from study import command_line, interval, table, timed, write

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.evaluation import cached_table, cut_windows, load_pipeline
from texclass.evaluation.folds import map_folds
from texclass.evaluation.pipeline import MatchedRow
from texclass.evaluation.protocols import find_protocol, make_splits
from texclass.loaders import open_dataset
from texclass.recognition.array_form import classifier_of
from texclass.robot.export.answers_graph import add_part
from texclass.robot.export.graph import Graph, Tensor
from texclass.tradeoff.pareto_front import LabelledData, accuracy_with_interval, preprocessing

ROW = "Several time scales"
TOUCH_S = 1.0
LIMITS_KB = (None, 2000, 1000, 500, 300, 200)


def evaluate_model(classifier, data, splits):
    """Return accuracy, samples kept, kB and seconds of the fit."""

    def fitted_on(fold):
        fitted_model, seconds = timed(lambda: fold.fit(classifier))
        return fitted_model, fitted_model.predict(fold.X_test) == fold.y_test, seconds

    ((fitted, hits, seconds),) = map_folds(fitted_on, data.X, data.y, splits, preprocessing())
    graph = Graph()
    add_part(classifier_of(fitted), Tensor(graph, "rows"))
    return {
        **accuracy_with_interval(hits, splits, data),
        "n_kept": len(fitted.dual_),
        "kb": sum(numpy_helper.to_array(one).nbytes for one in graph.constants) / 1000,
        "fit_s": seconds,
    }


def main() -> None:
    args = command_line(__doc__, jobs=1)
    pipeline, windows = load_pipeline("texclass"), cut_windows(open_dataset("biotac20"), TOUCH_S)
    table_of_features = cached_table(windows, *pipeline.needed, channels=pipeline.channels, n_jobs=args.jobs)
    frame, protocol = table_of_features.frame, find_protocol("chronological")
    row = next(row for row in pipeline.rows if row.name == ROW)
    columns = list(MatchedRow.match(row, pipeline.features, table_of_features).columns)
    data = LabelledData(
        frame[columns].to_numpy(dtype=np.float64),
        frame["surface"].to_numpy(dtype=str),
        protocol.clusters(frame),
        protocol.independent(frame)[1],
    )
    splits = make_splits(protocol, frame, pipeline.seed)
    rows = []
    for max_kb in LIMITS_KB:
        compressed = evaluate_model(KernelDiscriminant(max_kb=max_kb), data, splits)
        alone = evaluate_model(KernelDiscriminant(max_samples=compressed["n_kept"]), data, splits)
        rows.append({"max_kb": max_kb, **compressed, "alone": alone["mean"], "n_alone": alone["n_kept"]})
        print(rows[-1], flush=True)
    result = {
        "rows": rows,
        "row": ROW,
        "n_columns": len(columns),
        "n_train": len(splits[0][0]),
        "n_test": len(splits[0][1]),
        "input_hash": windows.input_hash,
    }
    table_rows = [
        one | {"limit": f"{one['max_kb'] or 'none'}", "right": interval(one, "mean")} for one in rows
    ]
    blocks = [
        f"Touches of {TOUCH_S:g} s of `biotac20`, {len(columns)} columns of the row {ROW}: repetitions 1 to "
        f"20 train ({result['n_train']:,} touches), 21 to 40 are asked ({result['n_test']:,}). Coefficients "
        "serve all training samples, whatever number of them is kept; beside it, what training on about as "
        "many alone gives.",
        table(
            table_rows,
            "--max-kb = {limit} | samples kept = {n_kept:,} | kB = {kb:,.0f} | % [95 %] = {right} | "
            "fit, s = {fit_s:.1f} | trained on as many alone = {alone:.1%}",
        ),
    ]
    write(args.out, "kernel_size", result, "Kernel discriminants of a few kilobytes", blocks)


if __name__ == "__main__":
    main()
