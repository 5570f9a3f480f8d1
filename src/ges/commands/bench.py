"""``ges bench``: how fast the simulator and the diagnosis are, measured in one run."""

from __future__ import annotations

import json
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from ges.commands import PATH
from ges.errors import UsageError
from ges.simulator import effects, manoeuvres
from ges.simulator import flight as sim
from ges.simulator.terrain import Terrain
from ges.threads import cores

if TYPE_CHECKING:
    import pandas as pd

    from ges.vehicle.file import Vehicle

STUDY_EFFECTS = {"ground_effect": {"curvature_gain_m": 0.6}}
QUAD = {
    "name": "quad",
    "mass_kg": {"value": 1.0, "sd": 0.02},
    "inertia_kg_m2": {"xx": 0.01, "yy": 0.01, "zz": 0.018, "sd_rel": 0.1},
    "rotors": [
        {"x_m": 0.12 * x, "y_m": 0.12 * y, "radius_m": 0.1, "spin": spin}
        for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
    ],
    "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.03},
    "torque_coefficient_Nm_s2": {"value": 1e-7, "sd_rel": 0.1},
    "max_rotor_speed_rad_s": {"value": 1000, "sd_rel": 0.01},
    "motor_time_constant_s": {"value": 0.023, "sd_rel": 0.12},
}
PLANTED = {"rotor_drag": {"k_kg": 1e-4}}
PLANS = ("height_staircase", "straight_runs", "climbs", "hover", "yaw_turn")
HELD_OUT = ("flight5",)
READ = {
    **{f"gyro_{a}_rad_s": f"omega_{a}_rad_s" for a in "xyz"},
    **{f"attitude_{a}": f"q_{a}" for a in "wxyz"},
}
LOGGED = (
    "t_s",
    *(f"p_{a}_m" for a in "xyz"),
    *(f"v_{a}_m_s" for a in "xyz"),
    *(f"acc_{a}_m_s2" for a in "xyz"),
    "range_m",
    "battery_V",
    *(f"rotor_speed_{i}_rad_s" for i in range(1, 5)),
    *(f"u_{i}" for i in range(1, 5)),
    *manoeuvres.COLUMNS[:6],
    "yaw_ref_rad",
    *READ,
)
NOISE = {"v_": 0.02, "q_": 0.001}  # of an estimator: m/s and 1


def _seconds(work: Callable[[], object], repeats: int) -> list[float]:
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
    return {
        "case": title,
        "flights": len(flights),
        "lanes": lanes,
        "steps": int(steps),
        # the fastest run: what else the machine does can only add to it
        "steps_per_s": steps / min(times),
        "steps_per_s_median": steps / statistics.median(times),
    }


def _cases(duration: float, repeats: int) -> list[dict]:
    ground, flat = Terrain.procedural(), Terrain.flat()
    full = _flights(64, STUDY_EFFECTS, ground, duration_s=duration)
    flight = _flights(1, STUDY_EFFECTS, ground, duration_s=4 * duration)
    cheap = {"agl_ref_m": 2.0, "duration_s": duration}
    quiet = {
        **cheap,
        "gyro_noise_rad_s": 0,
        "range_noise_m": 0,
        "rpm_noise_rad_s": 0,
        "current_noise_A": 0,
        "acc_noise_m_s2": 0,
    }
    return [
        # each case does without one thing more, which tells what that thing costs
        _case("one flight, full physics", flight, 1, repeats),
        _case("lanes, full physics", full, 0, repeats),
        _case("lanes, without the ground effect", _flights(64, {}, ground, **cheap), 0, repeats),
        _case(
            "lanes, flat ground, without the ground effect",
            _flights(64, {}, flat, **cheap),
            0,
            repeats,
        ),
        _case("lanes, the same without sensor noise", _flights(64, {}, flat, **quiet), 0, repeats),
        _case(
            "lanes, the same with the firmware at 10 Hz",
            _flights(64, {}, flat, **quiet, control_every=100),
            0,
            repeats,
        ),
        _case(
            "cheap kernel, one flight: rigid body and rotors alone",
            _flights(1, {}, flat, **{**quiet, "duration_s": 4 * duration}, control_every=100),
            1,
            repeats,
        ),
    ]


def _replay_case(repeats: int) -> dict:
    record = sim.fly([sim.Flight({"duration_s": 100}, STUDY_EFFECTS, Terrain.procedural(1))])[0]
    # every sample a hundred times: long enough for the clock
    samples = effects.Samples.from_columns(
        {name: values.repeat(100) for name, values in record.columns.items()}
    )
    times = _seconds(
        lambda: effects.replay({}, samples, STUDY_EFFECTS, Terrain.procedural(1)), repeats
    )
    return {
        "case": "recorded samples through the ground effect",
        "samples": len(samples),
        "samples_per_s": len(samples) / min(times),
    }


def _manoeuvre(vehicle: Vehicle, plan: str, duration: float, seed: int) -> sim.Flight:
    numbers: dict[str, float | str] = {
        **vehicle.parameters(),
        "seed": seed,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": manoeuvres.STEP_S,
        "duration_s": duration,
    }
    return sim.Flight(numbers, PLANTED, Terrain.flat(), manoeuvres.make(plan, duration))


def _logged(record: sim.Record, seed: int) -> pd.DataFrame:
    """Give a flight's table, its velocity and attitude as noisy as an estimator's."""
    import pandas as pd

    rng = np.random.default_rng(seed)
    columns = {READ.get(name, name): values for name, values in record.columns.items()}
    return pd.DataFrame(
        {n: v + rng.normal(0.0, NOISE.get(n[:2], 0.0), len(v)) for n, v in columns.items()}
    )


def _diagnosis_case(duration: float, repeats: int) -> dict:
    """Time five flights with rotor drag: simulating them, diagnosing them, writing the report."""
    from ges.diagnose.pipeline import diagnose
    from ges.diagnose.report.output import write_diagnosis
    from ges.vehicle.file import parse_vehicle

    vehicle = parse_vehicle(QUAD)
    flights = [_manoeuvre(vehicle, plan, duration, seed) for seed, plan in enumerate(PLANS, 1)]
    frames = [_logged(record, seed) for seed, record in enumerate(sim.fly(flights, LOGGED), 1)]
    # once before the clock runs: what is read at first use does not count
    diagnosis = diagnose(frames, vehicle, holdout=HELD_OUT)
    simulated = min(_seconds(lambda: sim.fly(flights, LOGGED), repeats))
    diagnosed = min(_seconds(lambda: diagnose(frames, vehicle, holdout=HELD_OUT), repeats))
    with tempfile.TemporaryDirectory() as out:
        written = min(_seconds(lambda: write_diagnosis(diagnosis, Path(out)), repeats))
    return {
        "case": "five flights with rotor drag",
        "flown_s": len(PLANS) * duration,
        "cores": cores(),
        "found": [f.name for f in diagnosis.findings],
        "simulation_s": simulated,
        "diagnosis_s": diagnosed,
        "report_s": written,
        "times_simulation": diagnosed / simulated,
    }


def _bench_sim(duration: float, repeats: int) -> list[dict]:
    cases = _cases(duration, repeats)
    # the cheap kernel of the same run: a ratio hangs less on the machine than a speed
    scale = cases[-1]["steps_per_s"]
    for case in cases:
        click.echo(
            f"{case['steps_per_s'] / 1e6:8.2f} million steps/s  {case['steps_per_s'] / scale:6.2f}"
            f" x cheap kernel  {case['case']}"
        )
    replay = _replay_case(repeats)
    click.echo(
        f"{replay['samples_per_s'] / 1e6:8.2f} million samples/s                    "
        f" {replay['case']}"
    )
    return [*cases, replay]


def _bench_diagnosis(duration: float, repeats: int) -> list[dict]:
    case = _diagnosis_case(duration, repeats)
    of = f"{case['case']}, {duration:g} s each, {case['cores']} cores"
    click.echo(
        f"{case['diagnosis_s']:8.2f} s diagnosis  {case['times_simulation']:6.1f} x simulating the"
        f" same flights  {of}"
    )
    click.echo(f"{case['report_s']:8.2f} s report")
    return [case]


def _bench_peers(repeats: int) -> list[dict]:
    """Time other people's simulators beside ours on one vehicle, those that are installed."""
    from ges.blind.foreign.peers import PEERS, lift_of

    lift = lift_of()
    cases: list[dict] = []
    for peer in PEERS:
        if why := peer.missing():
            click.echo(f"{peer.name} is left out: {why}", err=True)
            continue
        speed = peer.steps_per_s(lift, repeats)
        # ours comes first
        ours = cases[0]["steps_per_s"] if cases else speed
        case = {"case": peer.name, "abreast": peer.abreast, "steps_per_s": speed}
        cases.append({**case, "over_ours": speed / ours})
        click.echo(
            f"{speed / 1e6:8.3f} million steps/s  {speed / ours:9.5f} x one flight of ours "
            f" {peer.abreast:3d} abreast  {peer.name}"
        )
    return cases


BENCHES = {"sim": _bench_sim, "diagnosis": _bench_diagnosis}


@click.command()
@click.argument("what", type=click.Choice(list(BENCHES)))
@click.option(
    "--duration", default=30.0, show_default=True, help="Simulated seconds of each flight."
)
@click.option(
    "--repeats", default=5, show_default=True, help="Runs of each case; the fastest counts."
)
@click.option(
    "--peers",
    is_flag=True,
    help="sim: other people's simulators beside ours on one vehicle (extra 'simulators').",
)
@click.option("--out", type=PATH, help="Write the figures here as JSON.")
def command(what: str, duration: float, repeats: int, peers: bool, out: Path | None) -> None:
    """Measure how fast the simulator or the diagnosis is.

    sim: steps per second and core, for one flight and for lanes, beside cheaper kernels for scale.
    diagnosis: seconds of diagnosing five flights, as many times those of simulating them, and of
    writing the report.

    Example: ges bench sim --out bench.json

    Example: ges bench sim --peers

    Example: ges bench diagnosis --duration 60 --repeats 1
    """
    if peers and what != "sim":
        raise UsageError("--peers compares simulators; it goes with 'ges bench sim'")
    cases = _bench_peers(repeats) if peers else BENCHES[what](duration, repeats)
    if out:
        machine = {
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "python": sys.version.split()[0],
        }
        out.with_suffix(".new").write_text(
            json.dumps({"machine": machine, "cases": cases}, indent=1) + "\n"
        )
        out.with_suffix(".new").replace(out)
