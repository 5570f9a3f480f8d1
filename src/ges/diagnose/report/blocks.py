"""Parts of the page that choose what is worth a reader's time: rows, remarks, and next steps.

All is made from diagnosis.json alone.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ges.diagnose.prepare.channels import least_rms
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import block_of
from ges.diagnose.types.words import (
    channel_words,
    correction_words,
    key_words,
    list_words,
    number_words,
    percent_words,
    plain,
    unit_words,
    without_unit,
)

NOTHING = "nothing more"
"""How ``next_flight`` calls the explanation that has none of the open names."""
LEAST_READING = {"m": 0.01, "m/s": 0.05, "rad": 0.002, "rad/s": 0.5, "": 0.002}
"""Errors below which no engineer acts, by unit, where no reference scale is known: a centimetre,
five centimetres a second, a tenth of a degree.
"""
LEAST_WIDTH = {"": 0.01, "m": 0.1, "m/s": 0.1, "V": 0.01, "s": 0.5}
"""Narrowest range of a condition that somebody could fly on purpose, by unit."""


def located_rows(content: Mapping[str, Any]) -> tuple[list[Mapping[str, Any]], int]:
    """Select the entries of ``located`` that are shown.

    Parameters
    ----------
    content : diagnosis.json.

    Returns
    -------
    The entries, and the number of others. Those are below the practical significance threshold, or
    in a condition narrower than anybody flies on purpose.
    """
    scale = content["data"].get("reference_scale", {})
    kept = [
        row
        for row in content["located"]
        if _is_flyable_range(row["regime"]) and _mean_is_relevant(row, scale)
    ]
    return kept, len(content["located"]) - len(kept)


def _mean_is_relevant(row: Mapping[str, Any], scale: Mapping[str, float]) -> bool:
    """Return whether the mean of a ``located`` entry reaches the practical significance threshold.

    True where the entry has no mean, or its block no reference scale: nothing is known against it.
    """
    block = block_of(row["channel"])
    if row.get("mean") is None or block not in scale:
        return True
    return abs(row["mean"]) >= least_rms(block, scale[block])


def _is_flyable_range(regime: Mapping[str, Sequence[float]]) -> bool:
    """Return whether somebody could fly a condition on purpose: its ranges are wide enough."""
    return all(
        high - low >= LEAST_WIDTH.get(unit_words(name), 0.0)
        for name, (low, high) in regime.items()
        if low is not None and high is not None
    )


def error_rows(
    table: Mapping[str, Mapping[str, Any]], scale: Mapping[str, float]
) -> tuple[list[dict[str, Any]], list[str]]:
    """Make the rows of a table of errors by stage.

    Parameters
    ----------
    table : ``channels`` of the fit, of its rollout or of its closed loop.
    scale : reference scale by block of channels: weight, weight times arm, full rotor speed.

    Returns
    -------
    rows : name, the stages, ``change`` of *after* against *recalibrated* (a share) with its 95 %
        interval, and ``state``: *better*, *worse* or ''.
    small : names of channels whose errors are too small to act on.
    """
    rows, small = [], []
    for name, c in table.items():
        stages = [c[s] for s in ("before", "recalibrated", "after") if c.get(s) is not None]
        # all three stages have to be small: an error that the findings brought down is news
        if stages and max(stages) < least_relevant_error(name, scale):
            small.append(name)
            continue
        reduction = _reduction_interval(c)
        change = c["after"] / c["recalibrated"] - 1.0 if c["recalibrated"] else None
        state = ""
        # certain and large enough, both: either alone makes no row better or worse
        if reduction and change is not None and abs(change) >= settings.statistics.least_gain:
            state = "better" if reduction[0] > 0.0 else "worse" if reduction[1] < 0.0 else ""
        rows.append(
            {
                "name": name,
                **{s: c[s] for s in ("before", "recalibrated", "names_only", "after") if s in c},
                "change": change,
                # a change is minus a reduction, so the ends of the interval swap
                "ci95": (-reduction[1], -reduction[0]) if reduction else None,
                "state": state,
            }
        )
    return rows, small


def _reduction_interval(row: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return ``reduction_ci95`` of a row of the fit; None where it has none."""
    low, high = row.get("reduction_ci95") or (None, None)
    return None if low is None or high is None else (low, high)


def least_relevant_error(name: str, scale: Mapping[str, float]) -> float:
    """Return the error of a channel below which no engineer acts.

    Parameters
    ----------
    name : of the channel, with its unit.
    scale : of :func:`error_rows`.

    Returns
    -------
    In the unit of the name.
    """
    block = block_of(without_unit(name))
    if block in scale:
        return least_rms(block, scale[block])
    return LEAST_READING.get(unit_words(name), 0.0)


def sds_moved(
    calibration: Mapping[str, Mapping[str, Any]], given: str = "prior_sd"
) -> dict[str, float]:
    """Return how many prior sds recalibration moved each number, the farthest first.

    Parameters
    ----------
    calibration : of diagnosis.json.
    given : what a number has to have: ``declared_sd`` is of those of the vehicle file.

    Returns
    -------
    By ``effect.parameter``; a number without a prior sd contradicts nothing and is left out.
    """
    rows = {k: c for k, c in calibration.items() if c["prior_sd"] and c[given]}
    moved = {k: abs(c["value"]) / c["prior_sd"] for k, c in rows.items()}
    return dict(sorted(moved.items(), key=lambda item: -item[1]))


def remarks(content: Mapping[str, Any]) -> list[str]:
    """Return what speaks against the fit on held-out flights, with what to do.

    Parameters
    ----------
    content : diagnosis.json.
    """
    table = content["fit"].get("channels", {})
    out = [*_worse_than_recalibrated(table), *_worse_than_given(table)]
    rolled = content["fit"].get("rollout") or {}
    for name, c in rolled.get("channels", {}).items():
        if c["after"] > (1.0 + settings.statistics.least_gain) * c["recalibrated"] and c[
            "after"
        ] >= least_relevant_error(name, {}):
            out.append(
                f"Simulated {number_words(rolled['horizon_s'], 2)} s ahead, the"
                f" {channel_words(name)} is farther off with the findings:"
                f" {_stages(name, c, 'recalibrated', 'after')}."
            )
    return [*out, *_far_from_prior(content)]


def _far_from_prior(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield numbers that recalibration moved clearly beyond what was known of them."""
    calibration, named = content["calibration"], {f["name"] for f in content["findings"]}
    far = [
        f"{key_words(key)} {correction_words(ParameterKey.of(key).parameter, c['value'])}"
        f" ({number_words(sds, 2)} prior sds)"
        for key, sds in sds_moved(calibration).items()
        for c in [calibration[key]]
        if sds > settings.statistics.clear_sds and ParameterKey.of(key).effect not in named
    ]
    if far:
        yield (
            f"Recalibration moved {list_words(far)} farther than the file, or what is usual, lets"
            " expect, and nothing named above accounts for it. Check these numbers before you rely"
            " on the rest."
        )


def _worse_than_recalibrated(table: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, c in table.items():
        # of 1 - after / recalibrated: with the upper end below zero it is worse for certain
        high = c["reduction_ci95"][1]
        if c["after"] <= (1.0 + settings.statistics.least_gain) * c["recalibrated"]:
            continue
        yield (
            f"With the findings the {channel_words(name)} is worse"
            f" ({_stages(name, c, 'recalibrated', 'after')}), "
            + (
                "and not by chance: one of them is wrong, or belongs to the other flights. Hold"
                " another flight out (--holdout) and see which of them stays."
                if high is not None and high < 0.0
                else "which chance may do."
            )
        )


def _worse_than_given(table: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    worse = [
        f"{channel_words(name)} ({_stages(name, c, 'before', 'recalibrated')})"
        for name, c in table.items()
        if c["recalibrated"] > (1.0 + settings.statistics.least_gain) * c["before"]
    ]
    if worse:
        yield (
            f"Recalibration alone makes worse: {list_words(worse)}. What the other flights ask of"
            " the nominal parameters does not hold here: look for what differs between the flights,"
            " such as battery, payload or trim."
        )


def _stages(name: str, c: Mapping[str, Any], first: str, then: str) -> str:
    unit = unit_words(name)
    return f"{number_words(c[first])} → {number_words(c[then])}{' ' + unit if unit else ''}"


def _separates_words(names: Sequence[str], tell: str = "tells", show: str = "shows") -> str:
    """Return what a flight is good for: *tells a and b apart*, *shows whether a is there at all*.

    Parameters
    ----------
    names : ``separates`` of the next flight.
    tell, show : the two verbs, for more than one flight or for none.
    """
    named = [plain(n) for n in names if n != NOTHING]
    there = f"{show} whether {list_words(named, 'or')} is there at all" if named else ""
    apart = f"{tell} {list_words(named)} apart" if len(named) > 1 else ""
    # a single name has nothing to be separated from: only whether it is there
    if not apart:
        return there or f"{show} whether anything is missing"
    return f"{apart} and {there}" if NOTHING in names else apart


def next_steps(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what to do now.

    Parameters
    ----------
    content : diagnosis.json.

    Returns
    -------
    ``words``, ``points`` under them, and a ``command`` where one does it, to be run in the page's
    folder.
    """
    return [
        *_next_flight(content),
        *_logging_advice(content),
        *_with_findings(content),
        *_why_not(content),
    ]


def _next_flight(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    advised = content["next_flight"]
    if not advised or not advised.get("separates"):
        return
    separates, times = advised["separates"], advised.get("flights") or 1
    # what no manoeuvre separates, a change of the vehicle or a measurement on the ground does
    if not advised.get("manoeuvre"):
        would = _separates_words(separates, "would tell", "would show")
        yield {
            "words": (
                f"No manoeuvre of the menu {would}. Instead change one thing on the vehicle"
                " (another propeller, no load, still air), fly the same plan again, diagnose it and"
                " compare: what goes with the change was its cause. Or measure one of them apart,"
                " on scales or a thrust stand, and declare it in the vehicle file with a smaller"
                " sd."
            ),
            "command": "ges compare . AFTER_THE_CHANGE",
        }
        return
    what = (
        f"it {_separates_words(separates)}"
        if times == 1
        else f"together these flights {_separates_words(separates, 'tell', 'show')}"
    )
    often = f" {times} times" if times > 1 else ""
    prepared = f" with {advised['preparation']}" if advised.get("preparation") else ""
    still = [plain(n) for n in advised.get("stays_open") or () if n != NOTHING]
    between = f" {list_words(still)} would stay open between themselves." if len(still) > 1 else ""
    # a diagnosis that was made in Python has no command line that could be given again
    command = content.get("origin", {}).get("command", "")
    yield {
        "words": (
            f"Fly {plain(advised['manoeuvre'])}{often}{prepared}: {what}.{between}"
            + (" Its set points are written, where this diagnosis was made, by" if command else "")
        ),
        "command": f"{command} --write-flight next_flight.csv" if command else "",
    }


def _logging_advice(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    # one sentence a reason: a missing stream silences several channels at once
    reasons: dict[str, list[str]] = {}
    for name, why in content["data"].get("channels_off", {}).items():
        reasons.setdefault(why, []).append(channel_words(name))
    if reasons:
        yield {
            "words": "Give it more to go by next time:",
            "points": [
                f"{why}: these flights say nothing of the {list_words(names)}"
                for why, names in reasons.items()
            ],
        }


def _with_findings(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    if content["findings"]:
        yield {
            "words": "Fly the fitted vehicle, findings and all:",
            "command": "ges simulate vehicle.fitted.yaml --plan straight_runs --out flight.parquet",
        }
    yield {
        "words": "Ask later flights what has changed since, and lay both diagnoses side by side:",
        "command": "ges diagnose LATER_FLIGHTS --vehicle vehicle.fitted.yaml --out later\n"
        "ges compare . later",
    }


def _why_not(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    rows = considered_rows(content)
    if rows:
        yield {
            "words": "Read why a name was not given, rule by rule:",
            "command": f"ges explain . {shlex.quote(rows[0]['name'])}",
        }


def considered_rows(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the candidates that were compared and not named, the most probable first.

    Parameters
    ----------
    content : diagnosis.json.

    Returns
    -------
    Entries of ``considered``, each with the first decision that ``failed``.
    """
    named = {(f["name"], f["place"]) for f in content["findings"]}
    rows = [
        {**c, "failed": next((d for d in c["decisions"] if not d["passed"]), None)}
        for c in content["considered"]
        # what was not compared has no probability to rank by; the page lists it as not tested
        if (c["name"], c["place"]) not in named and c["probability"] is not None
    ]
    return sorted(rows, key=lambda c: (-c["probability"], c["name"], c["place"]))


def decision_words(decision: Mapping[str, Any]) -> str:
    """Return a decision as a sentence: statistic, threshold and reason.

    Parameters
    ----------
    decision : an entry of ``decisions``.
    """
    numbers = ""
    if decision["statistic"] is not None:
        numbers = number_words(decision["statistic"])
        if decision["threshold"] is not None:
            numbers += f", asked {number_words(decision['threshold'])}"
    because = decision["because"]
    return "; ".join(part for part in (numbers, because) if part)


def share_words(name: str, value: float | None, scale: Mapping[str, float]) -> str:
    """Return a size of a channel as a share of its reference scale.

    Parameters
    ----------
    name : of the channel, with its unit.
    value : in that unit.
    scale : reference scale by block of channels.

    Returns
    -------
    A percentage; '' where no scale is known.
    """
    reference = scale.get(block_of(without_unit(name)))
    return percent_words(value / reference) if reference and value is not None else ""


def flight_names(content: Mapping[str, Any]) -> list[str]:
    """Return the names of all flights that a diagnosis was given.

    Parameters
    ----------
    content : diagnosis.json.
    """
    return [f["name"] for f in content.get("origin", {}).get("flights", ())]


def grouped_warnings(warnings: Sequence[str], names: Sequence[str]) -> list[str]:
    """Join warnings that say the same of several flights.

    Parameters
    ----------
    warnings : sentences; those about a flight begin with its name.
    names : of the flights.
    """
    alike: dict[str, dict[str, str]] = {}
    for warning in warnings:
        # the name of flight1 also begins the sentence about flight10: the longest that fits is
        # meant
        name = max((n for n in names if warning.startswith(n)), key=len, default="")
        alike.setdefault(warning.removeprefix(name).lstrip(": "), {})[name] = warning
    return [
        next(iter(by_flight.values()))
        if len(by_flight) == 1
        else f"{list_words(list(by_flight))}: {words}"
        for words, by_flight in alike.items()
    ]
