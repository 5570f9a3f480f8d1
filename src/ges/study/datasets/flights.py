"""Flights of the data set: flown in batches, one typed Parquet file a seed."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ges.errors import GesError, UsageError
from ges.files import replacing
from ges.simulator import flight as sim
from ges.study.config import FlightPlan, Simulator
from ges.study.datasets.columns import TYPES

SCHEMA_VERSION = 1


def seed_of(path: Path) -> int:
    """Return the seed that a file is named after (``seed0042.parquet``).

    Raises
    ------
    UsageError
        When the file is not named like this.
    """
    match = re.fullmatch(r"seed(\d+)\.parquet", Path(path).name)
    if not match:
        raise UsageError(
            f"'{Path(path).name}' is no flight of a data set; such files are named like"
            " seed0042.parquet"
        )
    return int(match[1])


def config_hash(*parts: object) -> str:
    """Return the SHA-256 of parts of a configuration, as sorted JSON.

    Parameters
    ----------
    *parts : pydantic models, or what JSON can hold.
    """
    plain = [p.model_dump(mode="json") if hasattr(p, "model_dump") else p for p in parts]
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def start_of(seed: int, plan: FlightPlan) -> float:
    """Draw the place of the track where a seed's flight begins.

    Flights thus lie over ground of every kind, and not over the flat border of the first feature.

    Returns
    -------
    Place (m), the same for the same seed.
    """
    return float(np.random.default_rng(seed).uniform(plan.start_min_m, plan.start_max_m))


def data_flight(
    seed: int, simulator: Simulator, plan: FlightPlan, duration_s: float, rate_hz: float
) -> sim.Flight:
    """Return the flight of one seed of the data set.

    Parameters
    ----------
    seed : of terrain, noise and start.
    simulator, plan : what is flown, and how.
    duration_s : length of the flight.
    rate_hz : rows a second.

    Raises
    ------
    UsageError
        When the rate does not divide the simulator's steps.
    """
    # a whole number of steps but for rounding, or rows would not be equally far apart
    every = 1.0 / (rate_hz * simulator.dt_s)
    if abs(every - round(every)) > 1e-9 * every:
        raise UsageError(
            f"data.rate_hz = {rate_hz:g} does not divide the simulator's {1 / simulator.dt_s:g}"
            " steps/s"
        )
    own = {
        "seed": float(seed),
        "duration_s": duration_s,
        "record_every": float(round(every)),
        "track_start_m": start_of(seed, plan),
        **plan.model_dump(exclude={"start_min_m", "start_max_m"}),
    }
    return sim.Flight({**simulator.parameters(), **own}, simulator.effects())


def _schema(metadata: dict[str, str]) -> pa.Schema:
    described = sim.columns()
    fields = [
        pa.field(
            name,
            pa.type_for_alias(kind),
            nullable=False,
            metadata={"unit": described[name][0], "meaning": described[name][1]},
        )
        for name, kind in TYPES.items()
    ]
    return pa.schema(fields, metadata=metadata)


def _write(path: Path, record: sim.Record, metadata: dict[str, str]) -> None:
    schema = _schema({**metadata, "seed": str(record.seed)})
    arrays = [pa.array(record[f.name].astype(f.type.to_pandas_dtype())) for f in schema]
    with replacing(path) as new:
        pq.write_table(
            pa.table(arrays, schema=schema),
            new,
            compression="zstd",
            use_dictionary=False,
            row_group_size=1 << 20,
        )


def fly_batch(
    flights: list[Path], simulator: Simulator, plan: FlightPlan, duration_s: float, rate_hz: float
) -> None:
    """Fly the seeds that files are named after, and write each flight.

    Every flight depends on its own seed alone, so that results do not depend on batches.

    Parameters
    ----------
    flights : to write (Parquet). Metadata of a file are ``schema`` (version), ``config_sha256`` and
        ``seed``; those of a column are ``unit`` and ``meaning``.
    simulator, plan : what is flown, and how.
    duration_s : length of a flight.
    rate_hz : rows a second.

    Raises
    ------
    GesError
        When a flight did not end well.
    """
    metadata = {
        "schema": str(SCHEMA_VERSION),
        "config_sha256": config_hash(simulator, plan, duration_s, rate_hz),
    }
    records = sim.fly(
        [data_flight(seed_of(f), simulator, plan, duration_s, rate_hz) for f in flights], TYPES
    )
    for path, record in zip(flights, records, strict=True):
        if record.status != "ok":
            raise GesError(
                f"data set: {record.status}; this flight plan cannot be flown with these gains"
            )
        _write(Path(path), record, metadata)


def read_flight(path: Path, columns: tuple[str, ...]) -> tuple[int, dict[str, np.ndarray]]:
    """Return the seed that a file states, and columns (n,) by name.

    Parameters
    ----------
    path : flight of the data set.
    columns : names, see :data:`TYPES`.

    Raises
    ------
    GesError
        When the file is no flight of the data set.
    """
    try:
        table = pq.read_table(path, columns=list(columns), partitioning=None)
        seed = int(table.schema.metadata[b"seed"])
    except (OSError, KeyError, TypeError, pa.ArrowInvalid) as error:
        raise GesError(
            f"{Path(path).name} is not a flight of the data set: {' '.join(str(error).split())}"
        ) from None
    return seed, {name: table[name].to_numpy() for name in columns}
