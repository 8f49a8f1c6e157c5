"""Report on the leaderboard: losses first, then questions, ranks, leakage, every protocol, and failures."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from texclass.evaluation.pipeline import DEFAULT_PIPELINE
from texclass.leaderboard.statistics import KEYS, PUBLISHED, losses, records
from texclass.reporting import Document, Finding, Heading, Table
from texclass.reporting.blocks import Block
from texclass.reporting.wording import counted, digits, gain, interval, p_value, percent

Data = Mapping[str, Any]
COLUMNS = {
    "balanced_accuracy": "Balanced %", "macro_f1": "Macro F1", "auroc_unknown": "AUROC unknown",
    "ece": "ECE", "coverage": "Coverage %", "set_size": "Set size", "ms": "ms", "kb": "kB",
}  # fmt: skip
"""Title of the column of each score."""


def leaderboard_document(data: Data, *, is_simulated: bool) -> Document:
    """Return the report on real or on simulated recordings.

    Parameters
    ----------
    data : mapping
        Data of a `Leaderboard`.
    is_simulated : bool
        Report on simulated recordings.
    """
    kind = "simulated" if is_simulated else "real"
    summary = pd.DataFrame([row for row in data["rows"] if row["is_simulated"] == is_simulated])
    titles = dict(zip(summary["method"], summary["title"], strict=True))
    blocks: list[Block] = [
        *_losses(summary),
        *_questions(data["questions"].get(kind, ()), titles),
        *_ranks(data["ranks"].get(kind), titles),
    ]
    if not is_simulated:
        blocks += _leakage(data["leakage"], set(summary["dataset"]))
    blocks += [*_protocols(summary), *_failures(summary), *_datasets(summary)]
    n_methods, n_datasets = summary["method"].nunique(), summary["dataset"].nunique()
    return Document(
        f"Leaderboard: {counted(n_methods, 'method')} on {counted(n_datasets, f'{kind} dataset')}",
        blocks,
        subtitle="Every method has the same folds and is tuned inside the training sets. Intervals are 95 % "
        "intervals over independent units (recordings, runs or operators).",
        finding=_finding(summary),
        reproduction={
            "Table": data["table_hash"],
            "Seed": str(data["seed"]),
            "Input hash": data["input_hash"][:16],
            "Code hash": data["code_hash"],
        },
        versions=data["versions"],
    )


def _finding(summary: pd.DataFrame) -> Finding | None:
    ours = summary[(summary["method"] == DEFAULT_PIPELINE) & (summary["status"] == "done")]
    if ours.empty:
        return None
    n_best = int((ours["difference"] == 0).sum())
    n_tied = int(ours["is_tied"].astype(bool).sum()) - n_best
    return Finding(
        f"{n_best} of {len(ours)}",
        "",
        "",
        f"protocols: the default of texclass has the highest accuracy. On {n_tied} more, its difference from "
        "the best method is not significant.",
        f"On {len(ours) - n_best - n_tied}, another method is significantly better.",
    )


def _accuracy(row: Mapping[str, Any]) -> str:
    return f"{percent(row['accuracy'])} {interval(row)}"


def _losses(summary: pd.DataFrame) -> Iterator[Block]:
    yield Heading("Where the default of texclass is not the best")
    rows = records(losses(summary, DEFAULT_PIPELINE))
    if not rows:
        yield "On every protocol, the default of texclass has the highest accuracy, or it was not evaluated."
        return
    frame = {
        "Dataset": [row["dataset"] for row in rows],
        "Question": [row["question"] for row in rows],
        "Best method": [row["best"] for row in rows],
        "Best %": [percent(row["best_accuracy"]) for row in rows],
        "Default of texclass %": [_accuracy(row) for row in rows],
        "Difference": [
            gain({**row, "low": row["difference_low"], "high": row["difference_high"]}) for row in rows
        ],
        "p": [p_value(row["p_value"]) for row in rows],
    }
    yield Table(
        frame,
        "Differences in percentage points, paired over the same tests; p-values corrected by Holm's method.",
        n_words=3,
    )


def _questions(rows: Sequence[Data], titles: Mapping[str, str]) -> Iterator[Block]:
    if not rows:
        return
    yield Heading("By question")
    questions = [name for name in rows[0] if name != "method"]
    frame = {"Method": [titles[row["method"]] for row in rows]}
    for question in questions:
        values = [row[question] for row in rows]
        frame[f"{question.capitalize()} %"] = ["" if value is None else percent(value) for value in values]
    yield Table(
        frame,
        "Mean accuracy over the datasets of a question; empty if a method has no result on one of them. "
        "Published splits may be optimistic. Few-shot, worst: the worst training set.",
    )


def _ranks(ranks: Data | None, titles: Mapping[str, str]) -> Iterator[Block]:
    if not ranks or not ranks["rows"]:
        return
    yield Heading("Mean rank over datasets")
    tied = [i for i, row in enumerate(ranks["rows"]) if row["is_tied"]]
    cd, p = ranks["critical_difference"], ranks["p_value"]
    text = (
        f"Honest protocols of {counted(ranks['n_datasets'], 'dataset')}; methods that failed are not ranked."
    )
    if cd is not None:
        text += f" Ranks that differ by less than {cd:.1f} are tied (Nemenyi test, 5 %), bold: the best."
    if p is not None:
        text += f" Friedman test: p {p_value(p)}."
    frame = {
        "Method": [titles[row["method"]] for row in ranks["rows"]],
        "Rank": [f"{row['rank']:.1f}" for row in ranks["rows"]],
    }
    yield Table(frame, text, bold_rows=tied)


def _leakage(rows: Sequence[Data], datasets: set[str]) -> Iterator[Block]:
    rows = [row for row in rows if row["dataset"] in datasets]
    if not rows:
        return
    yield Heading("Published and honest splits")
    frame = {
        "Dataset": [row["dataset"] for row in rows],
        "Honest split": [row["question"] for row in rows],
        "Method": [row["title"] for row in rows],
        "Published %": [percent(row["published"]) for row in rows],
        "Honest %": [percent(row["honest"]) for row in rows],
        "Leakage": [gain({**row, "difference": row["leakage"]}) for row in rows],
    }
    yield Table(
        frame,
        "Leakage: accuracy of the published split minus that of the honest split, in percentage points. It "
        "also contains the change over time where the honest split tests later recordings.",
        n_words=3,
    )


def _protocols(summary: pd.DataFrame) -> Iterator[Block]:
    yield Heading("Every protocol")
    for _, rows in summary.groupby(KEYS, sort=False, dropna=False):
        done = rows[rows["status"] == "done"].sort_values("accuracy", ascending=False, kind="stable")
        if done.empty:
            continue
        lines = records(done)
        frame = {
            "Method": [row["title"] for row in lines],
            "Accuracy %": [_accuracy(row) for row in lines],
        }
        for name, title in COLUMNS.items():
            factor = 100 if title.endswith("%") else 1
            frame[title] = ["" if row[name] is None else digits(factor * row[name]) for row in lines]
        first = lines[0]
        question = "published split" if first["question"] == PUBLISHED else first["question"]
        window = f", windows of {first['window_s']:g} s" if first["window_s"] else ""
        yield Table(
            frame,
            f"{first['dataset']}, {question}: `{first['protocol']}`{window}; "
            f"{counted(int(first['n_tests']), 'test')} of {counted(int(first['n_units']), first['unit'])}, "
            f"{counted(int(first['n_surfaces']), 'surface')}, chance level {percent(first['chance'])} %. "
            "Bold: the best method, and methods without a significant difference from it.",
            bold_rows=[i for i, row in enumerate(lines) if row["is_tied"]],
            n_narrow=2,
        )


def _failures(summary: pd.DataFrame) -> Iterator[Block]:
    failed = summary[summary["status"] != "done"]
    if failed.empty:
        return
    yield Heading("Failures")
    yield [
        f"{row['dataset']}, {row['question']}, {row['title']}: {row['message']}" for row in records(failed)
    ]


def _datasets(summary: pd.DataFrame) -> Iterator[Block]:
    yield Heading("Datasets")
    first = summary.drop_duplicates("dataset")
    frame = {
        "Dataset": first["dataset"].tolist(),
        "Licence": first["licence"].tolist(),
        "Hash": first["dataset_hash"].tolist(),
        "Surfaces": [str(n) for n in first["n_surfaces"]],
    }
    yield Table(frame, "Hash: digest of the files and of the keys of the card that change recordings.", 3)
