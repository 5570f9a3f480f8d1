"""Two diagnoses side by side: verdicts, findings, corrections and errors on held-out flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import RenderableType, group
from rich.text import Text

from ges.diagnose.report.page import VERDICTS, environment
from ges.diagnose.report.sentence import size_words
from ges.diagnose.report.terminal import table_of
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.words import (
    channel_words,
    key_words,
    number_words,
    percent_words,
    plain,
    probability_words,
    unit_words,
)


def compare(
    first: Mapping[str, Any], second: Mapping[str, Any], names: Sequence[str]
) -> dict[str, Any]:
    """Compare two diagnoses.

    Parameters
    ----------
    first, second : contents of diagnosis.json, as :func:`~ges.diagnose.report.saved.load_diagnosis`
        reads them.
    names : what to call the first and the second.

    Returns
    -------
    A mapping of words and numbers ready for tables.

    - ``names``: as given.
    - ``remarks``: what makes the two hard to compare, such as flights that both used.
    - ``heads``: verdict, sentence, vehicle and seconds of each.
    - ``findings``: ``state`` (``both``, ``first only``, ``second only``), and whether intervals
    overlap.
    - ``numbers``: corrections of nominal parameters.
    - ``errors``: errors on held-out flights, and their change.

    Examples
    --------
    >>> from ges.diagnose.report.compare import compare
    >>> table = compare(load_diagnosis("all"), load_diagnosis("report"), ["four", "two"])
    >>> [(row["name"], row["state"]) for row in table["findings"]]
    [('rotor drag', 'both'), ('ground effect', 'first only')]
    """
    both, rollouts = (first, second), [c["fit"]["rollout"] for c in (first, second)]
    ahead = f", {number_words(rollouts[0]['horizon_s'], 2)} s ahead"
    return {
        "names": list(names),
        "remarks": list(_remarks(first, second)),
        "heads": [
            {
                "name": name,
                "vehicle": c["origin"]["vehicle"]["name"],
                "flights": c["data"]["flights"],
                "seconds": c["data"]["seconds_used"],
                "verdict": VERDICTS[c["verdict"]],
                "sentence": c["sentence"],
            }
            for name, c in zip(names, both, strict=True)
        ],
        "findings": [*_findings(first, second), *_laws(first, second)],
        "numbers": list(_numbers(first["calibration"], second["calibration"])),
        "errors": [
            *_errors(first["fit"]["channels"], second["fit"]["channels"], ""),
            *_errors(rollouts[0]["channels"], rollouts[1]["channels"], ahead),
        ],
    }


def _remarks(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[str]:
    origins = [c["origin"] for c in (first, second)]
    vehicles = [o["vehicle"]["name"] for o in origins]
    if all(vehicles) and vehicles[0] != vehicles[1]:
        yield f"The vehicles are not the same: {vehicles[0]} and {vehicles[1]}."
    # by content, not by name: every session may have its flight1
    hashes = [{f["sha256"] for f in o["flights"]} - {None} for o in origins]
    same = hashes[0] & hashes[1]
    if same:
        count = f"{len(same)} of the flights are" if len(same) > 1 else "One of the flights is"
        yield f"{count} in both: what they have in common is no second witness."
    # an error is that of model and flying together, so only the same flights compare models alone
    held_out = [set(c["fit"]["holdout_flights"]) for c in (first, second)]
    if held_out[0] != held_out[1]:
        yield (
            "The errors are those of different flights, so that the flying may account for a change"
            " of them."
        )


def _findings(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Return one row for each finding.

    It has the diagnoses that have it, its size and probability in each, and both values of every
    parameter with the overlap of their intervals.
    """
    # by place, too: a loss at rotor 3 is another finding than one at rotor 4
    findings = [{(f["name"], f["place"]): f for f in c["findings"]} for c in (first, second)]
    for key in dict.fromkeys([*findings[0], *findings[1]]):
        pair = [f.get(key) for f in findings]
        named = next(f for f in pair if f)
        parameters = dict.fromkeys(name for f in pair if f for name in f["parameters"])
        yield {
            "name": plain(key[0]) + (f", {key[1]}" if key[1] else ""),
            "title": named["title"],
            "state": "both" if all(pair) else "first only" if pair[0] else "second only",
            "each": [_finding_words(f, c, key) for f, c in zip(pair, (first, second), strict=True)],
            "parameters": [_parameter(name, pair) for name in parameters],
        }


def _laws(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the same for laws: one row for each channel, terms as parameters."""
    laws = [{law["channel"]: law for law in c["laws"]} for c in (first, second)]
    for channel in dict.fromkeys([*laws[0], *laws[1]]):
        pair = [by.get(channel) for by in laws]
        terms = [
            {t["term"]: {**t, "value": t["coefficient"], "unit": "1"} for t in law["terms"]}
            if law
            else {}
            for law in pair
        ]
        parameters = [{"parameters": of} for of in terms]
        yield {
            "name": f"law in the {channel_words(channel)}",
            "title": "",
            "state": "both" if all(pair) else "first only" if pair[0] else "second only",
            "each": [law["form"] if law else "none" for law in pair],
            "parameters": [
                _parameter(t, parameters) for t in dict.fromkeys([*terms[0], *terms[1]])
            ],
        }


def _finding_words(
    f: Mapping[str, Any] | None, content: Mapping[str, Any], key: tuple[str, str]
) -> str:
    """Return a finding in a few words; how probable it was where it is absent."""
    if f is None:
        considered = {(c["name"], c["place"]): c for c in content["considered"]}
        probability = considered.get(key, {}).get("probability")
        words = "" if probability is None else f" ({probability_words(probability)})"
        return f"not named{words}"
    probability = f"probability {probability_words(f['probability'])}"
    parts = [size_words(f, content), probability, "open" if f["open"] else ""]
    return "; ".join(p for p in parts if p)


def _parameter(name: str, pair: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    values = [f["parameters"].get(name) if f else None for f in pair]
    unit = next(v["unit"] for v in values if v)
    return {
        "name": name,
        # "1" is the descriptors' word for no unit
        "unit": "" if unit == "1" else unit,
        **_values(values),
    }


def _values(values: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    """Return both values with intervals, in words, and whether the intervals overlap."""
    ends: list[Any] = [v["ci95"] if v else (None, None) for v in values]
    (a_low, a_high), (b_low, b_high) = ends
    known = None not in (a_low, a_high, b_low, b_high)
    return {
        "each": [
            f"{number_words(v['value'])} ({' to '.join(map(number_words, v['ci95']))})" if v else ""
            for v in values
        ],
        "overlap": (
            ("overlap" if max(a_low, b_low) <= min(a_high, b_high) else "apart") if known else ""
        ),
    }


def _numbers(
    first: Mapping[str, Mapping[str, Any]], second: Mapping[str, Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Return one row for each nominal parameter that either diagnosis corrected."""
    for key in dict.fromkeys([*first, *second]):
        yield {
            "name": key_words(key),
            "unit": unit_words(ParameterKey.of(key).parameter),
            **_values([c.get(key) for c in (first, second)]),
        }


def _errors(
    first: Mapping[str, Mapping[str, Any]], second: Mapping[str, Mapping[str, Any]], what: str
) -> Iterator[dict[str, Any]]:
    """Yield one row for each channel of both: errors, and their change."""
    for name in (n for n in first if n in second):
        a, b = first[name], second[name]
        change = b["after"] / a["after"] - 1.0 if a["after"] else None
        yield {
            "name": f"{channel_words(name)}{what}",
            "unit": unit_words(name),
            "each": [
                f"{number_words(c['recalibrated'])} → {number_words(c['after'])}" for c in (a, b)
            ],
            "change": "" if change is None else percent_words(change),
        }


@group()
def as_text(comparison: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Lay a comparison out for a terminal.

    Parameters
    ----------
    comparison : of :func:`compare`.
    """
    c = comparison
    for head in c["heads"]:
        yield Text.assemble((head["name"], "bold"), f": {head['verdict']}\n{head['sentence']}\n")
    yield from (Text(remark) for remark in c["remarks"])
    one, two = c["names"]
    if c["findings"]:
        yield Text("\nfindings", style="bold")
        table = table_of("finding", "in", one, two, "intervals")
        for f in c["findings"]:
            table.add_row(f["name"], f["state"], *f["each"], "")
            for p in f["parameters"]:
                table.add_row(f"  {_with_unit(p)}", "", *p["each"], p["overlap"])
        yield table
    if c["numbers"]:
        yield Text("\ncorrections of nominal parameters", style="bold")
        table = table_of("number", one, two, "intervals")
        for n in c["numbers"]:
            table.add_row(_with_unit(n), *n["each"], n["overlap"])
        yield table
    if c["errors"]:
        yield Text(
            "\nerrors on flights that took no part, recalibrated → with the findings", "bold"
        )
        table = table_of("channel", one, two, "change", numbers=("change",))
        for e in c["errors"]:
            table.add_row(_with_unit(e), *e["each"], e["change"])
        yield table


def _with_unit(row: Mapping[str, Any]) -> str:
    return row["name"] + (f", {row['unit']}" if row["unit"] else "")


def as_html(comparison: Mapping[str, Any]) -> str:
    """Return a comparison as a page.

    Parameters
    ----------
    comparison : of :func:`compare`.
    """
    return environment().get_template("compare.html.j2").render(comparison)
