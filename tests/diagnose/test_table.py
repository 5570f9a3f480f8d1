"""Columns by channel: what is asked comes back, and what is zero costs nothing."""

import numpy as np
import pytest

from ges.diagnose.design.system import build
from ges.diagnose.design.table import table_of
from ges.diagnose.library.grids import library
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres


@pytest.fixture
def table():
    columns = [{0: np.array([1.0, 2.0])}, {0: np.array([3.0, 4.0]), 2: np.array([5.0, 6.0])}, {}]
    return table_of(columns, 2, 3)


def test_a_column_is_what_it_was_made_of_and_zero_elsewhere(table):
    assert table.shape == (2, 3, 3)
    np.testing.assert_array_equal(table.of(0, [1, 2, 0]), [[3.0, 0.0, 1.0], [4.0, 0.0, 2.0]])
    np.testing.assert_array_equal(table.of(1, [0, 1]), np.zeros((2, 2)))
    one, none = table.columns([1, 2])
    assert {c: list(v) for c, v in one.items()} == {0: [3.0, 4.0], 2: [5.0, 6.0]}
    assert none == {}


def test_windows_are_told_in_which_some_column_of_a_channel_is_no_number():
    table = table_of([{0: np.array([1.0, np.nan])}, {0: np.ones(2), 2: np.ones(2)}], 2, 3)
    np.testing.assert_array_equal(table.finite(), [[True, True, True], [False, True, True]])


def test_columns_add_up_in_the_channels_that_are_asked_for(table):
    np.testing.assert_array_equal(
        table.weighted_sum({0: 1.0, 1: -2.0}, 3), [[-5.0, 0.0, -10.0], [-6.0, 0.0, -12.0]]
    )
    assert table.weighted_sum({1: 1.0}, 1).shape == (2, 1)


def test_columns_taken_over_from_another_system_are_those_computed_anew(sheet, flown):
    vehicle = sheet()
    model = from_vehicle(vehicle)
    gate = pass_gate([flown(vehicle, {}, manoeuvres.straight_runs(20.0), 1)], model)
    flights = list(gate.flights.values())
    variants = library(model)[
        "cg_offset"
    ].variants  # one axis, the other, and both: each column several times
    first = build(flights, model, variants)
    again = build(flights, model, variants, reuse=first)
    for c in range(len(first.names)):
        wanted = range(len(first.columns))
        np.testing.assert_allclose(
            again.flights[0].x.of(c, wanted), first.flights[0].x.of(c, wanted), rtol=1e-6, atol=1e-9
        )
