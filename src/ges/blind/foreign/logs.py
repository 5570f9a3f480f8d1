"""Logs of other people's simulators whose vehicle is known: PX4 in Gazebo classic, and PX4 in SIH.

The vehicle files are the simulators' own numbers from the library of vehicles, with the usual
uncertainties. Concealed is what is left out of the file, or wrong in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ges.blind.foreign.sets import HALVES, Concealed, Place, Sources, write_recorded
from ges.blind.generator.airframe import SD_REL
from ges.recordings.readers import Options, open_log
from ges.vehicle.file import vehicle_content
from ges.vehicle.load import load_vehicle

WORLD = "px4-simulators"
LIMIT = "not known: the log is all there is"
PIECES = 3
# Gazebo's motors lose thrust with speed along their axis, |v| / 25 m/s, in every flight; its map of
# commands to speeds is a curve here
GAZEBO_TOO = ("axial_inflow", "thrust_scale", "motor_lag", "thrust_curve")


@dataclass(frozen=True)
class LogSource:
    """A log of another simulator.

    Attributes
    ----------
    path : of the log below the folder of recordings.
    options : how it is read.
    vehicle : name in the library of vehicles.
    """

    path: str
    options: Options
    vehicle: str


GAZEBO = LogSource("gazebo-iris/quadrotor_model.csv", Options("gazebo-iris"), "gazebo-iris")
SIH = LogSource("px4-flights/sample_px4_events.ulg", Options(), "sih-quad")


@dataclass(frozen=True)
class LogDesign:
    """A set of one log with a changed vehicle file.

    Attributes
    ----------
    source : the log.
    without : effects that are left out of the file.
    wrong : factors on numbers of the file, by its keys.
    """

    source: LogSource
    without: tuple[str, ...] = ()
    wrong: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Name in the table of cases: vehicle, and what was changed in its file."""
        parts = [f"file without {n}" for n in self.without]
        parts += [f"file {n} {f:g}" for n, f in self.wrong.items()]
        return f"{self.source.vehicle} {', '.join(parts) or 'nothing'}"

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        The effects left out, and ``thrust_scale`` where a number is wrong. What Gazebo simulates
        beside them is optional.
        """
        names = (*self.without, *(("thrust_scale",) if self.wrong else ()))
        other = tuple(n for n in GAZEBO_TOO if n not in names) if self.source == GAZEBO else ()
        parameter = bool(self.wrong) and not self.without
        return Concealed(
            names,
            "medium",
            heavier=self.wrong.get("mass_kg", 1.0) < 1.0,
            optional=other,
            verdict="parameter" if parameter else "",
            category="parameter" if parameter else "",
        )


def designs(half: str) -> list[LogDesign]:
    """Return the sets of a half.

    Returns
    -------
    Three of the flight in Gazebo, of which each half has its own part, and for development one of
    SIH.
    """
    listed = [
        LogDesign(GAZEBO),
        LogDesign(GAZEBO, ("rotor_drag",)),
        LogDesign(GAZEBO, wrong={"mass_kg": 0.86 if half == "development" else 1.13}),
    ]
    return listed + ([LogDesign(SIH)] if half == "development" else [])


def make(out: Path, sets: Sequence[tuple[LogDesign, int, Place]], sources: Sources) -> None:
    """Write sets of :data:`PIECES` consecutive pieces of a log.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    sets : designs, each with its number in the world and its place.
    sources : where the published logs lie.

    Raises
    ------
    GesError
        When a log is not there.
    """
    for design, _, place in sets:
        frame = open_log(sources.recordings / design.source.path, design.source.options).frame()
        if design.source == GAZEBO:
            # each half of the study gets its half of the flight, and no sample of the other's
            size = len(frame) // 2
            start = size * HALVES.index(place.half)
            frame = frame.iloc[start : start + size]
        # one flight is all there is: its pieces stand for several
        size = len(frame) // PIECES
        flights = [frame.iloc[k * size : (k + 1) * size] for k in range(PIECES)]
        about = {"design": design.key, "vehicle": design.source.vehicle}
        truth = design.concealed().truth()
        write_recorded(out, place, _file(design), flights, truth, LIMIT, about)


def _file(design: LogDesign) -> dict[str, Any]:
    """Return the library's file with the usual uncertainties, less what is concealed."""
    content = vehicle_content(load_vehicle(design.source.vehicle))
    doubted = {
        "mass_kg": "mass",
        "thrust_coefficient_N_s2": "thrust",
        "torque_coefficient_Nm_s2": "torque",
        "motor_time_constant_s": "lag",
        "max_rotor_speed_rad_s": "speed",
    }
    for key, number in doubted.items():
        value = content[key]["value"] if isinstance(content[key], dict) else content[key]
        value *= design.wrong.get(key, 1.0)
        content[key] = {"value": value, "sd": SD_REL[number] * value}
    content["inertia_kg_m2"]["sd_rel"] = SD_REL["inertia"]
    content["effects"] = {
        name: numbers for name, numbers in content["effects"].items() if name not in design.without
    }
    return content
