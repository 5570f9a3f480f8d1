"""The sentence that an engineer reads first, of at most :data:`MOST_WORDS` words.

It says what is missing, how much, how sure, and what that is worth on held-out flights. No key of a
file is in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ges.conventions import SDS_95
from ges.diagnose.report.blocks import error_rows, least_relevant_error, sds_moved
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
    regime_words,
    unit_words,
    without_unit,
)

MOST_WORDS = 40
MOST_NAMES = 3
LEADS: Mapping[str, str] = {
    "physics": "missing in the simulator:",
    "parameter": "wrong in the vehicle file:",
    "sensor": "wrong in the sensors:",
}
# the long form first; the short one where words are short
UNSEEN = ("on flights that took no part,", "unseen,")


def sentence_of(content: Mapping[str, Any]) -> str:
    """Return the sentence of a diagnosis.

    Parameters
    ----------
    content : diagnosis.json without its ``sentence``.

    Returns
    -------
    The first form that has no more than :data:`MOST_WORDS` words; forms go from most to least
    detail.
    """
    forms = {
        "nothing_proven": _nothing,
        "law": _law,
        "unknown": _unknown,
        "ambiguous": _ambiguous,
    }.get(content["verdict"], _findings_forms)
    # every generator ends with a form that is short enough
    return next(form for form in forms(content) if len(form.split()) <= MOST_WORDS)


def _findings_forms(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield findings by kind, how sure the least of them is, and their worth on held-out flights.

    Shorter forms drop sizes first, then names, then the channel that lost, and the gain last.
    """
    findings, gain, loss = content["findings"], _improvement_words(content), _loss(content)
    if not findings:
        # a contradicted nominal parameter that no effect corrects
        wrong = _largest_correction(content, "declared_sd") or "a nominal parameter"
        yield f"The vehicle file is wrong about {wrong}."
        return
    if not content["fit"].get("channels"):
        worths = [""]
    # a loss outranks names: it may mean that one of them is wrong
    elif loss:
        both = [f"{gain}, but {loss}", f"{gain}, but another error grows"] if gain else []
        worths = [*both, loss]
    else:
        worths = [gain or "no error falls", ""]
    # what is missing outranks how large it is, which stands in the table below the sentence
    for worth, most, sized in itertools.product(worths, range(MOST_NAMES, 0, -1), (True, False)):
        what = f"{_by_kind(findings, content, most, sized)}, {_sureness(findings)}"
        clauses = [f"{where} {worth}" for where in UNSEEN] if worth else [""]
        yield from (_join(what, clause) for clause in clauses)
    lead = LEADS[findings[0]["kind"]]
    yield _capital(f"{lead} {list_words(_names(findings, content, 1, False))}.")


def _by_kind(
    findings: Sequence[Mapping], content: Mapping[str, Any], most: int, sized: bool
) -> str:
    parts = []
    for kind, lead in LEADS.items():
        of_kind = [f for f in findings if f["kind"] == kind]
        if of_kind:
            names = _names(of_kind, content, most, sized)
            parts.append(f"{lead} {list_words(names)}")
    return _capital("; ".join(parts))


def _names(
    findings: Sequence[Mapping], content: Mapping[str, Any], most: int, sized: bool
) -> list[str]:
    names = [
        f"{_name(f)} ({size})" if sized and (size := size_words(f, content)) else _name(f)
        for f in findings[:most]
    ]
    rest = len(findings) - len(names)
    return [*names, f"{rest} more"] if rest else names


def _name(f: Mapping[str, Any]) -> str:
    return plain(f["name"]) + (f" of {f['place']}" if f.get("place") else "")


def size_words(f: Mapping[str, Any], content: Mapping[str, Any]) -> str:
    """Return how large a finding is.

    Parameters
    ----------
    f : the finding.
    content : diagnosis.json.

    Returns
    -------
    N per m/s where the force is proportional to speed. Else a share of the weight, the lever of a
    moment in metres, or its own unit. For a nominal parameter the correction; '' where nothing is
    known.
    """
    size = f["size"]
    if f["kind"] == "parameter" and f["parameters"]:
        # of several corrections of one effect the largest is reported
        name = max(f["parameters"], key=lambda p: abs(f["parameters"][p]["value"]))
        return correction_words(name, f["parameters"][name]["value"])
    if size.get("force_per_speed_N_s_m"):
        return f"{number_words(size['force_per_speed_N_s_m'], 2)} N per m/s"
    if size.get("value") is None:
        return ""
    block, scale = block_of(size.get("channel", "")), content["data"].get("reference_scale", {})
    if block in ("force", "acc"):
        return f"{percent_words(size['share_of_weight'])} of weight"
    if block == "moment" and scale.get("force"):
        # moment over weight: the arm at which the weight would make it
        return f"lever of {number_words(size['value'] / scale['force'], 2)} m"
    if block == "drive":
        return f"{percent_words(size['share_of_weight'])} of full speed"
    return f"{number_words(size['value'], 2)} {size['unit']}"


def _sureness(findings: Sequence[Mapping]) -> str:
    least = min(f["probability"] for f in findings)
    # as in the table of findings: nothing is rounded to certainty
    sure = f"{100.0 * min(least, 0.999):.{1 if least > 0.99 else 0}f} %"
    return f"{'each at least ' if len(findings) > 1 else ''}{sure} sure"


def _improvement_words(content: Mapping[str, Any]) -> str:
    """Return how much the findings improve held-out flights; '' for less than is worth a mention.

    First comes the position that gains most one second ahead, else the channel that gains most.
    *nothing of it shows* where errors in the findings' own channels are too small to act on: a gain
    elsewhere is then no evidence.
    """
    table, scale = content["fit"].get("channels", {}), content["data"].get("reference_scale", {})
    channels_of_findings = {
        f["size"].get("channel") for f in (*content["findings"], *content["laws"])
    }
    their_rows = {n for n in table if without_unit(n) in channels_of_findings}
    if their_rows and their_rows <= set(error_rows(table, scale)[1]):
        return "nothing of it shows"
    rolled = content["fit"].get("rollout") or {}
    # metres off a second ahead say more to an engineer than newtons of a residual
    position_rows = {n: c for n, c in rolled.get("channels", {}).items() if unit_words(n) == "m"}
    best = _best(position_rows)
    if best:
        name, c = best
        # as many digits as tell the two apart
        pairs = ([number_words(c[s], n) for s in ("after", "recalibrated")] for n in (2, 3, 4))
        after, recalibrated = next(pair for pair in pairs if pair[0] != pair[1])
        return (
            f"{channel_words(name)} {number_words(rolled['horizon_s'], 1)} s ahead is"
            f" {after} m off, not {recalibrated} m"
        )
    best = _best(table)
    if best:
        name, c = best
        share = percent_words(1.0 - c["after"] / c["recalibrated"])
        return f"the error of the {channel_words(name)} falls by {share}"
    return ""


def _loss(content: Mapping[str, Any]) -> str:
    """Return the channel that is certainly worse with the findings on held-out flights.

    It counts from an error on that somebody acts on; '' where there is none.
    """
    scale = content["data"].get("reference_scale", {})
    rows, _ = error_rows(content["fit"].get("channels", {}), scale)
    worse = [
        row
        for row in rows
        if row["state"] == "worse"
        and row["after"] - row["recalibrated"] >= least_relevant_error(row["name"], scale)
    ]
    if not worse:
        return ""
    row = max(worse, key=lambda row: row["change"])
    return f"the {channel_words(row['name'])} is {percent_words(row['change'])} worse"


def _best(table: Mapping[str, Mapping[str, Any]]) -> tuple[str, Mapping[str, Any]] | None:
    """Return the row that gains most against recalibration alone, if that is worth a mention."""
    # against recalibration, as only what exceeds it speaks for the findings
    gains = {n: 1.0 - c["after"] / c["recalibrated"] for n, c in table.items() if c["recalibrated"]}
    name = max(gains, key=lambda n: gains[n], default=None)
    return (
        (name, table[name])
        if name is not None and gains[name] >= settings.statistics.least_gain
        else None
    )


def _largest_correction(content: Mapping[str, Any], given: str = "prior_sd") -> str:
    """Return the number that recalibration moved farthest over its prior sd; '' within two.

    Of those that have what is ``given``: ``declared_sd`` is of numbers of the vehicle file.
    """
    key, sds = next(iter(sds_moved(content["calibration"], given).items()), ("", 0.0))
    if sds < SDS_95:
        return ""
    value = content["calibration"][key]["value"]
    return (
        f"{key_words(key)}: the flights ask for"
        f" {correction_words(ParameterKey.of(key).parameter, value)},"
        f" {number_words(sds, 2)} prior sds"
    )


def _ambiguous(content: Mapping[str, Any]) -> Iterator[str]:
    sure = [f for f in content["findings"] if not f["open"]]
    rivals = [f for f in content["findings"] if f["open"]]
    advised = content["next_flight"].get("manoeuvre")
    tells = f"flying {plain(advised)} would tell" if advised else ""
    # what cannot be tested in these flights cannot be in others that are logged as they are
    reasons = (content["not_tested"].get(f["name"]) for f in rivals)
    if missing := next(filter(None, reasons), ""):
        needed, _, _ = missing.removeprefix("needs ").partition(";")
        tells = f"{needed} would tell"
    # first to go are the sizes, then a third name, then the advised flight: the page has them all
    for clause, most, sized in (
        *itertools.product((tells, ""), range(MOST_NAMES, 1, -1), (True, False)),
        ("", 1, False),
    ):
        names = list_words(_names(rivals, content, most, sized), "or")
        one_of = f"one of {names} is missing and these flights cannot tell which"
        if len(rivals) == 1:
            one_of = f"{names} may be missing and these flights cannot tell"
        if sure:
            proven = list_words(_names(sure, content, most, sized))
            one_of = f"missing in the simulator: {proven}; beside it {one_of}"
        yield _join(_capital(one_of), clause)


def _law(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the law of the largest size, and its worth on held-out flights."""
    laws = sorted(content["laws"], key=lambda law: -law["size"]["share_of_weight"])
    first, rest = laws[0], len(laws) - 1
    more = f" and by {rest} more law{'s' if rest > 1 else ''}" if rest else ""
    where, unproven = f"The {channel_words(first['channel'])}", "which no effect is proven to make"
    worth = _improvement_words(content) or "no error falls"
    if _loss(content):
        worth = f"{worth}, but {_loss(content)}"
    for what in (
        f"{where} is off by {first['form']}{more}, {unproven}",
        f"{where} is off by a law{more}, {unproven}",
    ):
        yield from (_join(what, f"{unseen} {worth}") for unseen in UNSEEN)
    yield f"{where} is off by a law, {unproven}."


def _unknown(content: Mapping[str, Any]) -> Iterator[str]:
    first = next(iter([*content["located"], *content["unexplained"]]), None)
    nothing = "no effect of the library explains it"
    if first:
        where = f"The simulator is wrong in the {channel_words(first['channel'])}"
        yield f"{where} at {regime_words(first['regime'])}, and {nothing}."
        yield f"{where}, and {nothing}."
    elif correction := _largest_correction(content, "declared_sd"):
        yield f"The vehicle is not as its file has it: {correction}, and {nothing}."
    yield f"The simulator is wrong, and {nothing}."


def _nothing(content: Mapping[str, Any]) -> Iterator[str]:
    alone = "no effect stands out of the noise"
    correction, stays = _largest_correction(content), _largest_error(content)
    rest = [f"{where} {stays}" for where in UNSEEN] if stays else []
    starts = [f"{alone}; farthest off is {correction}"] if correction else []
    for start in (*starts, f"{alone} and of what the file leaves open"):
        yield from (_join(f"Nothing proven: {start}", clause) for clause in (*rest, ""))


def _largest_error(content: Mapping[str, Any]) -> str:
    """Return the largest error that recalibration leaves on held-out flights.

    It is largest over the reference scale.

    Wide prior sds agree with much.
    """
    scale = content["data"].get("reference_scale", {})
    errors = {
        name: c["recalibrated"]
        for name, c in content["fit"].get("channels", {}).items()
        if scale.get(block_of(name))
    }
    name = max(errors, key=lambda n: errors[n] / scale[block_of(n)], default=None)
    if name is None:
        return ""
    error = number_words(errors[name], 2)
    return f"the {channel_words(name)} stays {error} {unit_words(name)} off"


def _join(*clauses: str) -> str:
    return "; ".join(c for c in clauses if c) + "."


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
