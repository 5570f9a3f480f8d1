"""Thrust far from the vehicle file, in flights whose battery voltage was not logged.

Two causes are possible: another mass or thrust coefficient, or another battery voltage. Where rotor
speeds are logged, the first shows by itself, and another top speed is possible in its place.
Without the voltage neither is searched (see ``requirements``). Nominal thrust or top speed absorbs
the difference as far as its prior allows. Beyond that one of the causes is needed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.estimate.fit import JointFit
from ges.diagnose.library.requirements import unmet_requirement
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter, interval95
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model
from ges.diagnose.types.words import number_words
from ges.simulator import effects as effect_table

SCALE, CURVE = "thrust_scale.scale", "thrust_curve.c"
VOLTAGE = "battery_V"
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
    key : the number that absorbs it, thrust or top speed.
    excess : thrust or rotor speed in hover relative to the file less one.
    prior_sd : of the same quantity.
    rivals : names that these flights cannot separate.
    """

    system: System
    key: str
    excess: FittedParameter
    prior_sd: float
    rivals: tuple[str, ...]

    @property
    def may_move(self) -> frozenset[str]:
        """Effects whose nominal parameters the rivals can move, and the top speed."""
        return frozenset({*self.rivals, ParameterKey.of(SPEED).effect})

    def sentence(self) -> str:
        """Return how far the thrust is off, what would explain it, and how to find out."""
        low, high = self.excess.ci95
        value = number_words(100.0 * abs(self.excess.value), 2)
        half = number_words(100.0 * 0.5 * (high - low), 2)
        times = number_words(abs(self.excess.value) / self.prior_sd, 2)
        causes_named = [f"{CAUSES[name]} ({name})" for name in CAUSES if name in self.rivals]
        *some, last = causes_named + (
            [f"another {SPEED.split('.')[1]}"] if self.key == SPEED else []
        )
        causes = f"{', '.join(some)} or {last}"
        kind_of_sd = "prior" if self.key in self.system.model.prior_sds else "usual"
        return (
            f"{self._off(value, half)}, {times} times its {kind_of_sd} sd."
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
        """Return the rivals as findings, all causes equally probable."""
        effect, parameter = ParameterKey.of(self.key)
        estimates = {effect: {parameter: self.excess}}
        # another top speed is a cause, but no name
        count = len(self.rivals) + (self.key == SPEED)
        return [
            Finding.of(name, 1.0 / count, estimates.get(name, {}), is_open=True)
            for name in self.rivals
        ]

    def explanations(self) -> dict[tuple[str, ...], effect_table.Effects]:
        """Return sets of names that would explain it, each with the effects by which it does.

        Notes
        -----
        The battery runs down in all of them, and its sag shows by how it grows. What it takes in
        the middle of the flight is another thrust, or another top speed, which has no name.
        """
        scale = ("thrust_scale",) if "thrust_scale" in self.rivals else ()
        return {names: self._effects_of(names) for names in (scale, ("battery_sag", *scale))}

    def _effects_of(self, names: Sequence[str]) -> effect_table.Effects:
        model = self.system.model
        sags = {
            **effect_table.get("battery_sag").neutral(),
            "sensitivity": float("battery_sag" in names),
        }
        present = model.effects.get("thrust_scale", {}).get("scale", 0.0)
        scale = present + self.excess.value * ("thrust_scale" in names)
        return {"battery_sag": sags, "thrust_scale": {"scale": scale}}


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
    model, flights = system.model, [r.flight for r in system.flights]
    rivals = tuple(sorted(name for name in CAUSES if unmet_requirement(name, flights, model)))
    effects = {ParameterKey.of(key).effect: key for key in (SCALE, SPEED)}
    key = next((k for e, k in effects.items() if e in rivals), SPEED)
    if not rivals or key not in system.nuisances or ParameterKey.of(CURVE).effect in named:
        return None
    # a top speed as a share of the file's
    unit = model.number(ParameterKey.of(SPEED).parameter) if key == SPEED else 1.0
    sd = model.prior_sds.get(key, system.prior_sd(key)) / unit
    # a voltage of each flight's own is one of the causes: what they have in the mean counts, too
    per_unit = _in_hover(key, model)
    excess = np.array(
        [
            sum(r * (joint.common.get(k, 0.0) + own.get(k, 0.0)) for k, r in per_unit.items())
            for own in joint.by_flight
        ]
    )
    value = float(excess.mean())
    if not sd or abs(value) < settings.statistics.certain_sds * sd:
        return None
    # of these flights, and not of those to come: what they share, or how far they are apart
    apart = excess.std(ddof=1) / math.sqrt(len(flights)) if len(flights) > 1 else 0.0
    own_sd = apart or joint.common_sd[key] / unit
    return UnmeasuredThrust(
        system, key, FittedParameter(value, interval95(value, own_sd), "1"), sd, rivals
    )


def _in_hover(key: str, model: Model) -> dict[str, float]:
    """Return the relative change of thrust, or of rotor speed, in hover for a unit of each number.

    A curve changes T = (1 + s) T_max ((1 - c) u^2 + c u) by c (1 / u - 1). A speed changes by half.
    """
    top = model.number(ParameterKey.of(SPEED).parameter)
    bent = top / model.hover_rad_s - 1.0
    return {SCALE: 1.0, CURVE: bent} if key == SCALE else {SPEED: 1.0 / top, CURVE: 0.5 * bent}
