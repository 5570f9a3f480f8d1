"""Work on several cores: in order, and on no more of them than allowed."""

import os
import threading

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ges import threads


@pytest.mark.parametrize("told", ["1", "2", "64"])
def test_results_come_in_order_whatever_the_number_of_threads(told, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", told)
    assert threads.each(lambda a, b: a - b, range(9), [1] * 9) == list(range(-1, 8))
    assert threads.each_apart(lambda a: a - 1, range(9)) == list(range(-1, 8))


def test_one_thread_works_where_it_was_called(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert threads.each(lambda _: threading.current_thread(), [0, 0]) == [threading.current_thread()] * 2
    assert threads.each_apart(lambda _: os.getpid(), [0, 0]) == [os.getpid()] * 2


def test_processes_are_others(monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 2)
    assert os.getpid() not in threads.each_apart(lambda _: os.getpid(), [0, 0])


@pytest.mark.parametrize("each", [threads.each, threads.each_apart])
def test_what_goes_wrong_elsewhere_is_told(each, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        each(lambda a: 1 // a, [1, 0])


@pytest.mark.parametrize("told, threads_in", [("1", 2), ("2", 1)])
def test_blas_has_one_thread_unless_it_was_told_so_before(told, threads_in, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", told)
    with threadpool_limits(2):
        seen = threads.blas_alone(lambda: {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"})()
    assert seen == {threads_in}
