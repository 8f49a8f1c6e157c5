"""Parallel execution: on processes of this machine, or on a Dask cluster."""

import atexit
import ctypes
import functools
import gc
import importlib
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
from typing import Any, Literal, TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
from joblib.externals.loky import BrokenProcessPool, ProcessPoolExecutor
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

R = TypeVar("R")
Backend = Literal["local", "dask"]
Progress = Callable[[int, int, str], None]
"""Callback of a progress bar: (number of calls done, total number, name of the stage)."""
_cluster: ContextVar[Any] = ContextVar("cluster", default=None)


def begin_worker() -> None:
    """Configure a worker process to collect garbage rarely and to keep freed memory for reuse.

    Rare garbage collection reduces the time to import and unload the libraries of a benchmark by a third.
    Reusing freed memory reduces the time per recording by a tenth.
    """
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
    with suppress(AttributeError, OSError, TypeError):  # C libraries other than glibc have no mallopt
        m_top_pad = -2  # M_TOP_PAD of malloc.h: extra bytes to request, and to keep when memory is freed
        ctypes.CDLL(None).mallopt(m_top_pad, 1 << 26)


BATCH_S = 0.1
"""Computing time in s that a batch of calls aims at. Sending a batch takes about 1 ms."""
N_BATCHES = 2
"""Number of batches that each worker process has, so that it always has one to continue with."""


@contextmanager
def use_backend(backend: Backend, scheduler: str | None = None) -> Iterator[None]:
    """Context manager that makes every `run_parallel` in its block use this backend.

    Parameters
    ----------
    backend : {"local", "dask"}
        "local" starts processes on this machine. "dask" sends the work to a cluster and
        requires the optional dependencies `distributed`. The workers of the cluster must find the same files
        under the same paths.
    scheduler : str, optional
        Address of the Dask scheduler, for example tcp://host:8786 (default: the environment
        variable DASK_SCHEDULER_ADDRESS, or a new cluster of processes on this machine if it is not set).

    Raises
    ------
    ValueError
        If `backend` is unknown, or "local" is combined with a scheduler.
    ModuleNotFoundError
        If Dask is not installed.
    OSError
        If the scheduler does not respond.

    Examples
    --------
    >>> from functools import partial
    >>> with use_backend("local"):
    ...     print(list(run_parallel([partial(pow, i, 2) for i in range(4)])))
    [0, 1, 4, 9]
    """
    if backend not in ("local", "dask") or (backend == "local" and scheduler):
        raise ValueError(
            f"backend must be 'dask', or 'local' without a scheduler, got backend {backend!r} and scheduler "
            f"{scheduler!r}"
        )
    if backend == "local":
        yield
        return
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"backend 'dask' needs {error.name}, which is not installed. Run `pip install "
            "'texclass[distributed]'`"
        ) from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        token = _cluster.set(client)
        try:
            yield
        finally:
            _cluster.reset(token)


def run_parallel(
    calls: Iterable[Callable[[], R]],
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
    stage: str = "",
    done: int = 0,
    total: int = 0,
    local_s: float = 0.0,
) -> Generator[R, None, None]:
    """Run calls in parallel, and yield each result in order as soon as it is available.

    If a worker of a cluster fails, its calls run on another worker. Closing the generator stops the work.

    Parameters
    ----------
    calls : iterable of callable
        Picklable functions without arguments, such as partials of module-level functions. Each uses one
        thread for linear algebra.
    n_jobs : int
        Number of processes on this machine, including this process (default 1; -1: one per core). A cluster
        always uses all of its workers.
    progress : callable, optional
        Function called after each result with (done, total, stage).
    stage : str
        Name of the stage, for `progress`.
    done, total : int
        Number of calls finished before this function was called, and total number of calls, for `progress`.
    local_s : float
        CPU time in s that this process spends on the calls before it starts other processes (default 0).
        Short work is finished before other processes could import their libraries.

    Examples
    --------
    >>> from functools import partial
    >>> list(run_parallel([partial(pow, i, 2) for i in range(4)]))
    [0, 1, 4, 9]
    """
    with closing(_results(iter(calls), n_jobs, time.process_time() + local_s)) as results:
        for number, result in enumerate(results, start=done + 1):
            if progress is not None:
                progress(number, total, stage)
            yield result


def _results(calls: Iterator[Callable[[], R]], n_jobs: int, limit_s: float) -> Generator[R, None, None]:
    while time.process_time() < limit_s:
        if (call := next(calls, None)) is None:
            return
        yield _single_threaded(call)
    cluster = _cluster.get()
    if cluster is None:
        yield from _local_results(calls, _n_workers(n_jobs))
        return
    with parallel_config(backend="dask", client=cluster), warnings.catch_warnings():
        # joblib warns when a generator is closed early, but a bad recording closes it on purpose.
        warnings.filterwarnings("ignore", message=".*tasks.*", category=UserWarning)
        tasks = (delayed(_single_threaded)(call) for call in calls)
        with closing(Parallel(n_jobs=-1, return_as="generator")(tasks)) as results:
            yield from results


def _local_results(calls: Iterator[Callable[[], R]], n_workers: int) -> Generator[R, None, None]:
    """Yield the results in order. While all worker processes have batches, this process runs calls, too."""
    numbered = enumerate(calls)
    pending: dict[Future[tuple[float, list[R]]], list[int]] = {}
    results: dict[int, R] = {}
    n_yielded, size = 0, 1
    try:
        while True:
            while len(pending) < N_BATCHES * n_workers and (batch := list(islice(numbered, size))):
                future = _submit(n_workers, _run_batch, [call for _, call in batch])
                pending[future] = [number for number, _ in batch]
            if (item := next(numbered, None)) is not None:
                results[item[0]] = _single_threaded(item[1])
            elif pending:
                wait(pending, return_when=FIRST_COMPLETED)
            elif not results:
                return
            for future in [future for future in pending if future.done()]:
                seconds, values = future.result()
                results.update(zip(pending.pop(future), values, strict=True))
                size = max(1, min(2 * size, round(len(values) * BATCH_S / max(seconds, 1e-6))))
            while n_yielded in results:
                yield results.pop(n_yielded)
                n_yielded += 1
    finally:
        if pending:  # closed early, or a process has failed
            _executor(n_workers).shutdown(kill_workers=True)
            _executor.cache_clear()


def _run_batch(calls: list[Callable[[], R]]) -> tuple[float, list[R]]:
    """Return the computing time in s and the results of calls."""
    start = time.perf_counter()
    results = [_single_threaded(call) for call in calls]
    return time.perf_counter() - start, results


def _n_workers(n_jobs: int) -> int:
    """Return the number of processes in addition to this process."""
    if n_jobs == 0:
        raise ValueError("n_jobs must be a positive number of processes, or -1 for one per core, got 0")
    return (n_jobs if n_jobs > 0 else max(1, cpu_count() + 1 + n_jobs)) - 1


def _submit(n_workers: int, function: Callable[..., R], *arguments: Any) -> "Future[R]":
    """Submit a call to worker processes; replace them if one of them has ended since the last call."""
    try:
        future: Future[R] = _executor(n_workers).submit(function, *arguments)
    except BrokenProcessPool:
        _executor.cache_clear()
        future = _executor(n_workers).submit(function, *arguments)
    return future


@functools.cache
def _executor(n_workers: int) -> Any:
    """Return worker processes, which are reused for 300 s. Each uses one thread.

    They are not those of joblib's `Parallel`, which accepts only processes that it has started.
    """
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return ProcessPoolExecutor(n_workers, timeout=300, initializer=begin_worker, env=threads)


def begin_loading(n_jobs: int, *modules: str) -> "list[Future[None]]":
    """Start worker processes, and import modules in them, while this process continues.

    Parameters
    ----------
    n_jobs : int
        Number of processes. `run_parallel` with the same number reuses them.
    *modules : str
        Modules to import in this order.

    Returns
    -------
    list of Future
        One future per worker process, done when it has imported the modules.
    """
    n_workers = 0 if _cluster.get() is not None else _n_workers(n_jobs)
    return [_submit(n_workers, _import, modules) for _ in range(n_workers)]


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        importlib.import_module(module)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit numerical libraries to one thread in the block, because more threads slow down short work."""
    with _libraries().limit(limits=1):
        yield


def _single_threaded(call: Callable[[], R]) -> R:
    with one_thread():
        return call()


@functools.cache
def _libraries() -> Any:
    """Return the thread pool controller. It is cached, because finding the libraries takes long."""
    return ThreadpoolController()
