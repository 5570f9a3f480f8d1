"""Work on several cores: in order, and on no more of them than allowed."""

import operator
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ges import threads


def _process(_) -> int:
    return os.getpid()


HERE: ContextVar[str] = ContextVar("here", default="nothing")


@pytest.mark.parametrize("told", ["1", "2"])
def test_threads_see_what_holds_where_they_were_called(told, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", told)
    token = HERE.set("ours")
    assert threads.each(lambda _: HERE.get(), range(8)) == ["ours"] * 8
    HERE.reset(token)
    assert threads.each(lambda _: HERE.get(), range(8)) == ["nothing"] * 8


@pytest.mark.parametrize("told", ["1", "2", "64"])
def test_results_come_in_order_whatever_the_number_of_threads(told, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", told)
    assert threads.each(lambda a, b: a - b, range(9), [1] * 9) == list(range(-1, 8))
    with threads.apart(os.getpid) as begin:
        assert begin(operator.neg, range(9))() == list(range(0, -9, -1))


def test_one_thread_works_where_it_was_called(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert (
        threads.each(lambda _: threading.current_thread(), [0, 0])
        == [threading.current_thread()] * 2
    )
    with threads.apart(os.getpid) as begin:
        assert begin(_process, [0, 0])() == [os.getpid()] * 2


def test_processes_are_others_and_prepare_at_once(monkeypatch, tmp_path):
    monkeypatch.setattr(threads, "cores", lambda: 2)
    with threads.apart((tmp_path / "prepared").touch) as begin:
        while not (tmp_path / "prepared").exists():
            time.sleep(0.01)
        assert os.getpid() not in begin(_process, [0, 0])()


def test_what_goes_wrong_elsewhere_is_told(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        threads.each(lambda a: 1 // a, [1, 0])
    with pytest.raises(ZeroDivisionError), threads.apart(os.getpid) as begin:
        begin(operator.truediv, [1, 1], [1, 0])()


def _runs(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_processes_end_with_a_caller_that_is_killed(tmp_path):
    code = f"""
import os, pathlib, signal, time
from ges import threads
threads.cores = lambda: 2
here = pathlib.Path({str(tmp_path)!r})
def tell(_=None):
    (here / str(os.getpid())).touch()
    time.sleep(0.1 if _ is None else 60.0)
with threads.apart(tell) as begin:
    begin(tell, [1, 2])
    while len(list(here.iterdir())) < 3:
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", code], check=False)
    left = [int(p.name) for p in tmp_path.iterdir()]
    assert len(left) == 3
    until = time.monotonic() + 60.0
    while any(map(_runs, left)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(_runs, left))


@pytest.mark.parametrize("told, threads_in", [("1", 2), ("2", 1)])
def test_blas_has_one_thread_unless_it_was_told_so_before(told, threads_in, monkeypatch):
    assert np.dot(np.ones(2), np.ones(2)) == 2.0  # now BLAS is there
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", told)
    with threadpool_limits(2):
        seen = threads.blas_alone(
            lambda: {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}
        )()
    assert seen == {threads_in}


def test_blas_has_one_thread_until_the_last_of_several_has_ended(monkeypatch):
    assert np.dot(np.ones(2), np.ones(2)) == 2.0
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)

    def blas_threads() -> set[int]:
        return {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}

    both_work, first_ended = threading.Barrier(2), threading.Event()

    @threads.blas_alone
    def first() -> None:
        both_work.wait(60.0)

    @threads.blas_alone
    def second() -> set[int]:
        both_work.wait(60.0)
        first_ended.wait(60.0)
        return blas_threads()

    before = threadpool_limits(2)
    with threadpool_limits():  # after it other threads may set limits
        pass
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.submit(first), pool.submit(second)
        one.result()
        first_ended.set()
        assert other.result() == {1}
    assert blas_threads() == {2}
    before.restore_original_limits()
    with threadpool_limits():
        pass
