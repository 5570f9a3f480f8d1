"""Findings with their fitted parameters, and their form in diagnosis.json."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from ges.conventions import SDS_95
from ges.diagnose.types.keys import ParameterKey
from ges.simulator import effects as effect_table


def interval95(value: float, sd: float) -> tuple[float, float]:
    """Compute the 95 % interval of a Gaussian, (low, high), from its mean and sd.

    Examples
    --------
    >>> interval95(10.0, 1.0)
    (8.04, 11.96)
    """
    return (value - SDS_95 * sd, value + SDS_95 * sd)


@dataclasses.dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter.

    Attributes
    ----------
    value : estimate, in ``unit``.
    ci95 : 95 % interval, (low, high), in ``unit``; within what the library allows.
    unit : ``1`` where it has none.
    note : what to know about it; '' for nothing.
    """

    value: float
    ci95: tuple[float, float]
    unit: str
    note: str = ""

    @classmethod
    def of(cls, key: str, value: float, sd: float, note: str = "") -> FittedParameter:
        """Make the estimate of a parameter of an effect, in its unit.

        Parameters
        ----------
        key : ``effect.parameter``.
        value, note : as the attributes.
        sd : of the value.
        """
        effect, parameter = ParameterKey.of(key)
        p = effect_table.get(effect).parameter(parameter)
        low, high = interval95(value, sd)
        # of a number that the library bounds no interval reaches beyond: no inertia is negative
        if p.low <= value <= p.high:
            low, high = max(low, p.low), min(high, p.high)
        return cls(value, (low, high), p.unit, note)

    def content(self) -> dict[str, Any]:
        """Give ``value``, ``ci95``, ``unit``, and ``note`` where there is one, as JSON has them."""
        content = {"value": self.value, "ci95": list(self.ci95), "unit": self.unit}
        return {**content, "note": self.note} if self.note else content


@dataclasses.dataclass(frozen=True)
class Finding:
    """A cause of the difference between simulator and flights.

    Attributes
    ----------
    name : name of the effect.
    kind : ``physics``, ``parameter`` or ``sensor``.
    title : the effect in words.
    probability : posterior probability, 0 to 1, after the correction of docs/reference.md.
    equation : formula of the effect.
    parameters : fitted parameters, by name.
    size : ``value`` (rms) and ``unit`` in the ``channel`` where the effect is largest,
        ``share_of_weight`` there. Empty where it was not fitted.
    alternatives : ``name`` and ``log_odds`` of other effects in its place; negative odds are
        against them.
    is_open : whether the flights cannot tell it from others.
    place : where it acts, as ``rotor 3``, if in one of several places; else ''.
    rival_law : ``channel``, ``form`` and ``log_odds`` of the law that could stand in its place, of
        as many numbers. Empty where none could; negative odds are against the law.

    Examples
    --------
    >>> drag = found.findings[0]
    >>> print(drag.title, "|", drag.equation)
    rotor drag, linear in air speed | F_i = -k w_i (V + omega x r_i)_xy, M_i = l r_i x F_i
    >>> low, high = drag.parameters["k_kg"].ci95
    >>> low < 6e-5 < high  # what acted when the flights were simulated
    True
    """

    name: str
    kind: str
    title: str
    probability: float
    equation: str
    parameters: Mapping[str, FittedParameter]
    size: Mapping[str, Any]
    alternatives: tuple[Mapping[str, Any], ...]
    is_open: bool = False
    place: str = ""
    rival_law: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls,
        name: str,
        probability: float,
        parameters: Mapping[str, FittedParameter],
        size: Mapping[str, Any] | None = None,
        alternatives: tuple[Mapping[str, Any], ...] = (),
        is_open: bool = False,
        place: str = "",
    ) -> Finding:
        """Make the finding of an effect of the library.

        Parameters
        ----------
        name : name of the effect; it gives kind, title and equation.
        probability, parameters, size, alternatives, is_open, place : as the attributes.

        Raises
        ------
        UsageError
            When the library has no such effect.
        """
        effect = effect_table.get(name)
        return cls(
            name,
            effect.about,
            effect.title,
            probability,
            effect.equation,
            parameters,
            size or {},
            alternatives,
            is_open,
            place,
        )

    def content(self) -> dict[str, Any]:
        """Give the finding as an entry of ``findings`` in diagnosis.json.

        Returns
        -------
        The attributes by name, ``is_open`` as ``open``.
        """
        content = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        content["open"] = content.pop("is_open")
        content["parameters"] = {name: e.content() for name, e in self.parameters.items()}
        return content


def json_values(value: Any) -> Any:
    """Convert a value to plain JSON.

    Parameters
    ----------
    value : mappings, lists, tuples, numbers and numpy scalars, nested at will.

    Returns
    -------
    The same with floats of six significant digits; None in place of NaN and infinity.
    """
    if isinstance(value, Mapping):
        return {str(k): json_values(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(v) for v in value]
    # numpy's scalars are not JSON's
    if hasattr(value, "item"):
        value = value.item()
    # JSON has no NaN and no infinity
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
