"""Declared numbers that the flights contradict: the user's own doubt is a statement, too."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from ges.diagnose.decide.sizes import least_sizes
from ges.diagnose.design.system import System, nuisance_of
from ges.diagnose.estimate.fit import JointFit
from ges.diagnose.select.evidence import rms_of
from ges.diagnose.settings import settings
from ges.diagnose.types.model import SPEED, Model
from ges.simulator import effects as effect_table


def words_of(key: str) -> str:
    """The numbers of the vehicle file that an ``effect.parameter`` corrects: ``mass_kg or ...``;
    itself where it corrects none.
    """
    effect, parameter = key.split(".")
    if key == SPEED:
        return parameter
    return " or ".join(effect_table.get(effect).parameter(parameter).corrects) or key


@dataclasses.dataclass(frozen=True)
class Contradicted:
    """One declared number: its correction with sd, in the unit of its ``effect.parameter``, its
    doubt (the declared sd with what the recording adds), and the correction over the declared value
    where it is no share already.
    """

    key: str
    value: float
    sd: float
    declared_sd: float
    share: float

    @property
    def effect(self) -> str:
        """The effect that corrects it; ``vehicle`` for a number that none corrects."""
        return self.key.split(".")[0]

    @property
    def is_trim(self) -> bool:
        """Whether it is no number of the vehicle, but a trim that its file was calibrated with."""
        return not _is_declared(self.key)

    @property
    def sds(self) -> float:
        """Distance from what is declared, in declared sds."""
        return abs(self.value) / self.declared_sd

    def sentence(self) -> str:
        """What is wrong, by how much, against which doubt."""
        if self.is_trim:
            return (
                f"The vehicle has changed since its file was made: {self.key} moved by"
                f" {self.sds:.1f} times the sd that the file has of it, and what did it is open."
            )
        return (
            f"The vehicle file is wrong about {words_of(self.key)}: these flights need"
            f" {100.0 * self.share:+.0f} %, {self.sds:.1f} times its doubt."
        )


def contradicted(joint: JointFit, system: System, but: Collection[str] = ()) -> list[Contradicted]:
    """Declared numbers, and trims that the file was calibrated with, that a fit moves beyond
    doubt, and by more than what no model is right to, the farthest first.

    Parameters
    ----------
    joint : of the last fit, corrections counted from the vehicle file.
    system : of the vehicle file, with its doubts.
    but : effects whose numbers other causes can move that these flights cannot tell apart.
    """
    model, share = system.model, rms_of(system) / least_sizes(system)[:, None]
    found = [
        Contradicted(key, value, joint.common_sd[key], sd, _share(key, value, model))
        for key, value in joint.common.items()
        # with what the recording adds to the file's own doubt, as how long a command was held
        if key in model.prior_sds
        and (sd := nuisance_of(system.columns[system.nuisances[key]]).sd)
        and key.split(".")[0] not in but
        # certain alone is not enough: a number known to a hair may be off by what matters nowhere
        and abs(value) > settings.statistics.certain_sds * sd
        and abs(value) * share[:, system.nuisances[key]].max() >= 1.0
    ]
    return sorted(found, key=lambda c: -c.sds)


def _is_declared(key: str) -> bool:
    """Whether an ``effect.parameter`` corrects a number of the vehicle file."""
    return key == SPEED or words_of(key) != key


def _share(key: str, value: float, model: Model) -> float:
    """A correction over the declared value."""
    effect, parameter = key.split(".")
    if key == SPEED:
        return value / model.number(parameter)
    known = effect_table.get(effect).parameter(parameter)
    if known.unit == "1" or not known.corrects:
        return value
    return value / model.number(known.corrects[-1])
