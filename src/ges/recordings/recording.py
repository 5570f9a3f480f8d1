"""Recording sets: a folder with a vehicle file and one Parquet file a flight.

Columns are quantities: floats in SI units, NaN where a sample is missing. ``t_s`` is required; it
increases strictly, not necessarily in equal steps. Unknown columns are kept and ignored.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ges.conventions import (
    BODY_RATE,
    MAX_ROTORS,
    MOST_NUMBERS,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
    command,
    commands_in,
    motor_current,
    rotor_speed,
)
from ges.errors import GesError, unknown_name
from ges.files import replacing, replacing_together, require_text
from ges.recordings import faults
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Vehicle, save_vehicle
from ges.vehicle.load import load_vehicle

_ROTOR_UNITS = (
    (r"rotor_speed_[1-9]\d*_rad_s", "rad/s"),
    (r"motor_current_[1-9]\d*_A", "A"),
    (r"u_[1-9]\d*", "1"),
)
_UNITS = {
    "t_s": "s",
    "battery_V": "V",
    "battery_A": "A",
    "range_m": "m",
    "ground_z_m": "m",
    "yaw_ref_rad": "rad",
    **dict.fromkeys(POSITION + POSITION_REF, "m"),
    **dict.fromkeys(VELOCITY + VELOCITY_REF, "m/s"),
    **dict.fromkeys(QUATERNION, "1"),
    **dict.fromkeys(BODY_RATE, "rad/s"),
    **dict.fromkeys(SPECIFIC_FORCE, "m/s^2"),
}

_FULL_SCALE_NOISE = 0.02  # of commands about zero
_LOWEST_FORCE_M_S2 = 3.0  # no vehicle falls freely most of the time

# Largest believable magnitude of a column in its unit, and what is usually wrong beyond it.
_PLAUSIBLE = (
    ("p_", 1e5, "it looks like millimetres; --mend position-mm reads it so"),
    ("v_", 300.0, "it looks like millimetres per second; convert to m/s"),
    ("rotor_speed_", 4500.0, "it looks like rpm; --mend rotor-speeds-rpm reads it so"),
    ("omega_", 60.0, "it looks like degrees per second; --mend gyro-deg reads it so"),
    ("acc_", 400.0, "it looks like a raw count or mm/s^2; convert to m/s^2"),
    ("battery_V", 200.0, "it looks like millivolts; convert to V"),
    ("range_m", 500.0, "it looks like millimetres; convert to m"),
    ("u_", 1.5, "commands are 0..1; divide by the full scale"),
    ("q_", 1.1, "quaternions have norm 1"),
)


def unit_of(column: str) -> str | None:
    """Look up the unit of a column.

    Parameters
    ----------
    column : name of the column.

    Returns
    -------
    The unit, as ``m/s^2``; ``1`` where it has none; None for an unknown column.
    """
    if column in _UNITS:
        return _UNITS[column]
    return next((unit for form, unit in _ROTOR_UNITS if re.fullmatch(form, column)), None)


@dataclasses.dataclass(frozen=True)
class RecordedFlight:
    """One recorded flight.

    Attributes
    ----------
    name : name for people, unique in its set.
    frame : table (n rows) with ``t_s`` and columns of the recording; world ENU, body FLU, SI units.

    Examples
    --------
    >>> flights.flights[0].name, flights.flights[0].frame["t_s"].iloc[-1].item()
    ('runs_fast', 20.0)
    """

    name: str
    frame: pd.DataFrame


@dataclasses.dataclass(frozen=True)
class RecordingSet:
    """Checked flights of one vehicle.

    Attributes
    ----------
    vehicle : the vehicle file.
    flights : the flights, in order of reading.
    folder : folder of the height map that the vehicle file names.
    warnings : what was noticed when they were read, one sentence each.

    Examples
    --------
    >>> [flight.name for flight in flights.flights]
    ['runs_fast', 'runs_slow', 'stairs_fast', 'stairs_slow']
    >>> flights.vehicle.name
    'example quadrotor'
    """

    vehicle: Vehicle
    flights: tuple[RecordedFlight, ...]
    folder: Path
    warnings: tuple[str, ...] = ()

    def ground(self) -> Terrain:
        """Load the ground under the flights.

        Raises
        ------
        GesError
            When the height map that the vehicle file names cannot be read.
        """
        return self.vehicle.ground(self.folder)


def _check_time(name: str, frame: pd.DataFrame) -> None:
    if "t_s" not in frame:
        raise GesError(f"{name} has no column t_s; every flight needs its time in seconds")
    if len(frame) < 2:
        raise GesError(f"{name} holds {len(frame)} samples; a flight needs two or more")
    _require_numbers(name, frame, "t_s")
    t = frame["t_s"].to_numpy(dtype=float)
    if not np.all(np.isfinite(t)):
        raise GesError(
            f"{name}: t_s is not a finite number in row {int(np.argmin(np.isfinite(t)))}"
        )
    step = np.diff(t)
    if not np.all(step > 0):
        row = int(np.argmax(step <= 0))
        raise GesError(
            f"{name}: t_s does not increase after row {row} ({t[row]:g} s, then {t[row + 1]:g} s);"
            " sort or drop repeats"
        )


def _require_numbers(name: str, frame: pd.DataFrame, column: str) -> None:
    if isinstance(frame[column], pd.DataFrame):
        raise GesError(f"{name} has more than one column {column}; remove all but one")
    if not pd.api.types.is_numeric_dtype(frame[column]):
        raise GesError(f"{name}: column {column} holds {frame[column].dtype}, not numbers")


def _contradiction(name: str, frame: pd.DataFrame) -> str | None:
    """Find a scale, a unit or an axis that the column itself or gravity refutes.

    Returns
    -------
    One sentence with what to do; None where nothing is refuted.
    """
    checks = (
        _below_zero(frame),
        _wrong_force(frame),
        _wrong_heading(frame),
    )
    return next((f"{name}: {problem}" for problem in checks if problem), None)


def _below_zero(frame: pd.DataFrame) -> str | None:
    for column in commands_in(frame):
        # a quantile, as single spikes are no other scale
        if (least := float(np.nanquantile(frame[column], 0.01))) < -_FULL_SCALE_NOISE:
            return (
                f"{column} falls to {least:.2g}: commands are 0..1; where they are -1..1 take"
                " (u + 1) / 2"
            )
    return None


def _wrong_force(frame: pd.DataFrame) -> str | None:
    if not all(name in frame for name in SPECIFIC_FORCE):
        return None
    # flying at all, the accelerometer reads g upwards most of the time
    size = float(np.nanmedian(np.linalg.norm(frame[list(SPECIFIC_FORCE)], axis=1)))
    if 0 < size < _LOWEST_FORCE_M_S2:
        return (
            f"the accelerometer reads {size:.2g} m/s^2 most of the time: it looks like g;"
            " --mend accelerometer-g reads it so"
        )
    usual = float(np.nanmedian(frame["acc_z_m_s2"]))
    if usual < -_LOWEST_FORCE_M_S2:
        return (
            f"acc_z_m_s2 reads {usual:.2g} most of the time: z points down; the body frame is"
            " forward-left-up, so negate y and z of accelerometer and gyro"
        )
    return None


def _wrong_heading(frame: pd.DataFrame) -> str | None:
    if not {"yaw_ref_rad", *QUATERNION} <= set(frame.columns):
        return None
    asked, w, x, y, z = frame[["yaw_ref_rad", *QUATERNION]].dropna().to_numpy().T
    largest = np.abs(asked).max(initial=0.0)
    # within a turn radians may be meant as well; beyond it they may count the turns
    if largest <= 2.0 * np.pi:
        return None
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    in_rad, in_deg = (
        float(np.median(np.abs(np.angle(np.exp(1j * (angle - heading))))))
        for angle in (asked, np.radians(asked))
    )
    # a heading that follows neither is no evidence
    if 2.0 * in_deg < in_rad:
        return (
            f"yaw_ref_rad reaches {largest:.3g}, and the attitude is"
            f" {in_deg:.2g} rad from it in degrees, {in_rad:.2g} in radians: it looks like"
            " degrees; convert to rad"
        )
    return None


def _implausible(name: str, column: str, values: np.ndarray) -> str | None:
    for prefix, bound, hint in _PLAUSIBLE:
        if column.startswith(prefix) and unit_of(column):
            # a quantile, as single spikes are no wrong unit
            size = float(np.nanquantile(np.abs(values), 0.95))
            return (
                f"{name}: {column} reaches {size:g} {unit_of(column)}: {hint}"
                if size > bound
                else None
            )
    return None


def checked_frame(name: str, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Check the table of one flight: numbers, increasing time, plausible units.

    Parameters
    ----------
    name : name of the flight, for messages.
    frame : table (n rows) with ``t_s`` and contract columns.

    Returns
    -------
    The table with known columns as floats, without those that hold no sample, and a warning for
    each of these.

    Raises
    ------
    GesError
        One sentence that names flight, column, value and remedy.
    """
    _check_time(name, frame)
    warnings, empty = [], []
    for column in frame.columns:
        if not unit_of(column):
            continue
        _require_numbers(name, frame, column)
        values = frame[column].to_numpy(dtype=float)
        if np.any(np.isinf(values)):
            raise GesError(
                f"{name}: {column} is infinite in row {int(np.argmax(np.isinf(values)))}; write NaN"
                " for a missing sample"
            )
        if np.all(np.isnan(values)):
            empty.append(column)
            warnings.append(f"{name}: {column} holds no sample (all NaN); it is left out")
        elif problem := _implausible(name, column, values):
            raise GesError(problem)
    numbers = frame.drop(columns=empty)
    return numbers.astype({c: float for c in numbers.columns if unit_of(c)}), warnings


def make_set(
    vehicle: Vehicle,
    frames: Iterable[tuple[str, pd.DataFrame]],
    folder: Path | str = ".",
    mends: Sequence[str] = (),
) -> RecordingSet:
    """Make a recording set from tables in memory, and check it.

    Tables are checked one by one, against the vehicle, and their columns against each other.

    Parameters
    ----------
    vehicle : the vehicle file.
    frames : name and table (n rows) of each flight; world ENU, body FLU, SI units.
    folder : folder of the height map that the vehicle file names.
    mends : corrections applied to every table first: names of :func:`ges.recordings.faults.faults`.

    Returns
    -------
    The set, without columns of motors that the vehicle does not have.

    Raises
    ------
    GesError
        When a table cannot be right; the sentence says what is most likely wrong.
    UsageError
        When ``mends`` has an unknown name.

    Examples
    --------
    >>> from ges.recordings.recording import make_set
    >>> first = flights.flights[0]
    >>> half = make_set(flights.vehicle, [("first half", first.frame[:500])])
    >>> [flight.name for flight in half.flights]
    ['first half']
    """
    known = {f.name: f for f in faults.faults(len(vehicle.rotors)).values() if not f.in_file}
    if wrong := [name for name in mends if name not in known]:
        # each order and sign of each stream: hundreds
        raise unknown_name("mend", wrong[0], list(known), "docs/importing.md")
    flights, warnings = [], [f"read with --mend {name}: {known[name].what}" for name in mends]
    for name, given in frames:
        frame = given
        for mend in mends:
            frame = known[mend].mend(frame)
        good, noticed = checked_frame(name, frame.drop(columns=_of_no_rotor(frame, vehicle)))
        if problem := _contradiction(name, good):
            raise GesError(problem)
        flights.append(RecordedFlight(name, good))
        warnings += noticed
    alike, log_odds = faults.find_faults([f.frame for f in flights], vehicle)
    if alike:
        raise GesError(f"{flights[0].name}: {faults.sentence(alike, log_odds)}")
    return RecordingSet(vehicle, tuple(flights), Path(folder), tuple(warnings))


def _of_no_rotor(frame: pd.DataFrame, vehicle: Vehicle) -> list[str]:
    """List columns of motors that the vehicle does not have, as spare outputs of its autopilot."""
    count = len(vehicle.rotors)
    every = (names(MAX_ROTORS) for names in (rotor_speed, command, motor_current))
    beyond = {name for names in every for name in names[count:]}
    return [name for name in frame.columns if name in beyond]


def load_set(folder: str | Path, least: int = 2, mends: Sequence[str] = ()) -> RecordingSet:
    """Read a recording set from its folder, and check it.

    Parameters
    ----------
    folder : holds vehicle.yaml and the flights' Parquet files, which are read in order of their
        names.
    least : smallest number of flights allowed.
    mends : corrections applied to every table, see :func:`make_set`.

    Returns
    -------
    The set; each flight is named after its file.

    Raises
    ------
    GesError
        When files are missing, cannot be read or cannot be right, in one sentence.

    Examples
    --------
    >>> from ges.recordings.recording import load_set
    >>> flights = load_set(example)
    >>> len(flights.flights)
    4
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise GesError(
            f"there is no folder {folder}; a recording set is a folder with vehicle.yaml and"
            " *.parquet"
        )
    if not (folder / "vehicle.yaml").exists():
        raise GesError(
            f"{folder} has no vehicle.yaml, as a recording set does; add it, or make a set of logs"
            " with 'ges import'"
        )
    paths = _tables(folder)
    if len(paths) < least:
        count = "1 flight" if len(paths) == 1 else f"{len(paths)} flights"
        raise GesError(
            f"{folder} holds {count} (*.parquet); needed are {least} or more;"
            " 'ges import --parts 4' cuts a long log"
        )
    frames = ((p.stem, _read(p)) for p in paths)
    return make_set(load_vehicle(folder / "vehicle.yaml"), frames, folder, mends)


def read_parquet(path: Path) -> pa.Table:
    """Read a Parquet file.

    Raises
    ------
    GesError
        Where it is damaged, or would not fit into memory.
    """
    try:
        about = pq.read_metadata(path)
        # of one value many times over, a file of some kB has as many rows as it likes
        if about.num_rows * about.num_columns > MOST_NUMBERS:
            raise GesError(
                f"{path.name} holds {about.num_rows} rows of {about.num_columns} columns; at most"
                f" {MOST_NUMBERS} numbers are read, so cut it"
            )
        return pq.read_table(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise GesError(f"{path.name} is not a readable Parquet file: {error}") from None


def _read(path: Path) -> pd.DataFrame:
    table = read_parquet(path)
    for field in table.schema:
        unit, expected = (field.metadata or {}).get(b"unit", b""), unit_of(field.name)
        stated = unit.decode(errors="replace")
        if stated and expected and stated != expected:
            raise GesError(
                f"{path.name}: the file calls {field.name} a number of {stated}; it must be"
                f" {expected}"
            )
    return table.to_pandas(ignore_metadata=True)


def write_flight(path: Path, frame: pd.DataFrame) -> None:
    """Write a flight as a Parquet file, complete or not at all.

    Parameters
    ----------
    path : file to write.
    frame : table (n rows) of the flight; units of known columns are written as metadata.
    """
    table = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    fields = [
        f.with_type(pa.float64()).with_metadata({"unit": unit}) if (unit := unit_of(f.name)) else f
        for f in table.schema
    ]
    with replacing(path) as new:
        pq.write_table(table.cast(pa.schema(fields)), new)


def write_set(
    folder: str | Path, vehicle: Vehicle, frames: Iterable[tuple[str, pd.DataFrame]]
) -> None:
    """Write a recording set, all of it or nothing: vehicle.yaml and one Parquet file a flight.

    Parameters
    ----------
    folder : folder to write into, made where it is missing.
    vehicle : the vehicle file.
    frames : name and table (n rows) of each flight; the name becomes that of the file.

    Raises
    ------
    GesError
        When the folder holds other flights, which would become part of the set.

    Examples
    --------
    >>> from ges.recordings.recording import write_set
    >>> write_set("copy", flights.vehicle, [(f.name, f.frame) for f in flights.flights])
    >>> load_set("copy").vehicle == flights.vehicle
    True
    """
    folder, tables = Path(folder), dict(frames)
    others = [p.name for p in _tables(folder) if p.stem not in tables]
    if others:
        raise GesError(
            f"{folder} already holds other flights ({', '.join(others[:3])}); remove them or name"
            " another folder"
        )
    with replacing_together(folder, last="vehicle.yaml") as new:
        for name, frame in tables.items():
            write_flight(new / f"{name}.parquet", frame)
        save_vehicle(vehicle, new / "vehicle.yaml")


def _tables(folder: Path) -> list[Path]:
    """Parquet files of a folder, sorted; what a process that was killed left of one is hidden."""
    paths = sorted(folder.glob("[!.]*.parquet"))
    for path in paths:
        require_text(path.name)
    return paths


def require_drive(recordings: RecordingSet) -> None:
    """Refuse flights without rotor speeds and without motor commands.

    Parameters
    ----------
    recordings : the flights.

    Raises
    ------
    GesError
        When there is no flight, or one has neither of the two for every rotor.
    """
    if not recordings.flights:
        raise GesError(
            "there is no flight among the recordings; give one table at least, a row a sample, with"
            " the columns of docs/importing.md"
        )
    n = len(recordings.vehicle.rotors)
    for flight in recordings.flights:
        complete = [
            all(f"{p}{i}{s}" in flight.frame for i in range(1, n + 1))
            for p, s in (("rotor_speed_", "_rad_s"), ("u_", ""))
        ]
        if not any(complete):
            raise GesError(
                f"{flight.name} has neither rotor speeds (rotor_speed_1_rad_s ...) nor commands"
                f" (u_1 ...) of all {n} rotors; log one of them to diagnose forces"
            )
