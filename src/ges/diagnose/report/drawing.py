"""Drawing of a diagnosis's figures, each as soon as its data are there.

The module imports quickly; matplotlib takes a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from ges.threads import Begin, apart, at_once

Figure = tuple[str, str, Sequence]
"""Name, function of ``pictures`` and its arguments."""


class Drawing:
    """The figures of one folder, each drawn once.

    Parameters
    ----------
    out : the folder.
    begin : how work is started, here or in other processes.
    """

    def __init__(self, out: Path, begin: Begin = at_once) -> None:
        self._out, self._begin = out, begin
        self._begun: dict[str, tuple[Callable[[], list[bytes]], int]] = {}

    def start(self, figures: Sequence[Figure]) -> None:
        """Begin to draw the figures that were not begun before.

        Parameters
        ----------
        figures : name, function of ``pictures`` and its arguments.
        """
        new = [f for f in figures if f[0] not in self._begun]
        if new:
            self._out.mkdir(parents=True, exist_ok=True)
            pictures = self._begin(partial(_draw, self._out), new)
            self._begun |= {name: (pictures, i) for i, (name, *_) in enumerate(new)}

    def pictures(self, figures: Sequence[Figure]) -> Mapping[str, bytes]:
        """Return figures as PNG by name, once all of them are written.

        Parameters
        ----------
        figures : as for :meth:`start`.
        """
        self.start(figures)
        begun = {name: self._begun[name] for name, *_ in figures}
        return {name: pictures()[i] for name, (pictures, i) in begun.items()}


@contextmanager
def drawing(out: Path) -> Iterator[Drawing]:
    """Draw by processes that start up while the caller goes on.

    Parameters
    ----------
    out : folder of the figures.

    Yields
    ------
    A :class:`Drawing`.
    """
    with apart(_ready) as begin:
        yield Drawing(out, begin)


def _ready() -> None:
    from ges.diagnose.report import pictures

    # one empty figure reads fonts and back ends before the first is asked for
    pictures.png(pictures.Figure(figsize=(1.0, 1.0)))


def _draw(out: Path, figure: Figure) -> bytes:
    """Draw and write one figure; its PNG."""
    from ges.diagnose.report import pictures

    name, draw, arguments = figure
    return pictures.save(getattr(pictures, draw)(*arguments), out, name)
