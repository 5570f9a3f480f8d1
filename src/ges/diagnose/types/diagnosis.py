"""The result of a diagnosis, and its form as diagnosis.json."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Mapping
from typing import Any

from ges.conventions import SDS_95
from ges.diagnose.types.decision import Considered
from ges.simulator import effects as effect_table
from ges.vehicle.file import Vehicle


def interval95(value: float, sd: float) -> tuple[float, float]:
    """Compute the 95 % interval of a Gaussian, (low, high), from its mean and sd.

    Examples
    --------
    >>> interval95(10.0, 1.0)
    (8.04, 11.96)
    """
    return (value - SDS_95 * sd, value + SDS_95 * sd)


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    Attributes
    ----------
    value : estimate, in ``unit``.
    ci95 : 95 % interval, (low, high), in ``unit``.
    unit : ``1`` where it has none.
    note : what to know about it; '' for nothing.
    """

    value: float
    ci95: tuple[float, float]
    unit: str
    note: str = ""

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

    Examples
    --------
    >>> drag = found.findings[0]
    >>> print(drag.title, "|", drag.equation)
    rotor drag, linear in air speed | F_i = -k w_i (V + omega x r_i)_xy
    >>> low, high = drag.parameters["k_kg"].ci95
    >>> low < 6e-5 < high  # what acted when the flights were simulated
    True
    """

    name: str
    kind: str
    title: str
    probability: float
    equation: str
    parameters: Mapping[str, Estimate]
    size: Mapping[str, Any]
    alternatives: tuple[Mapping[str, Any], ...]
    is_open: bool = False
    place: str = ""

    @classmethod
    def of(
        cls,
        name: str,
        probability: float,
        parameters: Mapping[str, Estimate],
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
        return {
            "name": self.name,
            "kind": self.kind,
            "title": self.title,
            "probability": self.probability,
            "equation": self.equation,
            "parameters": {name: e.content() for name, e in self.parameters.items()},
            "size": dict(self.size),
            "alternatives": [dict(a) for a in self.alternatives],
            "open": self.is_open,
            "place": self.place,
        }


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    Attributes
    ----------
    verdict : ``nothing_proven``, ``parameter``, ``sensor``, ``physics``, ``ambiguous``, ``law`` or
        ``unknown``.
    remark : what is to be said besides the sentence; '' for nothing.
    origin : ``vehicle``, ``flights`` with the part each took, and ``version``; of a run also file
        hashes and command.
    findings : causes: proven ones, the largest first, then settled and nominal parameters, then
        open ones.
    located : where the residual is largest: ``channel``, ``regime`` with its bounds,
        ``share_of_excess``, ``mean``, ``q_value``.
    laws : fitted laws: ``channel``, ``form``, ``terms`` with 95 % intervals, ``regime``, ``size``.
    unexplained : residual structure with neither cause nor law: ``channel``, ``regime``, ``r2``,
        ``q_value``, ``rms``.
    fit : errors on ``holdout_flights``. ``channels`` has rms ``before``, ``recalibrated`` and
        ``after``, and ``rollout`` the same of open-loop simulation.
    detectable : by effect the ``smallest`` size of ``parameter`` that these flights would show;
        None where they show none.
    next_flight : ``manoeuvre`` that separates what is open, and what it separates; empty where
        nothing is open.
    data : flights, seconds, channels, delays and instruments used, and ``warnings``.
    calibration : correction of each nominal parameter, with its 95 % interval and its stated sd.
    not_tested : by effect, what the recordings lack to test it.
    considered : every candidate with its posterior probability and the decisions about it.
    vehicle : vehicle file with corrections, findings and laws.
    sentence : the result in one sentence.
    workings : intermediate results, from which figures are drawn.

    Examples
    --------
    >>> found.verdict
    'physics'
    >>> errors = found.fit["channels"]["force_x_N"]
    >>> errors["after"] < 0.5 * errors["recalibrated"]
    True
    >>> "battery_sag" in found.not_tested  # no voltage was logged
    True
    """

    verdict: str
    remark: str
    origin: Mapping[str, Any]
    findings: tuple[Finding, ...]
    located: tuple[Mapping[str, Any], ...]
    laws: tuple[Mapping[str, Any], ...]
    unexplained: tuple[Mapping[str, Any], ...]
    fit: Mapping[str, Any]
    detectable: Mapping[str, Mapping[str, Any]]
    next_flight: Mapping[str, Any]
    data: Mapping[str, Any]
    calibration: Mapping[str, Mapping[str, Any]]
    not_tested: Mapping[str, str]
    considered: tuple[Considered, ...]
    vehicle: Vehicle
    sentence: str = ""
    workings: Any = dataclasses.field(default=None, repr=False)

    def __repr__(self) -> str:
        """Verdict and names in one line; ``sentence``, ``findings`` and ``fit`` have the rest."""
        names = [f"{f.name} {f.place}".strip() for f in self.findings]
        names += [law["form"] for law in self.laws]
        return f"Diagnosis({self.verdict}: {', '.join(names) or 'no name'})"

    def _repr_html_(self) -> str:
        """Return verdict, sentence and findings, as a notebook shows them."""
        rows = "".join(
            f"<tr><td>{html.escape(f.title)} {html.escape(f.place)}</td>"
            f"<td>{f.probability:.2f}</td><td>{html.escape(_numbers(f.parameters))}</td></tr>"
            for f in self.findings
        )
        head = "<tr><th>finding</th><th>probability</th><th>fitted, 95 % interval</th></tr>"
        sentence = f"<p><b>{html.escape(self.verdict)}</b>: {html.escape(self.sentence)}</p>"
        return sentence + (f"<table>{head}{rows}</table>" if rows else "")

    def content(self) -> dict[str, Any]:
        """Give the content of diagnosis.json.

        Returns
        -------
        A mapping of plain JSON values: six significant digits, None for a number that is not
        finite.
        """
        return json_values(
            {
                "schema": 1,
                "verdict": self.verdict,
                "sentence": self.sentence,
                "remark": self.remark,
                "origin": dict(self.origin),
                "findings": [f.content() for f in self.findings],
                "located": [dict(item) for item in self.located],
                "laws": [dict(item) for item in self.laws],
                "unexplained": [dict(item) for item in self.unexplained],
                "fit": dict(self.fit),
                "detectable": dict(self.detectable),
                "next_flight": dict(self.next_flight),
                "data": dict(self.data),
                "calibration": dict(self.calibration),
                "not_tested": dict(self.not_tested),
                "considered": [c.content() for c in self.considered],
            }
        )


def _numbers(parameters: Mapping[str, Estimate]) -> str:
    units = {name: "" if e.unit == "1" else f" {e.unit}" for name, e in parameters.items()}
    return "; ".join(
        f"{name} {e.value:.3g} [{e.ci95[0]:.3g}, {e.ci95[1]:.3g}]{units[name]}"
        for name, e in parameters.items()
    )


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
