"""A vehicle, flights and systems made by hand, small enough to know every number of them."""

from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import BODY_RATE, POSITION, QUATERNION, VELOCITY, command, rotor_speed
from ges.diagnose.design.columns import DesignColumn, Nuisance
from ges.diagnose.design.feedback import EndogenousPart, EndogenousParts, values_of
from ges.diagnose.design.system import FlightRows, System
from ges.diagnose.design.table import table_of
from ges.diagnose.design.weak import make_windows
from ges.diagnose.design.whiten import Errors, WhiteGroup
from ges.diagnose.library.candidates import Amplitude, Variant, amplitude_of
from ges.diagnose.prepare.align import CommandHold, Prepared
from ges.diagnose.types.model import Model

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

NUMBERS = {
    "mass_kg": 1.0,
    "ixx_kg_m2": 0.01,
    "iyy_kg_m2": 0.012,
    "izz_kg_m2": 0.018,
    "thrust_coefficient_N_s2": 6e-6,
    "torque_coefficient_Nm_s2": 1e-7,
    "max_rotor_speed_rad_s": 1000.0,
    "motor_time_constant_s": 0.02,
    **{f"rotor_{i}_radius_m": 0.1 for i in range(1, 5)},
}
MODEL = Model(NUMBERS)
STEP_S = 0.01
WINDOW_S = 0.2


def hovering(duration_s: float = 4.0, **columns) -> Prepared:
    """A flight that stands still at 1.5 m, the nose to the east, its commands at work at once; with
    columns changed, or left out where None is given.
    """
    t_s = STEP_S * np.arange(round(duration_s / STEP_S))
    still = dict.fromkeys((*POSITION, *VELOCITY, *BODY_RATE, *QUATERNION), 0.0)
    level = {"p_z_m": 1.5, "q_w": 1.0}
    drive = dict.fromkeys(ROTOR_SPEED, MODEL.hover_rad_s)
    asked = dict.fromkeys(COMMAND, MODEL.hover_rad_s / MODEL.number("max_rotor_speed_rad_s"))
    given = {**still, **level, **drive, **asked, **columns}
    made = {
        name: np.broadcast_to(np.asarray(value, dtype=float), len(t_s)).copy()
        for name, value in given.items()
        if value is not None
    }
    updates = ("position", "velocity", "attitude", "gyro", "rotor_speed", "command")
    return Prepared(
        t_s,
        made,
        np.ones(len(t_s), bool),
        {},
        dict.fromkeys(updates, STEP_S),
        command_hold=CommandHold(0.0, 0.0),
    )


def times(duration_s: float = 4.0) -> np.ndarray:
    """Times of :func:`hovering`."""
    return STEP_S * np.arange(round(duration_s / STEP_S))


def windows_of(flight: Prepared, higher_orders: int = 0):
    """Windows along a flight."""
    return make_windows(flight.t_s, flight.flying, WINDOW_S, higher_orders)


def nuisance(key: str, sd: float, flight_sd: float = 0.0, mean: float = 0.0) -> DesignColumn:
    """A number ``effect.parameter`` that every hypothesis may adjust."""
    effect, parameter = key.split(".")
    return DesignColumn(key, nuisance=Nuisance(effect, parameter, 0.01, sd, flight_sd, mean))


def amplitude(key: str, part: str = "", **changes) -> DesignColumn:
    """A column of one amplitude ``effect.parameter``, alone in its variant."""
    effect, parameter = key.split(".")
    a = amplitude_of(effect, parameter)
    a = Amplitude(**{**vars(a), **changes})
    return DesignColumn(key, variant=Variant(effect, {}, (a,)), part=part)


Channels = Mapping[int, np.ndarray]


def rows_of(
    y: np.ndarray,
    columns: Sequence[Channels] = (),
    air: np.ndarray | None = None,
    start_s: float = 0.0,
    noise: np.ndarray | None = None,
) -> FlightRows:
    """Rows of one flight from its residuals (m, C) and columns by channel, (m,) each."""
    half = 10
    t_s = start_s + STEP_S * np.arange(half * (len(y) + 1) + 1)
    flying = np.ones(len(t_s), bool)
    windows = make_windows(t_s, flying, 2 * half * STEP_S)
    assert len(windows) == len(y)
    flight = Prepared(t_s, {}, flying, {}, {})
    air = np.ones(len(y), bool) if air is None else air
    noise = np.zeros(len(y)) if noise is None else noise
    return FlightRows(flight, windows, y, table_of(columns, *y.shape), noise, {}, None, air, {})


def system_of(
    names: Sequence[str],
    columns: Sequence[DesignColumn],
    flights: Sequence[FlightRows],
    model: Model = MODEL,
) -> System:
    """All of them as one system."""
    return System(model, tuple(names), tuple(columns), tuple(flights), WINDOW_S)


def turned(flight: Prepared, yaw_rad: float) -> Prepared:
    """The same flight with the world turned about its vertical."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    columns = dict(flight.columns)
    for x, y in (("p_x_m", "p_y_m"), ("v_x_m_s", "v_y_m_s")):
        a, b = flight.columns[x], flight.columns[y]
        columns |= {x: c * a - s * b, y: s * a + c * b}
    ch, sh = np.cos(0.5 * yaw_rad), np.sin(0.5 * yaw_rad)
    w, x, y, z = (flight.columns[name] for name in QUATERNION)
    q = (ch * w - sh * z, ch * x - sh * y, ch * y + sh * x, ch * z + sh * w)
    return flight.replace(columns={**columns, **dict(zip(QUATERNION, q, strict=True))})


def white_part(
    columns: Sequence[int], y: np.ndarray, x: np.ndarray, errors: np.ndarray | None = None
) -> WhiteGroup:
    """One channel whose rows are white as they are, with errors of the drive."""
    by_drive = np.zeros((1, 0, len(y))) if errors is None else errors.T[None]
    return WhiteGroup(
        (0,),
        np.arange(len(y)),
        np.asarray(columns),
        y[None],
        (tuple(x.T),),
        lambda columns: columns,
        Errors(by_drive, (), lambda columns: columns),
    )


def endogenous_part(key: str, column: np.ndarray) -> EndogenousPart:
    """A part that is its whole column, in the air all the time."""
    air = np.ones(len(column), bool)
    return EndogenousPart(key, column, air, None, lambda x, keys, channel: x)


def made(parts: EndogenousParts) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    """Endogenous parts with their values, (m,) each."""
    return {
        at: dict(zip(own, values_of(list(own.values())), strict=True)) for at, own in parts.items()
    }


def manoeuvre(duration_s: float = 6.0, **columns) -> Prepared:
    """A flight that does a little of everything: tilts, turns, speeds and climbs."""
    t = times(duration_s)
    roll, pitch, yaw = 0.2 * np.sin(1.3 * t), 0.15 * np.cos(0.9 * t), 0.6 * np.sin(0.5 * t)
    cr, sr, cp, sp = (f(0.5 * a) for a in (roll, pitch) for f in (np.cos, np.sin))
    cy, sy = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    speeds = [MODEL.hover_rad_s * (1.0 + 0.05 * np.sin((1.0 + 0.3 * i) * t + i)) for i in range(4)]
    made = {
        "p_x_m": 2.0 * np.sin(0.7 * t),
        "p_y_m": -1.5 * np.cos(0.6 * t),
        "p_z_m": 1.5 + 0.4 * np.sin(0.8 * t),
        "v_x_m_s": 1.4 * np.cos(0.7 * t),
        "v_y_m_s": 0.9 * np.sin(0.6 * t),
        "v_z_m_s": 0.32 * np.cos(0.8 * t),
        "omega_x_rad_s": 0.26 * np.cos(1.3 * t),
        "omega_y_rad_s": -0.135 * np.sin(0.9 * t),
        "omega_z_rad_s": 0.3 * np.cos(0.5 * t),
        **dict(zip(QUATERNION, q, strict=True)),
        **dict(zip(ROTOR_SPEED, speeds, strict=True)),
        **dict(zip(COMMAND, (s / 1000.0 for s in speeds), strict=True)),
    }
    return hovering(duration_s, **{**made, **columns})
