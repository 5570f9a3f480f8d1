"""A vehicle with the source of each of its numbers, written as a vehicle file with comments."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Mapping
from typing import Any

import yaml

from ges.vehicle.file import Vehicle, vehicle_content

COLUMNS = 100
EXACT_DIGITS = 6
SD_DIGITS = 2


@dataclasses.dataclass(frozen=True)
class Datasheet:
    """A vehicle with the source of each of its numbers.

    Attributes
    ----------
    vehicle : content of the vehicle file.
    origin : what was read, in a sentence or two at the head of the file.
    sources : by key of the vehicle file, or ``effects.NAME``: where the number and its sd come
        from.
    remarks : what the source says and a vehicle file cannot, one sentence each.
    """

    vehicle: Vehicle
    origin: str
    sources: Mapping[str, str] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def renamed(self, name: str) -> Datasheet:
        """Give the vehicle another name; sources stay."""
        return dataclasses.replace(self, vehicle=self.vehicle.model_copy(update={"name": name}))

    def to_yaml(self) -> str:
        """Write the vehicle file with sources as comments.

        Returns
        -------
        YAML text. A number with an sd is rounded to the second digit of the sd, others to six
        digits.
        """
        content = _rounded(vehicle_content(self.vehicle))
        effects = content.pop("effects")
        lines = [line for text in (self.origin, *self.remarks) for line in comment(text)]
        for key, value in content.items():
            lines += [*comment(self.sources.get(key, "")), *_entry(key, value)]
        lines.append("effects:" if effects else "effects: {}")
        for name, values in effects.items():
            entry = [*comment(self.sources.get(f"effects.{name}", "")), *_entry(name, values)]
            lines += [f"  {line}" for line in entry]
        return "\n".join(lines) + "\n"


def comment(text: str, mark: str = "# ") -> list[str]:
    """Wrap a text into comment lines.

    Parameters
    ----------
    text : '' gives no line.
    mark : what every line begins with.

    Returns
    -------
    Lines of at most 98 characters.
    """
    wrapped = textwrap.wrap(
        text, COLUMNS - 2 - len(mark), break_long_words=False, break_on_hyphens=False
    )
    return [mark + line for line in wrapped]


def _entry(key: str, value: Any) -> list[str]:
    if isinstance(value, list):
        return [f"{key}:", *(f"  - {_flow(item)}" for item in value)]
    return [f"{key}: {_flow(value)}"]


def _flow(value: Any) -> str:
    # a bare number ends in YAML's mark of a document's end
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=math.inf)
    return text.removesuffix("...\n").strip()


def _rounded(value: Any) -> Any:
    """Round floats to six digits, or to the second digit of their sd."""
    if isinstance(value, dict):
        if value.get("sd"):
            digits = _digits(value["value"], value["sd"])
            return {**value, "value": _float(value["value"], digits), "sd": _float(value["sd"])}
        return {key: _rounded(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    return _float(value, EXACT_DIGITS) if isinstance(value, float) else value


def _digits(value: float, sd: float) -> int:
    """Count the significant digits of a value down to the second digit of its sd."""
    if value == 0.0:
        return SD_DIGITS
    # 1234.5678 with an sd of 0.31 is written 1234.57
    return max(SD_DIGITS, SD_DIGITS + math.floor(math.log10(abs(value)) - math.log10(sd)) + 1)


def _float(value: float, digits: int = SD_DIGITS) -> float:
    return float(f"{value:.{digits}g}")
