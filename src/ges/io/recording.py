"""Recording sets: a folder with a vehicle file and one Parquet file a flight.

Columns are quantities, floats in SI, NaN where a sample is missing; ``t_s`` is required and strictly increasing, not
necessarily regular. Columns that are not known are kept and ignored.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ..conventions import BODY_RATE, POSITION, POSITION_REF, QUATERNION, SPECIFIC_FORCE, VELOCITY, VELOCITY_REF
from ..errors import GesError
from ..vehicle import Vehicle, load_vehicle, save_vehicle

_PREFIX_UNITS = (("rotor_speed_", "rad/s"), ("motor_current_", "A"), ("u_", "1"))
_UNITS = {
    "t_s": "s", "battery_V": "V", "battery_A": "A", "range_m": "m", "ground_z_m": "m", "yaw_ref_rad": "rad",
    **dict.fromkeys(POSITION + POSITION_REF, "m"), **dict.fromkeys(VELOCITY + VELOCITY_REF, "m/s"),
    **dict.fromkeys(QUATERNION, "1"), **dict.fromkeys(BODY_RATE, "rad/s"), **dict.fromkeys(SPECIFIC_FORCE, "m/s^2"),
}  # fmt: skip

# Largest believable magnitude of a column in its unit, and what is usually wrong beyond it.
_PLAUSIBLE = (
    ("rotor_speed_", 4500.0, "it looks like rpm; convert to rad/s"),
    ("omega_", 60.0, "it looks like degrees per second; convert to rad/s"),
    ("acc_", 400.0, "it looks like a raw count or mm/s^2; convert to m/s^2"),
    ("battery_V", 200.0, "it looks like millivolts; convert to V"),
    ("range_m", 500.0, "it looks like millimetres; convert to m"),
    ("u_", 1.5, "commands are 0..1; divide by the full scale"),
    ("q_", 1.1, "quaternions have norm 1"),
    ("yaw_ref_rad", 30.0, "it looks like degrees; convert to rad"),
)


def unit_of(column: str) -> str | None:
    """Unit of a known column, None for a column that is only kept."""
    if column in _UNITS:
        return _UNITS[column]
    return next((unit for prefix, unit in _PREFIX_UNITS if column.startswith(prefix) and column[len(prefix)].isdigit()), None)


@dataclasses.dataclass(frozen=True)
class Flight:
    """One recorded flight: a name for people, and the table."""

    name: str
    frame: pd.DataFrame


@dataclasses.dataclass(frozen=True)
class RecordingSet:
    """Flights of one vehicle, and what was noticed when they were read."""

    vehicle: Vehicle
    flights: tuple[Flight, ...]
    folder: Path
    warnings: tuple[str, ...] = ()

    def ground(self):
        """Ground under the flights."""
        return self.vehicle.ground(self.folder)


def _check_time(name: str, frame: pd.DataFrame) -> None:
    if "t_s" not in frame:
        raise GesError(f"{name} has no column t_s; every flight needs its time in seconds")
    if len(frame) < 2:
        raise GesError(f"{name} holds {len(frame)} samples; a flight needs two or more")
    t = frame["t_s"].to_numpy()
    if not np.all(np.isfinite(t)):
        raise GesError(f"{name}: t_s is not a finite number in row {int(np.argmin(np.isfinite(t)))}")
    step = np.diff(t)
    if not np.all(step > 0):
        row = int(np.argmax(step <= 0))
        raise GesError(f"{name}: t_s does not increase after row {row} ({t[row]:g} s, then {t[row + 1]:g} s); sort or drop repeats")


def _implausible(name: str, column: str, values: np.ndarray) -> str | None:
    for prefix, bound, hint in _PLAUSIBLE:
        if column.startswith(prefix) and unit_of(column):
            size = float(np.nanquantile(np.abs(values), 0.95))
            return f"{name}: {column} reaches {size:g} {unit_of(column)}: {hint}" if size > bound else None
    return None


def checked_frame(name: str, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Check one flight's table: floats, increasing time, no empty channel, believable units.

    Returns
    -------
    frame, warnings : the table without channels that hold no sample, and a sentence for each of those.

    Raises
    ------
    GesError
        One sentence naming flight, column, value and remedy.
    """
    _check_time(name, frame)
    warnings, empty = [], []
    for column in frame.columns:
        if not unit_of(column):
            continue
        if not pd.api.types.is_numeric_dtype(frame[column]):
            raise GesError(f"{name}: column {column} holds {frame[column].dtype}, not numbers")
        values = frame[column].to_numpy(dtype=float)
        if np.all(np.isnan(values)):
            empty.append(column)
            warnings.append(f"{name}: {column} holds no sample (all NaN); it is left out")
        elif problem := _implausible(name, column, values):
            raise GesError(problem)
    numbers = frame.drop(columns=empty)
    return numbers.astype({c: float for c in numbers.columns if unit_of(c)}), warnings


def make_set(vehicle: Vehicle, frames: Iterable[tuple[str, pd.DataFrame]], folder: Path | str = ".") -> RecordingSet:
    """Recording set from tables in memory, checked."""
    flights, warnings = [], []
    for name, frame in frames:
        good, noticed = checked_frame(name, frame)
        flights.append(Flight(name, good))
        warnings += noticed
    return RecordingSet(vehicle, tuple(flights), Path(folder), tuple(warnings))


def load_set(folder: str | Path, least: int = 2) -> RecordingSet:
    """Read a recording set.

    Parameters
    ----------
    folder : holds vehicle.yaml and the flights' Parquet files, read in the order of their names.
    least : how many flights there must be.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise GesError(f"there is no folder {folder}; a recording set is a folder with vehicle.yaml and *.parquet")
    if not (folder / "vehicle.yaml").exists():
        raise GesError(f"{folder} has no vehicle.yaml; add the vehicle file to make it a recording set")
    paths = sorted(folder.glob("*.parquet"))
    if len(paths) < least:
        raise GesError(f"{folder} holds {len(paths)} flights (*.parquet); needed are {least} or more")
    return make_set(load_vehicle(folder / "vehicle.yaml"), ((p.stem, _read(p)) for p in paths), folder)


def _read(path: Path) -> pd.DataFrame:
    try:
        return pq.read_table(path).to_pandas()
    except (OSError, pa.ArrowException) as error:
        raise GesError(f"{path.name} is not a readable Parquet file: {str(error).splitlines()[0]}") from None


def write_flight(path: Path, frame: pd.DataFrame) -> None:
    """Write one flight, units in the metadata; complete or not at all."""
    fields = [pa.field(c, pa.float64(), metadata={"unit": unit_of(c) or ""}) for c in frame.columns]
    table = pa.Table.from_pandas(frame, schema=pa.schema(fields), preserve_index=False).replace_schema_metadata(None)
    fresh = path.with_name(path.name + ".new")
    pq.write_table(table, fresh)
    os.replace(fresh, path)


def write_set(folder: str | Path, vehicle: Vehicle, frames: Iterable[tuple[str, pd.DataFrame]]) -> None:
    """Write a recording set: vehicle.yaml and a Parquet file a flight."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    save_vehicle(vehicle, folder / "vehicle.yaml")
    for name, frame in frames:
        write_flight(folder / f"{name}.parquet", frame)


def require_drive(recordings: RecordingSet) -> None:
    """Refuse flights that tell nothing of the drive.

    Raises
    ------
    GesError
        When a flight has neither rotor speeds nor motor commands.
    """
    n = len(recordings.vehicle.rotors)
    for flight in recordings.flights:
        complete = [all(f"{p}{i}{s}" in flight.frame for i in range(1, n + 1)) for p, s in (("rotor_speed_", "_rad_s"), ("u_", ""))]
        if not any(complete):
            raise GesError(f"{flight.name} has neither rotor speeds (rotor_speed_1_rad_s ...) nor motor commands (u_1 ...) of all "
                           f"{n} rotors; log one of them to diagnose forces")  # fmt: skip
