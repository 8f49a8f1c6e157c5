"""The committed study of the order of the paper's rows."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

from texclass.experiment.pipeline import load_pipeline

REPORT = Path(__file__).parents[2] / "reports" / "studies" / "rank_agreement.json"


def test_rank_agreement_is_told_over_ten_catalogues_with_an_interval_and_without_the_combined_rows():
    told = json.loads(REPORT.read_text(encoding="utf-8"))
    rows = pd.DataFrame(told["accuracy"])
    published = [row.name for row in load_pipeline("strese2015").rows if row.published]
    assert list(rows["row"].unique()) == published
    assert rows["seed"].nunique() >= 10
    pools = {"all rows": published, "without the combined rows": published[:-2]}
    assert {(one["rows"], one["n_rows"]) for one in told["results"]} == {
        (k, len(v)) for k, v in pools.items()
    }
    assert len(told["results"]) == 2 * rows["classifier"].nunique()
    bayes = rows[rows["classifier"] == "naive_bayes"]
    for one in told["results"][:2]:
        assert one["classifier"] == "Naive Bayes"
        counted = bayes[bayes["row"].isin(pools[one["rows"]])]
        found = [spearmanr(part["ours"], part["published"]).statistic for _, part in counted.groupby("seed")]
        np.testing.assert_allclose(one["of_catalogues"], found, atol=0.01)
        assert one["low"] < np.mean(found) < one["high"]
        assert one["mean"] == pytest.approx(np.mean(found), abs=0.01)
