"""What effects add on flights, and how large that is."""

import dataclasses

import numpy as np
import pytest

from ges.diagnose.design.residual import residual
from ges.diagnose.design.system import build
from ges.diagnose.estimate.contributions import (
    contributions,
    contributions_of,
    size_of_contribution,
)

from ..synthetic import MODEL, manoeuvre, system_of

NAMES = ("force_x", "force_z", "moment_x", "acc_x")


def _size(*columns):
    return size_of_contribution([np.column_stack(columns)], system_of(NAMES, (), ()))


def test_a_size_is_told_where_it_weighs_most():
    none, push, turn = np.zeros(4), np.full(4, 0.5), np.full(4, 0.2)
    told = _size(push, none, none, none)
    assert told["channel"] == "force_x" and told["value"] == pytest.approx(0.5)
    assert told["unit"] == "N"
    assert told["share_of_weight"] == pytest.approx(0.5 / MODEL.weight_N)
    told = _size(push, none, turn, none)
    assert told["channel"] == "moment_x" and told["unit"] == "N m"
    assert told["share_of_weight"] == pytest.approx(0.2 / (MODEL.weight_N * MODEL.arm_m))


def test_a_force_and_its_accelerometer_are_told_as_the_force():
    push = np.full(4, 0.5)
    assert _size(push, 0.0 * push, 0.0 * push, push * (1.0 + 1e-12))["channel"] == "force_x"


def test_absent_windows_do_not_dilute_a_size_and_nothing_has_no_channel():
    push = np.array([0.5, np.nan, 0.5, np.nan])
    none = np.zeros(4)
    assert _size(push, none, none, none)["value"] == pytest.approx(0.5)
    assert _size(none, none, none, np.full(4, np.nan))["channel"] == ""
    two = size_of_contribution(
        [np.full((2, 4), 3.0), np.full((6, 4), 1.0)], system_of(NAMES, (), ())
    )
    assert two["value"] == pytest.approx(np.sqrt(3.0)), "all windows of all flights count alike"


def test_what_an_effect_adds_is_the_residual_without_it_less_that_with_it():
    effects = {"rotor_drag": {"k_kg": 2e-4}, "tether": {"weight_N_m": 0.3}}
    flight = manoeuvre()
    system = build([flight], MODEL.with_effects(effects), [])
    (rows,) = system.flights
    (added,) = contributions_of(effects, "rotor_drag", system, MODEL)
    drag_off = {"tether": effects["tether"]}
    without, having = (
        residual(flight, rows.windows, MODEL.with_effects(e), system.main)
        for e in (drag_off, effects)
    )
    np.testing.assert_allclose(added, without - having, atol=1e-9)
    assert np.abs(added[:, system.main.index("force_x")]).max() > 0.1


def test_of_what_the_file_has_only_the_difference_is_added():
    declared = MODEL.with_effects({"tether": {"weight_N_m": 0.3}})
    flight = manoeuvre()
    effects = {"tether": {"weight_N_m": 0.5}}
    system = build([flight], declared.with_effects(effects), [])
    c = system.main.index("force_z")
    (more,) = contributions_of(effects, "tether", system, declared)
    (all_of_it,) = contributions_of(effects, "tether", system, MODEL)
    np.testing.assert_allclose(more[:, c], 0.4 * all_of_it[:, c], rtol=1e-6)
    (same,) = contributions_of(declared.effects, "tether", system, declared)
    np.testing.assert_allclose(same[:, c], 0.0, atol=1e-12)


def test_nothing_fitted_adds_nothing():
    assert contributions(None, ("rotor_drag",), MODEL) == {}


def test_a_channel_that_is_not_there_stays_absent():
    system = build([manoeuvre()], MODEL.with_effects({"rotor_drag": {"k_kg": 2e-4}}), [])
    (rows,) = system.flights
    y = rows.y.copy()
    y[:, 0] = np.nan
    silent = dataclasses.replace(system, flights=(dataclasses.replace(rows, y=y),))
    (added,) = contributions_of(system.model.effects, "rotor_drag", silent, MODEL)
    assert np.isnan(added[:, 0]).all() and np.isfinite(added[:, 1]).all()
