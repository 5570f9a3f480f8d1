"""Work on several cores: compiled calls and large array operations by threads of one process, plain Python by processes."""

from __future__ import annotations

import functools
import multiprocessing
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

from threadpoolctl import threadpool_limits


def cores() -> int:
    """Cores to work on: those that this process may use, but no more than ``OMP_NUM_THREADS`` where that is set."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    told = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(told))) if told.isdigit() else allowed


def blas_alone(work: Callable) -> Callable:
    """``work`` with one thread of BLAS: the same bytes whatever the number of cores, and its threads do not wait for ours."""

    @functools.wraps(work)
    def alone(*arguments, **named):
        if os.environ.get("OPENBLAS_NUM_THREADS") == "1":  # as ``ges`` and the proof start it, where no library can be looked for
            return work(*arguments, **named)
        with threadpool_limits(1):
            return work(*arguments, **named)

    return alone


def each(work: Callable, *arguments: Iterable) -> list:
    """``work`` of one of each of the arguments after another, in their order, whatever the number of cores."""
    count = cores()
    if count == 1:
        return list(map(work, *arguments))
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, *arguments))


_inherited: list[Callable] = []


def _inherit(work: Callable) -> None:
    _inherited[:] = [work]


def _do(argument):
    return _inherited[0](argument)


def each_apart(work: Callable, arguments: Sequence) -> list:
    """The same by processes, for what keeps Python itself busy; ``work`` is inherited, arguments and results are copied."""
    count = min(cores(), len(arguments))
    if count < 2 or "fork" not in multiprocessing.get_all_start_methods():
        return list(map(work, arguments))
    with ProcessPoolExecutor(count, multiprocessing.get_context("fork"), _inherit, (work,)) as pool:
        return list(pool.map(_do, arguments))
