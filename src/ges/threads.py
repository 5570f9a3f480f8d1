"""Parallel work: compiled calls and large array operations in threads, pure Python in processes."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def cores() -> int:
    """Count the cores that this process may use.

    Returns
    -------
    Number of cores, at least 1; at most ``OMP_NUM_THREADS`` where that is set.
    """
    allowed = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(limit))) if limit.isdigit() else allowed


class _OneBlasThread:
    """Limit BLAS to one thread: the first of several users sets the limit, the last lifts it.

    The limit is of the whole process, so whoever ends first must not lift it for the others.
    """

    def __init__(self) -> None:
        self._lock, self._users = threading.Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if self._users == 0:
                self._limit = threadpool_limits(1)
            self._users += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._limit.restore_original_limits()
            # the thread that set a limit alone may change it, until it leaves a ``with`` of it
            with threadpool_limits():
                pass


_one_blas_thread = _OneBlasThread()


def blas_alone(work: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function to run with BLAS limited to one thread.

    Sums of BLAS depend on its number of threads, so results are the same on any machine. Its
    threads do not compete with those of :func:`each` either.

    Parameters
    ----------
    work : the function.

    Returns
    -------
    A function with the same arguments and result.
    """

    @functools.wraps(work)
    def alone(*arguments: P.args, **named: P.kwargs) -> R:
        if (
            os.environ.get("OPENBLAS_NUM_THREADS") == "1"
        ):  # as ``ges`` and the proof start it, where no library can be looked for
            return work(*arguments, **named)
        with _one_blas_thread:
            return work(*arguments, **named)

    return alone


def each(work: Callable[..., R], *arguments: Iterable) -> list[R]:
    """Call a function on each of several arguments, in threads.

    The threads see the context variables of their caller, as the settings of a diagnosis.

    Parameters
    ----------
    work : the function; it must be safe to call from several threads.
    *arguments : iterables, one for each argument of ``work``, as for :func:`map`.

    Returns
    -------
    Results in the order of the arguments, whatever the number of cores.
    """
    count = cores()
    if count == 1:
        return list(map(work, *arguments))
    caller = contextvars.copy_context()
    with ThreadPoolExecutor(count) as pool:
        # a context cannot be entered twice at once, so that each call has its own copy
        return list(pool.map(lambda *one: caller.copy().run(work, *one), *arguments))


Begin = Callable[..., Callable[[], list]]
"""Begins ``work`` of one of each of the arguments after another; what it returns waits for the
results, in their order.
"""


def at_once(work: Callable, *arguments: Iterable) -> Callable[[], list]:
    """Do all of the work before returning; a :data:`Begin` without parallelism.

    Parameters
    ----------
    work : the function.
    *arguments : iterables, one for each argument of ``work``, as for :func:`map`.

    Returns
    -------
    A function that returns the results, in order.
    """
    done = list(map(work, *arguments))
    return lambda: done


@contextlib.contextmanager
def apart(prepare: Callable[[], object]) -> Iterator[Begin]:
    """Start work in other processes, for pure Python that threads cannot run in parallel.

    Where there is one core, or no ``fork``, the work is done in this process.

    Parameters
    ----------
    prepare : called once in the first of these processes, while the caller goes on. The others are
        forked from that one.

    Yields
    ------
    A :data:`Begin`. Work, arguments and results are copied between processes by pickle.
    """
    if cores() < 2 or "fork" not in multiprocessing.get_all_start_methods():
        yield at_once
        return
    with _processes(1, prepare) as one:
        one.submit(os.getpid)  # the first task starts it
        yield lambda work, *arguments: one.submit(_shared, work, *arguments).result


def _processes(count: int, prepare: Callable[[], object]) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, multiprocessing.get_context("fork"), _ready, (prepare,))


def _shared(work: Callable, *arguments: Iterable) -> list:
    """Do what :func:`each` does, in processes forked from this one."""
    with _processes(cores(), os.getpid) as pool:
        return list(pool.map(work, *arguments))


def _ready(prepare: Callable[[], object]) -> None:
    """Leave interrupts to the caller, end with it however it ends, and prepare."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(
        target=_end_with, args=(multiprocessing.parent_process(),), daemon=True
    ).start()
    prepare()


def _end_with(caller: Any) -> None:
    caller.join()
    os._exit(1)
