"""Decisions of the rules about effects, and the record of everything that was considered."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any


@dataclasses.dataclass(frozen=True)
class Decision:
    """Outcome of one rule for one name.

    Attributes
    ----------
    rule : name of the rule.
    passed : whether the name goes on to the next rule.
    because : the comparison, in words.
    statistic, threshold : the two numbers that were compared; None where the rule compares none.
    """

    rule: str
    passed: bool
    because: str
    statistic: float | None = None
    threshold: float | None = None


@dataclasses.dataclass(frozen=True)
class Considered:
    """A candidate effect and all that was decided about it.

    Attributes
    ----------
    name : the effect.
    place : where it acts, ``rotor 3``; '' where it acts everywhere.
    probability : posterior probability among all rivals; None where it was not computed.
    decisions : of the rules, in their order.
    """

    name: str
    place: str
    probability: float | None
    decisions: tuple[Decision, ...]

    def content(self) -> dict[str, Any]:
        """Return the candidate as an entry of ``considered`` of diagnosis.json."""
        return dataclasses.asdict(self)


class DecisionLog:
    """Log of decisions: the latest one of each rule about each name.

    Notes
    -----
    The rules write to it while a diagnosis runs; :class:`Considered` takes its decisions from it.
    """

    def __init__(self) -> None:
        self._decisions: dict[str, dict[str, Decision]] = {}

    def note(self, name: str, decision: Decision) -> None:
        """Keep a decision about a name.

        Parameters
        ----------
        name : the effect.
        decision : replaces an earlier one of the same rule about the same name.
        """
        rules = self._decisions.setdefault(name, {})
        # taken out first, so that it stands last: later rounds of the search ask a rule again
        rules.pop(decision.rule, None)
        rules[decision.rule] = decision

    def become(self, other: DecisionLog) -> None:
        """Take the decisions of another log in place of all its own.

        Parameters
        ----------
        other : of a search that was done again.
        """
        self._decisions = other._decisions

    def of(self, name: str) -> tuple[Decision, ...]:
        """Return the decisions about a name.

        Parameters
        ----------
        name : the effect; a name that was never decided about has none.

        Returns
        -------
        Decisions in the order in which they were last made.
        """
        return tuple(self._decisions.get(name, {}).values())

    @property
    def names(self) -> Mapping[str, Any]:
        """All names that something was decided about."""
        return self._decisions
