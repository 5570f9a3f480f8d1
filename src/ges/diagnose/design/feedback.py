"""Feedback: what a controller's response, or noise of a reading, may add to columns.

A controller responds to turbulence. What it moves then correlates with the disturbance that a
residual contains. Instruments explain a part of such a column. The rest is *endogenous*, and its
coefficient may err by the correlation (see ``whiten``). The kinds are:

- ``dynamic``: what rotor speeds and their changes make of a moment, and of thrust where commands
  alone are known. All of it is endogenous. The mean along thrust is not, which has no cause but the
  balance. A trim moment has causes of its own (a shifted centre of gravity, a weak rotor), and is
  subtracted first (see :func:`subtract_trims`).
- ``thrust_gain``: what multiplies thrust. Its part along thrust is endogenous where thrust changed
  fast and not its gain. So are changes of the moment of a gain near the ground that is on, because
  attitude responds too.
- ``rotor``: what takes thrust from one rotor. Changes of its moment in roll and pitch are
  endogenous, which show responses to yaw as well. With a weak rotor a response in roll also yaws,
  and takes large changes of all speeds. Its trim counts in full.
- ``load``: what hangs below, once it is on. Fast changes of its pull along thrust are endogenous:
  disturbances shake the vehicle, and so the load.
- ``drive``: all that moves a rotor's speed. Its changes are endogenous. The noise of the commands
  between two rows is in the model's speed, in the residual and in the column alike.
- ``motion``: what velocity and body rates make of a moment. A disturbance that turns the vehicle
  makes its rates, too, and then its speed. Changes are endogenous.
- ``height``: an error of a rangefinder that grows with height. The height that it is compared with
  is a reading, too.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import AXES
from ges.diagnose.design.instruments import (
    directions,
    instrument_strength,
    instruments,
    project,
    rotor_signals,
)
from ges.diagnose.design.table import ColumnTable
from ges.diagnose.design.weak import Windows, blocks_of
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import MarkedChannel, ParameterKey
from ges.diagnose.types.model import SPEED, Model, block_of
from ges.simulator import effects as effect_table
from ges.simulator.laws import LAW

VERTICAL = ("force_z", "acc_z")
ROLL_PITCH, YAW = ("moment_x", "moment_y"), "moment_z"
DRIVE, MOTION = "drive", "motion"
OWN_MOMENT = "/moment"
"""Behind the key of a moment that has a coefficient, and so an endogenous part, of its own."""


def _effect_of(key: str) -> effect_table.Effect | None:
    """Return the effect of a number, or None for one of the vehicle that no effect corrects."""
    return effect_table.table().get(ParameterKey.of(key).effect)


def feedback_of(key: str) -> str:
    """Return how a controller's response shows in a column.

    Parameters
    ----------
    key : ``effect.parameter``.

    Returns
    -------
    The kind; 'none' for a number that no effect corrects.
    """
    effect = _effect_of(key)
    return effect.feedback if effect else "none"


def near_ground_gain(key: str) -> bool:
    """Return whether a column is a thrust gain that depends on the height.

    Parameters
    ----------
    key : ``effect.parameter``.
    """
    effect = _effect_of(key)
    return effect is not None and effect.feedback == "thrust_gain" and "height" in effect.needs


def moves_a_speed(key: str) -> bool:
    """Return whether a number is of a drive: of an actuator, or the top speed.

    Parameters
    ----------
    key : ``effect.parameter``.
    """
    effect = _effect_of(key)
    return key == SPEED or (effect is not None and effect.kind == "actuator")


def is_made_by_velocity(key: str) -> bool:
    """Return whether a number is of a force or moment that velocity and body rates make.

    Parameters
    ----------
    key : ``effect.parameter``. A law is one of them, whatever it is of: moments make the rates.
    """
    if ParameterKey.of(key).effect == LAW:
        return True
    effect = _effect_of(key)
    return effect is not None and effect.feedback == "none" and "velocity" in effect.needs


def subtract_trims(
    dynamic: Collection[int],
    x: ColumnTable,
    windows: Windows,
    names: Sequence[str],
    thrust: np.ndarray,
    omega: np.ndarray,
    air: np.ndarray,
) -> ColumnTable:
    """Subtract the trim from the moments of ``dynamic`` columns.

    Parameters
    ----------
    dynamic : indices of these columns.
    x : the columns (m, C, K).
    windows : m windows of the flight.
    names : of the C channels.
    thrust : (n,) N.
    omega : (n, 3) body rates, rad/s.
    air : (m,) True for windows in the air.

    Returns
    -------
    The columns without their trim; all others are shared.

    Notes
    -----
    A trim is constant or proportional to thrust. A moment that turned the vehicle is no trim,
    though thrust may have changed with it in repeated turns. So the angular acceleration is a
    regressor as well, and stays.
    """
    is_dynamic = np.zeros(x.shape[2], dtype=bool)
    is_dynamic[list(dynamic)] = True
    constant_and_thrust = np.column_stack([np.ones(len(thrust)), thrust])
    values = [list(columns) for columns in x.values]

    @functools.cache
    def trim_and_rates(mark: str) -> tuple[np.ndarray, np.ndarray]:
        # by the channel's own test function: the average of what is held, the rate of what turned
        mean, rate = windows.functions[mark]
        return (mean @ constant_and_thrust)[air], (rate @ omega)[air]

    for c, name in enumerate(names):
        if block_of(name) != "moment" or not is_dynamic[x.at[c]].any():
            continue
        trim, rates = trim_and_rates(MarkedChannel.of(name).mark)
        rotation = rates[:, AXES.index(name[len("moment_")])]
        indices = np.flatnonzero(is_dynamic[x.at[c]])
        columns = np.stack([values[c][k] for k in indices], axis=1)
        regressors = np.column_stack([trim, rotation])
        # both are fitted, the trim alone is taken out
        fitted = np.linalg.lstsq(regressors, columns[air], rcond=None)[0]
        columns[air] -= trim @ fitted[: trim.shape[1]]
        for k, column in zip(indices, columns.T, strict=True):
            values[c][k] = column.copy()
    return dataclasses.replace(x, values=tuple(map(tuple, values)))


@dataclasses.dataclass(frozen=True)
class FlightInstruments:
    """Instruments of one flight by channel.

    Attributes
    ----------
    spanned : (m, r) orthonormal directions of those that are strong.
    signal : (m,) thrust or moment of the rotors, or commands of a drive.
    strength : share of the signal that the instruments explain.
    """

    spanned: Mapping[str, np.ndarray]
    signal: Mapping[str, np.ndarray]
    strength: Mapping[str, float]


def flight_instruments(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    y: np.ndarray,
    speeds: np.ndarray,
) -> FlightInstruments:
    """Compute the instruments of moments, of forces along thrust, and of drives.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight, in the air.
    model : of the vehicle.
    names : of the C channels.
    y : (m, C) residuals; channels with gaps have no strength.
    speeds : (n, rotors) acting rotor speeds, rad/s.
    """
    z = instruments(flight, windows, model, names)
    signal = rotor_signals(flight, windows, model, speeds, names)
    block = blocks_of([(windows, flight.t_s[0])], settings.statistics.block_s)[0]
    # channels in which a controller's response shows
    shown = [
        n
        for n, finite in zip(names, np.isfinite(y).all(axis=0), strict=True)
        if finite and (block_of(n) in ("moment", DRIVE) or n in VERTICAL)
    ]
    strength = {n: instrument_strength(signal[n], z[n], block) for n in shown}
    spanned = {n: d for n in shown if _are_strong(strength[n], d := directions(z[n]))}
    return FlightInstruments(spanned, signal, strength)


def instrument_strengths(flights: Sequence[FlightInstruments], names: Sequence[str]) -> list[dict]:
    """Return the strength of the instruments by channel, as diagnosis.json has it.

    Parameters
    ----------
    flights : instruments by flight.
    names : of the channels.

    Returns
    -------
    Mean strength over the flights, and the number of flights in which it is enough.
    """
    by_channel = {n: [t.strength[n] for t in flights if n in t.strength] for n in names}
    return [
        {
            "channel": n,
            "share": float(np.mean(s)),
            "flights_strong": sum(n in t.spanned for t in flights),
            "flights": len(s),
        }
        for n, s in by_channel.items()
        if s
    ]


def _are_strong(share: float, spanned: np.ndarray) -> bool:
    """Return whether instruments (m, r) predict enough of a signal.

    Two-stage least squares err by about 1/F of what plain regression does. That is too much where
    an acceptance would be wrong more rarely.

    References
    ----------
    Staiger and Stock 1997, *Econometrica* 65, 557.
    """
    windows, directions_used = spanned.shape
    # windows overlap by half: every second one is independent
    free = 0.5 * windows - directions_used
    f_statistic = share / max(1.0 - share, settings.numerics.tiny) * free / max(directions_used, 1)
    return f_statistic * settings.statistics.possible_probability > 1.0


@dataclasses.dataclass(frozen=True)
class _Channel:
    """One channel of one flight, as the endogenous parts of its columns need it.

    Attributes
    ----------
    name : of the channel.
    instruments : of the flight.
    length_s : support of a window.
    rates_measured : whether rates or attitude were logged.
    """

    name: str
    instruments: FlightInstruments
    length_s: float
    rates_measured: bool

    @property
    def has_instruments(self) -> bool:
        """Whether the flight's instruments are of this channel."""
        return self.name in self.instruments.strength

    def remainder(self, x: np.ndarray, mean_counts: bool) -> np.ndarray:
        """Return columns (a, k) minus what instruments explain.

        Their mean is subtracted where it counts in full.
        """
        rest = _less_mean(x) if mean_counts else x
        spanned = self.instruments.spanned.get(self.name)
        return rest if spanned is None else rest - project(x, spanned)

    def fast_remainder(self, x: np.ndarray) -> np.ndarray:
        """Return fast changes of columns (a, k) that instruments do not explain.

        Slow changes balance a height, a climb, a load, and respond to no turbulence.
        """
        rest = self.remainder(x, mean_counts=True)
        # a high pass; its width in windows, which stand half a length apart
        width = settings.design.response_slowest_s / (0.5 * self.length_s)
        return rest - gaussian_filter1d(rest, width, axis=0)

    def endogenous_share(self) -> np.ndarray:
        """Return fast changes of thrust that instruments do not explain, over thrust.

        By window in the air, (a, 1). A gain's force is in proportion to thrust, so that this share
        of it is endogenous.
        """
        thrust = self.instruments.signal[self.name]
        # thrust below a descent's, as in a drop, would make the ratio endless
        least = settings.prepare.descent_share * thrust.mean()
        return self.fast_remainder(thrust[:, None]) / np.maximum(thrust, least)[:, None]


PartOfColumns = Callable[[np.ndarray, Sequence[str], _Channel], np.ndarray]


def _dynamic(x: np.ndarray, keys: Sequence[str], channel: _Channel) -> np.ndarray:
    """Return all that instruments do not explain; the mean along thrust counts in full."""
    return channel.remainder(x, mean_counts=channel.name in VERTICAL)


def _thrust_gain(x: np.ndarray, keys: Sequence[str], channel: _Channel) -> np.ndarray:
    """Return the force of unexplained thrust, and the moment of a gain near the ground."""
    # a gain's force is in proportion to thrust: one share of it is endogenous, whatever the gain
    if channel.name in VERTICAL:
        return x * channel.endogenous_share()
    # of moments only that of a gain near the ground that is on: while one is searched, its moment
    # tells it from a fountain
    is_on = [near_ground_gain(key) and key.endswith(OWN_MOMENT) for key in keys]
    return np.array(is_on, dtype=float) * _less_mean(x)


def _changes(x: np.ndarray, keys: Sequence[str], channel: _Channel) -> np.ndarray:
    """Return changes that instruments do not explain."""
    return channel.remainder(x, mean_counts=True)


def _load(x: np.ndarray, keys: Sequence[str], channel: _Channel) -> np.ndarray:
    """Return fast changes along thrust."""
    return channel.fast_remainder(x)


def _height(x: np.ndarray, keys: Sequence[str], channel: _Channel) -> np.ndarray:
    """Return changes of the rangefinder's error."""
    return _less_mean(x)


def _is_balance(channel: _Channel) -> bool:
    """Return whether a channel is one of moments, or of forces along thrust, without gaps."""
    return channel.has_instruments and block_of(channel.name) != DRIVE


def _is_roll_or_pitch(channel: _Channel) -> bool:
    return _is_balance(channel) and channel.name.startswith(ROLL_PITCH)


def _is_unseen_yaw(channel: _Channel) -> bool:
    """Return whether it is yaw under faster test functions, with neither rates nor attitude logged.

    There the moment in yaw turned the vehicle unseen. The noise of the commands is in residual and
    column alike (errors in variables). Its plain average would have spun the vehicle, and counts in
    full.
    """
    seen = channel.rates_measured or not MarkedChannel.of(channel.name).mark
    return _is_balance(channel) and channel.name.startswith(YAW) and not seen


def _is_vertical(channel: _Channel) -> bool:
    return channel.has_instruments and channel.name in VERTICAL


def _is_moment(channel: _Channel) -> bool:
    return channel.has_instruments and block_of(channel.name) == "moment"


def _is_drive(channel: _Channel) -> bool:
    return channel.has_instruments and block_of(channel.name) == DRIVE


def _is_range(channel: _Channel) -> bool:
    return channel.name == "range"


PARTS: tuple[tuple[str, Callable[[_Channel], bool], PartOfColumns], ...] = (
    ("dynamic", _is_balance, _dynamic),
    ("thrust_gain", _is_balance, _thrust_gain),
    ("rotor", _is_roll_or_pitch, _changes),
    ("rotor", _is_unseen_yaw, _changes),
    ("load", _is_vertical, _load),
    (DRIVE, _is_drive, _changes),
    (MOTION, _is_moment, _changes),
    ("height", _is_range, _height),
)
"""Endogenous part of columns (a, k) by kind, and whether a channel shows one."""


@dataclasses.dataclass(frozen=True)
class EndogenousPart:
    """Endogenous part of one column in one channel, made where it is asked for.

    Attributes
    ----------
    key : ``effect.parameter`` of the column.
    column : (m,).
    air : (m,) True for windows in the air; the part is zero elsewhere.
    channel : of the column.
    of_columns : makes the parts of columns of its kind.

    Notes
    -----
    All of them would be half as large as all columns, which a system has anyway.
    """

    key: str
    column: np.ndarray
    air: np.ndarray
    channel: _Channel
    of_columns: PartOfColumns

    @functools.cached_property
    def acts(self) -> bool:
        """Whether the column acts on the channel."""
        return bool(self.column.any())


EndogenousParts = Mapping[tuple[str, int], Mapping[str, EndogenousPart]]
"""By kind and channel, of every ``effect.parameter`` that has it there."""


def values_of(parts: Sequence[EndogenousPart]) -> np.ndarray:
    """Make endogenous parts of one kind in one channel.

    Parameters
    ----------
    parts : j of them.

    Returns
    -------
    (j, m).
    """
    any_part, x = parts[0], np.stack([p.column for p in parts]).T
    keys, air = [p.key for p in parts], any_part.air
    values = any_part.of_columns(x if air.all() else x[air], keys, any_part.channel)
    return np.ascontiguousarray(_in_all_windows(air, values).T)


def endogenous_parts(
    keys: Sequence[str],
    x: ColumnTable,
    length_s: float,
    channels: Mapping[int, str],
    instruments: FlightInstruments,
    air: np.ndarray,
    on: Collection[str] = (),
    rates_measured: bool = True,
) -> EndogenousParts:
    """Compute the endogenous parts of columns: what instruments do not explain.

    Parameters
    ----------
    keys, x : ``effect.parameter`` of every column, and the columns (m, C, K).
    length_s : support of a window.
    channels : names of the channels without gaps, by index.
    instruments : of the flight.
    air : (m,) True for windows in the air; parts are zero elsewhere.
    on : effects of the model.
    rates_measured : whether rates or attitude were logged.

    Returns
    -------
    By kind and channel, by ``effect.parameter``.

    Notes
    -----
    Shapes of one parameter are endogenous alike: its first column stands for them.
    """
    parts: dict[tuple[str, int], dict[str, EndogenousPart]] = {}
    nothing = np.zeros(x.shape[0])
    for kind, shows, part in PARTS:
        columns = _columns_of(kind, keys, on)
        for c, name in channels.items() if columns else ():
            channel = _Channel(name, instruments, length_s, rates_measured)
            if shows(channel):
                # of a force and its moment the one that acts here
                here = dict(zip(x.at[c].tolist(), x.values[c], strict=True))
                preferred = here if kind == MOTION else ()
                parts[kind, c] = {
                    key: EndogenousPart(
                        key,
                        here.get(next((k for k in ks if k in preferred), ks[0]), nothing),
                        air,
                        channel,
                        part,
                    )
                    for key, ks in columns.items()
                }
    return parts


def merge_endogenous_parts(
    earlier: EndogenousParts, new: EndogenousParts, on: Collection[str]
) -> EndogenousParts:
    """Merge endogenous parts of two sets of columns of the same windows.

    Parameters
    ----------
    earlier, new : parts; the new ones replace known ones.
    on : keys of the model's effects. With a gain near the ground on, no other such gain is
        endogenous: its moment is explained.
    """
    gain_is_on = any(map(near_ground_gain, on))
    kept = {
        at: {key: x for key, x in parts.items() if not (gain_is_on and near_ground_gain(key))}
        for at, parts in earlier.items()
    }
    merged = {at: {**kept.get(at, {}), **new.get(at, {})} for at in dict.fromkeys((*kept, *new))}
    return {at: parts for at, parts in merged.items() if parts}


def _in_all_windows(air: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values of the windows in the air among all of them, (m, k), zero elsewhere."""
    if air.all():
        return values
    full = np.zeros((len(air), values.shape[1]))
    full[air] = values
    return full


def _columns_of(kind: str, keys: Sequence[str], on: Collection[str]) -> dict[str, list[int]]:
    """Return the columns of every parameter of a kind, by its key."""
    # a load that may be there would take from thrust gains what they do along thrust
    if kind == "load" and "load" not in map(feedback_of, on):
        return {}
    # whatever responds to them, all of these are made of the same commands
    of_more = {DRIVE: moves_a_speed, MOTION: is_made_by_velocity}
    wanted = of_more.get(kind, lambda key: feedback_of(key) == kind)
    columns: dict[str, list[int]] = {}
    for k, key in enumerate(keys):
        if wanted(key):
            columns.setdefault(key, []).append(k)
    return columns


def _less_mean(x: np.ndarray) -> np.ndarray:
    return x - x.mean(axis=0)
