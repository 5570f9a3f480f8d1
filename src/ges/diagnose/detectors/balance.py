"""Has the balance of thrust and moments left what healthy flights do among themselves, and towards
which rotor?

A vehicle file from ``ges calibrate`` states how far the gain of every motor may be off in a later
flight. What goes beyond is one number in each of four directions (thrust, roll, pitch, yaw), and
two single causes near one rotor ask for nearly the same answer of the controller: a rotor that lost
thrust, and a mass at its hub. They differ in yaw alone. The search weighs names one by one against
nothing; here the two are held against each other, so that a change which is certain while its cause
is not is told as such.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from scipy.special import expit, ndtri

from ges.conventions import MAX_ROTORS, SDS_95, rotor_columns
from ges.diagnose.design.system import System, nuisance_of
from ges.diagnose.prepare.align import attitude_measured
from ges.diagnose.settings import settings
from ges.diagnose.types.diagnosis import Estimate, Finding, interval95
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

CHANNELS = ("force_z", "moment_x", "moment_y", "moment_z")
LOSSES = rotor_columns("weak_rotor.loss_{}", MAX_ROTORS)
MASS = ("cg_offset.x_m", "cg_offset.y_m", "thrust_scale.scale")
CANT = "rotor_cant.angle_rad"


def losses_of(model: Model) -> tuple[str, ...]:
    """Keys of the losses of the rotors that a vehicle has."""
    return LOSSES[: model.n_rotors]


def _mean_variance(values: np.ndarray, block: int) -> float:
    """Variance of the mean of one flight's windows, from blocks of time; nan where there is but one
    block.
    """
    blocks = [values[k : k + block].mean() for k in range(0, len(values), block)]
    return float(np.var(blocks, ddof=1) / len(blocks)) if len(blocks) > 1 else np.nan


def variance_of_means(system: System, channels: Sequence[int]) -> np.ndarray:
    """Variance of a flight's mean residual in the air in c channels, (c,), in their squared units,
    from blocks of time, mean of the flights.
    """
    block_s = settings.statistics.block_s
    # windows stand half a length apart
    block = max(1, int(round(2.0 * block_s / system.flights[0].windows.length_s)))
    return np.nanmean(
        [[_mean_variance(e, block) for e in r.in_air(channels).T] for r in system.flights], axis=0
    )


@dataclasses.dataclass(frozen=True)
class Cause:
    """One cause near one rotor: amplitude (loss, or kg), its sd, and the squared distance that it
    explains.
    """

    rotor: int
    value: float
    sd: float
    explained: float

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval."""
        return interval95(self.value, self.sd)


@dataclasses.dataclass(frozen=True)
class Shift:
    """A balance that moved: both causes at the rotor that explains it best, and whether the load's
    swing could be seen.
    """

    system: System
    loss: Cause
    mass: Cause
    swing_seen: bool

    may_move: ClassVar[frozenset[str]] = frozenset()
    """Effects whose declared numbers it can move: none."""

    @property
    def rotor(self) -> int:
        """Number of the rotor, from 1."""
        return self.loss.rotor

    @property
    def gained(self) -> float:
        """Squared distance that the better cause explains, in sd^2."""
        return max(self.loss.explained, self.mass.explained)

    def sentence(self) -> str:
        """Where the balance went, what would do it, and how to find out."""
        away, odds = self.gained**0.5, np.exp(0.5 * abs(self.loss.explained - self.mass.explained))
        lost = f"{100 * self.loss.value:.0f} +- {100 * SDS_95 * self.loss.sd:.0f} %"
        grams = f"{1e3 * self.mass.value:.2f} +- {1e3 * SDS_95 * self.mass.sd:.2f} g"
        i = self.rotor
        return (
            f"Since the calibration the balance of thrust and moments has moved towards rotor {i},"
            f" {away:.1f} sd beyond what healthy flights do among themselves. A rotor {i} that lost"
            f" {lost} of its thrust or {grams} near rotor {i} (fixed or hanging) would do it; the"
            f" two differ in yaw alone, too little here (odds {odds:.0f}:1). Weigh the vehicle, or"
            f" fly the same with a new propeller {i}: the shift then goes if the propeller was the"
            " cause, and stays if a mass is."
        )

    def next_flight(self) -> dict:
        """``next_flight`` of diagnosis.json: what a healthy balance would be worth against the
        shift that was seen.
        """
        return {
            "manoeuvre": "hover",
            "preparation": f"a new propeller on rotor {self.rotor}",
            "separates": ["weak_rotor", "cg_offset+thrust_scale"],
            "stays_open": [],
            "expected_log_odds": 0.5 * self.gained,
            "so_far_log_odds": 0.5 * abs(self.loss.explained - self.mass.explained),
        }

    def findings(self) -> list[Finding]:
        """Both causes in the library's names; their probabilities are those of each given that one
        of them acts, as much less sure than the balance as what a search says.
        """
        model, i = self.system.model, self.rotor
        # half the difference of squared distances: log odds of the loss against the mass
        lead = 0.5 * (self.loss.explained - self.mass.explained)
        share = expit(settings.search.log_odds_slope * lead)
        # a kilogram at a hub moves the centre of gravity by the hub's place over the mass,
        # and thrust carries as much more: a thrust scale of minus one over the mass
        per_kg = 1.0 / model.number("mass_kg")
        start = {
            key: model.effects.get(key.split(".")[0], {}).get(key.split(".")[1], 0.0)
            for key in (*losses_of(model), *MASS)
        }
        lost = {f"loss_{i}": (start[LOSSES[i - 1]], 1.0)}
        hub = {
            f"{a}_m": (start[f"cg_offset.{a}_m"], per_kg * model.number(f"rotor_{i}_{a}_m"))
            for a in "xy"
        }
        heavier = [("cg_offset", hub), ("thrust_scale", {"scale": (start[MASS[2]], -per_kg)})]
        # a mass that hangs would swing, and an attitude that was measured shows that
        heavier += [] if self.swing_seen else [("slung_load", {"mass_kg": (0.0, 1.0)})]
        return [
            _named("weak_rotor", share, lost, self.loss),
            *(_named(n, 1.0 - share, p, self.mass) for n, p in heavier),
        ]


def _named(
    name: str, probability: float, parameters: dict[str, tuple[float, float]], cause: Cause
) -> Finding:
    """A cause as a finding: parameters as start and change per unit of its amplitude."""
    units = {p.name: p.unit for p in effect_table.get(name).parameters}
    told = {}
    for key, (start, per) in parameters.items():
        low, high = sorted(start + per * v for v in cause.ci95)
        note = f"near rotor {cause.rotor}" + (
            f"; the vehicle file has {start:.3g}" if start else ""
        )
        told[key] = Estimate(start + per * cause.value, (low, high), units[key], note)
    return Finding.of(name, float(probability), told, is_open=True)


def _stated(system: System, column: Mapping[str, int]) -> bool:
    """Whether the vehicle file, a calibrated one, states how far the gain of every motor may be
    off.
    """
    gains = "weak_rotor" in system.model.effects and {*losses_of(system.model), *MASS} <= set(
        column
    )
    return gains and set(CHANNELS) <= set(system.main)


def without_mean_balance(left: Sequence[np.ndarray], system: System) -> list[np.ndarray]:
    """Residuals of the plain averages (m, C) by flight, less their mean over all flights where
    :func:`shift_of` judges it.
    """
    if not _stated(system, system.nuisances):
        return list(left)
    slow = [system.main.index(c) for c in CHANNELS]
    mean = np.zeros(len(system.main))
    mean[slow] = np.nanmean(np.concatenate(left)[:, slow], axis=0)
    return [rows - mean for rows in left]


def causes_of(system: System) -> list[tuple[Cause, Cause]]:
    """By rotor, its loss and a mass at its hub, each as if it alone had changed; none without a
    calibrated file.

    Parameters
    ----------
    system : nuisance columns suffice; those of ``weak_rotor``, ``cg_offset`` and ``thrust_scale``
        are read.
    """
    column = system.nuisances
    if not _stated(system, column):
        return []
    y, x, precision = _distance(system, [*losses_of(system.model), *MASS], column)
    directions = [(_loss(x, i), _mass(x, i, system)) for i in range(system.model.n_rotors)]
    return [
        (_weigh(y, lost, precision, i), _weigh(y, heavy, precision, i))
        for i, (lost, heavy) in enumerate(directions, 1)
    ]


def _strongest(weighed: Sequence[tuple[Cause, Cause]]) -> tuple[Cause, Cause]:
    """Both causes at the rotor that explains most."""
    return max(weighed, key=lambda pair: max(c.explained for c in pair))


def shift_of(system: System) -> Shift | None:
    """The shift, where the balance leaves what a calibrated file allows and its cause is open; else
    None.
    """
    weighed = causes_of(system)
    if not weighed:
        return None
    loss, mass = _strongest(weighed)
    # Bonferroni over two causes at every rotor; each of them explains on one side only
    least = ndtri(settings.statistics.chance / (2 * len(weighed))) ** 2
    gained, between = max(loss.explained, mass.explained), abs(loss.explained - mass.explained)
    seen = attitude_measured([r.flight for r in system.flights])
    return Shift(system, loss, mass, seen) if gained > least and between < _told_apart() else None


def _told_apart() -> float:
    """Difference of two squared distances at which the chance of the wrong cause is a healthy
    flight's of being called changed.
    """
    # chance = 1 / (1 + exp(difference / 2))
    chance = settings.statistics.chance
    return 2.0 * float(np.log(1.0 / chance - 1.0))


def _distance(
    system: System, keys: Sequence[str], column: dict[str, int]
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Mean residuals (4,), mean columns by key (4,) and the inverse covariance of the former under
    the file's doubts, that on the cant of the rotors among them.
    """
    keys = [*keys, *({CANT} & set(column))]
    slow, count = [system.names.index(c) for c in CHANNELS], len(system.flights)
    y = np.mean([r.in_air(slow).mean(axis=0) for r in system.flights], axis=0)
    means = np.mean(
        [r.mean_columns(slow, [column[key] for key in keys]) for r in system.flights], axis=0
    )
    x, variance = dict(zip(keys, means.T, strict=True)), variance_of_means(system, slow) / count
    # doubts are noise of the mean; what differs from flight to flight averages out over them
    covariance = np.diag(variance)
    for key in keys:
        n = nuisance_of(system.columns[column[key]])
        covariance += (n.sd**2 + n.flight_sd**2 / count) * np.outer(x[key], x[key])
    return y, x, np.linalg.inv(covariance)


def _loss(x: dict[str, np.ndarray], i: int) -> np.ndarray:
    """Change of the residual by the loss of one rotor."""
    return x[LOSSES[i]]


def _mass(x: dict[str, np.ndarray], i: int, system: System) -> np.ndarray:
    """Change of the residual by a kilogram at one hub: the centre of gravity moves, and the thrust
    weighs less in comparison.
    """
    hub = [system.model.number(f"rotor_{i + 1}_{a}_m") for a in "xy"]
    return (hub[0] * x[MASS[0]] + hub[1] * x[MASS[1]] - x[MASS[2]]) / system.model.number("mass_kg")


def _weigh(y: np.ndarray, direction: np.ndarray, precision: np.ndarray, rotor: int) -> Cause:
    """Generalised least squares of one amplitude; a loss or a mass below zero explains nothing."""
    information = float(direction @ precision @ direction)
    value = float(direction @ precision @ y) / information
    return Cause(rotor, value, information**-0.5, value**2 * information if value > 0 else 0.0)
