"""Results of every kind as the commands write them, small, with names that are hostile to HTML."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.cost import ClassifierCost
from texclass.experiment.paired import Paired
from texclass.experiment.result import BenchmarkResult, Confusion, Gains, GroupGain, RowResult, RowSum
from texclass.peers import Contestant, Cost, PeerComparison
from texclass.stability import Mark, StabilityResult
from texclass.tradeoff.tradeoff_result import Chosen, Curve, Estimate, FeatureCost, FrontPoint, Tradeoff

HOSTILE = '<script>alert("x")</script>'
AGAIN: dict[str, Any] = {"versions": {"texclass": "1", "numpy": "2"}, "seed": 7, "input_hash": "abc"}
FACTS = {
    "name": "toy", "title": f"Toy {HOSTILE}", "n_recordings": 100, "n_materials": 3, "n_operators": 2,
    "source": "javascript:alert(1)", "licence": "MIT", "notes": ["'\"><img src=x onerror=alert(1)>"],
}  # fmt: skip
PAIRED = Paired(0.05, (0.01, 0.09), 0.012, "exact McNemar test", ((0.04, 0.06), (0.0, -0.1)), 8, 3)
NEAR = Estimate(0.9, 0.85, 0.95)


def benchmark(n_materials: int = 3, **changes: Any) -> BenchmarkResult:
    """A benchmark of three rows; 90 of 100 are right in the best one."""
    names = (HOSTILE, *(f"material-{i:02d}" for i in range(1, n_materials)))
    counts = np.diag(np.full(n_materials, 9)) + np.roll(np.eye(n_materials, dtype=int), 1, axis=1)
    vote = Accuracy(18, 20, (0.9, 0.9))
    best = {
        "lda": Accuracy(90, 100, (0.9, 0.9), balanced=0.85, voted=vote),
        "naive_bayes": Accuracy(80, 100, (0.8, 0.8)),
    }
    rows = (
        RowResult("All", 12, best, {"lda": 86.0}, 3.5, selected={"lda": {"mfcc.c1": 1.0}}),
        RowResult(f"Row {HOSTILE}", 2, {"lda": Accuracy(50, 100)}, {"lda": 60.0}, 1.0),
        RowResult("Friction", 1, {}, missing="no friction signal"),
    )
    added = GroupGain("taps", 3, RowSum(15, 0.95, 4.0), PAIRED, 0.024)
    return BenchmarkResult(
        **{
            "dataset": FACTS | {"n_materials": n_materials, "materials": list(names)},
            "pipeline": "small", "pipeline_hash": "beef", "feature_set": "texclass",
            "classifiers": ("lda", "naive_bayes"),
            "protocol": "operator",
            "protocol_description": "leave one operator out", "n_folds": 2, "rows": rows,
            "confusion": Confusion("All", "lda", names, counts),
            "gains": Gains(
                "All", "lda", "the most accurate row", True, RowSum(12, 0.9, 3.5), 2, 2,
                (added, GroupGain("friction", 1, missing="no friction signal")),
            ),
            **AGAIN, **changes,
        }
    )  # fmt: skip


def feature() -> dict[str, Any]:
    """A benchmark with a new feature, as `FeatureStudy.to_dict` writes it."""
    law = {"power": 1.0, "shift": 0.0}
    kin = {"column": "mfcc.c1", "rank_correlation": -0.5}
    new = {
        "name": "crest", "phase": "movement", "unit": "1", "reference": "eq. 1", "columns": ["crest"],
        "ms_alone": 2.0, "ms_added": 0.5,
        "redundancy": [{"column": "crest", "explained": 0.2, "nearest": [kin]}],
        "gain_law": {"declared": law, "measured": law, "deviation": 0.0, "holds": True},
        "behaviour": [{"input": "silence", "answer": "reason", "detail": HOSTILE, "kept": True}],
    }  # fmt: skip
    return benchmark().to_dict() | {"new_feature": new}


def tradeoff() -> Tradeoff:
    """A study of two features with two curves in one panel."""
    front = tuple(FrontPoint(ms, ms, Estimate(a, a - 0.05, a + 0.05), NEAR, 1, 2)
                  for ms, a in ((1.0, 0.7), (2.0, 0.895), (8.0, 0.9)))  # fmt: skip
    curves = tuple(Curve("touch", "s", (0.1, 1.0, 5.0), (NEAR,) * 3, ("0.1", "1", "whole"), name)
                   for name in ("linear discriminants", HOSTILE))  # fmt: skip
    return Tradeoff(
        FACTS, "texclass", "recording, 2 x 2 folds",
        (FeatureCost("mfcc", 3.0, 5.0, 2.0), FeatureCost(HOSTILE, 1.0, 2.0, 0.5)), {"fft": 2.0}, 4.0, 8.0,
        ((2.0, 2.1),), (ClassifierCost("lda", 1.0, 0.1),), NEAR, front, ((1, NEAR), (2, NEAR)), curves,
        Chosen("knee", ("mfcc.c1",), ("mfcc",), 2.0, 2.2, NEAR), **AGAIN,
    )  # fmt: skip


def peers() -> PeerComparison:
    """Ours, a peer that finished, and one that did not run."""
    cost = Cost(4.0, 0.01, 0.1, 0.4, 2.0, 0.02)
    ours = Contestant("All", "lda", "All", True, "done", n_columns=4, n_folds=2, accuracy=Accuracy(95, 100),
                      cost=cost)  # fmt: skip
    peer = Contestant("rocket", "ridge", HOSTILE, False, "done", n_columns=9, n_folds=2,
                      accuracy=Accuracy(90, 100), cost=cost, difference=PAIRED)  # fmt: skip
    absent = Contestant("tsfel", "", "TSFEL", False, "not installed", message="needs tsfel")
    return PeerComparison(
        FACTS, "texclass", "beef", "blocks", "first half trains", 2, (ours, peer, absent), "ours", 60.0,
        peer_versions={"aeon": "1"}, **AGAIN,
    )  # fmt: skip


def invariance() -> dict[str, Any]:
    """Two features; one is undefined under one condition."""
    row = {"set": "texclass", "origin": "texclass", "feature": "mfcc", "trend": 0.2}
    other = {"set": "strese2015", "origin": "related work", "feature": HOSTILE, "trend": None}
    return {
        "versions": {"texclass": "1"}, "seed": 1,
        "rows": [
            row | {"condition": "speed", "ratio": 2.0}, row | {"condition": "force", "ratio": 3.0},
            other | {"condition": "speed", "ratio": 0.5}, other | {"condition": "force", "ratio": None},
        ],
    }  # fmt: skip


def stability() -> StabilityResult:
    """Ours right on every input, and a public library that is not."""
    names = ["library", "group", "subject", "family", "case", "mark", "error", "limit", "what", "reason"]
    about = ("models", "fit", "plain", "noise")
    cells = [
        ("texclass", *about, Mark.EXACT, 1e-12, 1e-9, "", ""),
        ("texclass", "features", HOSTILE, "silent", "zeros", Mark.DOCUMENTED, None, None, "", "silence"),
        ("librosa", *about, Mark.WRONG, 1.0, 1e-9, "", HOSTILE),
        ("librosa", *about, Mark.EXACT, 1e-12, 1e-9, "", ""),
    ]
    found = pd.DataFrame(cells, columns=names)
    return StabilityResult(found, True, {"texclass": "1"}, "cafe", 1.0, left_out=("tsfel: not installed",))


def write_all(folder: Path) -> list[Path]:
    """Write one result of every kind."""
    documents = {
        "benchmark": benchmark().to_dict(), "feature": feature(), "tradeoff": tradeoff().to_dict(),
        "peers": peers().to_dict(), "invariance": invariance(), "stability": stability().to_dict(),
    }  # fmt: skip
    for name, document in documents.items():
        (folder / f"{name}.json").write_text(json.dumps(document))
    return [folder / f"{name}.json" for name in documents]


__all__ = ["HOSTILE", "benchmark", "feature", "invariance", "peers", "stability", "tradeoff", "write_all"]
