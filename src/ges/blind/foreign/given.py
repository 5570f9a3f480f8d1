"""Sets that others made with a simulator which no registry has, given as a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import yaml

from ges.blind.foreign.sets import CATEGORY_OF_SIZE, Place, Sources, write_recorded
from ges.errors import GesError

WORLD = "gym-pybullet-drones"
LIMIT = "not known: nobody kept the truth"


@dataclass(frozen=True)
class GivenSet:
    """One set of the folder.

    Attributes
    ----------
    key : name of its folder below ``cases/``, and of its truth below ``sealed/``.
    """

    key: str


def folder_of(half: str, sources: Sources) -> Path:
    """Return the folder of the given sets of a half.

    Parameters
    ----------
    half : 'development', whose folder has the name of the world, or 'evaluation', whose name ends
        in ``-evaluation``.
    sources : the folder of all given sets.
    """
    return sources.given / (WORLD if half == "development" else f"{WORLD}-{half}")


def designs(half: str, sources: Sources) -> list[GivenSet]:
    """Return the sets that are given for a half, by name; none where there is no folder of them."""
    cases = folder_of(half, sources) / "cases"
    return [GivenSet(path.name) for path in sorted(cases.iterdir())] if cases.is_dir() else []


def make(out: Path, sets: Sequence[tuple[GivenSet, int, Place]], sources: Sources) -> None:
    """Copy sets with their truth, under names that reveal nothing.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    sets : each with its number in the world and its place.
    sources : where the given sets lie.

    Raises
    ------
    GesError
        When a set has no truth beside it.
    """
    for design, _, place in sets:
        folder = folder_of(place.half, sources)
        path = folder / "sealed" / f"{design.key}.json"
        if not path.is_file():
            raise GesError(f"the set {design.key} has no truth {path}; it cannot be scored")
        truth = json.loads(path.read_text())
        case = folder / "cases" / design.key
        flights = [pd.read_parquet(flight) for flight in sorted(case.glob("*.parquet"))]
        names = truth["findings"]
        kind = "parameter" if truth["verdict"] == "parameter" else CATEGORY_OF_SIZE[len(names)]
        about = {"design": truth.pop("case", design.key), "vehicle": "crazyflie"}
        vehicle = yaml.safe_load((case / "vehicle.yaml").read_text())
        truth |= {"category": kind}
        write_recorded(out, place, vehicle, flights, truth, LIMIT, about)
