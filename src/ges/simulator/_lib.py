"""The border to the C simulator: the only module that knows ctypes.

The interface is ``sim_c/include/ges.h``. Python crosses this border once a batch of flights or a
recording, never once a step.
"""

from __future__ import annotations

import ctypes as ct
import functools
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ges.conventions import MOST_NUMBERS
from ges.errors import GesError

ABI = 12
MAX_EFFECTS, MAX_PARAMETERS = 40, 16
MAX_TERMS, MAX_GROUPS = 24, 16
_ERROR_SIZE = 512
_double_p = ct.POINTER(ct.c_double)


class CParameter(ct.Structure):
    _fields_ = [(n, ct.c_char_p) for n in ("name", "unit", "doc")] + [
        (n, ct.c_double) for n in ("value", "low", "high")
    ]


class CColumn(ct.Structure):
    _fields_: ClassVar[Any] = [
        *((n, ct.c_char_p) for n in ("name", "unit", "doc")),
        ("rotor", ct.c_int),
    ]


class CChoice(ct.Structure):
    _fields_ = [
        *((n, ct.c_char_p) for n in ("name", "doc")),
        *((n, ct.c_int) for n in ("input_columns", "rotor_columns")),
    ]


class CGrid(ct.Structure):
    _fields_ = (
        [("nx", ct.c_int), ("ny", ct.c_int)]
        + [(n, ct.c_double) for n in ("x0_m", "y0_m", "dx_m", "dy_m")]
        + [("z_m", _double_p)]
    )


class CGroup(ct.Structure):
    _fields_ = [(n, ct.c_char_p) for n in ("quantity", "reference", "unit", "needs", "doc")]


class CTerm(ct.Structure):
    _fields_ = [
        *((n, ct.c_int) for n in ("channel", "scale")),
        *((n, ct.c_int * MAX_GROUPS) for n in ("power", "magnitude")),
        ("near_m", ct.c_double * 3),
    ]


class CEffects(ct.Structure):
    _fields_ = [
        ("n", ct.c_int),
        ("id", ct.c_int * MAX_EFFECTS),
        ("value", (ct.c_double * MAX_PARAMETERS) * MAX_EFFECTS),
        ("n_terms", ct.c_int),
        ("term", CTerm * MAX_TERMS),
        ("coefficient", ct.c_double * MAX_TERMS),
    ]


class CFlight(ct.Structure):
    _fields_ = [
        ("parameters", _double_p),
        ("effects", CEffects),
        ("grid", ct.POINTER(CGrid)),
        ("inputs", _double_p),
        ("n_inputs", ct.c_int),
        ("out", _double_p),
        ("n_rows", ct.c_int),
        ("stopped_row", ct.c_int),
        ("stopped_t_s", ct.c_double),
        ("stopped_field", ct.c_char_p),
    ]


def library_path() -> Path:
    """Find the compiled simulator.

    Returns
    -------
    ``$GES_LIBRARY`` if set, else ``libges.so`` beside this file (a wheel has it), else
    ``build/libges.so`` of the checkout.
    """
    given, packaged = os.environ.get("GES_LIBRARY"), Path(__file__).with_name("libges.so")
    if given:
        return Path(given)
    return (
        packaged if packaged.exists() else Path(__file__).resolve().parents[3] / "build/libges.so"
    )


@functools.lru_cache(maxsize=8)
def load(path: Path | None = None) -> ct.CDLL:
    """Load the compiled simulator.

    Parameters
    ----------
    path : the library; :func:`library_path` by default.

    Raises
    ------
    GesError
        When it is missing or was built from another version of the sources.
    """
    path = path or library_path()
    if not path.exists():
        raise GesError(
            f"the compiled simulator {path.name} is not at {path.parent}; run 'make build' in a"
            " checkout, or install the wheel anew"
        )
    library = ct.CDLL(str(path))
    if library.ges_abi() != ABI:
        raise GesError(
            f"{path.name} has interface {library.ges_abi()}, this package needs {ABI}; run 'make"
            " build'"
        )
    # a count is a Python int, which ctypes passes as a C int unless told it is one of 64 bits
    library.ges_rows.argtypes = [_double_p]
    library.ges_describe_effects.restype = ct.c_char_p
    library.ges_replay.argtypes = [
        _double_p,
        ct.POINTER(CEffects),
        ct.c_int,
        ct.POINTER(CGrid),
        _double_p,
        ct.c_int64,
        ct.POINTER(ct.c_int),
        ct.c_int,
        _double_p,
        ct.c_int,
        ct.c_char_p,
        ct.c_int,
    ]
    library.ges_terrain.argtypes = [
        _double_p,
        ct.POINTER(CGrid),
        _double_p,
        _double_p,
        ct.c_int64,
        _double_p,
        _double_p,
        _double_p,
        _double_p,
        ct.c_char_p,
        ct.c_int,
    ]
    return library


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(_double_p)


def contiguous(array: ArrayLike) -> np.ndarray:
    """Convert to C doubles in rows, (n,) or (n, k) as given."""
    return np.ascontiguousarray(array, dtype=np.float64)


def _checked(call: Callable[..., int], *arguments: Any) -> None:
    error = ct.create_string_buffer(_ERROR_SIZE)
    if call(*arguments, error, _ERROR_SIZE) != 1:
        raise GesError(error.value.decode())


def parameter_table() -> list[tuple[str, str, str, float, float, float]]:
    """List (name, unit, doc, default, low, high) of every number of a flight."""
    table = ct.POINTER(CParameter)()
    n = load().ges_parameters(ct.byref(table))
    return [
        (*(s.decode() for s in (p.name, p.unit, p.doc)), p.value, p.low, p.high) for p in table[:n]
    ]


Column = tuple[str, str, str, int]
"""Name, unit, doc, and the rotor that a column is of: its number from 1, 0 of none, -1 of each, for
whose number there is a ``#`` in the name."""


def _column_list(table: Any, n: int) -> list[Column]:
    return [(c.name.decode(), c.unit.decode(), c.doc.decode(), c.rotor) for c in table[:n]]


def _choices(listed: Callable[..., int]) -> dict[str, tuple[int, int]]:
    table = ct.POINTER(CChoice)()
    n = listed(ct.byref(table))
    return {row.name.decode(): (row.input_columns, row.rotor_columns) for row in table[:n]}


def mode_names() -> list[str]:
    """List the modes of the feedforward, in the order of their numbers."""
    return list(_choices(load().ges_modes))


def controller_inputs() -> dict[str, tuple[int, int]]:
    """List the columns of the input table of every controller, in the order of its number.

    Returns
    -------
    By controller, the number of columns of no rotor, and the number for every rotor.
    """
    return _choices(load().ges_controllers)


def column_table() -> list[Column]:
    """List every recorded quantity."""
    table = ct.POINTER(CColumn)()
    n = load().ges_columns(ct.byref(table))
    return _column_list(table, n)


def replay_tables() -> tuple[list[Column], list[Column]]:
    """List what a replay reads and what it gives; columns of rotors come last."""
    inputs, outputs = ct.POINTER(CColumn)(), ct.POINTER(CColumn)()
    n_in, n_out = ct.c_int(), ct.c_int()
    load().ges_replay_columns(ct.byref(inputs), ct.byref(n_in), ct.byref(outputs), ct.byref(n_out))
    return _column_list(inputs, n_in.value), _column_list(outputs, n_out.value)


def effect_descriptors() -> list[dict[str, Any]]:
    """List the descriptors of all compiled effects, in the order of their numbers.

    Returns
    -------
    Fields by name, as ``sim_c/effects/descriptor.h`` has them; lists are tuples.
    """
    return json.loads(
        load().ges_describe_effects(),
        object_hook=lambda given: {
            key: tuple(value) if isinstance(value, list) else value for key, value in given.items()
        },
    )


def group_table() -> list[tuple[str, ...]]:
    """List (quantity, reference, unit, needs, doc) of every dimensionless group of laws."""
    table = ct.POINTER(CGroup)()
    n = load().ges_groups(ct.byref(table))
    return [
        tuple(s.decode() for s in (g.quantity, g.reference, g.unit, g.needs, g.doc))
        for g in table[:n]
    ]


def pack_effects(
    effects: list[tuple[int, list[float]]],
    terms: Sequence[tuple] = (),
) -> CEffects:
    """Pack effects and terms of laws into the struct of the compiled library.

    Parameters
    ----------
    effects : number and parameter values of each effect.
    terms : channel, scale, powers, powers of magnitudes, place and width (m), and coefficient of
        each; a power for every group.

    Raises
    ------
    GesError
        When there are more effects or terms than the library takes.
    """
    if len(effects) > MAX_EFFECTS:
        raise GesError(f"{len(effects)} effects are switched on; at most {MAX_EFFECTS} at once")
    if len(terms) > MAX_TERMS:
        raise GesError(f"the laws have {len(terms)} terms; at most {MAX_TERMS} at once")
    packed = CEffects(n=len(effects), n_terms=len(terms))
    for j, (number, values) in enumerate(effects):
        packed.id[j] = number
        packed.value[j][: len(values)] = values
    for j, (channel, scale, power, magnitude, near_m, coefficient) in enumerate(terms):
        packed.term[j] = CTerm(channel=channel, scale=scale, near_m=near_m)
        packed.term[j].power[: len(power)] = power
        packed.term[j].magnitude[: len(magnitude)] = magnitude
        packed.coefficient[j] = coefficient
    return packed


def pack_grid(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> CGrid:
    """Pack a height map; the struct keeps a reference to the heights.

    Parameters
    ----------
    x_m, y_m : uniform axes in the world, (k,) and (m,).
    z_m : (m, k) heights in the world.
    """
    z_m = contiguous(z_m)
    grid = CGrid(
        len(x_m), len(y_m), x_m[0], y_m[0], x_m[1] - x_m[0], y_m[1] - y_m[0], _pointer(z_m)
    )
    # the struct holds a bare address
    grid.kept = z_m
    return grid


def _reference(grid: CGrid | None) -> Any:
    return ct.pointer(grid) if grid is not None else None


def fly(
    flights: list[tuple], columns: list[int], lanes: int
) -> list[tuple[np.ndarray, float, str | None]]:
    """Fly a batch.

    Parameters
    ----------
    flights : (parameters, CEffects, CGrid or None, inputs or None) of each.
    columns : numbers of the columns to record.
    lanes : as of :func:`ges.simulator.flight.fly`.

    Returns
    -------
    Of each flight the record (n, k) for k columns in their units, the stop time (s) and the stopped
    field.

    Raises
    ------
    GesError
        When a number is out of its bounds or an input table is missing.
    """
    library, kept, batch = load(), [], (CFlight * len(flights))()
    for c, (parameters, effects, grid, inputs) in zip(batch, flights, strict=True):
        parameters = contiguous(parameters)
        rows = library.ges_rows(_pointer(parameters))
        if rows * len(columns) > MOST_NUMBERS:
            raise GesError(
                f"a flight of {rows} rows and {len(columns)} columns; at most {MOST_NUMBERS}"
                " numbers are recorded, so fly shorter or raise record_every"
            )
        # what is not reached, behind a state that stopped being finite, stays NaN
        out = np.full((rows, len(columns)), np.nan)
        c.parameters, c.effects, c.grid = _pointer(parameters), effects, _reference(grid)
        c.out, c.n_rows = _pointer(out), len(out)
        if inputs is not None:
            inputs = contiguous(inputs)
            c.inputs, c.n_inputs = _pointer(inputs), len(inputs)
        # the C structs hold bare addresses: the arrays must live until the batch is flown
        kept.append((parameters, out, inputs, grid))
    _checked(
        library.ges_fly,
        batch,
        len(flights),
        (ct.c_int * len(columns))(*columns),
        len(columns),
        lanes,
    )
    return [
        (out, c.stopped_t_s, c.stopped_field.decode() if c.stopped_field else None)
        for c, (_, out, _, _) in zip(batch, kept, strict=True)
    ]


def replay(
    parameters: ArrayLike,
    sets: list[CEffects],
    grid: CGrid | None,
    samples: np.ndarray,
    columns: list[int],
    lanes: int,
) -> np.ndarray:
    """Compute the model along n recorded samples under each set of effects.

    Parameters
    ----------
    parameters : all numbers of the vehicle, (k,).
    sets : packed sets of effects.
    grid : height map; None for other ground.
    samples : (n_inputs, n), a row for each quantity.
    columns : numbers of the quantities given.
    lanes : 0 for what suits the processor.

    Returns
    -------
    Array (n_sets, k, n) for k columns.

    Raises
    ------
    GesError
        When a number is out of its bounds.
    """
    samples, parameters = contiguous(samples), contiguous(parameters)
    out = np.empty((len(sets), len(columns), samples.shape[1]))
    _checked(
        load().ges_replay,
        _pointer(parameters),
        (CEffects * len(sets))(*sets),
        len(sets),
        _reference(grid),
        _pointer(samples),
        samples.shape[1],
        (ct.c_int * len(columns))(*columns),
        len(columns),
        _pointer(out),
        lanes,
    )
    return out


def terrain(
    parameters: ArrayLike, grid: CGrid | None, x_m: np.ndarray, y_m: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Compute the ground at n points.

    Parameters
    ----------
    parameters : all numbers of a flight, (k,).
    grid : height map; None for other ground.
    x_m, y_m : (n,) coordinates in the world.

    Returns
    -------
    Height (m), slope along x and y, and Laplacian (1/m), each (n,).
    """
    x_m, y_m, parameters = contiguous(x_m), contiguous(y_m), contiguous(parameters)
    out = [np.empty(len(x_m)) for _ in range(4)]
    _checked(
        load().ges_terrain,
        _pointer(parameters),
        _reference(grid),
        _pointer(x_m),
        _pointer(y_m),
        len(x_m),
        *map(_pointer, out),
    )
    return tuple(out)


def network(features: np.ndarray) -> float:
    """Compute the exported network as the firmware does, from features (13,)."""
    given = np.ascontiguousarray(features, dtype=np.float32)
    factor = ct.c_float()
    load().ges_network(given.ctypes.data_as(ct.POINTER(ct.c_float)), ct.byref(factor))
    return factor.value
