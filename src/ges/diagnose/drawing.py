"""Drawing the figures of a diagnosis by other processes: importable at once, as what it needs takes them a second to read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from ..threads import apart


def drawing() -> AbstractContextManager[Callable[..., list]]:
    """An ``each`` for :func:`ges.diagnose.output.write_diagnosis`, by processes that get ready while the caller goes on."""
    return apart(_ready)


def _ready() -> None:
    from .pictures import Figure, png

    png(Figure(figsize=(1.0, 1.0)))


def drawn(out: Path, figure: tuple[str, str, Sequence]) -> bytes:
    """The picture of one figure, given by name, function of ``pictures`` and its arguments; which is written too."""
    from . import pictures

    name, draw, arguments = figure
    return pictures.save(getattr(pictures, draw)(*arguments), out, name)
