"""Shift of the balance of thrust and moments beyond what healthy flights show, and where.

A vehicle file from ``ges calibrate`` states how far the gain of every motor may be off in a later
flight. A larger change has one number in each of four directions: thrust, roll, pitch, yaw. Two
causes near one rotor change the controller's response almost alike: a rotor that lost thrust, and a
mass at its hub. They differ in yaw alone. The search compares names one by one with nothing; here
the two are compared with each other, and with a mass at the centre. So a change that is certain
while its cause is not is reported as such.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.special import expit, ndtr, owens_t

from ges.conventions import MAX_ROTORS, SDS_95, rotor_columns
from ges.diagnose.design.columns import nuisance_of
from ges.diagnose.design.system import System
from ges.diagnose.design.weak import block_windows
from ges.diagnose.prepare.align import no_attitude_derived
from ges.diagnose.select.probability import calibrated_probability
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter, interval95
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

CHANNELS = ("force_z", "moment_x", "moment_y", "moment_z")
LOSSES = rotor_columns("weak_rotor.loss_{}", MAX_ROTORS)
MASS = ("cg_offset.x_m", "cg_offset.y_m", "thrust_scale.scale")
CANT = "rotor_cant.angle_rad"
_Changes = Mapping[str, Mapping[str, tuple[float, float]]]


def losses_of(model: Model) -> tuple[str, ...]:
    """Return the keys of the thrust losses of a vehicle's rotors.

    Parameters
    ----------
    model : of the vehicle.
    """
    return LOSSES[: model.n_rotors]


def _mean_variance(values: np.ndarray, block: int) -> float:
    """Return the variance of the mean of one flight's windows, from blocks of time.

    It is nan for a single block.
    """
    blocks = [values[k : k + block].mean() for k in range(0, len(values), block)]
    return float(np.var(blocks, ddof=1) / len(blocks)) if len(blocks) > 1 else np.nan


def variance_of_means(system: System, channels: Sequence[int]) -> np.ndarray:
    """Return the variance of a flight's mean residual in the air, from blocks of time.

    Parameters
    ----------
    system : of the flights.
    channels : indices of c channels.

    Returns
    -------
    (c,) mean over the flights, in the squared units of the channels; nan where none has two blocks.
    """
    # windows stand half a length apart
    block = block_windows(0.5 * system.flights[0].windows.length_s)
    variances = np.array(
        [[_mean_variance(e, block) for e in r.in_air(channels).T] for r in system.flights]
    )
    known = np.isfinite(variances)
    total, count = np.where(known, variances, 0.0).sum(axis=0), known.sum(axis=0)
    return np.divide(total, count, out=np.full(len(channels), np.nan), where=count > 0)


@dataclasses.dataclass(frozen=True)
class Cause:
    """One cause near one rotor, or at the centre.

    Attributes
    ----------
    rotor : its number, from 1; 0 for the centre.
    value : loss (a share) or mass (kg).
    sd : its standard deviation.
    distance_explained : squared distance of the balance that it explains, in sd^2.
    """

    rotor: int
    value: float
    sd: float
    distance_explained: float

    @property
    def where(self) -> str:
        """Its place in words."""
        return f"near rotor {self.rotor}" if self.rotor else "at the centre"

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the value."""
        return interval95(self.value, self.sd)


@dataclasses.dataclass(frozen=True)
class Shift:
    """A shifted balance, with both causes, each where it explains most.

    Attributes
    ----------
    system : of the flights.
    loss, mass : the two causes.
    swing_seen : whether the flights would show the swing of a hanging load.
    """

    system: System
    loss: Cause
    mass: Cause
    swing_seen: bool

    @property
    def distance_explained(self) -> float:
        """Squared distance that the better cause explains, in sd^2."""
        return max(self.loss.distance_explained, self.mass.distance_explained)

    def sentence(self) -> str:
        """Return what shifted, what would explain it, and how to find out."""
        away = self.distance_explained**0.5
        loss_lead = self.loss.distance_explained - self.mass.distance_explained
        certain = settings.statistics.certain_probability
        least = np.log(certain / (1.0 - certain))
        odds = np.exp(min(0.5 * abs(loss_lead), least))
        odds_words = ("" if 0.5 * abs(loss_lead) < least else "more than ") + f"{odds:.0f}:1"
        likelier = "the loss" if loss_lead > 0.0 else "the mass"
        loss_words = f"{100 * self.loss.value:.0f} +- {100 * SDS_95 * self.loss.sd:.0f} %"
        mass_words = f"{1e3 * self.mass.value:.2f} +- {1e3 * SDS_95 * self.mass.sd:.2f} g"
        rotor = self.loss.rotor
        return (
            "Since the calibration the balance of thrust and moments has moved,"
            f" {away:.1f} sd beyond what healthy flights do among themselves. A rotor {rotor} that"
            f" lost {loss_words} of its thrust or {mass_words} {self.mass.where} (fixed or hanging)"
            f" would do it, with odds {odds_words} for {likelier}. Weigh the vehicle, or fly the"
            f" same with a new propeller {rotor}: the shift then goes if the propeller was the"
            " cause, and stays if a mass is."
        )

    def next_flight(self) -> dict:
        """Return ``next_flight`` of diagnosis.json: the expected evidence of a healthy balance."""
        return {
            "manoeuvre": "hover",
            "preparation": f"a new propeller on rotor {self.loss.rotor}",
            "separates": ["+".join(changes) for changes in self._changes()],
            "stays_open": [],
            "expected_log_odds": 0.5 * self.distance_explained,
            "so_far_log_odds": 0.5
            * abs(self.loss.distance_explained - self.mass.distance_explained),
        }

    def findings(self) -> list[Finding]:
        """Return both causes as findings of the library.

        Notes
        -----
        Their probabilities are those of each given that one of them acts. They are tempered as
        those of a search.
        """
        # half the difference of squared distances: log odds of the loss against the mass
        lead = 0.5 * (self.loss.distance_explained - self.mass.distance_explained)
        # certain by its own rule, a shift is as sure as any name can be
        sure, share = calibrated_probability(1.0), expit(settings.search.log_odds_slope * lead)
        loss, mass = self._changes()
        # a mass that hangs would swing, and an attitude that was measured shows that
        hanging = {} if self.swing_seen else {"slung_load": {"mass_kg": (0.0, 1.0)}}
        causes = [
            (sure * share, self.loss, loss),
            (sure * (1.0 - share), self.mass, {**mass, **hanging}),
        ]
        possible = settings.statistics.possible_probability
        causes = [(p, cause, changes) for p, cause, changes in causes if p > possible]
        # fixed or hanging is open as well
        is_open = len(causes) > 1 or causes[0][1] is self.mass and bool(hanging)
        return [
            _as_finding(name, p, parameters, cause, is_open)
            for p, cause, changes in causes
            for name, parameters in changes.items()
        ]

    def effects(self) -> dict[str, effect_table.Effects]:
        """Return the parameters that each cause changes, by its name, the better cause first.

        Notes
        -----
        A mass is a thrust scale, and at a hub a centre of gravity besides.
        """
        causes = sorted(
            zip((self.loss, self.mass), self._changes(), strict=True),
            key=lambda pair: -pair[0].distance_explained,
        )
        return {
            next(iter(changes)): {
                name: {p: start + per * cause.value for p, (start, per) in own.items()}
                for name, own in changes.items()
            }
            for cause, changes in causes
        }

    def _changes(self) -> tuple[_Changes, _Changes]:
        """Return start and change per unit of the loss and of the mass, by effect and parameter."""
        model, rotor, hub = self.system.model, self.loss.rotor, self.mass.rotor
        per_kg, by_mass = 1.0 / model.number("mass_kg"), _changes_by_mass(hub, model)
        start = {
            key: model.effects.get(effect, {}).get(parameter, 0.0)
            for key in (*losses_of(model), *MASS)
            for effect, parameter in [ParameterKey.of(key)]
        }
        moved = {
            f"{a}_m": (start[f"cg_offset.{a}_m"], per_kg * by_mass[f"cg_offset.{a}_m"])
            for a in ("xy" if hub else "")
        }
        heavier = {"thrust_scale": {"scale": (start[MASS[2]], per_kg * by_mass[MASS[2]])}}
        return (
            {"weak_rotor": {f"loss_{rotor}": (start[LOSSES[rotor - 1]], 1.0)}},
            {"cg_offset": moved, **heavier} if moved else heavier,
        )


def _as_finding(
    name: str,
    probability: float,
    parameters: Mapping[str, tuple[float, float]],
    cause: Cause,
    is_open: bool,
) -> Finding:
    """Return a cause as a finding.

    Parameters are given as start and change per unit of the cause's value.
    """
    units = {p.name: p.unit for p in effect_table.get(name).parameters}
    estimates = {}
    for key, (start, per) in parameters.items():
        low, high = sorted(start + per * v for v in cause.ci95)
        note = cause.where + (f"; the vehicle file has {start:.3g}" if start else "")
        estimates[key] = FittedParameter(start + per * cause.value, (low, high), units[key], note)
    return Finding.of(name, float(probability), estimates, is_open=is_open)


def _states_gains(system: System, column: Mapping[str, int]) -> bool:
    """Return whether a calibrated file states how far every motor's gain may be off."""
    gains = "weak_rotor" in system.model.effects and {*losses_of(system.model), *MASS} <= set(
        column
    )
    return gains and set(CHANNELS) <= set(system.main)


def without_mean_balance(residuals: Sequence[np.ndarray], system: System) -> list[np.ndarray]:
    """Subtract the mean over all flights from the channels of thrust and moments.

    Only with a calibrated file: there :func:`balance_shift` decides on that mean, and it is no
    structure of a regime.

    Parameters
    ----------
    residuals : by flight, (m, C) of the main channels, in their units.
    system : of the flights.

    Returns
    -------
    By flight, (m, C).
    """
    if not _states_gains(system, system.nuisances):
        return list(residuals)
    balance_channels = [system.main.index(c) for c in CHANNELS]
    mean = np.zeros(len(system.main))
    mean[balance_channels] = np.nanmean(np.concatenate(residuals)[:, balance_channels], axis=0)
    return [rows - mean for rows in residuals]


def causes_of(system: System) -> list[tuple[Cause, Cause]]:
    """Estimate for every rotor its loss and a mass at its hub, each as if it alone had changed.

    Parameters
    ----------
    system : nuisance columns suffice; those of ``weak_rotor``, ``cg_offset`` and ``thrust_scale``
        are read.

    Returns
    -------
    Loss and mass by rotor; empty without a calibrated file.
    """
    balance = _balance_of(system)
    if balance is None:
        return []
    return list(zip(balance.causes(balance.losses), balance.causes(balance.masses), strict=False))


@dataclasses.dataclass(frozen=True)
class _Balance:
    """Mean residual of thrust and moments, and what each cause would change.

    Attributes
    ----------
    y : (4,) mean residual, N and N m.
    precision : (4, 4) of it.
    losses : change (4,) per unit of the loss of each rotor.
    masses : change (4,) per kilogram at each hub, and last at the centre.
    """

    y: np.ndarray
    precision: np.ndarray
    losses: tuple[np.ndarray, ...]
    masses: tuple[np.ndarray, ...]

    def causes(self, directions: Sequence[np.ndarray]) -> list[Cause]:
        """Estimate each cause as if it alone acted.

        Directions are by rotor; a last one more is the centre, rotor 0.
        """
        rotors = (*range(1, len(self.losses) + 1), 0)
        return [
            _estimate_cause(self.y, d, self.precision, rotor)
            for rotor, d in zip(rotors[: len(directions)], directions, strict=True)
        ]

    def p_value(self, sds: float) -> float:
        """Return the probability that noise makes any cause as large as this, at most.

        Causes are alike, and so Bonferroni's sum counts most of the probability twice. What both of
        a pair take is taken off along a spanning tree (Worsley 1982, Biometrika 69, 297).
        """
        root = np.linalg.cholesky(self.precision)
        white = np.array([root.T @ d for d in (*self.losses, *self.masses)])
        white /= np.linalg.norm(white, axis=1, keepdims=True)
        correlation = np.clip(white @ white.T, -1.0 + settings.numerics.small, 1.0)
        # probability that two Gaussians of this correlation are both beyond (Owen 1956)
        ratio = (1.0 - correlation) / (1.0 + correlation)
        both = ndtr(-sds) - 2.0 * owens_t(sds, np.sqrt(ratio))
        return float(len(white) * ndtr(-sds) + minimum_spanning_tree(-np.triu(both, 1)).sum())


def _balance_of(system: System) -> _Balance | None:
    """Return the mean balance; None without a calibrated file."""
    column, model = system.nuisances, system.model
    if not _states_gains(system, column):
        return None
    y, x, precision = _mean_balance(system, [*losses_of(model), *MASS], column)
    losses = tuple(x[key] for key in losses_of(model))
    rotors = (*range(1, len(losses) + 1), 0)
    masses = tuple(_residual_per_kg(x, rotor, system) for rotor in rotors)
    return _Balance(y, precision, losses, masses)


def balance_shift(system: System) -> Shift | None:
    """Find a balance beyond what a calibrated file allows.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    The shift; None where the balance is as allowed.
    """
    balance = _balance_of(system)
    if balance is None:
        return None
    loss, mass = (
        max(balance.causes(directions), key=lambda cause: cause.distance_explained)
        for directions in (balance.losses, balance.masses)
    )
    shift = Shift(system, loss, mass, no_attitude_derived([r.flight for r in system.flights]))
    p_value = balance.p_value(shift.distance_explained**0.5)
    return shift if p_value < settings.statistics.chance else None


def _mean_balance(
    system: System, keys: Sequence[str], column: dict[str, int]
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Return mean residuals (4,), mean columns by key (4,), and the residuals' precision (4, 4).

    Prior sds of the file count as noise, that of the cant of the rotors among them.
    """
    keys = [*keys, *({CANT} & set(column))]
    balance_channels, count = [system.names.index(c) for c in CHANNELS], len(system.flights)
    y = np.mean([r.in_air(balance_channels).mean(axis=0) for r in system.flights], axis=0)
    columns = [column[key] for key in keys]
    means = np.mean([r.mean_columns(balance_channels, columns) for r in system.flights], axis=0)
    x = dict(zip(keys, means.T, strict=True))
    variance = variance_of_means(system, balance_channels) / count
    # prior sds are noise of the mean; what differs from flight to flight averages out over them
    covariance = np.diag(variance)
    for key in keys:
        n = nuisance_of(system.columns[column[key]])
        covariance += (n.sd**2 + n.flight_sd**2 / count) * np.outer(x[key], x[key])
    return y, x, np.linalg.inv(covariance)


def _changes_by_mass(rotor: int, model: Model) -> dict[str, float]:
    """Return the changes of :data:`MASS` by a load at a hub, over its share of the vehicle's mass.

    The centre of gravity moves by the hub's place times that share. To the thrust it is a scale
    that is lower by the share. Rotor 0 is the centre.
    """
    x_m, y_m = (model.number(f"rotor_{rotor}_{a}_m") if rotor else 0.0 for a in "xy")
    return dict(zip(MASS, (x_m, y_m, -1.0), strict=True))


def _residual_per_kg(columns: Mapping[str, np.ndarray], rotor: int, system: System) -> np.ndarray:
    """Return the change of the mean residual per kilogram at a hub, (4,), N/kg and N m/kg.

    The columns (4,) are by key; rotor 0 is the centre.
    """
    changes = _changes_by_mass(rotor, system.model)
    x, y, scale = (change * columns[key] for key, change in changes.items())
    return (x + y + scale) / system.model.number("mass_kg")


def _estimate_cause(
    y: np.ndarray, direction: np.ndarray, precision: np.ndarray, rotor: int
) -> Cause:
    """Return the generalised least squares estimate of one cause.

    A value below zero explains nothing.
    """
    information = float(direction @ precision @ direction)
    value = float(direction @ precision @ y) / information
    return Cause(rotor, value, information**-0.5, value**2 * information if value > 0 else 0.0)
