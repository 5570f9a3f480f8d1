"""The verdict, one word of the contract, and the remark that goes with the sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ges.diagnose.decide.contradicted import Contradicted, corrected_numbers
from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import UnmeasuredThrust
from ges.diagnose.library.requirements import silent_channels_words
from ges.diagnose.types.finding import Finding


def verdict_of(
    findings: Sequence[Finding],
    contradicted: Sequence[Contradicted],
    laws: Sequence[FittedLaw],
    unexplained: Sequence[Mapping],
) -> str:
    """Return the verdict.

    Parameters
    ----------
    findings : of the diagnosis.
    contradicted : nominal parameters that the flights contradict.
    laws : that were found.
    unexplained : entries of ``unexplained``.

    Returns
    -------
    One of the words of ``verdict`` in the contract.
    """
    if any(f.is_open for f in findings):
        return "ambiguous"
    kinds = {f.kind for f in findings}
    for kind in ("physics", "sensor", "parameter"):
        if kind in kinds:
            return kind
    if any(not parameter.is_trim for parameter in contradicted):
        return "parameter"
    if laws:
        return "law"
    return "unknown" if unexplained or contradicted else "nothing_proven"


def remark_of(
    verdict: str,
    contradicted: Sequence[Contradicted],
    unnamed_cause: Shift | UnmeasuredThrust | None,
    off: Mapping[str, str],
) -> str:
    """Return what there is to say besides the sentence.

    Parameters
    ----------
    verdict : of :func:`verdict_of`.
    contradicted : nominal parameters that the flights contradict.
    unnamed_cause : a shifted balance or unmeasured thrust; None without one.
    off : channels without data, each with what to log.

    Returns
    -------
    Why something is open and how to find out, what is contradicted, and what *nothing proven* does
    not cover.
    """
    sentences = [unnamed_cause.sentence()] if unnamed_cause else []
    # the farthest first: of several corrections of one number, as lags up and down, it stands alone
    of_number: dict[str, Contradicted] = {}
    for parameter in contradicted:
        of_number.setdefault(corrected_numbers(parameter.key), parameter)
    sentences += [parameter.sentence() for parameter in of_number.values()]
    sentences += [silent_channels_words(off)] if verdict == "nothing_proven" else []
    return " ".join(s.strip() for s in sentences if s)
