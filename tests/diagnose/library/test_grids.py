"""Variants of effects: laid out by rule over where the flights went, within bounds."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from ges.conventions import command
from ges.diagnose.library.candidates import FlightEnvelope, flight_envelope
from ges.diagnose.library.grids import library, out_of_reach
from ges.diagnose.library.requirements import candidates_of
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table
from ges.simulator.terrain import Terrain

from ..synthetic import MODEL, hovering, times

COMMAND = command(4)

REACHED = FlightEnvelope(
    low_m=(-2.0, -1.0, 0.4),
    high_m=(3.0, 1.5, 2.0),
    middle_m=(0.5, 0.0, 1.0),
    places_m=((0.0, 0.0), (1.0, 0.5)),
    square_m=0.5,
    commands=(0.55, 0.7, 0.85),
)


def _variants(name, envelope=REACHED, model=MODEL):
    return library(model, envelope)[name].variants


def test_every_effect_that_enters_the_search_is_a_candidate_with_variants_of_itself():
    found = library(MODEL, REACHED)
    for name, effect in effect_table.table().items():
        # no rotor of a quadrotor lies over another
        tried = not effect.settled and name != "coaxial_wake"
        assert (name in found) == tried, name
    for name, candidate in found.items():
        assert candidate.name == name and candidate.variants
        assert {v.effect for v in candidate.variants} == {name}


def test_shapes_lie_within_the_bounds_of_their_parameters_and_steps_within_the_amplitudes():
    for v in (v for c in library(MODEL, REACHED).values() for v in c.variants):
        effect = effect_table.get(v.effect)
        for name, value in v.shape.items():
            p = effect.parameter(name)
            assert p.low <= value <= p.high, v.key
        for a in v.amplitudes:
            assert a.step != 0.0 and a.low < a.high, v.key
            assert set(v.parameters({})) == {p.name for p in effect.parameters}


def test_what_the_file_has_is_no_candidate_unless_it_acts_in_many_places():
    on = MODEL.with_effects({"rotor_drag": {"k_kg": 1e-4}, "weak_rotor": {"loss_1": 0.1}})
    found = library(on, REACHED)
    assert "rotor_drag" not in found and "weak_rotor" in found
    moved = dataclasses.replace(on, corrections={"rotor_drag.k_kg": 1e-5})
    assert "rotor_drag" in library(moved, REACHED)


def test_losses_of_one_and_of_two_rotors_that_never_gain():
    variants = _variants("weak_rotor")
    sets = {tuple(a.parameter for a in v.amplitudes) for v in variants}
    names = [f"loss_{i}" for i in range(1, 5)]
    assert sets == {c for n in (1, 2) for c in itertools.combinations(names, n)}
    assert all(a.low == 0.0 and a.high == 1.0 for v in variants for a in v.amplitudes)
    assert variants[-1].places == ("rotor 3", "rotor 4")


def test_axes_are_tried_in_every_set_and_an_inertia_on_each_side_by_its_own_step():
    sets = [tuple(a.parameter for a in v.amplitudes) for v in _variants("cg_offset")]
    assert sorted(sets) == [("x_m",), ("x_m", "y_m"), ("y_m",)]
    inertia = _variants("inertia")
    assert len(inertia) == 2 * 7
    for v in inertia:
        for a in v.amplitudes:
            assert (a.low == 0.0) == (a.step > 0.0) and (a.high == 0.0) == (a.step < 0.0)


def test_levels_are_whole_steps_from_neutral():
    for v in _variants("ground_effect_lag"):
        (a,) = v.amplitudes
        assert a.step == a.level and a.neutral + a.step in (0.7, 2.0, 5.0)
    ceilings = [v.amplitudes[0] for v in _variants("rotor_saturation")]
    assert sorted(a.neutral + a.step for a in ceilings) == pytest.approx([0.55, 0.7, 0.85])
    never = dataclasses.replace(REACHED, commands=(1.0, 0.05))
    assert "rotor_saturation" not in library(MODEL, never), "beyond the bounds of the parameter"


def test_a_motor_is_slower_by_shares_of_its_lag_and_slows_down_no_sooner():
    declared = MODEL.number("motor_time_constant_s")
    least = settings.prepare.grid_step_shortest_s
    pairs = {tuple(a.step for a in v.amplitudes) for v in _variants("motor_lag")}
    levels = [max(k * declared, least) for k in (0.25, 1.0, 3.0)]
    assert all(up <= down for up, down in pairs)
    assert {v for pair in pairs for v in pair} == set(levels)
    slow = MODEL.with_number("motor_time_constant_s", 2.0 * declared)
    doubled = {tuple(a.step for a in v.amplitudes) for v in _variants("motor_lag", model=slow)}
    assert max(up for up, _ in doubled) == pytest.approx(2.0 * max(up for up, _ in pairs))


def test_a_ceiling_is_above_the_highest_rotor_by_radii():
    raised = MODEL.with_number("rotor_2_z_m", 0.07)
    heights = [v.shape["ceiling_z_m"] for v in _variants("ceiling_effect", model=raised)]
    assert heights == pytest.approx([2.07 + 0.1 * k for k in (0.5, 1.0, 2.0, 4.0)])


def test_walls_are_a_radius_beyond_each_side():
    walls = {
        round(v.shape["bearing_rad"], 3): v.shape["distance_m"] for v in _variants("wall_effect")
    }
    assert walls == pytest.approx({0.0: 3.1, 1.571: 1.6, 3.142: 2.1, -1.571: 1.1})


def test_another_vehicle_is_looked_for_above_every_place():
    variants = _variants("downwash")
    assert {(v.shape["other_x_m"], v.shape["other_y_m"]) for v in variants} == set(REACHED.places_m)
    above = 2.0 + 5.0 * MODEL.radius_m
    assert {v.shape["other_z_m"] for v in variants} == {above}
    assert {v.shape["width_m"] for v in variants} == {0.25}
    fine = dataclasses.replace(REACHED, square_m=0.01)
    assert {v.shape["width_m"] for v in _variants("downwash", fine)} == {MODEL.radius_m}


def test_loads_hang_lie_and_are_drawn_on_threads_that_fit_the_flight():
    loads = _variants("slung_load")
    lying = [v for v in loads if v.shape.keys() == {"length_m"}]
    assert lying and min(v.shape["length_m"] for v in lying) > REACHED.low_m[2]
    hubs = {
        (v.shape["attach_x_m"], v.shape["attach_y_m"]) for v in loads if "attach_x_m" in v.shape
    }
    expected = {
        (MODEL.number(f"rotor_{i}_x_m"), MODEL.number(f"rotor_{i}_y_m")) for i in range(1, 5)
    }
    assert hubs == expected | {(0.0, 0.0)}
    drawn = {round(v.shape["length_m"], 6) for v in loads if "start_x_m" in v.shape}
    assert drawn == {round(math.hypot(1.0, k), 6) for k in (0.6, 1.2)}, "1 m over the ground"
    untilted = dataclasses.replace(REACHED, attitude_derived=True)
    still = _variants("slung_load", untilted)
    assert all("start_x_m" in v.shape for v in still), "a swing shows in the tilt alone"
    high = dataclasses.replace(MODEL, terrain=Terrain.flat(0.5))
    nearer = {
        v.shape["length_m"] for v in _variants("slung_load", model=high) if "start_x_m" in v.shape
    }
    assert min(nearer) == pytest.approx(0.5 * math.hypot(1.0, 0.6))
    short = dataclasses.replace(REACHED, low_m=(0.4, -0.2, 0.4), high_m=(0.6, 0.2, 2.0))
    assert not any("start_x_m" in v.shape for v in _variants("slung_load", short)), (
        "slack all the way"
    )


def test_a_plane_that_is_in_doubt_is_tried_across_its_doubt():
    plain = _variants("ground_effect")
    doubtful = dataclasses.replace(MODEL, plane_sd_m=0.02)
    across = {
        v.shape["rotor_plane_offset_m"]
        for v in _variants("ground_effect", model=doubtful)
        if "rotor_plane_offset_m" in v.shape
    }
    assert sorted(across) == pytest.approx([0.02 * k for k in (-2, -1, 0, 1, 2)])
    assert {v.shape.get("rotor_plane_offset_m", 0.0) for v in plain} == {0.0}


def test_a_wind_brings_the_drag_that_it_acts_through_unless_one_is_on():
    usual = {frozenset(v.given) for v in _variants("wind")}
    assert usual == {frozenset({"rotor_drag"})}
    (k_kg,) = {v.given["rotor_drag"]["k_kg"] for v in _variants("wind")}
    share = effect_table.get("rotor_drag").parameter("k_kg").usual_share
    assert k_kg * 4.0 * MODEL.hover_rad_s == pytest.approx(share * MODEL.weight_N)
    on = MODEL.with_effects({"parasitic_drag": {"area_m2": 0.01}})
    assert all(not v.given for v in _variants("wind", model=on))


def test_what_was_not_flown_is_not_laid_out():
    nowhere = library(MODEL)
    assert not {"ceiling_effect", "wall_effect", "downwash", "rotor_saturation"} & set(nowhere)


def test_flights_too_high_for_a_form_are_told_with_its_bounds():
    high = dataclasses.replace(REACHED, high_m=(3.0, 1.5, 2000.0))
    ceiling, wall = (effect_table.get(n) for n in ("ceiling_effect", "wall_effect"))
    assert "ceiling_effect" not in library(MODEL, high)
    why = out_of_reach(ceiling, MODEL, high)
    assert why.startswith("it would take ceiling_z_m 2e+03 m") and "-100 to 1000" in why
    assert out_of_reach(ceiling, MODEL, REACHED) == "" and out_of_reach(wall, MODEL, high) == ""


def test_candidates_that_can_act_now_need_no_other_or_have_it():
    flights = [hovering(battery_V=16.0, range_m=1.5, p_x_m=times())]
    first = {c.name for c in candidates_of(flights, MODEL)}
    assert "rotor_drag" in first and "ground_effect_lag" not in first and "wind" in first
    assert "rangefinder_bias" in first and "accelerometer_bias" not in first
    on = MODEL.with_effects({"ground_effect": {"c_a": 0.3}})
    then = {c.name for c in candidates_of(flights, on, ("ground_effect",))}
    assert "ground_effect_lag" in then and "rotor_drag" not in then, "what acts through it alone"
    assert {c.name for c in candidates_of(flights, MODEL, (), ("rotor_drag", "gusts"))} == {
        "rotor_drag"
    }


def test_where_flights_went_is_where_they_flew():
    t = times()
    flying = t >= 1.0
    x = np.where(flying, t - 1.0, 70.0)
    envelope = flight_envelope([hovering(p_x_m=x, u_1=0.9).replace(flying=flying)], 0.0625)
    assert envelope.low_m == pytest.approx((0.0, 0.0, 1.5))
    assert envelope.high_m == pytest.approx((2.99, 0.0, 1.5))
    assert envelope.middle_m[0] == pytest.approx(1.495)
    step = 0.125
    assert envelope.square_m == step and len(envelope.places_m) == 24
    assert envelope.places_m[0] == pytest.approx((0.5 * step, 0.5 * step))
    assert envelope.commands[-1] == pytest.approx(0.9)
    assert (
        flight_envelope([hovering(p_x_m=None, u_1=None, rotor_speed_1_rad_s=None)], 0.0625)
        == FlightEnvelope()
    )


def test_places_are_as_coarse_as_they_have_to_be_few():
    t = times(40.0)
    wide = hovering(40.0, p_x_m=t * np.cos(t), p_y_m=t * np.sin(t))
    envelope = flight_envelope([wide], 0.0625)
    assert 1 < len(envelope.places_m) <= settings.library.places_most
    steps = math.log(envelope.square_m / 0.125, math.sqrt(2.0))
    assert steps == pytest.approx(round(steps), abs=1e-6)
    for x, y in zip(wide.columns["p_x_m"][::50], wide.columns["p_y_m"][::50], strict=True):
        near = min(max(abs(x - a), abs(y - b)) for a, b in envelope.places_m)
        assert near <= 0.5 * envelope.square_m + 1e-9


def test_levels_of_commands_reach_from_the_air_to_a_take_off():
    t = times()
    flying = t >= 1.0
    asked = np.where(flying, 0.6, 1.0)
    flight = hovering(**dict.fromkeys(COMMAND, asked), rotor_speed_1_rad_s=None)
    lifting = np.ones(len(t), bool)
    envelope = flight_envelope([flight.replace(flying=flying, lifting=lifting)], 0.0625)
    assert envelope.largest_commands == pytest.approx((0.6, 1.0))
    levels = [a.level for v in _variants("rotor_saturation", envelope) for a in v.amplitudes]
    neutral = effect_table.get("rotor_saturation").parameter("share").neutral
    assert levels == pytest.approx([0.6 + 0.4 * s - neutral for s in (0.0, 0.1, 0.4, 0.7)])
    # rotors that were logged at 750 of 1000 rad/s have no ceiling below
    turning = hovering(**dict.fromkeys(COMMAND, asked), rotor_speed_2_rad_s=750.0)
    faster = flight_envelope([turning.replace(flying=flying, lifting=lifting)], 0.0625)
    above = [a.level for v in _variants("rotor_saturation", faster) for a in v.amplitudes]
    assert above == pytest.approx([level for level in levels if level + neutral >= 0.75])
    still = flight_envelope([flight.replace(flying=flying)], 0.0625)
    assert still.commands == pytest.approx([0.6] * 4) and still.largest_commands == (0.6, 0.6)
