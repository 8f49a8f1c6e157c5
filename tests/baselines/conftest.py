"""A small dataset on disk, its benchmark, and fake interpreters of baselines."""

import stat
import sys

import numpy as np
import pytest

from texclass.baselines import worker_process
from texclass.evaluation import load_pipeline, run_benchmark
from texclass.evaluation.pipeline import FoldSettings
from texclass.loaders import open_dataset

FAKE = """#!{python}
import json, signal, sys
from pathlib import Path
import numpy as np
task, baseline, out = (Path(a) for a in sys.argv[4:7])
layout = np.load(task / "layout.npz")
def write(name, content):
    (out / name).write_text(json.dumps(content))
def fold(k, shift=0):
    predicted = (layout["labels"][layout[f"test_{{k}}"]] + shift) % 3
    ran = dict(fit_s=0.5, predict_s=0.001, predicted=predicted.tolist())
    every = {{name: ran for name in {classifiers}}}
    write(f"fold_{{k}}.json", dict(n_columns=7, feature_s=0.002, memory_mb=3.0, classifiers=every))
write("started.json", dict(first_s=9.0, versions={{"fake": "1.0"}}))
behaviour = {behaviours}.get(baseline.name, {behaviour!r})
if behaviour == "absent":
    write("failed.json", dict(missing=True, message="needs aeon"))
    sys.exit(1)
if behaviour == "crash":
    sys.exit("Killed by its own hand")
fold(0, behaviour == "first fold wrong")
fold(1)
if behaviour == "slow":
    signal.pause()
fold(2)
fold(3)
write("done.json", {{}})
"""
CLASSIFIERS = ("lda", "shrinkage_lda", "random_forest", "naive_bayes", "ridge", "extra_trees")


@pytest.fixture(scope="session")
def interpreter(tmp_path_factory):
    """Make an executable that behaves like an interpreter whose baselines do as told."""

    def make(behaviour="perfect", **behaviours):
        path = tmp_path_factory.mktemp("fake") / "python"
        facts = {"classifiers": CLASSIFIERS, "behaviour": behaviour, "behaviours": behaviours}
        path.write_text(FAKE.format(python=sys.executable, **facts))
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    return make


@pytest.fixture
def ours_here(monkeypatch):
    """Time our rows in this process: starting another takes longer than all they do."""
    monkeypatch.setattr(worker_process, "run_parallel", lambda calls, n_jobs: (call() for call in calls))


@pytest.fixture(scope="session")
def noises(tmp_path_factory):
    """Three surfaces of coloured noise, four recordings each, all movement."""
    root = tmp_path_factory.mktemp("noises")
    rng = np.random.default_rng(3)
    for i, surface in enumerate(("felt", "oak", "tile")):
        (root / surface).mkdir()
        for k in range(4):
            smooth = np.convolve(rng.normal(size=3000), np.ones(1 + 4 * i), mode="same")
            np.savetxt(root / surface / f"{surface}_{k}.txt", smooth)
    return root


@pytest.fixture(scope="session")
def bench(noises, tmp_path_factory):
    """Dataset, pipeline of two rows, and what the benchmark found."""
    dataset = open_dataset(str(noises), fs=1000.0, unit="m/s^2")
    pipeline = load_pipeline("strese2015")
    names = ("Modified MFCC, Constant Mel Filter Bank", "Standard Roughness")
    rows = tuple(r for r in pipeline.rows if r.name in names)
    pipeline = pipeline.model_copy(update={"rows": rows, "protocol": FoldSettings(folds=4)})
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_CACHE", str(tmp_path_factory.mktemp("cache")))
        return dataset, pipeline, run_benchmark(dataset, pipeline, nested_cv=False)
