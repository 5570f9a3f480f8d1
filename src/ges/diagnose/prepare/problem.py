"""The data of a diagnosis: flights read, aligned, and divided into fitted and held-out ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.gate import Gate, pass_gate, with_flown_voltage
from ges.diagnose.prepare.split import digest, split
from ges.diagnose.types.model import Model, from_vehicle
from ges.errors import GesError, UsageError, unknown_name
from ges.recordings.recording import RecordingSet, make_set, require_drive
from ges.vehicle.file import Vehicle
from ges.vehicle.load import load_vehicle, vehicle_path

Recordings = RecordingSet | Mapping[str, pd.DataFrame] | Sequence[pd.DataFrame]
"""What can be diagnosed: a set, or flights by name or in a row, with contract columns."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """The data of a diagnosis.

    Attributes
    ----------
    vehicle, model : the vehicle file, and its model at the voltage that was flown.
    gate : the aligned flights, delays and offsets.
    fitted : flights for fitting and choosing, by name.
    held_out : flights for the proof alone, by name.
    seconds : duration of every recording by name, also of those that cannot be used.
    warnings : what the reader should know.
    """

    vehicle: Vehicle
    model: Model
    gate: Gate
    fitted: Mapping[str, Prepared]
    held_out: Mapping[str, Prepared]
    seconds: Mapping[str, float]
    warnings: Sequence[str]

    @property
    def train(self) -> list[Prepared]:
        """Flights for fitting and choosing."""
        return list(self.fitted.values())

    @property
    def flights(self) -> list[Prepared]:
        """All flights in use: those for fitting, then those held out."""
        return [*self.train, *self.held_out.values()]

    def with_flights(self, flights: Sequence[Prepared]) -> Problem:
        """Return a copy with other flights.

        Parameters
        ----------
        flights : in the order of :attr:`flights`.
        """
        some = iter(flights)
        return dataclasses.replace(
            self,
            fitted={name: next(some) for name in self.fitted},
            held_out={name: next(some) for name in self.held_out},
        )


def pose_problem(
    recordings: Recordings,
    vehicle: Vehicle | str | Path | None,
    holdout: str | Sequence[str] | None,
    folder: Path | str,
) -> Problem:
    """Align the flights, remove delays and offsets, and divide them.

    Parameters
    ----------
    recordings : a recording set, or tables with contract columns.
    vehicle : or its path or name in the library; taken from a recording set where not given.
    holdout : names of the flights to hold out, or one name; None lets :func:`split` choose.
    folder : where a height map of the vehicle file lies.

    Raises
    ------
    GesError
        When the recordings cannot be used, in one sentence.

    Notes
    -----
    Neither names nor order of the flights matter.
    """
    flights = _as_set(recordings, vehicle, folder)
    require_drive(flights)
    model = from_vehicle(flights.vehicle, flights.folder)
    hashed = [(digest(f.frame), f) for f in flights.flights]
    ordered = sorted(hashed, key=lambda pair: pair[0])
    labels, frames = [f.name for _, f in ordered], [f.frame for _, f in ordered]
    gate = pass_gate(frames, model, labels)
    model = with_flown_voltage(model, gate.flights.values())
    digests = [d for d, _ in ordered]
    train, held_out = split(digests, list(gate.flights), _indices(holdout, labels))
    if not train:
        raise GesError("every usable flight is held out; leave at least one for fitting")
    return Problem(
        flights.vehicle,
        model,
        gate,
        {labels[i]: gate.flights[i] for i in train},
        {labels[i]: gate.flights[i] for i in held_out},
        {f.name: float(np.ptp(f.frame["t_s"].to_numpy(dtype=float))) for _, f in ordered},
        (*flights.warnings, *gate.warnings),
    )


def _as_set(
    recordings: Recordings, vehicle: Vehicle | str | Path | None, folder: Path | str
) -> RecordingSet:
    if isinstance(vehicle, str | Path):
        folder = vehicle_path(vehicle).parent
        vehicle = load_vehicle(vehicle)
    if not isinstance(vehicle, Vehicle | None):
        raise UsageError(
            f"the vehicle is of type {type(vehicle).__name__}; allowed is a Vehicle, the path of a"
            " vehicle file or a name of the library, so load it with ges.vehicle.load_vehicle"
        )
    if isinstance(recordings, RecordingSet):
        if vehicle is None:
            return recordings
        return make_set(vehicle, [(f.name, f.frame) for f in recordings.flights], folder)
    named = _named_tables(recordings)
    if vehicle is None:
        raise GesError(
            "no vehicle given; pass one (ges.vehicle.load_vehicle) or a recording set that has one"
        )
    return make_set(vehicle, named, folder)


def _named_tables(recordings: Recordings) -> list[tuple[str, pd.DataFrame]]:
    """List tables with the names of a mapping, or with numbers."""
    if isinstance(recordings, Mapping):
        named = list(recordings.items())
    elif isinstance(recordings, Sequence):
        named = [(f"flight{i}", frame) for i, frame in enumerate(recordings, 1)]
    else:
        named = [("", recordings)]
    wrong = [frame for name, frame in named if not (name and isinstance(frame, pd.DataFrame))]
    if wrong:
        raise UsageError(
            f"recordings hold a {type(wrong[0]).__name__}; allowed are a recording set"
            " (ges.recordings.recording.load_set) and tables in a list or by name, and"
            " ges.diagnose takes the path of a set or of logs, too"
        )
    return named


def _indices(holdout: str | Sequence[str] | None, names: Sequence[str]) -> list[int] | None:
    if holdout is None:
        return None
    holdout = [holdout] if isinstance(holdout, str) else holdout
    for name in holdout:
        if name not in names:
            raise unknown_name("flight", name, names)
    return [names.index(name) for name in holdout]
