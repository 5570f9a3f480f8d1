"""The verdict, one word of the contract, and what there is to say beside the sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ges.diagnose.decide.declared import Contradicted
from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import UnmeasuredThrust
from ges.diagnose.library.requirements import not_spoken_about
from ges.diagnose.types.diagnosis import Finding


def verdict_of(
    findings: Sequence[Finding],
    wrong: Sequence[Contradicted],
    laws: Sequence[FittedLaw],
    unexplained: Sequence[Mapping],
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
    if laws:
        return "law"
    return "unknown" if unexplained or wrong else "nothing_proven"


def remark_of(
    verdict: str,
    wrong: Sequence[Contradicted],
    shift: Shift | UnmeasuredThrust | None,
    off: Mapping[str, str],
) -> str:
    """What there is to say beside the sentence: why something is open and how to find out, declared
    numbers that the flights contradict, and what a verdict of nothing proven does not speak about.

    Parameters
    ----------
    wrong : declared numbers that the flights contradict.
    shift : what moved, where the flights cannot tell by which of several causes.
    off : channels that no flight speaks about, each with what to log.
    """
    sentences = [shift.sentence()] if shift else []
    sentences += [number.sentence() for number in wrong]
    sentences += [not_spoken_about(off)] if verdict == "nothing_proven" else []
    return " ".join(s.strip() for s in sentences if s)
