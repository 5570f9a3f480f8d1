"""``ges simulate``: fly a vehicle file as it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from ges.commands import PATH
from ges.errors import GesError, UsageError

if TYPE_CHECKING:
    from ges.simulator import flight as sim
    from ges.vehicle.file import Vehicle

# a recording has the gyro's rates, not the true ones
READINGS = {f"gyro_{a}_rad_s": f"omega_{a}_rad_s" for a in "xyz"}
KEPT = (
    "t_s",
    "p_",
    "v_",
    "q_",
    "omega_",
    "acc_",
    "rotor_speed_",
    "u_",
    "battery_V",
    "range_m",
    "ground_z_m",
    "yaw_ref_rad",
    "motor_current_",
    "contact",
    "agl_m",
    "ge_factor",
)
# for which the first set point is held before the record begins: integral terms settle
TRIM_S = 5.0


def _missing(vehicle: Vehicle) -> tuple[dict[str, float], list[str]]:
    """Estimates for what the file leaves out, each named."""
    from ges.vehicle import scaling

    rotors = vehicle.rotor_arrays()
    values: dict[str, float] = {}
    notes: list[str] = []
    if vehicle.inertia_kg_m2 is None:
        arm_m = scaling.arm_m(rotors["x_m"], rotors["y_m"])
        inertia = scaling.inertia(vehicle.mass_kg.value, arm_m)
        # a scaling law of published frames: a share of mass times squared arm
        values |= {f"i{axis}_kg_m2": getattr(inertia, axis) for axis in ("xx", "yy", "zz")}
        notes.append(
            f"inertia is not in the file; taken as {scaling.ABOUT_X_Y:g}, {scaling.ABOUT_X_Y:g} and"
            f" {scaling.ABOUT_Z:g} of mass times arm squared"
        )
    if vehicle.torque_coefficient_Nm_s2 is None:
        thrust = vehicle.thrust_coefficient_N_s2.value
        torque = scaling.torque_coefficient(thrust, 2.0 * float(rotors["radius_m"].mean()))
        values["torque_coefficient_Nm_s2"] = torque.value
        notes.append(
            f"the torque coefficient is not in the file; taken as {scaling.TORQUE:g} of rotor"
            " diameter times thrust coefficient"
        )
    return values, notes


def _references(plan: str, references: Path | None, duration: float | None) -> np.ndarray:
    import pandas as pd

    from ges.simulator import manoeuvres

    if references is None:
        return manoeuvres.make(plan, duration)
    try:
        frame = (
            pd.read_parquet(references)
            if references.suffix == ".parquet"
            else pd.read_csv(references)
        )
    except (OSError, ValueError) as error:
        raise GesError(f"cannot read the references {references}: {error}") from None
    return manoeuvres.from_frame(frame)


def _recorded(record: sim.Record) -> dict[str, np.ndarray]:
    # the true rates give way to what the gyro read of them
    columns = {
        name: v
        for name, v in record.columns.items()
        if name.startswith(KEPT) and name not in READINGS.values()
    }
    before = int(np.searchsorted(record["t_s"], TRIM_S))
    recorded = {
        READINGS.get(name, name): record.columns[name][before:]
        for name in [*columns, *READINGS]
        if name in record.columns
    }
    return recorded | {"t_s": record["t_s"][: len(record["t_s"]) - before]}


@click.command()
@click.argument("vehicle_path", type=PATH, metavar="VEHICLE")
@click.option(
    "--plan",
    default="height_staircase",
    show_default=True,
    help="Manoeuvre of the menu in ges.manoeuvres.",
)
@click.option("--references", type=PATH, help="Set-point file (CSV or Parquet) instead of a plan.")
@click.option(
    "--duration", type=click.FloatRange(min=0.1), help="Seconds; default: the plan's own."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Seed of the sensor noise.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Any number of the simulator, e.g. dt_s=0.0005.",
)
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="Parquet file with the columns of a recording.",
)
def command(
    vehicle_path: Path,
    plan: str,
    references: Path | None,
    duration: float | None,
    seed: int,
    settings: tuple[str, ...],
    out: Path,
) -> None:
    """Fly a vehicle file, effects and all, in closed loop, and record the flight.

    Example: ges simulate out/vehicle.fitted.yaml --plan straight_runs --seed 3 --out flight.parquet
    """
    import pandas as pd

    from ges.files import require_file
    from ges.recordings.recording import write_flight
    from ges.simulator import flight as sim
    from ges.simulator import manoeuvres
    from ges.vehicle.load import load_vehicle

    require_file(out)
    vehicle = load_vehicle(vehicle_path)
    values, notes = _missing(vehicle)
    for sentence in notes:
        click.echo(f"warning: {sentence}", err=True)
    table = _references(plan, references, duration)
    timing = {
        "inputs_dt_s": manoeuvres.STEP_S,
        "inputs_start_s": TRIM_S,
        "duration_s": TRIM_S + (len(table) - 1) * manoeuvres.STEP_S,
    }
    # height by position and no feed-forward: the controller knows nothing of the ground
    fixed: dict[str, float | str] = {"seed": seed, "altitude_source": 1, "mode": "none", **timing}
    # a row has the readings of its own time, and no stream is half a step late of another
    fixed |= {"integrator": 1, "control_every": 5, "record_every": 10}
    # as autopilots have: integral action, or weak and canted rotors turn the vehicle over, and roll
    # and pitch before yaw where a rotor is at its limit
    fixed |= {"attitude_ki": 150.0, "yaw_kp": 20.0, "yaw_ki": 10.0, "yaw_kd": 8.0, "allocation": 1}
    curve = vehicle.effect_values().get("thrust_curve", {}).get("c", 0.0)
    fixed["fw_thrust_curve"] = min(max(curve, 0.0), 1.0)  # an autopilot is set up for its motors
    # later ones replace earlier ones: what the user sets has the last word
    numbers = {**vehicle.parameters(), **values, **fixed, **_settings(settings)}
    record = sim.fly(
        [sim.Flight(numbers, vehicle.effect_values(), vehicle.ground(vehicle_path.parent), table)]
    )[0]
    if record.status != "ok":
        raise GesError(record.status)
    recorded = _recorded(record)
    write_flight(out, pd.DataFrame(recorded))
    click.echo(
        f"{out}: {recorded['t_s'][-1]:.1f} s, {int(recorded['contact'].sum())} samples in contact"
        " with the ground",
        err=True,
    )


def _settings(settings: tuple[str, ...]) -> dict[str, float]:
    values = {}
    for item in settings:
        name, _, value = item.partition("=")
        try:
            values[name] = float(value)
        except ValueError:
            raise UsageError(f"--set {item}: expected NAME=NUMBER, as in dt_s=0.0005") from None
    return values
