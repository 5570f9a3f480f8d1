"""The ground under a rotor as a vortex cylinder and its image; the fountain between the wakes."""

from __future__ import annotations

import numpy as np

DISC_POINTS = ((0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 0.7), (0.0, -0.7))
WALL_JET = 1.12
FADING = 3.0
"""Radii over which a wake's vortices fade to 1/e."""


def _cylinder(height: float) -> float:
    """Return the inflow that a cylinder which ends at the ground and its image leave, on the axis.

    Rings of strength exp(-s / L) induce (1/2) (1 + s^2)^(-3/2), lengths over the radius.
    """
    from scipy.integrate import quad

    def ring(s: float) -> float:
        return 0.5 / (1.0 + s * s) ** 1.5

    # rings of the wake down to the ground, less those of its image, over a wake without end
    wake = quad(lambda s: np.exp(-s / FADING) * ring(s), 0.0, height)[0]
    image = quad(lambda s: np.exp(-(2.0 * height - s) / FADING) * ring(s), height, 2.0 * height)[0]
    free = quad(lambda s: np.exp(-s / FADING) * ring(s), 0.0, 40.0)[0]
    return (wake - image) / free


_HEIGHTS = np.geomspace(0.05, 40.0, 200)
_BLOCKED = np.array([1.0 - _cylinder(h) for h in _HEIGHTS])


def blocked_share(height_over_radius: np.ndarray) -> np.ndarray:
    """Return the share of a hovering rotor's inflow that the ground blocks in theory.

    A vortex cylinder reaches from the disc to the ground and has its image there. Vortices fade
    with age: a third is left after three radii.

    Parameters
    ----------
    height_over_radius : (4, F) of the disc above the ground.

    References
    ----------
    Knight and Hefner 1941, NACA TN 835; the diffusion after Ananthan and Leishman 2004.
    """
    height = np.clip(height_over_radius, _HEIGHTS[0], _HEIGHTS[-1])
    return np.interp(np.log(height), np.log(_HEIGHTS), _BLOCKED)


def wake_path(
    height: np.ndarray, edge: np.ndarray, induced: np.ndarray, sweep: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the way of a skewed wake to the ground.

    Parameters
    ----------
    height : (4, F) of the disc above the ground (m).
    edge, induced : (F,) edgewise and induced speed (m/s).
    sweep : (F,) factor on the edgewise speed.

    Returns
    -------
    Length of the way (m), (4, F), and cosine of the skew, (F,).

    References
    ----------
    Heyson 1960, NASA TR R-71: images lie along the wake.
    """
    cosine = induced / np.sqrt(induced**2 + (sweep * edge) ** 2)
    return height / np.maximum(cosine, 0.1), cosine


def fountain_share(height: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Return the fountain's lift over its peak.

    Wall jets that spread from each rotor lose speed as r^-1.12, and need room below the body to
    turn up.

    Parameters
    ----------
    height : (F,) of the body above the ground (m).
    spacing : (F,) of the rotors (m).

    References
    ----------
    Glauert 1956, J. Fluid Mech. 1.
    """
    x = np.maximum(height, 0.0) / spacing
    shape = (1.0 + x) ** (-2.0 * WALL_JET) * -np.expm1(-3.0 * x)
    return shape / PEAK


_X = np.linspace(0.0, 4.0, 2001)
PEAK = float(np.max((1.0 + _X) ** (-2.0 * WALL_JET) * -np.expm1(-3.0 * _X)))


def levelling(tilt: np.ndarray, height: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Return the moment that levels a tilted vehicle near the ground.

    Parameters
    ----------
    tilt : (F,) sine of the tilt about the axis.
    height : (F,) of the body above the ground (m).
    spacing : (F,) of the rotors (m).

    Returns
    -------
    (F,) moment over weight times spacing, per unit of its coefficient. It dies within a span of
    height.

    References
    ----------
    Yang et al. 2025.
    """
    return -tilt / (1.0 + (np.maximum(height, 0.0) / spacing) ** 2) ** 2
