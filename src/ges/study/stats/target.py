"""What the fits to published figures share: distances from these, the place of free numbers within
their bounds, and the record of what was fitted to what.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Figures = Mapping[str, float]
Bounds = Mapping[str, tuple[float, float]]
# in tolerances; finite, since searches take differences of it
_UNFLYABLE = 1e4


def distances(flown: Figures, published: Figures, tolerance: Figures) -> np.ndarray:
    """Distances from k published figures, each over its tolerance, (k,); far where a flight did not
    end well.
    """
    values = np.array([(flown[k] - published[k]) / tolerance[k] for k in published])
    return np.where(np.isfinite(values), values, _UNFLYABLE)


def misfit_of(flown: Figures, published: Figures, tolerance: Figures) -> float:
    """Sum of squared :func:`distances`."""
    return float(np.sum(distances(flown, published, tolerance) ** 2))


def ends(bounds: Bounds) -> np.ndarray:
    """Least and greatest of n free numbers, (2, n)."""
    return np.array(list(bounds.values()), float).T


def place_of(numbers: Mapping[str, float], bounds: Bounds) -> np.ndarray:
    """Place of n free numbers within their bounds, 0 to 1, (n,)."""
    low, high = ends(bounds)
    return (np.array([numbers[name] for name in bounds]) - low) / (high - low)


def record_of(
    numbers: Mapping[str, float],
    flown: Figures,
    published: Figures,
    tolerance: Figures,
    bounds: Bounds,
    seeds: Sequence[int],
    evaluations: int,
) -> dict[str, Any]:
    """Free numbers, published and flown figures, misfit, bounds and seeds of a search, as JSON."""
    return {
        "fitted": numbers,
        "flown": flown,
        "published": published,
        "tolerance": tolerance,
        "bounds": bounds,
        "seeds": seeds,
        "misfit": misfit_of(flown, published, tolerance),
        "evaluations": evaluations,
    }
