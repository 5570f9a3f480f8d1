"""What the effects promise, checked over the whole table; run as a program it lists the violations.

Run against another library with GES_LIBRARY, as the tests with planted faults do.
"""

from __future__ import annotations

import contextlib

import numpy as np
import pint

from ges.conventions import rotor_columns
from ges.simulator import _lib, effects
from ges.simulator.parameters import parameters
from ges.simulator.terrain import Terrain
from ges.vehicle.layouts import LAYOUTS

UNITS = pint.UnitRegistry()
N = 64
BOWL_AXIS = np.linspace(-3, 3, 25)
FRAMES = ("x", "tri", "hexa-x", "octo-x", "x8", "deca-x", "canted")


def numbers_of(frame: str) -> dict[str, float]:
    """A frame whose hubs are above its centre, so that arms matter in every axis."""
    mounts = LAYOUTS["hexa-x" if frame == "canted" else frame]
    numbers = {"rotors": float(len(mounts))}
    for i, m in enumerate(mounts, 1):
        angle = np.radians(m.angle_deg)
        # the rear rotor of a tricopter is its own mirror image, which no spin is
        spin = 0.0 if frame == "tri" and m.angle_deg == 180 else 1.0 if m.spin == "ccw" else -1.0
        numbers |= {
            f"rotor_{i}_x_m": 0.124 * np.cos(angle),
            f"rotor_{i}_y_m": -0.124 * np.sin(angle),
            f"rotor_{i}_z_m": 0.03 + 0.02 * m.level,
            f"rotor_{i}_radius_m": 0.083,
            f"rotor_{i}_spin": spin,
        }
        if frame == "canted":
            # turned about its arm by a quarter of a radian, with the sense of its spin
            numbers |= {
                f"rotor_{i}_axis_x": -0.25 * spin * -np.sin(angle),
                f"rotor_{i}_axis_y": 0.25 * spin * np.cos(angle),
            }
    return numbers


def partners(frame: str) -> list[int]:
    """Of every rotor, the one at its place in a mirror that swaps left and right."""
    at = numbers_of(frame)
    hubs = [[at[f"rotor_{i}_{a}_m"] for a in "xyz"] for i in range(1, int(at["rotors"]) + 1)]
    return [
        int(np.argmin([np.linalg.norm(np.subtract(hub, (x, -y, z))) for hub in hubs]))
        for x, y, z in hubs
    ]


FRAME = FRAMES[0]
"""What is flown now."""


@contextlib.contextmanager
def flying(frame: str):
    """All checks of another frame."""
    global FRAME
    before, FRAME = FRAME, frame
    try:
        yield
    finally:
        FRAME = before


def columns(prefix: str, names: str, suffix: str) -> list[str]:
    return [f"{prefix}{n}{suffix}" for n in names]


def rotors(template: str) -> list[str]:
    return list(rotor_columns(template, int(numbers_of(FRAME)["rotors"])))


def random_samples(seed: int = 0) -> dict[str, np.ndarray]:
    """Flying states near the ground: tilted, turning, with unequal rotor speeds."""
    rng = np.random.default_rng(seed)
    s = {"t_s": np.arange(N) * 0.01, "battery_V": rng.uniform(14, 16, N)}
    for name, low, high in [("p_x_m", -1, 1), ("p_y_m", -1, 1), ("p_z_m", 0.15, 0.5)]:
        s[name] = rng.uniform(low, high, N)
    for name in columns("v_", "xyz", "_m_s"):
        s[name] = rng.uniform(-3, 3, N)
    axis, angle = rng.normal(size=(N, 3)), rng.uniform(-0.3, 0.3, N)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    s["q_w"] = np.cos(angle / 2)
    for k, name in enumerate(columns("q_", "xyz", "")):
        s[name] = axis[:, k] * np.sin(angle / 2)
    for name in columns("omega_", "xyz", "_rad_s") + columns("omega_dot_", "xyz", "_rad_s2"):
        s[name] = rng.uniform(-2, 2, N)
    for name in rotors("rotor_speed_{}_rad_s"):
        s[name] = rng.uniform(350, 550, N)
    for name in rotors("rotor_acceleration_{}_rad_s2"):
        s[name] = rng.uniform(-500, 500, N)
    for name in rotors("u_{}"):
        s[name] = rng.uniform(0.4, 0.9, N)
    return s


def bowl(flip: bool = False) -> Terrain:
    """Uneven ground without symmetry, or its left-right image."""
    x, y = np.meshgrid(BOWL_AXIS, BOWL_AXIS)
    z = 0.02 * np.sin(2 * x + 0.3) + 0.03 * np.cos(3 * y + 0.5) - 0.03
    return Terrain.grid(BOWL_AXIS, BOWL_AXIS, z[::-1] if flip else z)


def vehicle() -> dict[str, float]:
    return numbers_of(FRAME)


def context(effect: effects.Effect) -> dict:
    return {"ground_effect": {"amplitude": 1.5}} if effect.modifies else {}


def added(
    effect: effects.Effect,
    values: dict,
    samples: dict,
    numbers: dict | None = None,
    terrain: Terrain | None = None,
):
    given = {**vehicle(), **(numbers or {})}
    return effects.evaluate(
        effect.name,
        values,
        effects.Samples.from_columns(samples),
        given,
        context(effect),
        terrain or Terrain.flat(),
    )


def largest(replay: effects.Replay) -> float:
    return float(np.nanmax(np.abs(replay.data)))


def check_neutral(effect):
    change = added(effect, effect.neutral(), random_samples(), terrain=bowl()).data
    change[effects.replay_rows(len(partners(FRAME)))["battery_V"]] = (
        0.0  # the voltage itself may sag without consequence
    )
    if np.nanmax(np.abs(change)) != 0.0:
        yield "does not vanish at its neutral parameters"


def check_acts(effect):
    coaxial = any(m.level for m in LAYOUTS.get(FRAME, ()))
    if effect.name == "coaxial_wake" and not coaxial:
        return
    if not largest(added(effect, effect.completed({}), random_samples(), terrain=bowl())) > 1e-9:
        yield "does nothing at its typical parameters"


def mirrored(samples: dict) -> dict:
    out = dict(samples)
    for name in [
        "p_y_m",
        "v_y_m_s",
        "q_x",
        "q_z",
        *columns("omega_", "xz", "_rad_s"),
        *columns("omega_dot_", "xz", "_rad_s2"),
    ]:
        out[name] = -samples[name]
    for template in ("rotor_speed_{}_rad_s", "rotor_acceleration_{}_rad_s2", "u_{}"):
        names = rotors(template)
        for i, j in enumerate(partners(FRAME)):
            out[names[i]] = samples[names[j]]
    return out


def check_mirror(effect):
    if "mirror" not in effect.invariants:
        return
    a = added(effect, effect.completed({}), random_samples(), terrain=bowl())
    b = added(effect, effect.completed({}), mirrored(random_samples()), terrain=bowl(flip=True))
    scale = max(largest(a), 1e-12)
    gaps = [
        a.force_N * [1, -1, 1] - b.force_N,
        a.moment_Nm * [-1, 1, -1] - b.moment_Nm,
        a.thrust_N[:, partners(FRAME)] - b.thrust_N,
    ]
    if max(np.abs(g).max() for g in gaps) > 1e-9 * scale:
        yield "is not mirror-symmetric"


def body_velocity(samples: dict) -> np.ndarray:
    w, x, y, z = (samples[f"q_{a}"] for a in "wxyz")
    r = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.einsum("jin,jn->ni", r, np.stack([samples[n] for n in columns("v_", "xyz", "_m_s")]))


def power(effect, samples) -> np.ndarray:
    replay = added(effect, effect.completed({}), samples)
    omega = np.stack([samples[n] for n in columns("omega_", "xyz", "_rad_s")], axis=1)
    return (replay.force_N * body_velocity(samples)).sum(1) + (replay.moment_Nm * omega).sum(1)


def check_power(effect):
    if "dissipates" in effect.invariants:
        samples = random_samples()
        for name in columns("omega_", "xyz", "_rad_s"):
            samples[name] = 0 * samples[name]
        if power(effect, samples).max() > 1e-12:
            yield "feeds energy into the motion"
        turning = random_samples()
        for name in columns("v_", "xyz", "_m_s"):
            turning[name] = 0 * turning[name]
        if power(effect, turning).max() > 1e-12:
            yield "feeds energy into the rotation"
    if "no_work" in effect.invariants and np.abs(power(effect, random_samples())).max() > 1e-12:
        yield "does work"


def check_height(effect):
    samples = random_samples()
    if "fades" in effect.invariants:
        low, high = (
            added(effect, effect.completed({}), samples),
            dict(samples, p_z_m=samples["p_z_m"] + 20.0),
        )
        if largest(added(effect, effect.completed({}), high)) > 1e-3 * largest(low):
            yield "does not fade with height"
    if "free_air" in effect.invariants:
        a, b = (
            added(effect, effect.completed({}), samples, terrain=t)
            for t in (Terrain.flat(-50.0), bowl())
        )
        if np.abs(a.force_N - b.force_N).max() + np.abs(a.moment_Nm - b.moment_Nm).max() > 1e-9:
            yield "depends on the ground"


def factor(unit: str, scale: dict[str, float]) -> float:
    dimension = UNITS.parse_units(unit.replace("Nm", "N m")).dimensionality if unit != "1" else {}
    result = 1.0
    for name, exponent in dict(dimension).items():
        result *= scale[name.strip("[]")] ** float(exponent)
    return result


def units_of(table) -> dict[str, str]:
    """Unit of every column of the vehicle."""
    return {
        name.replace("#", str(rotor)): unit
        for name, unit, _, each in table
        for rotor in (range(1, len(partners(FRAME)) + 1) if each else (0,))
    }


def rescaled_samples(samples: dict, scale: dict) -> dict:
    units = units_of(_lib.replay_tables()[0])
    return {name: values * factor(units[name], scale) for name, values in samples.items()}


def check_homogeneous(effect):
    scale = {"length": 1.25, "mass": 0.8, "time": 1.0 if effect.n_states else 1.1, "current": 1.05}
    values = {p.name: p.default * factor(p.unit, scale) for p in effect.parameters}
    base = {
        p.name: p.default for p in parameters().values() if not p.name.startswith("terrain")
    } | vehicle()
    numbers = {n: v * factor(parameters()[n].unit, scale) for n, v in base.items()}
    samples = random_samples()
    a = added(effect, effect.completed({}), samples, base)
    b = added(effect, values, rescaled_samples(samples, scale), {**numbers, "seed": 1.0})
    for name, unit in units_of(_lib.replay_tables()[1]).items():
        expected = a[name] * factor(unit, scale)
        size = max(np.nanmax(np.abs(expected)), 1e-9)
        if not np.allclose(expected, b[name], rtol=0, atol=1e-6 * size, equal_nan=True):
            yield f"is not dimensionally homogeneous in {name}"


STEPS_S = (0.004, 0.005, 0.01, 0.02)  # between samples of a log
FINE_S = 0.001


def check_stable(effect):
    """Along a recording extra states do not grow by themselves, however slowly it was sampled and
    however short a time constant becomes.
    """
    for share in (0.01, 0.1, 1.0) if effect.n_states else ():
        values = {
            p.name: p.default * (1.0 if np.isnan(p.neutral) else share) for p in effect.parameters
        }
        fine, *sampled = (
            added(effect, values, {**random_samples(), "t_s": np.arange(N) * step}).data
            for step in (FINE_S, *STEPS_S)
        )
        bound = 10.0 * max(np.nanmax(np.abs(fine)), 1.0)
        for step, data in zip(STEPS_S, sampled, strict=True):
            if np.isnan(data).sum() > np.isnan(fine).sum() or np.nanmax(np.abs(data)) > bound:
                yield f"is unstable at {share:g} of its size and {step:g} s between samples"


CHECKS = (
    check_neutral,
    check_acts,
    check_mirror,
    check_power,
    check_height,
    check_homogeneous,
    check_stable,
)


def violations() -> list[str]:
    found = []
    for frame in FRAMES:
        with flying(frame):
            found += [
                f"{effect.name} {what} ({frame})"
                for effect in effects.table().values()
                for check in CHECKS
                for what in check(effect)
            ]
    return found


if __name__ == "__main__":
    found = violations()
    print("\n".join(found))
    raise SystemExit(bool(found))
