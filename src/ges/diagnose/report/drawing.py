"""Drawing of a diagnosis's figures, each as soon as its data are there.

The module imports quickly; matplotlib takes a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from ges.threads import Begin, apart, at_once

Figure = tuple[str, str, Sequence]
"""Name, function of ``pictures`` and its arguments."""
Drawn = Mapping[str, bytes]
"""A picture by the ending of its file: ``png``, ``pdf``."""


class Drawing:
    """The figures of one diagnosis, each drawn once.

    Parameters
    ----------
    begin : how work is started, here or in other processes.
    """

    def __init__(self, begin: Begin = at_once) -> None:
        self._begin = begin
        self._begun: dict[str, tuple[Callable[[], list[Drawn]], int]] = {}

    def start(self, figures: Sequence[Figure]) -> None:
        """Begin to draw the figures that were not begun before.

        Parameters
        ----------
        figures : name, function of ``pictures`` and its arguments.
        """
        new = [f for f in figures if f[0] not in self._begun]
        if new:
            pictures = self._begin(_draw, new)
            self._begun |= {name: (pictures, i) for i, (name, *_) in enumerate(new)}

    def pictures(self, figures: Sequence[Figure]) -> Mapping[str, Drawn]:
        """Return figures by name, once all of them are drawn.

        Parameters
        ----------
        figures : as for :meth:`start`.
        """
        self.start(figures)
        begun = {name: self._begun[name] for name, *_ in figures}
        return {name: pictures()[i] for name, (pictures, i) in begun.items()}


@contextmanager
def drawing() -> Iterator[Drawing]:
    """Draw by processes that start up while the caller goes on.

    Yields
    ------
    A :class:`Drawing`.
    """
    with apart(_load_fonts) as begin:
        yield Drawing(begin)


def _load_fonts() -> None:
    """Draw one empty figure, which reads fonts and back ends before the first is asked for."""
    from ges.diagnose.report import pictures

    pictures.png(pictures.Figure(figsize=(1.0, 1.0)))


def _draw(figure: Figure) -> Drawn:
    """Draw one figure."""
    from ges.diagnose.report import pictures

    _, draw, arguments = figure
    drawn = getattr(pictures, draw)(*arguments)
    # the PDF takes its layout from the PNG, so it comes second
    return {"png": pictures.png(drawn), "pdf": pictures.pdf(drawn)}
