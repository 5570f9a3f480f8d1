"""Thrust that is far from what the vehicle file says, in flights whose battery voltage was not logged.

Three things would do it: another mass or thrust coefficient, another thrust curve, another battery voltage than the file's.
Without the voltage none of them is searched (see ``hearing``), and the declared thrust takes the difference upon itself, as
far as it may be. Farther than that, one of the three is needed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from .align import Prepared
from .fit import Joint
from .hearing import LIKE_SAG, lacking
from .model import Model
from .result import Estimate, Finding, interval95
from .words import number_words

THRUST = "thrust_scale.scale"
BEYOND_SDS = 4.0
"""Declared sds beyond which thrust is not as declared: a doubt of 3 % then is 9 to 1 wrong, one of some twenty names being
needed as often as the search has it (see ``select``)."""


@dataclasses.dataclass(frozen=True)
class UntoldThrust:
    """Thrust over what the file says less one, its sd, and what is declared of it."""

    excess: Estimate
    declared_sd: float

    @property
    def rivals(self) -> tuple[str, ...]:
        """Names that these flights cannot tell apart."""
        return tuple(sorted(LIKE_SAG))

    def sentence(self) -> str:
        """How far it is off, what would do it, and how to find out."""
        low, high = self.excess.ci95
        value, half = number_words(100.0 * abs(self.excess.value), 2), number_words(50.0 * (high - low), 2)
        return (
            f"Thrust is {value} +- {half} % {'more' if low > 0 else 'less'} than the vehicle file says,"
            f" {number_words(abs(self.excess.value) / self.declared_sd, 2)} times its declared sd. Another mass or thrust"
            " coefficient (thrust_scale), another thrust curve (thrust_curve) or another battery voltage (battery_sag) would do"
            " it; where the voltage is logged (battery_V) they can be told apart."
        )

    def findings(self) -> list[Finding]:
        """The three, each as likely as the others."""
        told = {"thrust_scale": {"scale": self.excess}}
        return [Finding.of(name, 1.0 / len(self.rivals), told.get(name, {})) for name in self.rivals]


def untold_thrust(joint: Joint, model: Model, flights: Sequence[Prepared]) -> UntoldThrust | None:
    """The excess that is left beside all that was accepted, where it is far and nothing was logged to tell its cause; else None.

    Parameters
    ----------
    joint : of the last fit, declared numbers counted from the vehicle file's.
    """
    declared = model.doubts.get(THRUST, 0.0)
    value, sd = joint.common.get(THRUST, 0.0), joint.common_sd.get(THRUST, 0.0)
    heard = any(not lacking(name, flights, model) for name in LIKE_SAG)
    if heard or not declared or abs(value) < BEYOND_SDS * declared:
        return None
    return UntoldThrust(Estimate(value, interval95(value, sd), "1"), declared)
