"""What every world hands over: flown flights with what was concealed in them, as a sealed set.

A world flies its designs; this module draws how they are logged, writes the recording set, and
seals the truth with the limit of what any method could tell (:mod:`ges.blind.limit`).
"""

from __future__ import annotations

import hashlib
import itertools
import os
import shutil
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.spatial.transform import Rotation

from ges.blind.foreign.recorder import Flown, Log, record, sample_times
from ges.blind.generator.airframe import DOUBTS, Airframe
from ges.blind.limit import Body, Change, log_likelihood_ratios
from ges.blind.limit import Path as FlownPath
from ges.blind.noise import Noise
from ges.errors import UsageError
from ges.files import write_json

HALVES = ("development", "evaluation")
FIRST_OF_EVALUATION = 1000
LIMIT_RATE_HZ = 130.0
"""Faster logs are thinned for the limit: what is told apart is slower than this."""
FLAT = {"kind": "flat", "z_m": 0.0}
INERTIA = ("ixx", "iyy", "izz")
# what it is called when a vehicle file is wrong about one of its numbers
NAME_OF_WRONG = {
    "mass": "thrust_scale",
    "thrust": "thrust_scale",
    "torque": "torque_coefficient",
    "inertia": "inertia",
    "lag": "motor_lag",
}


def half_of(seed: int) -> str:
    """Return the half that a seed belongs to: evaluation from :data:`FIRST_OF_EVALUATION` on."""
    return HALVES[seed >= FIRST_OF_EVALUATION]


def check_half(half: str, seed: int) -> None:
    """Refuse a seed of the other half.

    Raises
    ------
    UsageError
        When ``seed`` belongs to the other half.
    """
    if half_of(seed) != half:
        raise UsageError(
            f"seed {seed} belongs to {half_of(seed)}, not to {half}; seeds below"
            f" {FIRST_OF_EVALUATION} are for development, the others for evaluation"
        )


@dataclass(frozen=True)
class Place:
    """Which set of a world this is; everything drawn for it follows from it."""

    world: str
    key: str
    half: str
    seed: int

    @property
    def identity(self) -> str:
        """A name that says nothing of the world or of what is concealed."""
        text = f"{self.world}/{self.key}/{self.half}/{self.seed}"
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def rng(self, purpose: str) -> np.random.Generator:
        """Return a random stream of its own."""
        parts = (self.world, self.key, self.half, purpose)
        return np.random.default_rng([self.seed, *(zlib.crc32(p.encode()) for p in parts)])


# two levels of noise for each half, over the ordinary one, and the rates of each half
LEVELS = {
    "development": {"low": 0.4, "high": 1.5},
    "evaluation": {"low": 0.6, "high": 1.9},
}
RATES_HZ = {"development": (50.0, 100.0, 250.0, 500.0), "evaluation": (62.5, 125.0, 200.0, 400.0)}


def draw_log(place: Place, number: int, noise: Noise | None = None) -> Log:
    """Return how the ``number``-th set of a world is logged: rates and levels go round, what is
    logged is drawn."""
    rng = place.rng("log")
    rates, levels = RATES_HZ[place.half], LEVELS[place.half]
    level = list(levels)[(number // len(rates) + number) % 2]
    rate = rates[number % len(rates)]
    sensors = (noise or Noise()).scaled(levels[level])
    # motion capture is slower than an inertial sensor that is logged at every turn of the loop
    every = 4 if rate > 300.0 else 1
    return Log(
        rate,
        replace(sensors, pose_every=every),
        level,
        rotor_speeds=bool(rng.random() < 0.6),
        references=bool(rng.random() < 0.8),
    )


@dataclass(frozen=True)
class Concealed:
    """What is true of a set: names, other answers that are as right, and how it is counted.

    ``optional`` are names that are true as well but small; ``instead`` whole answers that are as
    right. ``verdict`` and ``category`` follow from the names where they are left out.
    """

    names: tuple[str, ...] = ()
    severity: str = "medium"
    optional: tuple[str, ...] = ()
    instead: tuple[tuple[str, ...], ...] = ()
    verdict: str = ""
    category: str = ""
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    note: str = ""

    def truth(self) -> dict[str, Any]:
        """Return the contract's form, with the category beside it."""
        return {
            "verdict": self.verdict or ("physics" if self.names else "nothing_proven"),
            "findings": self._findings(self.names),
            "severity": self.severity,
            "also_acceptable": self._other(),
            "category": self.category or CATEGORY_OF_SIZE[min(len(self.names), 3)],
            "note": self.note,
        }

    def _findings(self, names: Iterable[str]) -> list[dict[str, Any]]:
        return [
            {"name": n, "parameters": dict(self.parameters.get(n, {}))} | place
            for n in names
            for place in ([{"place": p} for p in self.places.get(n, ())] or [{}])
        ]

    def _other(self) -> list[list[str]]:
        whole = [
            sorted({*names, *more})
            for names in (self.names, *self.instead)
            for size in range(len(self.optional) + 1)
            for more in itertools.combinations(self.optional, size)
        ]
        unlike = [names for names in whole if set(names) != set(self.names)]
        return [list(names) for names in dict.fromkeys(map(tuple, unlike))]


CATEGORY_OF_SIZE = ("null", "single", "pair", "triple")


def write_flown(
    out: Path,
    place: Place,
    craft: Airframe,
    flights: Sequence[Flown],
    log: Log,
    concealed: Concealed,
    method: str,
    wrong: Mapping[str, float] = MappingProxyType({}),
) -> None:
    """Record flown flights, write the set, seal its truth and what any method could tell of it.

    Parameters
    ----------
    craft : the true vehicle and what its file honestly declares.
    method : how the limit is known, in words.
    wrong : factors by which the file is wrong beyond its doubts, by the numbers of
        :data:`NAME_OF_WRONG`.
    """
    rng = place.rng("sensors")
    frames = [record(flown, log, rng) for flown in flights]
    thin = int(np.ceil(log.rate_hz / LIMIT_RATE_HZ))
    paths = [flown_path(flown, log, thin, craft, wrong) for flown in flights]
    craft = replace(craft, declared=misdeclared(craft.declared, wrong))
    limits = log_likelihood_ratios(paths, body_of(craft), log.sensors.thinned(thin))
    content = concealed.truth() | {
        "detectable": limits | {"method": method},
        "situation": situation(place, craft.size, log),
    }
    write_set(out, place, craft.vehicle_file(FLAT), frames, content)


def situation(place: Place, vehicle: str, log: Log) -> dict[str, Any]:
    """Return what surrounds a set, for the table of cases."""
    return {
        "world": place.world,
        "design": place.key,
        "vehicle": vehicle,
        "noise": log.level,
        "rate_hz": log.rate_hz,
        "rotor_speeds": log.rotor_speeds,
        "references": log.references,
    }


def write_set(
    out: Path,
    place: Place,
    vehicle: Mapping[str, Any],
    frames: Sequence[pd.DataFrame],
    truth: Mapping[str, Any],
) -> None:
    """Write one recording set under a name that says nothing, whole or not at all; the truth last.

    Parameters
    ----------
    vehicle : content of the vehicle file.
    """
    final, folder = out / "cases" / place.identity, out / "cases" / f".{place.identity}"
    for left in (final, folder):
        shutil.rmtree(left, ignore_errors=True)
    folder.mkdir(parents=True)
    for number, frame in enumerate(frames, 1):
        rounded = frame.astype({c: "float32" for c in frame.columns if c != "t_s"})
        rounded.to_parquet(folder / f"flight_{number}.parquet", index=False, compression="zstd")
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(dict(vehicle), sort_keys=False))
    for path in (*folder.iterdir(), folder):
        os.utime(path, (0, 0))
    os.replace(folder, final)
    write_json(out / "sealed" / f"{place.identity}.json", truth)


def body_of(craft: Airframe) -> Body:
    """Return the true vehicle in the limit's terms."""
    true = craft.true
    height = np.full(4, craft.rotor_z_m)
    yaw = -np.array(craft.spin) * true["torque"] / true["thrust"]
    places = np.stack([craft.rotor_x_m, craft.rotor_y_m, height], axis=1)
    return Body(true["mass"], np.array([true[k] for k in ("ixx", "iyy", "izz")]), places, yaw)


def misdeclared(declared: Mapping[str, float], wrong: Mapping[str, float]) -> dict[str, float]:
    """Return what a wrong file declares; 'inertia' is wrong about all three axes."""
    return {k: v * wrong.get("inertia" if k in INERTIA else k, 1.0) for k, v in declared.items()}


def flown_path(
    flown: Flown, log: Log, thin: int, craft: Airframe, wrong: Mapping[str, float]
) -> FlownPath:
    """Return a flight as the limit sees it, at every ``thin``-th of the log's times, with what the
    file doubts and what it is wrong about.
    """
    t = sample_times(flown, log.rate_hz / thin)
    clock = np.arange(len(flown.state["p"])) * flown.step_s

    def at(rows: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, clock, row) for row in rows.T], axis=1)

    speed = at(flown.state["rotor_speed"])
    rate = at(np.gradient(flown.state["rotor_speed"], flown.step_s, axis=0))
    omega = at(flown.state["omega"])
    turning = at(np.gradient(flown.state["omega"], flown.step_s, axis=0))
    level = flown.air.level
    step_s = thin / log.rate_hz
    body = body_of(craft)
    declared = doubts(body, craft.true, speed, rate, omega, turning, step_s)
    changes = {n: {c: at(v) for c, v in one.items()} for n, one in flown.changes.items()}
    for number, factor in wrong.items():
        if number == "lag":
            slow = _lagged(flown.state["u"], factor * craft.true["lag"], flown.step_s)
            quick = _lagged(flown.state["u"], craft.true["lag"], flown.step_s)
            off = at(quick - slow) * craft.true["speed"]
            changes[NAME_OF_WRONG[number]] = driven(body, craft.true, speed, off)
        else:
            parts = INERTIA if number == "inertia" else (number,)
            changes[NAME_OF_WRONG[number]] = _scaled(
                1.0 / factor - 1.0, [declared[part][1] for part in parts]
            )
    return FlownPath(
        step_s=step_s,
        rotation=Rotation.from_quat(at(flown.state["q"]), scalar_first=True).as_matrix(),
        thrust_N=craft.true["thrust"] * speed**2,
        speed_rad_s=speed,
        speed_error_rad_s=_speed_error(flown, log, craft, float(speed.mean())),
        changes=changes,
        doubts=declared,
        air=flown.air if level is None else replace(flown.air, level=np.interp(t, clock, level)),
    )


def doubts(
    body: Body,
    true: Mapping[str, float],
    speed: np.ndarray,
    speed_rate: np.ndarray,
    omega: np.ndarray,
    turning: np.ndarray,
    step_s: float,
) -> dict[str, tuple[float, Change]]:
    """Return (sd, change for one) of every declared number, relative to its value.

    Parameters
    ----------
    speed, speed_rate : (n, 4) rotor speeds (rad/s) and their rates; omega, turning : (n, 3) body
        rates and their rates.
    """
    thrust = true["thrust"] * speed**2
    wrench = body.wrench(thrust)
    moment = wrench["moment_Nm"]
    whole = body.inertia_kg_m2 * turning + np.cross(omega, body.inertia_kg_m2 * omega)
    level = moment * np.array([1.0, 1.0, 0.0])
    found = {
        "mass": (DOUBTS["mass"], {"force_N": -wrench["force_N"]}),
        "thrust": (DOUBTS["thrust"], {"force_N": wrench["force_N"], "moment_Nm": level}),
        "torque": (DOUBTS["torque"], {"moment_Nm": moment - level}),
        "speed": (DOUBTS["speed"], driven(body, true, speed, speed)),
        "lag": (DOUBTS["lag"], driven(body, true, speed, _lag_change(true, speed_rate, step_s))),
    }
    for axis, name in enumerate(("ixx", "iyy", "izz")):
        found[name] = (DOUBTS["inertia"], {"moment_Nm": -whole * np.eye(3)[axis]})
    return found


def driven(body: Body, true: Mapping[str, float], speed: np.ndarray, change: np.ndarray) -> Change:
    """Return what a small change (n, 4) of rotor speeds does: to the speeds and to the wrench."""
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


def _speed_error(flown: Flown, log: Log, craft: Airframe, speed: float) -> float:
    """Return how well rotor speeds follow from the log at best, one sd (rad/s): from commands that
    are logged only now and then, or from speeds that are measured."""
    u = flown.state["u"]
    every = np.maximum(np.arange(len(u)) * flown.step_s * log.rate_hz + 1e-9, 0.0)
    last = np.minimum(np.floor(np.floor(every) / (log.rate_hz * flown.step_s) + 1e-9), len(u) - 1)
    missed = _lagged(u - u[last.astype(int)], craft.true["lag"], flown.step_s)
    held = float(np.sqrt(np.mean(missed**2))) * craft.true["speed"]
    return min(held, log.sensors.speed_share * speed)
