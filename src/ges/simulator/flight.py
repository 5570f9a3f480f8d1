"""Batches of flights in the compiled simulator.

A flight is a table of named numbers (:mod:`ges.simulator.parameters`), effects, ground and, where
needed, an input table. Many flights go in one call. Results do not depend on how many, on the
number of lanes, or on the machine.
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
from ges.simulator.parameters import parameter_vector, parameters, rotors_of
from ges.simulator.terrain import Terrain


@functools.lru_cache(maxsize=1)
def modes() -> list[str]:
    """List the modes of the feedforward; ``mode`` is an index into this list.

    Examples
    --------
    >>> modes()[0]
    'none'
    """
    return _lib.mode_names()


def controllers() -> list[str]:
    """List what can drive the rotors; ``control`` is an index into this list.

    Examples
    --------
    >>> controllers()
    ['firmware', 'replayed_commands', 'replayed_speeds', 'interpolated_commands']
    """
    return list(_controller_inputs())


@functools.lru_cache(maxsize=1)
def _controller_inputs() -> dict[str, tuple[int, int]]:
    return _lib.controller_inputs()


@functools.lru_cache(maxsize=MAX_ROTORS)
def columns(n_rotors: int = 4) -> dict[str, tuple[str, str]]:
    """List the quantities that can be recorded.

    Parameters
    ----------
    n_rotors : number of rotors of the vehicle.

    Returns
    -------
    (unit, meaning) by name.

    Examples
    --------
    >>> columns()["p_z_m"]
    ('m', 'position, world z')
    """
    return {
        name: (unit, doc) for name, unit, doc, rotor in _lib.column_table() if rotor <= n_rotors
    }


@functools.lru_cache(maxsize=1)
def _column_numbers() -> dict[str, int]:
    return {name: i for i, (name, *_) in enumerate(_lib.column_table())}


@dataclasses.dataclass(frozen=True)
class Flight:
    """A flight to simulate.

    Attributes
    ----------
    parameters : numbers by name, in the units of
        :func:`ges.simulator.parameters.parameters`; defaults elsewhere. ``mode``
        may be a name of :func:`modes`, ``control`` one of :func:`controllers`.
    effects : parameters by effect; defaults elsewhere.
    terrain : ground; by default procedural, from the flight's seed.
    inputs : input table (n, k), its rows ``inputs_dt_s`` apart from ``inputs_start_s``; see notes.

    Notes
    -----
    Columns of ``inputs`` depend on ``control``.

    For ``firmware``, 14 references in the world frame: position (3, m), velocity (3, m/s),
    acceleration (3, m/s^2), yaw (rad), angular acceleration about the body axes (3, rad/s^2),
    vertical acceleration (m/s^2).

    For the others, n_rotors + 8: commands (0 to 1), for ``replayed_speeds`` rotor speeds (rad/s),
    attitude (4, body to world), battery (V), body rates (3, rad/s).

    Examples
    --------
    A second of hover on flat ground, with rotor drag:

    >>> from ges.simulator import manoeuvres
    >>> from ges.simulator.flight import Flight, fly
    >>> from ges.simulator.terrain import Terrain
    >>> flight = Flight(
    ...     {"duration_s": 1.0, "inputs_dt_s": manoeuvres.STEP_S},
    ...     effects={"rotor_drag": {"k_kg": 6e-5}},
    ...     terrain=Terrain.flat(),
    ...     inputs=manoeuvres.make("hover", 1.0),
    ... )
    >>> flight.n_rotors
    4
    """

    parameters: Mapping[str, float | str] = dataclasses.field(default_factory=dict)
    effects: effects.Effects = dataclasses.field(default_factory=dict)
    terrain: Terrain = dataclasses.field(default_factory=Terrain.procedural)
    inputs: np.ndarray | None = None

    def numbers(self) -> dict[str, float]:
        """Give all numbers of the flight.

        Returns
        -------
        Parameters with those of the terrain, by name; names of modes and controllers as their
        index.

        Raises
        ------
        UsageError
            When a name of a mode or controller is unknown, or a text stands for a number.
        """
        named = {**self.terrain.parameters(), **self.parameters}
        return {
            name: self._number(name, value) if isinstance(value, str) else value
            for name, value in named.items()
        }

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return rotors_of(self.parameters)

    @staticmethod
    def _number(name: str, value: str) -> float:
        if name not in ("mode", "control"):
            raise UsageError(f"{name} is '{value}'; it takes a number")
        known = modes() if name == "mode" else controllers()
        if value not in known:
            raise unknown_name("feedforward mode" if name == "mode" else name, value, known)
        return float(known.index(value))


@dataclasses.dataclass(frozen=True)
class Record:
    """A simulated flight.

    Attributes
    ----------
    columns : recorded quantities (n,) by name, in the units of :func:`columns`. NaN from the row on
        where a state stopped being finite.
    seed : seed of the flight.
    stopped_t_s : time at which a state stopped being finite, s; None if none did.
    stopped_field : that state; None if none did.

    Examples
    --------
    >>> (record,) = fly([flight])
    >>> record.status, record["p_z_m"].shape
    ('ok', (101,))
    """

    columns: dict[str, np.ndarray]
    seed: int
    stopped_t_s: float | None = None
    stopped_field: str | None = None

    @property
    def status(self) -> str:
        """``ok``, or what stopped being finite, and when, in one sentence."""
        if self.stopped_field is None:
            return "ok"
        return (
            f"seed {self.seed} stopped at t = {self.stopped_t_s:g} s: {self.stopped_field} is not"
            " finite"
        )

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]


def _recorded(flights: Sequence[Flight], wanted: Iterable[str] | None) -> list[str]:
    """Name what is recorded: by default all that every flight has."""
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


def _packed(flight: Flight, on: _lib.CEffects) -> tuple:
    numbers, ground = flight.numbers(), flight.terrain
    if flight.inputs is not None:
        _check_inputs(flight.inputs, numbers.get("control", 0.0), flight.n_rotors)
    heights = ground.height_map()
    grid = None if heights is None else _lib.pack_grid(*heights)
    return parameter_vector(numbers), on, grid, flight.inputs


def fly(
    flights: Sequence[Flight], wanted: Iterable[str] | None = None, lanes: int = 0
) -> list[Record]:
    """Simulate a batch of flights.

    Parameters
    ----------
    flights : any number; they need not resemble each other.
    wanted : names of :func:`columns` to record; by default all that every flight has.
    lanes : flights that are computed together: 1, 2, 4, 8, or 0 for what suits the processor.
        Results are the same bits.

    Returns
    -------
    A record for each flight, in their order.

    Raises
    ------
    GesError
        When a number is out of its bounds, or an input table is missing.
    UsageError
        When a name is unknown, or an input table has a wrong shape.

    Examples
    --------
    >>> (record,) = fly([flight], ["t_s", "p_z_m"])
    >>> record["t_s"][-1].item()
    1.0
    """
    names, numbers = _recorded(flights, wanted), _column_numbers()
    # pieces of one flight have the same effects, by the thousand
    on = {key: effects.pack(e) for key, e in {id(f.effects): f.effects for f in flights}.items()}
    packed = [_packed(f, on[id(f.effects)]) for f in flights]
    seed = list(parameters()).index("seed")
    flown = _lib.fly(packed, [numbers[name] for name in names], lanes)
    seeds = [int(vector[seed]) for vector, *_ in packed]
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
    """Write a term of a law, as :func:`ges.simulator.laws.packed` gives it, for ``ges_sim``."""
    channel, scale, power, magnitude, near_m, coefficient = term
    names = [group.quantity for group in laws.groups().values()]
    factors = [q for q, n in zip(names, power, strict=True) for _ in range(n)]
    factors += [f"|{q}|" for q, m in zip(names, magnitude, strict=True) for _ in range(m)]
    factors += [f"near:{','.join(map(float.hex, near_m))}"] if near_m[2] else []
    return f"term {channel} {scale} {coefficient.hex()} {' '.join(factors)}"


def write_script(
    flights: Sequence[Flight], path: str | Path, wanted: Iterable[str] | None = None
) -> None:
    """Write flights as a script that the program ``ges_sim`` flies to the same bytes.

    Parameters
    ----------
    flights : on flat or procedural ground.
    path : script to write; input tables are written beside it.
    wanted : names of :func:`columns` to record; by default all that every flight has.

    Raises
    ------
    UsageError
        When a flight has a height map, or a name is unknown.
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
