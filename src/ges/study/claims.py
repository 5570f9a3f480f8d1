"""The paper's claims beside our values, with a verdict by rule.

Claims stand in ``claims.yaml`` with the published value and where ours is to be found. That is a
table below ``results``, the row (``where``) and the column (``value``). The rules of the verdict
are :data:`RULES`, which the paper prints.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import yaml
from pydantic import BaseModel, ConfigDict

from ges.errors import GesError
from ges.files import write_csv, write_json
from ges.study.config import Seeds

CLOSE = 0.05
"""Relative distance from the published value that counts as reproduced where our interval misses
it.
"""

REPRODUCED, DIRECTION = "reproduced", "same direction"
NOT, UNMEASURED = "not reproduced", "not measured"
RULES = {
    "value": (
        "a number: reproduced if we are within a twentieth of it (of 1 - R² for an R²), or our 95 %"
        " interval holds it and reaches less far than the number itself; same direction if ours"
        " lies on the same side of the same baseline (of zero for a difference whose interval"
        " excludes zero)"
    ),
    "sign": (
        "a difference said to be there: reproduced if ours has its sign and an interval that"
        " excludes zero; same direction if it has its sign only"
    ),
    "null": (
        "no difference: same direction if ours is smaller than the stated margin; reproduced if our"
        " interval holds zero, too"
    ),
    "above": (
        "a number said to exceed a bound: reproduced if our interval, or our value where there is"
        " none, lies above it; same direction if only our value does"
    ),
    "below": "the same for a number said to lie below a bound",
    "not_below": (
        "no better (lower) than something: reproduced unless our interval of the difference lies"
        " below zero"
    ),
}


class Strict(BaseModel):
    """Base of what the files of claims and numbers hold; keys that are not listed are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Where = dict[str, str | float]


class Claim(Strict):
    """One claim of the paper, and where our number stands.

    Attributes
    ----------
    id, section, says : name, section of the paper, and the claim in words.
    kind : rule of the verdict, a key of :data:`RULES`.
    paper, paper_text : published value, and how it is printed.
    unit : of both numbers; '1' without one.
    table, where, value : table below ``results``, row and column of our number.
    reduce : what is made of several rows that fit.
    minus : row whose number is subtracted, as a change of ``where``.
    over, over_reduce : row that divides, and what is made of several such rows.
    scale : factor on our number.
    baseline, paper_baseline : row of our baseline, and the published baseline.
    margin : greatest difference that 'null' allows.
    bound : of 'above' and 'below'.
    seeds : seed lists behind our number, separated by spaces.
    fitted : whether the simulator was calibrated to this number, which then tests nothing.
    derived : whether the paper does not make the statement, but it follows from two of its own.
    why : cause of a claim that is not reproduced.
    """

    id: str
    section: str
    says: str
    kind: Literal["value", "sign", "null", "above", "below", "not_below"] = "value"
    paper: float | None = None
    paper_text: str = ""
    unit: str = "1"
    table: str
    where: Where = {}
    value: str
    reduce: Literal["max", "min", "mean", "first", "count"] | None = None
    over_reduce: Literal["max", "min", "mean", "first"] | None = None
    minus: Where | None = None
    over: Where | None = None
    scale: float = 1.0
    baseline: Where | None = None
    paper_baseline: float | None = None
    margin: float | None = None
    bound: float | None = None
    seeds: str = ""
    fitted: bool = False
    derived: bool = False
    why: str = ""

    @property
    def published(self) -> float:
        """The published number.

        Raises
        ------
        ValueError
            When the claim has none.
        """
        if self.paper is None:
            raise ValueError(f"claim {self.id} has no number of the paper; give 'paper'")
        return self.paper

    @property
    def limit(self) -> float:
        """The bound of 'above' and 'below'.

        Raises
        ------
        ValueError
            When the claim has none.
        """
        if self.bound is None:
            raise ValueError(f"claim {self.id} has no bound; give 'bound'")
        return self.bound

    @property
    def least(self) -> float:
        """The margin of 'null'.

        Raises
        ------
        ValueError
            When the claim has none.
        """
        if self.margin is None:
            raise ValueError(f"claim {self.id} has no margin; give 'margin'")
        return self.margin


class Ours(Strict):
    """Our counterpart of a claim.

    Attributes
    ----------
    value : in the unit of the claim.
    low, high : 95 % interval; NaN where there is none.
    """

    value: float
    low: float = math.nan
    high: float = math.nan


LISTED = Path(str(resources.files("ges.study") / "claims.yaml"))


def claims(listed: Path = LISTED) -> list[Claim]:
    """Return every claim of a file.

    Parameters
    ----------
    listed : YAML of groups; keys of a group hold for all of its claims, and ``where`` is merged.
    """
    loaded = []
    for group in yaml.safe_load(listed.read_text()):
        common = {k: v for k, v in group.items() if k != "claims"}
        for entry in group["claims"]:
            where = {**common.get("where", {}), **entry.get("where", {})}
            loaded.append(Claim.model_validate({**common, **entry, "where": where}))
    return loaded


def _cell(row: Mapping[str, Any], value: str) -> Ours:
    """A column with its interval: ``x_low``/``x_high``, or ``low``/``high`` of a difference."""
    names = ("low", "high") if value == "difference" else (f"{value}_low", f"{value}_high")
    low, high = (float(row.get(n, math.nan)) for n in names)
    return Ours(value=float(row[value]), low=low, high=high)


def _matches(column: pd.Series, wanted: str | float) -> pd.Series:
    if isinstance(wanted, str):
        return column.astype(str) == wanted
    # numbers went through text: equal but for rounding
    return (pd.to_numeric(column, errors="coerce") - wanted).abs() < 1e-9


def look(frame: pd.DataFrame, where: Where, value: str, reduce: str | None = None) -> Ours | None:
    """Return the number of a table's row.

    Parameters
    ----------
    frame : the table.
    where : values of columns that choose the row.
    value : column of the number; its interval stands in ``<value>_low`` and ``<value>_high``, or
        ``low`` and ``high`` of a difference.
    reduce : what is made of several rows: 'max', 'min', 'mean', 'sum', 'first' or 'count'. The
        interval is then left out.

    Returns
    -------
    None where no row fits.

    Raises
    ------
    GesError
        When a column is missing, or several rows fit and ``reduce`` is not given.
    """
    for name in (*where, value):
        if name not in frame:
            raise GesError(
                f"a claim or number names column '{name}'; its table has {', '.join(frame.columns)}"
            )
    for name, wanted in where.items():
        frame = frame[_matches(frame[name], wanted)]
    if reduce == "count":
        return Ours(value=float(frame[value].count()))
    if reduce and len(frame):
        return Ours(
            value=float(
                frame[value].iloc[0] if reduce == "first" else getattr(frame[value], reduce)()
            )
        )
    if len(frame) > 1:
        raise GesError(f"a claim or number: {len(frame)} rows fit {where}; say which")
    return _cell(frame.iloc[0], value) if len(frame) else None


def ours(claim: Claim, tables: Mapping[str, pd.DataFrame]) -> Ours | None:
    """Return our counterpart of a claim.

    Parameters
    ----------
    claim : the claim.
    tables : by their path below ``results``.

    Returns
    -------
    None where table or row is missing, or the number is not finite. The interval of a difference or
    ratio holds wherever both lie in theirs.
    """
    frame = tables.get(claim.table)
    if frame is None or frame.empty:
        return None
    result = look(frame, claim.where, claim.value, claim.reduce)
    for extra, reduce in (
        (claim.minus, claim.reduce),
        (claim.over, claim.over_reduce or claim.reduce),
    ):
        if result and extra is not None:
            other = look(frame, {**claim.where, **extra}, claim.value, reduce)
            result = other and _combined(result, other, subtract=extra is claim.minus)
    if not result or not math.isfinite(result.value):
        return None
    return Ours(
        value=claim.scale * result.value,
        low=claim.scale * result.low,
        high=claim.scale * result.high,
    )


def _combined(a: Ours, b: Ours, subtract: bool) -> Ours:
    """Return the difference or ratio of two numbers.

    Its interval holds wherever both lie in theirs. A ratio whose divisor may be zero has none.
    """
    # the widest that both intervals allow, since how they depend on each other is not known
    if subtract:
        return Ours(value=a.value - b.value, low=a.low - b.high, high=a.high - b.low)
    if b.low <= 0.0 <= b.high:
        return Ours(value=a.value / b.value)
    # a quotient is monotonic in both, so that its extremes are at the ends, whatever the signs
    ends = [x / y for x in (a.low, a.high) for y in (b.low, b.high)]
    return Ours(value=a.value / b.value, low=float(np.min(ends)), high=float(np.max(ends)))


def _side(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


def _unexplained(
    claim: Claim, result: Ours, baseline: Ours | None
) -> tuple[Claim, Ours, Ours | None]:
    """The same in 1 - R^2, so that closeness is that of what a model leaves unexplained."""

    def rest(value: float | None) -> float | None:
        return None if value is None else 1.0 - value

    changes = {
        # under its own name the rule would turn it again
        "value": "unexplained",
        "paper": rest(claim.paper),
        "paper_baseline": rest(claim.paper_baseline),
    }
    return claim.model_copy(update=changes), _turned(result), baseline and _turned(baseline)


def _turned(o: Ours) -> Ours:
    # turning swaps the ends
    return Ours(value=1 - o.value, low=1 - o.high, high=1 - o.low)


def _value(claim: Claim, result: Ours, baseline: Ours | None) -> str:
    if claim.value == "r2":
        return _value(*_unexplained(claim, result, baseline))
    published = claim.published
    # an interval wider than the number itself would hold any claim
    holds = result.low <= published <= result.high and (result.high - result.low) / 2 < abs(
        published
    )
    if holds or abs(result.value - published) <= CLOSE * abs(published):
        return REPRODUCED
    if baseline is not None and claim.paper_baseline is not None:
        same = _side(result.value - baseline.value) == _side(published - claim.paper_baseline)
        return DIRECTION if same else NOT
    # both ends on one side of zero; NaN, where there is no interval, is on none
    excludes = result.low * result.high > 0
    return (
        DIRECTION
        if claim.value == "difference" and excludes and _side(result.value) == _side(published)
        else NOT
    )


def _sign(claim: Claim, result: Ours) -> str:
    if _side(result.value) != _side(claim.published):
        return NOT
    return REPRODUCED if result.low * result.high > 0 else DIRECTION


def _null(claim: Claim, result: Ours) -> str:
    if abs(result.value) >= claim.least:
        return NOT
    return REPRODUCED if result.low <= 0 <= result.high else DIRECTION


def _above(claim: Claim, result: Ours) -> str:
    if result.value <= claim.limit:
        return NOT
    # a low of NaN is not below: without an interval the value decides
    return DIRECTION if result.low <= claim.limit else REPRODUCED


def _below(claim: Claim, result: Ours) -> str:
    if result.value >= claim.limit:
        return NOT
    # a high of NaN is not above: without an interval the value decides
    return DIRECTION if result.high >= claim.limit else REPRODUCED


def _not_below(_: Claim, result: Ours) -> str:
    # a high of NaN never is the greater one: without an interval the value decides
    return NOT if max(result.value, result.high) < 0 else REPRODUCED


def verdict(claim: Claim, result: Ours | None, baseline: Ours | None = None) -> str:
    """Return the verdict on a claim by :data:`RULES`.

    Parameters
    ----------
    claim : the claim.
    result : our number; None is :data:`UNMEASURED`.
    baseline : our counterpart of the published baseline.
    """
    if result is None:
        return UNMEASURED
    if claim.kind == "value":
        return _value(claim, result, baseline)
    return {
        "sign": _sign,
        "null": _null,
        "above": _above,
        "below": _below,
        "not_below": _not_below,
    }[claim.kind](claim, result)


def read_tables(tables: list[Path], results: Path) -> dict[str, pd.DataFrame]:
    """Return tables by their path below ``results``.

    Parameters
    ----------
    tables : CSV, or JSON as one row.
    results : folder that the paths count from.
    """

    def read(path: Path) -> pd.DataFrame:
        return (
            pd.json_normalize(json.loads(path.read_text()))
            if path.suffix == ".json"
            else pd.read_csv(path)
        )

    return {path.relative_to(results).as_posix(): read(path) for path in tables}


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.4g}"


def _behind(claim: Claim, seeds: Seeds) -> str:
    """Seeds behind our number, as first-last (count)."""
    named = [getattr(seeds, name) for name in claim.seeds.split()]
    return " ".join(f"{r.first}-{r.first + r.count - 1} ({r.count})" for r in named)


def _rows(
    listed: list[Claim], tables: Mapping[str, pd.DataFrame], seeds: Seeds
) -> Iterator[dict[str, Any]]:
    for claim in listed:
        result = ours(claim, tables)
        baseline = (
            ours(claim.model_copy(update={"where": {**claim.where, **claim.baseline}}), tables)
            if claim.baseline
            else None
        )
        judged = verdict(claim, result, baseline)
        yield {
            "id": claim.id,
            "section": claim.section,
            "claim": claim.says,
            "rule": claim.kind,
            "paper": claim.paper_text or _number(claim.paper),
            "unit": claim.unit,
            "ours": _number(result.value if result else None),
            "low": _number(result.low if result else None),
            "high": _number(result.high if result else None),
            "seeds": _behind(claim, seeds),
            "verdict": judged,
            "fitted": "yes" if claim.fitted else "",
            "derived": "yes" if claim.derived else "",
            "why": "" if judged in (REPRODUCED, UNMEASURED) else claim.why,
        }


def write_claims(
    listed: Path, tables: list[Path], results: Path, seeds: Seeds, table: Path, rules: Path
) -> None:
    """Write every claim with the paper's value, ours and the verdict.

    Parameters
    ----------
    listed : the claims (YAML).
    tables : results to look into; named in ``listed`` relative to ``results``.
    results : folder of the results.
    seeds : seed lists of the configuration.
    table : to write (CSV): a row a claim.
    rules : to write (JSON): the rules of the verdict.
    """
    read = read_tables(tables, results)
    write_csv(table, pd.DataFrame(list(_rows(claims(listed), read, seeds))))
    write_json(rules, RULES)
