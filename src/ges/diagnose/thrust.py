"""Thrust that is far from what the vehicle file says, in flights whose battery voltage was not logged.

Three things would do it: another mass or thrust coefficient, another thrust curve, another battery voltage than the file's.
Without the voltage none of them is searched (see ``hearing``), and the declared thrust takes the difference upon itself, as
far as it may be. Farther than that, one of the three is needed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from .. import effects as effect_table
from .candidates import flown, library
from .evidence import Board, make_board
from .fit import Joint, within_bounds
from .hearing import LIKE_SAG, lacking
from .model import Model
from .recommend import Rival, rank
from .result import Estimate, Finding, interval95
from .system import System, build
from .words import number_words

THRUST = "thrust_scale.scale"
VOLTAGE = "battery_V"
BEYOND_SDS = 4.0
"""Declared sds beyond which thrust is not as declared: a doubt of 3 % then is 9 to 1 wrong, one of some twenty names being
needed as often as the search has it (see ``select``)."""

EXPLANATIONS = (("thrust_scale",), ("thrust_curve",), ("battery_sag", "thrust_scale"))
"""What would do it; a battery's sag is known by how it grows, what it takes in the middle is another thrust."""


@dataclasses.dataclass(frozen=True)
class UntoldThrust:
    """Thrust over what the file says less one, its sd, and what is declared of it; the system of the flights."""

    system: System
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

    def next_flight(self) -> dict:
        """``next_flight`` of diagnosis.json: the manoeuvre that separates the three best once the voltage is logged."""
        system, flights = self.system, [r.flight for r in self.system.flights]
        listed = library(system.model, flown(flights))
        variants = [v for name in self.rivals if name in listed for v in listed[name].variants]
        board = make_board(build(flights, system.model, variants, like=system))
        rivals = [Rival(names, self._flown_with(names, system.model), _columns(board, names)) for names in EXPLANATIONS]
        ranked = rank(board, rivals, also_logged=(VOLTAGE,))
        return {**ranked[0].content(), "preparation": f"the battery voltage logged ({VOLTAGE})"} if ranked else {}

    def _flown_with(self, names: Sequence[str], model: Model) -> effect_table.Effects:
        """Effects by which an explanation makes the thrust that was seen; in all of them the battery runs down."""
        sags = {**effect_table.get("battery_sag").neutral(), "sensitivity": float("battery_sag" in names)}
        if "thrust_curve" in names:
            per_share = model.number("max_rotor_speed_rad_s") / model.hover_rad_s - 1.0
            return {"battery_sag": sags, "thrust_curve": {"c": within_bounds("thrust_curve", "c", self.excess.value / per_share)}}
        known = model.effects.get("thrust_scale", {}).get("scale", 0.0)
        return {"battery_sag": sags, "thrust_scale": {"scale": known + self.excess.value}}


def _columns(board: Board, names: Sequence[str]) -> tuple[int, ...]:
    """Columns of these effects on the board."""
    return tuple(k for (name, _), columns in board.by_variant().items() if name in names for k in columns)


def untold_thrust(joint: Joint, system: System) -> UntoldThrust | None:
    """The excess that is left beside all that was accepted, where it is far and nothing was logged to tell its cause; else None.

    Parameters
    ----------
    joint : of the last fit, declared numbers counted from the vehicle file's.
    """
    model, flights = system.model, [r.flight for r in system.flights]
    declared = model.doubts.get(THRUST, 0.0)
    value, sd = joint.common.get(THRUST, 0.0), joint.common_sd.get(THRUST, 0.0)
    heard = any(not lacking(name, flights, model) for name in LIKE_SAG)
    if heard or not declared or abs(value) < BEYOND_SDS * declared:
        return None
    return UntoldThrust(system, Estimate(value, interval95(value, sd), "1"), declared)
