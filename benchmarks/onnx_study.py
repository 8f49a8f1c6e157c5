"""One ONNX file from samples to prediction: agreement, time and size compared with texclass.

Models are trained on `biotac20` and `borealtc` (or read from `--models`), exported from the samples on, and
asked about windows of all recordings, also of those they were not trained on: labels and verdicts have to be
the same where the answer does not hang on less than the margin, probabilities within 1e-5.
"""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import onnxruntime
from study import command_line, in_turns, table, timed, write

import texclass as tx
from texclass.evaluation.windows import Window, cut_windows
from texclass.recognition import load_model
from texclass.robot import export_onnx
from texclass.robot.export.answers_graph import OUTPUTS
from texclass.robot.export.parity import run
from texclass.robot.export.sample_graph import SAMPLES, build_sample_graph, channels_of, recording_of
from texclass.robot.export.sample_parity import (
    MARGIN,
    TOLERANCE,
    check_sample_parity,
    features_of_windows,
)

MODELS = (
    ("biotac20", "texclass", "Modified MFCC", "lda", 1.0),
    ("biotac20", "texclass", "Movement", "lda", 1.0),
    ("biotac20", "texclass", "All", "lda", 1.0),
    ("biotac20", "texclass", "Several time scales", "lda", 1.0),
    ("biotac20", "texclass", "Several time scales", "naive_bayes", 1.0),
    ("biotac20", "texclass", "Several time scales", "lda", 0.25),
    ("biotac20", "texclass", "Several time scales", "kernel", 0.25),
    ("biotac20", "multiscale", "Spectrum, slopes, curvatures and shape", "vote", 1.0),
    ("borealtc", "coarse", "Bands", "lda", 5.0),
    ("borealtc", "coarse", "Bands", "kernel", 5.0),
)
"""Dataset, pipeline, row, classifier, seconds of a window."""
TRAINED = 20
"""Repetitions of `biotac20` that train."""
STEP_S = {0.25: 0.5, 1.0: 0.5, 5.0: 0.4}
"""Length of windows -> time from one to the next that is asked."""


def model_of(dataset, pipeline, row, classifier, window_s, folder, jobs):
    """Return a model from the folder, or train it."""
    words = f"{dataset}-{pipeline}-{row}-{classifier}-{window_s:g}".replace(" ", "_").replace(",", "")
    path = Path(folder) / f"{words}.skops"
    if not path.is_file():
        dataset_windows = tx.open_dataset(dataset)
        kept_entries = tuple(
            e for e in dataset_windows.entries if dataset != "biotac20" or e.repetition <= TRAINED
        )
        dataset_windows = type(dataset_windows)(
            dataset_windows.name,
            kept_entries,
            dataset_windows.load,
            f"{dataset_windows.input_hash}-{len(kept_entries)}",
        )
        train_options = {"row": row, "classifier": classifier, "window_s": window_s, "n_jobs": jobs}
        tx.train(dataset_windows, pipeline, **train_options, exportable=True).save(path)
    return load_model(path)


def windows_of(model, dataset, window_s, n_most):
    """Return windows of all recordings as float32, shape (n, n_channels, n_samples)."""
    cut = cut_windows(tx.open_dataset(dataset), window_s, step=STEP_S[window_s])
    entries = [entry for entry in cut.entries if isinstance(entry, Window) and not entry.problem]
    if len(entries) > n_most:
        entries = [entries[i] for i in np.linspace(0, len(entries) - 1, n_most).astype(int)]
    found = []
    for entry in entries:
        touch = cut.load(entry)
        columns = [touch.acceleration.reshape(touch.n_samples, -1)]
        if len(channels_of(model)) > columns[0].shape[1]:
            columns.append(touch.turn_rate)
        found.append(np.column_stack(columns).T.astype(np.float32))
    return np.stack(found)


def studied(model, windows, path, n_rounds):
    """Return what was found of one model."""
    exported, export_s = timed(lambda: export_onnx(model, path, start="samples"))
    n_samples = windows.shape[2]
    with_features = build_sample_graph(model, n_samples, with_features=True).SerializeToString()
    found = run(with_features, windows, SAMPLES)
    X = features_of_windows(model, windows)
    parity = check_sample_parity(model, with_features, windows, X)
    p, p_known = model.classify(X)
    labels = np.array(model.surfaces)[p.argmax(axis=1)]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session, load_s = timed(
        lambda: onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    )
    sample_rows = iter(np.resize(windows, (10_000, *windows.shape[1:])))

    def by_texclass():
        model.classify(model.plan.compute(recording_of(model, next(sample_rows))).values[None])

    def by_onnx():
        session.run(list(OUTPUTS), {SAMPLES: next(sample_rows)[None]})

    times = 1e3 * in_turns({"texclass": by_texclass, "onnx": by_onnx}, n_rounds).median()
    return {
        "n_windows": len(windows),
        "n_channels": windows.shape[1],
        "n_samples": n_samples,
        "n_columns": len(model.columns),
        "accuracy": model.manifest.accuracy["mean"],
        "with_all_features": model.manifest.accuracy.get("with_all_features"),
        "without_graph": model.manifest.accuracy.get("not_exportable", []),
        "labels_differ": int((found["label"] != labels).sum()),
        "verdicts_differ": int((found["unknown"] != (p_known <= model.novelty.false_alarms)).sum()),
        "n_close": parity.n_close,
        "n_unknown": parity.n_unknown,
        "n_answered": parity.n_predicted,
        "largest_gap": float(np.abs(found["probabilities"] - p).max()),
        "feature_gap": parity.feature_difference,
        "texclass_ms": float(times["texclass"]),
        "onnx_ms": float(times["onnx"]),
        "times_faster": float(times["texclass"] / times["onnx"]),
        "load_ms": 1e3 * load_s,
        "export_s": export_s,
        "size_mb": exported.path.stat().st_size / 1e6,
    }


def main() -> None:
    args = command_line(__doc__, windows=10_000, rounds=200, jobs=1, models="")
    folder = Path(args.models or mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for dataset, pipeline, row, classifier, window_s in MODELS:
        model = model_of(dataset, pipeline, row, classifier, window_s, folder, args.jobs)
        windows = windows_of(model, dataset, window_s, args.windows)
        named_models = {
            "dataset": dataset,
            "pipeline": pipeline,
            "row": row,
            "classifier": classifier,
            "s": window_s,
        }
        rows.append(named_models | studied(model, windows, folder / "study.onnx", args.rounds))
        print(rows[-1], flush=True)
    report(rows, args.rounds, args.out)


def report(rows, n_rounds, out) -> None:
    """Write what was found of all models."""
    result = {
        "rows": rows,
        "tolerance": TOLERANCE,
        "margin": MARGIN,
        "n_rounds": n_rounds,
    }
    blocks = [
        "Windows of all recordings are asked, those of repetitions that did not train (`biotac20` 21 to 40) "
        "among them; from one to the next are 0.5 s (`biotac20`) or 0.4 s (`borealtc`), so that those of 1 s "
        "and 5 s overlap. *differ*: labels, and verdicts on unknown surfaces, that are others in ONNX; "
        f"*close*: windows whose label or verdict lies within {MARGIN:g} of another. The largest "
        f"difference of a probability has to be at most {TOLERANCE:g}, in windows inside the range of "
        "training; that of a feature is in widths of its range.",
        table(
            rows,
            "model = {dataset}: {row}, {classifier} | s = {s:g} | windows = {n_windows} | "
            "differ = {labels_differ}, {verdicts_differ} | close = {n_close} | unknown = {n_unknown} | "
            "probability = {largest_gap:.1e} | feature = {feature_gap:.1e}",
            n_words=1,
        ),
        "What `texclass train --exportable` left out, and the accuracy of held-out touches with and without:",
        table(
            [row | {"left_out": ", ".join(row["without_graph"])} for row in rows if row["without_graph"]],
            "model = {dataset}: {row}, {classifier} | left out = {left_out} | "
            "with all = {with_all_features:.1%} | without = {accuracy:.1%}",
            n_words=2,
        ),
        "Milliseconds of a window, one thread, medians of rounds in which texclass (features and answer, "
        "single windows) and ONNX Runtime take turns; loading and size of the file:",
        table(
            rows,
            "model = {dataset}: {row}, {classifier} | s = {s:g} | "
            "channels x samples = {n_channels} x {n_samples} | columns = {n_columns} | "
            "texclass (ms) = {texclass_ms:.2f} | ONNX (ms) = {onnx_ms:.2f} | "
            "times faster = {times_faster:.1f} | load (ms) = {load_ms:.0f} | MB = {size_mb:.2f}",
            n_words=1,
        ),
    ]
    write(out, "onnx", result, "From samples to the answer in one ONNX file", blocks)


if __name__ == "__main__":
    main()
