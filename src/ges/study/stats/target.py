"""What the fits to published figures share.

These are distances from the figures, the place of free numbers within their bounds, and the record
of what was fitted to what.
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
    """Return distances from published figures, each over its tolerance.

    Parameters
    ----------
    flown, published, tolerance : by figure; ``flown`` may have more of them.

    Returns
    -------
    (figures,); far where a flight did not end well.
    """
    values = np.array([(flown[k] - published[k]) / tolerance[k] for k in published])
    return np.where(np.isfinite(values), values, _UNFLYABLE)


def misfit_of(flown: Figures, published: Figures, tolerance: Figures) -> float:
    """Return the sum of squared :func:`distances`.

    Parameters
    ----------
    flown, published, tolerance : by figure.
    """
    return float(np.sum(distances(flown, published, tolerance) ** 2))


def ends(bounds: Bounds) -> np.ndarray:
    """Return the least and greatest values of free numbers.

    Parameters
    ----------
    bounds : by number.

    Returns
    -------
    (2, numbers).
    """
    return np.array(list(bounds.values()), float).T


def place_of(numbers: Mapping[str, float], bounds: Bounds) -> np.ndarray:
    """Return the place of free numbers within their bounds.

    Parameters
    ----------
    numbers : by name; may hold more than the free ones.
    bounds : by free number.

    Returns
    -------
    (numbers,) 0 at the lower bound, 1 at the upper.
    """
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
    """Return the record of a search, as JSON can hold it.

    Parameters
    ----------
    numbers : free numbers that were found.
    flown, published, tolerance : figures of the simulator, published ones, and their tolerances.
    bounds : by free number.
    seeds : that were flown.
    evaluations : how often the search has flown them.
    """
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
