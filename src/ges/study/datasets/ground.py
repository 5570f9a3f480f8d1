"""The ground that a seed was flown over, in numpy."""

from __future__ import annotations

import dataclasses

from ges.simulator.terrain import ProceduralShape, Terrain
from ges.study.config import TerrainShape


def ground_of(seed: int, terrain: TerrainShape) -> Terrain:
    """Return the procedural terrain of a seed.

    Parameters
    ----------
    seed : each draws another terrain.
    terrain : its shape.
    """
    fields = {f.name for f in dataclasses.fields(ProceduralShape)}
    return Terrain.procedural(
        seed,
        ProceduralShape(**{k: float(v) for k, v in terrain.model_dump().items() if k in fields}),
    )
