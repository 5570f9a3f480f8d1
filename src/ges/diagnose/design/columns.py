"""Columns of a system: what one is of, its prior, and what it does to a flight's residuals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from ges.diagnose.design.drives import Drive, affects_drive, fly_drives
from ges.diagnose.design.residual import (
    Evaluation,
    depend_on_path_alone,
    evaluate,
    replay_with_each,
)
from ges.diagnose.design.weak import Windows
from ges.diagnose.library.candidates import Variant, has_prerequisite
from ges.diagnose.library.requirements import needs_attitude
from ges.diagnose.prepare.align import Prepared, no_attitude_derived
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model, block_of
from ges.simulator import effects as effect_table
from ges.simulator.effects import MOST_LANES, Replay


@dataclasses.dataclass(frozen=True)
class Nuisance:
    """A nominal parameter that every hypothesis may adjust.

    Attributes
    ----------
    effect, parameter : of its correction.
    step : difference of the parameter that makes the column.
    sd : prior sd over vehicles.
    flight_sd : sd from flight to flight.
    mean : prior mean of the correction.
    given : effects that it acts through, which are not on.
    """

    effect: str
    parameter: str
    step: float
    sd: float
    flight_sd: float
    mean: float = 0.0
    given: effect_table.Effects = dataclasses.field(default_factory=dict)

    @property
    def key(self) -> str:
        """``effect.parameter``."""
        return f"{self.effect}.{self.parameter}"


@dataclasses.dataclass(frozen=True)
class DesignColumn:
    """One column: a nuisance, or one amplitude of one variant of a candidate.

    Attributes
    ----------
    label : for messages.
    nuisance : of a nuisance's column.
    variant, amplitude : of an amplitude's column, with the index of the amplitude.
    part : 'force' or 'moment' for a column of those channels alone, with a coefficient of its own.

    Notes
    -----
    A sideways force on the rotors is split into parts. Its lever about the centre of gravity is
    millimetres long. Small moments are measured far better than small forces, and would decide its
    size. So is a thrust gain near the ground in a fit. How much the gains of the rotors differ, and
    so the moment, depends on how far each of them spreads. A search tries several gains of the
    moment in place of a free one: a moment without the force is no such gain.
    """

    label: str
    nuisance: Nuisance | None = None
    variant: Variant | None = None
    amplitude: int = 0
    part: str = ""

    @property
    def recipe(self) -> tuple:
        """What the column is computed from; columns of one recipe differ in parts or gains."""
        if self.nuisance is not None:
            return (self.nuisance.key,)
        v = variant_of(self)
        return v.effect, tuple(v.shape.items()), v.amplitudes[self.amplitude], repr(v.given)

    def own_changes(
        self, changes: Mapping[int, np.ndarray], names: Sequence[str]
    ) -> Mapping[int, np.ndarray]:
        """Return the changes that belong to this column's part, moments by their gain.

        Parameters
        ----------
        changes : by channel, (m,), of all that the recipe moves.
        names : of the channels.
        """
        is_moment = {c: block_of(names[c]) == "moment" for c in changes}
        if self.part:
            wanted = self.part == "moment"
            return {c: value for c, value in changes.items() if is_moment[c] == wanted}
        gain = self.variant.moment_gain if self.variant else None
        if gain is None:
            return changes
        return {c: gain * value if is_moment[c] else value for c, value in changes.items()}

    @property
    def key(self) -> str:
        """``effect.parameter``; a nuisance and a candidate of one key correct the same number."""
        if self.nuisance is not None:
            return self.nuisance.key
        v = variant_of(self)
        return f"{v.effect}.{v.amplitudes[self.amplitude].parameter}"


def variant_of(column: DesignColumn) -> Variant:
    """Return the variant that an amplitude column belongs to.

    Parameters
    ----------
    column : of an amplitude.

    Raises
    ------
    TypeError
        For the column of a nuisance.
    """
    if column.variant is None:
        raise TypeError(f"column {column.label} is a nuisance and of no variant")
    return column.variant


def nuisance_of(column: DesignColumn) -> Nuisance:
    """Return the nuisance of a nuisance column.

    Parameters
    ----------
    column : of a nuisance.

    Raises
    ------
    TypeError
        For the column of an amplitude.
    """
    if column.nuisance is None:
        raise TypeError(f"column {column.label} is an amplitude and no nuisance")
    return column.nuisance


def nuisances(
    model: Model, names: Iterable[str], flights: Sequence[Prepared]
) -> tuple[Nuisance, ...]:
    """Return the numbers that are always free: nominal parameters, trims, sensor errors.

    Parameters
    ----------
    model : of the vehicle; prior sds of its file replace the usual ones.
    names : channels.
    flights : prepared recordings.

    Notes
    -----
    Without a measured attitude, numbers that only it shows stay nominal. Where rotor speeds have to
    be made from commands, the thrust curve is as uncertain as where both were logged.
    """
    present = {"any", *names, *map(block_of, names)}
    if any(not f.has("rotor_speed") for f in flights):
        present.add("command")
    voltage = all(f.has("battery") for f in flights)
    listed = [
        nuisance_with_prior(f"{effect.name}.{p.name}", p.prior, model, flights)
        for effect in effect_table.table().values()
        if no_attitude_derived(flights) or not needs_attitude(effect.name)
        if not effect.modifies or effect.modifies in model.effects
        for p in effect.of_rotors(model.n_rotors)
        if p.prior and set(p.prior.shows_in) & present and (voltage or not p.prior.with_voltage)
    ]
    # the top speed is a number of the vehicle: no effect's descriptor has a prior for it
    if "drive" in present:
        listed.append(_top_speed(model, flights))
    for key, sd in model.flight_sds.items():
        effect, parameter = ParameterKey.of(key)
        given = {} if has_prerequisite(effect, model.effects) else model.act_through
        listed.append(Nuisance(effect, parameter, step=sd, sd=sd, flight_sd=sd, given=given))
    return tuple(n for n in listed if n.sd > 0 or n.flight_sd > 0)


def _top_speed(model: Model, flights: Sequence[Prepared]) -> Nuisance:
    """Return the top speed, which a battery that nobody read moves in each flight."""
    (effect, parameter), sd = ParameterKey.of(SPEED), model.prior_sds.get(SPEED, 0.0)
    half = 0.0
    if not any(f.has("battery") for f in flights):
        of_thrust = max(
            p.prior.unlogged_voltage_sd
            for e in effect_table.table().values()
            for p in e.parameters
            if p.prior and p.trim == "thrust"
        )
        # a speed goes as the root of thrust; by half of the variance flights of a day are alike
        half = 0.5 * of_thrust * model.number(parameter) / math.sqrt(2.0)
    # counted from the model as it is, as every correction
    mean = -model.corrections.get(SPEED, 0.0)
    return Nuisance(effect, parameter, sd or half, math.hypot(sd, half), half, mean)


def nuisance_with_prior(
    key: str, prior: effect_table.ParameterPrior, model: Model, flights: Sequence[Prepared]
) -> Nuisance:
    """Return one parameter with its priors, centred on the vehicle file.

    Parameters
    ----------
    key : ``effect.parameter``.
    prior : of the descriptor.
    model : of the vehicle; prior sds of its file replace the usual ones.
    flights : prepared recordings.
    """
    effect, parameter = ParameterKey.of(key)
    unit = model.arm_m if prior.per_arm else 1.0
    sd = model.prior_sds.get(key, unit * prior.sd)
    if sd and prior.timing:
        # independent sds add in squares
        sd = math.hypot(sd, _timing_sd_s(prior.timing, model, flights))
    step = settings.statistics.clear_sds * sd if prior.reciprocal else unit * prior.step
    # counted from the model as it is: what was corrected already is not expected again
    mean = prior.mean - model.corrections.get(key, 0.0)
    flight_sd = unit * prior.flight_sd
    given = _usually_on(effect, parameter, model)
    shown = ("battery",) if "drive" in prior.shows_in else ("battery", "rotor_speed")
    if not any(f.has(stream) for f in flights for stream in shown):
        # a battery that nobody read is full in one flight and empty in another, by half of the
        # variance: flights of a day begin alike. How it sags is no number of the vehicle
        common = 0.0 if given else prior.unlogged_voltage_sd / math.sqrt(2.0)
        own = math.sqrt(prior.unlogged_voltage_sd**2 - common**2)
        sd, flight_sd = math.hypot(sd, common), math.hypot(flight_sd, own)
    return Nuisance(effect, parameter, step, sd, flight_sd, mean, given)


def _usually_on(effect: str, parameter: str, model: Model) -> effect_table.Effects:
    """Return the effect at its usual size, for a number that says how it acts where it is off."""
    descriptor = effect_table.get(effect)
    if parameter in descriptor.amplitudes or effect in model.effects:
        return {}
    usual = {name: descriptor.parameter(name).default for name in descriptor.amplitudes}
    return {effect: {**descriptor.neutral(), **usual}}


def _timing_sd_s(timing: str, model: Model, flights: Sequence[Prepared]) -> float:
    """Return further sd of a drive's delay or lag.

    It covers how long a command was held, or for a lag the time between two rows. A motor's second
    pole is included. Two lags a and b respond like a lag of sqrt(a^2 + b^2) and a delay of the
    rest (method of moments).

    References
    ----------
    Astrom and Hagglund 1995, *PID Controllers*, 2nd ed., section 2.4.
    """
    row_s = max((slowest_update_s([f], ("command",)) for f in flights), default=0.0)
    # how late a command comes has a bound, and so has a second pole, whose delay is largest where
    # both are alike: what goes beyond a bound is certain
    certain = settings.statistics.certain_sds
    pole = (1.0 - math.sqrt(0.5)) * model.number("motor_time_constant_s") / certain
    if timing == "delay":
        rows = max(f.command_hold.bound_rows for f in flights) / certain
    else:
        # a shape within a row is not logged: uniform over it
        rows = 1.0 / math.sqrt(12.0)
    return math.hypot(rows * row_s, pole)


def slowest_update_s(flights: Sequence[Prepared], streams: Sequence[str]) -> float:
    """Return the longest usual time between two values of a stream, s.

    Parameters
    ----------
    flights : prepared recordings.
    streams : as ``gyro``; those that are not logged do not count.
    """
    return max(
        (f.update_s[s] for f in flights for s in streams if np.isfinite(f.update_s.get(s, np.nan))),
        default=0.0,
    )


def _step_parameter(
    model: Model, effect: str, values: Mapping[str, float], parameter: str, step: float
) -> tuple[dict, float]:
    """Return an effect with one parameter a step further, and that step.

    The step is reversed where it would leave the bounds. Where both ways would, it is the longest
    that does not.
    """
    values_now = {**model.values_of(effect), **values}
    now, p = values_now[parameter], effect_table.get(effect).parameter(parameter)
    within = [s for s in (step, -step) if p.low <= now + s <= p.high]
    taken = within[0] if within else max(p.low - now, p.high - now, key=abs)
    return {effect: {**values_now, parameter: now + taken}}, taken


def _reference(model: Model, column: DesignColumn) -> dict:
    """Return effects that must be on for the column's shape, with neutral amplitude.

    Empty where they do nothing.
    """
    variant = column.variant
    if variant is None:
        return dict(nuisance_of(column).given)
    if variant.effect in model.effects:
        return {}
    neutral = {**variant.given, variant.effect: variant.parameters({})}
    return neutral if affects_drive(neutral) or variant.given else {}


def _stepped_effects(model: Model, column: DesignColumn) -> tuple[dict, float]:
    if column.nuisance is not None:
        n = column.nuisance
        own = n.given.get(n.effect, {})
        stepped, step = _step_parameter(model, n.effect, own, n.parameter, n.step)
        return {**n.given, **stepped}, step
    variant = variant_of(column)
    a = variant.amplitudes[column.amplitude]
    values = variant.parameters({}) if variant.effect not in model.effects else {}
    stepped, step = _step_parameter(model, variant.effect, values, a.parameter, a.step)
    return {**variant.given, **stepped}, step


def column_parts(variant: Variant, others_present: Collection[str]) -> tuple[str, ...]:
    """Return parts of a variant's columns, see :class:`DesignColumn`.

    Parameters
    ----------
    variant : of an effect. One whose moments have a gain is whole.
    others_present : effects with columns beside it.

    Notes
    -----
    It has the force alone where another effect present makes its moment free.
    """
    effect = effect_table.get(variant.effect)
    if "own_lever" not in effect.hints or variant.moment_gain is not None:
        return ("",)
    others = map(effect_table.get, others_present)
    levers = {e.modifies for e in others if "lever_of_carrier" in e.hints}
    return ("force",) if effect.name in levers else ("force", "moment")


def evaluate_columns(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    here: Sequence[str],
    base: Evaluation,
    columns: Sequence[DesignColumn],
    drives: Mapping[str, Drive],
) -> list[dict[int, np.ndarray]]:
    """Compute the columns of one flight: minus the residual's change per unit of a coefficient.

    Parameters
    ----------
    flight, windows : of the m rows.
    model : about which the columns are linearised.
    names, here : channels of the system, and those of them that the flight has.
    base : evaluation of the model.
    columns : to compute.
    drives : of :func:`fly_drives_of_columns`.

    Returns
    -------
    Each column by the indices of the channels that it acts on, (m,).
    """

    def with_added(effects: effect_table.Effects, outputs: Mapping[str, Replay]) -> Evaluation:
        if not effects:
            return base
        key = repr(effects)
        known = drives.get(key), outputs.get(key)
        return evaluate(flight, windows, model, here, effects, base, *known)

    def changes_by(column: DesignColumn, outputs: Mapping[str, Replay]) -> dict[int, np.ndarray]:
        # a number of the vehicle is no effect: drive, motion and replay are all made anew
        if (n := column.nuisance) is not None and n.effect == "vehicle":
            other = model.with_number(n.parameter, model.number(n.parameter) + n.step)
            before, after, step = base, evaluate(flight, windows, other, here), n.step
        else:
            shifted, step = _stepped_effects(model, column)
            before = with_added(_reference(model, column), outputs)
            after = with_added(shifted, outputs)
        pairs = ((names.index(c), before.residuals[c], after.residuals[c]) for c in here)
        # what was taken over from the evaluation before is the same object: nothing changed there
        changes = {c: (a - b) / step for c, a, b in pairs if a is not b}
        return {c: change for c, change in changes.items() if change.any()}

    # what remembers its path goes as many at a time as the simulator has lanes, for a replay of a
    # long flight is large
    changes: list[dict[int, np.ndarray]] = []
    for first in range(0, len(columns), MOST_LANES):
        batch = columns[first : first + MOST_LANES]
        outputs = _replay_additions(flight, model, base, batch)
        changes += [changes_by(column, outputs) for column in batch]
    return changes


def _additions(model: Model, columns: Iterable[DesignColumn]) -> dict[str, dict]:
    """Return all that these columns add to the effects, by its text."""
    added = [
        e
        for c in columns
        if c.key != SPEED
        for e in (_reference(model, c), _stepped_effects(model, c)[0])
    ]
    return {repr(e): e for e in added if e}


def fly_drives_of_columns(
    flight: Prepared,
    model: Model,
    here: Sequence[str],
    columns: Sequence[DesignColumn],
    drive: Drive | None,
) -> tuple[Drive, dict[str, Drive]]:
    """Fly the drive of a model and of all that its columns add, as one batch.

    Parameters
    ----------
    flight, model : whose commands are flown.
    here : channels of the flight.
    columns : to compute.
    drive : of the model, where it is known.

    Returns
    -------
    The model's drive, and those under additions by their text.
    """
    sets = {
        text: model.with_effects(e).effects
        for text, e in _additions(model, columns).items()
        if affects_drive(e, model.effects)
    }
    flown = [] if drive else [model.effects]
    drives = fly_drives(flight, model, [*flown, *sets.values()], here) if flown or sets else []
    if drive is None:
        drive, *drives = drives
    return drive, dict(zip(sets, drives, strict=True))


def _replay_additions(
    flight: Prepared, model: Model, base: Evaluation, columns: Iterable[DesignColumn]
) -> dict[str, Replay]:
    """Return model output under additions with memory of the path, replayed as one batch."""
    additions = _additions(model, columns).items()
    sets = {text: e for text, e in additions if depend_on_path_alone(e, model.effects)}
    outputs = replay_with_each(flight, model, base, list(sets.values())) if sets else []
    return dict(zip(sets, outputs, strict=True))
