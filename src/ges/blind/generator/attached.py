"""Things that pull on the vehicle: slung load, tether, fountain, contact, and forces in nobody's
library.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ges.conventions import GRAVITY_M_S2

if TYPE_CHECKING:
    from ges.blind.generator.flight import Bench, State

ROPE_RATE_RAD_S = 120.0
_DOWN = np.array([[0.0], [0.0], [-GRAVITY_M_S2]])


def slung_load(
    load: np.ndarray,
    load_v: np.ndarray,
    p: np.ndarray,
    v: np.ndarray,
    mass: np.ndarray,
    hid: Mapping[str, np.ndarray],
    dt: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance a point mass on a stiff, damped rope below the centre of mass.

    The rope only pulls. The load passes through the ground: it is taken to hang free.

    Parameters
    ----------
    load, load_v : (3, F) place (m) and velocity (m/s) of the load, world frame.
    p, v : (3, F) of the vehicle.
    mass : (F,) of the vehicle (kg).
    hid : (F,) ``load_share`` of the mass, and length of the rope ``rope_m``.
    dt : step (s).

    Returns
    -------
    Force on the vehicle (N, world frame), place and velocity of the load, (3, F) each.
    """
    share = np.maximum(hid["load_share"], 1e-9)
    away = load - p
    length = np.maximum(np.sqrt((away * away).sum(axis=0)), 1e-6)
    line = away / length
    stretch = length - hid["rope_m"]
    closing = ((load_v - v) * line).sum(axis=0)
    # spring and damper over the load's mass, so that one rate suits loads of all sizes
    pull = np.maximum(ROPE_RATE_RAD_S**2 * stretch + 0.6 * ROPE_RATE_RAD_S * closing, 0.0) * (
        stretch > 0.0
    )
    acceleration = _DOWN - pull * line - 0.15 * load_v
    on = hid["load_share"] > 0.0
    load_v = np.where(on, load_v + dt * acceleration, 0.0)
    load = np.where(on, load + dt * load_v, p + np.array([[0.0], [0.0], [-1.0]]) * hid["rope_m"])
    return np.where(on, share * mass * pull * line, 0.0), load, load_v


def tether(
    p: np.ndarray, under: np.ndarray, weight_N_m: np.ndarray, sag_m: np.ndarray
) -> np.ndarray:
    """Return the force of a cable from a winch at the origin.

    The cable hangs as a catenary that touches down on the ground; its hanging length is sqrt(h^2 +
    2 a h).

    Parameters
    ----------
    p : (3, F) place of the vehicle (m).
    under : (F,) height of the ground below it (m).
    weight_N_m : (F,) weight of the cable per metre.
    sag_m : (F,) horizontal tension over weight per metre, a.

    Returns
    -------
    (3, F) N, world frame.
    """
    height = np.maximum(p[2] - under, 0.0)
    hanging = weight_N_m * np.sqrt(height * height + 2.0 * sag_m * height)
    away = np.sqrt(p[0] * p[0] + p[1] * p[1])
    # a catenary's horizontal tension is the same all along; tanh lets it turn smoothly at 0
    drawn = -weight_N_m * sag_m * np.tanh(away / 0.3) / np.maximum(away, 1e-6)
    return np.stack([drawn * p[0], drawn * p[1], -hanging])


def fountain_share(height: np.ndarray, spacing: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Return the fountain's lift over its peak, 0 to 1.

    Wakes that meet below the body rise there. The lift is greatest at 0.8 rotor spacings and dies
    with tilt.

    Parameters
    ----------
    height : (F,) of the body above the ground (m).
    spacing : (F,) of the rotors (m).
    upright : (F,) cosine of the tilt.

    Returns
    -------
    (F,).
    """
    x = np.maximum(height, 0.0) / spacing
    return 2.0 * (x / 0.8) ** 2 / (1.0 + (x / 0.8) ** 4) * np.clip(upright, 0.0, 1.0) ** 8


def patches(p: np.ndarray, hid: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the force of what sits at a place: magnet, updraft column and wall.

    Parameters
    ----------
    p : (3, F) place of the vehicle (m).
    hid : (F,) numbers of the three.

    Returns
    -------
    (3, F) N, world frame.
    """
    dx, dy = p[0] - hid["magnet_x_m"], p[1] - hid["magnet_y_m"]
    near = np.exp(-(dx * dx + dy * dy) / hid["magnet_width_m"] ** 2)
    # 2.3 is about sqrt(2 e), which makes the peak of r exp(-r^2) one: the pull at most is magnet_N
    pull = 2.3 * hid["magnet_N"] * near / hid["magnet_width_m"]
    to_wall = np.maximum(1.2 - p[1], 0.15)
    return np.stack(
        [-pull * dx, -pull * dy + hid["wall_N"] * np.exp(-to_wall / 0.5), hid["updraft_N"] * near]
    )


def unlisted_loads(
    air_body: np.ndarray, thrust: np.ndarray, b: Bench, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the load of effects that no library has.

    These are vortex-ring buffet, flapping moment, rotor interference and a loose hatch.

    Parameters
    ----------
    air_body : (3, F) velocity through the air, body frame (m/s).
    thrust : (n_rotors, F) N.
    b : constants of the vehicles.
    noise : (F,) unit normal, of the buffet.

    Returns
    -------
    Force (N) and moment (N m), (3, F) each, body frame.
    """
    hid = b.hid
    # the ring forms when the vehicle sinks into its own wake, at a share of the induced velocity
    sink = np.clip(-air_body[2] / b.v_h - 0.06, 0.0, 0.4) / 0.15
    total = thrust.sum(axis=0)
    speed = np.sqrt(air_body[0] ** 2 + air_body[1] ** 2)
    slam = hid["hatch_N"] * (np.tanh(6.0 * (speed - 1.4)) + 1.0) / 2.0
    force = np.stack([-slam, 0.0 * slam, -hid["buffet"] * sink * total * (0.6 + 0.5 * noise)])
    up = hid["pitch_up_s_m"] * b.weight * b.arm
    # a rear rotor flies in the wake of the one ahead, and loses thrust with the speed
    behind = np.where(b.rx * air_body[0] < 0.0, 1.0, 0.0)
    loss = hid["interference"] * np.tanh(np.abs(air_body[0]) / 2.0) * behind * thrust
    force[2] -= loss.sum(axis=0)
    moment = np.stack(
        [
            up * air_body[1] - (b.ry * loss).sum(axis=0),
            -up * air_body[0] + (b.rx * loss).sum(axis=0),
            0.0 * up,
        ]
    )
    return force, moment


def contact(s: State, r: np.ndarray, under: np.ndarray, b: Bench) -> tuple[np.ndarray, np.ndarray]:
    """Return what the ground does to the landing gear.

    Parameters
    ----------
    s : state of the vehicles.
    r : (3, 3, F) from the body frame to the world.
    under : (F,) height of the ground below the vehicles (m).
    b : constants of the vehicles.

    Returns
    -------
    Force (N, world frame) and angular acceleration (rad/s^2, body frame), (3, F) each.
    """
    depth = under + 0.5 * b.radius - s.p[2]
    touching = (depth > 0.0).astype(float)
    push = touching * np.maximum(b.mass * (2500.0 * depth - 60.0 * s.v[2]), 0.0)
    force = np.stack([-20.0 * touching * b.mass * s.v[0], -20.0 * touching * b.mass * s.v[1], push])
    # a landing gear stands the vehicle upright: it turns about z x up, body frame
    level = np.stack([-r[2, 1], r[2, 0], 0.0 * push])
    return force, touching * (150.0 * level - 20.0 * s.omega)
