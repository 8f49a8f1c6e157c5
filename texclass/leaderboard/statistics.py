"""Statistics of the leaderboard: intervals, paired differences, leakage, and ranks over datasets."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import friedmanchisquare, rankdata, studentized_range

from texclass.evaluation.accuracy import LEVEL, cluster_interval, clustered_t, holm

KEYS = ["dataset", "question", "protocol", "window_s"]
"""Columns that identify a protocol of a dataset."""
SCORES = ("balanced_accuracy", "macro_f1", "auroc_unknown", "ece", "coverage", "set_size", "ms", "kb")
"""Scores that are averaged over folds, weighted by their numbers of tests."""
SUMMARY_COLUMNS = (
    "accuracy", "low", "high", "worst", *SCORES, "n_folds", "n_tests", "choice", "difference",
    "difference_low", "difference_high", "p_value", "is_tied", "message",
)  # fmt: skip
"""Columns of the summary that are computed."""
PUBLISHED = "published"
"""Question of the published split."""
FEW_SHOT = "few-shot"
"""Question of the protocols with a few training recordings per surface."""
FACTS = ("title", "author", "is_simulated", "licence", "unit", "n_units", "n_surfaces", "chance",
         "dataset_hash", "folds_hash", "units_hash", "versions")  # fmt: skip


def unit_counts(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the hits and tests of each independent unit, summed over folds.

    Parameters
    ----------
    rows : DataFrame
        Folds of one method under one protocol, with the column `unit_hits`: "0:31/32 4:30/32" for 31 hits in
        32 tests of unit 0, and 30 hits in 32 tests of unit 4.

    Returns
    -------
    DataFrame
        Columns `hits` and `tests`, indexed by the number of the unit.

    Examples
    --------
    >>> unit_counts(pd.DataFrame({"unit_hits": ["0:31/32 4:30/32", "4:1/2"]})).loc[4].tolist()
    [31, 34]
    """
    text = " ".join(rows["unit_hits"]).replace(":", " ").replace("/", " ")
    counts = np.array(text.split(), dtype=np.int64).reshape(-1, 3)
    frame = pd.DataFrame(counts, columns=["unit", "hits", "tests"])
    return frame.groupby("unit").sum()


def summarize(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per dataset, protocol and method, with intervals and paired differences.

    Parameters
    ----------
    table : DataFrame
        Table of the suite, one row per fold.

    Returns
    -------
    DataFrame
        Columns `KEYS`, `method`, facts, `accuracy` (pooled over all tests) with its 95 % interval from `low`
        to `high` over independent units, `worst` (accuracy of the worst fold), and the scores averaged over
        folds. `difference` is the accuracy of the best method minus that of this method, with `p_value`
        (clustered t-test on the same tests, corrected by Holm's method over the methods of the protocol).
        `is_tied` is True if this difference is not significant. Failed methods have a `message` and no
        scores.
    """
    lines = []
    for key, protocol_rows in table.groupby(KEYS, sort=False, dropna=False):
        counts = {}
        protocol_lines = []
        for method, rows in protocol_rows.groupby("method", sort=False):
            first = rows.iloc[0]
            line = dict(zip(KEYS, key, strict=True)) | {"method": method, "status": first["status"]}
            line |= {name: first[name] for name in FACTS}
            if first["status"] != "done":
                protocol_lines.append(line | {"message": first["message"]})
                continue
            counts[method] = unit_counts(rows)
            protocol_lines.append(line | _scores(rows, counts[method]))
        lines += _with_differences(protocol_lines, counts)
    return pd.DataFrame(lines, columns=[*KEYS, "method", "status", *FACTS, *SUMMARY_COLUMNS])


def _scores(rows: pd.DataFrame, counts: pd.DataFrame) -> dict[str, Any]:
    """Return accuracy with interval, and the mean of each score over the folds."""
    low, high = _interval(counts)
    scores = dict[str, float | None]()
    for name in SCORES:
        is_defined = rows[name].notna()
        weights = rows.loc[is_defined, "n_test"]
        scores[name] = (
            float(np.average(rows.loc[is_defined, name], weights=weights)) if len(weights) else None
        )
    return {
        "accuracy": _rate(counts),
        "low": low,
        "high": high,
        "worst": float(rows["accuracy"].min()),
        "n_folds": len(rows),
        "n_tests": int(counts["tests"].sum()),
        "choice": rows["choice"].mode().iloc[0],
        "message": "",
        **scores,
    }


def _with_differences(
    lines: Sequence[dict[str, Any]], counts: Mapping[Any, pd.DataFrame]
) -> list[dict[str, Any]]:
    """Add the paired difference of each method from the best one."""
    done = [line for line in lines if line["status"] == "done"]
    if not done:
        return list(lines)
    best = max(done, key=lambda line: float(line["accuracy"]))
    others = [line for line in done if line is not best]
    p_values = []
    for line in others:
        one, two = counts[best["method"]], counts[line["method"]]
        (low, high), p = clustered_t((one["hits"] - two["hits"]).to_numpy(), one["tests"].to_numpy())
        p_values.append(p)
        line |= {
            "difference": best["accuracy"] - line["accuracy"],
            "difference_low": low,
            "difference_high": high,
        }
    for line, p in zip(others, holm(p_values) if others else (), strict=True):
        line |= {"p_value": float(p), "is_tied": bool(p > LEVEL)}
    best |= {"difference": 0.0, "p_value": 1.0, "is_tied": True}
    return list(lines)


def leakage(table: pd.DataFrame) -> pd.DataFrame:
    """Return the accuracy of the published split minus that of each honest split, by dataset and method.

    Few-shot protocols are not compared, because their training sets are much smaller. If both protocols test
    the same independent units, the interval is that of a paired difference over units. Otherwise it combines
    the widths of both intervals.

    Parameters
    ----------
    table : DataFrame
        Table of the suite.

    Returns
    -------
    DataFrame
        Columns `dataset`, `question`, `method`, `title`, `published`, `honest`, `leakage`, `low`, `high`.
    """
    lines = []
    done = table[table["status"] == "done"]
    # A protocol that is published and honest at the same time hides nothing.
    for (dataset, method), rows in done.groupby(["dataset", "method"], sort=False):
        published = rows[rows["question"] == PUBLISHED]
        honest_rows = rows[~rows["question"].isin([PUBLISHED, FEW_SHOT])]
        for _, honest in honest_rows.groupby(["question", "protocol", "window_s"], sort=False, dropna=False):
            first, windows = honest.iloc[0], published["window_s"]
            same = published[windows.eq(first["window_s"]) | (windows.isna() & pd.isna(first["window_s"]))]
            if len(same) and same.iloc[0]["protocol"] != first["protocol"]:
                lines.append(_leakage_line(dataset, method, same, honest))
    return pd.DataFrame(
        lines,
        columns=["dataset", "question", "method", "title", "published", "honest", "leakage", "low", "high"],
    )


def _leakage_line(dataset: Any, method: Any, published: pd.DataFrame, honest: pd.DataFrame) -> dict[str, Any]:
    one, two = unit_counts(published), unit_counts(honest)
    rates = _rate(one), _rate(two)
    first = honest.iloc[0]
    is_paired = published.iloc[0]["units_hash"] == first["units_hash"] and np.array_equal(
        one["tests"], two["tests"]
    )
    if is_paired:
        (low, high), _ = clustered_t((one["hits"] - two["hits"]).to_numpy(), one["tests"].to_numpy())
    else:
        (low, high), (other_low, other_high) = _interval(one), _interval(two)
        half = float(np.hypot((high - low) / 2, (other_high - other_low) / 2))
        low, high = rates[0] - rates[1] - half, rates[0] - rates[1] + half
    return {
        "dataset": dataset,
        "question": first["question"],
        "method": method,
        "title": first["title"],
        "published": rates[0],
        "honest": rates[1],
        "leakage": rates[0] - rates[1],
        "low": float(low),
        "high": float(high),
    }


def _rate(counts: pd.DataFrame) -> float:
    return float(counts["hits"].sum() / counts["tests"].sum())


def _interval(counts: pd.DataFrame) -> tuple[float, float]:
    hits, tests = counts["hits"].to_numpy(), counts["tests"].to_numpy()
    is_hit = np.concatenate([np.arange(n) < k for k, n in zip(hits, tests, strict=True)])
    return cluster_interval(is_hit, np.repeat(np.arange(len(tests)), tests))


def by_question(summary: pd.DataFrame) -> pd.DataFrame:
    """Return the mean accuracy of each method over the datasets of each question.

    For few-shot protocols, the worst training set is also given. A mean is undefined if the method has no
    result on one of the datasets of the question.

    Parameters
    ----------
    summary : DataFrame
        Result of `summarize`.
    """
    columns = {
        str(question): _by_method(rows, "accuracy").mean(skipna=False)
        for question, rows in summary.groupby("question", sort=False)
    }
    few_shot = summary[summary["question"] == FEW_SHOT]
    if len(few_shot):
        columns["few-shot, worst"] = _by_method(few_shot, "worst").mean(skipna=False)
    accuracy = pd.DataFrame(columns).rename_axis("method")
    return accuracy.loc[accuracy.mean(axis=1).sort_values(ascending=False, kind="stable").index]


def mean_ranks(summary: pd.DataFrame) -> pd.DataFrame:
    """Return the mean rank of each method over the honest protocols of all datasets, with ties.

    Methods whose mean rank is within the critical difference of the best one (Nemenyi test) are tied with it:

        CD = q sqrt(k (k + 1)/(6 N)),

    for k methods and N datasets, where sqrt(2) q is the 95 % quantile of the studentized range. Only methods
    that finished every protocol are ranked. The protocols of one dataset are averaged first, because they are
    not independent.

    Parameters
    ----------
    summary : DataFrame
        Result of `summarize`.

    Returns
    -------
    DataFrame
        Columns `method`, `rank`, `is_tied`, sorted by rank. Its `attrs` have `critical_difference`,
        `n_datasets` and `p_value` (Friedman test; None for fewer than three methods or two datasets).

    References
    ----------
    Demsar: Statistical comparisons of classifiers over multiple data sets, Journal of Machine Learning
    Research 7, 2006.
    """
    accuracy = _by_method(summary[summary["question"] != PUBLISHED], "accuracy").dropna(axis=1)
    per_dataset = pd.DataFrame(
        rankdata(-accuracy.to_numpy(), axis=1), index=accuracy.index, columns=accuracy.columns
    ).groupby(level="dataset").mean()  # fmt: skip
    n, k = per_dataset.shape
    ranks = per_dataset.mean().sort_values(kind="stable").rename("rank").rename_axis("method").reset_index()
    cd = critical_difference(k, n) if k >= 2 and n >= 2 else float("nan")
    ranks["is_tied"] = ~(ranks["rank"] > ranks["rank"].min() + cd)
    p = float(friedmanchisquare(*per_dataset.to_numpy().T).pvalue) if k >= 3 and n >= 2 else None
    ranks.attrs |= {"critical_difference": cd, "n_datasets": n, "p_value": p}
    return ranks


def _by_method(summary: pd.DataFrame, score: str) -> pd.DataFrame:
    """Return a score with one row per protocol and one column per method; NaN without a result."""
    scores = summary.pivot_table(
        index=KEYS, columns="method", values=score, aggfunc="first", sort=False, dropna=False
    )
    return scores[scores.notna().any(axis=1)]


def critical_difference(n_methods: int, n_datasets: int) -> float:
    """Return the critical difference of mean ranks (Nemenyi test, 5 %).

    Examples
    --------
    >>> round(critical_difference(5, 30), 2)
    1.11
    """
    q = float(studentized_range.ppf(1 - LEVEL, n_methods, np.inf)) / np.sqrt(2)
    return float(q * np.sqrt(n_methods * (n_methods + 1) / (6 * n_datasets)))


def losses(summary: pd.DataFrame, method: str) -> pd.DataFrame:
    """Return the protocols on which a method is not the best, with the largest difference first.

    Parameters
    ----------
    summary : DataFrame
        Result of `summarize`.
    method : str
        Name of the method.
    """
    best = summary[summary["difference"] == 0].drop_duplicates(KEYS).set_index(KEYS)
    rows = summary[(summary["method"] == method) & (summary["difference"] > 0)].copy()
    winners = best.reindex(pd.MultiIndex.from_frame(rows[KEYS]))
    rows["best"], rows["best_accuracy"] = winners["title"].to_numpy(), winners["accuracy"].to_numpy()
    return rows.sort_values("difference", ascending=False, kind="stable", ignore_index=True)


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table, with None for undefined values."""
    return [
        {str(key): None if pd.isna(value) else value for key, value in row.items()}
        for row in frame.to_dict("records")
    ]
