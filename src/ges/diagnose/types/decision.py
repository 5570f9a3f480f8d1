"""Decisions about a name, and the record of what was considered."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any


@dataclasses.dataclass(frozen=True)
class Decision:
    """What one rule said of one name.

    Attributes
    ----------
    rule : name of the rule.
    passed : whether the name goes on to the next rule.
    because : in words, what was weighed.
    statistic, threshold : what was held against what; None where the rule holds no numbers.
    """

    rule: str
    passed: bool
    because: str
    statistic: float | None = None
    threshold: float | None = None

    def content(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "rule": self.rule,
            "passed": self.passed,
            "statistic": self.statistic,
            "threshold": self.threshold,
            "because": self.because,
        }


@dataclasses.dataclass(frozen=True)
class Considered:
    """A candidate, where it acts (``rotor 3``; '' everywhere), its posterior probability beside all
    rivals (None where it was not weighed), and the decisions about it in their order.
    """

    name: str
    place: str
    probability: float | None
    decisions: tuple[Decision, ...]

    def content(self) -> dict[str, Any]:
        """An entry of ``considered`` of diagnosis.json."""
        return {
            "name": self.name,
            "place": self.place,
            "probability": self.probability,
            "decisions": [d.content() for d in self.decisions],
        }


class Record:
    """Decisions as they are made: the last of each rule about each name."""

    def __init__(self) -> None:
        self._decisions: dict[str, dict[str, Decision]] = {}

    def note(self, name: str, decision: Decision) -> None:
        """Keep a decision; one of the same rule about the same name is replaced."""
        rules = self._decisions.setdefault(name, {})
        # taken out first, so that it stands last: later rounds of the search ask a rule again
        rules.pop(decision.rule, None)
        rules[decision.rule] = decision

    def of(self, name: str) -> tuple[Decision, ...]:
        """Decisions about a name, in the order in which they were last made."""
        return tuple(self._decisions.get(name, {}).values())

    @property
    def names(self) -> Mapping[str, Any]:
        """All names that something was decided about."""
        return self._decisions
