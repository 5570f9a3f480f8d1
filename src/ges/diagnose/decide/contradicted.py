"""Nominal parameters that the flights contradict: the user's prior sd is a statement, too."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping

from ges.diagnose.decide.rules import SIGNIFICANT
from ges.diagnose.design.system import System
from ges.diagnose.estimate.joint import JointFit
from ges.diagnose.select.evidence import rms_of
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import DecisionLog
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model
from ges.simulator import effects as effect_table


def corrected_numbers(key: str) -> str:
    """Return the numbers of the vehicle file that a key corrects.

    Parameters
    ----------
    key : ``effect.parameter``.

    Returns
    -------
    ``mass_kg or ...``; the key itself where it corrects none.
    """
    return " or ".join(_corrected(key)) or key


def _corrected(key: str) -> tuple[str, ...]:
    effect, parameter = ParameterKey.of(key)
    return (parameter,) if key == SPEED else effect_table.get(effect).parameter(parameter).corrects


@dataclasses.dataclass(frozen=True)
class Contradicted:
    """A nominal parameter that the flights contradict.

    Attributes
    ----------
    key : ``effect.parameter`` of its correction.
    value, sd : of the correction, in the parameter's unit.
    declared_sd : prior sd of the file, with what the recording adds.
    share : correction over the nominal value, where it is not relative already.
    """

    key: str
    value: float
    sd: float
    declared_sd: float
    share: float

    @property
    def effect(self) -> str:
        """The effect that corrects it; ``vehicle`` for a number that none corrects."""
        return ParameterKey.of(self.key).effect

    @property
    def is_trim(self) -> bool:
        """Whether it is a trim of a calibrated file, and no number of the vehicle."""
        return self.key != SPEED and corrected_numbers(self.key) == self.key

    @property
    def sds(self) -> float:
        """Distance from the nominal value, in prior sds."""
        return abs(self.value) / self.declared_sd

    def sentence(self) -> str:
        """Return what is wrong, and by how much."""
        if self.is_trim:
            return (
                f"The vehicle has changed since its file was made: {self.key} moved by"
                f" {self.sds:.1f} times the sd that the file has of it, and what did it is open."
            )
        return (
            f"The vehicle file is wrong about {corrected_numbers(self.key)}: these flights"
            f" need {self._needed()}, {self.sds:.1f} times its prior sd."
        )

    def _needed(self) -> str:
        """Return the change of each number that would do."""
        numbers = _corrected(self.key)
        if len(numbers) == 1:
            return f"{100.0 * self.share:+.0f} %"
        # flights tell thrust over mass, so that more of the one is less of the other
        of_mass = 1.0 / (1.0 + self.share) - 1.0
        shares = {n: of_mass if n == "mass_kg" else self.share for n in numbers}
        return " or ".join(f"{100.0 * share:+.0f} % of {n}" for n, share in shares.items())


def excused_effects(open_names: Collection[str], record: DecisionLog) -> set[str]:
    """Return effects whose nominal parameters no contradiction is reported for.

    An open cause may move the numbers that it is confused with. And an effect that
    :func:`ges.diagnose.decide.rules.significant` rejected must not come back as an error of the
    file.

    Parameters
    ----------
    open_names : names that are open, and effects that they can move.
    record : of all decisions.
    """
    rejected = {
        name
        for name in record.names
        for d in record.of(name)
        if d.rule == SIGNIFICANT and not d.passed
    }
    return {*open_names, *rejected}


def contradicted_parameters(
    joint: JointFit, system: System, but: Collection[str] = ()
) -> list[Contradicted]:
    """Return nominal parameters and calibrated trims that a fit moves certainly beyond their prior.

    Parameters
    ----------
    joint : of the last fit, corrections counted from the vehicle file.
    system : of the vehicle file, with its priors.
    but : effects whose numbers other causes can move that these flights cannot separate.

    Returns
    -------
    The farthest first. A correction below the practical significance threshold does not count. Nor
    does one of an effect that stands at a bound of the library: something else is behind that.
    """
    at_bound = {
        ParameterKey.of(key).effect
        for key, value in joint.common.items()
        if _stands_at_bound(key, value, system.model)
    }
    model, share = system.model, rms_of(system) / system.least_rms[:, None]
    # with what the recording adds to the file's own sd, as how long a command was held
    prior_sds = {
        key: sd
        for key in joint.common
        if key in model.prior_sds
        and (sd := system.prior_sd(key))
        and ParameterKey.of(key).effect not in {*but, *at_bound}
    }
    contradicted = [
        Contradicted(key, value, joint.common_sd[key], sd, _relative_correction(key, value, model))
        for key, sd in prior_sds.items()
        for value in [joint.common[key]]
        # certain alone is not enough: a number known to a hair may be off by what matters nowhere
        if _number_is_beyond(key, joint.common, prior_sds)
        and abs(value) * share[:, system.nuisances[key]].max() >= 1.0
    ]
    return sorted(contradicted, key=lambda c: -c.sds)


def _number_is_beyond(
    key: str, common: Mapping[str, float], prior_sds: Mapping[str, float]
) -> bool:
    """Return whether the number that a key corrects is certainly beyond its prior.

    Several corrections of one number, as lags up and down, move it by their mean. That is as
    uncertain as each: the file has one sd for the number.
    """
    number = corrected_numbers(key)
    of_it = [k for k in prior_sds if corrected_numbers(k) == number]
    mean_sds = abs(sum(common[k] for k in of_it)) / sum(prior_sds[k] for k in of_it)
    return mean_sds > settings.statistics.certain_sds


def _stands_at_bound(key: str, value: float, model: Model) -> bool:
    """Return whether a corrected number stands at a bound of the library.

    A number that is nothing, as the lag of a fast motor, stands at none.
    """
    effect, name = ParameterKey.of(key)
    if effect == "vehicle":
        return False
    parameter = effect_table.get(effect).parameter(name)
    corrected = model.values_of(effect)[name] + value - model.corrections.get(key, 0.0)
    bounds = (parameter.low, parameter.high)
    return any(b and math.isclose(corrected, b, rel_tol=settings.numerics.small) for b in bounds)


def _relative_correction(key: str, value: float, model: Model) -> float:
    """Return a correction over the nominal value."""
    effect, parameter = ParameterKey.of(key)
    if key == SPEED:
        return value / model.number(parameter)
    parameter_of_effect = effect_table.get(effect).parameter(parameter)
    if parameter_of_effect.unit == "1" or not parameter_of_effect.corrects:
        return value
    return value / model.number(parameter_of_effect.corrects[-1])
