"""Stages of a vehicle model: as given, recalibrated, with findings, each with its residuals."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.conventions import SDS_95
from ges.diagnose.design.system import System, build, window_length_s
from ges.diagnose.detectors.balance import without_mean_balance
from ges.diagnose.estimate.joint import (
    JointFit,
    null_fit,
    only_in_air,
    raw_residuals,
    with_corrections,
)
from ges.diagnose.estimate.recalibrate import at_corrections, checked_fit, operating_point
from ges.diagnose.locate.regimes import (
    Cell,
    regime_cells,
    regimes_of,
    unresolved_variances,
    with_known_speeds,
)
from ges.diagnose.locate.structure import Regimes, Structure, structures
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import Regression
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Stage:
    """A model, the fit behind it, and its residuals.

    Attributes
    ----------
    model : with the fitted numbers.
    joint : the fit.
    regression : what was fitted.
    residuals : by flight, (m, C), in the channels' units.
    residuals_in_air : by flight, (m, C), NaN for windows on the ground.
    structures : what a smooth function of a regime variable predicts of them.
    """

    model: Model
    joint: JointFit
    regression: Regression
    residuals: Sequence[np.ndarray]
    residuals_in_air: Sequence[np.ndarray]
    structures: list[Structure]


def make_stage(model: Model, joint: JointFit, regression: Regression, regimes: Regimes) -> Stage:
    """Return the stage of a fitted model.

    Parameters
    ----------
    model : with the fitted numbers.
    joint, regression : the fit.
    regimes : by flight, regime variables of all windows.
    """
    residuals = without_mean_balance(raw_residuals(regression.system, joint), regression.system)
    # a drive on the ground is no regime of flight, and would pass for structure; so would what it
    # did before the recording
    residuals_in_air = only_in_air(residuals, regression.system)
    return Stage(
        model,
        joint,
        regression,
        residuals,
        residuals_in_air,
        structures(
            with_known_speeds(residuals_in_air, regression.system),
            regimes,
            regression.system.main,
            regression.system.blocks(settings.statistics.block_s),
            unresolved_variances(regression.system),
        ),
    )


@dataclasses.dataclass(frozen=True)
class Start:
    """The recalibrated vehicle without findings: where the search begins.

    Attributes
    ----------
    nominal : the vehicle file's model.
    system : what the search is linearised about, without candidates.
    regimes : by flight, regime variables of all windows.
    first : the recalibrated stage.
    cells : map of its residuals over the regime variables.
    """

    nominal: Model
    system: System
    regimes: Regimes
    first: Stage
    cells: list[Cell]

    def linearised_about(self, model: Model) -> Start:
        """Return the start of a search that is linearised about another model.

        Parameters
        ----------
        model : of the same vehicle.
        """
        recordings, length_s = self.system.recordings, self.system.length_s
        return dataclasses.replace(self, system=build(recordings, model, (), length_s=length_s))


def recalibrate(flights: Sequence[Prepared], nominal: Model) -> Start:
    """Set the nominal parameters within their prior sds, and look at the remaining residuals.

    Parameters
    ----------
    flights : that take part in the fit.
    nominal : the vehicle file's model.

    Notes
    -----
    Corrections multiply each other, so the columns are computed again where the model stands.
    Shorter parts of long flights come first, see :func:`nested_parts`.
    """
    regression, joint = _linearised_fit(flights, nominal)
    joint = checked_fit(regression, joint)
    system = regression.system
    regimes = regimes_of(system)
    first = make_stage(with_corrections(nominal, joint.common), joint, regression, regimes)
    return Start(
        nominal,
        system,
        regimes,
        first,
        regime_cells(system, first.residuals_in_air, regimes, first.structures),
    )


def relinearise(start: Start, effects: effect_table.Effects) -> Start | None:
    """Return the start with the search linearised where the nominal parameters are with effects.

    Parameters
    ----------
    start : the recalibrated vehicle.
    effects : that were accepted, with their values.

    Returns
    -------
    None where no nominal parameter is moved by more than its prior allows.

    Notes
    -----
    A nominal parameter and an effect multiply each other: an inertia divides the moments of a drag.
    About a place that is far off, the search needs other names to make up for that.
    """
    corrections = far_corrections(start, effects)
    if not corrections:
        return None
    return start.linearised_about(at_corrections(start.nominal, corrections))


def far_corrections(start: Start, effects: effect_table.Effects) -> dict[str, float]:
    """Return the corrections of nominal parameters that flights ask for with effects.

    Parameters
    ----------
    start, effects : as for :func:`relinearise`.

    Returns
    -------
    By ``effect.parameter``, in its unit; empty where none is beyond 95 % of its prior from where
    the search is linearised.
    """
    system, nominal = start.system, start.nominal
    # an effect may have numbers of its own to correct
    fitted = _linearised_fit(system.recordings, nominal.with_effects(effects))[1].common
    # trims are no numbers of the file: what a rotor lost would be taken for where it was
    of_file = set(system.nuisances) & set(nominal.prior_sds)
    corrections = {key: value for key, value in fitted.items() if key in of_file}
    before = system.model.corrections
    far = any(
        abs(value - before.get(key, 0.0)) > SDS_95 * system.prior_sd(key)
        for key, value in corrections.items()
    )
    return corrections if far else {}


def _linearised_fit(flights: Sequence[Prepared], nominal: Model) -> tuple[Regression, JointFit]:
    """Return the fit of the nuisances, linearised about the corrections where the model stands."""
    # corrections multiply each other, so all columns are made where the model comes to stand
    length_s = window_length_s(flights)

    def fit_about(
        corrections: dict[str, float], some: Sequence[Prepared]
    ) -> tuple[Regression, JointFit]:
        there = at_corrections(nominal, corrections)
        return null_fit(build(some, there, (), length_s=length_s))

    corrections: dict[str, float] = {}
    for some in nested_parts(flights):
        corrections = operating_point(*fit_about(corrections, some), nominal) or corrections
    regression, joint = fit_about(corrections, flights)
    for _ in range(settings.numerics.noise_rounds):
        corrections = operating_point(regression, joint, nominal)
        if not corrections:
            break
        regression, joint = fit_about(corrections, flights)
    return regression, joint


def nested_parts(flights: Sequence[Prepared]) -> list[list[Prepared]]:
    """Return ever longer middle parts of the flights, a quarter of the next each.

    Parameters
    ----------
    flights : prepared recordings.

    Returns
    -------
    The shortest parts first, without the whole flights; empty for short flights.

    Notes
    -----
    What short excerpts settle, whole flights correct in a step or two.

    References
    ----------
    Bottou, Curtis and Nocedal 2018, SIAM Rev. 60, 223.
    """
    excerpts: list[list[Prepared]] = []
    some = list(flights)
    while max(_seconds(f) for f in some) >= 4.0 * settings.advise.duration_s:
        some = [_middle(f, max(0.25 * _seconds(f), settings.advise.duration_s)) for f in some]
        excerpts.append(some)
    return excerpts[::-1]


def _seconds(flight: Prepared) -> float:
    return len(flight.t_s) * flight.dt_s


def _middle(flight: Prepared, seconds: float) -> Prepared:
    """Return the part of this length about the middle of the time in the air."""
    rows = min(len(flight.t_s), round(seconds / flight.dt_s))
    air = np.flatnonzero(flight.flying)
    center = int(air[len(air) // 2]) if len(air) else len(flight.t_s) // 2
    start = min(max(0, center - rows // 2), len(flight.t_s) - rows)
    return flight.between(start, start + rows)
