"""A cascade as common autopilots have it: position, velocity, attitude by quaternion, rates with
derivative, allocation that gives up yaw first.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

G_M_S2 = 9.80665
LEAST, MOST_TILT = 0.06, 0.6


class Cascade:
    """Cascaded controller of vehicles abreast, as common autopilots have it.

    It knows what the files declare.

    Parameters
    ----------
    nominal : (F,) mass, ixx, iyy, izz, thrust, torque and speed, in SI units.
    rotor_m : (4, 2, F) hubs, body x and y.
    spin : (4, F) counter-clockwise positive.
    lag_s : (F,) time constant of the drive that the gains are tuned for.
    dt : time from one command to the next (s).
    """

    def __init__(
        self,
        nominal: Mapping[str, np.ndarray],
        rotor_m: np.ndarray,
        spin: np.ndarray,
        lag_s: np.ndarray,
        dt: float,
    ) -> None:
        self.nominal, self.dt = nominal, dt
        self.inertia = np.stack([nominal[k] for k in ("ixx", "iyy", "izz")])
        ratio = nominal["torque"] / nominal["thrust"]
        # total thrust and moments of the rotors' thrusts; its inverse allots them
        rows = np.stack([np.ones_like(spin), rotor_m[:, 1], -rotor_m[:, 0], -spin * ratio], axis=0)
        self.allocation = np.linalg.inv(rows.transpose(2, 0, 1))
        band = 1.0 / (lag_s + 0.012)
        self.rate_gain = np.minimum(0.42 * band, 20.0)
        self.attitude_gain = 0.42 * self.rate_gain
        # each loop is a bit over twice as slow as the one inside it
        self.velocity_gain = 0.38 * self.attitude_gain
        self.position_gain = 0.42 * self.velocity_gain
        self.drift = np.zeros((3, len(lag_s)))
        self.twist = np.zeros((3, len(lag_s)))
        self.before = np.zeros((3, len(lag_s)))
        self.trim_moment = np.zeros((3, len(lag_s)))

    def trim(self, hover_u: np.ndarray, moment: np.ndarray) -> None:
        """Start as on a vehicle that has flown before.

        Parameters
        ----------
        hover_u : (F,) command in hover, 0 to 1.
        moment : (3, F) moment that it has to hold in hover (N m, body frame).
        """
        thrust = 4.0 * self.nominal["thrust"] * (hover_u * self.nominal["speed"]) ** 2
        lacking = thrust / self.nominal["mass"] - G_M_S2
        self.drift[2] = lacking / (0.5 * self.velocity_gain)
        self.trim_moment = moment

    def commands(
        self, ref: np.ndarray, p: np.ndarray, v: np.ndarray, q: np.ndarray, omega: np.ndarray
    ) -> np.ndarray:
        """Return the commands for references and a measured state.

        Parameters
        ----------
        ref : (11, F) position, velocity, acceleration (world frame), yaw and yaw rate.
        p, v : (3, F) position (m) and velocity (m/s), world frame.
        q : (4, F) attitude, scalar first.
        omega : (3, F) body rates (rad/s).

        Returns
        -------
        (4, F) rotor speeds over the nominal top speed, 0 to 1.
        """
        # the integrator's input is bounded, so that a far start does not wind it up
        asked = ref[3:6] + self.position_gain * (ref[0:3] - p)
        self.drift = self.drift + self.dt * np.clip(asked - v, -1.0, 1.0)
        push = ref[6:9] + self.velocity_gain * (asked - v + 0.5 * self.drift)
        push[2] = np.clip(push[2], -4.0, 6.0) + G_M_S2
        # height first: the level part gives way where the tilt would be too much
        reach = MOST_TILT * push[2] / np.maximum(np.hypot(push[0], push[1]), 1e-6)
        push[:2] *= np.minimum(1.0, reach)
        up = push / np.linalg.norm(push, axis=0)
        body_up = _third_axis(q)
        thrust = self.nominal["mass"] * np.maximum((push * body_up).sum(axis=0), 2.0)
        error = _towards(q, up, ref[9])
        wish = 2.0 * self.attitude_gain * error * np.array([[1.0], [1.0], [0.4]])
        wish[2] += ref[10]
        lack = wish - omega
        self.twist = np.clip(self.twist + self.dt * lack, -1.0, 1.0)
        bend, self.before = (omega - self.before) / self.dt, omega
        turn = self.rate_gain * (lack + 1.2 * self.twist) - 0.02 * bend
        # what a weak rotor or an offset asks for grows with the thrust
        moment = self.inertia * turn - self.trim_moment * thrust / (self.nominal["mass"] * G_M_S2)
        # yaw has the least authority of the rotors, and gives up first
        most = np.abs(self.trim_moment[2]) + 0.02 * thrust
        moment[2] = np.clip(moment[2], -most, most)
        each = np.einsum("fij,jf->if", self.allocation, np.concatenate([thrust[None], moment]))
        speed = np.sqrt(np.maximum(each, 0.0) / self.nominal["thrust"])
        return np.clip(speed / self.nominal["speed"], LEAST, 1.0)


def _third_axis(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _towards(q: np.ndarray, up: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Return half the rotation vector to the attitude that thrusts along ``up`` with this yaw.

    It is (3, F), in the body frame.
    """
    heading = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    # the axes of the attitude that is asked for, in the world: ahead, left, up
    left = np.cross(up, heading, axis=0)
    left /= np.linalg.norm(left, axis=0)
    ahead = np.cross(left, up, axis=0)
    # matrix to quaternion, the vehicle never being upside down
    w = 0.5 * np.sqrt(np.maximum(1.0 + ahead[0] + left[1] + up[2], 1e-9))
    wanted = np.stack([w, left[2] - up[1], up[0] - ahead[2], ahead[1] - left[0]])
    wanted[1:] /= 4.0 * w
    # q* q_wanted, the turn that is lacking; its sign chosen for the short way round
    a, b, c, d = q * np.array([[1.0], [-1.0], [-1.0], [-1.0]])
    e, f, g, h = wanted
    real = a * e - b * f - c * g - d * h
    part = np.stack(
        [
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )
    return part * np.sign(real)
