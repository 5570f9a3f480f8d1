"""Memory of a diagnosis: in proportion to the flights, and not once more for every fit."""

import tracemalloc
from typing import NamedTuple

import pytest

from ges.diagnose.design.system import build
from ges.diagnose.estimate.joint import null_fit
from ges.diagnose.library.requirements import candidates_of

from .synthetic import MODEL, manoeuvre


class _Used(NamedTuple):
    """Bytes of all columns, of what two fits keep besides, and the most that was in use."""

    columns: int
    kept: int
    most: int


def _used(duration_s: float) -> _Used:
    flights = [manoeuvre(duration_s)]
    variants = [v for c in candidates_of(flights, MODEL) for v in c.variants]
    tracemalloc.start()
    try:
        system = build(flights, MODEL, variants)
        before, _ = tracemalloc.get_traced_memory()
        fits = [null_fit(system) for _ in range(2)]
        after, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    del fits
    (rows,) = system.flights
    columns = {id(v): v.nbytes for values in rows.x.values for v in values}
    return _Used(sum(columns.values()), after - before, most)


@pytest.fixture(scope="module")
def used():
    # what the first call makes once for all is of no flight
    _used(6.0)
    return _used(40.0), _used(80.0)


def test_a_flight_twice_as_long_takes_no_more_than_twice_the_memory(used):
    short, long = used
    assert long.most < 2.0 * short.most


def test_with_the_length_grows_what_the_columns_take_and_little_else(used):
    """Normal equations are of no length: only differences of two lengths count."""
    columns, kept, most = (b - a for a, b in zip(*used, strict=True))
    assert kept < 0.5 * columns, "two fits keep no columns of their own"
    assert most < 3.0 * columns
