"""Work on several cores: compiled calls and large array operations by threads of one process, plain
Python by processes.
"""

from __future__ import annotations

import contextlib
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
    """Cores to work on: those that this process may use, but no more than ``OMP_NUM_THREADS`` where
    that is set.
    """
    allowed = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    told = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(told))) if told.isdigit() else allowed


def blas_alone(work: Callable[P, R]) -> Callable[P, R]:
    """``work`` with one thread of BLAS: the same bytes whatever the number of cores, and its
    threads do not wait for ours.
    """

    @functools.wraps(work)
    def alone(*arguments: P.args, **named: P.kwargs) -> R:
        if (
            os.environ.get("OPENBLAS_NUM_THREADS") == "1"
        ):  # as ``ges`` and the proof start it, where no library can be looked for
            return work(*arguments, **named)
        with threadpool_limits(1):
            return work(*arguments, **named)

    return alone


def each(work: Callable[..., R], *arguments: Iterable) -> list[R]:
    """``work`` of one of each of the arguments after another, in their order, whatever the number
    of cores.
    """
    count = cores()
    if count == 1:
        return list(map(work, *arguments))
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, *arguments))


Begin = Callable[..., Callable[[], list]]
"""Begins ``work`` of one of each of the arguments after another; what it returns waits for the
results, in their order.
"""


def at_once(work: Callable, *arguments: Iterable) -> Callable[[], list]:
    """A :data:`Begin` that does all of the work before it returns."""
    done = list(map(work, *arguments))
    return lambda: done


@contextlib.contextmanager
def apart(prepare: Callable[[], object]) -> Iterator[Begin]:
    """A :data:`Begin` by other processes, for what keeps Python itself busy. They come of one that
    does ``prepare`` while the caller goes on; work and arguments are copied to them, results back.
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
    """What :func:`each` does, by processes that are born as this one is."""
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
