"""Drawing the figures of a diagnosis, each as soon as it can be: importable at once, what draws
them takes a second to read.
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
    """The figures of one folder; each is drawn once."""

    def __init__(self, out: Path, begin: Begin = at_once) -> None:
        self._out, self._begin = out, begin
        self._begun: dict[str, tuple[Callable[[], list[bytes]], int]] = {}

    def start(self, figures: Sequence[Figure]) -> None:
        """Begin to draw those that were not begun before."""
        new = [f for f in figures if f[0] not in self._begun]
        if new:
            self._out.mkdir(parents=True, exist_ok=True)
            pictures = self._begin(partial(_drawn, self._out), new)
            self._begun |= {name: (pictures, i) for i, (name, *_) in enumerate(new)}

    def pictures(self, figures: Sequence[Figure]) -> Mapping[str, bytes]:
        """The figures as PNG, by name, once all of them are written."""
        self.start(figures)
        begun = {name: self._begun[name] for name, *_ in figures}
        return {name: pictures()[i] for name, (pictures, i) in begun.items()}


@contextmanager
def drawing(out: Path) -> Iterator[Drawing]:
    """Drawing by processes that get ready while the caller goes on."""
    with apart(_ready) as begin:
        yield Drawing(out, begin)


def _ready() -> None:
    from ges.diagnose.report import pictures

    # one empty figure reads fonts and back ends before the first is asked for
    pictures.png(pictures.Figure(figsize=(1.0, 1.0)))


def _drawn(out: Path, figure: Figure) -> bytes:
    """The picture of one figure, which is written too."""
    from ges.diagnose.report import pictures

    name, draw, arguments = figure
    return pictures.save(getattr(pictures, draw)(*arguments), out, name)
