"""Gusts: a slow horizontal force through the drag that is on, predicted by nothing else.

The search tests what place, speed, time or command predict, and none of them predicts gusts. So
they are looked for in the residuals of the accepted effects. These are expressed as equivalent
wind, window by window. A steady wind, its profile with height, an error of the drag's form and
trims are regressed out.

Noise averages out and gusts do not. Means over a stretch of time are compared with what the scatter
of means over a tenth of it predicts. Turbulence has any time scale, and so do the stretches: from
seconds down to ten windows. Where an accelerometer is logged it is what counts:
an attitude that drifts pushes the force that follows from the motion, and no accelerometer. The
strength follows from the compiled effect, flown along the same flights and averaged in the same
way. What scatters as much along thrust, where the drag hardly pushes, is no gust.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtrc

from ges.conventions import QUATERNION, SDS_95
from ges.diagnose.design.motion import motion_of
from ges.diagnose.design.system import FlightRows, System, build
from ges.diagnose.estimate.joint import JointFit, raw_residuals
from ges.diagnose.library.candidates import Variant, amplitude_of, has_prerequisite
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import ACC, FORCE
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.select.probability import calibrated_probability
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

HANGING = ("tether", "slung_load")
"""What the vehicle may have hanging."""
GUSTS, WIND = "gusts", ("east_m_s", "north_m_s")
STRENGTH = "wind_20ft_m_s"
WIND_M_S = ("wind_x_m_s", "wind_y_m_s")
PUSHED = frozenset({"force_x", "force_y", "acc_x", "acc_y"})
"""Channels in which what slow gusts did in one flight may look predicted by its time or place."""


@dataclasses.dataclass(frozen=True)
class Gusts:
    """Gusts that were found.

    Attributes
    ----------
    strength_m_s : parameter of the compiled effect.
    relative_sd : relative standard deviation of the strength.
    mean_wind_sd_m_s : sd of the mean wind of a flight.
    force_N : their rms force.
    weight_N : of the vehicle.
    p_value : probability that noise alone scatters so.
    """

    strength_m_s: float
    relative_sd: float
    mean_wind_sd_m_s: float
    force_N: float
    weight_N: float
    p_value: float

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the strength, m/s."""
        factor = float(np.exp(SDS_95 * self.relative_sd))
        return self.strength_m_s / factor, self.strength_m_s * factor

    def blow_in(self, model: Model, effects: effect_table.Effects) -> Model:
        """Return the model whose flights have mean winds as gusts so strong leave them.

        Parameters
        ----------
        model : of the vehicle.
        effects : with their values; those that wind acts through are picked.

        Notes
        -----
        Flights of one day share a wind, and each has one of its own besides. Both have the same sd.
        """
        drags = {n: v for n, v in effects.items() if n in effect_table.get("wind").prerequisites}
        sds = {f"wind.{axis}": self.mean_wind_sd_m_s for axis in WIND}
        return dataclasses.replace(model, flight_sds=sds, act_through=drags)

    def finding(self) -> Finding:
        """Return the gusts as a finding of the contract."""
        value = FittedParameter(self.strength_m_s, self.ci95, "m/s")
        size = {
            "value": self.force_N,
            "unit": "N",
            "share_of_weight": self.force_N / self.weight_N,
            "channel": FORCE[0],
        }
        return Finding.of(
            "gusts", calibrated_probability(1.0 - self.p_value), {STRENGTH: value}, size
        )


def wind_speed_m_s(system: System, name: str, values: Mapping[str, float]) -> float:
    """Return the median speed of a wind where the flights of a system are.

    Parameters
    ----------
    system : of the flights.
    name : of the effect.
    values : its parameters.
    """
    speeds = [
        np.linalg.norm(_wind(flight, system.model, {name: values})[flight.flying], axis=1)
        for flight in system.recordings
    ]
    return float(np.median(np.concatenate(speeds)))


def _wind(flight: Prepared, model: Model, effects: effect_table.Effects) -> np.ndarray:
    """Return the wind (n, 2) of effects along a flight, east and north, m/s."""
    samples = effect_table.Samples.from_columns(motion_of(flight, model, {}).columns)
    # asked of the compiled wind, so that any profile over height is met
    output = effect_table.replay({}, samples, effects, model.terrain, wanted=WIND_M_S)
    return output.stack(*WIND_M_S)


def load_may_push(
    force_N: float, added: Mapping[str, Sequence[np.ndarray]], system: System
) -> bool:
    """Return whether a suspended load may make a horizontal force by leaning.

    Parameters
    ----------
    force_N : rms of the force.
    added : by effect and flight, (m, C) in the channels' units.
    system : of the flights.
    """
    axes = [c for c, name in enumerate(system.main) if name in FORCE]
    pulls = [np.concatenate(added[name])[:, axes] for name in HANGING if name in added]
    sizes_N = [float(np.sqrt(np.nanmean(pull**2, axis=0).sum())) for pull in pulls]
    return any(force_N < size_N for size_N in sizes_N)


@dataclasses.dataclass(frozen=True)
class _EquivalentWind:
    """Windows of all flights with horizontal forces, M in all.

    Attributes
    ----------
    wind : (M, 2) wind east and north that would make the residual, m/s.
    regressors : (M, 2, k) what else looks like it, as wind.
    precision : (k,) of the coefficients' priors.
    """

    wind: np.ndarray
    regressors: np.ndarray
    precision: np.ndarray

    def without_regressors(self, wind: np.ndarray) -> np.ndarray:
        """Return wind (M, 2) less what the regressors explain, with equal noise in every window."""
        x = self.regressors.reshape(-1, self.regressors.shape[2])
        # singular where a column is nothing, as the profile's without a height: so lstsq
        coefficients = np.linalg.lstsq(self._normal_matrix, x.T @ wind.ravel(), rcond=None)[0]
        return wind - self.regressors @ coefficients

    @functools.cached_property
    def _normal_matrix(self) -> np.ndarray:
        """Products of the regressors, with their priors in units of the noise, (k, k)."""
        x = self.regressors.reshape(-1, self.regressors.shape[2])
        variance = max(float(np.var(self.wind)), settings.numerics.tiny)
        return x.T @ x + np.diag(variance * self.precision)


@dataclasses.dataclass(frozen=True)
class _Stretches:
    """Stretches of time of one length.

    Attributes
    ----------
    windows : of every stretch, as indices among those of all flights.
    submeans : number of shorter means in a stretch.
    """

    windows: Sequence[np.ndarray]
    submeans: int

    def means(self, wind: np.ndarray) -> np.ndarray:
        """Return the mean wind (M, 2) of every stretch, (s, 2)."""
        return np.array([wind[at].mean(axis=0) for at in self.windows])

    def noise_variance(self, wind: np.ndarray) -> float:
        """Return the variance of such a mean, from the scatter of shorter means."""
        shorter = [
            np.array(
                [
                    wind[some].mean(axis=0)
                    for some in np.array_split(at, min(self.submeans, len(at)))
                ]
            )
            for at in self.windows
        ]
        # the mean of n independent means has their variance over n
        return float(np.mean([m.var(axis=0, ddof=1) / len(m) for m in shorter]))


@dataclasses.dataclass(frozen=True)
class _Excess:
    """What the means of stretches scatter beyond the noise of their shorter means.

    Attributes
    ----------
    stretches : of one length.
    variance_of_means : of the stretches, m^2/s^2.
    noise_variance : what the noise makes of it.
    p_value : probability that noise alone scatters so.
    """

    stretches: _Stretches
    variance_of_means: float
    noise_variance: float
    p_value: float


def shows_moving_air(effects: effect_table.Effects) -> bool:
    """Return whether an effect is on that moving air acts through.

    Parameters
    ----------
    effects : that are on.
    """
    return has_prerequisite("wind", effects)


def find_gusts(
    system: System, joint: JointFit, nominal_gusts: Mapping[str, float] | None = None
) -> Gusts | None:
    """Find gusts in the residuals of a fit.

    Parameters
    ----------
    system, joint : of the fit.
    nominal_gusts : parameters of the effect in the vehicle file; None where it has none.

    Returns
    -------
    The gusts. None where no drag is on, nothing scatters as they do, or no more than the nominal
    ones.
    """
    if not shows_moving_air(system.model.effects) or not {*FORCE} <= {*system.names}:
        return None
    channels = ACC if {*ACC} <= {*system.names} else FORCE
    forces = _force_windows(system, _without_gust_winds(joint, system.model), channels)
    if not forces:
        return None
    equivalent = _equivalent_wind(forces, system.model)
    wind = equivalent.without_regressors(equivalent.wind)
    axial = np.concatenate([f.axial - f.axial.mean() for f in forces])
    lengths_s = _stretch_lengths_s(forces)
    on_each = [_excess_on(length_s, forces, wind, axial, len(lengths_s)) for length_s in lengths_s]
    excesses = [excess for excess in on_each if excess]
    if not excesses:
        return None
    # of several lengths the one on which they stand out most
    clearest = max(excesses, key=lambda e: e.variance_of_means / e.noise_variance)
    gusts = _gusts_of_excess(clearest, equivalent, forces, system.model)
    # no news unless clearly stronger than the gusts that are known already
    expected = (
        0.0
        if nominal_gusts is None
        else effect_table.get("gusts").completed(nominal_gusts)[STRENGTH]
    )
    return gusts if gusts.ci95[0] > expected else None


def _without_gust_winds(joint: JointFit, model: Model) -> JointFit:
    """Return the fit without the mean winds of gusts, which are part of what they blow."""
    own = (
        {k: v for k, v in values.items() if k not in model.flight_sds} for values in joint.by_flight
    )
    return dataclasses.replace(joint, by_flight=tuple(own))


def _stretch_lengths_s(forces: Sequence[_ForceWindows]) -> list[float]:
    """Return lengths of stretches, halved from blocks of time down to tenths of a window's step."""
    length_s, spacing_s = settings.statistics.block_s, 0.5 * forces[0].rows.windows.length_s
    lengths_s = []
    while length_s >= _submeans() * spacing_s:
        lengths_s.append(length_s)
        length_s *= 0.5
    return lengths_s


def _submeans() -> int:
    """Return the number of shorter means in a stretch."""
    return round(settings.statistics.block_s / settings.design.response_slowest_s)


def _excess_on(
    length_s: float,
    forces: Sequence[_ForceWindows],
    wind: np.ndarray,
    axial: np.ndarray,
    lengths_tried: int,
) -> _Excess | None:
    """Return the excess scatter of wind (M, 2), m/s, over stretches of this length.

    None where an F test puts it down to noise, or to as much scatter along thrust, ``axial`` (M,).
    Its level is ``statistics.chance``, by Bonferroni over the lengths.
    """
    first = np.cumsum([0, *(len(f.at) for f in forces[:-1])])
    windows = [k + at for k, f in zip(first, forces, strict=True) for at in _stretches(f, length_s)]
    if not windows:
        return None
    stretches = _Stretches(windows, _submeans())
    variance_of_means = float(np.mean(stretches.means(wind) ** 2))
    noise_variance = stretches.noise_variance(wind)
    if variance_of_means < settings.detect.gust_variance_ratio * noise_variance:
        return None
    # two axes of every stretch against what its shorter means have about their own mean
    freedom, ratio = 2 * len(windows), variance_of_means / noise_variance
    p_value = float(fdtrc(freedom, freedom * (stretches.submeans - 1.0), ratio))
    # and against the one axis along thrust
    axial_variance = float(np.mean(stretches.means(axial) ** 2))
    if axial_variance > 0.0:
        ratio = variance_of_means / axial_variance
        p_value = max(p_value, float(fdtrc(freedom, len(windows), ratio)))
    p_value = min(1.0, p_value * lengths_tried)
    if p_value > settings.statistics.chance:
        return None
    return _Excess(stretches, variance_of_means, noise_variance, p_value)


@dataclasses.dataclass(frozen=True)
class _ForceWindows:
    """Windows of one flight with force residuals, expressed as equivalent wind.

    Attributes
    ----------
    rows : of the flight.
    at : (m,) windows.
    wind : (m, 2) east and north, m/s.
    axial : (m,) what pushes along thrust, as wind that would push as much across, m/s.
    log_height : (m,) of :func:`_log_height`.
    force_per_wind : (m, 2, 2) force by channel and axis of a unit wind, N per m/s.
    """

    rows: FlightRows
    at: np.ndarray
    wind: np.ndarray
    axial: np.ndarray
    log_height: np.ndarray
    force_per_wind: np.ndarray


def _force_windows(system: System, joint: JointFit, names: Sequence[str]) -> list[_ForceWindows]:
    """Return windows of every flight that has any, of these three channels of force."""
    east_and_north = Variant("wind", {}, tuple(amplitude_of("wind", p) for p in WIND))
    system_of_wind = build(system.recordings, system.model, [east_and_north], system)
    columns = [
        k
        for k, c in enumerate(system_of_wind.columns)
        if c.variant is not None and c.part != "moment"
    ]
    # the motion has to be known as well: a drag acts by it
    channels, motion = (
        np.array([system_of_wind.names.index(name) for name in three]) for three in (names, FORCE)
    )
    across, thrust = channels[:2], channels[2]
    forces = []
    for rows, residuals in zip(system_of_wind.flights, raw_residuals(system, joint), strict=True):
        force_per_wind = np.stack([rows.x.of(c, columns) for c in across], axis=1)
        # can be inverted where the vehicle stands on edge
        force_per_wind += settings.numerics.small * np.abs(force_per_wind).max() * np.eye(2)
        known = np.isfinite(residuals[:, [*channels, *motion]]).all(axis=1)
        height = _log_height(rows)
        at = np.flatnonzero(known & np.isfinite(height))
        if force_per_wind.any() and len(at):
            pushes = force_per_wind[at]
            wind = np.linalg.solve(pushes, residuals[np.ix_(at, across)][:, :, None])[:, :, 0]
            axial = residuals[at, thrust] / np.sqrt(np.abs(np.linalg.det(pushes)))
            forces.append(_ForceWindows(rows, at, wind, axial, height[at], pushes))
    return forces


def _equivalent_wind(forces: Sequence[_ForceWindows], model: Model) -> _EquivalentWind:
    """Join the force windows of all flights, with regressors."""
    # wind, profile and drag may be anything; a trim is a tilt within its prior sd, a share of
    # weight
    tilt = effect_table.get("attitude_bias").parameters[0].prior
    trim_N = (tilt.sd if tilt else 0.0) * model.weight_N
    by_flight = [_regressors(f, model, i, len(forces)) for i, f in enumerate(forces)]
    regressors, trims = np.concatenate(by_flight), 2 * len(forces)
    free = np.zeros(regressors.shape[2] - trims)
    return _EquivalentWind(
        np.concatenate([f.wind for f in forces]),
        regressors,
        np.r_[free, np.full(trims, trim_N**-2)],
    )


def _regressors(forces: _ForceWindows, model: Model, index: int, flights: int) -> np.ndarray:
    """Return regressors of the flight of this index, (m, 2, 18 + 2 flights).

    They are a steady wind, its log-height profile, errors of the drag's form and a trim of each
    flight. A drag along an axis of the body goes with the air's speed there, times a factor.
    Factors are the speed across thrust and its root, the whole speed, that of the axis alone, and
    the climb. The last is for the area that a flat body shows: it grows with the square of the
    climb's share.
    """
    at, flight = forces.rows.windows.center[forces.at], forces.rows.flight
    axes = np.broadcast_to(np.eye(2), (len(at), 2, 2))
    # a unit force along each body axis, as the wind that would push so
    push = np.linalg.inv(forces.force_per_wind)
    trims = np.zeros((len(at), 2, 2 * flights))
    trims[:, :, 2 * index : 2 * index + 2] = push
    speed = _air_speed(flight, model)[at]
    sideways, whole = (np.linalg.norm(speed[:, :k], axis=1, keepdims=True) for k in (2, 3))
    of_form = [push * speed[:, None, :2]]
    climb = speed[:, 2:]
    edgewise = climb**2 / np.maximum(whole, settings.numerics.tiny)
    factors = (np.sqrt(sideways), sideways, whole, np.abs(speed[:, :2]), climb, edgewise)
    of_form += [of_form[0] * factor[:, None] for factor in factors]
    return np.concatenate([axes, forces.log_height[:, None, None] * axes, *of_form, trims], axis=2)


def _log_height(rows: FlightRows) -> np.ndarray:
    """Return the log of the height of every window, (m,); zero where no height was logged."""
    height = rows.flight.columns.get("p_z_m")
    if height is None:
        return np.zeros(len(rows.y))
    return np.log(np.maximum(height[rows.windows.center], settings.prepare.height_error_m))


def _air_speed(flight: Prepared, model: Model) -> np.ndarray:
    """Return the speed through the air of a model's winds, (n, 3), body frame, m/s."""
    winds = effect_table.only(model.effects, lambda e: e.moves_air)
    world = flight.stack("velocity").copy()
    world[:, :2] -= _wind(flight, model, winds)
    columns = motion_of(flight, model, {}).columns
    return to_body(np.stack([columns[name] for name in QUATERNION], axis=1), world)


def _stretches(forces: _ForceWindows, length_s: float) -> list[np.ndarray]:
    """Return windows of every stretch of one flight, as indices among those in use.

    None is shorter than half of a full one.
    """
    windows = forces.rows.windows
    since_first_s = windows.center_s[forces.at] - windows.center_s[forces.at[0]]
    stretch = (since_first_s // length_s).astype(int)
    stretches = [np.flatnonzero(stretch == k) for k in np.unique(stretch)]
    return [at for at in stretches if len(at) >= length_s / windows.length_s]


def _gusts_of_excess(
    excess: _Excess, equivalent: _EquivalentWind, forces: Sequence[_ForceWindows], model: Model
) -> Gusts:
    """Return gusts that make this excess variance of the means, by the compiled effect."""
    by_flight = [_unit_gust_winds(f, model, i) for i, f in enumerate(forces)]
    winds = [np.concatenate(draw) for draw in zip(*by_flight, strict=True)]
    variances = np.array(
        [np.mean(excess.stretches.means(equivalent.without_regressors(w)) ** 2) for w in winds]
    )
    variance = excess.variance_of_means - excess.noise_variance
    # wind goes with the strength, its variance with the square: hence a root, and half the error
    strength = float(np.sqrt(variance / variances.mean()))
    # both axes blow independently: squares of what each pushes add up
    push_2 = np.concatenate([(f.force_per_wind**2).sum(axis=2) for f in forces]).mean()
    unit_means = [wind.mean(axis=0) for draws in by_flight for wind in draws]
    return Gusts(
        strength_m_s=strength,
        relative_sd=0.5 * float(variances.std() / variances.mean()),
        mean_wind_sd_m_s=strength * float(np.sqrt(np.mean(np.square(unit_means)))),
        force_N=float(np.sqrt(variance * push_2)),
        weight_N=model.weight_N,
        p_value=excess.p_value,
    )


def _unit_gust_winds(forces: _ForceWindows, model: Model, index: int) -> list[np.ndarray]:
    """Return winds (m, 2) of compiled gusts of unit strength along the flight of this index."""
    samples = effect_table.Samples.from_columns(motion_of(forces.rows.flight, model, {}).columns)
    # no two flights share a draw: their gusts are independent
    draws = settings.detect.gust_draws
    sets = [{"gusts": {STRENGTH: 1.0, "seed": float(draws * index + k)}} for k in range(draws)]
    outputs = effect_table.replay_each(
        model.parameters, samples, sets, model.terrain, wanted=WIND_M_S
    )
    return [(forces.rows.windows.mean @ r.stack(*WIND_M_S))[forces.at] for r in outputs]
