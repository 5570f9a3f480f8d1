"""Motion of a flight as the model sees it: sensor faults undone, heights, replayed states."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import BODY_RATE, QUATERNION, VELOCITY, command
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.kinematics import body_rates, quaternion_product, to_body
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


def height_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Return the position, over the logged ground where one is logged and the terrain is flat.

    Parameters
    ----------
    flight : prepared recording.
    model : with the terrain.

    Returns
    -------
    (n,) by contract column, m, world. Without a position the rangefinder's reading is the height.
    """
    columns = {
        name: flight.columns[name] for name in ("p_x_m", "p_y_m", "p_z_m") if name in flight.columns
    }
    if "ground_z_m" in flight.columns and model.terrain.kind == "flat" and "p_z_m" in columns:
        columns["p_z_m"] = (
            columns["p_z_m"]
            - flight.columns["ground_z_m"]
            + model.terrain.parameters().get("terrain_z_m", 0.0)
        )
    # without a position the rangefinder's reading is all that is known of the height
    if "p_z_m" not in columns and flight.has("range"):
        columns["p_z_m"] = flight.columns["range_m"]
    return columns


def state_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Return all that the library reads of every sample but rotor speeds.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.

    Returns
    -------
    (n,) by contract column, in the units of their names.
    """
    columns = {"t_s": flight.t_s - flight.t_s[0], **height_columns(flight, model)}
    for names in (VELOCITY, QUATERNION, command(model.n_rotors), ("battery_V",)):
        columns.update({name: flight.columns[name] for name in names if name in flight.columns})
    # effects ask for an angular acceleration, and differences amplify the gyro's noise: smoothed
    omega, width = body_rates(flight), settings.prepare.rate_smoothing_s / flight.dt_s
    rate = np.gradient(gaussian_filter1d(omega, width, axis=0), flight.dt_s, axis=0)
    columns.update(zip(BODY_RATE, omega.T, strict=True))
    columns.update(zip((f"omega_dot_{a}_rad_s2" for a in "xyz"), rate.T, strict=True))
    return columns


@dataclasses.dataclass(frozen=True)
class Motion:
    """The recorded motion as the library and the equations of motion take it.

    Attributes
    ----------
    columns : (n,) by contract column; rotor speeds are not among them.
    as_read : the same before sensor faults are undone.
    gravity_m_s2 : gravity.
    """

    columns: Mapping[str, np.ndarray]
    as_read: Mapping[str, np.ndarray]
    gravity_m_s2: float

    @functools.cached_property
    def omega(self) -> np.ndarray:
        """Body rates, (n, 3) rad/s."""
        return np.stack([self.columns[name] for name in BODY_RATE], axis=1)

    @functools.cached_property
    def rate_products(self) -> np.ndarray:
        """Products of the body rates about the other two axes, (n, 3) rad^2/s^2."""
        return np.roll(self.omega, -1, axis=1) * np.roll(self.omega, 1, axis=1)

    @functools.cached_property
    def velocity_terms(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity v_b in the body frame, and omega x v_b + R^T g; (n, 3) each."""
        # (1) of docs/method.md without the derivative: omega x v_b + R^T g
        q = np.stack([self.columns[name] for name in QUATERNION], axis=1)
        v = to_body(q, np.stack([self.columns[name] for name in VELOCITY], axis=1))
        return v, np.cross(self.omega, v) + to_body(
            q, np.tile([0.0, 0.0, self.gravity_m_s2], (len(q), 1))
        )


def motion_of(
    flight: Prepared, model: Model, effects: effect_table.Effects, reuse: Motion | None = None
) -> Motion:
    """Return the motion of a flight, with sensor faults undone.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : of which sensor faults count.
    reuse : motion of the same flight and vehicle under other faults.
    """
    as_read = reuse.as_read if reuse else state_columns(flight, model)
    return Motion(
        undo_sensor_faults(as_read, model, effects), as_read, model.number("gravity_m_s2")
    )


def effects_of_kind(effects: effect_table.Effects, *kinds: str) -> dict:
    """Return the effects of some kinds.

    Parameters
    ----------
    effects : that are on.
    kinds : of the descriptor, as ``actuator`` or ``sensor``.
    """
    return effect_table.only(effects, lambda e: e.kind in kinds)


def turning_faults(effects: effect_table.Effects) -> dict:
    """Return sensor faults of attitude and rates.

    Parameters
    ----------
    effects : that are on.
    """
    turning = {"gyro", "attitude"}
    return effect_table.only(effects, lambda e: e.kind == "sensor" and turning & set(e.channels))


def undo_sensor_faults(
    columns: Mapping[str, np.ndarray], model: Model, effects: effect_table.Effects
) -> Mapping[str, np.ndarray]:
    """Return attitude and rates as they were, if the given sensor faults had made the readings.

    Parameters
    ----------
    columns : (n,) by contract column, rates in rad/s.
    model : of the vehicle.
    effects : of which sensor faults count.
    """
    faults = turning_faults(effects)
    if not faults:
        return columns
    errors, rates = (
        [name.format(a) for a in "xyz"] for name in ("attitude_error_{}_rad", "gyro_{}_rad_s")
    )
    output = effect_table.replay(
        model.parameters,
        effect_table.Samples.from_columns(columns),
        faults,
        model.terrain,
        wanted=(*errors, *rates),
    )
    # a small turn by the error e is undone by the quaternion (sqrt(1 - |e / 2|^2), -e / 2)
    turn = -0.5 * output.stack(*errors)
    columns = dict(columns)
    if "q_w" in columns:
        q = np.stack([columns[name] for name in QUATERNION], axis=1)
        q = quaternion_product(q, np.column_stack([np.sqrt(1.0 - (turn**2).sum(axis=1)), turn]))
        columns.update(zip(QUATERNION, q.T, strict=True))
    # the fault f makes f(x) of a rate x: to first order what was read as x had been 2 x - f(x)
    for name, rate in zip(BODY_RATE, rates, strict=True):
        columns[name] = 2.0 * columns[name] - output[rate]
    return columns
