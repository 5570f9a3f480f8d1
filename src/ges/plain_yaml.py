"""YAML files of plain data: whatever a file holds, it is read or refused in one sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from ges.errors import GesError, UsageError

LARGEST_BYTES = 1_000_000
"""Of a file that people write; this many take a minute to read."""


class _Loader(yaml.SafeLoader):
    """Safe, with the floats of YAML 1.2, and without aliases of aliases.

    By those a file of a few lines grows without end.
    """

    anchored = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the node of the next event."""
        event = self.peek_event()
        alias = isinstance(event, yaml.AliasEvent)
        if alias and self.anchored:
            raise yaml.MarkedYAMLError(
                problem="an alias in what has an anchor; write it out",
                problem_mark=event.start_mark,
            )
        names_itself = not alias and event.anchor is not None
        self.anchored += names_itself
        node = super().compose_node(parent, index)
        self.anchored -= names_itself
        return node


# 1e-6 is a number to everybody but YAML 1.1, which asks for 1.0e-6
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+\.?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def read_yaml(path: Path, what: str) -> Any:
    """Return the content of a YAML file.

    Parameters
    ----------
    path : the file.
    what : is asked for, for people, as ``vehicle file``.

    Raises
    ------
    GesError
        Where it cannot be read, or is no YAML of plain data.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise GesError(f"cannot read the {what} {path}: {error.strerror}") from None
    if len(data) > LARGEST_BYTES:
        raise UsageError(
            f"{path.name} has {len(data) / 1e6:.1f} MB; a {what} has {LARGEST_BYTES / 1e6:g} MB at"
            " most"
        )
    try:
        return yaml.load(data.decode(), _Loader)
    except (yaml.YAMLError, RecursionError) as error:
        raise UsageError(f"{path.name} is not YAML: {_reason(error)}") from None
    # numbers of too many digits and days that no month has
    except (ValueError, OverflowError) as error:
        raise UsageError(f"{path.name} is not YAML of plain data: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "it nests too deep"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem and error.problem_mark:
        return f"{error.problem}, in line {error.problem_mark.line + 1}"
    return " ".join(str(error).split())
