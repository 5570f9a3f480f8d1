"""Weak form: averages with smooth test functions, so that nothing is differentiated.

For a test function phi with compact support, integral(phi x') = -integral(phi' x). The derivative
moves from the noisy signal to the known function (Messenger & Bortz 2021, weak SINDy).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from ges.diagnose.settings import settings


@dataclasses.dataclass(frozen=True)
class Windows:
    """Test functions along one flight.

    Attributes
    ----------
    center_s : (m,) centres, on the recording's clock.
    center : (m,) rows of the centres on the grid.
    mean : (m, n) weights of the average, each row sums to 1.
    rate : (m, n) weights that give the average of the time derivative.
    length_s : support of each function.
    higher_orders : weights and rate weights (m, n) of :func:`higher_order_functions` on the same
        supports.
    """

    center_s: np.ndarray
    center: np.ndarray
    mean: csr_array
    rate: csr_array
    length_s: float
    higher_orders: tuple[tuple[csr_array, csr_array], ...] = ()

    @property
    def functions(self) -> dict[str, tuple[csr_array, csr_array]]:
        """Weights and rate weights of every test function, by the mark on a channel's name."""
        return {
            "": (self.mean, self.rate),
            **{f"/{k}": pair for k, pair in enumerate(self.higher_orders, 1)},
        }

    def __len__(self) -> int:
        return len(self.center)

    @property
    def half(self) -> int:
        """Samples from the centre of a function to its end, and from one centre to the next."""
        # every row of the weights keeps its whole support, 2 half + 1 entries
        return (self.mean.indptr[1] - 1) // 2 if len(self) else 0

    def within(self, allowed: np.ndarray) -> np.ndarray:
        """Return the windows whose whole support is allowed.

        Parameters
        ----------
        allowed : (n,) samples.

        Returns
        -------
        (m,) True where all samples of the support are.
        """
        return all_allowed(allowed, self.center - self.half, self.center + self.half + 1)

    def select(self, which: np.ndarray) -> Windows:
        """Return some of the windows.

        Parameters
        ----------
        which : (m,) True for those to keep.
        """
        if which.all():
            return self
        faster = tuple((a[which], b[which]) for a, b in self.higher_orders)
        return Windows(
            self.center_s[which],
            self.center[which],
            self.mean[which],
            self.rate[which],
            self.length_s,
            faster,
        )


def all_allowed(allowed: np.ndarray, first: np.ndarray, past: np.ndarray) -> np.ndarray:
    """Return whether all samples of each interval are allowed.

    Parameters
    ----------
    allowed : (n,) samples.
    first, past : (m,) first sample of each interval, and one past its last.

    Returns
    -------
    (m,).
    """
    # samples not allowed before each: as many at both ends means none between
    out = np.r_[0, np.cumsum(~allowed)]
    return out[past] == out[first]


def blocks_of(flights: Sequence[tuple[Windows, float]], length_s: float) -> list[np.ndarray]:
    """Count the blocks of time of every window; no two flights share a block.

    Parameters
    ----------
    flights : windows, and the first time of the flight's clock (s).
    length_s : length of a block.

    Returns
    -------
    By flight, (m,).
    """
    blocks, first = [], 0
    for windows, start_s in flights:
        block = ((windows.center_s - start_s) // length_s).astype(int) + first
        blocks.append(block)
        first = int(block.max(initial=first)) + 1
    return blocks


def block_windows(spacing_s: float) -> int:
    """Return the number of windows in a block of time.

    Parameters
    ----------
    spacing_s : of the windows.
    """
    return max(1, int(round(settings.statistics.block_s / spacing_s)))


def bump(half: int, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the plain test function (1 - s^2)^3 and minus its derivative.

    Parameters
    ----------
    half : samples from the centre to the end.
    step_s : spacing of the samples.

    Returns
    -------
    Weights (2 half + 1,), and rate weights (2 half + 1,) in 1/s; exact for constants and ramps.
    """
    s, phi, slope = _bump(half)
    return phi / phi.sum(), slope / (slope @ (s * (half + 1.0) * step_s))


def _bump(half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points s in (-1, 1), (1 - s^2)^3, and minus its derivative."""
    s = np.arange(-half, half + 1) / (half + 1.0)
    return s, (1.0 - s**2) ** 3, 6.0 * s * (1.0 - s**2) ** 2


def higher_order_functions(
    half: int, step_s: float, count: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return faster test functions: the bump times sines and cosines of some half-waves.

    Parameters
    ----------
    half : samples from the centre to the end.
    step_s : spacing of the samples.
    count : largest number of half-waves.

    Returns
    -------
    Weights and rate weights, (2 half + 1,) each.

    Notes
    -----
    They are orthogonal to slower ones. White noise has the same size in all of them as in the
    bump's average.
    """
    s, phi, slope = _bump(half)
    functions = [np.stack([phi, slope])]
    for k in range(1, count + 1):
        c, w = np.cos(np.pi * k * s), np.sin(np.pi * k * s)
        # to each function minus its derivative, by the product rule
        functions += [
            np.stack([phi * w, slope * w - np.pi * k * phi * c]),
            np.stack([phi * c, slope * c + np.pi * k * phi * w]),
        ]
    # Gram-Schmidt on the functions; derivatives take part, being linear in them
    for i, pair in enumerate(functions):
        for other in functions[:i]:
            pair = pair - (pair[0] @ other[0]) * other
        functions[i] = pair / np.linalg.norm(pair[0])
    size, reach_s = np.linalg.norm(phi) / phi.sum(), (half + 1.0) * step_s
    return [(size * pair[0], size * pair[1] / reach_s) for pair in functions[1:]]


def make_windows(
    t_s: np.ndarray, flying: np.ndarray, length_s: float, higher_orders: int = 0
) -> Windows:
    """Make half-overlapping windows whose whole support flies.

    Parameters
    ----------
    t_s : (n,) uniform times.
    flying : (n,) usable samples.
    length_s : support of a test function.
    higher_orders : largest number of half-waves of the faster test functions.
    """
    step_s = t_s[1] - t_s[0]
    half = max(int(round(0.5 * length_s / step_s)), 2)
    centers = np.arange(half, len(t_s) - half, half)
    centers = centers[all_allowed(flying, centers - half, centers + half + 1)]
    phi, slope = bump(half, step_s)
    # all rows have the same weights, each at its centre: a band matrix in compressed rows, whose
    # places all functions share
    columns = (centers[:, None] + np.arange(-half, half + 1)).ravel().astype(np.int32)
    starts = (np.arange(len(centers) + 1) * (2 * half + 1)).astype(np.int32)

    def spread(weights: np.ndarray) -> csr_array:
        return csr_array(
            (np.tile(weights, len(centers)), columns, starts), shape=(len(centers), len(t_s))
        )

    faster = tuple(
        (spread(a), spread(b)) for a, b in higher_order_functions(half, step_s, higher_orders)
    )
    return Windows(
        t_s[centers], centers, spread(phi), spread(slope), (2 * half + 1) * step_s, faster
    )
