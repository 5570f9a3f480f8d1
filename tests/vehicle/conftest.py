"""A flight of this package's simulator, logged as an autopilot would."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest

from ges.conventions import command, rotor_speed
from ges.simulator import flight as sim
from ges.simulator import manoeuvres
from ges.vehicle.file import Vehicle
from ges.vehicle.load import load_vehicle

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

CURVE = 0.4


@dataclasses.dataclass
class Stream:
    """Where a stream comes from."""

    source: str = ""


@dataclasses.dataclass
class Log:
    """What a reader gives, as far as a vehicle is made of it."""

    table: pd.DataFrame
    format: str = "px4"
    autopilot: str = "PX4 1.15.0"
    name: str = "flight"
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    command: str = "actuator_outputs"

    @property
    def streams(self) -> dict[str, Stream]:
        return {"command": Stream(self.command)} if COMMAND[0] in self.table else {}

    def frame(self) -> pd.DataFrame:
        return self.table


def fly(vehicle: Vehicle, plan: str, seconds: float) -> pd.DataFrame:
    """A closed-loop flight at 100 Hz, standing on the ground for its first five seconds."""
    table = manoeuvres.make(plan, seconds)
    fixed = {
        "seed": 3,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": manoeuvres.STEP_S,
        "duration_s": (len(table) - 1) * manoeuvres.STEP_S,
        "fw_thrust_curve": CURVE,
    }
    record = sim.fly(
        [
            sim.Flight(
                {**vehicle.parameters(), **fixed},
                vehicle.effect_values(),
                vehicle.ground(),
                table,
            )
        ]
    )[0]
    assert record.status == "ok"
    frame = pd.DataFrame(record.columns)
    for axis in "xyz":
        frame[f"omega_{axis}_rad_s"] = frame[f"gyro_{axis}_rad_s"]
    return standing(frame)


def standing(frame: pd.DataFrame) -> pd.DataFrame:
    """Five seconds on the ground with idling rotors before the flight."""
    step_s = float(np.median(np.diff(frame["t_s"])))
    rows = int(5.0 / step_s)
    still = pd.concat([frame.iloc[[0]]] * rows, ignore_index=True)
    still["t_s"] = frame["t_s"].iloc[0] - step_s * np.arange(rows, 0, -1)
    moving = [c for c in frame if c.startswith(("v_", "omega_", "acc_"))]
    still[moving] = 0.0
    still["acc_z_m_s2"] = 9.80665
    still[list(COMMAND)] = 0.08
    still[list(ROTOR_SPEED)] *= 0.2
    return pd.concat([still, frame], ignore_index=True)


@pytest.fixture(scope="session")
def flown_vehicle() -> Vehicle:
    """A 1.5 kg quadrotor with a bent thrust curve and a lag, whose numbers the tests look for."""
    appius = load_vehicle("appius")
    return Vehicle.model_validate(
        {
            "name": "truth",
            "mass_kg": 1.5,
            "inertia_kg_m2": {"xx": 0.02, "yy": 0.02, "zz": 0.035},
            "rotors": [
                {"x_m": r.x_m.value, "y_m": r.y_m.value, "radius_m": 0.12, "spin": r.spin}
                for r in appius.rotors
            ],
            "thrust_coefficient_N_s2": 1.038e-5,
            "torque_coefficient_Nm_s2": 2.2e-7,
            "motor_time_constant_s": 0.045,
            "max_rotor_speed_rad_s": 1000.0,
            "effects": {"thrust_curve": {"c": CURVE}},
        }
    )


@pytest.fixture(scope="session")
def flight(flown_vehicle) -> pd.DataFrame:
    """Forty seconds of it far from the ground."""
    frame = fly(flown_vehicle, "straight_runs", 40.0)
    frame["p_z_m"] += 20.0
    return frame
