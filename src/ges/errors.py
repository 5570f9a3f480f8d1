"""Errors that speak to a person: what was wrong, the value met, what is allowed, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GesError(Exception):
    """Something could not be done; the command line prints the message and exits with 1."""

    exit_code = 1


class UsageError(GesError):
    """The request itself was wrong (unknown name, impossible value); exits with 2."""

    exit_code = 2


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UsageError:
    """Build the error for a name that does not exist, with the nearest one that does."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{near[0]}'?" if near else "known: " + ", ".join(known)
    return UsageError(f"unknown {kind} '{name}'; {hint}")
