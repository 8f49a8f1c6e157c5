"""Parallel execution on processes and on a cluster: order, one thread per process, failing workers."""

import ctypes
import gc
import json
import mmap
import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest
from joblib import Parallel, delayed
from threadpoolctl import threadpool_info

from texclass.evaluation import workers
from texclass.evaluation.checkpoints import write_checkpoint
from texclass.evaluation.feature_table import extract_partitions, extract_table
from texclass.evaluation.workers import begin_loading, run_parallel, use_backend
from texclass.features import load_feature_set
from texclass.features.plan import Plan
from texclass.loaders import open_dataset


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Give the address of a real scheduler, and its two worker processes."""
    distributed = pytest.importorskip("distributed")
    folder, quiet = tmp_path_factory.mktemp("cluster"), subprocess.DEVNULL

    def start(what, *options):
        command = [sys.executable, "-m", "dask", what, "--scheduler-file", "s.json", "--no-dashboard"]
        return subprocess.Popen([*command, *options], cwd=folder, stdout=quiet, stderr=quiet)

    processes = [start("scheduler", "--port", "0")]
    processes += [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
    try:
        with distributed.Client(scheduler_file=folder / "s.json", timeout="60s") as client:
            client.wait_for_workers(2, timeout=60)
        yield json.loads((folder / "s.json").read_text())["address"], processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_run_parallel_keeps_the_order_reports_progress_and_stops_when_closed():
    calls, progress_calls = [partial(pow, i, 2) for i in range(20)], []
    results = run_parallel(
        calls, n_jobs=2, progress=lambda *call: progress_calls.append(call), stage="squares", done=5, total=25
    )
    assert list(results) == [i * i for i in range(20)]
    assert progress_calls == [(n, 25, "squares") for n in range(6, 26)]
    outcomes = run_parallel(partial(pow, i, 2) for i in range(10**6))
    assert next(outcomes) == 0
    outcomes.close()


def test_closing_the_results_of_two_processes_stops_the_work(tmp_path):
    calls = (
        partial(eval, f"__import__('pathlib').Path({str(tmp_path / str(i))!r}).touch()") for i in range(10**6)
    )
    results = run_parallel(calls, n_jobs=2)
    for _ in range(50):
        next(results)
    results.close()
    n_files = len(list(tmp_path.iterdir()))
    assert 50 <= n_files < 10**5
    time.sleep(0.3)
    assert len(list(tmp_path.iterdir())) == n_files


def test_an_error_in_a_worker_is_raised_here_and_zero_processes_are_refused():
    with pytest.raises(ZeroDivisionError):
        list(run_parallel([partial(divmod, 1, 0)], n_jobs=2))
    assert list(run_parallel([partial(pow, 3, 2)] * 3, n_jobs=2)) == [9, 9, 9]
    with pytest.raises(ValueError, match="n_jobs must be"):
        list(run_parallel([partial(pow, 3, 2)], n_jobs=0))


def test_a_worker_that_dies_while_idle_is_replaced():
    (pid,) = run_parallel([partial(os.getpid)], n_jobs=2)
    os.kill(pid, signal.SIGKILL)
    time.sleep(0.5)
    (other_pid,) = run_parallel([partial(os.getpid)], n_jobs=2)
    assert other_pid not in (pid, os.getpid())


def test_a_worker_that_dies_at_work_is_an_error_and_the_next_work_is_done():
    with pytest.raises(RuntimeError, match="terminated"):
        list(run_parallel([partial(os._exit, 1)], n_jobs=2))
    assert list(run_parallel([partial(pow, 3, 2)] * 3, n_jobs=2)) == [9, 9, 9]


def test_joblib_and_these_processes_can_be_used_in_turn():
    for _ in range(2):
        assert list(run_parallel([partial(pow, 3, 2)] * 3, n_jobs=2)) == [9, 9, 9]
        assert Parallel(n_jobs=2)(delayed(pow)(3, 2) for _ in range(3)) == [9, 9, 9]


def test_calls_that_last_unequally_keep_their_order_in_batches():
    calls = [partial(eval, f"__import__('time').sleep({0.02 * (i % 7 == 0)}) or {i}") for i in range(300)]
    assert list(run_parallel(iter(calls), n_jobs=3)) == list(range(300))


def test_each_worker_uses_one_thread():
    results = list(run_parallel([partial(threadpool_info)] * 4, n_jobs=2))
    assert all(pool["num_threads"] == 1 for pools in results for pool in pools)


def test_what_is_done_soon_is_done_here_and_the_rest_by_others():
    calls = [partial(os.getpid)] * 4
    assert set(run_parallel(calls, n_jobs=2, local_s=60.0)) == {os.getpid()}
    slow_answer = partial(eval, "__import__('time').sleep(0.05) or __import__('os').getpid()")
    assert len(set(run_parallel([slow_answer] * 60, n_jobs=2))) == 2
    assert os.getpid() in set(run_parallel([slow_answer] * 60, n_jobs=2))
    progress_calls, spend = (
        [],
        "import time\nend = time.process_time() + 0.2\nwhile time.process_time() < end: pass",
    )
    first, *others = [partial(exec, spend), *calls]
    results = run_parallel(
        [first, *others], n_jobs=2, local_s=0.1, progress=lambda *call: progress_calls.append(call), total=5
    )
    assert len(list(results)) == 5
    assert [done for done, *_ in progress_calls] == [1, 2, 3, 4, 5]


def test_workers_import_modules_before_there_is_work_and_features_need_no_scikit_learn(tmp_path):
    assert begin_loading(1) == []
    workers._executor.cache_clear()  # workers of other tests may have loaded it
    (loading,) = begin_loading(2, "texclass.evaluation.checkpoints")
    assert loading.result(timeout=120) is None
    is_loaded = "'texclass.evaluation.checkpoints' in __import__('sys').modules"
    (worker_answer,) = run_parallel([partial(eval, is_loaded)], n_jobs=2)  # the first call runs in a worker
    assert worker_answer
    dataset, features = open_dataset("simulated"), load_feature_set("strese2015")
    call = partial(
        write_checkpoint, dataset.load, dataset.entries[:1], Plan.of(features, ()), tmp_path / "part"
    )
    (tmp_path / "call").write_bytes(pickle.dumps(call))
    code = (
        f"import pickle, sys\nprint(pickle.load(open({str(tmp_path / 'call')!r}, 'rb'))())\n"
        "print([m for m in ('sklearn', 'pandas', 'pyarrow', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["None", "[]"]
    assert (tmp_path / "part").stat().st_size > 0


def test_a_worker_seldom_looks_for_garbage_and_its_caller_as_before():
    before = gc.get_threshold()
    (threshold,) = run_parallel([partial(gc.get_threshold)], n_jobs=2)
    assert threshold[0] >= 100_000  # 700 as Python starts
    assert list(run_parallel([partial(gc.get_threshold)])) == [before] == [gc.get_threshold()]


def faults_of_arrays_made_again():
    """Return how many pages are taken anew where arrays follow others of their size that are gone."""
    import resource

    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        arrays = [np.ones(200_000) for _ in range(10)]
        durations = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
        del arrays
    return durations


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="a C library without mallopt")
def test_a_worker_keeps_the_memory_of_the_last_recording_for_the_next():
    pages = 10 * 200_000 * 8 / mmap.PAGESIZE
    workers._executor.cache_clear()  # those of other tests may have divided their memory
    (faults,) = run_parallel([faults_of_arrays_made_again], n_jobs=2)
    assert faults < 0.05 * pages


def test_a_cluster_gives_the_same_table_even_if_a_worker_is_killed_on_the_way(cluster, tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    for i in range(32):
        (tmp_path / f"m{i % 2}").mkdir(exist_ok=True)
        np.savetxt(tmp_path / f"m{i % 2}" / f"{i}.txt", np.random.default_rng(i).normal(size=2000))
    dataset, features = open_dataset(tmp_path, fs=1000.0, unit="g"), load_feature_set("strese2015")
    features = features.restricted_to(["variance", "hardness", "friction"])
    here, (address, workers) = extract_table(dataset, features, tmp_path / "here.npz"), cluster

    def kill_one(n_done, n_all, what):
        if n_done == 3:
            workers[0].kill()

    with use_backend("dask", address):
        there = extract_table(dataset, features, tmp_path / "there.npz", progress=kill_one)
        extract_partitions(dataset, features, tmp_path / "parts", 3)
    assert workers[0].wait() == -signal.SIGKILL
    parts = pd.concat(map(pd.read_csv, sorted((tmp_path / "parts").iterdir())), ignore_index=True)
    np.testing.assert_array_equal(parts[list(here.columns)], here.values)
    pd.testing.assert_frame_equal(there.frame, here.frame, check_exact=True)
    assert there.reasons == here.reasons
    assert list(run_parallel([partial(os.getpid)])) == [os.getpid()]  # here again


def test_a_scheduler_that_does_not_answer_and_an_impossible_backend_are_refused():
    for backend, address in (("local", "tcp://127.0.0.1:8786"), ("spark", None)):
        with pytest.raises(ValueError, match=backend), use_backend(backend, address):
            pass
    pytest.importorskip("distributed")
    import dask

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        pytest.raises(OSError, match=r"127\.0\.0\.1:9"),
        use_backend("dask", "tcp://127.0.0.1:9"),
    ):
        pass
