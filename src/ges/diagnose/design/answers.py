"""What a controller's answer to disturbances, or the noise of a reading, may have done to columns.

A controller answers turbulence, and what it moves then correlates with the disturbance that a
residual contains. Instruments explain a part of such a column; the rest is *endogenous*, and its
coefficient may err by the correlation (see ``whiten``):

- ``dynamic``: what rotor speeds and their changes make of a moment, and of thrust where commands
  alone are known. All of it is endogenous, but along thrust not the mean, which has no cause but
  the balance. A trim moment has causes of its own (a shifted centre of gravity, a weak rotor), and
  is taken out of such columns first (see :func:`untrim`).
- ``thrust_gain``: what multiplies thrust. Endogenous is what it does along thrust because thrust
changed
  fast, not because its gain did; and what changes of a cushion's moment, because attitude answers
  too.
- ``rotor``: what takes thrust from one rotor. Endogenous is what changes of its moment in roll and
  pitch, where answers to yaw show, too: what answers a roll with a weak rotor also yaws, and takes
  large changes of all speeds. Its trim counts in full.
- ``load``: what hangs below, once it is on. Endogenous is what changes fast of its pull along
thrust:
  disturbances shake the vehicle, and so it.
- ``drive``: all that moves a rotor's speed. Endogenous is what changes with it: the noise of the
  commands between two rows is in the model's speed, in the residual and in the column alike.
- ``height``: an error of a rangefinder that grows with height: the height that it is held against
  is a reading, too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import AXES
from ges.diagnose.design.instruments import (
    instruments,
    mark_of,
    own_signal,
    projected,
    strength,
)
from ges.diagnose.design.table import ColumnTable
from ges.diagnose.design.weak import Windows, blocks_of
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import SPEED, Model, block_of
from ges.simulator import effects as effect_table

VERTICAL = ("force_z", "acc_z")
ROLL_PITCH, YAW = ("moment_x", "moment_y"), "moment_z"
KINDS = ("dynamic", "thrust_gain", "rotor", "load", "height")
DRIVE = "drive"

EndogenousParts = Mapping[tuple[str, int], Mapping[str, np.ndarray]]
"""By kind and channel, of every ``effect.parameter`` that has it there, (m,)."""


def feedback_of(key: str) -> str:
    """How the controller shows in a column, by its ``effect.parameter``; 'none' in a number that no
    effect corrects.
    """
    effect = effect_table.table().get(key.split(".")[0])
    return effect.feedback if effect else "none"


def near_ground_gain(key: str) -> bool:
    """Whether a column is a thrust gain that depends on the height."""
    effect = effect_table.table().get(key.split(".")[0])
    return effect is not None and effect.feedback == "thrust_gain" and "height" in effect.needs


def moves_a_speed(key: str) -> bool:
    """Return whether a number is of a drive: of an actuator, or the top speed.

    Parameters
    ----------
    key : ``effect.parameter``.
    """
    effect = effect_table.table().get(key.split(".")[0])
    return key == SPEED or (effect is not None and effect.kind == "actuator")


def untrim(
    keys: Sequence[str],
    x: ColumnTable,
    windows: Windows,
    names: Sequence[str],
    thrust: np.ndarray,
    omega: np.ndarray,
    air: np.ndarray,
) -> None:
    """Take out of the ``dynamic`` ones of columns x (m, C, K) the trim, what is constant or goes
    with thrust (n,) in the moments, where they are in the ``air`` (m,).

    A moment that turned the vehicle is no trim, though thrust may have changed with it, as in turns
    flown again and again: the angular acceleration of the body rates ``omega`` (n, 3) is regressed
    on as well, and stays.
    """
    dynamic = np.array([feedback_of(key) == "dynamic" for key in keys], dtype=bool)
    held = np.column_stack([np.ones(len(thrust)), thrust])
    for c, name in enumerate(names):
        if block_of(name) != "moment" or not dynamic[x.at[c]].any():
            continue
        # by the channel's own test function: the average of what is held, the rate of what turned
        mean, rate = windows.functions[mark_of(name)]
        trim, turned = (mean @ held)[air], (rate @ omega[:, AXES.index(name[len("moment_")])])[air]
        at = np.ix_(air, dynamic[x.at[c]])
        regressors = np.column_stack([trim, turned])
        # both are fitted, the trim alone is taken out
        fitted = np.linalg.lstsq(regressors, x.values[c][at], rcond=None)[0]
        x.values[c][at] -= trim @ fitted[: trim.shape[1]]


@dataclasses.dataclass(frozen=True)
class FlightInstruments:
    """What instruments say of one flight by channel: instruments (m, k), thrust or moment of the
    rotors (m,), and the share of the latter that the former explain.
    """

    z: Mapping[str, np.ndarray]
    own: Mapping[str, np.ndarray]
    strong: Mapping[str, float]


def flight_instruments(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    y: np.ndarray,
    speeds: np.ndarray,
) -> FlightInstruments:
    """Of the moments, of what acts along thrust and of the drives, where residuals y (m, C) are
    known; ``speeds`` (n, rotors) are those at work.
    """
    z, own = (
        instruments(flight, windows, model, names),
        own_signal(flight, windows, model, speeds, names),
    )
    block = blocks_of([(windows, flight.t_s[0])], settings.statistics.block_s)[0]
    answered = [
        n
        for n, heard in zip(names, np.isfinite(y).all(axis=0), strict=True)
        if heard and _answered(n)
    ]
    return FlightInstruments(z, own, {n: strength(own[n], z[n], block) for n in answered})


def strengths(told: Sequence[FlightInstruments], names: Sequence[str]) -> list[dict]:
    """How strong the instruments are by channel: the share of the rotors' thrust or moment that the
    references predict, mean of the flights, and in how many flights that is enough.
    """
    heard = {n: [t.strong[n] for t in told if n in t.strong] for n in names}
    return [
        {
            "channel": n,
            "share": float(np.mean(s)),
            "flights_strong": sum(map(_is_strong, s)),
            "flights": len(s),
        }
        for n, s in heard.items()
        if s
    ]


def _is_strong(share: float) -> bool:
    """Whether instruments predict enough of a signal."""
    return share > settings.statistics.large_part


def _answered(name: str) -> bool:
    return block_of(name) in ("moment", DRIVE) or name in VERTICAL


def endogenous_parts(
    keys: Sequence[str],
    x: ColumnTable,
    length_s: float,
    heard: Mapping[int, str],
    told: FlightInstruments,
    air: np.ndarray,
    on: Collection[str] = (),
    turning_measured: bool = True,
) -> EndogenousParts:
    """Endogenous parts of columns, zero where they are not in the ``air`` (m,).

    Shapes of one parameter are endogenous alike: its first column stands for them.

    Parameters
    ----------
    keys, x : ``effect.parameter`` of every column, and the columns (m, C, K).
    heard : names of the channels that are there, by their number.
    on : effects of the model; a load that is not on would take from cushions what they do along
        thrust.
    turning_measured : whether rates or attitude were logged. Where they were not, what the faster
        test functions see of the moment in yaw turned the vehicle unseen: the noise of the commands
        is in residual and column alike (errors in variables). Its average would have spun the
        vehicle, and counts.
    """
    which = {
        kind: _first(keys, kind)
        for kind in KINDS
        if kind != "load" or "load" in map(feedback_of, on)
    }
    # whatever answers them, all of these are made of the same commands
    which[DRIVE] = [k for k in _first(keys) if moves_a_speed(keys[k])]
    parts = {kind: {c: x.of(c, at)[air] for c in heard} for kind, at in which.items()}
    # in moments a cushion is endogenous, along thrust every gain
    levels = np.array([near_ground_gain(keys[k]) for k in which["thrust_gain"]], dtype=float)
    z, own, strong = told.z, told.own, told.strong
    driven = {c: n for c, n in heard.items() if n in strong and block_of(n) == DRIVE}
    answered = {c: n for c, n in heard.items() if n in strong and c not in driven}
    # a gain's force is in proportion to thrust: one share of it is endogenous, whatever the gain
    share = {
        c: _by_thrust(own[n], z[n], strong[n], length_s)
        for c, n in answered.items()
        if n in VERTICAL
    }
    found = {
        "dynamic": {
            c: _beyond(parts["dynamic"][c], z[n], strong[n], n in VERTICAL)
            for c, n in answered.items()
        },
        "thrust_gain": {
            c: parts["thrust_gain"][c] * share[c]
            if c in share
            else levels * _centred(parts["thrust_gain"][c])
            for c, n in answered.items()
        },
        "rotor": {
            c: _beyond(parts["rotor"][c], z[n], strong[n], mean_is_told=True)
            for c, n in answered.items()
            if n.startswith(ROLL_PITCH)
        }
        | {
            c: _beyond(parts["rotor"][c], z[n], strong[n], mean_is_told=True)
            for c, n in answered.items()
            if n.startswith(YAW) and mark_of(n) and not turning_measured
        },
        "load": {
            c: _fast(parts["load"][c], z[n], strong[n], length_s)
            for c, n in answered.items()
            if "load" in parts and n in VERTICAL
        },
        DRIVE: {
            c: _beyond(parts[DRIVE][c], z[n], strong[n], mean_is_told=True)
            for c, n in driven.items()
        },
        "height": {c: _centred(parts["height"][c]) for c, n in heard.items() if n == "range"},
    }
    return {
        (kind, c): {
            keys[k]: values for k, values in zip(which[kind], _among(air, part).T, strict=True)
        }
        for kind, parts in found.items()
        if which.get(kind)
        for c, part in parts.items()
    }


def both(known: EndogenousParts, new: EndogenousParts, on: Collection[str]) -> EndogenousParts:
    """Endogenous parts of two sets of columns of the same windows, the new ones where both have
    them; beside a cushion that is ``on`` none of another: what it makes of moments is told.
    """
    taken = any(map(near_ground_gain, on))
    kept = {
        at: {key: x for key, x in parts.items() if not (taken and near_ground_gain(key))}
        for at, parts in known.items()
    }
    merged = {at: {**kept.get(at, {}), **new.get(at, {})} for at in dict.fromkeys((*kept, *new))}
    return {at: parts for at, parts in merged.items() if parts}


def _among(air: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values of the windows in the air among all of them, (m, k), zero elsewhere."""
    if air.all():
        return values
    full = np.zeros((len(air), values.shape[1]))
    full[air] = values
    return full


def _first(keys: Sequence[str], kind: str = "") -> list[int]:
    """First column of every parameter, of those of a kind where one is given."""
    # in reverse, so that the first of equal keys is the one that the dictionary keeps
    return list(
        {
            key: k
            for k, key in reversed(list(enumerate(keys)))
            if not kind or feedback_of(key) == kind
        }.values()
    )


def _centred(x: np.ndarray) -> np.ndarray:
    return x - x.mean(axis=0)


def _by_thrust(thrust: np.ndarray, z: np.ndarray, strong: float, length_s: float) -> np.ndarray:
    """Share of a gain's force that is there because instruments do not explain thrust, (m, 1)."""
    # where thrust all but vanishes, as in a drop, the share would be endless
    least = settings.prepare.descent_share * thrust.mean()
    return _fast(thrust[:, None], z, strong, length_s) / np.maximum(thrust, least)[:, None]


def _fast(x: np.ndarray, z: np.ndarray, strong: float, length_s: float) -> np.ndarray:
    """What changes fast of columns (m, k) and instruments do not explain; slow changes are no
    answers to turbulence: they are what balances a height, a climb, a load.
    """
    rest = _beyond(x, z, strong, mean_is_told=True)
    # a high pass; its width in windows, which stand half a length apart
    width = settings.design.answer_slowest_s / (0.5 * length_s)
    return rest - gaussian_filter1d(rest, width, axis=0)


def _beyond(x: np.ndarray, z: np.ndarray, strong: float, mean_is_told: bool) -> np.ndarray:
    """Columns (m, k) less what their instruments, and along thrust their means, explain."""
    rest = _centred(x) if mean_is_told else x
    return rest - projected(x, z) if _is_strong(strong) else rest
