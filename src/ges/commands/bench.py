"""``ges bench``: how fast the simulator is, measured in one run."""

from __future__ import annotations

import json
import os
import platform
import statistics
import sys
import time
from pathlib import Path

import click

from .. import effects, sim
from ..terrain import Terrain

STUDY_EFFECTS = {"ground_effect": {"curvature_gain_m": 0.6}}


def _seconds(work, repeats: int) -> list[float]:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return times


def _flights(n: int, on: dict, terrain: Terrain, **numbers: float) -> list[sim.Flight]:
    return [sim.Flight({"seed": i + 1, **numbers}, on, terrain) for i in range(n)]


def _case(title: str, flights: list[sim.Flight], lanes: int, repeats: int) -> dict:
    numbers = flights[0].numbers()
    steps = len(flights) * numbers["duration_s"] / numbers.get("dt_s", 0.001)
    times = _seconds(lambda: sim.fly(flights, ["t_s", "p_z_m"], lanes), repeats)
    return {"case": title, "flights": len(flights), "lanes": lanes, "steps": int(steps),
            "steps_per_s": steps / min(times), "steps_per_s_median": steps / statistics.median(times)}  # fmt: skip


def _cases(duration: float, repeats: int) -> list[dict]:
    ground, flat = Terrain.procedural(), Terrain.flat()
    full = _flights(64, STUDY_EFFECTS, ground, duration_s=duration)
    flight = _flights(1, STUDY_EFFECTS, ground, duration_s=4 * duration)
    cheap = {"agl_ref_m": 2.0, "duration_s": duration}
    quiet = {**cheap, "gyro_noise_rad_s": 0, "range_noise_m": 0, "rpm_noise_rad_s": 0, "current_noise_A": 0, "acc_noise_m_s2": 0}
    return [
        _case("one flight, full physics", flight, 1, repeats),
        _case("lanes, full physics", full, 0, repeats),
        _case("lanes, without the ground effect", _flights(64, {}, ground, **cheap), 0, repeats),
        _case("lanes, flat ground, without the ground effect", _flights(64, {}, flat, **cheap), 0, repeats),
        _case("lanes, the same without sensor noise", _flights(64, {}, flat, **quiet), 0, repeats),
        _case("lanes, the same with the firmware at 10 Hz", _flights(64, {}, flat, **quiet, control_every=100), 0, repeats),
        _case("cheap kernel, one flight: rigid body and rotors alone",
              _flights(1, {}, flat, **{**quiet, "duration_s": 4 * duration}, control_every=100), 1, repeats),
    ]  # fmt: skip


def _replay_case(repeats: int) -> dict:
    record = sim.fly([sim.Flight({"duration_s": 100}, STUDY_EFFECTS, Terrain.procedural(1))])[0]
    samples = effects.Samples.from_columns({name: values.repeat(100) for name, values in record.columns.items()})
    times = _seconds(lambda: effects.replay({}, samples, STUDY_EFFECTS, Terrain.procedural(1)), repeats)
    return {
        "case": "recorded samples through the ground effect",
        "samples": len(samples),
        "samples_per_s": len(samples) / min(times),
    }


@click.command()
@click.argument("what", type=click.Choice(["sim"]))
@click.option("--duration", default=30.0, show_default=True, help="Simulated seconds of each flight.")
@click.option("--repeats", default=5, show_default=True, help="Runs of each case; the fastest counts.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the figures here as JSON.")
def command(what: str, duration: float, repeats: int, out: Path | None) -> None:
    """Steps per second and core, for one flight and for lanes, beside cheaper kernels for scale.

    Example: ges bench sim --out bench.json
    """
    cases = _cases(duration, repeats)
    scale = cases[-1]["steps_per_s"]
    for case in cases:
        click.echo(
            f"{case['steps_per_s'] / 1e6:8.2f} million steps/s  {case['steps_per_s'] / scale:6.2f} x cheap kernel  {case['case']}"
        )
    replay = _replay_case(repeats)
    click.echo(f"{replay['samples_per_s'] / 1e6:8.2f} million samples/s                     {replay['case']}")
    if out:
        machine = {"processor": platform.machine(), "cores": os.cpu_count(), "python": sys.version.split()[0]}
        out.with_suffix(".new").write_text(json.dumps({"machine": machine, "cases": [*cases, replay]}, indent=1) + "\n")
        out.with_suffix(".new").replace(out)
