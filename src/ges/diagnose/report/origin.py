"""``origin`` of diagnosis.json: what a diagnosis was made from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ges import __version__
from ges.diagnose.prepare.problem import Problem


def origin_of(problem: Problem) -> dict[str, Any]:
    """Return ``origin`` as far as tables in memory show it.

    Parameters
    ----------
    problem : the data of the diagnosis.
    """
    used = {**problem.fitted, **problem.held_out}
    parts = {
        **dict.fromkeys(problem.fitted, "fitted"),
        **dict.fromkeys(problem.held_out, "held_out"),
    }
    rows = []
    for name, seconds in sorted(problem.seconds.items()):
        flight = used.get(name)
        # samples times step: the last sample would count a step beyond the recording's end
        flown_s = float(flight.flying.sum() * flight.dt_s) if flight else 0.0
        rows.append(
            {
                "name": name,
                "seconds": seconds,
                "seconds_used": min(flown_s, seconds),
                "part": parts.get(name, "left_out"),
            }
        )
    return {"vehicle": {"name": problem.vehicle.name}, "flights": rows, "version": __version__}


def with_files(
    origin: Mapping[str, Any],
    hashes: Mapping[str, str],
    vehicle_file: Mapping[str, str],
    command: str,
) -> dict[str, Any]:
    """Return ``origin`` with what a run from files knows.

    Parameters
    ----------
    origin : of :func:`origin_of`.
    hashes : SHA-256 of the file of each flight, by name of the flight.
    vehicle_file : ``file`` and ``sha256`` of the vehicle file; empty where it was made from a log.
    command : the command line, as the user gave it.
    """
    return {
        **origin,
        "vehicle": {**origin["vehicle"], **vehicle_file},
        "flights": [
            {**row, **({"sha256": hashes[row["name"]]} if row["name"] in hashes else {})}
            for row in origin["flights"]
        ],
        "command": command,
    }
