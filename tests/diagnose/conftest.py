"""A small simulated quadrotor and its recorded flights, shared by the tests of the diagnosis."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ges.conventions import BODY_RATE, POSITION, QUATERNION, REFERENCE, VELOCITY, rotor_speed
from ges.simulator import flight as sim
from ges.simulator import manoeuvres
from ges.vehicle.file import Vehicle, parse_vehicle

# a diagnosis that the tests of that room write
sys.path.append(str(Path(__file__).parents[1] / "report"))

ARM_M = 0.12
SHEET = {
    "name": "quad",
    "mass_kg": {"value": 1.0, "sd": 0.02},
    "inertia_kg_m2": {"xx": 0.01, "yy": 0.01, "zz": 0.018, "sd_rel": 0.1},
    "rotors": [
        {"x_m": ARM_M * x, "y_m": ARM_M * y, "radius_m": 0.1, "spin": spin}
        for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
    ],
    "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.03},
    "torque_coefficient_Nm_s2": {"value": 1e-7, "sd_rel": 0.1},
    "max_rotor_speed_rad_s": 1000,
}
POSE = ("t_s", *POSITION, *VELOCITY)
SPEEDS = rotor_speed(4)
GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
ATTITUDE = ("attitude_w", "attitude_x", "attitude_y", "attitude_z")
READINGS = dict(zip((*GYRO, *ATTITUDE), (*BODY_RATE, *QUATERNION), strict=True))
NOISE = {"v_x": 0.02, "v_y": 0.02, "v_z": 0.02, "gyr": 0.02, "att": 0.001}


@pytest.fixture(scope="session")
def sheet() -> Callable[..., Vehicle]:
    """The vehicle with keys changed, or left out where None is given."""
    return lambda **changes: parse_vehicle(
        {k: v for k, v in {**SHEET, **changes}.items() if v is not None}
    )


def fly(
    vehicle: Vehicle, effects: dict, table: np.ndarray, seed: int, extra: tuple[str, ...] = ()
) -> pd.DataFrame:
    """Fly a manoeuvre, on the vehicle's own effects and ground, and record it with the noise of a
    decent estimator.
    """
    numbers = {
        **vehicle.parameters(),
        "seed": seed,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": manoeuvres.STEP_S,
        "duration_s": (len(table) - 1) * manoeuvres.STEP_S,
    }
    flight = sim.Flight(numbers, {**vehicle.effect_values(), **effects}, vehicle.ground(), table)
    (record,) = sim.fly([flight], (*POSE, *ATTITUDE, *SPEEDS, *extra))
    assert record.status == "ok", record.status
    rng = np.random.default_rng(seed)
    noisy = {
        name: values + rng.normal(0.0, NOISE.get(name[:3], 0.0), len(values))
        for name, values in record.columns.items()
    }
    return pd.DataFrame(noisy).rename(columns=READINGS)


@pytest.fixture(scope="session")
def flown() -> Callable[..., pd.DataFrame]:
    """:func:`fly`: vehicle, effects, manoeuvre table, seed, extra columns."""
    return fly


def on_the_ground_first(frame: pd.DataFrame, push: np.ndarray) -> pd.DataFrame:
    """The flight with its first four seconds on the ground, and all that is logged of the drive
    times ``push`` (n,).
    """
    t = frame["t_s"].to_numpy()
    heights = np.where(t < 4.0, 0.0, 1.5) + 1e-3 * np.sin(40.0 * t)
    return frame.assign(
        p_z_m=heights, **{c: push * frame[c] for c in frame if c.startswith(("u_", "rotor_speed_"))}
    )


@pytest.fixture(scope="session")
def held_down() -> Callable[..., pd.DataFrame]:
    """:func:`on_the_ground_first`: flight, push by sample."""
    return on_the_ground_first


@pytest.fixture(scope="session")
def with_rates() -> tuple[str, ...]:
    """Extra columns: gyro and references."""
    return (*GYRO, *REFERENCE)
