"""Thrust far from the vehicle file, in flights whose battery voltage was not logged.

By commands alone two causes are possible: another mass or thrust coefficient, or another battery
voltage. With rotor speeds they are another top speed of the motors, or another voltage. Without the
voltage they are not searched (see ``requirements``). Nominal thrust, or the top speed, absorbs the
difference as far as its prior allows. Beyond that one of the causes is needed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.estimate.joint import JointFit, speed_per_unit, within_bounds
from ges.diagnose.library.requirements import unmet_requirement
from ges.diagnose.prepare.channels import least_rms_in
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter, interval95
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model
from ges.diagnose.types.words import number_words
from ges.simulator import effects as effect_table

SCALE, CURVE = "thrust_scale.scale", "thrust_curve.c"
VOLTAGE = "battery_V"
# effects that move rotor speeds at the same commands
MAKE_LEVEL = ("battery_sag", ParameterKey.of(CURVE).effect)
CAUSES = {
    "thrust_scale": "another mass or thrust coefficient",
    "battery_sag": "another battery voltage",
}


@dataclasses.dataclass(frozen=True)
class UnmeasuredThrust:
    """A thrust difference whose cause was not measured.

    Attributes
    ----------
    system : of the flights.
    key : the number that absorbs it, ``effect.parameter``.
    excess : thrust or top speed relative to the file less one.
    prior_sd : of the same quantity; 0 where the file states it without one.
    rivals : names that these flights cannot separate.
    """

    system: System
    key: str
    excess: FittedParameter
    prior_sd: float
    rivals: tuple[str, ...]

    def sentence(self) -> str:
        """Return how far the thrust is off, what would explain it, and how to find out."""
        low, high = self.excess.ci95
        value = number_words(100.0 * abs(self.excess.value), 2)
        half = number_words(100.0 * 0.5 * (high - low), 2)
        listed = [f"{CAUSES[name]} ({name})" for name in CAUSES if name in self.rivals]
        *some, last = listed + ([f"another {SPEED.split('.')[1]}"] if self.key == SPEED else [])
        causes = f"{', '.join(some)} or {last}"
        kind_of_sd = "prior" if self.key in self.system.model.prior_sds else "usual"
        known = (
            f"{number_words(abs(self.excess.value) / self.prior_sd, 2)} times its {kind_of_sd} sd"
            if self.prior_sd
            else "which has no sd there"
        )
        return (
            f"{self._off(value, half)}, {known}."
            f" {causes[0].upper()}{causes[1:]} would do it; where the voltage is logged ({VOLTAGE})"
            " they can be told apart."
        )

    def _off(self, value: str, half: str) -> str:
        more = self.excess.value > 0.0
        if self.key == SCALE:
            return (
                f"Thrust is {value} +- {half} % {'more' if more else 'less'} than the vehicle file"
                " says"
            )
        return (
            f"Rotor speeds at the same commands are {value} +- {half} %"
            f" {'higher' if more else 'lower'} than the vehicle file says"
        )

    def findings(self) -> list[Finding]:
        """Return the rivals as open findings, each as probable as any cause.

        Where the top speed absorbs the excess it counts as one more cause, without a finding: no
        effect of the library is it.
        """
        effect, parameter = ParameterKey.of(self.key)
        estimates = {effect: {parameter: self.excess}}
        cause_count = len(self.rivals) + (self.key == SPEED)
        return [
            Finding.of(name, 1.0 / cause_count, estimates.get(name, {}), is_open=True)
            for name in self.rivals
        ]

    def explanations(self) -> dict[tuple[str, ...], effect_table.Effects]:
        """Return sets of names that would explain it, each with the effects by which it does.

        Notes
        -----
        The battery runs down in one of them, and its sag shows by how it grows. What it takes in
        the middle of the flight is another thrust, or another top speed.
        """
        scale = tuple(name for name in self.rivals if name == "thrust_scale")
        return {names: self._effects_of(names) for names in (scale, ("battery_sag", *scale))}

    def _effects_of(self, names: Sequence[str]) -> effect_table.Effects:
        model = self.system.model
        sags = {
            **effect_table.get("battery_sag").neutral(),
            "sensitivity": float("battery_sag" in names),
        }
        effect, parameter = ParameterKey.of(SCALE)
        # the excess counts from the file, and what the model has holds a part of it already
        present = model.effects.get(effect, {}).get(parameter, 0.0)
        of_file = present - model.corrections.get(SCALE, 0.0)
        scale = of_file + self.excess.value if effect in names else present
        return {
            "battery_sag": sags,
            effect: {parameter: within_bounds(effect, parameter, scale)},
        }


def _thrust_per_bend(model: Model) -> float:
    """Return the relative change of the thrust in hover for each unit of the curve's bend.

    T = T_max ((1 - c) u^2 + c u) changes by c (1 / u - 1) of itself.
    """
    return model.number("max_rotor_speed_rad_s") / model.hover_rad_s - 1.0


def unmeasured_causes(system: System) -> tuple[str, ...]:
    """Return causes of another thrust that flights cannot separate, for want of a voltage.

    Parameters
    ----------
    system : of the flights.

    Notes
    -----
    Scale and curve may undo each other in hover: no single one of their numbers is known.
    """
    unmet = (n for n in CAUSES if unmet_requirement(n, system.recordings, system.model))
    return tuple(sorted(unmet))


def movable_by_voltage(system: System) -> frozenset[str]:
    """Return effects whose nominal parameters a voltage that nobody logged can move.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    The causes, and ``vehicle`` for the top speed; empty where the voltage is known.
    """
    causes = unmeasured_causes(system)
    return frozenset({*causes, ParameterKey.of(SPEED).effect}) if causes else frozenset()


def unmeasured_thrust(
    joint: JointFit, system: System, named: Collection[str] = ()
) -> UnmeasuredThrust | None:
    """Find an excess of thrust whose cause was not logged.

    Parameters
    ----------
    joint : of the last fit, corrections counted from the vehicle file.
    system : of the flights.
    named : effects that are accepted.

    Returns
    -------
    The excess; None where it is within the prior sds, or the signals were logged. None beside a
    named curve, which is fitted with the thrust in hover.
    """
    if ParameterKey.of(CURVE).effect in named:
        return None
    model, flights, rivals = system.model, system.recordings, unmeasured_causes(system)
    prior_sds = {
        key: sd
        for key in system.nuisances
        if (ParameterKey.of(key).effect in rivals or rivals and key == SPEED)
        and ((sd := model.prior_sds.get(key, system.prior_sd(key))) or key == SPEED)
    }
    # a voltage of each flight's own is one of the causes: what they have in the mean counts, too
    corrections_by_key = {
        key: joint.common.get(key, 0.0) + np.array([f.get(key, 0.0) for f in joint.by_flight])
        for key in prior_sds
    }
    # commands alone show what scale and curve together make of the thrust in hover
    if SCALE in prior_sds:
        bent = _thrust_per_bend(model) * joint.common.get(CURVE, 0.0)
        corrections_by_key[SCALE] = corrections_by_key[SCALE] + bent
    if SPEED in prior_sds:
        # how batteries sagged is a number of each flight's own; a curve and another level may undo
        # each other where the flights are
        made = [k for k in system.nuisances if ParameterKey.of(k).effect in MAKE_LEVEL]
        per_unit = speed_per_unit(system, made)
        numbers = [joint.common.get(k, 0.0) + f.get(k, 0.0) for f in joint.by_flight for k in made]
        speeds = (per_unit * np.reshape(numbers, per_unit.shape)).sum(axis=1)
        corrections_by_key[SPEED] = corrections_by_key[SPEED] + np.nan_to_num(speeds)
    mean_correction = {
        key: float(corrections.mean()) for key, corrections in corrections_by_key.items()
    }
    # in sds of what was known: the number farthest off takes the difference upon itself. A top
    # speed without an sd is exact, but for what matters nowhere
    least = least_rms_in("drive", model)
    in_sds = {key: abs(mean_correction[key]) / (sd or least) for key, sd in prior_sds.items()}
    key = max(in_sds, key=lambda k: in_sds[k], default=None)
    if key is None or in_sds[key] < settings.statistics.certain_sds:
        return None
    # a top speed as a share of the file's
    unit = model.number(ParameterKey.of(SPEED).parameter) if key == SPEED else 1.0
    value = mean_correction[key] / unit
    # of these flights, and not of those to come: what they share, or how far they are apart
    apart = (
        corrections_by_key[key].std(ddof=1) / math.sqrt(len(flights)) if len(flights) > 1 else 0.0
    )
    sd = (apart or joint.common_sd[key]) / unit
    return UnmeasuredThrust(
        system,
        key,
        FittedParameter(value, interval95(value, sd), "1"),
        prior_sds[key] / unit,
        rivals,
    )
