"""One verdict against one truth, read from the contract's two files alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

SURE = 0.9
BY_VERDICT = {
    "nothing_proven": "null",
    "unknown": "unknown",
    "ambiguous": "confounded",
    "sensor": "sensor",
    "parameter": "parameter",
}
CATEGORIES = ("null", "single", "pair", "triple", "parameter", "sensor", "unknown", "confounded")


@dataclass(frozen=True)
class Judgement:
    """What came of one case.

    Attributes
    ----------
    case, category, severity : of the case.
    truth : true names.
    verdict : of the diagnosis.
    claimed, offered : names reported as proven, and names left open.
    outcome : 'exact', 'partial', 'extra', 'wrong', 'hedged', 'nothing', 'unknown' or 'failed'.
        Partial claims true names, but not all; extra claims all and others. Wrong claims a false
        name, and not all true ones. Hedged leaves the truth open among others.
    wrong : claimed names that no right answer has.
    flagged : whether something unexplained was reported.
    stated : (probability, came true) of each name.
    located : numbers of channels found, found too many, and missed.
    """

    case: str
    category: str
    severity: str
    truth: tuple[str, ...]
    verdict: str
    claimed: tuple[str, ...]
    offered: tuple[str, ...]
    outcome: str
    wrong: tuple[str, ...]
    flagged: bool
    stated: tuple[tuple[float, bool], ...] = field(repr=False)
    located: tuple[int, int, int]

    @property
    def exact(self) -> bool:
        """Whether the answer was right."""
        return self.outcome == "exact"

    @property
    def alarm(self) -> bool:
        """Whether anything was reported to be there."""
        return self.verdict not in ("nothing_proven", "failed")


def category_of(truth: Mapping) -> str:
    """Return the kind of a case: as stated, else by its verdict and number of findings.

    Returns
    -------
    One of :data:`CATEGORIES`.
    """
    if truth.get("category") in CATEGORIES:
        return truth["category"]
    kind = BY_VERDICT.get(truth["verdict"])
    return kind or {1: "single", 2: "pair"}.get(len(truth["findings"]), "triple")


def acceptable(truth: Mapping) -> list[frozenset[str]]:
    """Return the sets of names that are right, the truth itself first."""
    names = frozenset(f["name"] for f in truth["findings"])
    return [names, *(frozenset(other) for other in truth.get("also_acceptable", []))]


def kind_of(diagnosis: Mapping) -> str:
    """Return the verdict of a diagnosis; ``unknown`` for a law as well, which no name explains."""
    return "unknown" if diagnosis["verdict"] == "law" else diagnosis["verdict"]


def judge(case: str, truth: Mapping, diagnosis: Mapping) -> Judgement:
    """Compare a diagnosis with the truth.

    In an ambiguous answer only names of probability 0.9 or more are claimed, the others are
    offered. A name is wrong when no acceptable answer has it.

    Parameters
    ----------
    case : name of the case.
    truth : its sealed truth.
    diagnosis : content of ``diagnosis.json``.
    """
    findings, verdict = diagnosis.get("findings", []), kind_of(diagnosis)
    offered = {f["name"] for f in findings}
    claimed = {f["name"] for f in findings if verdict != "ambiguous" or f["probability"] >= SURE}
    right = acceptable(truth)
    true_names = frozenset().union(*right)
    flagged = verdict == "unknown" or bool(diagnosis.get("unexplained"))
    category = category_of(truth)
    return Judgement(
        case=case,
        category=category,
        severity=truth.get("severity", ""),
        truth=tuple(f["name"] for f in truth["findings"]) or tuple(truth.get("concealed", ())),
        verdict=verdict,
        claimed=tuple(sorted(claimed)),
        offered=tuple(sorted(offered - claimed)),
        outcome=_outcome(category, verdict, claimed, offered, right),
        wrong=tuple(sorted(claimed - true_names)),
        flagged=flagged,
        stated=tuple((float(f["probability"]), f["name"] in true_names) for f in findings),
        located=_located(truth, diagnosis),
    )


def _outcome(
    category: str, verdict: str, claimed: set[str], offered: set[str], right: list[frozenset[str]]
) -> str:
    if verdict == "failed":
        return "failed"
    true_names = frozenset().union(*right)
    # effects that look alike in these flights: to state one as proven is luck, so that only an open
    # answer with the true one in it is right
    if category == "confounded":
        return (
            "exact"
            if verdict == "ambiguous" and right[0] <= offered
            else _named(claimed, right, true_names, verdict)
        )
    if category == "unknown":
        # no name of the library is true here; what accounts for it as well follows the first
        if claimed and frozenset(claimed) in right[1:]:
            return "exact"
        return (
            "wrong"
            if claimed - true_names
            else "exact"
            if verdict == "unknown"
            else verdict.partition("_")[0]
        )
    if frozenset(claimed) in right and verdict not in ("ambiguous", "unknown"):
        return "exact"
    # the truth is among what was left open, and nothing false was claimed
    if verdict == "ambiguous" and any(r <= offered for r in right) and not claimed - true_names:
        return "hedged"
    return _named(claimed, right, true_names, verdict)


def _named(
    claimed: set[str], right: list[frozenset[str]], true_names: frozenset[str], verdict: str
) -> str:
    if claimed - true_names:
        # the empty answer of a null is in every claim, and makes it no half-right one
        return "extra" if any(r and r <= claimed for r in right) else "wrong"
    if claimed:
        return "partial"
    return "unknown" if verdict == "unknown" else "hedged" if verdict == "ambiguous" else "nothing"


def _located(truth: Mapping, diagnosis: Mapping) -> tuple[int, int, int]:
    """Return (found, too many, missed) channels.

    A trace of an effect is neither to be found nor a mistake. Where nothing is concealed every
    channel is one too many. A truth that states no channels (a sensor fault; other people's cases)
    is not scored.
    """
    # a trace is a channel that an effect reaches, too weakly for it to be demanded
    must = set(truth.get("located", ()))
    may = must | set(truth.get("traces", ()))
    if not may and category_of(truth) != "null":
        return (0, 0, 0)
    got = {_channel(entry["channel"]) for entry in diagnosis.get("located", [])}
    return (len(must & got), len(got - may), len(must - got))


def _channel(name: str) -> str:
    """Specific force is force; the four drives are one channel."""
    return "drive" if name.startswith("drive") else name.replace("acc_", "force_")
