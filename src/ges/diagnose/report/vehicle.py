"""The vehicle file with what was found, which flies as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.detectors.gusts import GUSTS, Gusts
from ges.diagnose.estimate.joint import JointFit, within_bounds
from ges.diagnose.prepare.gate import with_stated_voltage
from ges.diagnose.report.laws import vehicle_laws
from ges.diagnose.types.finding import interval95
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.vehicle.file import Estimate, Quantity, Vehicle


def fitted_vehicle(
    vehicle: Vehicle,
    nominal: Model,
    accepted: Accepted,
    joint: JointFit,
    gusts: Gusts | None,
    laws: Sequence[FittedLaw],
) -> Vehicle:
    """Return the vehicle file with findings, laws and corrected numbers.

    Parameters
    ----------
    vehicle : the vehicle file.
    nominal : its model.
    accepted : names and fits.
    joint : of the last fit, corrections counted from the nominal model.
    gusts, laws : that were found.

    Notes
    -----
    Corrections of sensors stay out.
    """
    numbers: dict[str, Any] = {}
    effects = {name: dict(values) for name, values in vehicle.effects.items()}
    for key, value in joint.common.items():
        name, parameter = ParameterKey.of(key)
        if name == "vehicle":
            corrected = nominal.number(parameter) + value
            numbers[parameter] = Quantity(value=corrected, sd=joint.common_sd[key])
        elif effect_table.get(name).kind != "sensor":
            of_effect = effects.setdefault(name, {})
            neutral = effect_table.get(name).neutral()[parameter]
            start = of_effect[parameter].value if parameter in of_effect else neutral
            corrected = within_bounds(name, parameter, start + value)
            of_effect[parameter] = Estimate(value=corrected, sd=joint.common_sd[key])
    for name in accepted.modelled:
        of_effect = effects.setdefault(name, {})
        # a nominal parameter beside those that the finding freed keeps its correction
        estimates = _estimates(accepted, name)
        of_effect |= {p: e for p, e in estimates.items() if f"{name}.{p}" not in joint.common}
    if gusts:
        parameters = gusts.finding().parameters
        effects[GUSTS] = {p: Estimate(value=e.value, ci95=e.ci95) for p, e in parameters.items()}
    effects = with_stated_voltage(effects, nominal)
    flown = vehicle_laws(vehicle.laws, laws)
    return vehicle.model_copy(update={"effects": effects, "laws": flown, **numbers})


def _estimates(accepted: Accepted, name: str) -> dict[str, Estimate]:
    """Return the fitted parameters of an effect, with intervals of those that were free."""
    fitted, free = accepted.fit, {p for e, p in accepted.fit.free if e == name}
    estimates = {}
    for parameter, value in fitted.effects[name].items():
        sd = fitted.sd(name, parameter) if parameter in free else 0.0
        estimates[parameter] = Estimate(
            value=value, sd=sd, ci95=interval95(value, sd) if sd else None
        )
    return estimates
