"""Work on several cores within one process: compiled calls and large array operations of different threads run at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor


def cores() -> int:
    """Cores to work on: those that this process may use, but no more than ``OMP_NUM_THREADS`` where that is set."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    told = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(told))) if told.isdigit() else allowed


def each(work: Callable, *arguments: Iterable) -> list:
    """``work`` of one of each of the arguments after another, in their order, whatever the number of cores."""
    count = cores()
    if count == 1:
        return list(map(work, *arguments))
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, *arguments))
