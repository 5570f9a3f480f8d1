"""Column maps (YAML): what each column of a foreign table is, in which unit and with which sign."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args

import numpy as np
import pydantic
import yaml
from pydantic_core import ErrorDetails

from ges.conventions import (
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
)
from ges.errors import UsageError, unknown_name
from ges.plain_yaml import read_yaml
from ges.recordings.readers import frames
from ges.recordings.recording import unit_of

if TYPE_CHECKING:
    import pint


class _StrictMap(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")


class Column(_StrictMap):
    """Where one column of a file goes.

    Attributes
    ----------
    to : column of the recording set; an unknown name is kept and ignored.
    unit : unit in the file; that of ``to`` by default. ``g`` is the standard acceleration of
        gravity.
    factor, offset : applied after the unit: a sign, a full scale, a zero.
    missing : number that stands for a missing sample, besides an empty field and nan.
    optional : whether a file may lack it.
    """

    to: str
    unit: str | None = None
    factor: float = 1.0
    offset: float = 0.0
    missing: float | None = None
    optional: bool = False


class Layout(_StrictMap):
    """One arrangement of columns.

    Attributes
    ----------
    columns : a list for files without a header (null: skip), or by name for files with one.
    axes : frames of the file: ``enu-flu``, or ``ned-frd`` (north-east-down, forward-right-down),
        which is converted.
    """

    columns: list[Column | None] | dict[str, Column]
    axes: Literal["enu-flu", "ned-frd"] = "enu-flu"

    def named(self, header: Iterable[str]) -> dict[str, Column] | None:
        """Select the columns that a file has.

        Parameters
        ----------
        header : names of the file's columns.

        Returns
        -------
        Columns by name; None where the layout goes by position or a required column is missing.
        """
        if not isinstance(self.columns, dict):
            return None
        present = set(header)
        lacking = [n for n, c in self.columns.items() if n not in present and not c.optional]
        return None if lacking else {n: c for n, c in self.columns.items() if n in present}


class ColumnMap(_StrictMap):
    """A column map file.

    Attributes
    ----------
    about : whose files these are.
    separator, decimal : of a text file, one character each.
    layouts : the first that fits a table is used; of a MATLAB file every one that fits.
    """

    about: str = ""
    separator: Annotated[str, pydantic.Field(min_length=1, max_length=1)] = ","
    decimal: Annotated[str, pydantic.Field(min_length=1, max_length=1)] = "."
    layouts: list[Layout] = pydantic.Field(min_length=1)


ADVICE = {
    "attitude": "columns q_w, q_x, q_y, q_z (or roll_rad, pitch_rad, yaw_rad)",
    "position": "columns p_x_m, p_y_m, p_z_m",
    "velocity": "columns v_x_m_s, v_y_m_s, v_z_m_s",
    "rates": "columns omega_x_rad_s, omega_y_rad_s, omega_z_rad_s",
    "acceleration": "columns acc_x_m_s2, acc_y_m_s2, acc_z_m_s2",
    "command": "columns u_1 to u_4, 0 to 1",
    "rotor_speed": "columns rotor_speed_1_rad_s to rotor_speed_4_rad_s",
    "battery": "a column battery_V",
    "reference": "columns p_ref_x_m ..., v_ref_x_m_s ..., yaw_ref_rad",
    "range": "a column range_m",
}
"""What to add to a table, by stream."""

Map = TypeVar("Map", bound=pydantic.BaseModel)


@functools.cache
def _units() -> pint.UnitRegistry:
    import pint

    registry: pint.UnitRegistry = pint.UnitRegistry(on_redefinition="ignore")
    # pint's own g is the gram
    registry.define("g = 9.80665 * meter / second ** 2")
    return registry


@functools.cache
def unit_factor(unit: str, target: str | None) -> float:
    """Compute the factor from one unit to another.

    Parameters
    ----------
    unit : unit to convert from, as ``deg`` or ``rpm``.
    target : unit to convert to; None or ``1`` for SI base units.

    Raises
    ------
    UsageError
        When a unit is unknown, or the two have different dimensions.

    Examples
    --------
    >>> unit_factor("mV", "V")
    0.001
    """
    # here, as it takes 0.1 s, and few runs read a table with units
    import pint

    try:
        one = _units().Quantity(1.0, unit)
        return float((one.to(target) if target and target != "1" else one.to_base_units()).m)
    except pint.errors.DimensionalityError:
        raise UsageError(
            f"unit '{unit}' of the column map cannot become {target}; check the column"
        ) from None
    except Exception:
        # pint meets a malformed unit with errors of many kinds, its tokenizer's among them
        raise UsageError(
            f"unit '{unit}' of the column map is not known; write it as in 'deg', 'rpm', 'mV',"
            " 'm/s'"
        ) from None


def _preset_files() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("ges.recordings.readers") / "presets"
    return {f.name.removesuffix(".yaml"): f for f in folder.iterdir() if f.name.endswith(".yaml")}


def preset_names() -> list[str]:
    """List the names of all shipped maps, sorted.

    Examples
    --------
    >>> "appius" in preset_names()
    True
    """
    return sorted(_preset_files())


@functools.cache
def presets(model: type[Map]) -> Mapping[str, Map]:
    """Read the shipped maps of one kind.

    Parameters
    ----------
    model : :class:`ColumnMap`, or the topic map of :mod:`ges.recordings.readers.ros`.

    Returns
    -------
    Maps by name, sorted.
    """
    wanted = "topics" if "topics" in model.model_fields else "layouts"
    files = {name: yaml.safe_load(f.read_text("utf-8")) for name, f in _preset_files().items()}
    return {n: model.model_validate(c) for n, c in sorted(files.items()) if wanted in c}


def load_map(given: str | Path, model: type[Map]) -> Map:
    """Read a map.

    Parameters
    ----------
    given : a YAML file, or the name of a preset.
    model : kind of map, see :func:`presets`.

    Returns
    -------
    The map, checked.

    Raises
    ------
    GesError
        When it cannot be read.
    UsageError
        When there is no such map, or its content is wrong; one sentence on what.
    """
    path = Path(given)
    if path.suffix not in (".yaml", ".yml") and not path.is_file():
        known = presets(model)
        if str(given) not in known:
            raise unknown_name("map (a YAML file or a preset)", str(given), known)
        return known[str(given)]
    try:
        return model.model_validate(read_yaml(path, "map"))
    except pydantic.ValidationError as error:
        raise UsageError(f"{path.name}: {_sentence(error.errors(), model)}") from None


def _sentence(problems: list[ErrorDetails], model: type[pydantic.BaseModel]) -> str:
    # a misspelt key is told before the one that seems missing because of it
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    if problem["type"] == "extra_forbidden":
        return str(unknown_name("key", str(problem["loc"][-1]), _keys(model)))
    parts = (str(p) for p in problem["loc"] if not str(p).startswith(("list[", "dict[")))
    return f"{'.'.join(parts) or 'the file'}: {problem['msg']}"


def _keys(annotation: Any) -> set[str]:
    """Collect the keys of a model and of the models in it."""
    if isinstance(annotation, type) and issubclass(annotation, pydantic.BaseModel):
        fields = annotation.model_fields
        return set(fields).union(*(_keys(field.annotation) for field in fields.values()))
    return set().union(*map(_keys, get_args(annotation)))


def convert(values: np.ndarray, column: Column) -> np.ndarray:
    """Convert a column of a file to the quantity that it stands for.

    Parameters
    ----------
    values : (n,) in the file's unit.
    column : where it goes.

    Returns
    -------
    Values (n,) in the unit of ``column.to``; NaN where missing.

    Raises
    ------
    UsageError
        When the unit does not suit the column.
    """
    # a name without meaning here may still tell an angle (roll_rad)
    target = unit_of(column.to) or ("rad" if column.to.endswith("_rad") else None)
    scale = unit_factor(column.unit, target) if column.unit else 1.0
    # before the unit: the file states it in its own numbers
    if column.missing is not None:
        values = np.where(values == column.missing, np.nan, values)
    return values * (scale * column.factor) + column.offset


def in_contract(columns: Mapping[str, np.ndarray], axes: str = "enu-flu") -> dict[str, np.ndarray]:
    """Bring columns into the package's frames: world ENU, body FLU.

    Angles become the quaternion. A velocity along the body's axes is turned into the world. A world
    acceleration becomes the specific force.

    Parameters
    ----------
    columns : (n,) by name, SI.
    axes : ``enu-flu``, or ``ned-frd`` for columns in NED and FRD.

    Returns
    -------
    Columns (n,) by name.

    Raises
    ------
    UsageError
        When a vector that must be turned lacks a component or the attitude.
    """
    # in the file's own axes first, as its angles and body velocity belong to each other there
    out = frames.with_quaternion(columns)
    if unknown := [name for name in out if re.fullmatch("v_body_[xyz]_m_s", name)]:
        if not all(name in out for name in (*frames.BODY_VELOCITY, *QUATERNION)):
            raise UsageError(
                f"the map sends a column to {unknown[0]}, which needs the other two of"
                f" {', '.join(frames.BODY_VELOCITY)} and the attitude beside it"
            )
        out = frames.with_world_velocity(out)
    if axes == "ned-frd":
        for names in (POSITION, VELOCITY, POSITION_REF, VELOCITY_REF, frames.WORLD_ACCELERATION):
            out |= _turned(out, names, frames.enu_from_ned)
        for names in (BODY_RATE, SPECIFIC_FORCE):
            out |= _turned(out, names, lambda *frd: frames.flu_from_frd(frd))
        out |= _turned(out, QUATERNION, lambda *q: frames.attitude_from_ned(np.stack(q)))
        if "yaw_ref_rad" in out:
            out["yaw_ref_rad"] = frames.yaw_from_heading(out["yaw_ref_rad"])
    # last, as gravity is along z in the contract's world alone
    return frames.with_specific_force(out)


def _turned(
    columns: Mapping[str, np.ndarray],
    names: tuple[str, ...],
    turn: Callable[..., Iterable[np.ndarray]],
) -> dict[str, np.ndarray]:
    """Turn a vector into other axes.

    Raises
    ------
    UsageError
        When some of its components are missing, as no column may lie about its axis.
    """
    present = [name for name in names if name in columns]
    if len(present) == len(names):
        return dict(zip(names, turn(*(columns[name] for name in names)), strict=True))
    if present:
        raise UsageError(
            f"the map sends columns to {', '.join(present)} in other axes, but not to all of"
            f" {', '.join(names)}; map the whole vector"
        )
    return {}
