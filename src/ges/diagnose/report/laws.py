"""Laws as diagnosis.json and the page show them, with the nearest physics in words."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.locate.laws import RivalLaw
from ges.diagnose.types.finding import Finding, interval95
from ges.diagnose.types.words import channel_words
from ges.simulator.laws import Term, groups, written
from ges.vehicle.file import Law

DIGITS = 3
"""Significant digits of a coefficient where it is read and not flown."""


def laws_content(laws: Sequence[FittedLaw]) -> list[dict[str, Any]]:
    """Return ``laws`` of diagnosis.json.

    Parameters
    ----------
    laws : that were fitted.
    """
    return [
        {
            "channel": law.channel,
            "form": written(law.coefficients, DIGITS),
            "terms": [
                {
                    "term": term.text,
                    "coefficient": c,
                    "ci95": list(interval95(c, law.sd[term])),
                }
                for term, c in law.coefficients.items()
            ],
            "regime": law.structure.bounds,
            "r2": law.r2,
            "size": dict(law.size),
            "reads_as": reads_as(law.channel, law.coefficients, law.size),
        }
        for law in laws
    ]


def with_rival_laws(findings: Sequence[Finding], rivals: Mapping[str, RivalLaw]) -> list[Finding]:
    """Return findings with the laws that could stand in their place.

    Parameters
    ----------
    findings : of the diagnosis.
    rivals : by name.
    """
    return [
        dataclasses.replace(f, rival_law=_rival_content(rivals[f.name]))
        if f.name in rivals and not f.is_open
        else f
        for f in findings
    ]


def _rival_content(law: RivalLaw) -> dict[str, Any]:
    return {
        "channel": law.channel,
        "form": written(law.coefficients, DIGITS) if law.coefficients else "0",
        "log_odds": law.log_odds,
    }


def vehicle_laws(before: Sequence[Law], fitted: Sequence[FittedLaw]) -> tuple[Law, ...]:
    """Return the laws of the fitted vehicle file.

    Parameters
    ----------
    before : laws of the vehicle file.
    fitted : laws that were fitted; they replace coefficients of terms that both have.
    """
    terms: dict[str, dict[Term, tuple[float, float]]] = {}
    for law in before:
        sd = law.sd or (0.0,) * len(law.terms())
        terms[law.channel] = {t: (c, s) for (t, c), s in zip(law.terms().items(), sd, strict=True)}
    for new in fitted:
        terms.setdefault(new.channel, {}).update(
            {t: (c, new.sd[t]) for t, c in new.coefficients.items()}
        )
    return tuple(
        Law(
            channel=channel,
            form=written({t: c for t, (c, _) in by.items()}),
            sd=tuple(s for _, s in by.values()),
        )
        for channel, by in terms.items()
    )


def reads_as(channel: str, coefficients: Mapping[Term, float], size: Mapping[str, Any]) -> str:
    """Return what the largest term of a law looks like, and the nearest physics.

    Parameters
    ----------
    channel : response of the law.
    coefficients : by term.
    size : of the law.
    """
    term = max(coefficients, key=lambda t: abs(coefficients[t]))
    used = [
        g for g, n, m in zip(groups().values(), term.power, term.magnitude, strict=True) if n or m
    ]
    words = channel_words(channel)
    if term.local:
        x, y, width = term.near_m
        where = f"{words} near x {x:g} m, y {y:g} m, within {width:g} m"
        return f"{where}: {_nearest(channel, 'x')}"
    if not used:
        return f"{words} that is always there: a trim, or a number of the vehicle file that is off"
    grows = " and ".join(g.doc.removesuffix(", relative to the air") for g in used)
    return f"{words} that follows {grows}: {_nearest(channel, used[0].quantity)}"


def _nearest(channel: str, quantity: str) -> str:
    """Return physics that makes a channel depend on a quantity."""
    kind, axis = channel.split("_")
    own = {"x": ("V_x", "p"), "y": ("V_y", "q"), "z": ("V_z", "r")}[axis]
    if quantity == "R":
        return "a ground effect of another form, or a thrust that the ground turns"
    if quantity in ("x", "y"):
        return "something at a place: a draught, a thread, an obstacle or a wrong map"
    if quantity in ("w", "U"):
        return "the drive: a thrust curve or a battery of another form"
    if quantity in ("p", "q", "r"):
        same = quantity in own
        return "a damping of the turn" if same and kind == "moment" else "a coupling of the turns"
    if kind == "moment":
        return "a frame or a flapping rotor whose centre of pressure is off the centre of mass"
    if quantity in own:
        drag = "a drag of another form"
        return f"an axial inflow, or {drag}" if axis == "z" else drag
    if axis == "z":
        return "a lift of the frame or of the rotors in forward flight"
    return "an asymmetric frame, or a thrust that is turned in yaw"
