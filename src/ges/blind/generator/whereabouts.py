"""Where a concealed effect can be seen: the channels in which it stands out against the air's own
turbulence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ges.blind.generator.concealed import SENSOR
from ges.blind.generator.flight import TURN_PER_M
from ges.blind.generator.plan import CONTROL_DT_S
from ges.conventions import AXES

if TYPE_CHECKING:
    from ges.blind.generator.make import Case

TRUTH_STEP = 10
FAST_STEP = 2
DRIVE_ERROR = 0.01
TRACE = 0.1


def seen_channels(case: Case, flights: Sequence[Mapping[str, np.ndarray]]) -> dict[str, list[str]]:
    """Return the channels in which what is concealed stands out.

    Parameters
    ----------
    case : the case.
    flights : channels of its true flights at the control rate, (n, width).

    Returns
    -------
    ``located``, channels to be found, and ``traces``, which are no mistake if found. Both are empty
    for a sensor fault and without anything concealed.

    Notes
    -----
    A channel is located where the RMS of the extra force or moment is above that of turbulence. The
    drive is located where rotor speeds are logged and off by more than 1 % of top speed from an
    unchanged drive's. A trace is above a tenth of that. What a diagnosis can resolve plays no part.
    """
    if not case.spec.names or set(case.spec.names) & set(SENSOR):
        return {"located": [], "traces": []}
    strength = _strength(case, flights)
    return {
        key: [c for c, s in strength.items() if s > level]
        for key, level in (("located", 1.0), ("traces", TRACE))
    }


def _strength(case: Case, flights: Sequence[Mapping[str, np.ndarray]]) -> dict[str, float]:
    """Return RMS over what counts as seen, a channel."""
    aloft = [f["p"][:, 2] - f["ground"][:, 0] > 0.6 * case.craft.radius_m for f in flights]
    speeds = case.around.logging.rotor_speeds
    loads = np.concatenate(
        [_loads(case, f, not speeds)[a] for f, a in zip(flights, aloft, strict=True)]
    )
    air, true = case.sorties[0].turbulence, case.craft.true
    inertia = np.array([true["ixx"], true["iyy"], true["izz"]])
    # turbulence is drawn as acceleration: of a force and a moment it makes these sds
    scale = np.concatenate([np.full(3, air * true["mass"]), TURN_PER_M * air * inertia])
    names = [f"force_{a}" for a in AXES] + [f"moment_{a}" for a in AXES]
    strengths = dict(zip(names, _rms(loads) / scale, strict=True))
    if speeds:
        off = [
            (f["rotor_speed"] - f["plain_speed"])[a] for f, a in zip(flights, aloft, strict=True)
        ]
        strengths["drive"] = _rms(np.concatenate(off).reshape(-1, 1))[0] / (
            true["speed"] * DRIVE_ERROR
        )
    return {name: float(s) for name, s in strengths.items()}


def _rms(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(rows), axis=0))


def _loads(case: Case, flight: Mapping[str, np.ndarray], through_drive: bool) -> np.ndarray:
    """Return (n, 6) body force and moment that nothing in the vehicle file explains."""
    true, numbers = case.craft.true, case.sorties[0].numbers
    inertia = np.array([true["ixx"], true["iyy"], true["izz"]])
    excess = numbers.get("inertia_error", 1.0) - 1.0
    spin_up = np.gradient(flight["omega"], CONTROL_DT_S, axis=0)
    force = flight["extra_force"] + payload_force(case, flight)
    out = np.hstack([force, flight["extra_moment"] - excess * inertia * spin_up])
    if through_drive:
        out[:, 2:] += _thrust_difference(case, flight)
    return out


def payload_force(case: Case, flight: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the force of a payload that the nominal mass misses, -m_p (a - g).

    Parameters
    ----------
    case : its numbers state the share of the payload in the mass.
    flight : ``specific_force`` (n, 3), body frame (m/s^2).

    Returns
    -------
    (n, 3) N, body frame.
    """
    share = case.sorties[0].numbers.get("payload_share", 0.0)
    return -share * case.craft.true["mass"] * flight["specific_force"]


def _thrust_difference(case: Case, flight: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return (n, 4): thrust and moments that motors with nothing concealed would not have given."""
    craft, true = case.craft, case.craft.true
    square = flight["rotor_speed"] ** 2 - flight["plain_speed"] ** 2
    thrust, torque = true["thrust"] * square, true["torque"] * square
    x, y, spin = np.array(craft.rotor_x_m), np.array(craft.rotor_y_m), np.array(craft.spin)
    return np.stack([thrust.sum(1), thrust @ y, -thrust @ x, -torque @ spin], axis=1)
