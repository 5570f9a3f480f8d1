"""Numbers that the text of the paper quotes, ready to print: every claim's, and those that
``numbers.yaml`` names.
"""

from __future__ import annotations

import json
import math
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import yaml

from ges.files import write_json
from ges.study.claims import (
    DIRECTION,
    NOT,
    REPRODUCED,
    UNMEASURED,
    Ours,
    Strict,
    Where,
    look,
    read_tables,
)

MILLIMETRES = 1.0
"""Metres below this are printed in millimetres."""
ABSENT = "n/a"
RAISED = str.maketrans(
    "-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)


class Quoted(Strict):
    """A number that the text of the paper quotes.

    Attributes
    ----------
    table, where, value : table below ``results``, row and column.
    minus : row whose number is subtracted, as a change of ``where``.
    reduce : what is made of several rows that fit.
    scale : factor on the number.
    unit : of the number; '1' without one.
    digits : significant digits to print.
    """

    table: str
    where: Where = {}
    minus: Where | None = None
    value: str
    reduce: Literal["max", "min", "mean", "sum", "count", "first"] | None = None
    scale: float = 1.0
    unit: str = "1"
    digits: int = 3


def digits(value: float, significant: int = 3, count: bool = True) -> str:
    """Return a number as it is printed.

    Parameters
    ----------
    value : any number; one that is not finite prints as :data:`ABSENT`.
    significant : digits.
    count : whether whole numbers are counts, which print without decimals; zero always does.

    Returns
    -------
    With a true minus, and without an exponent down to 1e-4.
    """
    if not math.isfinite(value):
        return ABSENT
    if value == round(value) and abs(value) < 1e6 and (count or value == 0):
        return f"{value:.0f}".replace("-", "\u2212")
    text = f"{value:#.{significant}g}" if abs(value) >= 1e-4 else f"{value:.{significant - 1}e}"
    # of large numbers, too, the format makes an exponent: those are printed in full
    if "e" in text and abs(value) >= 1e-4:
        text = f"{value:.0f}"
    mantissa, _, exponent = text.partition("e")
    power = f" × 10{str(int(exponent)).translate(RAISED)}" if exponent else ""
    return mantissa.rstrip(".").replace("-", "\u2212") + power


def entry(result: Ours | None, unit: str, significant: int = 3) -> dict[str, Any]:
    """Return a number with its interval, as values and as text.

    Parameters
    ----------
    result : the number; None prints as :data:`ABSENT`.
    unit : SI; metres below :data:`MILLIMETRES` are printed in millimetres.
    significant : digits.

    Returns
    -------
    ``value``, ``ci95`` and ``unit`` in SI, ``text``, and ``full``, which has the interval as well.
    """
    if result is None or not math.isfinite(result.value):
        return {"value": None, "ci95": None, "unit": unit, "text": ABSENT, "full": ABSENT}
    factor, name = (
        (1000.0, "mm") if unit == "m" and abs(result.value) < MILLIMETRES else (1.0, unit)
    )
    suffix = "" if name == "1" else f"\u202f{name}"
    has = math.isfinite(result.low) and math.isfinite(result.high)
    span = [result.low, result.high]
    # what has an interval was measured: it keeps its digits where it happens to be whole
    value, low, high = (
        digits(factor * v, significant, count=not has) for v in (result.value, *span)
    )
    text = value + suffix
    full = f"{value} [{low}, {high}]{suffix}" if has else text
    return {
        "value": result.value,
        "ci95": span if has else None,
        "unit": unit,
        "text": text,
        "full": full,
    }


def _claims(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Entries of every claim, and how many of the paper's own have each verdict."""
    made: dict[str, dict[str, Any]] = {}
    for row in table.to_dict("records"):
        result = Ours(
            **{k: float(row[c]) for k, c in (("value", "ours"), ("low", "low"), ("high", "high"))}
        )
        made[row["id"]] = {
            **entry(result, row["unit"]),
            "paper": _published(row),
            "verdict": row["verdict"],
        }
    own = table[table["derived"] != "yes"]
    for verdict in (REPRODUCED, DIRECTION, NOT, UNMEASURED):
        made[f"claims.{verdict.replace(' ', '_')}"] = entry(
            Ours(value=float((own["verdict"] == verdict).sum())), "1"
        )
    fitted = own[(own["fitted"] == "yes") & (own["verdict"] == REPRODUCED)]
    counts = {
        "claims.all": len(own),
        "claims.derived": len(table) - len(own),
        "claims.reproduced_fitted": len(fitted),
    }
    return made | {name: entry(Ours(value=float(count)), "1") for name, count in counts.items()}


def _published(row: dict[str, Any]) -> str:
    """The paper's value in the unit that ours is printed in."""
    try:
        return entry(Ours(value=float(row["paper"])), row["unit"])["text"]
    except ValueError:
        return str(row["paper"])


LISTED = Path(str(resources.files("ges.study") / "numbers.yaml"))


def quoted(listed: Path = LISTED) -> dict[str, Quoted]:
    """Return the numbers that a file names.

    Parameters
    ----------
    listed : YAML of numbers by name.
    """
    content = yaml.safe_load(listed.read_text())
    return {name: Quoted.model_validate(spec) for name, spec in content.items()}


def _looked_up(frame: pd.DataFrame, spec: Quoted) -> Ours | None:
    """Return the number that is asked for.

    A difference of two rows has no interval, since they are not independent.
    """
    result = look(frame, spec.where, spec.value, spec.reduce)
    if result is None or spec.minus is None:
        return result
    other = look(frame, {**spec.where, **spec.minus}, spec.value, spec.reduce)
    return other and Ours(value=result.value - other.value)


def write_numbers(
    listed: Path, claims: Path, tables: list[Path], results: Path, numbers: Path
) -> None:
    """Write every number that the paper may quote.

    Parameters
    ----------
    listed : the numbers (YAML).
    claims : table of :func:`claims.write_claims`.
    tables : results to look into; named in ``listed`` relative to ``results``.
    results : folder of the results.
    numbers : to write (JSON): entries by name. One whose table or row is missing prints as
        :data:`ABSENT`.
    """
    made, read = _claims(pd.read_csv(claims)), read_tables(tables, results)
    for name, spec in quoted(listed).items():
        frame = read.get(spec.table)
        result = None if frame is None or frame.empty else _looked_up(frame, spec)
        if result is not None:
            result = Ours(
                value=spec.scale * result.value,
                low=spec.scale * result.low,
                high=spec.scale * result.high,
            )
        made[name] = entry(result, spec.unit, spec.digits)
    write_json(numbers, json.loads(json.dumps(made)))
