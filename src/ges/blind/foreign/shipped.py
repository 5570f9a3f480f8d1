"""Real flights that the package ships, as sealed sets: what was done to a vehicle since the flights
that it was calibrated on.
"""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from ges.blind.foreign.real import (
    CUT,
    CUT_PAIR,
    HEALTHY_FLIGHTS,
    LIMIT,
    STRING_WEIGHT,
    TAPED_WEIGHT,
)
from ges.blind.foreign.sets import HALVES, Concealed, Place, unknown_limit, write_set
from ges.blind.protocol import seal
from ges.diagnose.calibrate.calibrate import calibrate
from ges.recordings.recording import RecordingSet, load_set
from ges.vehicle.file import vehicle_content

WORLD = "crazypad-small"


@dataclass(frozen=True)
class Change:
    """What was done to a vehicle, and the flights before and after it.

    Attributes
    ----------
    done : in words.
    truth : what a diagnosis should find.
    reference, flights : flights for the calibration and for the diagnosis. Each is a folder of
        :data:`WORLD` and the part of it that is taken.
    """

    done: str
    truth: Concealed
    reference: tuple[str, slice]
    flights: tuple[str, slice]


ALL = slice(None)
CHANGES = (
    Change("nothing", HEALTHY_FLIGHTS, ("healthy_e9", slice(2)), ("healthy_e9", slice(2, None))),
    Change("propeller 3 cut by 3 mm", CUT, ("healthy_e9", ALL), ("cut_propeller_3", ALL)),
    Change(
        "propellers 1 and 2 cut by 4 mm",
        CUT_PAIR,
        ("reference_of_the_pair", ALL),
        ("cut_propellers_1_2", ALL),
    ),
    Change("weight at motor 3", TAPED_WEIGHT, ("healthy_e9", ALL), ("weight_at_motor_3", ALL)),
    Change("weight on a string", STRING_WEIGHT, ("healthy_e8", ALL), ("weight_on_string", ALL)),
)


def make_and_seal(sums: Path) -> None:
    """Write a set for each of :data:`CHANGES`, and seal them.

    Parameters
    ----------
    sums : list of hashes to be written, ``sealed/SHA256SUMS``; what is in its folder and in
        ``cases/`` beside that is replaced.
    """
    out = sums.parents[1]
    for folder in ("cases", "sealed"):
        shutil.rmtree(out / folder, ignore_errors=True)
        (out / folder).mkdir(parents=True)
    for change in CHANGES:
        _write(out, change)
    seal.close(out)


def _write(out: Path, change: Change) -> None:
    reference, flights = _part(change.reference), _part(change.flights)
    place = Place(WORLD, change.done, HALVES[0], 0)
    truth = change.truth.truth() | {
        "detectable": unknown_limit(LIMIT),
        "situation": {"world": WORLD, "design": change.done, "noise": "real"},
    }
    vehicle = vehicle_content(calibrate(reference).vehicle)
    write_set(out, place, vehicle, [f.frame for f in flights.flights], truth)


def _part(where: tuple[str, slice]) -> RecordingSet:
    folder, part = where
    with resources.as_file(resources.files("ges.recordings") / WORLD / folder) as path:
        whole = load_set(path)
    return dataclasses.replace(whole, flights=whole.flights[part])
