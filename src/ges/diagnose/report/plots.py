"""Pictures of a diagnosis for notebooks, each on given axes or on those of a new figure."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ges.diagnose.prove.verify import horizon_times_s
from ges.diagnose.report import figures, pictures
from ges.errors import UsageError, unknown_name

if TYPE_CHECKING:
    from ges.diagnose.report.diagnosis import Diagnosis


class Plots:
    """The pictures of the page of a diagnosis, by the names of their files.

    A picture that the diagnosis has no data for is a :class:`~ges.errors.UsageError`.

    Parameters
    ----------
    diagnosis : as :func:`~ges.diagnose.pipeline.diagnose` returns it.

    Examples
    --------
    >>> axes = found.plot.rollout("p_x_m")
    >>> axes.get_ylabel()
    'rms error, m'
    """

    def __init__(self, diagnosis: Diagnosis) -> None:
        self._diagnosis = diagnosis

    def located(self, ax: Axes | None = None) -> Axes:
        """Draw the residual where it is largest, and what the findings add there.

        Parameters
        ----------
        ax : to draw on; those of a new figure by default.
        """
        drawn = figures.located(self._diagnosis)
        if drawn is None:
            raise UsageError("nothing is located on a held-out flight; 'found.located' is empty")
        with _axes(ax) as axes:
            pictures.draw_residual(axes, *drawn)
        return axes

    def where(self, regime: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the mean residual over its standard error, by channel and bin of one regime.

        Parameters
        ----------
        regime : ``height_over_radius`` or another that was flown; the first by default.
        ax : to draw on; those of a new figure by default.
        """
        cells = list(map(dataclasses.asdict, self._diagnosis.workings.cells))
        chosen = _chosen("regime", regime, [c["regime"] for c in cells])
        with _axes(ax) as axes:
            channels = pictures.clearest_channels(cells)
            drawn = pictures.draw_map(axes, [c for c in cells if c["regime"] == chosen], channels)
            axes.figure.colorbar(drawn, ax=axes, label=pictures.MAP_LABEL)
        return axes

    def parameters(self, ax: Axes | None = None) -> Axes:
        """Draw fitted parameters with 95 % intervals, each on its own scale.

        Parameters
        ----------
        ax : to draw on; those of a new figure by default.
        """
        rows = figures.parameters(self._diagnosis)
        if not rows:
            raise UsageError("no parameter was fitted, so there is none to draw")
        with _axes(ax, len(rows)) as axes:
            labels = pictures.draw_parameters(axes, rows)
            axes.legend(labels.values(), labels.keys(), loc="upper center", bbox_to_anchor=(0.5, 0))
        return axes

    def held_out(self, ax: Axes | None = None) -> Axes:
        """Draw errors on held-out flights by stage, each over that of the vehicle file.

        Parameters
        ----------
        ax : to draw on; those of a new figure by default.
        """
        channels = figures.held_out(self._diagnosis)
        if not channels:
            raise UsageError("no flight was held out, so there is no error on one to draw")
        with _axes(ax, len(channels)) as axes:
            pictures.draw_held_out(axes, channels)
            axes.legend()
        return axes

    def rollout(self, channel: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw how the error of an open-loop simulation grows.

        Parameters
        ----------
        channel : contract column, as ``p_z_m``; the first that was simulated by default.
        ax : to draw on; those of a new figure by default.
        """
        errors = self._diagnosis.workings.proof.rollouts
        chosen = _chosen("channel", channel, list(errors))
        with _axes(ax) as axes:
            pictures.draw_rollout(axes, horizon_times_s(), errors[chosen], chosen)
            axes.legend()
        return axes

    def over_time(
        self, channel: str | None = None, flight: str | None = None, ax: Axes | None = None
    ) -> Axes:
        """Draw one signal of a flight over time, recorded and simulated.

        Parameters
        ----------
        channel : as ``force_x_N``; the first of the flight by default.
        flight : its name; the first that was held out by default.
        ax : to draw on; those of a new figure by default.
        """
        traces = sorted(figures.traces_of(self._diagnosis), key=lambda t: not t.held_out)
        by_name = {t.flight: t for t in traces}
        trace = by_name[_chosen("flight", flight, list(by_name))]
        with _axes(ax) as axes:
            pictures.draw_signal(axes, trace, _chosen("channel", channel, trace.channels))
            axes.set_xlabel(f"time, s ({trace.flight})")
            axes.legend()
        return axes


@contextmanager
def _axes(given: Axes | None, rows: int = 6) -> Iterator[Axes]:
    """Yield the axes to draw on, in the style of the page; new ones have room for ``rows``."""
    with mpl.rc_context(pictures.STYLE):
        size_in = (pictures.WIDTH_IN, 0.4 + 0.5 * rows)
        yield given or plt.subplots(figsize=size_in, layout="constrained")[1]


def _chosen(what: str, name: str | None, known: Sequence[str]) -> str:
    if not known:
        raise UsageError(f"these flights have no {what} to draw")
    if name is not None and name not in known:
        raise unknown_name(what, name, known)
    return name or known[0]
