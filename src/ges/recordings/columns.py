"""Column maps: what each column of a foreign log is, in which unit and with which sign (YAML)."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pint
import pydantic
import yaml

from ges.conventions import GRAVITY_M_S2, QUATERNION, SPECIFIC_FORCE
from ges.errors import GesError, UsageError, unknown_name
from ges.recordings.recording import unit_of

EULER = ("roll_rad", "pitch_rad", "yaw_rad")
WORLD_ACCELERATION = ("acc_world_x_m_s2", "acc_world_y_m_s2", "acc_world_z_m_s2")


class Column(pydantic.BaseModel):
    """Where one column goes.

    Attributes
    ----------
    to : column of the recording set; a name without meaning there is kept and ignored.
    unit : unit in the file; that of the column if not given. ``g`` is the standard acceleration of
        gravity.
    factor, offset : after the unit: a sign, a full scale, a zero.
    missing : number by which the file says that a sample is missing (besides an empty field and
        nan).
    """

    model_config = pydantic.ConfigDict(extra="forbid")

    to: str
    unit: str | None = None
    factor: float = 1.0
    offset: float = 0.0
    missing: float | None = None


class Layout(pydantic.BaseModel):
    """One arrangement of columns: a list for files without a header (null: skip), names for files
    with one.
    """

    model_config = pydantic.ConfigDict(extra="forbid")

    columns: list[Column | None] | dict[str, Column]


class ColumnMap(pydantic.BaseModel):
    """A column map file."""

    model_config = pydantic.ConfigDict(extra="forbid")

    separator: str = ","
    layouts: list[Layout] = pydantic.Field(min_length=1)


@functools.cache
def _units() -> pint.UnitRegistry:
    registry = pint.UnitRegistry(on_redefinition="ignore")
    registry.define("g = 9.80665 * meter / second ** 2")
    return registry


@functools.cache
def unit_factor(unit: str, target: str | None) -> float:
    """Factor from one unit to another (or to SI base units where no target is set)."""
    try:
        quantity = _units().Quantity(1.0, unit)
        return float((quantity.to(target) if target and target != "1" else quantity.to_base_units()).magnitude)
    except (pint.errors.UndefinedUnitError, pint.errors.DefinitionSyntaxError, AssertionError):
        raise UsageError(f"unit '{unit}' of the column map is not known; write it as in 'deg', 'rpm', 'mV', 'm/s'") from None
    except pint.errors.DimensionalityError:
        raise UsageError(f"unit '{unit}' of the column map cannot become {target}; check the column") from None


def _sentence(problems: list[dict]) -> str:
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    if problem["type"] == "extra_forbidden":
        known = {key for model in (ColumnMap, Layout, Column) for key in model.model_fields}
        return str(unknown_name("key", str(problem["loc"][-1]), known))
    place = ".".join(str(p) for p in problem["loc"] if not str(p).startswith(("list[", "dict["))) or "the file"
    return f"{place}: {problem['msg']}"


def load_map(path: str | Path) -> ColumnMap:
    """Read a column map; one sentence names what is wrong with it."""
    path = Path(path)
    try:
        return ColumnMap.model_validate(yaml.safe_load(path.read_text()))
    except OSError as error:
        raise GesError(f"cannot read the column map {path}: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise UsageError(f"{path.name} is not YAML: {str(error).splitlines()[0]}") from None
    except pydantic.ValidationError as error:
        raise UsageError(f"{path.name}: {_sentence(error.errors())}") from None


def convert(values: np.ndarray, column: Column) -> np.ndarray:
    """A column in the file's unit as the quantity it stands for."""
    target = unit_of(column.to) or ("rad" if column.to.endswith("_rad") else None)
    scale = unit_factor(column.unit, target) if column.unit else 1.0
    values = values if column.missing is None else np.where(values == column.missing, np.nan, values)
    return values * (scale * column.factor) + column.offset


def quaternion(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Hamilton quaternion body-to-world of shape (4, n) from yaw-pitch-roll (z-y-x) angles in
    radians.
    """
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    return np.stack([cy * cp * cr + sy * sp * sr, cy * cp * sr - sy * sp * cr, cy * sp * cr + sy * cp * sr,
                     sy * cp * cr - cy * sp * sr])


def with_quaternion(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Add the quaternion where roll, pitch and yaw are all there; incomplete angles stay as they
    are.
    """
    out = dict(columns)
    if all(name in out for name in EULER):
        for name, values in zip(QUATERNION, quaternion(*(out.pop(n) for n in EULER)), strict=True):
            out[name] = values
    return out


def with_specific_force(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turn a world acceleration without gravity into the body's specific force where the whole
    attitude was logged.
    """
    out = dict(columns)
    if all(name in out for name in (*QUATERNION, *WORLD_ACCELERATION)) and not any(name in out for name in SPECIFIC_FORCE):
        world = [out.pop(name) for name in WORLD_ACCELERATION]
        world[2] = world[2] + GRAVITY_M_S2
        w, x, y, z = (out[name] for name in QUATERNION)
        rows = ((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
                (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
                (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
        for name, row in zip(SPECIFIC_FORCE, rows, strict=True):
            out[name] = sum(r * a for r, a in zip(row, world, strict=True))
    return out


def increasing(frame: pd.DataFrame, name: str) -> tuple[pd.DataFrame, list[str]]:
    """Drop rows whose time does not go on; say how many."""
    t = frame["t_s"].to_numpy()
    if not np.all(np.isfinite(t)):
        raise GesError(
            f"{name}: the time column is not a number in row {int(np.argmin(np.isfinite(t)))}; every row needs its time"
        )
    keep = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]])
    dropped = int(np.sum(~keep))
    warning = [f"{name}: {dropped} rows repeat an earlier time and were dropped"] if dropped else []
    return frame[keep].reset_index(drop=True), warning
