"""Parallel execution: on processes of this machine, or on a Dask cluster."""

import atexit
import ctypes
import functools
import gc
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from threading import Thread
from typing import Any, Literal, TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
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


PROCESSES: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1, "initializer": begin_worker}
"""Settings of joblib for processes of this machine. Processes with equal settings are reused."""


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
        Number of processes on this machine (default 1; -1: one per core). A cluster always uses all of its
        workers.
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
    config = PROCESSES
    if cluster is not None:
        config, n_jobs = {"backend": "dask", "client": cluster}, -1
    with parallel_config(**config), warnings.catch_warnings():
        # joblib warns when a generator is closed early, but a bad recording closes it on purpose.
        warnings.filterwarnings("ignore", message=".*tasks.*", category=UserWarning)
        tasks = (delayed(_single_threaded)(call) for call in calls)
        with closing(Parallel(n_jobs=n_jobs, return_as="generator")(tasks)) as results:
            yield from results


def begin_loading(n_jobs: int) -> Thread | None:
    """Start worker processes in the background, and import the feature modules in them.

    Parameters
    ----------
    n_jobs : int
        Number of processes. `run_parallel` with the same number reuses them.

    Returns
    -------
    Thread or None
        Thread that ends when the modules are imported, or None if no other process is used.
    """
    if n_jobs in (0, 1) or _cluster.get() is not None:
        return None
    n_processes = n_jobs if n_jobs > 0 else cpu_count()

    def import_in_workers() -> None:
        with parallel_config(**PROCESSES):  # no `catch_warnings` here, because it is not thread-safe
            Parallel(n_jobs=n_processes)([delayed(_import_features)()] * n_processes)

    thread = Thread(target=import_in_workers, daemon=True)
    thread.start()
    return thread


def _import_features() -> None:
    import texclass.evaluation.checkpoints  # noqa: F401


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
