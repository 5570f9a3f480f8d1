"""Whether the streams of a log agree with one another on axes, signs and units."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from ges.conventions import (
    BODY_RATE,
    GRAVITY_M_S2,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    commands_in,
    rotor_speeds_in,
)
from ges.vehicle.file import Quantity, Vehicle

_STEP_S, _SMOOTH_S = 0.02, 0.15
# rotors turn a vehicle faster than that moves it
_FAST_STEP_S, _FAST_SMOOTH_S = 0.01, 0.05
_LONGEST_GAP_S = 0.5
_FEWEST = 100
_STILL = 1e-6
# smooth body rates of a vehicle in the air scatter by more, however calm it is
_STANDING_RAD_S = 0.01
_LEAST_UPRIGHT = 0.2
# a pair never agrees better than clocks and filters let it
_LEAST_MISFIT = 1e-3
_TURNS = ("roll", "pitch", "yaw")
# of the log of a number of a vehicle file: hardly any is wrong by twice
_SIZE_SD = 0.3
MASS, FULL_SPEED = "mass_kg", "max_rotor_speed_rad_s"
INERTIA = ("ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2")

Columns = Mapping[str, np.ndarray]
Pairs = Iterator[tuple[str, np.ndarray, np.ndarray]]


def of_rotors(quantity: str, n_rotors: int) -> tuple[str, ...]:
    """Name a quantity of each rotor of the vehicle file, as :func:`numbers_of` does.

    Parameters
    ----------
    quantity : ``x_m``, ``y_m``, ``spin``, ``thrust_N_s2`` or ``torque_Nm_s2``.
    n_rotors : number of rotors.
    """
    return tuple(f"{quantity}_of_{i + 1}" for i in range(n_rotors))


def numbers_of(vehicle: Vehicle) -> dict[str, Quantity]:
    """Give the numbers of a vehicle file that streams are compared by, as if they were logged.

    Parameters
    ----------
    vehicle : its file; what it does not state is left out.

    Returns
    -------
    Numbers by name, in the unit of the name. A coefficient of all rotors has its standard deviation
    at the first, so that it counts once.
    """
    rotors, n_rotors = vehicle.rotor_arrays(), len(vehicle.rotors)
    of_each = {name: (Quantity(value=1.0), rotors[name]) for name in ("x_m", "y_m", "spin")}
    of_each["thrust_N_s2"] = vehicle.thrust_coefficient_N_s2, rotors["thrust"]
    if torque := vehicle.torque_coefficient_Nm_s2:
        of_each["torque_Nm_s2"] = torque, rotors["torque"]
    numbers = {MASS: vehicle.mass_kg}
    if inertia := vehicle.inertia_kg_m2:
        numbers |= {
            name: Quantity(value=value, sd=inertia.sd_rel * value)
            for name, value in zip(INERTIA, (inertia.xx, inertia.yy, inertia.zz), strict=True)
        }
    if full := vehicle.max_rotor_speed_rad_s:
        numbers[FULL_SPEED] = full
    for quantity, (common, shares) in of_each.items():
        for i, name in enumerate(of_rotors(quantity, n_rotors)):
            sd = 0.0 if i else common.sd * shares[i]
            numbers[name] = Quantity(value=common.value * shares[i], sd=sd)
    return numbers


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How one quantity follows another that physics ties to it.

    Attributes
    ----------
    what : the two quantities, in words.
    correlation : 1 where they agree, -1 where a sign is wrong; 0 without motion.
    ratio : how many times as large the first is as the second (least squares).
    rms : standard deviation of the second, in its unit: small where little moves.
    """

    what: str
    correlation: float
    ratio: float
    rms: float


@dataclasses.dataclass(frozen=True)
class PairFit:
    """How much of two quantities does not agree that physics makes equal or proportional.

    Attributes
    ----------
    misfit : share of the power of either that the other does not explain, 1 - max(0, c)^2. c is
        twice the mean product of both over the sum of their powers, about their means. Where a
        factor between them is free it is their correlation. The misfit is 0 for equals, 1 for
        strangers or opposites.
    windows : number of independent windows, by the width of the smoothing.
    columns : names of what both are computed from, numbers of the vehicle file among them.
    log_size : natural logarithm of how many times as large the first is as the second, by the
        numbers of the vehicle file; None where these do not say.
    log_size_sd : of this, by noise and by the uncertainties that the vehicle file states.
    """

    misfit: float
    windows: float
    columns: frozenset[str]
    log_size: float | None = None
    log_size_sd: float = 0.0

    @property
    def log_likelihood(self) -> float:
        """Log likelihood over that of strangers, noise at its most likely value: -(n/2) log m."""
        return -0.5 * self.windows * float(np.log(max(self.misfit, _LEAST_MISFIT)))


def size_log_likelihood(fits: Sequence[PairFit]) -> float:
    """Compute the log likelihood of one pair's sizes in several flights.

    Parameters
    ----------
    fits : of the same pair, one a flight; all have a size.

    Returns
    -------
    log N(x; 0, s), less its greatest value without these uncertainties. x is the mean of the log
    sizes: all flights have the same numbers, so that they count once.
    """
    size, sd = np.mean([(fit.log_size or 0.0, fit.log_size_sd) for fit in fits], axis=0)
    variance = _SIZE_SD**2 + sd**2
    return float(-0.5 * size**2 / variance - 0.5 * np.log(variance / _SIZE_SD**2))


@dataclasses.dataclass(frozen=True)
class OnGrids:
    """Columns of a flight at even times, once for all ways to read them.

    Attributes
    ----------
    values : by step of the grid and name, (t,), NaN in gaps, and numbers of the vehicle file, ();
        empty where the flight is too short, or too long for its rows.
    row_s : median spacing of the rows.
    sd_rel : of numbers of the vehicle file, by name, relative to each.
    as_logged : the values before any was replaced.
    smoothed : quantities that were computed from these, by key; they are the same in most readings.
    """

    values: Mapping[float, Columns]
    row_s: float
    sd_rel: Mapping[str, float]
    as_logged: Mapping[float, Columns]
    smoothed: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(
        cls, frame: Columns | pd.DataFrame, numbers: Mapping[str, Quantity] | None = None
    ) -> OnGrids:
        """Interpolate the columns that pairs are computed from.

        Parameters
        ----------
        frame : table (n rows) with ``t_s`` and contract columns.
        numbers : of the vehicle file, as :func:`numbers_of` gives them.
        """
        t_s = np.asarray(frame["t_s"], dtype=float)
        row_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else np.inf
        grids = {step_s: _grid(t_s, step_s) for step_s in (_STEP_S, _FAST_STEP_S)}
        fixed = (*POSITION, *VELOCITY, *QUATERNION, *BODY_RATE, *SPECIFIC_FORCE)
        names = (*(c for c in fixed if c in frame), *commands_in(frame), *rotor_speeds_in(frame))
        values = {
            step_s: {
                **{c: _on(grid, t_s, np.asarray(frame[c], dtype=float)) for c in names},
                **{c: np.asarray(number.value) for c, number in (numbers or {}).items()},
            }
            for step_s, grid in grids.items()
            if grid is not None
        }
        sd_rel = {c: abs(n.sd / n.value) for c, n in (numbers or {}).items() if n.sd}
        return cls(values, row_s, sd_rel, values, {})

    @property
    def logged(self) -> Columns:
        """Columns by name, on the coarse grid; empty where there is none."""
        return self.values.get(_STEP_S, {})

    def read(self, otherwise: Callable[[Columns], Columns]) -> OnGrids:
        """Replace columns by others.

        Parameters
        ----------
        otherwise : function of the columns to those that change.
        """
        values = {step_s: {**v, **otherwise(v)} for step_s, v in self.values.items()}
        return dataclasses.replace(self, values=values)


@dataclasses.dataclass(frozen=True)
class _Side:
    """One quantity of a pair, or of several pairs.

    Attributes
    ----------
    key : names the quantity.
    streams : columns that it is computed from, and numbers of the vehicle file.
    of : function of the streams on a grid, each (t, k), and of the numbers, each (k,), to the
        quantity, (t, n).
    """

    key: str
    streams: tuple[tuple[str, ...], ...]
    of: Callable[..., np.ndarray]

    @functools.cached_property
    def columns(self) -> frozenset[str]:
        return frozenset(c for stream in self.streams for c in stream)

    def smooth(self, flight: OnGrids, step_s: float, smooth_s: float) -> tuple[np.ndarray, ...]:
        """Smooth the quantity, (t, n), and say where it has samples, (t, n)."""
        values, as_logged = flight.values[step_s], flight.as_logged[step_s]
        key = (self.key, f"{step_s:g} s")
        same = all(values[c] is as_logged[c] for c in self.columns)
        if same and key in flight.smoothed:
            return flight.smoothed[key]
        quantity = self.of(*(np.stack([values[c] for c in s], axis=-1) for s in self.streams))
        made = _smooth(quantity, smooth_s / step_s)
        if same:
            flight.smoothed[key] = made
        return made


@dataclasses.dataclass(frozen=True)
class _Tie:
    """Quantities that physics ties to one another.

    Attributes
    ----------
    names : both quantities in words, for each component.
    sides : both quantities.
    step_s, smooth_s : step of the grid and width of the smoothing.
    free : whether a factor between them is not known.
    sized : whether both are in the same unit by the vehicle file, for each component; none if so
        for none.
    level : whether they are compared in size alone, about zero.
    """

    names: Sequence[str]
    sides: tuple[_Side, _Side]
    step_s: float = _STEP_S
    smooth_s: float = _SMOOTH_S
    free: bool = False
    sized: Sequence[bool] = ()
    level: bool = False

    @functools.cached_property
    def columns(self) -> frozenset[str]:
        return self.sides[0].columns | self.sides[1].columns

    @functools.cached_property
    def depends_on(self) -> frozenset[str]:
        """What its fits change with: a size has no windows, and is the same at other times."""
        return self.columns if self.level else self.columns | {"t_s"}

    def pairs(self, flight: OnGrids) -> Pairs:
        """Give both of each pair, smooth and about their means, where they have samples."""
        (a, has_a), (b, has_b) = (
            side.smooth(flight, self.step_s, self.smooth_s) for side in self.sides
        )
        for k, what in enumerate(self.names):
            both = has_a[:, k] & has_b[:, k]
            if both.sum() >= _FEWEST:
                x, y = a[both, k], b[both, k]
                # without motion there is nothing to compare; where the unit is free in no unit
                still = [_STILL * (np.abs(side).max() if self.free else 1.0) for side in (x, y)]
                if not self.level:
                    x, y = x - x.mean(), y - y.mean()
                if all(
                    np.sqrt(np.mean(s**2)) > least for s, least in zip((x, y), still, strict=True)
                ):
                    yield what, x, y

    def fits(self, flight: OnGrids) -> Iterator[tuple[str, PairFit]]:
        """Measure how well both of each pair agree."""
        # width of a box that averages noise as the smoothing does; no window is shorter
        window = self.step_s / max(2.0 * np.sqrt(np.pi) * self.smooth_s, flight.row_s)
        sized = dict(zip(self.names, self.sized, strict=False))
        stated = np.sqrt(sum(flight.sd_rel.get(c, 0.0) ** 2 for c in self.columns))
        for what, a, b in self.pairs(flight):
            both, either = a @ b, np.sqrt((a @ a) * (b @ b))
            if self.level:
                size = float(np.log(max(both / (b @ b), _STILL)))
                yield what, PairFit(1.0, 0.0, self.depends_on, size, float(stated))
                continue
            power = either if self.free else 0.5 * (a @ a + b @ b)
            misfit = 1.0 - max(0.0, float(both / power)) ** 2
            fit = PairFit(misfit, len(a) * window, self.depends_on)
            if sized.get(what) and both > 0.0:
                # between the regressions of either on the other
                size, noise = 0.5 * np.log((a @ a) / (b @ b)), np.log(either / both)
                sd = np.hypot(noise, stated)
                fit = dataclasses.replace(fit, log_size=float(size), log_size_sd=float(sd))
            yield what, fit


def agreements(frame: pd.DataFrame) -> list[Agreement]:
    """Compare pairs of quantities that must agree, smoothed over 0.15 s.

    Parameters
    ----------
    frame : table (n rows) with ``t_s`` and contract columns.

    Returns
    -------
    One agreement for each component; pairs that were not logged are left out.

    Notes
    -----
    The pairs are:

    - body rates and the turning of the attitude;
    - velocity and the derivative of the position;
    - acceleration of the velocity and the specific force in the world, dv/dt = R f - g e_z;
    - specific force along the thrust axis and squared rotor speeds, or commands.
    """
    flight = OnGrids.of(frame)
    return [
        Agreement(what, float(np.corrcoef(a, b)[0, 1]), float(a @ b / (b @ b)), float(np.std(b)))
        for tie in (*_kinematic_ties(flight.logged), *_thrust_ties(flight.logged))
        for what, a, b in tie.pairs(flight)
    ]


def pair_fits(
    flight: OnGrids, among: Collection[str] | None = None
) -> Iterator[tuple[str, PairFit]]:
    """Measure how well quantities agree that physics makes equal or proportional.

    Parameters
    ----------
    flight : its columns at even times, with the numbers of the vehicle file where it is known.
    among : what a pair has to be computed from, in part; None for every pair.

    Yields
    ------
    The pair in words, and its fit; pairs that were not logged or do not move are left out.

    Notes
    -----
    The pairs are:

    - those of :func:`agreements` without the thrust. Without an accelerometer the horizontal
      acceleration is compared with the tilt, dv/dt = g (R e_z)_xy / (R e_z)_z;
    - commands and squared rotor speeds, each over the mean of all rotors;
    - angular acceleration and the moments of the rotors over the inertia,
      d(omega)/dt = I^-1 sum_i (y_i k, -x_i k, -spin_i k_q) w_i^2. Where no speeds were logged, the
      shares of the commands stand for w_i^2;
    - in size alone: m f_z and sum_i k w_i^2, and rotor speeds and commands times the full speed.

    A factor between the two of a pair is free where motors are in it, but not below zero. Where
    speeds were logged its size is compared with the numbers of the vehicle file.
    """
    for tie in _ties(frozenset(flight.logged)):
        if among is None or not tie.depends_on.isdisjoint(among):
            yield from tie.fits(flight)


@functools.cache
def _ties(names: frozenset[str]) -> tuple[_Tie, ...]:
    """List the ties of a log and its vehicle file, by the names of what they hold."""
    of = (_kinematic_ties, _drive_ties, _mixer_ties, _level_ties)
    return tuple(tie for ties in of for tie in ties(names))


def _grid(t_s: np.ndarray, step_s: float) -> np.ndarray | None:
    """Make even times of a flight; None where it is too short, or too long for its rows."""
    if len(t_s) < 2 or t_s[-1] - t_s[0] > _LONGEST_GAP_S * len(t_s):
        return None
    grid = np.arange(t_s[0], t_s[-1], step_s)
    return grid if len(grid) >= _FEWEST else None


def _kinematic_ties(logged: Collection[str]) -> Iterator[_Tie]:
    turning = _Side("turning of the attitude", (QUATERNION,), lambda q: _rates(q, _STEP_S))
    names = [f"{c} and the turning of the attitude" for c in BODY_RATE]
    yield from _logged(logged, _Tie(names, (_Side("gyro", (BODY_RATE,), _itself), turning)))
    speeding = _Side("acceleration", (VELOCITY,), lambda v: np.gradient(v, _STEP_S, axis=0))
    if all(c in logged for c in SPECIFIC_FORCE):
        felt = _Side("felt acceleration", (QUATERNION, SPECIFIC_FORCE), _felt_acceleration)
        names = [f"d({c})/dt and the accelerometer" for c in VELOCITY]
    else:
        felt = _Side("tilt", (QUATERNION,), _tilt_acceleration)
        names = [f"d({c})/dt and the tilt" for c in VELOCITY[:2]]
    yield from _logged(logged, _Tie(names, (speeding, felt)))
    moving = _Side("motion", (POSITION,), lambda p: np.gradient(p, _STEP_S, axis=0))
    names = [f"d({p})/dt and {v}" for p, v in zip(POSITION, VELOCITY, strict=True)]
    yield from _logged(logged, _Tie(names, (moving, _Side("velocity", (VELOCITY,), _itself))))


def _logged(logged: Collection[str], tie: _Tie) -> Iterator[_Tie]:
    if all(c in logged for c in tie.columns):
        yield tie


def _itself(stream: np.ndarray) -> np.ndarray:
    return stream


def _felt_acceleration(q: np.ndarray, force: np.ndarray) -> np.ndarray:
    # dv/dt = R f - g e_z
    return turned_into("world", force, q) - [0.0, 0.0, GRAVITY_M_S2]


def _tilt_acceleration(q: np.ndarray) -> np.ndarray:
    axis = turned_into("world", np.broadcast_to([0.0, 0.0, 1.0], (len(q), 3)), q)
    return GRAVITY_M_S2 * axis[:, :2] / np.maximum(axis[:, 2:], _LEAST_UPRIGHT)


def _thrust_ties(logged: Collection[str]) -> Iterator[_Tie]:
    name, columns, power = _push(logged)
    if columns:
        force = _Side("force", (SPECIFIC_FORCE,), lambda f: f[:, 2:])
        push = _Side("push", (columns,), lambda p: (p**power).sum(axis=1, keepdims=True))
        yield from _logged(logged, _Tie([f"acc_z_m_s2 and {name}"], (force, push)))


def _drive_ties(logged: Collection[str]) -> Iterator[_Tie]:
    commands, speeds = commands_in(logged), rotor_speeds_in(logged)
    if len(commands) == len(speeds) > 0:
        names = [f"{u} and {w}" for u, w in zip(commands, speeds, strict=True)]
        asked = _Side("shares of the commands", (commands,), _shares)
        made = _Side("shares of the speeds", (speeds,), lambda w: _shares(w**2))
        yield _Tie(names, (asked, made), free=True)


def _mixer_ties(logged: Collection[str]) -> Iterator[_Tie]:
    _, columns, power = _push(logged)
    n_rotors = len(columns)
    turning = [s for s in (BODY_RATE, QUATERNION) if all(c in logged for c in s)]
    arms = [of_rotors(name, n_rotors) for name in ("x_m", "y_m", "spin", "thrust_N_s2")]
    known = all(c in logged for names in arms for c in names)
    # a file of another number of rotors says nothing of these
    if not turning or not n_rotors or not known or of_rotors("spin", n_rotors + 1)[-1] in logged:
        return
    torques = of_rotors("torque_Nm_s2", n_rotors)
    with_torque = torques[0] in logged
    sized = power == 2 and INERTIA[0] in logged

    def turn(stream: np.ndarray) -> np.ndarray:
        rates = stream if turning[0] == BODY_RATE else _rates(stream, _FAST_STEP_S)
        return np.gradient(rates, _FAST_STEP_S, axis=0)

    def mix(push: np.ndarray, *numbers: np.ndarray) -> np.ndarray:
        x, y, spin, thrust, *more = numbers
        torque = more[0] if with_torque else thrust
        inertia = more[-1] if sized else np.ones(3)
        if not sized:
            # in shares, where nothing says how much a command pushes
            thrust, torque = thrust / thrust.mean(), torque / torque.mean()
        levers = np.stack([y * thrust, -x * thrust, -spin * torque], axis=1)
        return _shares(push**power) @ levers / inertia

    more = [*([torques] if with_torque else []), *([INERTIA] if sized else [])]
    yield _Tie(
        [f"mixer in {axis}" for axis in _TURNS],
        (_Side("turn", (turning[0],), turn), _Side("mixer", (columns, *arms, *more), mix)),
        _FAST_STEP_S,
        _FAST_SMOOTH_S,
        free=True,
        sized=(sized, sized, sized and with_torque),
    )


def _level_ties(logged: Collection[str]) -> Iterator[_Tie]:
    commands, speeds = commands_in(logged), rotor_speeds_in(logged)
    if not speeds:
        return
    thrusts = of_rotors("thrust_N_s2", len(speeds))
    lift = _Side("lift", (speeds, thrusts), lambda w, k: (w**2) @ k[:, None])
    # upright most of the time, and on average not accelerated
    felt = SPECIFIC_FORCE if all(c in logged for c in SPECIFIC_FORCE) else speeds
    rates = [BODY_RATE] if all(c in logged for c in BODY_RATE) else []

    def weigh(of: np.ndarray, mass: np.ndarray, *rates: np.ndarray) -> np.ndarray:
        force = of[:, 2:3] if felt == SPECIFIC_FORCE else np.full((len(of), 1), GRAVITY_M_S2)
        turning = [_smooth(rate, _SMOOTH_S / _STEP_S)[0].std(axis=0) for rate in rates]
        # the ground carries what stands on it
        stands = any(sds.max() < _STANDING_RAD_S for sds in turning)
        return np.full_like(force, np.nan) if stands else mass * force

    weight = _Side("weight", (felt, (MASS,), *rates), weigh)
    yield from _logged(logged, _Tie(["weight and thrust"], (weight, lift), level=True))
    if len(commands) == len(speeds):
        names = [f"{w} and the full speed" for w in speeds]
        turned = _Side("rotor speeds", (speeds,), _itself)
        asked = _Side("speeds asked for", (commands, (FULL_SPEED,)), lambda u, full: u * full)
        yield from _logged(logged, _Tie(names, (turned, asked), level=True))


def _push(logged: Collection[str]) -> tuple[str, tuple[str, ...], int]:
    """Name what goes with the thrust of every rotor, its columns (none if not logged) and power."""
    # speeds first: thrust goes with their square, whatever the drive does
    if speeds := rotor_speeds_in(logged):
        return "squared rotor speeds", speeds, 2
    return "commands", commands_in(logged), 1


def _shares(values: np.ndarray) -> np.ndarray:
    """Compute what every motor has over the mean of all, (t, n)."""
    return values - values.mean(axis=1, keepdims=True)


def turned_into(frame: str, vectors: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Turn vectors by attitudes.

    Parameters
    ----------
    frame : ``body`` for vectors of the world, ``world`` for those of the body.
    vectors : (n, 3).
    q : (n, 4) body to world, scalar first.

    Returns
    -------
    (n, 3), NaN where the attitude is not known.
    """
    turned, valid = _attitude(q)
    valid &= np.isfinite(vectors).all(axis=1)
    result = turned.apply(np.where(valid[:, None], vectors, 0.0), inverse=frame == "body")
    result[~valid] = np.nan
    return result


def _attitude(q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Give attitudes, and where they are known."""
    valid = np.isfinite(q).all(axis=1) & (np.linalg.norm(q, axis=1) > 0.0)
    return Rotation.from_quat(
        np.where(valid[:, None], q, [1.0, 0.0, 0.0, 0.0]), scalar_first=True
    ), valid


def _rates(q: np.ndarray, step_s: float) -> np.ndarray:
    turned, valid = _attitude(q)
    # body rates: log(q_k* q_k+1) / dt
    step = (turned[:-1].inv() * turned[1:]).as_rotvec() / step_s
    turning = np.vstack([step, step[-1:]])
    # a turn needs both of its attitudes
    turning[~(valid & np.r_[valid[1:], False])] = np.nan
    return turning


def _on(grid: np.ndarray, t_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate a column (n,) on the grid between its own samples; NaN in gaps."""
    finite = np.isfinite(values)
    t = t_s[finite]
    if len(t) < 2:
        return np.full(len(grid), np.nan)
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    # a line across a long gap would be no sample
    near = (t[after] - t[after - 1] < _LONGEST_GAP_S) & (grid >= t[0]) & (grid <= t[-1])
    return np.where(near, np.interp(grid, t, values[finite]), np.nan)


def _smooth(values: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Smooth quantities (t, n) over ``width`` samples, and say where they have samples."""
    valid = np.isfinite(values)
    if not valid.all():
        # gaps are bridged for the filter alone; only what is there is compared
        steps = np.arange(len(values))
        bridged = [
            np.interp(steps, steps[has], v[has]) if has.any() else np.zeros(len(v))
            for v, has in zip(values.T, valid.T, strict=True)
        ]
        values = np.stack(bridged, axis=1)
    return gaussian_filter1d(values, width, axis=0), valid
