"""Propellers by their trade names, and what the size alone tells of a rotor.

The static thrust coefficient of propellers is C_T = T / (rho n^2 D^4), with n in revolutions per
second. So T = k w^2 with k = C_T rho D^4 / (4 pi^2).
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
    blades : number of blades.
    """

    diameter_m: float
    blades: int = 2

    @classmethod
    def parse(cls, size: str) -> Propeller:
        """Read the size of a propeller.

        Parameters
        ----------
        size : ``10in``, ``10x4.5``, ``5x4.3x3`` (diameter x pitch x blades, inches), ``254mm`` or
            ``0.254m``. The pitch is not used: families of blades differ by more than their pitches
            do.

        Returns
        -------
        The propeller, of two blades unless stated.

        Raises
        ------
        UsageError
            When it is no size, or none between 2 cm and 2 m.

        Examples
        --------
        >>> Propeller.parse("5x4.3x3")
        Propeller(diameter_m=0.127, blades=3)
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


def thrust_coefficient(propeller: Propeller, rho_kg_m3: float) -> Quantity:
    """Estimate the thrust coefficient from the size of a propeller.

    Parameters
    ----------
    propeller : size and number of blades.
    rho_kg_m3 : density of the air.

    Returns
    -------
    k = C_T rho D^4 / (4 pi^2) in N s^2; its sd is the spread of published propellers, 20 %.

    References
    ----------
    Leishman, Principles of Helicopter Aerodynamics, 2006, section 3.3, for the number of blades.
    """
    # a power law in the number of blades through two and three of them
    ct = TWO_BLADES_CT * A_BLADE_MORE ** (math.log2(propeller.blades / 2) / math.log2(1.5))
    value = ct * rho_kg_m3 * propeller.diameter_m**4 / (4.0 * math.pi**2)
    return Quantity(value=value, sd=CT_SD_REL * value)


def thrust_curve(propeller: Propeller) -> Quantity:
    """Estimate the linear share of thrust over command from the size of a propeller.

    Parameters
    ----------
    propeller : its diameter is used.

    Returns
    -------
    c in T = T_max ((1 - c) u^2 + c u) for commands u from 0 to 1, with an sd of 0.2.

    Notes
    -----
    1 - c is 0.5 at 5 in and 0.8 at 30 in, linear between and constant outside.

    References
    ----------
    L. Hall, discuss.ardupilot.org, topic 26172: about a hundred measured propellers.
    """
    inches = propeller.diameter_m / INCH_M
    exponent = 0.5 + 0.3 * (min(max(inches, 5.0), 30.0) - 5.0) / 25.0
    return Quantity(value=1.0 - exponent, sd=0.2)
