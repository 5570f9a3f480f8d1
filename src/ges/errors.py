"""Errors that speak to a person: what was wrong, the value met, what is allowed, what to do."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable


def visible(text: str) -> str:
    """Write control characters out: a log may name anything, commands to a terminal among it.

    Parameters
    ----------
    text : one line for a person.

    Examples
    --------
    >>> from ges.errors import visible
    >>> visible("two\\nlines") == r"two\\nlines"
    True
    """
    return re.sub("[\x00-\x1f\x7f-\x9f\ud800-\udfff]", lambda met: repr(met[0])[1:-1], text)


class GesError(Exception):
    """A request that could not be carried out, with one sentence for a person.

    The sentence says what was wrong, where, what is allowed and what to do. The command line prints
    it without a traceback.

    Attributes
    ----------
    exit_code : exit status of the command line, 1.

    Examples
    --------
    >>> from ges.errors import GesError
    >>> try:
    ...     load_set("no-such-folder")
    ... except GesError as error:
    ...     print(str(error).partition(";")[0])
    there is no folder no-such-folder
    """

    exit_code = 1

    def __str__(self) -> str:
        return visible(super().__str__())


class UsageError(GesError):
    """A request that is wrong in itself: an unknown name, or a value that is not possible.

    Attributes
    ----------
    exit_code : exit status of the command line, 2.

    Examples
    --------
    >>> from ges.errors import UsageError
    >>> try:
    ...     load_vehicle("crazyflie-2.2")
    ... except UsageError as error:
    ...     print(error, error.exit_code)
    unknown vehicle 'crazyflie-2.2'; did you mean 'crazyflie-2.1'? 2
    """

    exit_code = 2


def unknown_name(kind: str, name: str, known: Iterable[str], lister: str = "") -> UsageError:
    """Build the error for a name that does not exist.

    Parameters
    ----------
    kind : what the name should name, for the message.
    name : the name given.
    known : all names that exist.
    lister : command or page that lists them, for names that are too many for a sentence.

    Returns
    -------
    The error, with the nearest known name where one is near, else with all of them or the lister.
    """
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=1)
    hints = [f"did you mean '{near[0]}'?"] if near else []
    hints += [f"'{lister}' lists all that are known"] if lister else []
    hint = " ".join(hints) or "known: " + ", ".join(known)
    return UsageError(f"unknown {kind} '{name}'; {hint}")
