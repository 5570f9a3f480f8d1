"""What simulators share whose vehicles fly one at a time under the concealed cases' controller."""

from __future__ import annotations

import numpy as np

from ges.blind.foreign.sets import OffPath
from ges.blind.generator.pilot import Pilot
from ges.blind.limit import Change

OFF_PATH_M = 3.0


def noisy_command(
    pilot: Pilot,
    ref: np.ndarray,
    p: np.ndarray,
    v: np.ndarray,
    turn: np.ndarray,
    omega: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the commands of a controller that sees its state with noise.

    Parameters
    ----------
    pilot : the controller.
    ref : (11,) as of :func:`paths.references`.
    p, v : (3,) position (m) and velocity (m/s), world frame.
    turn : (3, 3) from the body frame to the world.
    omega : (3,) body rates (rad/s).
    rng : stream of the noise.

    Returns
    -------
    (n_rotors,) rotor speeds over the nominal top speed.
    """
    p = p + 0.002 * rng.standard_normal(3)
    v = v + 0.01 * rng.standard_normal(3)
    omega = omega + 0.01 * rng.standard_normal(3)
    state = (p[:, None], v[:, None], turn[:, :, None], omega[:, None])
    return pilot.command(ref[:, None], np.zeros((4, 1)), *state, np.ones(1))[:, 0]


def require_on_path(key: str, p: np.ndarray, planned: np.ndarray, t_s: float) -> None:
    """Refuse a vehicle that left its path.

    Parameters
    ----------
    key : name of the design.
    p, planned : (3,) where it is, and where it was to be (m).
    t_s : time since the start.

    Raises
    ------
    OffPath
        When it is farther off than :data:`OFF_PATH_M` along an axis, or nowhere.
    """
    if not np.abs(p - planned).max() < OFF_PATH_M:
        raise OffPath(
            f"'{key}' lost its path {t_s:.1f} s after the start; the path is too fast for the"
            " vehicle"
        )


def change_by_shift(shift_m: float, thrust: np.ndarray) -> Change:
    """Return what it changes that all rotors are shifted against the centre of mass.

    Parameters
    ----------
    shift_m : towards body -x; towards y it is half of that.
    thrust : (n, rotors) N.
    """
    lever = shift_m * thrust.sum(axis=1)
    return {"moment_Nm": np.stack([0.5 * lever, lever, 0.0 * lever], axis=1)}
