"""Simulate the recording set that the package ships: ``make example``.

A quadrotor of 1.2 kg flies between 0.15 and 1.5 m above flat ground. Its simulator, the vehicle
file, knows neither the ground effect nor rotor drag, and its mass is 3 % too low.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from ges.recordings.recording import write_flight
from ges.simulator import flight, manoeuvres
from ges.simulator.terrain import Terrain
from ges.vehicle.load import load_vehicle

FOLDER = Path(__file__).resolve().parents[1] / "src" / "ges" / "recordings" / "example"
TRUTH = {"ground_effect": {}, "rotor_drag": {"k_kg": 6e-5}}
TRUE_MASS = 1.03  # times that of the vehicle file
PLANS = {
    "stairs_slow": ("height_staircase", 32.0),
    "stairs_fast": ("height_staircase", 24.0),
    "runs_fast": ("straight_runs", 20.0),
    "runs_slow": ("straight_runs", 24.0),
}
RATE_HZ = 50
# Name in the log: name in the simulator, standard deviation of an estimator's noise, resolution.
LOGGED = {
    "t_s": ("t_s", 0.0, 0.0),
    **{f"p_{a}_m": (f"p_{a}_m", 0.002, 2.0**-10) for a in "xyz"},
    **{f"v_{a}_m_s": (f"v_{a}_m_s", 0.01, 2.0**-9) for a in "xyz"},
    **{f"q_{a}": (f"attitude_{a}", 0.0007, 2.0**-13) for a in "wxyz"},
    **{f"omega_{a}_rad_s": (f"gyro_{a}_rad_s", 0.0, 2.0**-10) for a in "xyz"},
    **{f"acc_{a}_m_s2": (f"acc_{a}_m_s2", 0.0, 2.0**-8) for a in "xyz"},
    **{f"rotor_speed_{i}_rad_s": (f"rpm_{i}_rad_s", 0.0, 2.0**-1) for i in range(1, 5)},
    **{f"u_{i}": (f"u_{i}", 0.0, 2.0**-11) for i in range(1, 5)},
    "range_m": ("range_m", 0.0, 2.0**-8),
    **{f"p_ref_{a}_m": (f"p_ref_{a}_m", 0.0, 2.0**-13) for a in "xyz"},
}


def fly() -> dict[str, pd.DataFrame]:
    """The flights by name, as they are logged."""
    vehicle = load_vehicle(FOLDER / "vehicle.yaml")
    numbers = vehicle.parameters()
    numbers["mass_kg"] *= TRUE_MASS
    flights = []
    for seed, (plan, duration_s) in enumerate(PLANS.values(), 1):
        table = manoeuvres.make(plan, duration_s)
        own = {
            "seed": seed,
            "altitude_source": 1,
            "mode": "none",
            "duration_s": duration_s,
            "inputs_dt_s": manoeuvres.STEP_S,
            "record_every": 1000 // RATE_HZ,
        }
        flights.append(flight.Flight({**numbers, **own}, TRUTH, Terrain.flat(), table))
    records = flight.fly(flights)
    return {
        name: _logged(record, seed)
        for seed, (name, record) in enumerate(zip(PLANS, records, strict=True), 1)
    }


def _logged(record: flight.Record, seed: int) -> pd.DataFrame:
    rng, columns = np.random.default_rng(seed), {}
    for name, (source, noise, step) in LOGGED.items():
        values = record[source]
        if noise:
            values = values + rng.normal(0.0, noise, len(values))
        columns[name] = np.round(values / step) * step if step else values
    return pd.DataFrame(columns)


if __name__ == "__main__":
    for name, frame in fly().items():
        path = FOLDER / f"{name}.parquet"
        write_flight(path, frame)
        pq.write_table(pq.read_table(path), path, compression="zstd", compression_level=19)
