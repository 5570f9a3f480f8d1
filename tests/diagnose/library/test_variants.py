"""Amplitudes, variants and what a log has to hold for an effect."""

import dataclasses
import math

import numpy as np
import pytest

from ges.conventions import BODY_RATE, VELOCITY, command, rotor_speed
from ges.diagnose.library.candidates import (
    Candidate,
    FlightEnvelope,
    Variant,
    amplitude_of,
    has_prerequisite,
    modifiers_of,
    place_of,
    reach_of,
    usual_height_m,
)
from ges.diagnose.library.grids import library
from ges.diagnose.library.requirements import (
    REQUIREMENTS,
    needs_attitude,
    silent_channels,
    silent_channels_words,
    unmet_requirement,
)
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table
from ges.simulator.terrain import Terrain

from ..synthetic import MODEL, hovering

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)


def test_every_amplitude_has_a_step_that_is_small_in_its_room_and_starts_at_neutral():
    for effect in effect_table.table().values():
        for p in (p for p in effect.parameters if not math.isnan(p.neutral)):
            a = amplitude_of(effect.name, p.name)
            assert 0.0 < abs(a.step) <= settings.library.step_share * (a.high - a.low)
            assert a.neutral == p.neutral and (a.low, a.high) == (p.low, p.high)


def test_an_axis_without_a_usual_size_has_that_of_its_siblings():
    x, y = (amplitude_of("cg_offset", n) for n in ("x_m", "y_m"))
    assert x.step == pytest.approx(settings.library.step_share * 0.005) and y.step == x.step


def test_a_variant_is_its_effect_with_all_other_numbers_neutral():
    v = Variant("slung_load", {"length_m": 0.4}, (amplitude_of("slung_load", "mass_kg"),))
    told = v.parameters({"mass_kg": 0.2})
    neutral = effect_table.get("slung_load").neutral()
    assert told == {**neutral, "length_m": 0.4, "mass_kg": 0.2}
    assert v.parameters({})["mass_kg"] == 0.0
    assert v.key == "slung_load[length_m=0.4](mass_kg by 0.01)"


def test_places_are_numbered_amplitudes_of_what_may_act_in_many():
    assert (
        place_of("loss_3") == "rotor 3" and place_of("mass_kg") == "" and place_of("x_m_s2") == ""
    )
    losses = tuple(amplitude_of("weak_rotor", f"loss_{i}") for i in (1, 4))
    assert Variant("weak_rotor", {}, losses).places == ("rotor 1", "rotor 4")
    assert Variant("slung_load", {}, (amplitude_of("slung_load", "mass_kg"),)).places == ()


def test_what_acts_through_others_needs_one_of_them():
    assert has_prerequisite("rotor_drag", ()) and not has_prerequisite("wind", ())
    assert has_prerequisite("wind", ("parasitic_drag",)) and not has_prerequisite(
        "wind", ("ground_effect",)
    )
    wind = Variant("wind", {}, (), {"rotor_drag": {"k_kg": 1e-4}})
    assert Candidate("wind", "physics", (wind,)).stands_alone
    assert not Candidate("wind", "physics", (Variant("wind", {}, ()),)).stands_alone
    assert modifiers_of(wind) == {}, "a carrier is no modifier"
    lagging = Variant("ground_effect", {}, (), {"ground_effect_lag": {"c": 2.0}})
    assert modifiers_of(lagging) == {"ground_effect_lag": {"c": 2.0}}


def test_a_usual_height_is_over_the_ground_of_the_file():
    envelope = FlightEnvelope(middle_m=(0.0, 0.0, 1.2))
    assert usual_height_m(MODEL, envelope) == pytest.approx(1.2)
    raised = dataclasses.replace(MODEL, terrain=Terrain.flat(0.5))
    assert usual_height_m(raised, envelope) == pytest.approx(0.7)


def test_a_place_moves_by_a_share_of_what_it_acts_over_and_nothing_else_is_held():
    values = {
        "ceiling_effect": {"ceiling_z_m": 2.5},
        "downwash": {"width_m": 0.4, "other_x_m": 1.0},
        "slung_load": {"length_m": 0.6, "mass_kg": 0.1},
        "rotor_drag": {"k_kg": 1e-4},
    }
    assert reach_of(("ceiling_effect", "ceiling_z_m"), values, MODEL) == pytest.approx(0.05)
    assert reach_of(("downwash", "other_x_m"), values, MODEL) == pytest.approx(0.2)
    assert reach_of(("slung_load", "length_m"), values, MODEL) == pytest.approx(0.018)
    assert reach_of(("rotor_drag", "k_kg"), values, MODEL) == 0.0
    thin = {"downwash": {"width_m": 0.01, "other_x_m": 1.0}}
    assert reach_of(("downwash", "other_x_m"), thin, MODEL) == pytest.approx(0.05), "a radius"


def test_of_a_gain_near_the_ground_the_moment_has_several_sizes_and_its_force_one():
    """How far the gain of a rotor spreads is not known; a moment alone is no such gain."""
    listed = library(MODEL)
    gains = {name: {v.moment_gain for v in c.variants} for name, c in listed.items()}
    levels = effect_table.get("ground_effect_moment").carried
    assert gains.pop("ground_effect") == {1.0 + level for level in levels} and min(levels) > -1.0
    assert set().union(*gains.values()) == {None}
    keys = [v.key for v in listed["ground_effect"].variants]
    assert len(set(keys)) == len(keys)
    # other modifiers are given with it, and this one is not named by the search
    assert {e for v in listed["ground_effect"].variants for e in v.given} == {
        "ground_effect_lag",
        "ground_effect_forward_flight",
    }


def test_every_need_of_a_descriptor_is_known_here():
    needs = {n for e in effect_table.table().values() for n in e.needs}
    assert needs <= set(REQUIREMENTS)


FULL = hovering(battery_V=16.0, range_m=1.5, acc_z_m_s2=9.8)
DERIVED = FULL.replace(derived=frozenset({"attitude"}))


def _without(*names):
    return FULL.replace(columns={n: v for n, v in FULL.columns.items() if n not in names})


@pytest.mark.parametrize(
    ("effect", "flight", "asked"),
    [
        ("rotor_drag", _without(*VELOCITY), "velocity"),
        ("rotor_drag", DERIVED, "attitude"),
        ("ground_effect", _without("p_z_m", "range_m"), "height"),
        ("rangefinder_bias", _without("range_m"), "rangefinder"),
        ("accelerometer_bias", _without("acc_z_m_s2"), "accelerometer"),
        ("battery_sag", _without("battery_V"), "battery_V"),
        ("thrust_scale", _without("battery_V", *ROTOR_SPEED), "battery_V"),
        ("motor_lag", _without(*COMMAND), "motor commands"),
        ("motor_lag", _without(*ROTOR_SPEED), "responses to disturbances"),
    ],
)
def test_what_a_log_lacks_is_said_in_words(effect, flight, asked):
    assert unmet_requirement(effect, [FULL], MODEL) == ""
    told = unmet_requirement(effect, [flight], MODEL)
    assert told.startswith("needs ") and asked in told


@pytest.mark.parametrize(("step_m", "told"), [(0.05, ""), (0.2, "needs ground without edges")])
def test_a_rangefinder_s_lag_is_told_apart_from_edges_of_the_ground_on_smooth_ground(step_m, told):
    crossing = FULL.replace(columns={**FULL.columns, "p_x_m": FULL.t_s - 2.0})
    x_m, y_m = np.linspace(-3.0, 3.0, 25), np.linspace(-3.0, 3.0, 25)
    heights_m = np.where(x_m > 0.0, step_m, 0.0) * np.ones((25, 25))
    edged = dataclasses.replace(MODEL, terrain=Terrain.grid(x_m, y_m, heights_m))
    assert unmet_requirement("rangefinder_lag", [crossing], edged).startswith(told or "")
    assert bool(unmet_requirement("rangefinder_lag", [crossing], edged)) == bool(told)
    assert unmet_requirement("rangefinder_lag", [crossing], MODEL) == ""


def test_attitude_is_needed_by_what_only_it_shows():
    assert needs_attitude("rotor_drag") and not needs_attitude("ground_effect")


def test_silent_channels_say_what_to_log_or_to_state():
    assert set(silent_channels([FULL], MODEL)) == {"acc_x"}
    off = silent_channels([DERIVED], MODEL)
    assert off["force_x"] == "log the attitude (q_w ...)" and "force_z" not in off
    blind = _without(*BODY_RATE, "q_w")
    off = silent_channels([blind], MODEL)
    assert "log the gyro" in off["moment_x"] and "velocity and attitude" in off["force_z"]
    unstated = dataclasses.replace(MODEL, stated_parts=frozenset())
    off = silent_channels([FULL], unstated)
    assert off["moment_x"].startswith("state inertia_kg_m2")
    assert off["moment_z"].startswith("state torque_coefficient")
    assert silent_channels([blind, FULL], MODEL).keys() == {"acc_x"}, (
        "one flight that speaks is enough"
    )


def test_a_verdict_of_nothing_names_what_it_is_silent_about():
    assert silent_channels_words({}) == ""
    told = silent_channels_words({"force_x": "log a", "force_z": "log b", "moment_x": "log c"})
    assert told == (
        " They say nothing of drag, inflow, loads and the ground (log b)"
        " and nothing of moments (log c)."
    )
    assert (
        silent_channels_words({"force_x": "log a"}) == " They say nothing of drag and wind (log a)."
    )
