"""The ground that a seed was flown over, in numpy."""

from __future__ import annotations

import dataclasses

from ges.simulator.terrain import ProceduralShape, Terrain
from ges.study.config import TerrainShape


def ground_of(seed: int, terrain: TerrainShape) -> Terrain:
    """Procedural terrain of a seed."""
    known = {f.name for f in dataclasses.fields(ProceduralShape)}
    return Terrain.procedural(
        seed,
        ProceduralShape(**{k: float(v) for k, v in terrain.model_dump().items() if k in known}),
    )
