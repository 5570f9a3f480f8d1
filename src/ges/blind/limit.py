"""What any method could tell: the Neyman-Pearson limit of a flown case.

The generator knows, noise-free, what a concealed effect changed along the flown path (a
:data:`Change`). It also knows the true noise of every sensor and of the air
(:mod:`ges.blind.noise`). A Kalman filter with that noise whitens the change and every column that
prior sds allow. Then

    J = s' (I + N P N')^-1 s

is the squared distance of the truth from the best explanation without the effect. The source is Kay
1998, *Fundamentals of statistical signal processing* II, section 4.4. Willsky and Jones 1976 treat
signals in a state-space model. The expected log likelihood ratio is J / 2, and a test with
false-alarm rate a finds the effect with probability Phi(sqrt(J) - z_(1-a)).

It is an upper bound. The form of the effect is taken as known, and small attitude errors act along
each axis by themselves. Of random gusts the very realisation is taken as known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ges.blind.noise import Air, Noise
from ges.conventions import GRAVITY_M_S2

VIBRATION_RMS = 0.6
"""Root mean square of four rotors' tones over their amplitude, folded down by the sampling."""
AMPLITUDE_SD = 1.0
"""Prior sd of how large the other true effects are, over their true size, where one is left out."""
CHANNELS = {
    "force_N": 3,
    "moment_Nm": 3,
    # as many as there are rotors
    "speed_rad_s": 0,
    "position_m": 3,
    "velocity_m_s": 3,
    "acceleration_m_s2": 3,
    "attitude_rad": 3,
    "rate_rad_s": 3,
    "range_m": 1,
}
Change = Mapping[str, np.ndarray]
"""By channel of :data:`CHANNELS`, (n, width), of rotor speeds (n, rotors), what differs along a
flight: force and moment in the body frame, rotor speeds, and what a faulty sensor adds to its
reading (position and velocity in the world, acceleration, attitude and rates in the body). A
channel that is left out does not differ."""


@dataclass(frozen=True)
class Path:
    """One flown flight at the times of its log, free of noise.

    Attributes
    ----------
    step_s : time from one sample to the next.
    rotation : (n, 3, 3) from the body frame to the world.
    thrust_N, speed_rad_s : (n, rotors) thrusts and speeds of the rotors.
    speed_error_rad_s : sd of rotor speeds between samples, inferred from the log at best.
    changes : by name, what each concealed effect changed.
    priors : by nominal parameter, its prior sd and the change for one unit of it.
    air : disturbance by the air.
    """

    step_s: float
    rotation: np.ndarray
    thrust_N: np.ndarray
    speed_rad_s: np.ndarray
    speed_error_rad_s: float
    changes: Mapping[str, Change]
    priors: Mapping[str, tuple[float, Change]]
    air: Air = field(default_factory=Air)


@dataclass(frozen=True)
class Body:
    """True inertial and geometric properties of a vehicle, in the body frame.

    Attributes
    ----------
    mass_kg : mass.
    inertia_kg_m2 : (3,) principal moments of inertia.
    rotor_m : (rotors, 3) hubs from the centre of mass.
    yaw_m : (rotors,) yaw moment over thrust of each rotor.
    """

    mass_kg: float
    inertia_kg_m2: np.ndarray
    rotor_m: np.ndarray
    yaw_m: np.ndarray

    def wrench(self, thrust_N: np.ndarray) -> Change:
        """Return force and moment of rotor thrusts along the body's z axis.

        Parameters
        ----------
        thrust_N : (n, rotors).

        Returns
        -------
        ``force_N`` and ``moment_Nm``, (n, 3) each, in the body frame.
        """
        moment = thrust_N @ np.stack([self.rotor_m[:, 1], -self.rotor_m[:, 0], self.yaw_m], axis=1)
        force = np.zeros((len(thrust_N), 3))
        force[:, 2] = thrust_N.sum(axis=1)
        return {"force_N": force, "moment_Nm": moment}


def log_likelihood_ratios(
    paths: Sequence[Path], body: Body, noise: Noise
) -> dict[str, float | dict[str, float]]:
    """Return the expected log likelihood ratios of what is concealed, in nats.

    Parameters
    ----------
    paths : the flights; nominal parameters are common to them, sensor biases are each flight's own.
    body : the true vehicle.
    noise : of the log at the step of the paths.

    Returns
    -------
    ``whole``, of the whole truth against nothing, and ``without``, by name, of the whole truth
    against the best explanation that lacks the name. The other names are free then, with an sd of
    :data:`AMPLITUDE_SD` of their true size.

    References
    ----------
    Kay 1998, *Fundamentals of statistical signal processing* II, section 4.4: the ratio is J / 2.
    """
    names = sorted({name for path in paths for name in path.changes})
    if not names:
        return {"whole": 0.0, "without": {}}
    gram, prior_sd = _gram(paths, body, noise, names)
    k = len(names)
    # columns are the true changes, so that the truth has ones; priors can explain it away
    whole = np.concatenate([np.ones(k), np.zeros(len(gram) - k)])
    free = {n: np.array([AMPLITUDE_SD * (n != m) for m in names]) for n in names}
    none = np.concatenate([np.zeros(k), prior_sd])
    return {
        "whole": 0.5 * _distance(gram, whole, none),
        "without": {
            n: 0.5 * _distance(gram, np.eye(len(gram))[i], np.concatenate([free[n], prior_sd]))
            for i, n in enumerate(names)
        },
    }


def power(log_likelihood_ratio: np.ndarray, false_alarm_rate: float) -> np.ndarray:
    """Return the probability that the most powerful test detects an effect.

    Parameters
    ----------
    log_likelihood_ratio : (n,) expected ratios in nats, as :func:`log_likelihood_ratios` has them.
    false_alarm_rate : of the test, 0 to 1.

    Returns
    -------
    (n,) Phi(sqrt(2 ratio) - z_(1-a)) at the false-alarm rate a.
    """
    from scipy.stats import norm

    distance = np.sqrt(2.0 * np.maximum(log_likelihood_ratio, 0.0))
    return norm.cdf(distance - norm.isf(false_alarm_rate))


def _distance(gram: np.ndarray, signal: np.ndarray, sd: np.ndarray) -> float:
    """Return s' (I + N P N')^-1 s of columns with this Gram matrix.

    It follows by the matrix inversion lemma, in units in which every uncertainty is one.
    """
    doubtful = np.flatnonzero(sd)
    # s' s - s' N (P^-1 + N' N)^-1 N' s, P scaled to one
    scaled = gram[:, doubtful] * sd[doubtful]
    inner = np.eye(len(doubtful)) + scaled[doubtful] * sd[doubtful, None]
    seen = signal @ scaled
    return float(max(signal @ gram @ signal - seen @ np.linalg.solve(inner, seen), 0.0))


def _gram(
    paths: Sequence[Path], body: Body, noise: Noise, names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gram matrix of whitened columns, and the sds of all but the first ``len(names)``.

    Columns are the changes, the nominal parameters (one for all flights), and each flight's own
    sensor biases.
    """
    shared = {n: sd for path in paths for n, (sd, _) in path.priors.items()}
    biases = _biases(noise)
    size = len(names) + len(shared) + len(biases) * len(paths)
    gram = np.zeros((size, size))
    for number, path in enumerate(paths):
        columns = [path.changes.get(n, {}) for n in names]
        columns += [path.priors[n][1] if n in path.priors else {} for n in shared]
        columns += [{c: np.broadcast_to(v, (len(path.thrust_N), len(v)))} for c, v, _ in biases]
        own = len(names) + len(shared) + len(biases) * number + np.arange(len(biases))
        at = np.concatenate([np.arange(len(names) + len(shared)), own])
        gram[np.ix_(at, at)] += _flight_gram(path, body, noise, columns)
    sds = [*shared.values(), *[sd for _, _, sd in biases] * len(paths)]
    return gram, np.array(sds, dtype=float)


def _biases(noise: Noise) -> list[tuple[str, np.ndarray, float]]:
    kinds = (
        ("attitude_rad", noise.attitude_bias_rad),
        ("rate_rad_s", noise.rate_bias_rad_s),
        ("acceleration_m_s2", noise.acceleration_bias_m_s2),
    )
    return [(c, unit, sd) for c, sd in kinds for unit in np.eye(3) if sd > 0.0]


def _flight_gram(path: Path, body: Body, noise: Noise, columns: Sequence[Change]) -> np.ndarray:
    n, rotors = path.thrust_N.shape
    # a channel that a change leaves out is zero there
    parts = {
        c: np.stack(
            [np.broadcast_to(one.get(c, 0.0), (n, w or rotors)) for one in columns], axis=-1
        )
        for c, w in CHANNELS.items()
    }
    to_world = "nij,njc->nic"
    attitude = np.einsum(to_world, path.rotation, parts["attitude_rad"])
    # a reading of the attitude that is off by (a, b) tilts the thrust, so gravity's share moves
    tilted = GRAVITY_M_S2 * np.stack([attitude[:, 1], -attitude[:, 0], 0.0 * attitude[:, 2]], 1)
    push = np.einsum(to_world, path.rotation, parts["force_N"]) / body.mass_kg
    felt = np.einsum(to_world, path.rotation, parts["acceleration_m_s2"])
    shaken = _thrust_noise(path, body)
    gram = np.zeros((len(columns), len(columns)))
    turn = parts["moment_Nm"] / body.inertia_kg_m2[:, None]
    # axes that have the same filter go through it side by side
    for axes in ([0, 1], [2]):
        model = _translation(path, noise, axes == [0, 1], _rms(shaken["force"][axes]))
        readings = np.stack(
            [parts["position_m"][:, axes], parts["velocity_m_s"][:, axes], felt[:, axes]], axis=1
        )
        gram += model.gram(push[:, axes] - tilted[:, axes], readings, push[:, axes])
        model = _rotation(path, noise, _rms(shaken["moment"][axes]))
        readings = np.stack([parts["attitude_rad"][:, axes], parts["rate_rad_s"][:, axes]], axis=1)
        gram += model.gram(turn[:, axes], readings)
    if np.isfinite(noise.speed_share):
        # speeds and ranges have white noise alone, so that no filter is needed
        sd = noise.speed_share * np.maximum(path.speed_rad_s, 1.0)
        gram += _white_gram(parts["speed_rad_s"] / sd[:, :, None])
    if np.isfinite(noise.range_m):
        gram += _white_gram(parts["range_m"] / noise.range_m)
    return gram


def _rms(sds: np.ndarray) -> float:
    return float(np.sqrt(np.mean(sds**2)))


def _white_gram(rows: np.ndarray) -> np.ndarray:
    flat = rows.reshape(-1, rows.shape[-1])
    return flat.T @ flat


def _thrust_noise(path: Path, body: Body) -> dict[str, np.ndarray]:
    """Return sds of the acceleration that unknown rotor speeds between the samples make.

    They are those of acceleration (world, 3) and angular acceleration (body, 3).
    """
    # thrust goes with w^2, so dT / T = 2 dw / w
    share = 2.0 * path.speed_error_rad_s / np.maximum(path.speed_rad_s, 1.0)
    each = path.thrust_N * share
    upright = path.rotation[:, :, 2]
    total = np.sqrt((each**2).sum(axis=1))
    force = np.sqrt(((upright * total[:, None]) ** 2).mean(axis=0)) / body.mass_kg
    arms = np.stack([body.rotor_m[:, 1], -body.rotor_m[:, 0], body.yaw_m], axis=1)
    moment = np.sqrt((each**2).mean(axis=0) @ arms**2) / body.inertia_kg_m2
    return {"force": force, "moment": moment}


def _translation(path: Path, noise: Noise, level: bool, shaken: float) -> _Filter:
    """Return the filter of one world axis.

    States are position, velocity, the air, and the drifts of attitude and of both readings. It
    reads position, velocity and acceleration.
    """
    model = _Filter(path.step_s, len(path.thrust_N), path.air.level)
    p, v = model.state(), model.state()
    model.transition[p, v] = path.step_s
    # white errors of the attitude, a new one every sample, tilt the known thrust
    tilt = GRAVITY_M_S2 * noise.attitude_rad if level else 0.0
    model.process[v] = path.step_s**2 * (tilt**2 + shaken**2)
    # the air's push is read by the accelerometer, too: the same states drive both
    air = [model.drift(sd, time, airborne=True) for sd, time in path.air.acceleration_m_s2]
    for state in air:
        model.transition[v, state] = path.step_s
    if level:
        model.transition[v, model.drift(*noise.attitude_drift)] = path.step_s * GRAVITY_M_S2
    model.drive = (v, path.step_s)
    pose = np.arange(len(path.thrust_N)) % noise.pose_every == 0
    model.reading(noise.position_m, (p, model.drift(*noise.position_drift)), pose)
    model.reading(noise.velocity_m_s, (v, model.drift(*noise.velocity_drift)), pose)
    # the rotors' tones, folded down by the sampling, count as white
    tones = VIBRATION_RMS * noise.vibration_m_s2
    model.reading(float(np.sqrt(noise.acceleration_m_s2**2 + tones**2 + shaken**2)), air)
    return model


def _rotation(path: Path, noise: Noise, shaken: float) -> _Filter:
    """Return the filter of one body axis.

    States are angle, rate, the air and the drift of the attitude. It reads angle and rate.
    """
    model = _Filter(path.step_s, len(path.thrust_N), path.air.level)
    angle, rate = model.state(), model.state()
    model.transition[angle, rate] = path.step_s
    model.process[rate] = (path.step_s * shaken) ** 2
    for sd, time in path.air.acceleration_m_s2:
        turn = path.air.turn_per_m * sd
        model.transition[rate, model.drift(turn, time, airborne=True)] = path.step_s
    model.drive = (rate, path.step_s)
    pose = np.arange(len(path.thrust_N)) % noise.pose_every == 0
    model.reading(noise.attitude_rad, (angle, model.drift(*noise.attitude_drift)), pose)
    model.reading(float(np.hypot(noise.rate_rad_s, VIBRATION_RMS * noise.vibration_rad_s)), (rate,))
    return model


class _Filter:
    """A Kalman filter of one axis, put together state by state, that whitens columns."""

    MOST = 12
    UNKNOWN = 1e3
    CONVERGED = 1e-10

    def __init__(self, step_s: float, n: int, level: np.ndarray | None):
        self.step_s, self.n, self.level = step_s, n, level
        self.transition = np.eye(self.MOST)
        self.process, self.airborne = np.zeros(self.MOST), np.zeros(self.MOST)
        self.start = np.zeros(self.MOST)
        self.size = 0
        self.drive = (0, 0.0)
        self.readings: list[tuple[float, tuple[int, ...], np.ndarray]] = []

    def state(self) -> int:
        """Add a state of which nothing is known at the start."""
        self.start[self.size] = self.UNKNOWN
        self.size += 1
        return self.size - 1

    def drift(self, sd: float, time_s: float, airborne: bool = False) -> int:
        """Add an Ornstein-Uhlenbeck state; what is airborne follows the level of the air."""
        at, keep = self.size, np.exp(-self.step_s / time_s)
        self.transition[at, at] = keep
        (self.airborne if airborne else self.process)[at] = sd**2 * (1.0 - keep**2)
        self.start[at] = sd**2
        self.size += 1
        return at

    def reading(self, sd: float, of: Sequence[int], when: np.ndarray | None = None) -> None:
        """Add a sensor that reads a sum of states, with white noise, at some of the samples."""
        every = np.ones(self.n, dtype=bool)
        self.readings.append((sd, tuple(of), every if when is None else when))

    def gram(
        self, push: np.ndarray, readings: np.ndarray, felt: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the Gram matrix (c, c) of the innovations of columns, summed over axes.

        Parameters
        ----------
        push : (n, axes, c) what drives each axis.
        readings : (n, sensors, axes, c) what is added to readings.
        felt : (n, axes, c) what the last sensor reads of ``push`` at once; nothing if left out.
        """
        n, axes, c = push.shape
        values = readings.reshape(n, len(self.readings), axes * c).copy()
        if felt is not None:
            values[:, -1] += felt.reshape(n, axes * c)
        rows = self._innovations(push.reshape(n, axes * c), values)
        flat = rows.reshape(-1, axes, c)
        return np.einsum("kai,kaj->ij", flat, flat)

    def _innovations(self, push: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return whitened innovations (n, sensors, columns)."""
        s, (at, weight) = self.size, self.drive
        # in units of their own noise, so that a deaf sensor beside a keen one costs no digits
        sds = np.array([sd for sd, _, _ in self.readings])
        values = values / sds[:, None]
        seen = np.zeros((len(self.readings), s))
        for row, (sd, of, _) in enumerate(self.readings):
            seen[row, list(of)] = 1.0 / sd
        step, covariance = self.transition[:s, :s], np.diag(self.start[:s])
        state, rows = np.zeros((s, push.shape[1])), np.empty_like(values)
        steady = None
        for k in range(self.n):
            if steady is None:
                gain, root, after = self._update(covariance, seen, k)
                # the Riccati recursion has converged: from here on gain and root stay the same
                moved = np.abs(after - covariance).max()
                if self._constant and moved <= self.CONVERGED * np.abs(after).max():
                    steady = k
                covariance = after
            innovation = values[k] - seen @ state
            rows[k] = root @ innovation
            # the filter's estimate, less what truly is: the filter knows of no push
            state = step @ (state + gain @ innovation)
            state[at] -= weight * push[k]
        return rows

    @property
    def _constant(self) -> bool:
        return self.level is None and all(when.all() for _, _, when in self.readings)

    def _update(
        self, covariance: np.ndarray, seen: np.ndarray, k: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gain, the innovations' whitening root, and the covariance one step on."""
        s, step = self.size, self.transition[: self.size, : self.size]
        # a sensor without a sample at this time has neither gain nor innovation
        live = np.array([when[k] for _, _, when in self.readings])
        part = seen[live]
        cross = covariance @ part.T
        # S = H P H' + I in units of the readings' noise; L^-1 of S = L L' whitens the innovation
        inner = part @ cross + np.eye(len(part))
        solved = np.linalg.solve(inner, cross.T).T
        gain, root = np.zeros((s, len(live))), np.zeros((len(live),) * 2)
        gain[:, live] = solved
        root[np.ix_(live, live)] = np.linalg.inv(np.linalg.cholesky(inner))
        # P = F (P - K H P) F' + Q, where only the air's part of Q follows the level of the air
        level = 1.0 if self.level is None else self.level[k]
        process = self.process[:s] + self.airborne[:s] * level**2
        after = step @ (covariance - solved @ cross.T) @ step.T + np.diag(process)
        return gain, root, 0.5 * (after + after.T)
