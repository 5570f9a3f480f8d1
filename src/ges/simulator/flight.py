"""Fly: batches of flights in the compiled simulator.

A flight is a flat table of named numbers (``parameters()``), the effects that are switched on, the
ground, and, where needed, a table of references or of a replay. Many flights go in one call;
results do not depend on how many, on the number of lanes, or on the machine.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ges.conventions import MAX_ROTORS
from ges.errors import UsageError, unknown_name
from ges.simulator import _lib, effects, laws
from ges.simulator.terrain import Terrain


@functools.lru_cache(maxsize=1)
def modes() -> list[str]:
    """Modes of the feedforward; ``mode`` is the place of one in this list."""
    return _lib.mode_names()


def controllers() -> list[str]:
    """What can drive the rotors; ``control`` is the place of one in this list."""
    return list(_controller_inputs())


@functools.lru_cache(maxsize=1)
def _controller_inputs() -> dict[str, tuple[int, int]]:
    return _lib.controller_inputs()


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One number of a flight, with its default and allowed bounds."""

    name: str
    unit: str
    doc: str
    default: float
    low: float
    high: float


@functools.lru_cache(maxsize=1)
def parameters() -> dict[str, Parameter]:
    """Every number of a flight by name."""
    return {row[0]: Parameter(*row) for row in _lib.parameter_table()}


def rotors_of(given: Mapping[str, float | str]) -> int:
    """How many rotors these numbers of a flight give the vehicle."""
    return int(given.get("rotors", parameters()["rotors"].default))


@functools.lru_cache(maxsize=MAX_ROTORS)
def columns(n_rotors: int = 4) -> dict[str, tuple[str, str]]:
    """(unit, meaning) of every recorded quantity by name, of a vehicle with so many rotors."""
    return {
        name: (unit, doc) for name, unit, doc, rotor in _lib.column_table() if rotor <= n_rotors
    }


@functools.lru_cache(maxsize=1)
def _column_numbers() -> dict[str, int]:
    return {name: i for i, (name, *_) in enumerate(_lib.column_table())}


def parameter_vector(given: Mapping[str, float]) -> np.ndarray:
    """All numbers of a flight in the library's order, (k,) in the units of their names, defaults
    where not given.
    """
    known = parameters()
    for name in given:
        if name not in known:
            raise unknown_name("parameter", name, known)
    return np.array([float(given.get(name, p.default)) for name, p in known.items()])


@dataclasses.dataclass(frozen=True)
class Flight:
    """What is flown.

    Parameters
    ----------
    parameters : numbers by name; defaults elsewhere. ``mode`` may also be a name of :func:`modes`,
        ``control`` one of :func:`controllers`.
    effects : effect name to its parameters (defaults elsewhere).
    terrain : ground; procedural from the flight's seed if not given.
    inputs : (n, 14) references where ``control`` is firmware: p_ref (3), v_ref (3), a_ref (3),
        yaw_ref, excitation (3 rad/s^2, m/s^2); (n, k + 8) replay where it is replayed_commands or
        replayed_speeds: drive (k rotors; commands or speeds), q (4), battery_V, omega (3). Rows are
        ``inputs_dt_s`` apart from t = 0.
    """

    parameters: Mapping[str, float | str] = dataclasses.field(default_factory=dict)
    effects: effects.Effects = dataclasses.field(default_factory=dict)
    terrain: Terrain = dataclasses.field(default_factory=Terrain.procedural)
    inputs: np.ndarray | None = None

    def numbers(self) -> dict[str, float]:
        """Parameters with the terrain's, names of modes and controllers replaced by numbers."""
        named = {**self.terrain.parameters(), **self.parameters}
        return {name: self._number(name, value) for name, value in named.items()}

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return rotors_of(self.parameters)

    @staticmethod
    def _number(name: str, value: float | str) -> float:
        if not isinstance(value, str):
            return value
        if name not in ("mode", "control"):
            raise UsageError(f"{name} is '{value}'; it takes a number")
        known = modes() if name == "mode" else controllers()
        if value not in known:
            raise unknown_name("feedforward mode" if name == "mode" else name, value, known)
        return float(known.index(value))


@dataclasses.dataclass(frozen=True)
class Record:
    """One flown flight: ``columns`` by name, each of shape (n,); NaN from the row where a state
    stopped being finite.
    """

    columns: dict[str, np.ndarray]
    seed: int
    stopped_t_s: float | None = None
    stopped_field: str | None = None

    @property
    def status(self) -> str:
        """'ok', or what went wrong and when."""
        if self.stopped_field is None:
            return "ok"
        return (
            f"seed {self.seed} stopped at t = {self.stopped_t_s:g} s: {self.stopped_field} is not"
            " finite"
        )

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]


def _recorded(flights: Sequence[Flight], wanted: Iterable[str] | None) -> list[str]:
    """Names of what is recorded: all that every flight has, where it is not said."""
    if wanted is None:
        return list(columns(min((f.n_rotors for f in flights), default=1)))
    names, known = list(wanted), columns(max((f.n_rotors for f in flights), default=1))
    for name in names:
        if name not in known:
            raise unknown_name("column", name, known)
    return names


def _check_inputs(inputs: np.ndarray, control: float, n_rotors: int) -> None:
    for number, (fixed, of_rotor) in enumerate(_controller_inputs().values()):
        width = fixed + of_rotor * n_rotors
        if control == number and np.shape(inputs)[1:] != (width,):
            raise UsageError(
                f"inputs have shape {np.shape(inputs)}; this control takes (n, {width})"
            )


def _packed(flight: Flight) -> tuple:
    numbers, ground = flight.numbers(), flight.terrain
    if flight.inputs is not None:
        _check_inputs(flight.inputs, numbers.get("control", 0.0), flight.n_rotors)
    heights = ground.height_map()
    grid = None if heights is None else _lib.pack_grid(*heights)
    return parameter_vector(numbers), effects.pack(flight.effects), grid, flight.inputs


def fly(
    flights: Sequence[Flight], wanted: Iterable[str] | None = None, lanes: int = 0
) -> list[Record]:
    """Fly a batch.

    Parameters
    ----------
    flights : any number; they need not resemble each other.
    wanted : names of the columns to record; all that every flight has if not given.
    lanes : 0 lets the library choose; 1, 2, 4 and 8 give the same bits.

    Raises
    ------
    GesError When a number is out of its bounds or an input table is missing; the message names
    flight, value and bounds.
    """
    names, numbers = _recorded(flights, wanted), _column_numbers()
    flown = _lib.fly([_packed(f) for f in flights], [numbers[name] for name in names], lanes)
    seeds = [int(f.numbers().get("seed", parameters()["seed"].default)) for f in flights]
    return [
        # the library gives a row a sample; a column has to be contiguous for what reads it alone
        Record(
            dict(zip(names, np.ascontiguousarray(out.T), strict=True)),
            seed,
            t if field else None,
            field,
        )
        for (out, t, field), seed in zip(flown, seeds, strict=True)
    ]


def _term_line(term: tuple) -> str:
    """A term of a law, as :func:`ges.simulator.laws.packed` has it, for ``ges_sim``."""
    channel, scale, power, magnitude, near_m, coefficient = term
    names = [group.quantity for group in laws.groups().values()]
    factors = [q for q, n in zip(names, power, strict=True) for _ in range(n)]
    factors += [f"|{q}|" for q, m in zip(names, magnitude, strict=True) for _ in range(m)]
    factors += [f"near:{','.join(map(float.hex, near_m))}"] if near_m[2] else []
    return f"term {channel} {scale} {coefficient.hex()} {' '.join(factors)}"


def write_script(
    flights: Sequence[Flight], path: str | Path, wanted: Iterable[str] | None = None
) -> None:
    """Write flights (without height maps) as a text file that the program ``ges_sim`` flies to the
    same bytes.
    """
    names = _recorded(flights, wanted)
    lines = ["columns " + " ".join(names)]
    for i, flight in enumerate(flights):
        if flight.terrain.kind == "grid":
            raise UsageError(
                "ges_sim takes flat or procedural ground; this flight has a height map"
            )
        lines.append("flight")
        # hexadecimal floats lose no bit
        lines += [f"{name} = {float(value).hex()}" for name, value in flight.numbers().items()]
        for name, values in flight.effects.items():
            if name == laws.LAW:
                lines += map(_term_line, laws.packed(values))
                continue
            lines.append(f"effect {name}")
            lines += [
                f"effect.{name}.{key} = {value.hex()}"
                for key, value in effects.get(name).completed(values).items()
            ]
        if flight.inputs is not None:
            table = Path(path).with_suffix(f".inputs{i}.txt")
            table.write_text(
                "\n".join(" ".join(float(v).hex() for v in row) for row in flight.inputs) + "\n"
            )
            lines.append(f"inputs {table}")
    Path(path).write_text("\n".join(lines) + "\n")
