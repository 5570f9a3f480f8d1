"""What a diagnosis says, as the contract writes it."""

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
    """95 % interval of a Gaussian."""
    return (value - SDS_95 * sd, value + SDS_95 * sd)


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted parameter: value, 95 % interval, unit, and what to know about it."""

    value: float
    ci95: tuple[float, float]
    unit: str
    note: str = ""

    def content(self) -> dict[str, Any]:
        """As JSON."""
        told = {"value": self.value, "ci95": list(self.ci95), "unit": self.unit}
        return {**told, "note": self.note} if self.note else told


@dataclasses.dataclass(frozen=True)
class Finding:
    """One named cause; ``is_open`` where the flights cannot tell it from others, ``place`` where it
    acts in one of several, ``rotor 3``.
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
        """An effect of the library; without a ``size`` where no fit was made with it."""
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
        """As JSON."""
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
    """Verdict, findings, laws and proof.

    ``content()`` is diagnosis.json, ``vehicle`` the fitted vehicle file, ``origin`` what it was
    made from, ``remark`` what there is to say beside the sentence, and ``workings``, of
    :mod:`ges.diagnose.report.workings`, what figures are drawn from.
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
        """Verdict, sentence and findings, as a notebook shows them."""
        rows = "".join(
            f"<tr><td>{html.escape(f.title)} {html.escape(f.place)}</td>"
            f"<td>{f.probability:.2f}</td><td>{html.escape(_numbers(f.parameters))}</td></tr>"
            for f in self.findings
        )
        head = "<tr><th>finding</th><th>probability</th><th>fitted, 95 % interval</th></tr>"
        said = f"<p><b>{html.escape(self.verdict)}</b>: {html.escape(self.sentence)}</p>"
        return said + (f"<table>{head}{rows}</table>" if rows else "")

    def content(self) -> dict[str, Any]:
        """diagnosis.json."""
        return cleaned(
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


def cleaned(value: Any) -> Any:
    """Plain JSON: numpy scalars as numbers, six significant digits, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(k): cleaned(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [cleaned(v) for v in value]
    # numpy's scalars are not JSON's
    if hasattr(value, "item"):
        value = value.item()
    # JSON has no NaN and no infinity
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
