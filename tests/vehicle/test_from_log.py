"""A vehicle from a log: the numbers of a simulated one come back, and doubts hold the truth."""

import numpy as np
import pandas as pd
import pytest
import yaml

from ges.conventions import GRAVITY_M_S2, command, rotor_speed
from ges.errors import GesError, UsageError
from ges.vehicle.drive import curve_at_hover, hover, normalised_thrust, response
from ges.vehicle.file import Quantity, parse_vehicle
from ges.vehicle.from_log import describe_log
from ges.vehicle.propeller import Propeller
from ges.vehicle.turning import turning

from .conftest import CURVE, Log, fly

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

PROP, KNOWN_CURVE = Propeller(0.24), Quantity(value=CURVE, sd=0.0)
PARAMETERS = {
    "CA_ROTOR_COUNT": 4,
    "THR_MDL_FAC": 1 - CURVE,
    **{f"CA_ROTOR{i}_PX": x for i, x in enumerate((0.175, -0.175, 0.175, -0.175))},
    **{f"CA_ROTOR{i}_PY": y for i, y in enumerate((0.175, -0.175, -0.175, 0.175))},
    **{f"CA_ROTOR{i}_KM": k for i, k in enumerate((0.05, 0.05, -0.05, -0.05))},
}


def _without(frame, *prefixes):
    return frame.drop(columns=[c for c in frame if c.startswith(prefixes)])


def _near(quantity: Quantity, truth: float, sds: float = 2.5) -> bool:
    return abs(quantity.value - truth) < sds * quantity.sd


def test_hovering_tells_the_thrust_coefficient(flight, flown_vehicle):
    truth = flown_vehicle.thrust_coefficient_N_s2.value
    found = hover(flight, 1.5, KNOWN_CURVE, 0.12)
    assert found.measured and found.quiet
    assert _near(found.thrust_per_drive, truth)
    assert found.thrust_per_drive.value == pytest.approx(truth, rel=0.02)


@pytest.mark.parametrize("lacking", ["rotor_speed_", "v_", "q_", "acc_", "p_z"])
def test_hovering_needs_no_single_stream(flight, flown_vehicle, lacking):
    frame = _without(flight, lacking)
    found = hover(frame, 1.5, KNOWN_CURVE, 0.12)
    largest = flown_vehicle.thrust_coefficient_N_s2.value * 1000.0**2
    measured = "rotor_speed_1_rad_s" in frame
    truth = flown_vehicle.thrust_coefficient_N_s2.value if measured else largest
    assert found.thrust_per_drive.value == pytest.approx(truth, rel=0.03)


def test_thrust_is_as_uncertain_as_the_curve_that_it_was_told_with(flight):
    frame = _without(flight, "rotor_speed_")
    known, found = (
        hover(frame, 1.5, Quantity(value=CURVE, sd=sd), 0.12).thrust_per_drive for sd in (0.0, 0.2)
    )
    u = frame[list(COMMAND)].median().mean()
    # T = k ((1 - c) u^2 + c u): d ln k / dc at the same thrust in hover
    share = 0.2 * (u - u * u) / ((1.0 - CURVE) * u * u + CURVE * u)
    assert found.value == known.value
    assert found.sd / found.value == pytest.approx(
        np.hypot(known.sd / known.value, share), rel=0.15
    )
    measured = hover(flight, 1.5, Quantity(value=CURVE, sd=0.2), 0.12)
    assert measured == hover(flight, 1.5, KNOWN_CURVE, 0.12)


def test_standing_with_idling_rotors_is_no_hovering(flight, flown_vehicle):
    """Nor is it when it lasts as long as the flight does."""
    longer = flight.iloc[:400]
    longer = pd.concat([longer] * 8, ignore_index=True)
    step_s = float(np.median(np.diff(flight["t_s"])))
    longer["t_s"] = flight["t_s"].iloc[0] - step_s * np.arange(len(longer), 0, -1)
    frame = pd.concat([longer, flight], ignore_index=True)
    found = hover(_without(frame, "rotor_speed_", "p_"), 1.5, KNOWN_CURVE, 0.12)
    assert found.thrust_per_drive.value == pytest.approx(10.38, rel=0.03)


def test_too_short_a_flight_and_dead_motors_are_refused(flight):
    with pytest.raises(GesError, match="it takes 5 s"):
        hover(flight.iloc[500:700], 1.5, KNOWN_CURVE, 0.12)
    dead = flight.assign(**dict.fromkeys(COMMAND, 0.0))
    with pytest.raises(GesError, match="commands above zero"):
        hover(_without(dead, "rotor_speed_"), 1.5, KNOWN_CURVE, 0.12)
    with pytest.raises(GesError, match="neither rotor speeds nor motor commands"):
        hover(_without(flight, "rotor_speed_", "u_"), 1.5, KNOWN_CURVE, 0.12)
    with pytest.raises(GesError, match="neither a velocity nor an accelerometer"):
        hover(_without(flight, "v_", "acc_"), 1.5, KNOWN_CURVE, 0.12)


def test_telemetry_tells_top_speed_and_curve(flight):
    found = response(flight, Quantity(value=0.6, sd=0.3))
    assert _near(found.top_speed_rad_s, 1000.0)
    assert _near(found.c, CURVE)
    assert found.r2 > 0.9


def test_lively_flight_tells_the_lag(flown_vehicle):
    found = response(fly(flown_vehicle, "multisine", 20.0), Quantity(value=0.6, sd=0.3))
    assert found.lag_s.value == pytest.approx(0.045, rel=0.1)


def test_slow_telemetry_tells_no_lag_and_foreign_speeds_nothing(flight):
    slow = flight.copy()
    slow.loc[slow.index % 25 != 0, list(ROTOR_SPEED)] = np.nan
    found = response(slow, Quantity(value=0.6, sd=0.3))
    assert found.lag_s is None and _near(found.top_speed_rad_s, 1000.0)
    rng = np.random.default_rng(1)
    noise = flight.assign(**{c: rng.uniform(100, 900, len(flight)) for c in ROTOR_SPEED})
    assert response(noise, Quantity(value=0.6, sd=0.3)) is None


def test_curve_at_hover_has_the_slope_it_was_asked_for():
    for elasticity in (1.1, 1.5, 1.9):
        c = curve_at_hover(elasticity, 0.4)
        u = np.array([0.4 - 1e-5, 0.4 + 1e-5])
        slope = np.diff(np.log(normalised_thrust(u, c))) / np.diff(np.log(u))
        assert slope[0] == pytest.approx(elasticity, rel=1e-4)


def test_the_flight_shows_which_rotor_turns_it_how(flight, flown_vehicle):
    seen = turning(flight)
    assert seen.confirmed(flown_vehicle.rotors) == ["roll", "pitch", "yaw"]
    assert seen.contradicted(flown_vehicle.rotors) == []


def test_a_log_with_speeds_gives_back_the_vehicle(flight, flown_vehicle):
    sheet = describe_log(Log(flight, parameters=PARAMETERS), 1.5, PROP)
    found, truth = sheet.vehicle, flown_vehicle
    assert _near(found.thrust_coefficient_N_s2, truth.thrust_coefficient_N_s2.value)
    assert _near(found.max_rotor_speed_rad_s, 1000.0)
    assert _near(found.motor_time_constant_s, 0.045)
    assert _near(found.effects["thrust_curve"]["c"], CURVE)
    for made, real in zip(found.rotors, truth.rotors, strict=True):
        assert made.spin == real.spin
        assert (made.x_m.value, made.y_m.value) == (real.x_m.value, real.y_m.value)
    assert not sheet.remarks


def test_a_log_with_commands_alone_carries_the_weight(flight, flown_vehicle):
    """Coefficient and top speed are nominal; their product, which acts, is right."""
    frame = _without(flight, "rotor_speed_")
    found = describe_log(Log(frame, parameters=PARAMETERS), 1.5, PROP).vehicle
    k, top = found.thrust_coefficient_N_s2, found.max_rotor_speed_rad_s.value
    assert k.value * top**2 == pytest.approx(10.38, rel=2.5 * k.sd / k.value)
    flying = flight["u_1"] > 0.2
    commands = flight.loc[flying, list(COMMAND)].to_numpy()
    c = found.effects["thrust_curve"]["c"].value
    lift = k.value * top**2 * normalised_thrust(commands, c).sum(axis=1)
    assert np.median(lift) == pytest.approx(1.5 * GRAVITY_M_S2, rel=0.03)


def test_px4_curve_depends_on_where_the_commands_were_taken(flight):
    frame = _without(flight, "rotor_speed_")
    for source, factor, c in (
        ("actuator_motors", 0.6, 1.0),
        ("actuator_outputs", 0.6, 0.4),
        ("actuator_outputs", 0.0, 0.447),
    ):
        log = Log(frame, parameters={**PARAMETERS, "THR_MDL_FAC": factor}, command=source)
        found = describe_log(log, 1.5, PROP).vehicle.effects["thrust_curve"]["c"]
        assert found.value == pytest.approx(c, abs=0.01) and found.sd >= 0.1


def test_ardupilot_curve_has_the_slope_of_its_own(flight):
    frame = _without(flight, "rotor_speed_")
    parameters = {"FRAME_CLASS": 1, "FRAME_TYPE": 1, "MOT_THST_EXPO": 0.5}
    parameters |= {"MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9}
    log = Log(frame, "ardupilot", "ArduCopter 4.5", parameters=parameters)
    c = describe_log(log, 1.5, PROP).vehicle.effects["thrust_curve"]["c"].value
    u = float(np.median(flight.loc[flight["u_1"] > 0.15, list(COMMAND)]))
    near = np.array([u - 1e-4, u + 1e-4])
    s = (near - 0.1) / 0.8
    theirs = np.diff(np.log(0.5 * s + 0.5 * s * s))
    assert np.diff(np.log(normalised_thrust(near, c))) == pytest.approx(theirs, rel=0.05)


def test_a_wrong_order_of_motors_is_refused_with_the_right_one(flight):
    log = Log(flight, "betaflight", "Betaflight 4.5")
    with pytest.raises(UsageError, match="contradicts the order.*--frame x"):
        describe_log(log, 1.5, PROP)
    assert describe_log(log, 1.5, PROP, layout="x", wheelbase_m=0.495).vehicle


def test_a_table_without_parameters_shows_its_layout_in_flight(flight):
    found = describe_log(Log(flight, "table", ""), 1.5, PROP).vehicle
    assert [r.spin for r in found.rotors] == ["ccw", "ccw", "cw", "cw"]
    hover_only = flight[(flight["t_s"] > 0) & (flight["t_s"] < 6)]
    still = hover_only.assign(**dict.fromkeys(["omega_x_rad_s", "omega_y_rad_s"], 0.0))
    with pytest.raises(UsageError, match="give --frame"):
        describe_log(Log(still, "table", ""), 1.5, PROP)


def test_thrust_that_no_such_propeller_has_is_remarked(flight):
    sheet = describe_log(Log(flight, parameters=PARAMETERS), 1.5, Propeller.parse("5in"))
    assert any("it would suit" in remark for remark in sheet.remarks)


def test_impossible_masses_are_refused(flight):
    for mass in (0.0, -1.0, 1e6, float("nan")):
        with pytest.raises(UsageError, match="allowed is 0.005 to 200 kg"):
            describe_log(Log(flight, parameters=PARAMETERS), mass, PROP)


def test_every_number_of_the_file_has_its_source(flight):
    sheet = describe_log(Log(flight, parameters=PARAMETERS), 1.5, PROP)
    text = sheet.to_yaml()
    lines = text.splitlines()
    assert max(map(len, (line for line in lines if line.lstrip().startswith("#")))) <= 100
    for key in set(yaml.safe_load(text)) - {"name", "terrain", "effects"}:
        (at,) = (i for i, line in enumerate(lines) if line.startswith(f"{key}:"))
        assert lines[at - 1].startswith("# "), key
    again = parse_vehicle(yaml.safe_load(text))
    assert again.mass_kg == sheet.vehicle.mass_kg
    k, written = sheet.vehicle.thrust_coefficient_N_s2, again.thrust_coefficient_N_s2
    assert abs(k.value - written.value) < 0.05 * k.sd


def test_damaged_flights_end_in_a_vehicle_or_a_sentence(flight):
    """Columns lost, frozen, cut, scaled and full of holes; parameters that are no numbers."""
    rng = np.random.default_rng(11)
    columns = [c for c in flight if c != "t_s"]
    for _ in range(40):
        frame = flight.iloc[:: int(rng.integers(1, 12))].reset_index(drop=True)
        for column in rng.choice(columns, int(rng.integers(0, 30)), replace=False):
            match int(rng.integers(5)):
                case 0:
                    frame = frame.drop(columns=column)
                case 1:
                    frame[column] = float(rng.choice([0.0, 1.0, np.nan, -5.0]))
                case 2:
                    frame.loc[rng.random(len(frame)) < 0.5, column] = np.nan
                case 3:
                    frame[column] *= float(rng.choice([-1.0, 1e-9, 1e9]))
                case _:
                    frame.loc[frame.index > int(rng.integers(len(frame))), column] = np.nan
        parameters = dict(PARAMETERS)
        for key in rng.choice(sorted(parameters), 2):
            parameters[key] = float(rng.choice([np.nan, np.inf, 0.0, -3.0, 1e30, 4.0]))
        parameters["MOT_THST_EXPO"] = float(rng.choice([np.nan, -5.0, 0.65, 9.0]))
        kind = str(rng.choice(["px4", "ardupilot", "betaflight", "crazyflie", "table"]))
        try:
            sheet = describe_log(Log(frame, kind, parameters=parameters), 1.5, PROP)
        except GesError as error:
            assert "\n" not in str(error)
            continue
        parse_vehicle(yaml.safe_load(sheet.to_yaml()))
