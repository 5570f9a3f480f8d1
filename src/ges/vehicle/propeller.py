"""Propellers by their trade names, and what the size alone tells of a rotor.

The static thrust coefficient of propeller practice is C_T = T / (rho n^2 D^4), n in revolutions per
second, so that T = k w^2 with k = C_T rho D^4 / (4 pi^2).
"""

from __future__ import annotations

import dataclasses
import math
import re

from ges.errors import UsageError
from ges.vehicle.file import Quantity

INCH_M = 0.0254
UNITS_M = {"in": INCH_M, '"': INCH_M, "": INCH_M, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
_SIZE = re.compile(
    r"(?P<diameter>\d+\.?\d*|\.\d+)\s*(?:x\s*(?P<pitch>\d+\.?\d*|\.\d+)\s*"
    r"(?:x\s*(?P<blades>[2-8]))?)?\s*(?P<unit>in|\"|mm|cm|m)?"
)

# Static C_T of two-blade propellers: 0.112 Hummingbird 8 in (RotorPy; GRASP says the same), 0.103
# on the bench of the appius quadrotor, 0.135 Crazyflie 2.1 (IMRCLab bench), 0.140 its brushless
# sister (drone-models).
TWO_BLADES_CT = 0.115
CT_SD_REL = 0.2
# A third blade adds solidity: C_T = (sigma a / 2)(theta / 3 - lambda / 2) gives 1.31 at a pitch of
# 0.45 diameters (blade element and momentum theory, Leishman 2006, section 3.3).
A_BLADE_MORE = 1.31


@dataclasses.dataclass(frozen=True)
class Propeller:
    """A propeller as it is sold.

    Attributes
    ----------
    diameter_m : over the tips.
    blades : how many.
    """

    diameter_m: float
    blades: int = 2

    @classmethod
    def parse(cls, size: str) -> Propeller:
        """Read ``10in``, ``10x4.5``, ``5x4.3x3`` (diameter x pitch x blades, inches), ``254mm`` or
        ``0.254m``.

        The pitch is read and not used: at a standstill families of blades differ by more than their
        pitches do.

        Raises
        ------
        UsageError
            When it is no size, or none between 2 cm and 2 m.
        """
        match = _SIZE.fullmatch(size.strip().lower())
        if not match:
            raise UsageError(
                f"propeller '{size}' is no size; write the diameter as in 10in, 10x4.5, 5x4.3x3"
                " (inches) or 0.254m"
            )
        unit = match["unit"] or ""
        diameter_m = float(match["diameter"]) * UNITS_M[unit]
        if not 0.02 <= diameter_m <= 2.0:
            raise UsageError(
                f"propeller '{size}' is {diameter_m:.3g} m wide; allowed is 0.02 to 2 m, and a"
                " number without a unit counts inches"
            )
        return cls(diameter_m, int(match["blades"] or 2))

    @property
    def radius_m(self) -> float:
        """Half the diameter."""
        return 0.5 * self.diameter_m

    def __str__(self) -> str:
        more = f", {self.blades} blades" if self.blades > 2 else ""
        return f"{self.diameter_m / INCH_M:.3g} in{more}"


def length_m(text: str) -> float:
    """Read a length such as ``500mm``, ``0.5m`` or ``20in``; a plain number counts metres.

    Raises
    ------
    UsageError
        When it is no length, or none between 2 cm and 5 m.
    """
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*(mm|cm|in|m|\"|)", text.strip().lower())
    metres = float(match[1]) * (UNITS_M[match[2]] if match[2] else 1.0) if match else math.nan
    if not 0.02 <= metres <= 5.0:
        raise UsageError(f"'{text}' is no length from 0.02 to 5 m; write it as in 500mm or 0.5m")
    return metres


def thrust_coefficient(propeller: Propeller, rho_kg_m3: float) -> Quantity:
    """Thrust over squared rotor speed (N s^2) that propellers of this size have.

    Parameters
    ----------
    propeller : size and number of blades.
    rho_kg_m3 : density of the air.

    Returns
    -------
    Quantity
        k = C_T rho D^4 / (4 pi^2) with the spread of published coefficients as its sd.
    """
    # a power law in the number of blades through two and three of them
    ct = TWO_BLADES_CT * A_BLADE_MORE ** (math.log2(propeller.blades / 2) / math.log2(1.5))
    value = ct * rho_kg_m3 * propeller.diameter_m**4 / (4.0 * math.pi**2)
    return Quantity(value=value, sd=CT_SD_REL * value)


def thrust_curve(propeller: Propeller) -> Quantity:
    """Linear share c in T = T_max ((1 - c) u^2 + c u) of a common speed controller.

    ArduPilot's default exponent, 1 - c = 0.65, was chosen from about a hundred measured propellers;
    its author puts 5 in at 0.5 and 30 in at 0.8 (L. Hall, discuss.ardupilot.org, topic 26172).
    """
    inches = propeller.diameter_m / INCH_M
    exponent = 0.5 + 0.3 * (min(max(inches, 5.0), 30.0) - 5.0) / 25.0
    return Quantity(value=1.0 - exponent, sd=0.2)
