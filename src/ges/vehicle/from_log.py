"""A vehicle file from a flight log, the mass and the propeller.

Geometry and thrust curve are those of the log's parameters. The thrust coefficient follows from the
weight that the flight carried. What no log tells comes from scaling laws. Every number keeps its
source and its standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import pandas as pd

from ges.conventions import GRAVITY_M_S2, rotors_in
from ges.errors import UsageError
from ges.vehicle import airframe, propeller, scaling
from ges.vehicle.airframe import Airframe
from ges.vehicle.datasheet import Datasheet
from ges.vehicle.drive import Hover, Response, curve_at_hover, hover, response
from ges.vehicle.file import Estimate, Quantity, parse_vehicle
from ges.vehicle.layouts import of_rotors
from ges.vehicle.parsing import require_mass
from ges.vehicle.propeller import Propeller
from ges.vehicle.turning import Turning, turning

MASS_SD_REL = 0.01
AIR_KG_M3 = Quantity(value=1.2, sd=0.05)
# A thrust curve that somebody set up for these motors, and one that nobody touched.
TUNED_SD, FLOWN_SD = 0.15, 0.1
ARDUPILOT_EXPO = 0.65
# A thrust coefficient this many times off is no spread of propellers.
UNLIKELY = 1.8
TAIL_SERVO = (
    "A tricopter turns about yaw by a servo at its tail, which is not modelled: its yaw moment"
    " tells nothing."
)
# Plus and X layouts agree in roll and pitch to 0.71.
SURELY = 0.9


class ReadableStream(Protocol):
    """What :func:`describe_log` reads of a stream: where it comes from."""

    @property
    def source(self) -> str:
        """Topic, message or event of the log."""


class ReadableLog(Protocol):
    """What :func:`describe_log` reads of a log; see :class:`ges.recordings.readers.ReadableLog`."""

    @property
    def name(self) -> str:
        """Stem of the file."""

    @property
    def format(self) -> str:
        """Name of the reader."""

    @property
    def autopilot(self) -> str:
        """Firmware and version; '' where the log does not say."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """The autopilot's own parameters, as logged."""

    @property
    def streams(self) -> Mapping[str, ReadableStream]:
        """Streams by name."""

    def frame(self) -> pd.DataFrame:
        """All columns on one time axis."""


def describe_log(
    log: ReadableLog,
    mass_kg: float,
    prop: Propeller,
    *,
    layout: str | None = None,
    wheelbase_m: float | None = None,
    name: str = "multirotor",
) -> Datasheet:
    """Make a vehicle file from a flight log.

    Parameters
    ----------
    log : the flight.
    mass_kg : mass as flown, weighed; 0.005 to 200 kg.
    prop : propellers of all rotors.
    layout : order and spins of the motors, see :func:`~ges.vehicle.layouts.layout_of`; by default
        those of the log, or those that the flight shows.
    wheelbase_m : distance of opposite hubs, m; by default that of the log or of usual vehicles.
    name : name of the vehicle.

    Returns
    -------
    The vehicle with the source of each number; ``to_yaml()`` writes it.

    Raises
    ------
    GesError
        When the log is of no multirotor, or flies too little.
    UsageError
        When the mass is not possible, the layout is unknown, or the flight contradicts it.

    Notes
    -----
    Thrust coefficient k from hover, in half seconds: m (g + dv_z/dt) / cos(tilt) = k sum_i w_i^2.
    docs/from-log-to-vehicle.md has the other numbers.

    Examples
    --------
    >>> from ges.vehicle.from_log import describe_log
    >>> from ges.vehicle.propeller import Propeller
    >>> sheet = describe_log(log, 1.2, Propeller.parse("8in"))
    >>> sheet.vehicle.mass_kg
    Quantity(value=1.2, sd=0.012)
    """
    require_mass(mass_kg)
    frame = log.frame()
    seen = turning(frame)
    rotors = _airframe(log, prop, layout, wheelbase_m, seen, rotors_in(frame))
    curve, curve_source = _curve(log, prop, frame)
    # speeds beside commands show the curve of this very drive; what was known before is the prior
    measured = response(frame, curve)
    if measured:
        curve = measured.c
        curve_source = (
            f"Fitted to the telemetry's rotor speeds at commands of {measured.span[0]:.2f} to"
            f" {measured.span[1]:.2f} (R2 {measured.r2:.2f}). Before it: {curve_source}"
        )
    flown = hover(frame, mass_kg, curve, prop.radius_m)
    thrust, thrust_sources, size_remarks = _thrust(flown, measured, prop, mass_kg)
    # torque follows from the thrust of this flight, not from that of usual propellers
    coefficient = Quantity.model_validate(thrust["thrust_coefficient_N_s2"]).value
    unlogged, unlogged_sources = _unlogged(
        mass_kg,
        rotors.arm_m,
        coefficient,
        prop,
        measured.lag_s if measured else None,
        log.format == "crazyflie",
    )
    remarks = (*rotors.remarks, *size_remarks)
    if rotors.yaw_by_servo:
        unlogged.pop("torque_coefficient_Nm_s2")
        remarks = (TAIL_SERVO, *remarks)
    content = {
        "name": name,
        "mass_kg": {"value": mass_kg, "sd": MASS_SD_REL * mass_kg},
        "rotors": [rotor.model_dump(exclude_none=True) for rotor in rotors.rotors],
        "rho_kg_m3": AIR_KG_M3.plain(),
        "effects": {"thrust_curve": {"c": Estimate(value=curve.value, sd=curve.sd).plain()}},
        **thrust,
        **unlogged,
    }
    sources = {
        "mass_kg": f"As given; weighed to {MASS_SD_REL:.0%}.",
        "rotors": _rotors_source(rotors, seen),
        "rho_kg_m3": "Not in the log: air between sea level and 1000 m, to 4%.",
        "effects.thrust_curve": curve_source,
        **thrust_sources,
        **unlogged_sources,
    }
    origin = (
        f"Made by ges vehicle from a flight log ({log.autopilot or log.format}),"
        f" {mass_kg:g} kg and propellers of {prop}. A number with an sd may be off by that much;"
        " 'ges calibrate' on healthy flights narrows it."
    )
    return Datasheet(parse_vehicle(content, "the vehicle"), origin, sources, remarks)


def _airframe(
    log: ReadableLog,
    prop: Propeller,
    layout: str | None,
    wheelbase_m: float | None,
    seen: Turning | None,
    count: int,
) -> Airframe:
    """Find the rotors, of which ``count`` were logged, from the user, the log or the flight.

    Raises
    ------
    UsageError
        When the flight contradicts their order or spins.
    """
    layouts = of_rotors(count)
    if layout is not None:
        built = airframe.from_layout(layout, prop, wheelbase_m)
    # older headers do not say which way the motors turn; yaw shows it
    elif log.format == "betaflight" and "yaw_motors_reversed" not in log.parameters:
        built = airframe.from_layout(_propellers_out(seen, prop), prop, wheelbase_m)
    elif log.format in ("px4", "ardupilot", "betaflight", "crazyflie"):
        built = airframe.from_parameters(log.format, log.parameters, prop, wheelbase_m)
    else:
        built = airframe.from_layout(_layout_flown(seen, prop, layouts), prop, wheelbase_m)
    if len(built.rotors) != count:
        raise UsageError(
            f"the log has commands or speeds of {count} motors, its frame {len(built.rotors)}; give"
            f" --frame, one of {', '.join(layouts) or 'none that is known'}"
        )
    # a wrong order makes every moment wrong and no force: nothing later would show it
    if seen and (against := seen.contradicted(built.rotors)):
        fits = [n for n in layouts if _fits(n, seen, prop)]
        hint = f"it fits --frame {fits[0]}" if fits else f"layouts are {', '.join(layouts)}"
        raise UsageError(
            f"the flight contradicts the order or spins of the motors in {_listed(against)}:"
            f" the vehicle turns otherwise than its commands would turn it; {hint}"
        )
    return built


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _fits(name: str, seen: Turning, prop: Propeller) -> bool:
    """Tell whether all three axes turn as this layout, and no other, would turn them."""
    rotors = airframe.from_layout(name, prop, None).rotors
    return bool(np.all(seen.agreement(rotors) > SURELY))


def _propellers_out(seen: Turning | None, prop: Propeller) -> str:
    """Choose Betaflight's layout, with reversed propellers where the flight shows it."""
    usual, other = "betaflight-x", "betaflight-x-reversed"
    against = seen and seen.contradicted(airframe.from_layout(usual, prop, None).rotors)
    return other if against == ["yaw"] else usual


def _layout_flown(seen: Turning | None, prop: Propeller, layouts: Sequence[str]) -> str:
    """Find the one layout that the flight itself shows."""
    fits = [name for name in layouts if seen and _fits(name, seen, prop)]
    if len(fits) != 1:
        raise UsageError(
            "the log does not say how the motors are arranged and the flight does not show it"
            f" clearly; give --frame, one of {', '.join(layouts) or 'none that is known'}"
        )
    return fits[0]


def _rotors_source(built: Airframe, seen: Turning | None) -> str:
    confirmed = seen.confirmed(built.rotors) if seen else []
    checked = (
        f"The flight bears that out in {_listed(confirmed)}."
        if confirmed
        else "The flight does not show whether that is so: it is logged too slowly, or hardly"
        " steered."
    )
    return (
        f"{built.source} {checked} Radius as given. How high the rotors lie over the centre of mass"
        " no log tells."
    )


def _curve(log: ReadableLog, prop: Propeller, frame: pd.DataFrame) -> tuple[Quantity, str]:
    """Give the linear share of thrust over command before the flight is used, and its source."""
    source = log.streams["command"].source if "command" in log.streams else ""
    common = propeller.thrust_curve(prop)
    default = (
        "what controllers and propellers of this size have (ArduPilot's default exponent, after"
        " about a hundred measured propellers)"
    )
    # duty cycles come after the battery compensation, the mixer's requests before it
    if log.format == "crazyflie" and source.startswith("pwm"):
        return common, f"Duty cycles were logged, not the thrust that was asked for: {default}."
    if log.format == "crazyflie":
        return Quantity(value=1.0, sd=FLOWN_SD), "The firmware commands thrust, so it is linear."
    if log.format == "px4":
        factor = float(log.parameters.get("THR_MDL_FAC", 0.0))
        # 0 is PX4's default, and says nothing of the motors
        if not 0.0 < factor <= 1.0:
            return common, f"THR_MDL_FAC is not set: {default}."
        if source == "actuator_motors":
            return (
                Quantity(value=1.0, sd=TUNED_SD),
                f"Commands before THR_MDL_FAC ({factor:g}) is applied, which makes thrust follow"
                " them, as far as it was tuned.",
            )
        return Quantity(value=1.0 - factor, sd=TUNED_SD), f"1 - THR_MDL_FAC ({factor:g})."
    if log.format == "ardupilot" and "MOT_THST_EXPO" in log.parameters:
        return _ardupilot_curve(log.parameters, frame)
    return common, f"Not in the log: {default}."


def _ardupilot_curve(parameters: Mapping[str, float], frame: pd.DataFrame) -> tuple[Quantity, str]:
    """Give the curve with the slope of ArduPilot's at the median command.

    T ~ (1 - e) s + e s^2 over s = (u - MOT_SPIN_MIN) / (MOT_SPIN_MAX - MOT_SPIN_MIN).
    """
    expo = float(np.clip(airframe.number_of(parameters, "MOT_THST_EXPO", None), -1.0, 1.0))
    low = airframe.number_of(parameters, "MOT_SPIN_MIN", 0.15)
    high = airframe.number_of(parameters, "MOT_SPIN_MAX", 0.95)
    # an exponent that nobody touched tells of common propellers, not of these
    sd = FLOWN_SD + TUNED_SD if math.isclose(expo, ARDUPILOT_EXPO, abs_tol=1e-3) else TUNED_SD
    # the curve is wanted where it flies, not where it idles
    commands = frame.filter(regex=r"^u_[1-9]$").to_numpy(dtype=float).ravel()
    commands = commands[np.isfinite(commands) & (commands > low + 0.05)]
    text = f"MOT_THST_EXPO {expo:g} over MOT_SPIN_MIN {low:g} to MOT_SPIN_MAX {high:g}"
    if len(commands) == 0 or not high > low:
        return Quantity(value=min(max(1.0 - expo, -0.5), 1.0), sd=sd), f"1 - {text}."
    u = float(np.median(commands))
    s = (u - low) / (high - low)
    # d ln T / d ln u = (dT/ds / T) (ds/du) u at the median command
    slope = (1.0 - expo + 2.0 * expo * s) / ((1.0 - expo) * s + expo * s * s) * u / (high - low)
    return Quantity(value=curve_at_hover(slope, u), sd=sd), f"Slope at hover of {text}."


def _thrust(
    flown: Hover, measured: Response | None, prop: Propeller, mass_kg: float
) -> tuple[dict, dict[str, str], tuple[str, ...]]:
    """Give thrust coefficient and top speed, their sources, and what looks wrong with them."""
    weight_N = mass_kg * GRAVITY_M_S2
    hovered = (
        f"From {flown.seconds:.0f} s of hovering under {weight_N:.3g} N"
        if flown.quiet
        else f"From {flown.seconds:.0f} s of flight of {mass_kg:.3g} kg, which seldom hovers"
    )
    # a second source of the same number, so that a wrong size or mass is noticed
    usual = propeller.thrust_coefficient(prop, AIR_KG_M3.value)
    if not flown.measured:
        return _thrust_commanded(flown, prop, usual, weight_N, hovered)
    thrust = flown.thrust_per_drive
    content = {"thrust_coefficient_N_s2": thrust.plain()}
    sources = {
        "thrust_coefficient_N_s2": (
            f"{hovered} at measured rotor speeds of {math.sqrt(flown.drive):.0f} rad/s. Propellers"
            f" of {prop} usually have {usual.value:.2g}, to {propeller.CT_SD_REL:.0%}."
        )
    }
    if measured:
        top = measured.top_speed_rad_s
        ratio = flown.n_rotors * thrust.value * top.value**2 / weight_N
        content["max_rotor_speed_rad_s"] = top.plain()
        sources["max_rotor_speed_rad_s"] = (
            "Speed at full command, from the telemetry's speeds at commands of"
            f" {measured.span[0]:.2f} to {measured.span[1]:.2f}. Thrust to weight: {ratio:.2g}."
        )
    return content, sources, _check_size(thrust.value / usual.value, prop)


def _check_size(ratio: float, prop: Propeller) -> tuple[str, ...]:
    """Say what a thrust coefficient far from that of the propeller's size suggests."""
    if 1.0 / UNLIKELY < ratio < UNLIKELY:
        return ()
    # k ~ D^4
    suited = Propeller(prop.diameter_m * ratio**0.25, prop.blades)
    return (
        f"The thrust coefficient is {ratio:.2g} times what propellers of {prop} have; it would suit"
        f" {suited}. Check --prop, --mass, and how the telemetry counts revolutions (pole pairs).",
    )


def _thrust_commanded(
    flown: Hover, prop: Propeller, usual: Quantity, weight_N: float, hovered: str
) -> tuple[dict, dict[str, str], tuple[str, ...]]:
    """Give coefficient and top speed where commands alone were logged, which show their product."""
    largest = flown.thrust_per_drive
    # only k w_max^2 acts: the coefficient takes its sd, the speed that of the factors
    top = math.sqrt(largest.value / usual.value)
    ratio = flown.n_rotors * largest.value / weight_N
    content = {
        "thrust_coefficient_N_s2": Quantity(
            value=usual.value, sd=usual.value * largest.sd / largest.value
        ).plain(),
        "max_rotor_speed_rad_s": Quantity(value=top, sd=0.5 * propeller.CT_SD_REL * top).plain(),
    }
    sources = {
        "thrust_coefficient_N_s2": (
            f"What propellers of {prop} usually have. No rotor speed was logged: with commands"
            " alone only coefficient times top speed squared acts, and the sd here is that of"
            " this product, with what the thrust curve leaves open of it."
        ),
        "max_rotor_speed_rad_s": (
            f"{hovered}: the speed at full command that makes a rotor's largest thrust of"
            f" {largest.value:.3g} N. Thrust to weight: {ratio:.2g}."
            " As a speed it is no better known than the coefficient is as one."
        ),
    }
    return content, sources, ()


def _unlogged(
    mass_kg: float,
    arm_m: float,
    thrust_N_s2: float,
    prop: Propeller,
    lag: Quantity | None,
    brushed: bool,
) -> tuple[dict, dict[str, str]]:
    """Give inertia, torque and lag, mostly from scaling laws, and their sources."""
    content = {
        "inertia_kg_m2": scaling.inertia(mass_kg, arm_m).model_dump(),
        "torque_coefficient_Nm_s2": scaling.torque_coefficient(
            thrust_N_s2, prop.diameter_m
        ).plain(),
        "motor_time_constant_s": (
            lag or scaling.motor_time_constant(prop.diameter_m, brushed)
        ).plain(),
    }
    sources = {
        "inertia_kg_m2": (
            f"Not in the log: {scaling.ABOUT_X_Y:g}, {scaling.ABOUT_X_Y:g} and {scaling.ABOUT_Z:g}"
            " of mass times squared arm, as published quadrotors have to"
            f" {scaling.INERTIA_SD_REL:.0%}."
        ),
        "torque_coefficient_Nm_s2": (
            f"Not in the log: {scaling.TORQUE:g} of thrust times diameter, as published rotors have"
            f" to {scaling.TORQUE_SD_REL:.0%}."
        ),
        "motor_time_constant_s": (
            "From the fast part of rotor speeds behind their commands."
            if lag
            else "Not in the log, or logged too slowly: a rule of thumb for motors of this kind and"
            f" size, to {scaling.LAG_SD_REL:.0%}."
        ),
    }
    return content, sources
