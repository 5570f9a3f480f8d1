"""Verdict and sentence: what an engineer is told first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from ges.diagnose.decide.declared import Contradicted
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import UntoldThrust
from ges.diagnose.library.requirements import not_spoken_about
from ges.diagnose.types.diagnosis import Finding
from ges.diagnose.types.words import channel_words, number_words, quantity_words, unit_words

NOTEWORTHY = 2.0
LEAST_GAIN = 0.02


def verdict_of(
    findings: Sequence[Finding], wrong: Sequence[Contradicted], unexplained: Sequence[Mapping]
) -> str:
    """One word of the contract; ``wrong`` are declared numbers that the flights contradict."""
    if any(f.is_open for f in findings):
        return "ambiguous"
    kinds = {f.kind for f in findings}
    for kind in ("physics", "sensor", "parameter"):
        if kind in kinds:
            return kind
    if any(not number.is_trim for number in wrong):
        return "parameter"
    return "unknown" if unexplained or wrong else "nothing_proven"


def where_words(item: Mapping) -> str:
    """A located entry in words."""
    name, (low, high) = next(iter(item["regime"].items()))
    words, _, unit = quantity_words(name).partition(", ")
    return (
        f"{channel_words(item['channel'])} at {words} {number_words(low, 2)} to"
        f" {number_words(high, 2)} {unit}".strip()
    )


def _finding_words(f: Finding) -> str:
    told = [f.title, f"P {f.probability:.2f}"]
    if f.size.get("channel"):
        told.append(
            f"{number_words(f.size['value'], 2)} {f.size['unit']} rms in the"
            f" {channel_words(f.size['channel'])}"
        )
    return f"{f.name} ({'; '.join(told)})"


def _gain(fit: Mapping) -> str:
    """The channel that gains most on flights never seen, against recalibration alone; or that they
    hardly show the findings, or none of them does, and which loses most.
    """
    gains = {
        name: 1.0 - told["after"] / told["recalibrated"]
        for name, told in fit.get("channels", {}).items()
        if told["recalibrated"]
    }
    if not gains:
        return ""
    if max(map(abs, gains.values())) < LEAST_GAIN:
        return (
            " The flights that took no part hardly show it: none of their errors changes by"
            f" {100.0 * LEAST_GAIN:.0f} %."
        )
    name, worst = max(gains, key=gains.get), min(gains, key=gains.get)
    if gains[name] < LEAST_GAIN:
        return (
            f" On flights that took no part no error falls by {100.0 * LEAST_GAIN:.0f} %, and that"
            f" of the {channel_words(worst)} rises by {-100.0 * gains[worst]:.0f} %."
        )
    told = fit["channels"][name]
    before, recalibrated, after = (
        number_words(told[stage], 3) for stage in ("before", "recalibrated", "after")
    )
    each = [
        f"{number_words(left[name], 3)} with {other}"
        for other, left in fit.get("alternatives", {}).items()
    ]
    *rest, last = [f"{recalibrated} recalibrated", *(each or [f"{after} with it"])]
    return (
        f" On flights that took no part the error of the {channel_words(name)} is {before}"
        f" {unit_words(name)} as given, {', '.join(rest)} and {last}."
    )


def _moved(calibration: Mapping[str, Mapping], wrong: Sequence[Contradicted]) -> str:
    """The declared numbers that the flights contradict; else the one that recalibration moved
    farthest, where that is beyond twice its doubt.
    """
    if wrong:
        return "".join(f" {number.sentence()}" for number in wrong)
    far = {
        k: abs(c["value"]) / c["declared_sd"] for k, c in calibration.items() if c["declared_sd"]
    }
    name = max(far, key=far.get, default=None)
    if name is None or far[name] < NOTEWORTHY:
        return ""
    return (
        f" Recalibration moved {name} by {number_words(calibration[name]['value'])},"
        f" {far[name]:.1f} times its declared sd."
    )


def _open_words(findings: Sequence[Finding], why_open: str) -> str:
    """What is missing for sure, and what else is, of which the flights cannot tell which."""
    sure, rest = (
        "; ".join(_finding_words(f) for f in findings if f.is_open == is_open)
        for is_open in (False, True)
    )
    beside = " beside it" if sure else ""
    told = (
        why_open or f"One of these is needed{beside} and these flights cannot tell which: {rest}."
    )
    return f"What is missing: {sure}. {told}" if sure else told


def sentence_of(
    verdict: str,
    findings: Sequence[Finding],
    located: Sequence[Mapping],
    unexplained: Sequence[Mapping],
    fit: Mapping,
    calibration: Mapping[str, Mapping],
    wrong: Sequence[Contradicted],
    shift: Shift | UntoldThrust | None = None,
    off: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """One or two sentences: where, what, how much, how sure.

    Parameters
    ----------
    wrong : declared numbers that the flights contradict.
    shift : what moved, where the flights cannot tell by which of several causes.
    off : channels that no flight speaks about, each with what to log.
    """
    if isinstance(shift, Shift):
        return shift.sentence()
    why_open = shift.sentence() if shift else ""
    first = next(iter([*located, *unexplained]), None)
    where = f"The simulator is wrong first in the {where_words(first)}." if first else ""
    named = "; ".join(_finding_words(f) for f in findings)
    left = (
        f" Something is left unexplained in the {channel_words(unexplained[0]['channel'])}."
        if unexplained
        else ""
    )
    if verdict == "nothing_proven":
        return (
            "Nothing proven: within the declared doubts these flights do not contradict the"
            " simulator by more than the smallest effects listed as"
            f" detectable.{_moved(calibration, wrong)}{not_spoken_about(off)}"
        )
    if verdict == "unknown":
        stays = (
            " No effect of the library explains it: it stays unknown, rather than under the nearest"
            " name."
        )
        return f"{where}{_moved(calibration, wrong) if wrong else stays}".strip()
    if verdict == "ambiguous":
        gain = _gain(fit) if fit.get("alternatives") else ""
        numbers = _moved(calibration, wrong) if wrong else ""
        return f"{where} {_open_words(findings, why_open)}{gain}{numbers}{left}".strip()
    if not findings:
        return f"{where}{_moved(calibration, wrong)}{_gain(fit)}{left}".strip()
    return (
        f"{where} What is missing: {named}.{_gain(fit)}{_moved(calibration, wrong)}{left}".strip()
    )
