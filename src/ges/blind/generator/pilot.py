"""The generator's own closed-loop controller: position, attitude and rate loops, mixer; flights
abreast.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ges.conventions import GRAVITY_M_S2


class Pilot:
    """Cascaded controller of vehicles abreast, tuned for the response of each.

    It knows nominal parameters only.

    Parameters
    ----------
    nominal : (F,) mass, ixx, iyy, izz, thrust, torque and speed, in SI units.
    rotor_x, rotor_y : (n_rotors, F) hubs in the body frame (m).
    spin : (n_rotors, F) counter-clockwise positive.
    lag_s : (F,) time constant of the drive that the gains are tuned for.
    dt : time from one command to the next (s).
    """

    def __init__(
        self,
        nominal: Mapping[str, np.ndarray],
        rotor_x: np.ndarray,
        rotor_y: np.ndarray,
        spin: np.ndarray,
        lag_s: np.ndarray,
        dt: float,
    ) -> None:
        self.mass, self.speed, self.dt = nominal["mass"], nominal["speed"], dt
        self.inertia = np.stack([nominal[k] for k in ("ixx", "iyy", "izz")])
        # thrust and moments of the squared speeds; its inverse is the mixer
        k, q = nominal["thrust"], nominal["torque"]
        rows = np.stack([np.broadcast_to(k, rotor_x.shape), k * rotor_y, -k * rotor_x, -q * spin])
        self.rotors, each = len(rotor_x), rows.transpose(2, 0, 1)
        # of more than four rotors the smallest squares that make what is asked
        mixer = np.linalg.inv(each) if self.rotors == 4 else np.linalg.pinv(each)
        self.mixer = mixer.transpose(1, 2, 0)
        slow = lag_s + 0.008
        self.k_rate = np.minimum(0.5 / slow, 22.0)
        # each loop is a bit over twice as slow as the one inside it
        self.k_att = self.k_rate / 2.2
        self.k_vel = np.stack([self.k_att / 2.4] * 2 + [np.minimum(0.35 / slow, 8.0)])
        self.k_pos = self.k_vel / 2.4
        self.most = np.clip(1.2 * self.k_att, 2.0, 6.0)
        self.sum_pos = np.zeros_like(self.k_pos)
        self.sum_rate = np.zeros_like(self.k_pos)
        self.gain = np.stack([self.k_rate, self.k_rate, 0.6 * self.k_rate])

    def trim(self, moment: np.ndarray, hover_u: np.ndarray, thrust_coefficient: np.ndarray) -> None:
        """Start as on a vehicle that was trimmed on flights before.

        Parameters
        ----------
        moment : (3, F) moment that it has to hold in hover (N m, body frame).
        hover_u : (F,) command in hover, 0 to 1.
        thrust_coefficient : (F,) N s^2.
        """
        self.trim_moment = moment
        # the sum of errors that adds to gravity what hover takes by the nominal parameters
        lift = self.rotors * thrust_coefficient * (hover_u * self.speed) ** 2 / self.mass
        self.sum_pos[2] = (lift - GRAVITY_M_S2) / (0.25 * self.k_vel[2] * self.k_pos[2])

    def command(
        self,
        ref: np.ndarray,
        excite: np.ndarray,
        p: np.ndarray,
        v: np.ndarray,
        rotation: np.ndarray,
        omega: np.ndarray,
        flying: np.ndarray,
    ) -> np.ndarray:
        """Return the commands for references and a measured state.

        Parameters
        ----------
        ref : (11, F) position, velocity, acceleration (world frame), yaw and yaw rate.
        excite : (4, F) angular acceleration about the body axes (rad/s^2) and heave (m/s^2).
        p, v : (3, F) position (m) and velocity (m/s), world frame.
        rotation : (3, 3, F) from the body frame to the world.
        omega : (3, F) body rates (rad/s).
        flying : (F,) 1 in the air, 0 while waiting on the ground.

        Returns
        -------
        (n_rotors, F) rotor speeds over the nominal top speed, 0 to 1.
        """
        error = ref[0:3] - p
        # bounded, and standing still on the ground, so that nothing winds up
        self.sum_pos = np.clip(self.sum_pos + self.dt * flying * error, -6.0, 6.0)
        push = ref[6:9] + self.k_vel * (ref[3:6] + self.k_pos * (error + 0.25 * self.sum_pos) - v)
        push[:2] = np.clip(push[:2], -self.most, self.most)
        push[2] = np.clip(push[2] + excite[3], -5.0, 6.0) + GRAVITY_M_S2
        # thrust is the push along the body's z; what points aside, z x push, asks for a turn
        body = np.einsum("ijf,if->jf", rotation, push)
        thrust = self.mass * np.maximum(body[2], 2.0)
        size = np.sqrt((push * push).sum(axis=0))
        yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
        turn = (ref[9] - yaw + np.pi) % (2.0 * np.pi) - np.pi
        wish = self.k_att * np.stack(
            [-body[1] / size, body[0] / size, 0.5 * np.clip(turn, -1.0, 1.0)]
        )
        wish[2] += ref[10]
        lack = wish - omega
        self.sum_rate = np.clip(self.sum_rate + self.dt * flying * lack, -4.0, 4.0)
        moment = self.inertia * (self.gain * (lack + 0.8 * self.sum_rate) + excite[:3])
        # offset and weak rotor make a moment in proportion to the thrust
        moment -= self.trim_moment * thrust / (self.mass * GRAVITY_M_S2)
        square = np.einsum("ijf,jf->if", self.mixer, np.concatenate([thrust[None], moment]))
        return np.clip(np.sqrt(np.maximum(square, 0.0)) / self.speed, 0.08, 1.0) * flying
