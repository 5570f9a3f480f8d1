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

from ..errors import GesError, UsageError
from .recording import unit_of

EULER = ("roll_rad", "pitch_rad", "yaw_rad")


class Column(pydantic.BaseModel):
    """Where one column goes: name, unit in the file, factor (a sign, or a full scale) and offset after the unit."""

    model_config = pydantic.ConfigDict(extra="forbid")

    to: str
    unit: str | None = None
    factor: float = 1.0
    offset: float = 0.0


class Layout(pydantic.BaseModel):
    """One arrangement of columns: a list for files without a header (null: skip), names for files with one."""

    model_config = pydantic.ConfigDict(extra="forbid")

    columns: list[Column | None] | dict[str, Column]


class ColumnMap(pydantic.BaseModel):
    """A column map file."""

    model_config = pydantic.ConfigDict(extra="forbid")

    separator: str = ","
    layouts: list[Layout] = pydantic.Field(min_length=1)


@functools.cache
def _units() -> pint.UnitRegistry:
    return pint.UnitRegistry()


@functools.cache
def unit_factor(unit: str, target: str | None) -> float:
    """Factor from one unit to another (or to SI base units where no target is set)."""
    try:
        quantity = _units().Quantity(1.0, unit)
        return float((quantity.to(target) if target and target != "1" else quantity.to_base_units()).magnitude)
    except pint.errors.UndefinedUnitError:
        raise UsageError(f"unit '{unit}' of the column map is not known; write it as in 'deg', 'rpm', 'mV', 'm/s'") from None
    except pint.errors.DimensionalityError:
        raise UsageError(f"unit '{unit}' of the column map cannot become {target}; check the column") from None


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
        problem = error.errors()[0]
        raise UsageError(f"{path.name}: {'.'.join(map(str, problem['loc']))}: {problem['msg']}") from None


def convert(values: np.ndarray, column: Column) -> np.ndarray:
    """A column in the file's unit as the quantity it stands for."""
    target = unit_of(column.to) or ("rad" if column.to.endswith("_rad") else None)
    scale = unit_factor(column.unit, target) if column.unit else 1.0
    return values * (scale * column.factor) + column.offset


def quaternion(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Hamilton quaternion body-to-world of shape (4, n) from yaw-pitch-roll (z-y-x) angles in radians."""
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    return np.stack([cy * cp * cr + sy * sp * sr, cy * cp * sr - sy * sp * cr, cy * sp * cr + sy * cp * sr,
                     sy * cp * cr - cy * sp * sr])  # fmt: skip


def with_quaternion(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Add the quaternion where roll, pitch and yaw are all there; incomplete angles stay as they are."""
    out = dict(columns)
    if all(name in out for name in EULER):
        for name, values in zip(("q_w", "q_x", "q_y", "q_z"), quaternion(*(out.pop(n) for n in EULER)), strict=True):
            out[name] = values
    return out


def increasing(frame: pd.DataFrame, name: str) -> tuple[pd.DataFrame, list[str]]:
    """Drop rows whose time does not go on; say how many."""
    t = frame["t_s"].to_numpy()
    if not np.all(np.isfinite(t)):
        raise GesError(f"{name}: the time column is not a number in row {int(np.argmin(np.isfinite(t)))}; every row needs its time")
    keep = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]])
    dropped = int(np.sum(~keep))
    warning = [f"{name}: {dropped} rows repeat an earlier time and were dropped"] if dropped else []
    return frame[keep].reset_index(drop=True), warning
