"""The worker of a baseline: files, extractors, measurements."""

import ast
import sys
import warnings
from importlib.util import find_spec
from mmap import mmap
from pathlib import Path

import numpy as np
import pytest

from texclass import baselines
from texclass.baselines.baseline_worker.baselines import (
    BASELINES,
    CLASSIFIERS,
    CountScaler,
    EqualLength,
    PerRecording,
    equal_lengths,
)
from texclass.baselines.baseline_worker.run import main, read_task, timed, watch_memory, write_task
from texclass.baselines.worker_process import read_outcome, run_worker

SPLITS = ((np.arange(0, 18), np.arange(18, 24)), (np.arange(6, 24), np.arange(0, 6)))


@pytest.fixture
def signals():
    rng = np.random.default_rng(0)
    return [
        np.stack([np.convolve(rng.normal(size=600 + i), np.ones(1 + 5 * (i % 2)), mode="same")] * 2)
        for i in range(24)
    ]


@pytest.fixture
def task(tmp_path, signals):
    write_task(tmp_path / "task", iter(signals), np.arange(24) % 2, SPLITS, 1000.0, 5)
    return tmp_path / "task"


def test_what_is_written_is_read(task, signals):
    worker_outcome = read_task(task)
    assert (worker_outcome.fs, worker_outcome.seed, len(worker_outcome.signals)) == (1000.0, 5, 24)
    for one, other in zip(worker_outcome.signals, signals, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(worker_outcome.select(np.array([7, 3]))[1], signals[3])
    np.testing.assert_array_equal(worker_outcome.signals[2:4][0], signals[2])
    for (train, test), (a, b) in zip(worker_outcome.splits, SPLITS, strict=True):
        np.testing.assert_array_equal(train, a)
        np.testing.assert_array_equal(test, b)


def test_worker_files_import_only_numpy_and_scikit_learn_before_a_baseline_is_asked():
    for file in (Path(baselines.__file__).parent / "baseline_worker").glob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        at_start = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        every = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
        assert roots(at_start) <= {"numpy", "sklearn", *sys.stdlib_module_names}
        assert "texclass" not in roots(every)


def roots(imports):
    """Return what is imported from outside the worker's folder."""
    names = [
        name
        for node in imports
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names])
        if not getattr(node, "level", 0)
    ]
    return {name.split(".")[0] for name in names}


def test_equal_lengths_crop_the_middle_and_pad_with_zeros():
    long, short = np.arange(9.0)[None], np.ones((1, 3))
    worker_outcome = equal_lengths([long, short], 5)
    assert worker_outcome[0, 0].tolist() == [2, 3, 4, 5, 6]
    assert worker_outcome[1, 0].tolist() == [1, 1, 1, 0, 0]
    assert EqualLength(list, list).fit([long, short, short]).n_samples == 3


def test_channels_are_described_apart_and_what_is_not_finite_takes_the_training_median():
    extractor = PerRecording(lambda x, fs: np.array([x.sum(), np.inf if x[0] > 2 else fs]), 10.0)
    table = extractor.transform([np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[1.0, 1.0], [2.0, 2.0]])])
    np.testing.assert_array_equal(table, [[3, 10, 7, np.nan], [2, 10, 4, 10]])
    assert np.isfinite(extractor.scaler().fit(table).transform(table)).all()


def test_count_scaler_standardises_roots_and_leaves_zeros():
    rng = np.random.default_rng(1)
    counts = rng.integers(1, 50, size=(200, 3)).astype(float)
    counts[:, 2] = 0
    counts[:20, 2] = 4
    scaled = CountScaler().fit(counts).transform(counts)
    assert np.abs(scaled[:, :2].mean(axis=0)).max() < 1e-5
    np.testing.assert_allclose(scaled[:, :2].std(axis=0, ddof=1), 1, rtol=1e-6)
    assert not scaled[20:, 2].any()


def test_a_system_that_tells_no_memory_gives_none(monkeypatch, tmp_path):
    for name in ("STATUS", "RESET"):
        monkeypatch.setattr(f"texclass.baselines.baseline_worker.run.{name}", tmp_path / "proc" / name)
    monkeypatch.setitem(sys.modules, "resource", None)  # Windows has none
    assert watch_memory()() == 0


def test_memory_that_came_and_went_and_the_time_of_this_process_are_measured():
    megabytes = watch_memory()
    with mmap(-1, 40 * 2**20) as grown:  # new pages: an array may be put where a freed one was
        for page in range(0, len(grown), 4096):
            grown[page] = 1
    assert 35 < megabytes() < 120
    worker_outcome, seconds = timed(lambda: np.linalg.svd(np.random.default_rng(0).normal(size=(200, 200))))
    assert 0 < seconds < 20
    assert worker_outcome.S.shape == (200,)


def test_mfcc_tells_two_noises_apart_in_an_interpreter_of_its_own(task, tmp_path):
    assert {name for baseline in BASELINES.values() for name in baseline.classifiers} <= set(CLASSIFIERS)
    outcome = run_worker(Path(sys.executable), task, "mfcc", tmp_path / "out", 120.0)
    assert (outcome["status"], len(outcome["folds"])) == ("done", 2)
    assert {"librosa", "numpy", "scikit-learn"} <= set(outcome["versions"])
    assert set(outcome["folds"][0]["classifiers"]) == set(BASELINES["mfcc"].classifiers)
    assert outcome["folds"][0]["n_columns"] == 26
    for fold, (_, test) in zip(outcome["folds"], SPLITS, strict=True):
        assert fold["classifiers"]["shrinkage_lda"]["predicted"] == (test % 2).tolist()


@pytest.mark.skipif(find_spec("aeon") is None, reason="aeon is not installed (extra `baselines`)")
def test_minirocket_tells_two_noises_apart(task, tmp_path):
    outcome = run_worker(Path(sys.executable), task, "minirocket", tmp_path / "out", 300.0)
    assert outcome["status"] == "done", outcome["message"]
    assert outcome["folds"][0]["classifiers"]["ridge"]["predicted"] == (SPLITS[0][1] % 2).tolist()


@pytest.mark.skipif(find_spec("pycatch22") is not None, reason="pycatch22 is installed")
def test_a_baseline_that_is_not_there_is_reported_as_not_installed(task, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["-c", str(task), "catch22", str(tmp_path)])
    with warnings.catch_warnings():
        assert main() == 1
    outcome = read_outcome(tmp_path, expired=False, time_limit_s=60.0)
    message = ("not installed", "needs pycatch22", [])
    assert (outcome["status"], outcome["message"], outcome["folds"]) == message


def test_no_such_interpreter_is_a_bad_input(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere/python.*Expected the path of a Python interpreter"):
        run_worker(Path("nowhere/python"), tmp_path, "mfcc", tmp_path / "out", 1.0)
