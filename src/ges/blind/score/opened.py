"""What a case comes to once its truth is known.

These are the oracle's fit, and the same tool given the true names. They are most of the work of
scoring, the same for all methods. They are kept beside the cases, so that an interrupted scoring
goes on.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ges.blind.protocol import seal
from ges.blind.score import oracle
from ges.blind.score.heldout import diagnose_true_names
from ges.blind.score.oracle import SHAPES, Oracle, Witness, is_load, rms
from ges.files import read_kept, sha256, tree_hash, write_json
from ges.provenance.sources import PACKAGE, sources
from ges.simulator import effects as effect_table
from ges.simulator._lib import library_path
from ges.vehicle.load import load_vehicle

KEPT = "opened"
PARTS = ("fit", "detectable")


@dataclasses.dataclass(frozen=True)
class Opened:
    """What is known of a case once its truth is.

    Attributes
    ----------
    best : the oracle's parameters.
    of_true_names : ``fit`` and ``detectable`` of the ``diagnosis.json`` given the true names.
    over_limit : size of what is concealed over the smallest that these flights would have shown. It
        is the least of several names, and None where one has no such limit.
    """

    best: Oracle
    of_true_names: Mapping
    over_limit: float | None


def open_case(folder: Path, case: str, truth: Mapping, seen: Witness) -> Opened:
    """Return what is known of an opened case.

    It is worked out once for these recordings, these sources and this simulator, and kept.

    Parameters
    ----------
    folder : of the cases; results are kept in its folder :data:`KEPT`.
    case, truth : name of the case and its truth.
    seen : noise-free truth of the flights.
    """
    kept, made_of = folder / KEPT / f"{case}.json", _made_of(folder)
    stored = read_kept(kept, dict)
    if stored.get("made_of") == made_of:
        reach = np.nan if stored["reach"] is None else stored["reach"]
        best = Oracle(stored["parameters"], reach)
        return Opened(best, stored["told"], stored["over_limit"])
    opened = _work_out(folder, case, truth, seen)
    # JSON has no NaN
    reach = opened.best.reach if np.isfinite(opened.best.reach) else None
    write_json(
        kept,
        {
            "made_of": made_of,
            "parameters": opened.best.parameters,
            "reach": reach,
            "told": opened.of_true_names,
            "over_limit": opened.over_limit,
        },
    )
    return opened


def _made_of(folder: Path) -> str:
    parts = [
        tree_hash(PACKAGE, sources(__name__)),
        sha256(library_path()),
        sha256(folder / "sealed" / seal.SUMS),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _work_out(folder: Path, case: str, truth: Mapping, seen: Witness) -> Opened:
    names, place = [f["name"] for f in truth["findings"]], folder / "cases" / case
    best = oracle.fit(seen, names)
    # errors of the file and faults of sensors are stated by the truth, and need no fit
    nominal = oracle.nominal_values(truth, load_vehicle(place / "vehicle.yaml"))
    best = dataclasses.replace(best, parameters={**best.parameters, **nominal})
    of_true_names = diagnose_true_names(place, names)
    # companions (the drag that a wind acts through) are true as well, but not what was concealed
    sizes = [
        _over_limit(seen, n, best, of_true_names.get("detectable", {}))
        for n in names
        if n in truth.get("concealed", names[-1:])
    ]
    # a name without a limit may be the hardest to see: the others' least tells nothing
    limited = [size for size in sizes if size is not None]
    over_limit = min(limited) if sizes and len(limited) == len(sizes) else None
    return Opened(
        best, {part: of_true_names[part] for part in PARTS if part in of_true_names}, over_limit
    )


def _over_limit(seen: Witness, name: str, best: Oracle, detectable: Mapping) -> float | None:
    """Return the size of the effect over the smallest that these flights would have shown.

    It is of the loads where the effect makes loads, else of the numbers along any axis. None stands
    for a missing limit. The limit is the one that is stated given the true name, the same for what
    was found and what was missed.
    """
    limit = detectable.get(name)
    if not limit or not limit.get("smallest") or name not in best.parameters:
        return None
    neutral, right = effect_table.get(name).neutral(), best.parameters[name]
    if is_load(name):
        least = neutral | limit["shape"] | {limit["parameter"]: limit["smallest"]}
        # both sets of numbers as loads along the same path, where form and shape may differ
        sizes = [rms(seen.loads({name: values})) for values in (neutral | right, least)]
        if sizes[1] > 0.0:
            return sizes[0] / sizes[1]
    # numbers of one unit only make a length; shapes are no part of a size
    units = {p.name: p.unit for p in effect_table.get(name).parameters}
    alike = [
        v - neutral[p]
        for p, v in right.items()
        if p not in SHAPES and units[p] == units[limit["parameter"]]
    ]
    return float(np.linalg.norm(alike)) / limit["smallest"] if alike else None
