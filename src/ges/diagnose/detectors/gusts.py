"""Gusts: a horizontal push through the drag that is on, slow as large eddies are, and predicted by
nothing else.

The search weighs what place, speed, time or command predict, and gusts none of them does. So they
are looked for in what the accepted effects leave: as the wind that would make it, window by window,
less what a steady wind, its profile with height, an error of the drag's form and trims would leave.
Noise averages out over seconds and gusts do not: means of seconds are held against what
the scatter of shorter means within them predicts. How strong the gusts are, the compiled effect
says: it blows along the same flights and goes through the same means.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtrc

from ges.conventions import SDS_95
from ges.diagnose.design.residual import motion_of
from ges.diagnose.design.system import FlightRows, System, build
from ges.diagnose.estimate.fit import Fitted, JointFit, raw_residuals
from ges.diagnose.library.candidates import Variant, amplitude_of, has_prerequisite
from ges.diagnose.prepare.channels import FORCE
from ges.diagnose.select.stated import stated
from ges.diagnose.settings import settings
from ges.diagnose.types.diagnosis import Estimate, Finding
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

HANGING = ("tether", "slung_load")
"""What the vehicle may have hanging."""
GUSTS, WIND, AXES = "gusts", "wind", ("east_m_s", "north_m_s")
STRENGTH = "wind_20ft_m_s"
PUSHED = frozenset({"force_x", "force_y", "acc_x", "acc_y"})
"""Channels in which what slow gusts did in one flight may look predicted by its time or place."""


@dataclasses.dataclass(frozen=True)
class Gusts:
    """Gusts that were found.

    ``strength_m_s`` is the compiled effect's with its relative sd, ``mean_sd_m_s`` how far gusts so
    strong may leave the mean wind of all flights from zero, ``push_N`` their rms force, ``chance``
    that noise alone scatters so.
    """

    strength_m_s: float
    relative_sd: float
    mean_sd_m_s: float
    push_N: float
    weight_N: float
    chance: float

    def may_be(self, fitted: Fitted) -> bool:
        """Whether the mean wind of a fit is no more than what gusts like these leave and the fit
        doubts.
        """
        sd_m_s = max(fitted.sd("wind", p) for p in AXES)
        most_m_s = settings.statistics.clear_sds * math.hypot(self.mean_sd_m_s, sd_m_s)
        return wind_speed_m_s(fitted.regression.system, "wind", fitted.effects["wind"]) < most_m_s

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the strength."""
        factor = float(np.exp(SDS_95 * self.relative_sd))
        return self.strength_m_s / factor, self.strength_m_s * factor

    def finding(self) -> Finding:
        """As the contract has it."""
        value = Estimate(self.strength_m_s, self.ci95, "m/s")
        size = {
            "value": self.push_N,
            "unit": "N",
            "share_of_weight": self.push_N / self.weight_N,
            "channel": FORCE[0],
        }
        return Finding.of("gusts", stated(1.0 - self.chance), {STRENGTH: value}, size)


def wind_speed_m_s(system: System, name: str, values: Mapping[str, float]) -> float:
    """Of a wind by its parameters, where the flights of a system are: the median."""
    speeds = []
    for flight in system.recordings:
        samples = effect_table.Samples.from_columns(motion_of(flight, system.model, {}).columns)
        # asked of the compiled wind, so that any profile over height is met
        said = effect_table.replay({}, samples, {name: values}, system.model.terrain)
        blown = said.stack("wind_x_m_s", "wind_y_m_s")[flight.flying]
        speeds.append(np.linalg.norm(blown, axis=1))
    return float(np.median(np.concatenate(speeds)))


def may_lean(push_N: float, added: Mapping[str, Sequence[np.ndarray]], system: System) -> bool:
    """Whether something hangs below whose pull need only lean to push so; ``added`` by effect and
    flight, (m, C).
    """
    axes = [c for c, name in enumerate(system.main) if name in FORCE]
    pulls = [np.concatenate(added[name])[:, axes] for name in HANGING if name in added]
    sizes_N = [float(np.sqrt(np.nanmean(pull**2, axis=0).sum())) for pull in pulls]
    return any(push_N < settings.statistics.large_part * size_N for size_N in sizes_N)


@dataclasses.dataclass(frozen=True)
class _Air:
    """Windows of all flights that tell of horizontal forces, M in all: what wind would leave what
    is left, (M, 2) east and north, what else looks like it, (M, 2, k), with the precision of each
    coefficient, (k,), and the windows of every stretch.
    """

    wind: np.ndarray
    known: np.ndarray
    precision: np.ndarray
    stretches: Sequence[np.ndarray]
    short: int

    def less_known(self, wind: np.ndarray) -> np.ndarray:
        """Wind (M, 2) less what else explains it, each window counted as noisy as the wind that was
        found.
        """
        x, variance = (
            self.known.reshape(-1, self.known.shape[2]),
            max(float(np.var(self.wind)), settings.numerics.tiny),
        )
        # singular where a column is nothing, as the profile's without a height: so lstsq
        gram = x.T @ x + np.diag(variance * self.precision)
        return wind - self.known @ np.linalg.lstsq(gram, x.T @ wind.ravel(), rcond=None)[0]

    def means(self, left: np.ndarray) -> np.ndarray:
        """Of every stretch, (s, 2)."""
        return np.array([left[at].mean(axis=0) for at in self.stretches])

    def noise(self, left: np.ndarray) -> float:
        """Variance of such a mean as the scatter of shorter means within the stretches predicts
        it.
        """
        shorter = [
            np.array(
                [
                    left[part].mean(axis=0)
                    for part in np.array_split(at, max(2, len(at) // self.short))
                ]
            )
            for at in self.stretches
        ]
        # the mean of n independent means has their variance over n
        return float(np.mean([m.var(axis=0, ddof=1) / len(m) for m in shorter]))


def heard_by(effects: effect_table.Effects) -> bool:
    """Whether something is on that moving air pushes."""
    return has_prerequisite("wind", effects)


def gusts_of(
    system: System, joint: JointFit, known: Mapping[str, float] | None = None
) -> Gusts | None:
    """Gusts in what a fit leaves; None where no drag is on, nothing scatters as they do, or no more
    than those that are ``known`` (parameters of the effect).
    """
    if not heard_by(system.model.effects) or not {*FORCE} <= {*system.names}:
        return None
    forces = _force_windows(system, joint)
    air = _air(forces, system.model)
    if not air.stretches:
        return None
    left = air.less_known(air.wind)
    slow, noise = float(np.mean(air.means(left) ** 2)), air.noise(left)
    if slow < settings.detect.gust_variance_ratio * noise:
        return None
    # F test: two axes of every stretch against what its shorter means have about their own mean
    count = 2 * len(air.stretches)
    parts = settings.statistics.block_s / settings.design.answer_slowest_s
    chance = float(fdtrc(count, count * (parts - 1.0), slow / noise))
    if chance > settings.statistics.chance:
        return None
    found = _measured(slow - noise, chance, air, forces, system.model)
    # no news unless clearly stronger than the gusts that are known already
    expected = 0.0 if known is None else effect_table.get("gusts").completed(known)[STRENGTH]
    return found if found.ci95[0] > expected else None


@dataclasses.dataclass(frozen=True)
class _ForceWindows:
    """One flight: its windows ``at`` (m,) that tell of horizontal forces, what is left there as
    wind, (m, 2) east and north, and the push of a unit wind, (m, 2, 2) channel by axis.
    """

    rows: FlightRows
    at: np.ndarray
    wind: np.ndarray
    push: np.ndarray


def _force_windows(system: System, joint: JointFit) -> list[_ForceWindows]:
    """Of the flights that tell anything."""
    east_and_north = Variant("wind", {}, tuple(amplitude_of("wind", p) for p in AXES))
    blown = build(system.recordings, system.model, [east_and_north], system)
    columns = [
        k for k, c in enumerate(blown.columns) if c.variant is not None and c.part != "moment"
    ]
    channels, forces = np.array([blown.names.index(name) for name in FORCE[:2]]), []
    for rows, left in zip(blown.flights, raw_residuals(system, joint), strict=True):
        push = np.stack([rows.x.of(c, columns) for c in channels], axis=1)
        push += (
            settings.numerics.small * np.abs(push).max() * np.eye(2)
        )  # can be inverted where the vehicle stands on edge
        at = np.flatnonzero(np.isfinite(left[:, channels]).all(axis=1))
        if push.any() and len(at):
            wind = np.linalg.solve(push[at], left[np.ix_(at, channels)][:, :, None])[:, :, 0]
            forces.append(_ForceWindows(rows, at, wind, push[at]))
    return forces


def _air(forces: Sequence[_ForceWindows], model: Model) -> _Air:
    if not forces:
        return _Air(np.zeros((0, 2)), np.zeros((0, 2, 6)), np.zeros(6), (), 1)
    first = np.cumsum([0, *(len(t.at) for t in forces)])
    # wind, profile and drag may be anything; a trim is a tilt within its doubt, a share of weight
    tilt = effect_table.get("attitude_bias").parameters[0].doubt
    trim_N = (tilt.sd if tilt else 0.0) * model.weight_N
    return _Air(
        np.concatenate([t.wind for t in forces]),
        np.concatenate([_known(t, i, len(forces)) for i, t in enumerate(forces)]),
        np.r_[np.zeros(6), np.full(2 * len(forces), trim_N**-2)],
        [k + part for k, t in zip(first, forces, strict=False) for part in _stretches(t)],
        max(1, round(settings.design.answer_slowest_s / (0.5 * forces[0].rows.windows.length_s))),
    )


def _known(forces: _ForceWindows, number: int, flights: int) -> np.ndarray:
    """Of one flight, (m, 2, 6 + 2 flights): a steady wind, its profile with height, an error of the
    drag's form, and a trim of this flight, which is a force that turns with the body.
    """
    at, flight = forces.rows.windows.center[forces.at], forces.rows.flight
    v = flight.stack("velocity")[at, :2]
    height = (
        np.log(np.maximum(flight.columns["p_z_m"][at], settings.prepare.height_error_m))
        if "p_z_m" in flight.columns
        else np.zeros(len(at))
    )
    axes = np.broadcast_to(np.eye(2), (len(at), 2, 2))
    # a unit force along each body axis, as the wind that would push so
    trims = np.zeros((len(at), 2, 2 * flights))
    trims[:, :, 2 * number : 2 * number + 2] = np.linalg.inv(forces.push)
    faster = np.linalg.norm(v, axis=1, keepdims=True) * v
    return np.concatenate(
        [axes, height[:, None, None] * axes, v[:, :, None], faster[:, :, None], trims], axis=2
    )


def _stretches(forces: _ForceWindows) -> list[np.ndarray]:
    """Windows of every stretch of one flight, numbered among those that are used; none shorter than
    half of one.
    """
    windows, length_s = forces.rows.windows, settings.statistics.block_s
    number = ((windows.center_s[forces.at] - windows.center_s[forces.at[0]]) // length_s).astype(
        int
    )
    parts = [np.flatnonzero(number == k) for k in np.unique(number)]
    return [part for part in parts if len(part) >= length_s / windows.length_s]


def _measured(
    excess: float, chance: float, air: _Air, forces: Sequence[_ForceWindows], model: Model
) -> Gusts:
    """The strength at which the compiled gusts make as much excess variance of the means, along the
    same flights.
    """
    blown = [
        np.concatenate(draw)
        for draw in zip(*(_blown(t, model, i) for i, t in enumerate(forces)), strict=True)
    ]
    made = np.array([np.mean(air.means(air.less_known(wind)) ** 2) for wind in blown])
    # wind goes with the strength, its variance with the square: hence a root, and half the error
    strength, spread = (
        float(np.sqrt(excess / made.mean())),
        float(np.std([wind.mean(axis=0) for wind in blown])),
    )
    # both axes blow independently: squares of what each pushes add up
    push_2 = np.concatenate([(t.push**2).sum(axis=2) for t in forces]).mean()
    return Gusts(
        strength,
        0.5 * float(made.std() / made.mean()),
        strength * spread,
        float(np.sqrt(excess * push_2)),
        model.weight_N,
        chance,
    )


def _blown(forces: _ForceWindows, model: Model, number: int) -> list[np.ndarray]:
    """Winds (m, 2) of the compiled gusts of unit strength along one flight, by draw."""
    samples = effect_table.Samples.from_columns(motion_of(forces.rows.flight, model, {}).columns)
    # no two flights share a draw: their gusts are independent
    draws = settings.detect.gust_draws
    sets = [{"gusts": {STRENGTH: 1.0, "seed": float(draws * number + k)}} for k in range(draws)]
    said = effect_table.replay_each(model.parameters, samples, sets, model.terrain)
    return [
        (forces.rows.windows.mean @ r.stack("wind_x_m_s", "wind_y_m_s"))[forces.at] for r in said
    ]
