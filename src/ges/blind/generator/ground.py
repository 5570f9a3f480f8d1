"""Terrain as a grid, and the ground's effect on the rotors by sources over a sampled patch.

Every rotor is a source whose flux meets the ground along rays of equal solid angle. The ground
answers with sources of the same flux where the rays meet it. On flat ground these are the image
rotor of Cheeseman and Bennett 1955, (R / 4z)^2. Steps, slopes and neighbour rotors need no further
law.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

HALF_SIZE_M = 8.0
SPACING_M = 0.05
NODES = int(round(2 * HALF_SIZE_M / SPACING_M)) + 1


def axis() -> np.ndarray:
    """Return the coordinates of the grid, the same in x and y.

    Returns
    -------
    (NODES,) m.
    """
    return np.linspace(-HALF_SIZE_M, HALF_SIZE_M, NODES)


def draw_terrain(kind: str, radius: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the heights of a terrain.

    Parameters
    ----------
    kind : 'flat', 'bumps' (smooth hills and dips) or 'step' (a ledge).
    radius : of the rotors (m); heights go with it.
    rng : stream of all draws.

    Returns
    -------
    (NODES, NODES) z[y, x] (m) on the grid of :func:`axis`.
    """
    x = axis()
    z = np.zeros((NODES, NODES))
    if kind == "step":
        at, height = rng.uniform(-0.8, 0.8), radius * rng.uniform(1.0, 2.0)
        z += height * (x[None, :] > at)
    if kind == "bumps":
        for _ in range(60):
            z += _bump(x, radius, rng)
    return z


def _bump(x: np.ndarray, radius: float, rng: np.random.Generator) -> np.ndarray:
    width = rng.uniform(0.25, 0.5) + 3.0 * radius
    height = radius * rng.uniform(-0.6, 0.9)
    cx, cy = rng.uniform(-6.0, 6.0, 2)
    return height * np.outer(np.exp(-(((x - cy) / width) ** 2)), np.exp(-(((x - cx) / width) ** 2)))


def height_at(grids: np.ndarray, which: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Interpolate heights bilinearly.

    Parameters
    ----------
    grids : (C, ny, nx) heights (m).
    which : number of the grid of each point; broadcasts against ``x``.
    x, y : points (m); beyond the edge they count as at it.

    Returns
    -------
    Heights (m) in the shape of ``x``.
    """
    gx = np.clip((x + HALF_SIZE_M) / SPACING_M, 0.0, NODES - 1.001)
    gy = np.clip((y + HALF_SIZE_M) / SPACING_M, 0.0, NODES - 1.001)
    ix, iy = gx.astype(np.intp), gy.astype(np.intp)
    fx, fy = gx - ix, gy - iy
    flat = grids.reshape(-1)
    base = (which * NODES + iy) * NODES + ix
    low = flat[base] * (1.0 - fx) + flat[base + 1] * fx
    high = flat[base + NODES] * (1.0 - fx) + flat[base + NODES + 1] * fx
    return low * (1.0 - fy) + high * fy


def _rays(rings: int = 5, spokes: int = 6) -> np.ndarray:
    """Return (2, P) horizontal reach per unit height of rays that carry equal flux downwards."""
    # equal steps of the cosine are equal solid angles
    cos = 1.0 - (np.arange(rings) + 0.5) / rings
    reach = np.sqrt(1.0 / cos**2 - 1.0)
    turn = 2.0 * np.pi * np.arange(spokes) / spokes + 0.4 * np.arange(rings)[:, None]
    return np.stack(
        [(reach[:, None] * np.cos(turn)).ravel(), (reach[:, None] * np.sin(turn)).ravel()]
    )


RAYS = _rays()


def image_fraction(
    rotor: np.ndarray,
    radius: np.ndarray,
    ground: Callable[[np.ndarray, np.ndarray], np.ndarray],
    sweep: np.ndarray,
) -> np.ndarray:
    """Return the upwash of the ground's sources at every rotor over its induced velocity.

    Parameters
    ----------
    rotor : (3, n_rotors, F) hubs in the world (m).
    radius : (F,) of the rotors (m).
    ground : heights (m) at points (x, y) whose last axis is F.
    sweep : (2, F) horizontal shift of the wake per unit height; zero straight below.

    Returns
    -------
    (n_rotors, F).

    References
    ----------
    On flat ground the image rotor of Cheeseman and Bennett 1955, (R / 4 z)^2.
    """
    under = rotor[2] - ground(rotor[0], rotor[1])
    reach = RAYS[:, :, None, None] + sweep[:, None, None, :]
    x = rotor[0] + under * reach[0]
    y = rotor[1] + under * reach[1]
    z = ground(x, y)
    return _upwash(rotor, radius, x, y, z)


def _upwash(
    rotor: np.ndarray, radius: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    strength = radius**2 / (4.0 * RAYS.shape[1])
    # a source closer than this would blow up as 1 / dz^2
    dz = np.maximum(rotor[2][:, None, None] - z, 0.2 * radius)
    square = (rotor[0][:, None, None] - x) ** 2 + (rotor[1][:, None, None] - y) ** 2 + dz * dz
    return strength * (dz / (square * np.sqrt(square))).sum(axis=(1, 2))


def saturate(fraction: np.ndarray, most: float = 0.75) -> np.ndarray:
    """Bound the upwash smoothly: u / (1 + u / most).

    Parameters
    ----------
    fraction : (n_rotors, F) upwash over induced velocity, not negative.
    most : share of the inflow that the ground can stop.
    """
    return fraction / (1.0 + fraction / most)
