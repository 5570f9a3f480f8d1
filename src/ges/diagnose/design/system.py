"""The linear system behind a diagnosis: residuals, nuisance columns and candidate columns of every
flight, whitened.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from ges.diagnose.design.answers import (
    EndogenousParts,
    FlightInstruments,
    both,
    endogenous_parts,
    flight_instruments,
    untrim,
)
from ges.diagnose.design.residual import (
    Along,
    Drive,
    act_along_the_path,
    along,
    drives,
    drives_of,
    said_with_each,
    with_higher_orders,
)
from ges.diagnose.design.table import ColumnTable, Indices, table_of
from ges.diagnose.design.weak import (
    Windows,
    blocks_of,
    make_windows,
)
from ges.diagnose.library.candidates import Variant
from ges.diagnose.library.requirements import needs_attitude
from ges.diagnose.prepare.align import Prepared, attitude_measured
from ges.diagnose.prepare.channels import MOMENT, channels, drive
from ges.diagnose.settings import settings
from ges.diagnose.types.model import SPEED, Model, block_of
from ges.simulator import effects as effect_table
from ges.simulator.effects import MOST_LANES, Replay
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class Nuisance:
    """A number that every hypothesis may adjust: sd over vehicles (declared doubt) and from flight
    to flight, about a mean.
    """

    effect: str
    parameter: str
    step: float
    sd: float
    flight_sd: float
    mean: float = 0.0

    @property
    def key(self) -> str:
        """``effect.parameter``."""
        return f"{self.effect}.{self.parameter}"


@dataclasses.dataclass(frozen=True)
class DesignColumn:
    """One column: a nuisance, or one amplitude of one variant of a candidate.

    ``part`` 'force' or 'moment' is a column of those channels alone, with a coefficient of its own.
    A thrust gain near the ground is split so: how much the cushions of the rotors differ, and so
    the moment, depends on how far each of them spreads. And so is what pushes the rotors sideways:
    its lever about the centre of gravity is millimetres long, and as small moments are measured far
    better than small forces, they would decide its size.
    """

    label: str
    nuisance: Nuisance | None = None
    variant: Variant | None = None
    amplitude: int = 0
    part: str = ""

    @property
    def made_of(self) -> tuple:
        """What the column is computed from: two columns with the same differ in their parts at
        most.
        """
        if self.nuisance is not None:
            return (self.nuisance,)
        v = variant_of(self)
        return v.effect, tuple(v.shape.items()), v.amplitudes[self.amplitude], repr(v.given)

    def part_of(
        self, whole: Mapping[int, np.ndarray], names: Sequence[str]
    ) -> Mapping[int, np.ndarray]:
        """This column's part of all that its coefficient changes, by channel, (m,) each."""
        if not self.part:
            return whole
        return {
            c: value
            for c, value in whole.items()
            if (block_of(names[c]) == "moment") == (self.part == "moment")
        }

    @property
    def key(self) -> str:
        """``effect.parameter``: a nuisance and a candidate with one key correct the same number."""
        if self.nuisance is not None:
            return self.nuisance.key
        v = variant_of(self)
        return f"{v.effect}.{v.amplitudes[self.amplitude].parameter}"


def variant_of(column: DesignColumn) -> Variant:
    """Of a column that is an amplitude of one.

    Raises
    ------
    TypeError : for a nuisance's column.
    """
    if column.variant is None:
        raise TypeError(f"column {column.label} is a nuisance and of no variant")
    return column.variant


def nuisance_of(column: DesignColumn) -> Nuisance:
    """Of a column that is one.

    Raises
    ------
    TypeError : for an amplitude's column.
    """
    if column.nuisance is None:
        raise TypeError(f"column {column.label} is an amplitude and no nuisance")
    return column.nuisance


@dataclasses.dataclass(frozen=True)
class FlightRows:
    """One flight: residuals ``y`` (m, C), NaN where a channel is not there, and columns ``x`` (m,
    C, K).

    Windows that are not in the ``air`` (m,) tell of the drive alone; ``beyond`` is an error of unit
    sd that its model may have where more is asked of it than in the air, (m,) by channel.
    ``endogenous`` are the parts of columns that instruments do not explain, ``instruments`` is
    what they say (see ``answers``).
    """

    flight: Prepared
    windows: Windows
    y: np.ndarray
    x: ColumnTable
    noise: np.ndarray
    endogenous: EndogenousParts
    instruments: FlightInstruments | None
    air: np.ndarray
    beyond: Mapping[int, np.ndarray]

    @property
    def follows(self) -> np.ndarray:
        """(m,) True where a window directly follows the one before."""
        # neighbours stand half a window apart; a longer step is a gap between them
        half = np.diff(self.windows.center)
        return np.r_[False, half == half.min()] if len(half) else np.zeros(len(self.windows), bool)

    def in_air(self, channels: Indices) -> np.ndarray:
        """Residuals of c channels in the air, (a, c), in the channels' units."""
        return self.y[np.ix_(self.air, np.asarray(channels, dtype=int))]

    def mean_columns(self, channels: Sequence[int], wanted: Sequence[int]) -> np.ndarray:
        """Means in the air of k wanted columns in c channels, (c, k), in the channels' units over
        those of the coefficients.
        """
        return np.stack([self.x.of(c, wanted)[self.air].mean(axis=0) for c in channels])

    def added(self, terms: Mapping[int, float], count: int) -> np.ndarray:
        """Columns times ``terms``, in the first ``count`` channels, (m, count), NaN where a channel
        is not there.
        """
        return np.where(np.isfinite(self.y[:, :count]), self.x.summed(terms, count), np.nan)


@dataclasses.dataclass(frozen=True)
class System:
    """All flights with the same channels and columns."""

    model: Model
    names: tuple[str, ...]
    columns: tuple[DesignColumn, ...]
    flights: tuple[FlightRows, ...]
    length_s: float

    @property
    def recordings(self) -> list[Prepared]:
        """The flights, without their rows."""
        return [r.flight for r in self.flights]

    @property
    def nuisances(self) -> dict[str, int]:
        """Columns of the nuisances by ``effect.parameter``."""
        return {c.key: k for k, c in enumerate(self.columns) if c.nuisance is not None}

    @property
    def main(self) -> tuple[str, ...]:
        """Channels under the plain average: what is told and drawn."""
        return tuple(name for name in self.names if "/" not in name)

    def blocks(self, length_s: float) -> list[np.ndarray]:
        """Number of the block of time of every window, (m,) by flight."""
        return blocks_of([(r.windows, r.flight.t_s[0]) for r in self.flights], length_s)


def nuisances(
    model: Model, names: Iterable[str], flights: Sequence[Prepared]
) -> tuple[Nuisance, ...]:
    """Numbers that are always free: declared doubts, trims, and what no drive and no sensor does
    exactly, as the effects' descriptors have it.

    A doubt that the vehicle file states under ``effects`` replaces the usual one. Where no attitude
    was measured, numbers that only it shows stay as declared; where rotor speeds have to be made
    from commands, the thrust curve is as doubtful as where both were logged.
    """
    present = {"any", *names, *map(block_of, names)}
    if any(not f.has("rotor_speed") for f in flights):
        present.add("command")
    voltage = all(f.has("battery") for f in flights)
    listed = [
        _nuisance(f"{effect.name}.{p.name}", p.doubt, model, flights)
        for effect in effect_table.table().values()
        if attitude_measured(flights) or not needs_attitude(effect.name)
        if not effect.modifies or effect.modifies in model.effects
        for p in effect.of_rotors(model.n_rotors)
        if p.doubt and set(p.doubt.shows_in) & present and (voltage or not p.doubt.with_voltage)
    ]
    # the top speed is a number of the vehicle: no effect's descriptor has a doubt for it
    if "drive" in present:
        sd = model.prior_sds.get(SPEED, 0.0)
        effect, _, parameter = SPEED.partition(".")
        listed.append(Nuisance(effect, parameter, step=sd, sd=sd, flight_sd=0.0))
    return tuple(n for n in listed if n.sd > 0 or n.flight_sd > 0)


def _nuisance(
    key: str, doubt: effect_table.Doubt, model: Model, flights: Sequence[Prepared]
) -> Nuisance:
    """One parameter, ``effect.parameter``, within its doubts, about where the vehicle file has
    it.
    """
    effect, _, parameter = key.partition(".")
    unit = model.arm_m if doubt.per_arm else 1.0
    sd = model.prior_sds.get(key, unit * doubt.sd)
    if sd and doubt.timing:
        # independent doubts add in squares
        sd = math.hypot(sd, _timing_sd_s(doubt.timing, model, flights))
    step = settings.statistics.clear_sds * sd if doubt.reciprocal else unit * doubt.step
    # counted from the model as it is: what was corrected already is not expected again
    mean = doubt.mean - model.corrections.get(key, 0.0)
    flight_sd = unit * doubt.flight_sd
    # a battery that nobody read is full in one flight and empty in another
    if not any(f.has("battery") or f.has("rotor_speed") for f in flights):
        flight_sd = math.hypot(flight_sd, doubt.unlogged_voltage_sd)
    return Nuisance(effect, parameter, step, sd, flight_sd, mean)


def _timing_sd_s(timing: str, model: Model, flights: Sequence[Prepared]) -> float:
    """Doubt on a drive's delay or lag beside its own: how long a command was held, or, of a lag,
    what went on between two rows of the log; and what a motor's second pole looks like (s).
    """
    row_s = max((_slowest([f], ("command",)) for f in flights), default=0.0)
    # a shape within a row is not logged: uniform over it. How late a command comes is, in the mean
    rows = (
        max(f.command_hold.sd_rows for f in flights) if timing == "delay" else 1.0 / math.sqrt(12.0)
    )
    pole = settings.design.second_pole_share * model.number("motor_time_constant_s")
    return math.hypot(rows * row_s, pole)


def _slowest(flights: Sequence[Prepared], streams: Sequence[str]) -> float:
    """Longest usual time between two values of a stream, s."""
    return max(
        (f.update_s[s] for f in flights for s in streams if np.isfinite(f.update_s.get(s, np.nan))),
        default=0.0,
    )


def window_length_s(flights: Sequence[Prepared]) -> float:
    """Support of the test functions: longer than the shortest where a stream speaks seldom."""
    slowest = _slowest(flights, ("velocity", "attitude", "gyro", "rotor_speed", "command"))
    return max(settings.design.window_shortest_s, settings.design.window_updates * slowest)


def common_channels(flights: Sequence[Prepared], model: Model) -> tuple[str, ...]:
    """Channels that at least one flight can speak about, in the order of the first flight that has
    most of them.
    """
    listed = [channels(flight, model) for flight in flights]
    return tuple(
        dict.fromkeys(name for names in sorted(listed, key=len, reverse=True) for name in names)
    )


def _stepped(
    model: Model, effect: str, values: Mapping[str, float], parameter: str, step: float
) -> tuple[dict, float]:
    """An effect with one parameter a step further, and that step: turned round where it would leave
    the effect's bounds.
    """
    known = effect_table.get(effect)
    now = {**known.neutral(), **model.effects.get(effect, {}), **values}
    p = known.parameter(parameter)
    if not p.low <= now[parameter] + step <= p.high:
        step = -step
    return {effect: {**now, parameter: now[parameter] + step}}, step


def _reference(model: Model, column: DesignColumn) -> dict:
    """Effects that must be on already for the column's shape, with the amplitude still neutral; {}
    where they do nothing.
    """
    variant = column.variant
    if variant is None or variant.effect in model.effects:
        return {}
    neutral = {**variant.given, variant.effect: variant.parameters({})}
    return neutral if drives(neutral) or variant.given else {}


def _shift(model: Model, column: DesignColumn) -> tuple[dict, float]:
    if column.nuisance is not None:
        n = column.nuisance
        return _stepped(model, n.effect, {}, n.parameter, n.step)
    variant = variant_of(column)
    a = variant.amplitudes[column.amplitude]
    values = variant.parameters({}) if variant.effect not in model.effects else {}
    stepped, step = _stepped(model, variant.effect, values, a.parameter, a.step)
    return {**variant.given, **stepped}, step


def _among(names: Sequence[str], here: Sequence[str], evaluated: Along) -> np.ndarray:
    """An evaluation of the channels of one flight among those of all flights, (m, C), NaN
    elsewhere.
    """
    told = evaluated.stack(here)
    if tuple(names) == tuple(here):
        return told
    full = np.full((len(told), len(names)), np.nan)
    full[:, [names.index(name) for name in here]] = told
    return full


@dataclasses.dataclass(frozen=True)
class _Seen:
    """One flight as the model sees it ``now``, and what a column makes of it; channels are ``here``
    among ``names``.
    """

    flight: Prepared
    windows: Windows
    model: Model
    names: Sequence[str]
    here: Sequence[str]
    now: Along
    driven: Mapping[str, Drive]
    said: Mapping[str, Replay]

    def column(self, column: DesignColumn) -> dict[int, np.ndarray]:
        """Minus the residual's change per unit of the column's coefficient, by channel, (m,) each,
        whatever its part.
        """
        # a number of the vehicle is no effect: drive, motion and replay are all made anew
        if column.nuisance is not None and column.nuisance.effect == "vehicle":
            n = column.nuisance
            other = self.model.with_number(n.parameter, self.model.number(n.parameter) + n.step)
            return self._change(
                self.now, along(self.flight, self.windows, other, self.here), n.step
            )
        shifted, step = _shift(self.model, column)
        return self._change(self._with(_reference(self.model, column)), self._with(shifted), step)

    def _with(self, effects: effect_table.Effects) -> Along:
        """The evaluation with effects added."""
        if not effects:
            return self.now
        known = repr(effects)
        return along(
            self.flight,
            self.windows,
            self.model,
            self.here,
            effects,
            self.now,
            self.driven.get(known),
            self.said.get(known),
        )

    def _change(self, before: Along, after: Along, step: float) -> dict[int, np.ndarray]:
        pairs = (
            (self.names.index(name), before.parts[name], after.parts[name]) for name in self.here
        )
        # what was taken over from the evaluation before is the same object: nothing changed there
        changes = {c: (a - b) / step for c, a, b in pairs if a is not b}
        return {c: change for c, change in changes.items() if change.any()}


def _added(model: Model, columns: Iterable[DesignColumn]) -> dict[str, dict]:
    """All that these columns add to the effects, by its name among what is known."""
    added = [
        e for c in columns if c.key != SPEED for e in (_reference(model, c), _shift(model, c)[0])
    ]
    return {repr(e): e for e in added if e}


def _driven(
    flight: Prepared, model: Model, here: Sequence[str], added: Mapping[str, dict]
) -> dict[str, Drive]:
    """Drives under what is added, flown as one batch."""
    sets = {
        name: model.with_effects(e).effects for name, e in added.items() if drives(e, model.effects)
    }
    return (
        dict(zip(sets, drives_of(flight, model, list(sets.values()), here), strict=True))
        if sets
        else {}
    )


def _said(
    flight: Prepared, model: Model, now: Along, added: Mapping[str, dict]
) -> dict[str, Replay]:
    """What the model says with what is added and remembers its path, replayed as one batch."""
    sets = {name: e for name, e in added.items() if act_along_the_path(e, model.effects)}
    return (
        dict(zip(sets, said_with_each(flight, model, now, list(sets.values())), strict=True))
        if sets
        else {}
    )


def rows(
    flight: Prepared,
    model: Model,
    names: Sequence[str],
    columns: Sequence[DesignColumn],
    length_s: float,
    known: Mapping | None = None,
    like: FlightRows | None = None,
) -> FlightRows:
    """Residuals and columns of one flight; a column is minus the residual's change per unit of its
    coefficient.

    Parameters
    ----------
    known : columns to take over, nuisances by key and others by what they are made of.
    like : of the same flight, whose instruments serve again: they hardly change with effects.
    """
    windows = make_windows(flight.t_s, flight.driven, length_s, half_waves(flight, length_s))
    air, driven = (
        windows.within(flight.flying),
        np.array([block_of(name) == "drive" for name in names]),
    )
    here = tuple(
        name
        for name in with_higher_orders(channels(flight, model), len(windows.higher_orders))
        if name in names
    )
    now = along(flight, windows, model, here)
    y = _among(names, here, now)
    # parts of one column are made of the same: computed once, and not at all where it is known
    told, made = known or {}, {c.made_of: c for c in columns}
    asked = {of: c.key if c.nuisance else of for of, c in made.items()}
    new = {of: c for of, c in made.items() if asked[of] not in told}
    # drives of all new columns are flown as one batch; what remembers its path goes as many at a
    # time as the simulator has lanes, for a replay of a long flight is large
    batched = _driven(flight, model, here, _added(model, new.values()))
    seen = _Seen(flight, windows, model, names, here, now, batched, {})
    values = {of: told[asked[of]] for of in made if of not in new}
    waiting = list(new.items())
    for first in range(0, len(waiting), MOST_LANES):
        batch = waiting[first : first + MOST_LANES]
        said = _said(flight, model, now, _added(model, (c for _, c in batch)))
        values |= {of: dataclasses.replace(seen, said=said).column(c) for of, c in batch}
    x = table_of([c.part_of(values[c.made_of], names) for c in columns], *y.shape)
    y = np.where(
        x.finite() & (air[:, None] | driven), y, np.nan
    )  # a beam that tilted a little further would see no ground
    # what is constant in a moment, or goes with this thrust, is a trim
    keys, thrust = (
        [c.key for c in columns],
        model.number("thrust_coefficient_N_s2") * (now.drive.at_work**2).sum(axis=1),
    )
    untrim(keys, x, windows, names, thrust, now.motion.omega, air)
    if like or not settings.design.instruments:
        explained_by = like.instruments if like else None
    else:
        explained_by = flight_instruments(
            flight, windows.some(air), model, names, y[air], now.drive.at_work
        )
    # endogenous parts are projected over all windows in the air: a channel with gaps has none
    heard = {c: name for c, name in enumerate(names) if np.isfinite(y[air, c]).all()}
    # of an effect that is on, the moment's part has a coefficient of its own, endogenous by itself
    apart = [
        f"{key}/{c.part}" if c.part == "moment" and variant_of(c).effect in model.effects else key
        for key, c in zip(keys, columns, strict=True)
    ]
    turning = flight.has("gyro") or "attitude" not in flight.derived
    answered = (
        endogenous_parts(
            apart, x, windows.length_s, heard, explained_by, air, model.effects, turning
        )
        if explained_by
        else {}
    )
    answered = both(like.endogenous, answered, model.effects) if like else answered
    beyond = _beyond(flight, windows, names, now.drive.commanded)
    return FlightRows(
        flight,
        windows,
        y,
        x,
        noisy(flight, windows, model, thrust),
        answered,
        explained_by,
        air,
        beyond,
    )


def residuals_with(system: System, model: Model) -> list[np.ndarray]:
    """Residuals (m, C) by flight of a system's windows and channels under another model."""

    def of(r: FlightRows) -> np.ndarray:
        here = tuple(
            name
            for name in with_higher_orders(channels(r.flight, model), len(r.windows.higher_orders))
            if name in system.names
        )
        y = _among(system.names, here, along(r.flight, r.windows, model, here))
        return np.where(np.isfinite(r.y), y, np.nan)

    return each(of, system.flights)


def _beyond(
    flight: Prepared, windows: Windows, names: Sequence[str], commanded: np.ndarray | None
) -> dict[int, np.ndarray]:
    """By channel of the drive, (m,): how far commands (n, rotors), as rotor speeds, are beyond all
    that the flight asks in the air, times the doubt on what they do there: a model is as wrong
    about that as any form.
    """
    if commanded is None or not (flight.driven & ~flight.flying).any():
        return {}
    more = settings.estimate.form_error * np.maximum(
        commanded - commanded[flight.flying].max(axis=0), 0.0
    )
    marked = {
        f"{name}{mark}": mean @ speeds
        for name, speeds in zip(drive(more.shape[1]), more.T, strict=True)
        for mark, (mean, _) in windows.functions.items()
    }
    return {
        c: marked[name] for c, name in enumerate(names) if name in marked and marked[name].any()
    }


def half_waves(flight: Prepared, length_s: float) -> int:
    """How many half-waves a test function may have before a stream cannot follow it."""
    slowest = _slowest([flight], ("gyro", "attitude", "rotor_speed", "command")) or np.inf
    # a half-wave has to span as many updates of a stream as the shortest window has to
    shortest_s = settings.design.window_updates * slowest
    return min(settings.design.half_waves_most, int(length_s / shortest_s))


def noisy(flight: Prepared, windows: Windows, model: Model, thrust: np.ndarray) -> np.ndarray:
    """Change of thrust between two readings of the rotor speeds, over weight, (m,): how much a slow
    stream may hide.
    """
    every = flight.update_s.get(
        "rotor_speed" if flight.has("rotor_speed") else "command", flight.dt_s
    )
    rate = np.abs(np.gradient(thrust, flight.dt_s)) / model.weight_N
    return windows.mean @ rate * (every if np.isfinite(every) else flight.dt_s)


def _known(system: System, flight: FlightRows, model: Model, wanted: set[tuple]) -> dict:
    """Nuisance columns of one flight by key; of the others, if computed for this very model, those
    that are ``wanted``, by what they are made of.
    """
    known: dict = {key: flight.x.alone(k) for key, k in system.nuisances.items()}
    for k, c in enumerate(system.columns) if system.model is model else ():
        if c.variant is not None and c.made_of in wanted:
            known[c.made_of] = known.get(c.made_of, {}) | flight.x.alone(k)
    return known


def _parts(effect: str, beside: Collection[str]) -> tuple[str, ...]:
    """Parts that an effect's columns come in, see :class:`DesignColumn`; the force alone, where
    what it makes of moments is free ``beside`` it.
    """
    if "own_lever" not in effect_table.get(effect).hints:
        return ("",)
    others = map(effect_table.get, beside)
    levers = {e.modifies for e in others if "lever_of_carrier" in e.hints}
    return ("force",) if effect in levers else ("force", "moment")


def build(
    flights: Sequence[Prepared],
    model: Model,
    variants: Sequence[Variant],
    like: System | None = None,
    length_s: float | None = None,
) -> System:
    """Assemble the system: nuisance columns first, then every amplitude of every variant.

    Parameters
    ----------
    like : a system of the same flights and channels: its windows, nuisance columns and
        instruments are taken over, which hardly change with effects; all of its columns where the
        model is the same.
    length_s : support of the test functions, s; of :func:`window_length_s` where not given.
    """
    main = common_channels(flights, model)
    length_s = like.length_s if like else length_s or window_length_s(flights)
    # a sine and a cosine of every half-wave
    names = with_higher_orders(main, 2 * max(half_waves(f, length_s) for f in flights))
    columns = (
        [DesignColumn(n.key, nuisance=n) for n in nuisances(model, main, flights)]
        if settings.design.declared_tolerance
        else []
    )
    for v in variants:
        # without channels of moments there is nothing to split
        parts = _parts(v.effect, {w.effect for w in variants}) if MOMENT[0] in names else ("",)
        columns += [
            DesignColumn(v.key, variant=v, amplitude=j, part=part)
            for j in range(len(v.amplitudes))
            for part in parts
        ]
    before: Sequence[FlightRows | None] = like.flights if like else [None] * len(flights)
    wanted = {c.made_of for c in columns}
    known = [_known(like, r, model, wanted) if like and r else {} for r in before]
    made = each(
        lambda f, k, r: rows(f, model, names, columns, length_s, k, r),
        flights,
        known,
        before,
    )
    return System(model, names, tuple(columns), tuple(made), length_s)
