"""Where independent work runs: processes of this machine, or a Dask cluster."""

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
"""Called with what is done, out of how many, and what is being done."""
_cluster: ContextVar[Any] = ContextVar("cluster", default=None)


def begin_worker() -> None:
    """Let this process serve: it keeps memory that was given back, and looks for garbage seldom.

    Loading and ending the libraries of a benchmark takes two thirds of the time if nobody looks through their
    modules, and a recording nine tenths if its arrays come to be where those of the last one were.
    """
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
    with suppress(AttributeError, OSError, TypeError):  # a C library without it
        m_top_pad = -2  # malloc.h: memory beyond what is asked for that is taken, and kept when it is free
        ctypes.CDLL(None).mallopt(m_top_pad, 1 << 26)


PROCESSES: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1, "initializer": begin_worker}
"""What joblib is told of processes of this machine: those of equal settings are used again."""


@contextmanager
def running_on(backend: Backend, scheduler: str | None = None) -> Iterator[None]:
    """Run every `each` inside on this backend.

    Parameters
    ----------
    backend : {"local", "dask"}
        "local" starts processes here; "dask" hands the work to a cluster (extra `distributed`) whose workers
        see the same files under the same paths.
    scheduler : str, optional
        Address of the Dask scheduler (tcp://host:8786). By default the one Dask is configured for
        (DASK_SCHEDULER_ADDRESS), else a cluster of processes on this machine.

    Raises
    ------
    ValueError
        If `backend` is neither, or a scheduler is named for processes of this machine.
    ModuleNotFoundError
        If Dask is not installed.
    OSError
        If no scheduler answers.
    """
    if backend not in ("local", "dask") or (backend == "local" and scheduler):
        raise ValueError(
            f"backend is {backend!r} and scheduler {scheduler!r}. Expected 'local' without, or 'dask'"
        )
    if backend == "local":
        yield
        return
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"backend 'dask' needs {error.name}, which is not installed; install texclass[distributed]"
        ) from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        token = _cluster.set(client)
        try:
            yield
        finally:
            _cluster.reset(token)


def each(
    calls: Iterable[Callable[[], R]],
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
    what: str = "",
    done: int = 0,
    total: int = 0,
    here_s: float = 0.0,
) -> Generator[R, None, None]:
    """Yield the result of every call, in their order, as the results come.

    A worker of a cluster that dies has its work done again elsewhere. Closing the generator stops the work.

    Parameters
    ----------
    calls : iterable of callable
        Partials of functions of module level; each uses one thread for linear algebra.
    n_jobs : int
        Processes of this machine, -1 for one a core; a cluster uses all its workers.
    progress : callable, optional
        Called after each result with (done, total, what).
    what : str
        What they do.
    done, total : int
        How many were done before these, and how many there are then, for `progress`.
    here_s : float
        CPU seconds that this process works itself before it hands on the rest: what is done by then is not
        worth loading in other processes what it needs.
    """
    with closing(_outcomes(iter(calls), n_jobs, time.process_time() + here_s)) as outcomes:
        for number, outcome in enumerate(outcomes, start=done + 1):
            if progress is not None:
                progress(number, total, what)
            yield outcome


def _outcomes(calls: Iterator[Callable[[], R]], n_jobs: int, limit_s: float) -> Generator[R, None, None]:
    while time.process_time() < limit_s:
        if (call := next(calls, None)) is None:
            return
        yield _single_threaded(call)
    cluster = _cluster.get()
    config = PROCESSES
    if cluster is not None:
        config, n_jobs = {"backend": "dask", "client": cluster}, -1
    with parallel_config(**config), warnings.catch_warnings():
        # joblib advises against stopping early; the first bad recording is meant to.
        warnings.filterwarnings("ignore", message=".*tasks.*", category=UserWarning)
        tasks = (delayed(_single_threaded)(call) for call in calls)
        with closing(Parallel(n_jobs=n_jobs, return_as="generator")(tasks)) as found:
            yield from found


def begin_loading(n_jobs: int) -> Thread | None:
    """Let processes of this machine start and load what computes features, while this one does other things.

    Parameters
    ----------
    n_jobs : int
        As of `each`, which uses these processes.

    Returns
    -------
    Thread or None
        It ends when they have loaded it; None where there is no other process.
    """
    if n_jobs in (0, 1) or _cluster.get() is not None:
        return None
    number = n_jobs if n_jobs > 0 else cpu_count()

    def load_in_each() -> None:
        with parallel_config(**PROCESSES):  # no warnings are caught: that is not for threads
            Parallel(n_jobs=number)([delayed(_load)()] * number)

    waiting = Thread(target=load_in_each, daemon=True)
    waiting.start()
    return waiting


def _load() -> None:
    import texclass.evaluation.parts  # noqa: F401


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep numerical libraries at one thread inside: starting more takes longer than short work shared."""
    with _libraries().limit(limits=1):
        yield


def _single_threaded(call: Callable[[], R]) -> R:
    with one_thread():
        return call()


@functools.cache
def _libraries() -> Any:
    """Return the libraries with threads of their own; looking for them takes as long as a short recording."""
    return ThreadpoolController()
