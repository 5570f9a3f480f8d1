"""The study's first diagnoses of published flights.

One vehicle has changed since it was calibrated; the simulator of another does not know of the
ground.
"""

from __future__ import annotations

from pathlib import Path

from ges.diagnose.calibrate.calibrate import calibrate
from ges.diagnose.pipeline import diagnose
from ges.diagnose.report.output import write_diagnosis
from ges.errors import GesError
from ges.recordings.readers import Options, open_log
from ges.recordings.recording import load_set
from ges.vehicle.load import load_vehicle

HELD_OUT = "NO_COMPENSATION_V_050"


def diagnose_changed(reference: list[Path], flights: list[Path], report: Path) -> None:
    """Diagnose the flights of a vehicle against reference flights of the same one.

    Parameters
    ----------
    reference, flights : files of a recording set each.
    report : report.html; all other files of a diagnosis are written next to it.
    """
    vehicle = calibrate(load_set(reference[0].parent)).vehicle
    diagnosis = diagnose({f.name: f.frame for f in load_set(flights[0].parent).flights}, vehicle)
    write_diagnosis(diagnosis, report.parent)


def diagnose_published(recordings: list[Path], vehicle: Path, mapping: Path, report: Path) -> None:
    """Diagnose the flights that have rotor speeds, with :data:`HELD_OUT` held out.

    Parameters
    ----------
    recordings : published CSV files.
    vehicle, mapping : vehicle file and column map.
    report : report.html; all other files of a diagnosis are written next to it.

    Raises
    ------
    GesError
        Where the held-out flight, or another one, is missing.
    """
    options = Options(mapping)
    logs = (open_log(path, options) for path in sorted(recordings))
    flights = {log.name: log.frame() for log in logs if "rotor_speed" in log.streams}
    # without these nothing would be proven
    if HELD_OUT not in flights or len(flights) < 2:
        raise GesError(
            f"the recordings lack {HELD_OUT} or a flight beside it;"
            " 'ges recordings fetch appius-ground-effect --out recordings' brings all"
        )
    write_diagnosis(diagnose(flights, load_vehicle(vehicle), holdout=[HELD_OUT]), report.parent)
