"""Gusts: a push that wanders slowly through a drag, and what is none."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from ges.conventions import SPECIFIC_FORCE, VELOCITY
from ges.diagnose.design.system import build
from ges.diagnose.detectors.gusts import (
    Gusts,
    find_gusts,
    load_may_push,
    shows_moving_air,
    wind_speed_m_s,
)
from ges.diagnose.estimate.joint import JointFit
from ges.diagnose.prepare.channels import ACC, FORCE

from ..synthetic import MODEL, hovering, system_of, times

DRAG_KG = 2e-4
DURATION_S = 52.0


@functools.lru_cache
def _wind_and_its_drag(
    strength_m_s, slow_s=3.0, constant_m_s=0.0, drag=True, shown=FORCE, accelerometer=()
):
    """A system whose residuals are those of a wind through the drag, that wanders in so many
    seconds, in the channels ``shown``; its sensors' noise of 0.02 N.
    """
    model = MODEL.with_effects({"rotor_drag": {"k_kg": DRAG_KG}} if drag else {})
    felt = dict(zip(accelerometer, (0.0, 0.0, 9.81), strict=False))
    system = build([hovering(DURATION_S, **felt)], model, [])
    (rows,) = system.flights
    rng = np.random.default_rng(0)
    step_s = float(rows.windows.center_s[1] - rows.windows.center_s[0])
    wind = gaussian_filter1d(rng.standard_normal((len(rows.y), 2)), slow_s / step_s, axis=0)
    wind = strength_m_s * wind / wind.std(axis=0) + constant_m_s
    push_N = DRAG_KG * 4.0 * MODEL.hover_rad_s * wind
    y = rows.y.copy()
    for channels in (FORCE, ACC) if accelerometer else (FORCE,):
        for c, name in enumerate(channels[:2]):
            noise_N = 0.02 * rng.standard_normal(len(y))
            y[:, system.names.index(name)] = noise_N + (channels == shown) * push_N[:, c]
    return dataclasses.replace(system, flights=(dataclasses.replace(rows, y=y),))


GUSTS = Gusts(5.0, 0.1, 2.0, 0.3, 9.8, 1e-4)
JOINT = JointFit(*[np.zeros(0)] * 3, 0.0, {}, {}, ({},))


def test_the_mean_wind_of_a_flight_is_a_nuisance_and_part_of_the_gusts():
    effects = {"rotor_drag": {"k_kg": DRAG_KG}, "payload": {"mass_kg": 0.1}}
    blown = GUSTS.blow_in(MODEL, effects)
    assert set(blown.act_through) == {"rotor_drag"}
    system = build([hovering(DURATION_S)], blown, [])
    k = system.nuisances["wind.east_m_s"]
    assert (system.columns[k].nuisance.sd, system.columns[k].nuisance.flight_sd) == (2.0, 2.0)
    (rows,) = system.flights
    # through the drag that is given, not on: a metre per second pushes by the drag of hover
    push = rows.x.of(system.names.index(FORCE[0]), [k])[:, 0]
    assert push == pytest.approx(DRAG_KG * 4.0 * MODEL.hover_rad_s, rel=1e-3)
    winds = ({"wind.east_m_s": 3.0, "wind.north_m_s": -1.0},)
    fitted = dataclasses.replace(JOINT, by_flight=winds)
    windy = _wind_and_its_drag(2.0)
    plain = find_gusts(windy, JOINT)
    assert find_gusts(windy, fitted) == plain
    # where the wind is a nuisance of the system, too: what it was fitted to is not taken away
    own = build(windy.recordings, GUSTS.blow_in(windy.model, {}), [])
    rows = dataclasses.replace(own.flights[0], y=windy.flights[0].y)
    assert find_gusts(dataclasses.replace(own, flights=(rows,)), fitted) == plain


@pytest.mark.parametrize("shown", [FORCE, ACC])
def test_what_shakes_as_much_along_thrust_is_no_gust(shown):
    windy = _wind_and_its_drag(
        2.0, shown=shown, accelerometer=() if shown == FORCE else SPECIFIC_FORCE
    )
    assert find_gusts(windy, JOINT)
    (rows,) = windy.flights
    across, along = (windy.names.index(shown[i]) for i in (0, 2))
    y = rows.y.copy()
    y[:, along] = np.roll(y[:, across], len(y) // 2)
    shaken = dataclasses.replace(windy, flights=(dataclasses.replace(rows, y=y),))
    assert find_gusts(shaken, JOINT) is None
    # of a tenth of that a gust is still one
    y[:, along] *= 0.1
    assert find_gusts(shaken, JOINT).strength_m_s == find_gusts(windy, JOINT).strength_m_s


def test_windows_whose_height_is_not_known_are_left_out():
    windy = _wind_and_its_drag(2.0)
    (rows,) = windy.flights
    height_m = rows.flight.columns["p_z_m"].copy()
    height_m[100:400] = np.nan
    flight = dataclasses.replace(rows.flight, columns={**rows.flight.columns, "p_z_m": height_m})
    found = find_gusts(
        dataclasses.replace(windy, flights=(dataclasses.replace(rows, flight=flight),)), JOINT
    )
    assert found.strength_m_s == pytest.approx(find_gusts(windy, JOINT).strength_m_s, rel=0.1)
    assert found != find_gusts(windy, JOINT)


@functools.lru_cache
def _found(strength_m_s):
    return find_gusts(_wind_and_its_drag(strength_m_s), JOINT)


def test_gusts_are_told_by_the_rms_of_their_push_and_more_of_them_by_more():
    found = {s: _found(s) for s in (1.0, 2.0)}
    for strength, gusts in found.items():
        push_N = DRAG_KG * 4.0 * MODEL.hover_rad_s * strength * np.sqrt(2.0)
        assert 0.3 * push_N < gusts.force_N < 1.3 * push_N
        assert gusts.p_value < 1e-6 and gusts.ci95[0] < gusts.strength_m_s < gusts.ci95[1]
    assert found[2.0].strength_m_s == pytest.approx(2.0 * found[1.0].strength_m_s, rel=0.1)
    assert found[2.0].force_N == pytest.approx(2.0 * found[1.0].force_N, rel=0.1)


@pytest.mark.parametrize("slow_s", [0.5, 1.0])
def test_gusts_of_a_second_are_told(slow_s):
    """Over blocks of five seconds they average out."""
    push_N = DRAG_KG * 4.0 * MODEL.hover_rad_s * 2.0 * np.sqrt(2.0)
    gusts = find_gusts(_wind_and_its_drag(2.0, slow_s), JOINT)
    assert gusts.p_value < 1e-6 and 0.5 * push_N < gusts.force_N < 1.1 * push_N


@pytest.mark.parametrize(
    "blown",
    [
        {"strength_m_s": 0.0},
        {"strength_m_s": 0.0, "constant_m_s": 4.0},
        {"strength_m_s": 1.0, "slow_s": 0.05},
        {"strength_m_s": 1.0, "drag": False},
    ],
    ids=["still", "a steady wind", "fast noise", "no drag"],
)
def test_what_is_no_gust_is_none(blown):
    assert find_gusts(_wind_and_its_drag(**blown), JOINT) is None


@pytest.mark.parametrize("form", ["of one axis", "with the climb", "of the area that is shown"])
def test_an_error_of_the_drag_s_form_is_no_gust(form):
    """With quiet sensors a drag of another form stood out by 19 times what noise makes."""
    t = times(DURATION_S)
    v = np.stack([5.0 * np.sin(0.6 * t), 3.0 * np.sin(0.83 * t + 1.0), 2.0 * np.sin(1.1 * t)])
    velocity = dict(zip(VELOCITY, v, strict=True))
    model = MODEL.with_effects({"rotor_drag": {"k_kg": DRAG_KG}})
    system = build([hovering(DURATION_S, **velocity)], model, [])
    (rows,) = system.flights
    u = rows.windows.mean @ v.T
    whole = np.linalg.norm(u, axis=1, keepdims=True)
    push = {
        "of one axis": u[:, :2] * [0.0, 1.0],
        "with the climb": u[:, :2] * u[:, 2:],
        # a flat body, as MuJoCo's ellipsoid, shows its plan to the climb
        "of the area that is shown": u[:, :2] * u[:, 2:] ** 2 / whole,
    }[form]
    y = 0.02 * np.random.default_rng(0).standard_normal(rows.y.shape)
    for c, name in enumerate(FORCE[:2]):
        y[:, system.names.index(name)] += 0.05 * push[:, c]
    formed = dataclasses.replace(system, flights=(dataclasses.replace(rows, y=y),))
    assert find_gusts(formed, JOINT) is None


def test_what_an_accelerometer_does_not_feel_is_no_gust():
    """An attitude that wanders pushes the force that follows from the motion."""
    shown = {
        channels: find_gusts(
            _wind_and_its_drag(2.0, shown=channels, accelerometer=SPECIFIC_FORCE), JOINT
        )
        for channels in (FORCE, ACC)
    }
    assert shown[FORCE] is None
    assert shown[ACC].force_N == pytest.approx(_found(2.0).force_N, rel=0.1)


def test_no_more_gusts_than_the_file_has_are_no_news():
    system, strength = _wind_and_its_drag(1.0), _found(1.0).strength_m_s
    assert find_gusts(system, JOINT, {"wind_20ft_m_s": strength}) is None
    assert find_gusts(system, JOINT, {"wind_20ft_m_s": 0.1 * strength}) is not None


@pytest.mark.parametrize("height_m", [1.5, 4.0])
def test_a_wind_over_rough_ground_is_slower_below(height_m):
    system = build([hovering(p_z_m=height_m)], MODEL, [])
    calm = {"east_m_s": 3.0, "north_m_s": -4.0, "roughness_m": 0.0}
    assert wind_speed_m_s(system, "wind", calm) == pytest.approx(5.0)
    # the logarithmic profile, told at 10 m
    rough = wind_speed_m_s(system, "wind", {**calm, "roughness_m": 0.03})
    share = math.log(height_m / 0.03) / math.log(10.0 / 0.03)
    assert rough == pytest.approx(5.0 * share, rel=0.05)


def test_a_strength_is_known_by_a_factor():
    low, high = GUSTS.ci95
    assert low * high == pytest.approx(25.0) and high / 5.0 == pytest.approx(np.exp(0.196))
    told = GUSTS.finding()
    assert told.size["share_of_weight"] == pytest.approx(0.3 / 9.8) and told.name == "gusts"
    assert told.parameters["wind_20ft_m_s"].value == 5.0


def test_what_hangs_below_may_lean_to_push_by_all_of_its_pull():
    system = system_of(("force_x", "force_y", "force_z"), (), ())
    pull = [np.tile([0.0, 0.6, 0.8], (10, 1))]
    assert load_may_push(0.9, {"slung_load": pull}, system)
    assert not load_may_push(1.1, {"slung_load": pull}, system)
    assert not load_may_push(0.1, {"rotor_drag": pull}, system), "it does not hang"
    assert not load_may_push(0.1, {}, system)


def test_moving_air_is_heard_by_a_drag_alone():
    assert shows_moving_air({"rotor_drag": {}}) and shows_moving_air({"parasitic_drag": {}})
    assert not shows_moving_air({"ground_effect": {}}) and not shows_moving_air({})
