"""Measure how time and memory of a diagnosis grow with what it is given.

    python examples/scaling.py length flights rate effects cores --out scaling

Every row flies a vehicle of the shipped example and diagnoses it in a process of its own, with one
thread but for the rows of cores. Time is the processor's, of the user and the system together. The
exponent is the slope of log time over log size in the upper half of the rows, where start-up counts
little, with its 95 % interval.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from scipy.stats import t as student

GES = (sys.executable, "-c", "from ges.cli import main; main()")
PLANS = ("height_staircase", "straight_runs", "height_staircase")
EFFECTS: Mapping[str, Mapping[str, float]] = {
    "rotor_drag": {"k_kg": 1e-4},
    "ground_effect": {"amplitude": 1.0},
    "axial_inflow": {"k_kg": 1e-4},
    "payload": {"mass_kg": 0.1},
}
STEP_S, FIRMWARE_S = 0.001, 0.004


class Row(NamedTuple):
    """One diagnosis: flights of so many seconds at a rate, with the first effects, on cores."""

    flights: int = 3
    seconds: float = 30.0
    hz: float = 100.0
    effects: int = 2
    cores: int = 1


AXES: Mapping[str, tuple[str, tuple[Row, ...]]] = {
    "length": (
        "s of log in 3 flights",
        tuple(Row(seconds=s) for s in (10.0, 30.0, 100.0, 200.0, 400.0, 1200.0)),
    ),
    "flights": ("flights of 30 s", tuple(Row(flights=n) for n in (2, 5, 10, 20, 50))),
    "rate": (
        "Hz, 3 flights of 30 s",
        tuple(Row(hz=hz) for hz in (50.0, 100.0, 250.0, 500.0, 1000.0, 2000.0, 8000.0)),
    ),
    "effects": ("effects that act", tuple(Row(effects=n) for n in range(len(EFFECTS) + 1))),
    "cores": ("cores, 3 flights of 200 s", tuple(Row(seconds=200.0, cores=n) for n in (1, 2))),
}
"""What the size is, and the rows, by axis."""


def size_of(axis: str, row: Row) -> float:
    """Return what grows along an axis."""
    of = {"length": row.flights * row.seconds, "flights": row.flights, "rate": row.hz}
    return float(of.get(axis, row.effects if axis == "effects" else row.cores))


def fly(row: Row, vehicle: Mapping, folder: Path) -> None:
    """Write a recording set: flights and a vehicle file that knows no effects."""
    folder.mkdir(parents=True, exist_ok=True)
    known = {name: value for name, value in vehicle.items() if name != "effects"}
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(known))
    acting = dict(list(EFFECTS.items())[: row.effects])
    flown = folder.with_suffix(".yaml")
    flown.write_text(yaml.safe_dump({**known, "effects": acting}))
    # whole steps of the integration between two rows, and of the firmware between two runs
    step_s = min(STEP_S, 1.0 / row.hz)
    every = max(1, round(1.0 / (row.hz * step_s)))
    numbers = {
        "dt_s": step_s,
        "record_every": every,
        "telemetry_every": every,
        "control_every": max(1, round(FIRMWARE_S / step_s)),
    }
    for i in range(row.flights):
        ges(
            "simulate",
            flown,
            *("--plan", PLANS[i % len(PLANS)], "--duration", row.seconds, "--seed", i + 1),
            *(word for name, n in numbers.items() for word in ("--set", f"{name}={n!r}")),
            *("--out", folder / f"flight_{i + 1:02d}.parquet"),
        )


def ges(*words: object) -> None:
    """Run the command line."""
    done = subprocess.run([*GES, *map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)


def measure(folder: Path, cores: int) -> tuple[float, float, float]:
    """Diagnose a set; return time of the processor (s), time (s) and peak memory (GiB)."""
    words = [*GES, "diagnose", str(folder), "--out", f"{folder}_report", "--no-page"]
    begin = time.monotonic()
    process = subprocess.Popen(
        words,
        env={**os.environ, "OMP_NUM_THREADS": str(cores)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    # of this process alone, as the resources of all children would keep the peak of earlier rows
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"ges diagnose {folder} failed; run it by hand to see why")
    return used.ru_utime + used.ru_stime, time.monotonic() - begin, used.ru_maxrss / 2**20


def exponent(size: np.ndarray, cost: np.ndarray) -> str:
    """Return slope of log cost over log size in the upper half, with its 95 % interval."""
    kept = slice(len(size) // 2, None)
    x, y = np.log(size[kept]), np.log(cost[kept])
    if len(x) < 3 or np.ptp(x) == 0.0:
        return ""
    x = x - x.mean()
    slope = float(x @ y / (x @ x))
    left = y - y.mean() - slope * x
    sd = float(np.sqrt(left @ left / (len(x) - 2) / (x @ x)))
    return f"{slope:.2f} +- {student.ppf(0.975, len(x) - 2) * sd:.2f}"


def main() -> None:
    """Measure the axes that are named, and print a table of each."""
    parser = argparse.ArgumentParser(description="Measure how a diagnosis grows.")
    parser.add_argument("axes", nargs="+", choices=AXES)
    parser.add_argument("--out", type=Path, default=Path("scaling"), help="folder for the flights")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    ges("recordings", "fetch", "example", "--out", options.out)
    vehicle = yaml.safe_load((options.out / "example" / "vehicle.yaml").read_text())
    for axis in options.axes:
        title, rows = AXES[axis]
        print(f"\n| {title} | processor time | time | memory |\n| --- | --- | --- | --- |")
        measured = []
        for k, row in enumerate(rows):
            folder = options.out / f"{axis}_{k}"
            fly(row, vehicle, folder)
            measured.append(measure(folder, row.cores))
            cpu_s, wall_s, gib = measured[-1]
            size = size_of(axis, row)
            print(f"| {size:g} | {cpu_s:.1f} s | {wall_s:.1f} s | {gib:.2f} GiB |", flush=True)
        if axis in ("length", "flights", "rate"):
            size = np.array([size_of(axis, row) for row in rows])
            cpu, _, gib = np.array(measured).T
            print(f"\nexponent of time {exponent(size, cpu)}, of memory {exponent(size, gib)}")


if __name__ == "__main__":
    main()
