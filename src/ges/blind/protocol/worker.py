"""One diagnosis behind walls.

It is ``python -I -m ges.blind.protocol.worker CASE OUT OPTIONS``, by :data:`run.SAME`. Its
environment and its working folder reveal nothing. It gets a copy of one case under a drawn name,
and gives up every other file before it reads the case. OPTIONS are JSON: ``set`` holds numbers of
the method by name, ``baseline`` names another method to use.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from ges.blind.protocol import jail
from ges.errors import GesError


def main(case: Path, out: Path, options: dict) -> int:
    """Diagnose one set and write the contract's files.

    Parameters
    ----------
    case : folder of the set, the only one that is read.
    out : folder that gets ``diagnosis.json`` and, but for a baseline, ``vehicle.fitted.yaml``;
        ``worker.json`` holds seconds and whether the kernel enforces the walls.
    options : ``set``, settings by name, or ``baseline``, the name of one.

    Returns
    -------
    1 where the method states that it cannot diagnose the set, else 0.
    """
    if "baseline" in options:
        from ges.blind.protocol import baselines  # noqa: F401  its source lies behind the wall
    # only the copy and the tool can be read from here on
    kernel = jail.lock_in([case, *jail.interpreter(), *jail.package()], [out])
    try:
        seconds = _diagnose(case, out, options)
    except GesError as error:
        print(error, file=sys.stderr)
        return 1
    (out / "worker.json").write_text(json.dumps({"kernel": kernel, "seconds": round(seconds, 3)}))
    return 0


def _diagnose(case: Path, out: Path, options: dict) -> float:
    from ges.diagnose import pipeline
    from ges.diagnose.settings import using
    from ges.files import write_json
    from ges.recordings.recording import load_set
    from ges.vehicle.file import save_vehicle

    start = time.perf_counter()
    if "baseline" in options:
        from ges.blind.protocol.baselines import diagnose

        write_json(out / "diagnosis.json", diagnose(load_set(case), options["baseline"]))
        return time.perf_counter() - start
    with using(options.get("set", {})):
        diagnosis = pipeline.diagnose(load_set(case))
    seconds = time.perf_counter() - start
    write_json(out / "diagnosis.json", diagnosis.content())
    save_vehicle(diagnosis.vehicle, out / "vehicle.fitted.yaml")
    return seconds


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), json.loads(sys.argv[3])))
