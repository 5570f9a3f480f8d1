"""Proof that no terrain is in two parts of a split, from the very files that models read."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pandas as pd

from ges.errors import GesError
from ges.files import sha256, write_json
from ges.study.config import TerrainShape
from ges.study.datasets.flights import read_flight, seed_of
from ges.study.datasets.ground import ground_of
from ges.study.datasets.split import PARTS


def _check_terrain(path: Path, terrain: TerrainShape) -> int:
    """Return the seed of a flight, proven by the ground that it recorded.

    The ground equals, bit for bit, that of the seed's terrain.

    Raises
    ------
    GesError
        When it does not, or the file is named after another seed.
    """
    seed, data = read_flight(path, ("p_x_m", "p_y_m", "ground_z_m"))
    # the numpy port repeats the compiled terrain to the last bit: what differs is other ground
    expected = ground_of(seed, terrain).at(data["p_x_m"], data["p_y_m"]).height_m
    if seed != seed_of(path) or not np.array_equal(expected, data["ground_z_m"]):
        raise GesError(
            f"leakage: {Path(path).name} is not the flight of its seed: it says seed {seed}, and"
            f" its ground {'is' if np.array_equal(expected, data['ground_z_m']) else 'is not'} that"
            " seed's; fly the data set again"
        )
    return seed


def _check_blocks(blocks: pd.DataFrame, name: str, by_seed: bool) -> None:
    """No row in two blocks; and, if ``by_seed``, no seed in two parts.

    Raises
    ------
    GesError
        Naming the seed and the parts.
    """
    unknown = set(blocks["part"]) - set(PARTS)
    if unknown:
        raise GesError(f"leakage: {name} has a part '{min(unknown)}'; parts are {', '.join(PARTS)}")
    ordered = blocks.sort_values(["seed", "first_row"])
    # by first row: if any two blocks of a seed overlap, some two neighbours do
    overlaps = (ordered["seed"] == ordered["seed"].shift()) & (
        ordered["first_row"] <= ordered["last_row"].shift()
    )
    if overlaps.any():
        bad = ordered[overlaps].iloc[0]
        raise GesError(
            f"leakage: {name}: rows from {bad.first_row} of seed {bad.seed} are in two blocks"
        )
    seeds = {part: set(blocks.loc[blocks["part"] == part, "seed"]) for part in PARTS}
    for a, b in itertools.combinations(PARTS, 2):
        shared = seeds[a] & seeds[b]
        if by_seed and shared:
            raise GesError(
                f"leakage: {name}: seed {min(shared)} is in both '{a}' and '{b}' ({len(shared)}"
                " shared)"
            )


def check_leakage(
    flights: list[Path], splits: list[Path], report: Path, terrain: TerrainShape
) -> None:
    """Check that no terrain is in two parts of a split.

    Parameters
    ----------
    flights : files of the data set; each must have flown over the terrain of its seed.
    splits : tables of blocks; those named ``*.seedwise.csv`` must share no seed.
    report : to write (JSON): SHA-256 of every flight, and the counts of every part. Rows are read
        from flights of a report alone.
    terrain : shape of the terrain.

    Raises
    ------
    GesError
        When a flight is not that of its seed, a seed is flown twice, blocks overlap, or parts share
        a seed.
    """
    seeds = {_check_terrain(f, terrain) for f in flights}
    checked = {"flights": {str(f): sha256(f) for f in flights}, "seeds": len(seeds)}
    if len(seeds) != len(flights):
        raise GesError(
            f"leakage: {len(flights)} flights hold {len(seeds)} seeds; each seed is flown once"
        )
    for split in map(Path, splits):
        blocks = pd.read_csv(split)
        _check_blocks(blocks, split.name, by_seed=".seedwise." in split.name)
        rows = (blocks["last_row"] - blocks["first_row"] + 1).groupby(blocks["part"]).sum()
        checked[split.name] = {
            p: {
                "seeds": int(blocks.loc[blocks["part"] == p, "seed"].nunique()),
                "rows": int(rows.get(p, 0)),
            }
            for p in PARTS
        }
    write_json(report, checked)
