"""The oracle: how well the true names, in the library's form, can match what truly happened.

The library's form is fitted to the noise-free forces, moments and rotor speeds that the generator
knows and no recording shows. It answers two questions. How much of a concealed effect can a
candidate of that name reach at all? Which parameters should a diagnosis come to?
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ges.blind.generator.drive import NOMINAL
from ges.blind.generator.whereabouts import FAST_STEP, TRUTH_STEP
from ges.conventions import (
    BODY_RATE,
    MAX_ROTORS,
    POSITION,
    QUATERNION,
    VELOCITY,
    command,
    rotor_columns,
    rotor_speed,
)
from ges.errors import GesError
from ges.simulator import effects as effect_table
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Vehicle
from ges.vehicle.load import load_vehicle

STEP_S = 0.004
# the exponential form with no ceiling that binds: gain and decay are all that shapes it
WIDE = {"form": 3.0, "amplitude": 1.0, "slope_exponent": 0.0, "low": 0.0, "high": 10.0}
# parameters that are free, by effect; shapes come after amplitudes
FREE: Mapping[str, tuple[str, ...]] = {
    "ground_effect": ("c_a", "decay"),
    "ground_effect_forward_flight": ("c",),
    "partial_ground_effect": ("k",),
    "ground_effect_lag": ("c",),
    "ground_effect_moment": ("q",),
    "fountain_lift": ("c_b", "c_s"),
    "rotor_drag": ("k_kg", "lever"),
    "parasitic_drag": ("area_m2", "vertical_ratio", "coupling"),
    "axial_inflow": ("k_kg",),
    "translational_lift": ("c",),
    "wind": ("east_m_s", "north_m_s", "roughness_m"),
    "weak_rotor": rotor_columns("loss_{}", MAX_ROTORS),
    "coaxial_wake": ("c",),
    "cg_offset": ("x_m", "y_m"),
    "rotor_tilt": ("x_rad", "y_rad"),
    "rotor_inertia_reaction": ("inertia_kg_m2",),
    "slung_load": ("mass_kg", "length_m", "damping"),
    "tether": ("weight_N_m",),
    "battery_sag": ("sensitivity",),
    "motor_lag": ("up_s", "down_s"),
    "esc_delay": ("delay_s",),
    "thrust_curve": ("c",),
    "rotor_saturation": ("share",),
    "actuator_mapping": ("exponent",),
}
HANGING = {"below_m": 20.0}  # the concealed load hangs free, through the ground
FIXED: Mapping[str, dict[str, float]] = {"ground_effect": WIDE, "slung_load": HANGING}
START = {("wind", "roughness_m"): 0.03}
SHAPES = (
    "decay",
    "c_s",
    "lever",
    "vertical_ratio",
    "coupling",
    "length_m",
    "damping",
    "roughness_m",
)
DRIVES = ("motor_lag", "esc_delay")
"""What a diagnosis always leaves free of a drive, beside its top speed."""


@dataclasses.dataclass(frozen=True)
class Oracle:
    """Best fit of the true names in the library's forms.

    Attributes
    ----------
    parameters : by effect.
    reach : share of the effects' mean square that they explain, 0 to 1; NaN where unknown.
    """

    parameters: dict[str, dict[str, float]]
    reach: float


@dataclasses.dataclass(frozen=True)
class Witness:
    """What truly happened in a case, in the library's terms.

    Attributes
    ----------
    numbers : true numbers of the vehicle, by simulator parameter.
    terrain : of the case's map.
    flights : a flight's samples by name, (n, width): states and loads at 25 Hz, and at 125 Hz what
        begins with ``fast_``.
    weight_N : true weight.
    arm_m : mean distance of the hubs from the body's z axis.
    """

    numbers: dict[str, float]
    terrain: Terrain
    flights: tuple[dict[str, np.ndarray], ...]
    weight_N: float
    arm_m: float

    def loads(self, effects: effect_table.Effects) -> np.ndarray:
        """Return what effects add along all flights.

        Parameters
        ----------
        effects : parameters by effect.

        Returns
        -------
        (n, 6) forces over weight, moments over weight times arm, body frame.
        """
        parts = []
        for flight in self.flights:
            samples = effect_table.Samples.from_columns(_columns(flight))
            # the same states twice: what the effects leave alone drops out of the difference
            having, bare = (
                effect_table.replay(self.numbers, samples, e, self.terrain) for e in (effects, {})
            )
            parts.append(
                np.hstack(
                    [
                        having.force_N - bare.force_N,
                        (having.moment_Nm - bare.moment_Nm) / self.arm_m,
                    ]
                )
            )
        return np.concatenate(parts) / self.weight_N

    def true_loads(self) -> np.ndarray:
        """Return the true extra loads, (n, 6), in the units of :meth:`loads`."""
        parts = [
            np.hstack([f["extra_force"], f["extra_moment"] / self.arm_m]) for f in self.flights
        ]
        return np.concatenate(parts) / self.weight_N

    def speeds(self, effects: effect_table.Effects) -> np.ndarray:
        """Return the rotor speeds that the library's drive makes of the true commands.

        Parameters
        ----------
        effects : parameters by effect.

        Returns
        -------
        (n, n_rotors) over top speed, at 125 Hz.
        """
        from ges.diagnose.design.drives import commanded_speeds
        from ges.diagnose.prepare.align import Prepared
        from ges.diagnose.types.model import Model

        flights = [_fast(flight) for flight in self.flights]
        prepared = [Prepared(c["t_s"], c, np.ones(len(c["t_s"]), bool), {}, {}) for c in flights]
        return (
            np.concatenate(commanded_speeds(prepared, Model(self.numbers), effects))
            / self.numbers["max_rotor_speed_rad_s"]
        )

    def true_speeds(self) -> np.ndarray:
        """Return the true rotor speeds over top speed, (n, n_rotors), at 125 Hz."""
        return (
            np.concatenate([f["fast_rotor_speed"] for f in self.flights])
            / self.numbers["max_rotor_speed_rad_s"]
        )


def _columns(flight: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    n = len(flight["p"])
    groups = {
        "p": POSITION,
        "v": VELOCITY,
        "q": QUATERNION,
        "omega": BODY_RATE,
        "rotor_speed": rotor_speed(flight["rotor_speed"].shape[1]),
        "u": command(flight["u"].shape[1]),
    }
    columns = {c: flight[key][:, k] for key, names in groups.items() for k, c in enumerate(names)}
    columns |= {
        f"rotor_acceleration_{i + 1}_rad_s2": flight["rotor_acceleration"][:, i] for i in range(4)
    }
    return columns | {"t_s": np.arange(n) * STEP_S * TRUTH_STEP}


def _fast(flight: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    columns = {c: flight["fast_u"][:, k] for k, c in enumerate(command(flight["fast_u"].shape[1]))}
    columns["battery_V"] = flight["fast_battery"][:, 0] * flight["full_V"]
    return columns | {"t_s": np.arange(len(flight["fast_u"])) * STEP_S * FAST_STEP}


def witness(folder: Path, case: str, truth: Mapping) -> Witness | None:
    """Return the noise-free truth that the generator kept of a case.

    Parameters
    ----------
    folder : of the cases.
    case, truth : name of the case and its truth.

    Returns
    -------
    None for a case of which nothing was kept.
    """
    path = folder / "sealed" / f"{case}.npz"
    if not path.exists():
        return None
    vehicle, true = load_vehicle(folder / "cases" / case / "vehicle.yaml"), truth["true_values"]
    numbers = vehicle.parameters() | {
        "mass_kg": true["mass"],
        "thrust_coefficient_N_s2": true["thrust"],
        "torque_coefficient_Nm_s2": true["torque"],
        "max_rotor_speed_rad_s": true["speed"],
        "ixx_kg_m2": true["ixx"],
        "iyy_kg_m2": true["iyy"],
        "izz_kg_m2": true["izz"],
        "battery_nominal_V": NOMINAL * true["battery_V"],
    }
    # arrays are kept as FLIGHT/NAME, in single precision
    flights: dict[str, dict] = {}
    with np.load(path) as kept:
        for key in kept.files:
            flight, name = key.split("/")
            flights.setdefault(flight, {"full_V": true["battery_V"]})[name] = kept[key].astype(
                float
            )
    arm = float(np.mean(np.hypot(*(vehicle.rotor_arrays()[a] for a in ("x_m", "y_m")))))
    ground = vehicle.ground(folder / "cases" / case)
    return Witness(numbers, ground, tuple(flights.values()), true["weight_N"], arm)


def fit(seen: Witness, names: list[str]) -> Oracle:
    """Fit the true names that the library has to what truly happened.

    Wrenches are fitted to forces and moments, effects of the drive to rotor speeds.

    Parameters
    ----------
    seen : noise-free truth.
    names : true names; unknown ones are left out.

    Returns
    -------
    ``reach`` is the mean of both parts.
    """
    modelled = [n for n in names if n in FREE and n in effect_table.table()]
    driven = [
        n for n in modelled if effect_table.get(n).kind == "actuator" and n != "actuator_mapping"
    ]
    wrenches = [n for n in modelled if effect_table.get(n).kind in ("wrench", "wind")]
    # loads and rotor speeds have no common unit: each part is fitted to its own
    parameters: dict[str, dict[str, float]] = {}
    reach: list[float] = []
    if wrenches:
        best, share = _least_squares(wrenches, seen.loads, seen.true_loads())
        parameters, reach = parameters | best, [*reach, share]
    if driven and "fast_u" in seen.flights[0]:
        best, share = _fit_drive(driven, seen)
        parameters, reach = parameters | best, [*reach, share]
    return Oracle(parameters, float(np.mean(reach)) if reach else np.nan)


def _fit_drive(names: list[str], seen: Witness) -> tuple[dict[str, dict[str, float]], float]:
    """Fit effects of a drive beside its lags, its delay and the top speed.

    A diagnosis leaves these free as well. A vehicle file is wrong about them in every case, and no
    drive is of first order.
    """
    true = seen.true_speeds()

    def model(effects: effect_table.Effects) -> np.ndarray:
        speeds = seen.speeds(effects)
        # the top speed scales all speeds: its least-squares value is put in, not searched for
        # (variable projection)
        return speeds * ((true * speeds).sum() / (speeds**2).sum())

    return _least_squares(names, model, true, [n for n in DRIVES if n not in names])


def is_load(name: str) -> bool:
    """Return whether an effect is fitted by the forces and moments that it makes."""
    return name in FREE and effect_table.get(name).kind in ("wrench", "wind")


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square over all elements, as of (n, 6) loads."""
    return float(np.sqrt(np.mean(values**2)))


def _least_squares(
    names: list[str],
    model: Callable[[effect_table.Effects], np.ndarray],
    target: np.ndarray,
    given: Sequence[str] = (),
) -> tuple[dict[str, dict[str, float]], float]:
    """Return the best parameters of the names, and the share that they explain.

    The share is of what the effects ``given`` them leave.
    """
    from scipy.optimize import least_squares

    table = {n: {p.name: p for p in effect_table.get(n).parameters} for n in (*names, *given)}
    # what is beside the names is fitted with them, or its errors would go into their numbers
    free = [(n, p) for n in table for p in FREE[n]]
    typical = np.array([_typical(table[n][p]) for n, p in free])
    low, high = (np.array([getattr(table[n][p], end) for n, p in free]) for end in ("low", "high"))
    start = np.clip(
        [START.get((n, p), table[n][p].default) for n, p in free], low + 1e-9, high - 1e-9
    )

    def effects(x: np.ndarray) -> dict[str, dict[str, float]]:
        own = {n: {**effect_table.get(n).neutral(), **FIXED.get(n, {})} for n in table}
        for (n, p), value in zip(free, x, strict=True):
            own[n][p] = float(value)
        return own

    limits: dict[str, Any] = {
        "bounds": (low, high),
        "x_scale": typical,
        "diff_step": 1e-3,
        "max_nfev": 40,
    }
    out = least_squares(lambda x: (target - model(effects(x))).ravel(), start, **limits)
    best = effects(out.x)
    # reach = 1 - |target - model|^2 / |target - model of the rest|^2
    none = target - model({n: best[n] for n in given})
    share = 1.0 - (out.fun**2).sum() / max((none**2).sum(), 1e-30)
    return {n: {p: best[n][p] for p in (*FREE[n], *FIXED.get(n, {}))} for n in names}, float(share)


def _typical(parameter: effect_table.Parameter) -> float:
    return abs(parameter.default) or 0.1 * (parameter.high - parameter.low)


def nominal_values(truth: Mapping, vehicle: Vehicle) -> dict[str, dict[str, float]]:
    """Return the parameters that follow from the truth without a fit.

    These are errors of the vehicle file and sensor faults.

    Parameters
    ----------
    truth : of the case.
    vehicle : its vehicle file.

    Returns
    -------
    Parameters by name, for the names that the truth holds.

    Raises
    ------
    GesError
        When the file has no torque coefficient.
    """
    true = truth["true_values"]
    concealed = {k: v for one in truth["concealed"].values() for k, v in one.items()}
    # flights show thrust over mass alone: one scale holds the errors of both
    lift = (
        true["thrust"]
        / true["mass"]
        * vehicle.mass_kg.value
        / vehicle.thrust_coefficient_N_s2.value
    )
    inertia = {a: true[f"i{a}"] / getattr(vehicle.inertia_kg_m2, a) for a in ("xx", "yy", "zz")}
    nominal = vehicle.torque_coefficient_Nm_s2
    if nominal is None:
        raise GesError("the case's vehicle file has no torque coefficient; make the case anew")
    torque = true["torque"] / nominal.value
    parameters = {
        "payload": {
            "mass_kg": true["mass"] * concealed.get("payload_share", 0.0),
            **{f"{a}_m": concealed.get(f"payload_{a}_m", 0.0) for a in "xy"},
        },
        "thrust_scale": {"scale": lift * concealed.get("thrust_error", 1.0) - 1.0},
        "inertia": {a: v * concealed.get("inertia_error", 1.0) - 1.0 for a, v in inertia.items()},
        "torque_coefficient": {"scale": torque * concealed.get("torque_error", 1.0) - 1.0},
        "actuator_mapping": {"exponent": concealed.get("mapping", 0.0)},
        "rangefinder_bias": {"bias_m": concealed.get("range_bias_m", 0.0)},
        "rangefinder_lag": {"tau_s": concealed.get("range_lag_s", 0.0)},
        "accelerometer_bias": {
            f"{a}_m_s2": concealed.get(f"acc_bias_{a}_m_s2", 0.0) for a in "xyz"
        },
        "gyro_bias": {f"{a}_rad_s": concealed.get(f"gyro_bias_{a}_rad_s", 0.0) for a in "xyz"},
        "attitude_bias": {f"{a}_rad": concealed.get(f"att_bias_{a}_rad", 0.0) for a in "xy"},
    }
    return {f["name"]: parameters[f["name"]] for f in truth["findings"] if f["name"] in parameters}
