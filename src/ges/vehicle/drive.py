"""What a flight tells of its drive: thrust from hover, top speed and lag from rotor speeds.

Signals come as one table in contract columns, each at its own rate, NaN between its samples. Means
over half a second bring them together; a steady balance loses nothing by it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ges.conventions import (
    GRAVITY_M_S2,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    commands_in,
    rotor_speeds_in,
)
from ges.errors import GesError
from ges.vehicle.file import Quantity

BIN_S = 0.5
FEWEST_BINS = 10
# Thrust per command on the ground is far above that in the air, where rotors carry the weight.
ON_GROUND = 1.6
# Quiet flight: thrust within a tenth of the weight, little tilt, slow, out of ground effect.
QUIET, TILT_RAD, SLOW_M_S, HIGH_RADII = 0.1, 0.25, 2.0, 6.0
# What ground effect, inflow and the accelerometer's scale leave in a hover's balance.
HOVER_SD_REL = 0.02
# What a fit to half seconds leaves out: sag, wind, rounding; less explained is no response.
TOP_SPEED_SD_REL, LEAST_CURVE_SD, LEAST_R2 = 0.02, 0.02, 0.25
# Telemetry that can tell a lag: at least a hundred rows a second, speeds that follow the commands.
FEWEST_ROWS, SLOWEST_TELEMETRY_S, LEAST_LIKENESS = 500, 0.011, 0.7
LAGS_S, LONGEST_DELAY_S, HIGH_PASS_S, LAG_SD_REL = (0.005, 0.2), 0.03, 0.3, 0.15


def normalised_thrust(u: np.ndarray, c: float) -> np.ndarray:
    """Compute the share of the largest thrust at a command.

    Parameters
    ----------
    u : commands, 0 to 1, of a shape such as (n,) or (n, k).
    c : linear share of the thrust curve.

    Returns
    -------
    (1 - c) u^2 + c u, not below 0, of the same shape.
    """
    return np.maximum((1.0 - c) * u * u + c * u, 0.0)


def curve_at_hover(elasticity: float, u: float) -> float:
    """Compute the thrust curve that has a given slope at hover.

    Parameters
    ----------
    elasticity : slope E = d ln T / d ln u.
    u : command at hover, 0 to 1.

    Returns
    -------
    c that solves (2 (1 - c) u + c) / ((1 - c) u + c) = E, from -0.5 to 1. A curve of another form
    agrees with it in value and slope at hover.
    """
    if elasticity <= 1.0:
        return 1.0
    quadratic = (elasticity - 1.0) / (elasticity * (1.0 - u) + 2.0 * u - 1.0)
    return float(np.clip(1.0 - quadratic, -0.5, 1.0))


@dataclasses.dataclass(frozen=True)
class Hover:
    """Thrust of a rotor over its drive, from the weight that all rotors carried.

    Attributes
    ----------
    thrust_per_drive : N per ((1 - c) u^2 + c u), the largest thrust of a rotor; or N s^2 per w^2,
        the thrust coefficient, if ``measured``.
    drive : median drive of a rotor at hover.
    seconds : seconds of flight used.
    quiet : whether these seconds hovered; if not, all of the flight was used.
    measured : whether the drive is a measured rotor speed.
    n_rotors : number of rotors.
    """

    thrust_per_drive: Quantity
    drive: float
    seconds: float
    quiet: bool
    measured: bool
    n_rotors: int


def binned(frame: pd.DataFrame) -> pd.DataFrame:
    """Average every column over half a second.

    Parameters
    ----------
    frame : table (n rows) of a flight in contract columns; NaN between samples.

    Returns
    -------
    Table with a row for each half second that has rows; means are over the samples in it.
    """
    # each signal is averaged over its own samples, at whatever rate they came
    t_s = frame["t_s"].to_numpy(dtype=float)
    bins = np.floor((t_s - t_s[0]) / BIN_S).astype(int)
    return frame.select_dtypes("number").groupby(bins).mean()


def _stack(frame: pd.DataFrame, names: tuple[str, ...]) -> np.ndarray | None:
    """Give columns as an array (n, k); None where one was not logged."""
    if not names or not all(name in frame for name in names):
        return None
    values = frame[list(names)].to_numpy(dtype=float)
    return values if np.isfinite(values).any() else None


def _upward(bins: pd.DataFrame) -> np.ndarray | None:
    """Compute the cosine of the tilt of every bin (n,)."""
    q = _stack(bins, QUATERNION)
    if q is None:
        return None
    # a mean over attitudes that are far apart, or over none, is short and points nowhere
    norm = np.linalg.norm(q, axis=1)
    good = norm > 0.5
    upright = np.where(good[:, None], q, [1.0, 0.0, 0.0, 0.0])
    up = Rotation.from_quat(upright, scalar_first=True).as_matrix()[:, 2, 2]
    return np.where(good, up, np.nan)


def _lift(bins: pd.DataFrame, up: np.ndarray | None) -> np.ndarray:
    """Compute thrust over mass of every bin (n,), m/s^2.

    With an attitude it is (g + dv_z/dt) / cos(tilt). Without one it is the length of g + dv/dt,
    which lacks the drag. Without a velocity it is the reading of the accelerometer.
    """
    velocity = _stack(bins, VELOCITY)
    if velocity is not None:
        pull = np.gradient(velocity, bins["t_s"].to_numpy(dtype=float), axis=0)
        pull[:, 2] += GRAVITY_M_S2
        if up is None:
            return np.linalg.norm(pull, axis=1)
        # beyond 60 degrees a small error of the tilt is a large one of the thrust
        return pull[:, 2] / np.where(up > 0.5, up, np.nan)
    felt = _stack(bins, SPECIFIC_FORCE)
    if felt is None:
        raise GesError(
            "the log has neither a velocity nor an accelerometer, so hovering cannot tell the"
            " thrust; log one of them"
        )
    return felt[:, 2]


def _flying(ratio: np.ndarray) -> np.ndarray:
    """Select bins whose lift over drive is that of flight, not of standing with idling rotors."""
    # lift over drive is about one number in flight, and far more where the ground carries
    finite = np.isfinite(ratio) & (ratio > 0)
    if finite.sum() < FEWEST_BINS:
        return finite
    # a log may stand longer than it flies: the median settles among those near a low start
    centre = float(np.quantile(ratio[finite], 0.25))
    for _ in range(5):
        near = finite & (ratio < ON_GROUND * centre) & (ratio > centre / ON_GROUND)
        if not near.any():
            break
        centre = float(np.median(ratio[near]))
    return near


def _hovering(bins: _Bins, radius_m: float) -> np.ndarray:
    """Select flying bins that hover, as far as the log shows."""
    calm = bins.flying & (np.abs(bins.lift / GRAVITY_M_S2 - 1.0) < QUIET)
    if bins.up is not None:
        calm &= bins.up > np.cos(TILT_RAD)
    velocity = _stack(bins.means, VELOCITY)
    if velocity is not None:
        calm &= np.linalg.norm(velocity, axis=1) < SLOW_M_S
    height = _stack(bins.means, POSITION[2:])
    if height is not None:
        high = calm & (height[:, 0] - np.nanmin(height) > HIGH_RADII * radius_m)
        # a flight that stays low is used as it is, with ground effect in its thrust
        calm = high if high.sum() >= FEWEST_BINS else calm
    return calm


@dataclasses.dataclass(frozen=True)
class _Bins:
    """Half seconds of a flight: means, what drives the rotors, and which of them fly."""

    means: pd.DataFrame
    speeds: np.ndarray | None
    commands: np.ndarray | None
    measured: bool
    ratio: np.ndarray
    drives: np.ndarray
    lift: np.ndarray
    up: np.ndarray | None
    flying: np.ndarray


def _bins(frame: pd.DataFrame, c: float) -> _Bins:
    """Split a flight into half seconds, with a linear share ``c`` of the thrust curve."""
    means = binned(frame)
    speeds, commands = _stack(means, rotor_speeds_in(means)), _stack(means, commands_in(means))
    # measured speeds need no curve, but a few seconds of them are too little
    if speeds is not None and (
        commands is None or np.isfinite(speeds).all(axis=1).sum() >= FEWEST_BINS
    ):
        measured, drives = True, speeds**2
    elif commands is not None:
        measured, drives = False, normalised_thrust(commands, c)
    else:
        raise GesError(
            "the log has neither rotor speeds nor motor commands; log one of them to tell thrust"
        )
    up = _upward(means)
    lift, total = _lift(means, up), drives.sum(axis=1)
    # m lift = kappa sum d, so that lift over drive is kappa over mass
    ratio = np.divide(lift, total, out=np.full(len(means), np.nan), where=total > 0)
    return _Bins(means, speeds, commands, measured, ratio, drives, lift, up, _flying(ratio))


def hover(frame: pd.DataFrame, mass_kg: float, curve: Quantity, radius_m: float) -> Hover:
    """Estimate the thrust of a rotor over its drive, from a flight of known mass.

    Parameters
    ----------
    frame : table (n rows) of a flight in contract columns.
    mass_kg : mass as flown.
    curve : linear share of the thrust curve; used where rotor speeds were not measured.
    radius_m : of a rotor; six radii above the lowest point count as out of ground effect.

    Returns
    -------
    Thrust over drive. Its sd is the spread over the half seconds, 2 % of the value, and what the sd
    of the curve moves it by.

    Raises
    ------
    GesError
        When nothing drives the rotors, or less than five seconds fly.

    Notes
    -----
    In every half second m (g + dv_z/dt) / cos(tilt) = kappa sum_i d_i. Measured rotor speeds give d
    = w^2, commands alone d = (1 - c) u^2 + c u. kappa is the median over what hovers out of ground
    effect.
    """
    bins = _bins(frame, curve.value)
    quiet = _hovering(bins, radius_m)
    # better from all of the flight than not at all; the source says so
    used = quiet if quiet.sum() >= FEWEST_BINS else bins.flying
    if used.sum() < FEWEST_BINS:
        raise GesError(
            f"only {used.sum() * BIN_S:.1f} s of the log fly with commands above zero; it takes"
            f" {FEWEST_BINS * BIN_S:.0f} s of flight to tell the thrust"
        )
    kappa, spread = _centre(mass_kg * bins.ratio[used])
    moved = 0.0
    if bins.commands is not None and not bins.measured:
        # the same hover under a straighter curve: where one is uncertain, so is the other
        straighter = normalised_thrust(bins.commands, curve.value + curve.sd).sum(axis=1)
        moved = _centre(mass_kg * (bins.lift[used] / straighter[used]))[0] - kappa
    return Hover(
        Quantity(value=kappa, sd=math.hypot(HOVER_SD_REL * kappa, spread, moved)),
        float(np.median(bins.drives[used])),
        float(used.sum() * BIN_S),
        used is quiet,
        bins.measured,
        bins.drives.shape[1],
    )


def _centre(values: np.ndarray) -> tuple[float, float]:
    """Compute the median, and the sd that the middle half of the values has."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    # the middle half of a normal distribution is 1.349 standard deviations wide
    return float(middle), float((high - low) / 1.349)


@dataclasses.dataclass(frozen=True)
class Response:
    """How rotor speeds follow commands.

    Attributes
    ----------
    top_speed_rad_s : speed at full command.
    c : linear share of the thrust curve.
    lag_s : first-order time constant; None where telemetry is too slow to show it.
    r2 : share of the variance of speeds that commands and curve explain, over half seconds.
    span : 1 % and 99 % quantile of the commands.
    """

    top_speed_rad_s: Quantity
    c: Quantity
    lag_s: Quantity | None
    r2: float
    span: tuple[float, float]


def response(frame: pd.DataFrame, curve: Quantity) -> Response | None:
    """Fit top speed, thrust curve and lag to a flight with rotor speeds and commands.

    Parameters
    ----------
    frame : table (n rows) of a flight in contract columns.
    curve : linear share of the thrust curve before this flight, with its sd: the prior.

    Returns
    -------
    The fit; None where speeds or commands are missing, too few, or hardly correlated.

    Notes
    -----
    w = w_max sqrt((1 - c) u^2 + c u) is fitted to means over half a second. The lag is then fitted
    to fast telemetry.
    """
    if not rotor_speeds_in(frame) or len(rotor_speeds_in(frame)) != len(commands_in(frame)):
        return None
    bins = _bins(frame, curve.value)
    speeds, commands = bins.speeds, bins.commands
    if speeds is None or commands is None:
        return None
    # a stopped rotor has no place on the curve
    good = bins.flying[:, None] & (speeds > 0) & (commands > 0)
    if good.sum() < good.shape[1] * FEWEST_BINS:
        return None
    w, u = speeds[good], commands[good]
    steady = _steady_response(w, u, curve)
    if steady is None:
        return None
    top, c, r2 = steady
    span = (float(np.quantile(u, 0.01)), float(np.quantile(u, 0.99)))
    return Response(top, c, _lag(frame, c.value), r2, span)


def _steady_response(
    w: np.ndarray, u: np.ndarray, curve: Quantity
) -> tuple[Quantity, Quantity, float] | None:
    """Fit top speed and curve to speeds and commands (n,).

    Returns
    -------
    Top speed, curve, and share of variance explained; None where that is little.
    """
    usual = float(np.median(w))
    # the search is for x[0] about 1 beside c, so that one step suits both
    unit = usual / float(np.sqrt(max(np.median(normalised_thrust(u, curve.value)), 1e-4)))

    def misfit(x: np.ndarray, scale: float) -> np.ndarray:
        speed = x[0] * unit * np.sqrt(np.maximum(normalised_thrust(u, x[1]), 1e-9))
        # the last row is what was known of c before, in its own standard deviation
        return np.append((speed - w) / scale, (x[1] - curve.value) / max(curve.sd, 1e-3))

    start, scale = np.array([1.0, curve.value]), 0.05 * usual
    # how large errors are is known from a first fit only, and it decides what the prior weighs
    for _ in range(2):
        fit = least_squares(
            misfit, start, args=(scale,), bounds=([0.1, -0.5], [10.0, 1.0]), loss="soft_l1"
        )
        residuals = misfit(fit.x, 1.0)[:-1]
        # Errors of one rotor hold for seconds, so that a tenth of the samples count as independent.
        scale = np.sqrt(10.0) * max(float(np.sqrt(np.mean(residuals**2))), 1e-3 * usual)
        start = fit.x
    r2 = 1.0 - float(np.var(residuals) / np.var(w))
    if not r2 > LEAST_R2:
        return None
    # (J' J)^-1, as the rows are in units of their standard deviation
    sd = np.sqrt(np.maximum(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)), 0.0))
    top = fit.x[0] * unit
    return (
        Quantity(value=top, sd=float(np.hypot(sd[0] * unit, TOP_SPEED_SD_REL * top))),
        Quantity(value=fit.x[1], sd=max(float(sd[1]), LEAST_CURVE_SD)),
        r2,
    )


def _lag(frame: pd.DataFrame, c: float) -> Quantity | None:
    """Fit the time constant of dw/dt = (w_cmd - w) / tau, with a pure delay, to fast telemetry.

    Both sides are compared after a high-pass of 0.3 s, over a grid of time constants and delays.
    """
    turning, asking = rotor_speeds_in(frame), commands_in(frame)
    rows = frame[["t_s", *turning, *asking]].dropna()
    if len(rows) < FEWEST_ROWS:
        return None
    step_s = float(np.median(np.diff(rows["t_s"])))
    if step_s > SLOWEST_TELEMETRY_S:
        return None
    commands = rows[list(asking)].to_numpy(dtype=float)
    asked = np.sqrt(normalised_thrust(commands, c))
    # slow errors, of the battery or the curve, would hide what a few hundredths of a second do
    fast = _fast(rows[list(turning)].to_numpy(dtype=float), step_s)
    lags_s = np.geomspace(*LAGS_S, 40)
    score = [_likeness(_fast(_slow(asked, step_s, lag), step_s), fast, step_s) for lag in lags_s]
    best = int(np.argmax(score))
    # the end of the grid is no maximum
    if not 0 < best < len(lags_s) - 1 or score[best] < LEAST_LIKENESS:
        return None
    return Quantity(value=float(lags_s[best]), sd=LAG_SD_REL * float(lags_s[best]))


def _likeness(made: np.ndarray, seen: np.ndarray, step_s: float) -> float:
    """Compute the correlation of two signals (n, k) at the delay that maximises it."""
    n = len(seen)
    # a delay would else pass for a longer lag
    pairs = ((made[: n - late], seen[late:]) for late in range(int(LONGEST_DELAY_S / step_s) + 1))
    return max(float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b))) for a, b in pairs)


def _slow(values: np.ndarray, step_s: float, lag_s: float) -> np.ndarray:
    """Apply a first-order low-pass along the rows, at rest before the first."""
    # here, as it takes a third of a second and few vehicles are made from a log
    from scipy.signal import lfilter

    keep = np.exp(-step_s / lag_s)
    return lfilter([1.0 - keep], [1.0, -keep], values - values[:1], axis=0) + values[:1]


def _fast(values: np.ndarray, step_s: float) -> np.ndarray:
    return values - _slow(values, step_s, HIGH_PASS_S)
