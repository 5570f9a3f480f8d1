"""Why names were given or not: the decisions as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import RenderableType, group
from rich.text import Text

from ges.diagnose.report.blocks import considered_rows
from ges.diagnose.report.terminal import table_of
from ges.diagnose.types.words import (
    number_words,
    odds_words,
    plain,
    probability_words,
)
from ges.errors import GesError, unknown_name
from ges.simulator import effects as effect_table

NUMBERS = ("probability", "statistic", "asked")


@group()
def decisions_about(content: Mapping[str, Any], name: str) -> list[RenderableType]:
    """Show every decision about one effect.

    Parameters
    ----------
    content : diagnosis.json.
    name : of an effect of the library; spaces or hyphens may stand for underscores.

    Raises
    ------
    UsageError
        For a name that the library lacks, with the nearest one.
    GesError
        Where the diagnosis has no record of it.
    """
    name = name.strip().replace(" ", "_").replace("-", "_")
    if name not in effect_table.table():
        raise unknown_name("effect", name, effect_table.table())
    effect = effect_table.get(name)
    parts: list[RenderableType] = [
        Text.assemble((plain(name), "bold"), f": {effect.title}\n{effect.equation}"),
        *_as_named(content, name),
        *_as_considered(content, name),
        *_limits(content, name),
    ]
    if len(parts) == 1:
        raise GesError(
            f"this diagnosis keeps no record of {name}; it may be older than this version: diagnose"
            " the flights again"
        )
    return parts


@group()
def overview(content: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Show what was named, considered and not named, and not tested.

    Parameters
    ----------
    content : diagnosis.json.
    """
    yield Text(content["sentence"])
    if content["findings"]:
        yield Text("\nnamed", style="bold")
        table = table_of("effect", "probability", "", numbers=NUMBERS)
        for f in content["findings"]:
            table.add_row(
                _effect(f), probability_words(f["probability"]), "open" if f["open"] else ""
            )
        yield table
    rows = considered_rows(content)
    if rows:
        yield Text("\nconsidered and not named", style="bold")
        table = table_of(
            "effect",
            "probability",
            "rule that it fails",
            "statistic",
            "asked",
            "why",
            numbers=NUMBERS,
        )
        for c in rows:
            table.add_row(
                _effect(c), probability_words(c["probability"]), *_decision_cells(c["failed"])
            )
        yield table
    elif not content["considered"]:
        yield Text("\nthis diagnosis keeps no record of its decisions; diagnose the flights again")
    if content["not_tested"]:
        yield Text("\nnot tested", style="bold")
        table = table_of("effect", "what it would need")
        for name, why in content["not_tested"].items():
            table.add_row(plain(name), why)
        yield table


def _decision_cells(decision: Mapping[str, Any] | None) -> tuple[str, str, str, str]:
    if decision is None:
        return "none", "", "", ""
    return (
        plain(decision["rule"]),
        _number(decision["statistic"]),
        _number(decision["threshold"]),
        decision["because"],
    )


def _number(value: float | None) -> str:
    return "" if value is None else number_words(value)


def _effect(entry: Mapping[str, Any]) -> str:
    return plain(entry["name"]) + (f", {entry['place']}" if entry["place"] else "")


def _as_named(content: Mapping[str, Any], name: str) -> Iterator[RenderableType]:
    for f in (f for f in content["findings"] if f["name"] == name):
        state = "open: this or another" if f["open"] else "named"
        yield Text(f"\n{_effect(f)}: {state}, probability {probability_words(f['probability'])}")
        if f["alternatives"]:
            others = ", ".join(
                f"{_effect(a)} {odds_words(a['log_odds'])}" for a in f["alternatives"]
            )
            yield Text(f"instead of it: {others}")
        if law := f["rival_law"]:
            form = f"{law['channel']} = {law['form']}"
            yield Text(f"or a law of as many numbers: {form}, {odds_words(law['log_odds'])}")


def _as_considered(content: Mapping[str, Any], name: str) -> Iterator[RenderableType]:
    named = {(f["name"], f["place"]) for f in content["findings"]}
    for c in (c for c in content["considered"] if c["name"] == name):
        if (name, c["place"]) not in named:
            probability = probability_words(c["probability"])
            yield Text(f"\n{_effect(c)}: considered and not named, probability {probability}")
        table = table_of("rule", "", "statistic", "asked", "why", numbers=NUMBERS)
        for d in c["decisions"]:
            rule, statistic, asked, why = _decision_cells(d)
            table.add_row(rule, "passed" if d["passed"] else "failed", statistic, asked, why)
        yield table


def _limits(content: Mapping[str, Any], name: str) -> Iterator[RenderableType]:
    why = content["not_tested"].get(name)
    if why:
        yield Text(f"\nnot tested: {why}")
    limit = content["detectable"].get(name)
    if limit:
        unit = "" if limit["unit"] in ("", "1") else f" {limit['unit']}"
        rival = (
            f", hardest to tell from {plain(limit['limited_by'])}" if limit["limited_by"] else ""
        )
        smallest = limit["smallest"]
        size = (
            "not visible in these flights"
            if smallest is None
            else f"{number_words(smallest)}{unit}"
        )
        yield Text(f"\nsmallest that would have been seen: {limit['parameter']} {size}{rival}")
