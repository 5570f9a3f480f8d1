"""What any method could tell of a flown case, from what the generator alone knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from ges.blind.generator.airframe import SD_REL, TrueVehicle
from ges.blind.limit import Body, Change, Path, log_likelihood_ratios
from ges.blind.noise import Air, Noise

LIMIT_RATE_HZ = 130.0
"""Faster logs are thinned for the limit: what is told apart is slower than this."""
ALOFT_SHARE = 0.5
"""A flight counts while every rotor is faster than this share of the usual speed."""
INERTIA = ("ixx", "iyy", "izz")
# what it is called when a vehicle file is wrong about one of its numbers
NAME_OF_WRONG = {
    "mass": "thrust_scale",
    "thrust": "thrust_scale",
    "torque": "torque_coefficient",
    "inertia": "inertia",
    "lag": "motor_lag",
}
NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class TrueFlight:
    """One flight as it truly was, on a uniform clock.

    Attributes
    ----------
    step_s : time from one sample to the next.
    state : by name, (n, width). ``p`` and ``v`` are in the world frame, ``q`` has the scalar first,
        ``u`` is held from one sample to the next. ``omega``, ``rotor_speed`` and ``specific_force``
        (body frame) follow; ``p_ref``, ``v_ref``, ``yaw_ref`` and ``range`` only where they exist.
    changes : what each concealed effect changed, by name.
    air : disturbance by the air.
    """

    step_s: float
    state: Mapping[str, np.ndarray]
    changes: Mapping[str, Change] = field(default_factory=dict)
    air: Air = field(default_factory=Air)


def sample_times(flown: TrueFlight, rate_hz: float) -> np.ndarray:
    """Return the times of a log's samples on the clock of the true flight.

    Parameters
    ----------
    flown : the true flight.
    rate_hz : of the log.

    Returns
    -------
    (n,) s; the first is one sample after the flight's start.
    """
    end = (len(flown.state["p"]) - 1) * flown.step_s
    return np.arange(1.0 / rate_hz, end, 1.0 / rate_hz)


def detectable(
    flights: Sequence[TrueFlight],
    rate_hz: float,
    noise: Noise,
    craft: TrueVehicle,
    wrong: Mapping[str, float] = NOTHING,
) -> dict[str, float | dict[str, float]]:
    """Return what any method could detect of a case.

    Parameters
    ----------
    flights : the true flights.
    rate_hz, noise : of the log; rotor speeds that are not logged have an infinite sd.
    craft : the true vehicle; its file is uncertain by :data:`airframe.SD_REL`.
    wrong : factors by which the file is wrong beyond that, by the numbers of :data:`NAME_OF_WRONG`.

    Returns
    -------
    Expected log likelihood ratios in nats, see :func:`ges.blind.limit.log_likelihood_ratios`.
    """
    thin = int(np.ceil(rate_hz / LIMIT_RATE_HZ))
    paths = [_path(flown, rate_hz, thin, noise, craft, wrong) for flown in flights]
    return log_likelihood_ratios(paths, body_of(craft), noise.thinned(thin))


def body_of(craft: TrueVehicle) -> Body:
    """Return the true vehicle in the terms of :mod:`ges.blind.limit`.

    Returns
    -------
    Hubs count from the centre of the frame; a concealed offset of the centre of mass is not in
    them.
    """
    true = craft.true
    yaw = -np.array(craft.spin) * true["torque"] / true["thrust"]
    inertia = np.array([true[k] for k in ("ixx", "iyy", "izz")])
    return Body(true["mass"], inertia, craft.hubs_m, yaw)


def _path(
    flown: TrueFlight,
    rate_hz: float,
    thin: int,
    noise: Noise,
    craft: TrueVehicle,
    wrong: Mapping[str, float],
) -> Path:
    """Return a flight as the limit sees it, at every ``thin``-th of the log's times.

    It has the change of each nominal parameter's uncertainty, and of what the file is wrong about.
    """
    t = sample_times(flown, rate_hz / thin)
    clock = np.arange(len(flown.state["p"])) * flown.step_s

    def at(rows: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, clock, row) for row in rows.T], axis=1)

    speed = at(flown.state["rotor_speed"])
    rate = at(np.gradient(flown.state["rotor_speed"], flown.step_s, axis=0))
    omega = at(flown.state["omega"])
    turning = at(np.gradient(flown.state["omega"], flown.step_s, axis=0))
    level = flown.air.level
    step_s = thin / rate_hz
    body = body_of(craft)
    nominal = _priors(body, craft.true, speed, rate, omega, turning, step_s)
    changes: dict[str, Mapping[str, np.ndarray]] = {
        n: {c: at(v) for c, v in one.items()} for n, one in flown.changes.items()
    }
    for number, factor in wrong.items():
        # what the true motor does over what the file's would do on the same commands
        if number == "lag":
            slow = _lagged(flown.state["u"], factor * craft.true["lag"], flown.step_s)
            quick = _lagged(flown.state["u"], craft.true["lag"], flown.step_s)
            off = at(quick - slow) * craft.true["speed"]
            changes[NAME_OF_WRONG[number]] = driven(body, craft.true, speed, off)
        else:
            # the truth is 1 / factor of what the file says
            parts = INERTIA if number == "inertia" else (number,)
            changes[NAME_OF_WRONG[number]] = _scaled(
                1.0 / factor - 1.0, [nominal[part][1] for part in parts]
            )
    # on the ground, with rotors standing or spinning up, nothing is asked of a method
    aloft = (speed > ALOFT_SHARE * np.median(speed)).all(axis=1)[:, None]
    changes = {n: {c: v * aloft for c, v in one.items()} for n, one in changes.items()}
    nominal = {n: (sd, {c: v * aloft for c, v in one.items()}) for n, (sd, one) in nominal.items()}
    return Path(
        step_s=step_s,
        rotation=Rotation.from_quat(at(flown.state["q"]), scalar_first=True).as_matrix(),
        thrust_N=craft.true["thrust"] * speed**2,
        speed_rad_s=speed,
        speed_error_rad_s=_speed_error(flown, rate_hz, noise, craft, float(speed.mean())),
        changes=changes,
        priors=nominal,
        air=flown.air if level is None else replace(flown.air, level=np.interp(t, clock, level)),
    )


def _priors(
    body: Body,
    true: Mapping[str, float],
    speed: np.ndarray,
    speed_rate: np.ndarray,
    omega: np.ndarray,
    turning: np.ndarray,
    step_s: float,
) -> dict[str, tuple[float, Change]]:
    """Return the sd and the change for one of every nominal parameter, relative to its value.

    Parameters
    ----------
    body, true : the true vehicle and its numbers.
    speed, speed_rate : (n, rotors) rotor speeds (rad/s) and their rates (rad/s^2).
    omega, turning : (n, 3) body rates (rad/s) and their rates (rad/s^2).
    step_s : time from one sample to the next.
    """
    thrust = true["thrust"] * speed**2
    wrench = body.wrench(thrust)
    moment = wrench["moment_Nm"]
    # J omega' + omega x J omega, what the whole inertia asks for
    whole = body.inertia_kg_m2 * turning + np.cross(omega, body.inertia_kg_m2 * omega)
    # thrust makes roll and pitch, torque makes yaw
    level = moment * np.array([1.0, 1.0, 0.0])
    priors = {
        "mass": (SD_REL["mass"], {"force_N": -wrench["force_N"]}),
        "thrust": (SD_REL["thrust"], {"force_N": wrench["force_N"], "moment_Nm": level}),
        "torque": (SD_REL["torque"], {"moment_Nm": moment - level}),
        "speed": (SD_REL["speed"], driven(body, true, speed, speed)),
        "lag": (SD_REL["lag"], driven(body, true, speed, _lag_change(true, speed_rate, step_s))),
    }
    for axis, name in enumerate(("ixx", "iyy", "izz")):
        priors[name] = (SD_REL["inertia"], {"moment_Nm": -whole * np.eye(3)[axis]})
    return priors


def driven(body: Body, true: Mapping[str, float], speed: np.ndarray, change: np.ndarray) -> Change:
    """Return what a small change of rotor speeds does, to first order.

    Parameters
    ----------
    body : the true vehicle.
    true : its numbers.
    speed, change : (n, rotors) speeds and their change (rad/s).

    Returns
    -------
    ``speed_rad_s`` as given, ``force_N`` and ``moment_Nm`` (n, 3) by 2 k w dw.
    """
    return {"speed_rad_s": change, **body.wrench(2.0 * true["thrust"] * speed * change)}


def _scaled(by: float, parts: Sequence[Change]) -> Change:
    channels = {c for part in parts for c in part}
    return {c: by * np.sum([part[c] for part in parts if c in part], axis=0) for c in channels}


def _lag_change(true: Mapping[str, float], speed_rate: np.ndarray, step_s: float) -> np.ndarray:
    """Return d w / d ln tau of tau dw/dt = c - w, which obeys tau dz/dt = -z - tau dw/dt."""
    return _lagged(-true["lag"] * speed_rate, true["lag"], step_s)


def _lagged(rows: np.ndarray, lag_s: float, step_s: float) -> np.ndarray:
    """Return rows (n, k) behind a first-order lag, at rest at the start."""
    from scipy.signal import lfilter, lfiltic

    keep = np.exp(-step_s / max(lag_s, 1e-4))
    start = np.stack([lfiltic([1.0 - keep], [1.0, -keep], y=[x]) for x in rows[0]], axis=1)
    return lfilter([1.0 - keep], [1.0, -keep], rows, axis=0, zi=start)[0]


def _speed_error(
    flown: TrueFlight, rate_hz: float, noise: Noise, craft: TrueVehicle, speed: float
) -> float:
    """Return the sd with which rotor speeds follow from the log at best (rad/s).

    They follow from commands that are logged only now and then, or from speeds that are measured.
    """
    u = flown.state["u"]
    clock = np.arange(len(u)) * flown.step_s
    # commands between two samples are not in the log; a reader holds the last one
    logged = np.floor(clock * rate_hz + 1e-9) / rate_hz
    last = np.minimum((logged / flown.step_s + 1e-9).astype(int), len(u) - 1)
    missed = _lagged(u - u[last], craft.true["lag"], flown.step_s)
    from_commands = float(np.sqrt(np.mean(missed**2))) * craft.true["speed"]
    return min(from_commands, noise.speed_share * speed)
