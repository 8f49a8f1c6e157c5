import json
import os
import signal
import subprocess
import sys
from functools import partial
from types import SimpleNamespace

import pandas as pd
import pytest
from threadpoolctl import threadpool_info

from texclass.experiment.feature_table import extract_table
from texclass.experiment.workers import each, running_on
from texclass.features import load_feature_set
from texclass.loaders import open_dataset

TINY = """
title = "Three simulated surfaces"
format = "simulated"
[recipe]
n_surfaces = 3
n_recordings = 4
n_operators = 2
duration_s = 4.0
fs = 10000
seed = 11
"""


def square(i):
    return i * i, os.getpid()


def count_threads():
    return [pool["num_threads"] for pool in threadpool_info()]


def start(folder, *what):
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *what, "--no-dashboard"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Give a real scheduler and its two worker processes."""
    distributed = pytest.importorskip("distributed")
    folder = tmp_path_factory.mktemp("cluster")
    processes = [start(folder, "scheduler", "--scheduler-file", "s.json", "--port", "0")]
    processes += [
        start(folder, "worker", "--scheduler-file", "s.json", "--nthreads", "1", "--no-nanny")
        for _ in range(2)
    ]
    try:
        with distributed.Client(scheduler_file=folder / "s.json", timeout="60s") as client:
            client.wait_for_workers(2, timeout=60)
        yield SimpleNamespace(
            scheduler=json.loads((folder / "s.json").read_text())["address"], workers=processes[1:]
        )
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_each_keeps_the_order_and_closing_it_stops_the_work():
    assert [v for v, _ in each([partial(square, i) for i in range(20)], n_jobs=2)] == [
        i * i for i in range(20)
    ]
    outcomes = each([partial(square, i) for i in range(10**5)])
    assert next(outcomes)[0] == 0
    outcomes.close()


def test_each_worker_uses_one_thread():
    assert all(n == 1 for pools in each([partial(count_threads)] * 4, n_jobs=2) for n in pools)


def test_a_cluster_gives_the_same_table_even_if_a_worker_is_killed_half_way(cluster, tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    (tmp_path / "tiny.toml").write_text(TINY)
    dataset, features = open_dataset(tmp_path / "tiny.toml"), load_feature_set("texclass")
    here = extract_table(dataset, features, tmp_path / "here.parquet")

    def kill_one(n_done, n_all, what):
        if n_done == n_all // 2:
            cluster.workers[0].kill()

    with running_on("dask", cluster.scheduler):
        there = extract_table(dataset, features, tmp_path / "there.parquet", progress=kill_one)
    assert cluster.workers[0].wait() == -signal.SIGKILL
    pd.testing.assert_frame_equal(there.frame, here.frame, check_exact=True)
    assert there.reasons == here.reasons


def test_after_a_cluster_work_runs_here_again(cluster):
    with running_on("dask", cluster.scheduler):
        pass
    assert [process for _, process in each([partial(square, i) for i in range(2)])] == [os.getpid()] * 2


def test_a_scheduler_that_does_not_answer_is_an_error():
    pytest.importorskip("distributed")
    import dask

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(OSError, match=r"127\.0\.0\.1:9"),
        running_on("dask", "tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.parametrize(("backend", "address"), [("local", "tcp://127.0.0.1:8786"), ("spark", None)])
def test_an_impossible_backend_is_refused(backend, address):
    with pytest.raises(ValueError, match=backend), running_on(backend, address):
        pass
