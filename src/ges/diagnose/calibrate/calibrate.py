"""Calibration of a vehicle file on healthy reference flights.

Later flights are compared with it.

Every nominal parameter may move within its prior sd. Gains of single motors, the cant of the rotors
and the centre of gravity (trims) may move as far as small vehicles do.

Flights of one vehicle differ by more than noise, for instance by a battery put back elsewhere. So
the spread of trims is fitted too (:mod:`ges.diagnose.calibrate.trims`), and enters the sd that the
new file states.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ges.diagnose.calibrate.trims import (
    LEVERS,
    THRUST,
    TRIMS,
    Spreads,
    balance_of_flights,
    fit_spreads,
    gauge_of_trims,
    posterior_of_trims,
)
from ges.diagnose.decide.contradicted import corrected_numbers
from ges.diagnose.design.speeds import with_expected_speeds
from ges.diagnose.design.system import build
from ges.diagnose.detectors.balance import CANT, LOSSES, without_mean_balance
from ges.diagnose.estimate.joint import (
    correction_bounds,
    null_fit,
    only_in_air,
    raw_residuals,
    with_corrections,
)
from ges.diagnose.locate.regimes import regimes_of, unresolved_variances, with_known_speeds
from ges.diagnose.locate.structure import structures
from ges.diagnose.prepare.align import Prepared, no_attitude_derived
from ges.diagnose.prepare.gate import pass_gate, with_flown_voltage, with_stated_voltage
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import interval95
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model, from_vehicle
from ges.errors import GesError
from ges.recordings.recording import RecordingSet, require_drive
from ges.simulator import effects as effect_table
from ges.simulator.effects import Effect, Parameter
from ges.threads import blas_alone
from ges.vehicle.file import Estimate, Quantity, Vehicle, parse_vehicle, vehicle_content


@dataclasses.dataclass(frozen=True)
class Correction:
    """One fitted correction of a nominal parameter or trim.

    Attributes
    ----------
    value : correction; relative for ``thrust_scale``, ``inertia``, ``torque_coefficient`` and the
        motors' losses.
    sd : of the correction, from these flights alone.
    flight_sd, session_sd : spread between flights of a session, and between sessions.
    declared_sd : prior sd.
    later_sd : sd in a flight of a later session, with spreads and the small numbers of flights and
        sessions.
    """

    value: float
    sd: float
    flight_sd: float
    session_sd: float
    declared_sd: float
    later_sd: float

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the correction."""
        return interval95(self.value, self.sd)


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A calibrated vehicle file and what it was made from.

    Attributes
    ----------
    vehicle : the new file.
    numbers : corrections by ``effect.parameter``.
    spread, session_spread : of a motor's gain between flights, and between sessions; nan with one
        session, or one flight of each.
    seconds : time in the air.
    warnings : what the reader should know.
    """

    vehicle: Vehicle
    numbers: Mapping[str, Correction]
    spread: float
    session_spread: float
    seconds: float
    warnings: tuple[str, ...]

    def spread_words(self) -> str:
        """Return by how much flights and sessions differ, in words.

        Returns
        -------
        *flights differ by 1.2 %*; '' where neither is known.
        """
        levels = {"flights": self.spread, "sessions": self.session_spread}
        return " and ".join(
            f"{which} differ by {100.0 * seen:.1f} %"
            for which, seen in levels.items()
            if np.isfinite(seen)
        )


def _with_free_trims(model: Model, flights: Sequence[Prepared]) -> Model:
    """Return the model with free gains of the motors and free cant.

    In hover a shifted centre of gravity looks like gains, so it only moves within the sd of the
    file. Without rotor speeds one number turns commands into thrust.
    """
    # later entries win: what the file declares stands, the rest may move as small vehicles do
    prior_sds = {
        **dict.fromkeys(LOSSES, settings.calibrate.loss_sd),
        CANT: settings.calibrate.cant_sd_rad,
        **dict.fromkeys(LEVERS, 0.0),
        **model.prior_sds,
    }
    # thrust coefficient, curve and top speed all scale thrust per command: the first takes it up
    if _commands_alone(flights):
        prior_sds |= dict.fromkeys(
            [f"{e.name}.{p.name}" for e in _drive_effects() for p in e.parameters], 0.0
        )
        prior_sds[SPEED] = 0.0
    return dataclasses.replace(model, prior_sds=prior_sds)


def _drive_effects() -> list[Effect]:
    """Return effects of the drive that correct no number of the vehicle file."""
    return [
        e
        for e in effect_table.table().values()
        if e.kind == "actuator" and any(p.prior for p in e.parameters)
        if not any(p.corrects or p.prior and p.prior.timing for p in e.parameters)
    ]


def _commands_alone(flights: Sequence[Prepared]) -> bool:
    """Return whether thrust is known from commands alone."""
    return not any(f.has("rotor_speed") for f in flights)


def _fit_trims(
    flights: Sequence[Prepared],
    session: Sequence[int],
    model: Model,
    before: Mapping[str, Correction],
) -> tuple[dict[str, Correction], Spreads]:
    """Return gains and trims from each flight's mean balance, and their spreads.

    They spread between flights and between sessions.
    """
    shift = {key: n.value for key, n in before.items()}
    balance = balance_of_flights(build(flights, with_corrections(model, shift), []), session)
    # linearised at the last values: seen from there, the file and its prior stand at minus them
    start = -np.array([shift.get(key, 0.0) for key in balance.keys])
    spreads = fit_spreads(
        balance, start, 1.0 if _commands_alone(flights) else settings.calibrate.smaller_spread
    )
    flight_sd, session_sd = (level.pooled * balance.spread for level in spreads)
    posterior = posterior_of_trims(balance.sessions, start, balance.prior_sd, flight_sd, session_sd)
    gauge = gauge_of_trims(balance.keys, model)
    # after the gauge: what losses and thrust scale cannot separate would count in both sds
    sd = np.sqrt(np.diag(gauge @ posterior.covariance @ gauge.T))
    later = np.sqrt(sd**2 + sum((level.later_sd * balance.spread) ** 2 for level in spreads))
    values = gauge @ (posterior.mean - start)
    rows = zip(
        balance.keys, values, sd, flight_sd, session_sd, balance.prior_sd, later, strict=True
    )
    corrections = (
        (
            key,
            Correction(
                _within_flown_bounds(key, float(value), float(sd), model),
                float(sd),
                *map(float, rest),
            ),
        )
        for key, value, sd, *rest in rows
    )
    return dict(corrections), spreads


def _nominal_corrections(
    flights: Sequence[Prepared], model: Model, before: Mapping[str, Correction]
) -> dict[str, Correction]:
    """Return corrections of the nominal parameters that are no trims, from the null fit.

    Empty where an attitude was derived: its moments show the slow balance alone. The fit starts
    from the last values, and its prior stays at the file. What no file states, as a clock's delay,
    keeps its usual sd in later flights.
    """
    if not no_attitude_derived(flights):
        return {}
    last = {key: n.value for key, n in before.items()}
    # trims come from the slow balance: here they are free within their sd alone
    trim_sds = {key: n.later_sd for key, n in before.items() if key in TRIMS}
    now = dataclasses.replace(
        with_corrections(model, last),
        prior_sds={**model.prior_sds, **trim_sds},
        corrections={key: value for key, value in last.items() if key not in TRIMS},
    )
    system = build(flights, now, [])
    _, joint = null_fit(system)
    corrections = {}
    for nuisance in (
        c.nuisance for c in system.columns if c.nuisance and c.nuisance.key in joint.common
    ):
        key, sd = nuisance.key, float(joint.common_sd[nuisance.key])
        if key not in TRIMS:
            value = _within_flown_bounds(key, joint.common[key], sd, model)
            later = max(sd, _usual_sd(key, model))
            corrections[key] = Correction(value, sd, 0.0, 0.0, nuisance.sd, later)
    return corrections


def _usual_sd(key: str, model: Model) -> float:
    """Return the usual prior sd of an ``effect.parameter``.

    It is 0 where a file alone has one.
    """
    if key == SPEED:
        # gains by commands spread from flight to flight, those by rotor speeds hardly: that is the
        # drive's. A speed goes as the root of thrust, hence a half (in _usual_spread it is that of
        # a mean)
        gain_sd = settings.calibrate.spread * settings.calibrate.loss_sd
        return 0.5 * gain_sd * model.number("max_rotor_speed_rad_s")
    effect, parameter = ParameterKey.of(key)
    usual = effect_table.get(effect).parameter(parameter).prior
    return usual.sd if usual else 0.0


def _within_flown_bounds(key: str, value: float, sd: float, model: Model) -> float:
    """Return a correction clipped to the bounds that the library flies.

    Noise or the form error of a drive may exceed them. So may a number that no file states, as a
    delay below zero.

    Raises
    ------
    GesError
        For a nominal parameter or trim that is clearly beyond. A file with a part of it would blame
        the rest on physics.
    """
    (low, high), certain_sds = correction_bounds(key, model), settings.statistics.certain_sds
    near = low - certain_sds * sd <= value <= high + certain_sds * sd
    # a drive's delay: no number of the file takes the rest
    corrects_nothing = key not in TRIMS and corrected_numbers(key) == key
    if near or corrects_nothing:
        return float(np.clip(value, low, high))
    raise GesError(
        f"these flights need {key} corrected by {value:.3g}, and the simulator flies {low:.3g} to"
        f" {high:.3g}; the vehicle file is too far from the vehicle: correct"
        f" {corrected_numbers(key)} in it and calibrate again"
    )


def _fit(
    flights: Sequence[Prepared], session: Sequence[int], model: Model
) -> tuple[dict[str, Correction], Spreads]:
    """Fit trims and nominal parameters in turn until nothing moves."""
    corrections: dict[str, Correction] = {}
    for _ in range(settings.numerics.noise_rounds):
        last = corrections
        trims, spreads = _fit_trims(flights, session, model, last)
        corrections = {**trims, **_nominal_corrections(flights, model, {**last, **trims})}
        share = settings.calibrate.converged_share
        if last and all(
            abs(n.value - last[key].value) < share * n.later_sd for key, n in corrections.items()
        ):
            break
    return corrections, spreads


def _corrected_fields(vehicle: Vehicle, corrections: Mapping[str, Correction]) -> dict:
    """Return fields of the vehicle file that take corrections themselves.

    Of numbers that act as one, as mass and thrust coefficient do, the last is corrected.
    """
    update: dict = {}
    for path, corrections_of_it in _by_nominal_parameter(corrections).items():
        name, _, axis = path.partition(".")
        current = update.get(name, getattr(vehicle, name))
        parameter, first = corrections_of_it[0]
        later_sd = max(c.later_sd for _, c in corrections_of_it)
        if axis:
            corrected = getattr(current, axis) * (1.0 + first.value)
            # one relative sd serves all axes, so the largest of theirs
            sd_so_far = current.sd_rel if name in update else 0.0
            update[name] = current.model_copy(
                update={axis: corrected, "sd_rel": max(sd_so_far, later_sd)}
            )
        elif parameter.unit == "1":
            update[name] = Quantity(
                value=current.value * (1.0 + first.value), sd=abs(current.value) * first.later_sd
            )
        else:
            shift = float(np.mean([c.value for _, c in corrections_of_it]))
            update[name] = Quantity(value=current.value + shift, sd=later_sd)
        # numbers that act as one have one sd: it is in the last, and the others are exact
        update |= {
            other: Quantity(value=getattr(vehicle, other).value)
            for other in parameter.corrects[:-1]
        }
    top = vehicle.max_rotor_speed_rad_s
    if SPEED in corrections and top is not None:
        update["max_rotor_speed_rad_s"] = Quantity(
            value=top.value + corrections[SPEED].value, sd=corrections[SPEED].later_sd
        )
    return update


def _by_nominal_parameter(
    corrections: Mapping[str, Correction],
) -> dict[str, list[tuple[Parameter, Correction]]]:
    """Return the corrections of each nominal parameter, ``inertia_kg_m2.xx`` for instance."""
    by_path: dict[str, list[tuple[Parameter, Correction]]] = {}
    for effect in effect_table.table().values():
        for p in effect.parameters:
            if p.corrects and (correction := corrections.get(f"{effect.name}.{p.name}")):
                by_path.setdefault(p.corrects[-1], []).append((p, correction))
    return by_path


def _fixed_drive(vehicle: Vehicle, effects: dict[str, dict[str, Estimate]]) -> dict[str, object]:
    """Return top speed and thrust curve without an sd.

    The thrust coefficient and its sd absorb them.
    """
    curves = {
        e.name: {key: Estimate(value=q.value) for key, q in effects[e.name].items()}
        for e in _drive_effects()
        if not e.reads_voltage and effects.get(e.name)
    }
    fields: dict[str, object] = {"effects": {**effects, **curves}}
    if vehicle.max_rotor_speed_rad_s:
        fields["max_rotor_speed_rad_s"] = Quantity(value=vehicle.max_rotor_speed_rad_s.value)
    return fields


def _is_written_as_effect(key: str, correction: Correction, vehicle: Vehicle) -> bool:
    """Return whether a correction is written under ``effects``.

    Trims and what is of one motor always are; effects of the drive where stated, or beyond the
    usual.
    """
    (effect, parameter), clear_sds = ParameterKey.of(key), settings.statistics.clear_sds
    of_one_motor = effect != "vehicle" and bool(effect_table.get(effect).parameter(parameter).rotor)
    clear = abs(correction.value) > max(clear_sds * correction.later_sd, correction.declared_sd)
    known = clear or of_one_motor or effect in vehicle.effects
    of_the_drive = effect in {e.name for e in _drive_effects()}
    return key in TRIMS and key != THRUST or of_the_drive and known


def _effects_of_file(
    vehicle: Vehicle, corrections: Mapping[str, Correction]
) -> dict[str, dict[str, Estimate]]:
    """Return ``effects`` of the new file.

    The battery's place is in the spread of the gains already, so the centre of gravity has no sd.
    """
    effects = {name: dict(values) for name, values in vehicle.effects.items()}
    for key, correction in corrections.items():
        name, parameter = ParameterKey.of(key)
        if not _is_written_as_effect(key, correction, vehicle):
            continue
        parameters = effects.setdefault(name, {})
        start = (
            parameters[parameter].value
            if parameter in parameters
            else effect_table.get(name).neutral()[parameter]
        )
        value, low, high = (start + v for v in (correction.value, *correction.ci95))
        parameters[parameter] = Estimate(value=value, sd=correction.later_sd, ci95=(low, high))
    if set(LOSSES) & set(corrections):
        lever = ParameterKey.of(LEVERS[0]).effect
        still = {ParameterKey.of(key).parameter: Estimate(value=0.0) for key in LEVERS}
        effects[lever] = {**still, **effects.get(lever, {})}
    return effects


@blas_alone
def calibrate(recordings: RecordingSet, *more: RecordingSet) -> Calibration:
    """Fit a vehicle file to reference flights.

    Parameters
    ----------
    recordings, more : flights that are known to be healthy, with the vehicle file to start from.
        Every set is one session (a day, a battery put in anew), with the same vehicle file.

    Raises
    ------
    GesError
        When fewer than two flights can be used, or sessions come with different vehicle files.
    UsageError
        When the flights contradict the file so far that a corrected number is impossible, such as a
        negative mass.

    Notes
    -----
    The result has the same bytes whatever the number of cores.
    """
    sets = (recordings, *more)
    for one in sets:
        require_drive(one)
    if any(one.vehicle != recordings.vehicle for one in more):
        raise GesError(
            "the sessions have different vehicle files, and one is calibrated: import all of them"
            " with the same one"
        )
    model = from_vehicle(recordings.vehicle, recordings.folder)
    flown = [(index, f) for index, one in enumerate(sets) for f in one.flights]
    gate = pass_gate([f.frame for _, f in flown], model, [f.name for _, f in flown])
    session, flights = [flown[i][0] for i in gate.flights], list(gate.flights.values())
    if len(flights) < 2:
        raise GesError(
            f"{len(flights)} usable reference flight; calibration needs two or more to see how much"
            " flights differ"
        )
    model = with_flown_voltage(model, flights)
    flights = with_expected_speeds(flights, model)
    corrections, spreads = _fit(flights, session, _with_free_trims(model, flights))
    update = _corrected_fields(recordings.vehicle, corrections) | {
        "effects": with_stated_voltage(_effects_of_file(recordings.vehicle, corrections), model)
    }
    if _commands_alone(flights):
        update |= _fixed_drive(recordings.vehicle, update["effects"])
    seconds = float(sum(f.flying.sum() * f.dt_s for f in flights))
    warnings = (
        *(w for one in sets for w in one.warnings),
        *gate.warnings,
        *_moved_warnings(corrections),
    )
    vehicle = recordings.vehicle.model_copy(update=update)
    vehicle = vehicle.model_copy(
        update={"left_unexplained": _calibrated_structure(flights, vehicle, recordings.folder)}
    )
    vehicle = parse_vehicle(vehicle_content(vehicle), "the calibrated vehicle")
    spread, between = (
        level.estimate * settings.calibrate.spread * settings.calibrate.loss_sd for level in spreads
    )
    return Calibration(vehicle, corrections, spread, between, seconds, warnings)


def _calibrated_structure(
    flights: Sequence[Prepared], vehicle: Vehicle, folder: Path
) -> dict[str, float]:
    """Return the largest structure by channel that the calibrated file leaves in its own flights.

    It is the largest of all pairs of flights, and no news in later ones.
    """
    model = with_flown_voltage(from_vehicle(vehicle, folder), flights)
    system = build(flights, model, [])
    balanced = without_mean_balance(raw_residuals(system, null_fit(system)[1]), system)
    residuals = with_known_speeds(only_in_air(balanced, system), system)
    regimes, blocks = regimes_of(system), system.blocks(settings.statistics.block_s)
    unresolved = unresolved_variances(system)
    largest: dict[str, float] = {}
    for pair in itertools.combinations(range(len(flights)), 2):
        for s in structures(
            [residuals[i] for i in pair],
            [regimes[i] for i in pair],
            system.main,
            [blocks[i] for i in pair],
            [unresolved[i] for i in pair],
        ):
            largest[s.key] = max(largest.get(s.key, 0.0), float(f"{s.rms:.3g}"))
    return largest


def _moved_warnings(corrections: Mapping[str, Correction]) -> list[str]:
    """Return a sentence for every nominal parameter that moved clearly beyond its prior sd."""
    return [
        f"{key} moved by {n.value:.3g}, {abs(n.value) / n.declared_sd:.1f} times its prior sd of"
        f" {n.declared_sd:.3g}; look at the vehicle file before you rely on it"
        for key, n in corrections.items()
        if corrected_numbers(key) != key
        and abs(n.value) > settings.statistics.clear_sds * n.declared_sd
    ]
