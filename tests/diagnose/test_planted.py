"""Plant it, see it found: candidates at the sizes given here, in flights of the project's own
simulator.

Both sides have the same form here, so this shows that each signature is right, not how good the
diagnosis is; that is what concealed cases are for (docs/proof.md).
"""

import functools
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import ges
from ges.conventions import POSITION, REFERENCE, SPECIFIC_FORCE, VELOCITY, command, rotor_speed
from ges.diagnose.design.residual import residual
from ges.diagnose.design.weak import make_windows
from ges.diagnose.detectors.gusts import load_may_push
from ges.diagnose.prepare.channels import FORCE
from ges.diagnose.prepare.gate import prepare
from ges.diagnose.report.diagnosis import Diagnosis
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres
from ges.vehicle.file import Estimate, GroundFile

POSE = ("t_s", *POSITION, *VELOCITY)
ACC = SPECIFIC_FORCE
GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
LOGGED = (*GYRO, *ACC, *command(4), "range_m", "battery_V", *REFERENCE)
ORDINARY = (
    ("height_staircase", (30.0,)),
    ("straight_runs", (30.0,)),
    ("climbs", (20.0,)),
    ("multisine", (20.0,)),
    ("yaw_turn", (20.0,)),
)
LOW = (
    ("height_staircase", (30.0,)),
    ("straight_runs", (30.0, 3.0, 0.2)),
    ("climbs", (20.0, 0.15, 0.6)),
    ("multisine", (20.0,)),
    ("yaw_turn", (20.0, 0.3)),
)
ROOM = (
    ("height_staircase", (30.0, 0.6, 2.0)),
    ("straight_runs", (40.0, 1.0)),
    ("climbs", (20.0, 0.6, 2.0)),
    ("multisine", (20.0,)),
    ("yaw_turn", (20.0,)),
)
SHAKEN = (*ORDINARY[:3], ("multisine", (40.0, 1.5, 9.0)), ("multisine", (20.0, 1.5, 9.0)))
"""Manoeuvres with their seconds, lengths and heights: the usual ones, near the ground, within a
small room, shaken harder.
"""
LEDGES = (
    ("height_staircase", (30.0, 0.3, 1.5)),
    ("straight_runs", (40.0, 2.0, 0.27)),
    ("climbs", (20.0, 1.0, 3.0)),
    ("multisine", (20.0,)),
    ("straight_runs", (20.0, 2.0, 0.3)),
)
JUST_ABOVE = (
    ("straight_runs", (40.0, 2.0, 0.5)),
    ("straight_runs", (30.0, 3.0, 0.5)),
    ("yaw_turn", (20.0, 0.5)),
    ("multisine", (20.0,)),
    ("straight_runs", (30.0, 2.0, 0.5)),
)
DRAG = {"rotor_drag": {"k_kg": 1e-4}}
CUSHION = {"ground_effect": {"form": 3, "c_a": 0.5, "decay": 1.0, "high": 10}}
PLANTED = {
    "ground_effect": CUSHION,
    "fountain_lift": {"fountain_lift": {"c_b": 0.1, "c_s": 1.0}},
    "rotor_drag": DRAG,
    "parasitic_drag": {"parasitic_drag": {"area_m2": 0.08}},
    "axial_inflow": {"axial_inflow": {"k_kg": 3e-4}},
    "translational_lift": {"translational_lift": {"c": 0.6}},
    "wind": {**DRAG, "wind": {"east_m_s": 2.5, "north_m_s": 1.0}},
    "battery_sag": {
        "battery_sag": {"sensitivity": 0.8, "nominal_V": 16, "drop_V_s": 0.06, "load_V": 0.5}
    },
    "motor_lag": {"motor_lag": {"up_s": 0.05, "down_s": 0.05}},
    "esc_delay": {"esc_delay": {"delay_s": 0.03}},
    "thrust_curve": {"thrust_curve": {"c": 0.3}},
    "weak_rotor": {"weak_rotor": {"loss_2": 0.15}},
    "slow_motor": {"slow_motor": {"loss_2": 0.06}},
    "cg_offset": {"cg_offset": {"x_m": 0.012, "y_m": 0.0}},
    "rotor_tilt": {"rotor_tilt": {"x_rad": 0.04, "y_rad": 0.0}},
    "rotor_cant": {"rotor_cant": {"angle_rad": 0.02}},
    "rotor_inertia_reaction": {"rotor_inertia_reaction": {"inertia_kg_m2": 1.5e-4}},
    "tether": {"tether": {"weight_N_m": 0.5}},
    "slung_load": {"slung_load": {"mass_kg": 0.12, "length_m": 0.5}},
    "payload": {"payload": {"mass_kg": 0.3, "x_m": 0.05, "y_m": -0.03, "z_m": 0.0}},
    "thrust_scale": {"thrust_scale": {"scale": -0.2}},
    "torque_coefficient": {"torque_coefficient": {"scale": 0.6}},
    "inertia": {"inertia": {"xx": 0.6, "yy": 0.0, "zz": 0.0}},
    "rangefinder_bias": {"rangefinder_bias": {"bias_m": 0.1}},
    "rangefinder_lag": {"rangefinder_lag": {"tau_s": 0.3}},
    "accelerometer_bias": {"accelerometer_bias": {"x_m_s2": 0.5}},
    "gyro_bias": {"gyro_bias": {"x_rad_s": 0.05}},
    "attitude_bias": {"attitude_bias": {"x_rad": 0.05}},
    "rotor_saturation": {"rotor_saturation": {"share": 0.8}},
    "gyroscopic_moment": {"gyroscopic_moment": {"inertia_kg_m2": 3e-4}},
    "ground_effect_forward_flight": {**CUSHION, "ground_effect_forward_flight": {"c": 2.0}},
    "ground_effect_lag": {**CUSHION, "ground_effect_lag": {"c": 4.0}},
    "ground_effect_moment": {**CUSHION, "ground_effect_moment": {"q": 2.5}},
    "actuator_mapping": {**CUSHION, "actuator_mapping": {"exponent": 0.5}},
    "wall_effect": {"wall_effect": {"c": 0.2, "distance_m": 1.4, "bearing_rad": 0}},
    "ceiling_effect": {"ceiling_effect": {"amplitude": 1.5, "ceiling_z_m": 2.2}},
    "downwash": {
        "downwash": {"force_N": 2267.18, "other_x_m": 1.0, "other_y_m": 0.0, "other_z_m": 2.5}
    },
}
QUICK = ("rotor_drag", "weak_rotor", "slung_load")
"""Found by ``make test`` already."""
WHERE = {
    **dict.fromkeys(
        (
            "ground_effect_forward_flight",
            "ground_effect_lag",
            "ground_effect_moment",
            "actuator_mapping",
        ),
        LOW,
    ),
    **dict.fromkeys(("wall_effect", "ceiling_effect", "downwash"), ROOM),
    "gyroscopic_moment": SHAKEN,
    "inertia": SHAKEN,
}
READ = {"slow_motor": (*LOGGED, *rotor_speed(4))}
"""What is logged where the usual columns do not show it."""


@pytest.fixture(scope="module")
def vehicle(sheet):
    return sheet(
        motor_time_constant_s={"value": 0.023, "sd_rel": 0.12},
        max_rotor_speed_rad_s={"value": 1000, "sd_rel": 0.01},
    )


def recordings_of(flown, vehicle, effects, plans=ORDINARY, logged=LOGGED):
    """Every manoeuvre once, the references and the excitation logged."""
    frames = []
    for seed, (plan, numbers) in enumerate(plans, 1):
        table = manoeuvres.MENU[plan](*numbers)
        frame, asked = flown(vehicle, effects, table, seed, logged), manoeuvres.to_frame(table)
        excitation = {
            c: np.interp(frame["t_s"], asked["t_s"], asked[c]) for c in manoeuvres.COLUMNS[10:]
        }
        frames.append(frame.assign(**excitation))
    return frames


@pytest.fixture(scope="module")
def diagnosed(flown, vehicle):
    """The diagnosis of flights in which one of :data:`PLANTED` is, made once."""

    @functools.cache
    def make(name: str) -> Diagnosis:
        plans, logged = WHERE.get(name, ORDINARY), READ.get(name, LOGGED)
        flights = recordings_of(flown, vehicle, PLANTED[name], plans, logged)
        return ges.diagnose(flights, vehicle, holdout=["flight5"])

    return make


@pytest.mark.slow
def test_a_cushion_that_any_speed_takes_away_is_one_that_fades(flown, vehicle):
    """Three was as far as the library went, and what ran to its bound did not stand."""
    fades = {**CUSHION, "ground_effect_forward_flight": {"c": 5.0}}
    found = ges.diagnose(recordings_of(flown, vehicle, fades, LOW), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == set(fades), found.sentence


def _marks(name: str) -> list:
    return [] if name in QUICK else [pytest.mark.slow]


@pytest.mark.parametrize("name", [pytest.param(n, marks=_marks(n)) for n in PLANTED])
def test_planted_effect_is_found(name, diagnosed):
    found = diagnosed(name)
    named = {f.name for f in found.findings}
    assert name in named, found.sentence
    assert named <= set(PLANTED[name]) | {name}, found.sentence


@pytest.mark.slow
def test_a_slow_motor_leaves_the_speeds_of_the_others_as_they_are(diagnosed):
    """Beside what is fitted of an effect its other numbers are corrections, and count once."""
    found = diagnosed("slow_motor")
    assert [f.place for f in found.findings] == ["rotor 2"]
    after = {name: errors["after"] for name, errors in found.fit["channels"].items()}
    given = found.fit["channels"]["drive_2_rad_s"]["before"]
    assert all(after[f"drive_{i}_rad_s"] < 0.05 * given for i in range(1, 5)), after


@pytest.mark.slow
def test_two_cut_propellers_are_two_findings_with_their_places(flown, vehicle):
    lost = {"loss_1": 0.1, "loss_3": 0.16}
    flights = recordings_of(flown, vehicle, {"weak_rotor": lost})
    found = ges.diagnose(flights, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["weak_rotor", "weak_rotor"], found.sentence
    assert {f.place for f in found.findings} == {"rotor 1", "rotor 3"}
    told = {name: e.value for f in found.findings for name, e in f.parameters.items()}
    assert told == pytest.approx(lost, rel=0.1)


@pytest.fixture(scope="module")
def nothing(flown, vehicle):
    """The diagnosis of flights in which nothing is planted."""
    return ges.diagnose(recordings_of(flown, vehicle, {}), vehicle, holdout=["flight5"])


@pytest.mark.slow
def test_nothing_planted_nothing_found(nothing):
    assert nothing.verdict == "nothing_proven", nothing.sentence
    assert nothing.detectable["ground_effect"]["smallest"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"), [("motor_lag", ("up_s", "down_s")), ("esc_delay", ("delay_s",))]
)
def test_a_lag_as_large_as_would_have_been_seen_is_found(name, parameters, nothing, flown, vehicle):
    """Lags within their prior sds are no finding: flights that show them to a tenth of a
    millisecond do not show them all.
    """
    size = 1.1 * nothing.detectable[name]["smallest"]
    found = ges.diagnose(
        recordings_of(flown, vehicle, {name: dict.fromkeys(parameters, size)}),
        vehicle,
        holdout=["flight5"],
    )
    assert [f.name for f in found.findings] == [name], found.sentence


def _taken_off(frame: pd.DataFrame, vehicle, share: float) -> pd.DataFrame:
    """The flight after a take-off at 0.95 of the command, of which the motors reach ``share``; it
    rests for a second before.
    """
    t, p = np.arange(0.0, 2.0, 0.01), vehicle.parameters()
    on, speeds, lag_s = (
        t >= 1.0,
        [f"rotor_speed_{i}_rad_s" for i in range(1, 5)],
        p["motor_time_constant_s"],
    )
    reached = (
        share * p["max_rotor_speed_rad_s"] * np.where(on, 1.0 - np.exp((1.0 - t) / lag_s), 0.0)
    )
    rest = {c: np.full(len(t), frame[c].iloc[0]) for c in frame}
    rest |= {
        "t_s": t,
        "p_z_m": np.where(t < 1.9, 0.0, frame["p_z_m"].iloc[0]),
        **dict.fromkeys(speeds, reached),
    }
    rest |= {f"u_{i}": np.where(on, 0.95, 0.0) for i in range(1, 5)}
    slowing = np.exp(-frame["t_s"] / lag_s)
    later = {c: frame[c] + (reached[-1] - frame[c].iloc[0]) * slowing for c in speeds}
    return pd.concat(
        [pd.DataFrame(rest), frame.assign(t_s=frame["t_s"] + 2.0, **later)], ignore_index=True
    )


@pytest.mark.slow
def test_a_ceiling_that_only_a_take_off_reaches_is_found(flown, vehicle):
    """What a drive does counts on the ground, too, while it lifts; all else there is left out."""
    calm = (*ORDINARY[:2], ("height_staircase", (20.0, 0.5, 1.5)), ORDINARY[4], ORDINARY[4])
    flights = recordings_of(flown, vehicle, {}, calm)
    reached = [_taken_off(f, vehicle, 0.8) if i < 2 else f for i, f in enumerate(flights)]
    found = ges.diagnose(reached, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["rotor_saturation"], found.sentence
    assert found.findings[0].parameters["share"].value == pytest.approx(0.8, rel=0.02)
    whole = ges.diagnose(
        [_taken_off(f, vehicle, 0.95) for f in flights], vehicle, holdout=["flight5"]
    )
    assert whole.verdict == "nothing_proven", whole.sentence


@pytest.mark.slow
def test_an_airframe_that_meets_the_climb_with_its_plan_is_no_inflow(flown, vehicle):
    """Twice the drag along thrust is the airframe's own, not a loss of thrust when climbing."""
    drag = {"parasitic_drag": {"area_m2": 0.15, "vertical_ratio": 2.0}}
    found = ges.diagnose(recordings_of(flown, vehicle, drag), vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["parasitic_drag"], found.sentence
    assert found.findings[0].parameters["vertical_ratio"].value == pytest.approx(2.0, rel=0.1)


@pytest.mark.slow
def test_a_drag_of_each_axis_alone_takes_no_lift_and_no_gusts_with_it(flown, vehicle):
    """MuJoCo's inertia box drags so: in a wind a lift of .98 stood beside drag and wind."""
    acting = {
        "parasitic_drag": {"area_m2": 0.1, "coupling": 0.0},
        "wind": {"east_m_s": 4.0, "north_m_s": -2.0},
    }
    found = ges.diagnose(recordings_of(flown, vehicle, acting), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == set(acting), found.sentence
    (drag,) = [f for f in found.findings if f.name == "parasitic_drag"]
    assert drag.parameters["coupling"].value < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("lever", [0.0, 1.0])
def test_a_rotor_drag_turns_the_vehicle_as_far_as_it_acts_at_the_hubs(lever, flown, vehicle):
    """Crazyflow and drone-models lump it at the centre, where it makes no moment."""
    drag = {"rotor_drag": {"k_kg": 2e-4, "lever": lever}}
    found = ges.diagnose(recordings_of(flown, vehicle, drag), vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["rotor_drag"], found.sentence
    told = found.findings[0].parameters["k_kg"]
    assert told.value == pytest.approx(2e-4, rel=0.1)
    assert ("its lever is" in told.note) == (lever < 0.5)
    at = found.vehicle.effects["rotor_drag"]["lever"]
    assert at.value == pytest.approx(lever, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "drag", [{"rotor_drag": {"k_kg": 2e-4}}, {"parasitic_drag": {"area_m2": 0.1}}], ids=list
)
def test_in_a_wind_a_drag_keeps_its_name(drag, flown, vehicle):
    """In steady air of 4 m/s what is quadratic in it is nearly linear in the motion."""
    blown = {**drag, "wind": {"east_m_s": 3.5, "north_m_s": -2.0}}
    found = ges.diagnose(recordings_of(flown, vehicle, blown), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == set(blown), found.sentence


@pytest.mark.slow
def test_air_that_hardly_moves_is_no_wind(flown, vehicle):
    breath = {"rotor_drag": {"k_kg": 2e-4}, "wind": {"east_m_s": 0.2, "north_m_s": 0.0}}
    found = ges.diagnose(recordings_of(flown, vehicle, breath), vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["rotor_drag"], found.sentence


@pytest.mark.slow
def test_a_rangefinder_that_sees_no_ground_for_a_while_is_held_against_the_height_all_the_same(
    flown, vehicle
):
    flights = recordings_of(flown, vehicle, PLANTED["rangefinder_bias"])
    gone = [
        f.assign(range_m=f["range_m"].where((f["t_s"] < 5.0) | (f["t_s"] > 8.0))) for f in flights
    ]
    found = ges.diagnose(gone, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["rangefinder_bias"], found.sentence


@pytest.mark.slow
def test_a_load_is_found_in_flights_that_begin_in_mid_swing(flown, vehicle):
    """The replay hangs it at rest; what it forgets of that in a few swings is enough."""
    load = {"mass_kg": 0.12, "length_m": 0.5}
    flights = [
        f[f["t_s"] >= 7.3].reset_index(drop=True)
        for f in recordings_of(flown, vehicle, {"slung_load": load}, ROOM)
    ]
    found = ges.diagnose(flights, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["slung_load"], found.sentence
    told = {name: e.value for name, e in found.findings[0].parameters.items()}
    assert told["length_m"] == pytest.approx(load["length_m"], rel=0.05)
    assert told["mass_kg"] == pytest.approx(load["mass_kg"], rel=0.15)


@pytest.mark.slow
def test_what_shakes_one_flight_of_four_does_not_hide_as_its_noise(flown, vehicle):
    """Where only one flight shakes, the reaction of its rotors looks like coloured noise; commands
    alone are logged.
    """
    plans = (*ORDINARY[:3], ("multisine", (25.0,)), ORDINARY[4])
    reaction = {"rotor_inertia_reaction": {"inertia_kg_m2": 1e-4}}
    flights = recordings_of(flown, vehicle, reaction, plans)
    flights = [f.drop(columns=[c for c in f if c.startswith("rotor_speed")]) for f in flights]
    found = ges.diagnose(flights, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["rotor_inertia_reaction"], found.sentence
    assert found.findings[0].parameters["inertia_kg_m2"].value == pytest.approx(1e-4, rel=0.2)


@pytest.mark.slow
def test_a_name_that_strains_the_declared_numbers_takes_no_true_one_along(flown, vehicle):
    """A minute of shaking invents a delay of the drive, against a motor 13 sds faster than
    declared; the drag is true.
    """
    plans = [(plan, (60.0, *numbers[1:])) for plan, numbers in ORDINARY if plan != "climbs"]
    found = ges.diagnose(recordings_of(flown, vehicle, DRAG, plans), vehicle, holdout=["flight4"])
    assert [f.name for f in found.findings] == ["rotor_drag"], found.sentence
    assert found.findings[0].parameters["k_kg"].value == pytest.approx(
        DRAG["rotor_drag"]["k_kg"], rel=0.05
    )


@pytest.mark.slow
@pytest.mark.parametrize("start_x_m", [0.0, 0.2])
def test_a_load_that_is_dragged_over_the_ground_is_found_with_its_thread(flown, vehicle, start_x_m):
    """On a thread below rotor 2 that is longer than the flights are high, from below or
    from ahead.
    """
    hub = {"attach_x_m": -0.12, "attach_y_m": 0.12}
    load = {"mass_kg": 0.06, "length_m": 0.8, **hub, "start_x_m": start_x_m}
    found = ges.diagnose(
        recordings_of(flown, vehicle, {"slung_load": load}, JUST_ABOVE),
        vehicle,
        holdout=["flight5"],
    )
    assert [f.name for f in found.findings] == ["slung_load"], found.sentence
    told = {name: e.value for name, e in found.vehicle.effects["slung_load"].items()}
    assert told["length_m"] == pytest.approx(load["length_m"], rel=0.02)
    assert told["mass_kg"] == pytest.approx(load["mass_kg"], rel=0.1)
    assert {name: told[name] for name in hub} == hub
    assert told["start_x_m"] == pytest.approx(start_x_m, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("roughness_m", [0.0, 0.05])
def test_a_wind_is_told_with_how_it_grows_with_height(roughness_m, flown, vehicle):
    blows = {**DRAG, "wind": {"east_m_s": 3.0, "north_m_s": 1.5, "roughness_m": roughness_m}}
    found = ges.diagnose(recordings_of(flown, vehicle, blows), vehicle, holdout=["flight5"])
    told = next(f for f in found.findings if f.name == "wind").parameters
    assert told["east_m_s"].value == pytest.approx(3.0, rel=0.1) and told[
        "north_m_s"
    ].value == pytest.approx(1.5, rel=0.1)
    assert ("roughness_m" in told) == (roughness_m > 0.0)
    assert not roughness_m or told["roughness_m"].value == pytest.approx(roughness_m, rel=0.5)


@pytest.mark.slow
def test_a_noisy_reading_of_the_voltage_makes_no_smaller_sag(flown, vehicle):
    """Noise of 1 %: taken as read it makes a sensitivity of 0.8 one of 0.53."""
    flights = recordings_of(flown, vehicle, PLANTED["battery_sag"])
    noise = np.random.default_rng(0)
    noisy = [f.assign(battery_V=f["battery_V"] + noise.normal(0.0, 0.16, len(f))) for f in flights]
    (finding,) = ges.diagnose(noisy, vehicle, holdout=["flight5"]).findings
    assert finding.parameters["sensitivity"].value == pytest.approx(0.8, rel=0.12)


@pytest.mark.slow
def test_another_vehicle_is_found_where_it_hovers(diagnosed):
    told = diagnosed("downwash").findings[0].parameters
    assert told["other_x_m"].value == pytest.approx(1.0, abs=0.05)
    assert told["other_y_m"].value == pytest.approx(0.0, abs=0.2)


@pytest.fixture(scope="module")
def gusty(flown, vehicle):
    """Flights with drag, a wind (east and north, m/s) and gusts that are others in every flight."""

    def make(strength_m_s: float, *wind: float):
        blowing = {"wind": dict(zip(("east_m_s", "north_m_s"), wind, strict=True))} if wind else {}
        gusts = [
            {"gusts": {"wind_20ft_m_s": strength_m_s, "seed": float(k)}}
            for k, _ in enumerate(ORDINARY, 7)
        ]
        return [
            recordings_of(flown, vehicle, {**DRAG, **blowing, **g}, [plan])[0]
            for g, plan in zip(gusts, ORDINARY, strict=True)
        ]

    return make


@pytest.mark.slow
@pytest.mark.parametrize("strength_m_s", [2.5, 8.0])
def test_gusts_are_told_with_their_strength_and_not_as_a_steady_wind(strength_m_s, gusty, vehicle):
    found = ges.diagnose(gusty(strength_m_s), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == {"rotor_drag", "gusts"}, found.sentence
    low, high = (
        next(f for f in found.findings if f.name == "gusts").parameters["wind_20ft_m_s"].ci95
    )
    assert 0.6 * low < strength_m_s < high / 0.6 and high < 5.0 * low
    assert found.vehicle.effects["gusts"]["wind_20ft_m_s"].value == pytest.approx(
        (low * high) ** 0.5
    )
    again = ges.diagnose(gusty(strength_m_s), found.vehicle, holdout=["flight5"])
    assert not again.findings, again.sentence


@pytest.mark.slow
def test_a_wind_that_gusts_do_not_make_stands_beside_them(gusty, vehicle):
    found = ges.diagnose(gusty(2.0, 3.0, 1.5), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == {"rotor_drag", "wind", "gusts"}, found.sentence


@pytest.mark.slow
def test_a_wind_that_gusts_may_make_flies_on_as_a_correction(gusty, vehicle):
    found = ges.diagnose(gusty(4.0, 3.0, 1.5), vehicle, holdout=["flight5"])
    assert {f.name for f in found.findings} == {"rotor_drag", "gusts"}, found.sentence
    calibration = found.content()["calibration"]
    for key, wind_m_s in (("wind.east_m_s", 3.0), ("wind.north_m_s", 1.5)):
        low, high = calibration[key]["ci95"]
        assert low < wind_m_s < high


@pytest.mark.slow
def test_gusts_are_found_where_the_drag_is_known_and_one_flight_tells_of_no_forces(gusty, vehicle):
    dragged = vehicle.model_copy(
        update={"effects": {"rotor_drag": {"k_kg": Estimate(value=DRAG["rotor_drag"]["k_kg"])}}}
    )
    flights = gusty(8.0)
    silent = flights[1].drop(columns=list(VELOCITY))
    found = ges.diagnose([silent, *flights], dragged, holdout=["flight6"])
    assert [f.name for f in found.findings] == ["gusts"], found.sentence


def test_a_tether_that_may_lean_pushes_as_gusts_do():
    """Ten newtons that lean by an eighth push as gusts of 1.2 N do."""
    system = SimpleNamespace(main=FORCE)
    assert load_may_push(1.2, {"tether": [np.full((50, 3), [0.0, 0.0, -10.0])]}, system)
    assert not load_may_push(1.2, {"tether": [np.full((50, 3), [0.0, 0.0, -1.0])]}, system)
    assert not load_may_push(1.2, {"ground_effect": [np.full((50, 3), [0.0, 0.0, 10.0])]}, system)


def test_gusts_are_not_looked_for_where_nothing_carries_them(diagnosed):
    assert "through drag" in diagnosed("weak_rotor").not_tested["gusts"]


@pytest.fixture
def over_ledges(sheet, vehicle, tmp_path):
    """The vehicle over steps of 15 cm, half a metre apart."""
    x = np.linspace(-4.0, 8.0, 481)
    steps = np.tile(np.where(x % 1.0 < 0.5, 0.0, 0.15), (2, 1))
    np.savez(tmp_path / "ledges.npz", x_m=x, y_m=[-9.0, 9.0], z_m=steps)
    # in memory there is no folder of the vehicle file beside which it could lie
    ledges = GroundFile.model_construct(kind="grid", file=str(tmp_path / "ledges.npz"))
    return vehicle.model_copy(update={"terrain": ledges})


@pytest.mark.slow
def test_partial_ground_effect_is_found_over_ledges(flown, over_ledges):
    effects = {**CUSHION, "partial_ground_effect": {"k": 1.0}}
    found = ges.diagnose(
        recordings_of(flown, over_ledges, effects, LEDGES), over_ledges, holdout=["flight5"]
    )
    assert {f.name for f in found.findings} == set(effects), found.sentence


def test_where_a_leaning_beam_falls_speaks_about_no_error_of_the_attitude(flown, over_ledges):
    """A rangefinder sees a patch, the model a point: of a bias of 50 mrad the forces speak
    alone.
    """
    (frame,) = recordings_of(flown, over_ledges, {}, LEDGES[1:2])
    model = from_vehicle(over_ledges, ".")
    flight = prepare(frame, model)
    windows, biased = (
        make_windows(flight.t_s, flight.flying, 0.2),
        {"attitude_bias": {"x_rad": 0.05}},
    )
    plain, leaning = (
        residual(flight, windows, model, ("range", "force_y"), more) for more in (None, biased)
    )
    assert np.array_equal(plain[:, 0], leaning[:, 0])
    assert np.mean(plain[:, 1] - leaning[:, 1]) == pytest.approx(
        0.05 * model.reference_scale("force_y"), rel=0.1
    )


@pytest.mark.slow
def test_a_late_pose_is_a_time_offset(flown, vehicle):
    """Position, velocity and attitude 30 ms behind gyro, accelerometer and rotor speeds."""
    late = [*POSE[1:], "q_w", "q_x", "q_y", "q_z"]
    flights = [
        f.assign(**{c: np.interp(f["t_s"] - 0.03, f["t_s"], f[c]) for c in late})
        for f in recordings_of(flown, vehicle, {})
    ]
    found = ges.diagnose(flights, vehicle, holdout=["flight5"])
    assert [f.name for f in found.findings] == ["time_offset"], found.sentence
    delay = next(iter(found.findings[0].parameters.values()))
    assert delay.ci95[0] < 0.03 < delay.ci95[1]


def test_every_effect_is_planted_or_said_to_be_out_of_reach():
    from ges.simulator import effects

    elsewhere = {"time_offset", "partial_ground_effect", "coaxial_wake"}
    assert set(effects.table()) - set(PLANTED) - elsewhere == {"gusts"}
    assert effects.get("gusts").settled
