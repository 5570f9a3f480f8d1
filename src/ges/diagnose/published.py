"""The first diagnosis of the study: published flights of a real vehicle whose simulator does not
know of the ground.
"""

from __future__ import annotations

from pathlib import Path

from ges.diagnose.pipeline import diagnose
from ges.diagnose.report.output import write_diagnosis
from ges.files import write_text
from ges.recordings.readers import Options, open_log
from ges.vehicle.file import load_vehicle

HELD_OUT = "NO_COMPENSATION_V_050"
ABSENT = """<!doctype html><title>No diagnosis</title>
<p>The published recordings are not at hand, so nothing was diagnosed.
<code>ges recordings fetch appius-ground-effect --out recordings</code> brings them;
then run the workflow again.</p>
"""


def diagnose_published(recordings: list[Path], vehicle: Path, mapping: Path, report: Path) -> None:
    """Diagnose the flights that have rotor speeds; the flight :data:`HELD_OUT` takes no part in
    fitting or choosing.

    Parameters
    ----------
    recordings : published CSV files; where there are none, the report says so.
    vehicle, mapping : vehicle file and column map.
    report : report.html; all other files of a diagnosis are written beside it.
    """
    options = Options(mapping)
    logs = (open_log(path, options) for path in sorted(recordings))
    flights = {log.name: log.frame() for log in logs if "rotor_speed" in log.streams}
    # without its flight held out, or one beside it to fit, nothing would be proven
    if HELD_OUT not in flights or len(flights) < 2:
        write_text(report, ABSENT)
        return
    write_diagnosis(diagnose(flights, load_vehicle(vehicle), holdout=[HELD_OUT]), report.parent)
