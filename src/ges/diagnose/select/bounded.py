"""How much of a Gaussian lies between bounds of its coefficients, however tied they are to each
other.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import log_ndtr

from ges.diagnose.settings import settings


def log_mass(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Log of the standard normal's mass between two bounds, (s, k) as they are, exact in both
    tails.
    """
    # mirrored into the lower tail, where the logarithm of the distribution keeps its digits
    low, high = np.where(low > 0, -high, low), np.where(low > 0, -low, high)
    with np.errstate(divide="ignore"):
        return log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))


def log_mass_within(
    low: np.ndarray, high: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Log of the mass of Gaussians between bounds, by expectation propagation (Cunningham, Hennig
    and Lacoste-Julien 2011, "Gaussian Probabilities and Expectation Propagation"): every bounded
    coefficient stands as a Gaussian factor with the mass, the mean and the variance that it has
    within its bounds beside the factors of the others.

    Parameters
    ----------
    low, high, mean : (s, k); covariance : (s, k, k).

    Returns
    -------
    (s,), exact where no two of the coefficients are tied; hundreds of sds beyond bounds, where
    rounding leaves nothing of the factors, as if none were.
    """
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    apart = log_mass((low - mean) / sd, (high - mean) / sd)
    with np.errstate(all="ignore"):
        together = _together(low, high, mean, covariance)
    # all bounds together leave no more than any one of them
    return np.where(
        np.isfinite(together), np.minimum(together, apart.min(axis=1)), apart.sum(axis=1)
    )


def _together(
    low: np.ndarray, high: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    factors, m, s = np.zeros((3, *mean.shape)), mean.copy(), covariance.copy()
    bounded = np.flatnonzero((np.isfinite(low) | np.isfinite(high)).any(axis=0))
    for i in np.tile(bounded, settings.numerics.bound_sweeps):
        across, new = (
            s[:, i].copy(),
            _factor(m[:, i], s[:, i, i], low[:, i], high[:, i], *factors[:2, :, i]),
        )
        tilt, weight, _ = new - factors[:, :, i]
        factors[:, :, i] = new
        # Sherman-Morrison: covariance and mean as the factor of one coefficient changes
        along = across / (1.0 + weight * s[:, i, i])[:, None]
        m += along * (tilt - weight * m[:, i])[:, None]
        s -= along[:, :, None] * (across * weight[:, None])[:, None, :]
    # log of the integral of N(mean, covariance) times all factors
    own = np.linalg.solve(covariance, mean[:, :, None])[:, :, 0]
    shrunk = np.linalg.slogdet(s)[1] - np.linalg.slogdet(covariance)[1]
    return factors[2].sum(axis=1) + 0.5 * (
        shrunk + (m * (own + factors[0]) - mean * own).sum(axis=1)
    )


def _factor(
    mean: np.ndarray,
    variance: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    tilt: np.ndarray,
    weight: np.ndarray,
) -> np.ndarray:
    """What stands for the bounds of one coefficient, exp(size + tilt x - weight x^2 / 2), instead
    of what stood there: tilt, weight and size (3, s).
    """
    # cavity: the coefficient's Gaussian without what stood for its bounds
    own = 1.0 / np.maximum(1.0 / variance - weight, settings.numerics.small / variance)
    at, sd = own * (mean / variance - tilt), np.sqrt(own)
    low, high = (low - at) / sd, (high - at) / sd
    size = log_mass(low, high)
    shift, share = _moments_within(low, high, size)
    # what is within the bounds, over the cavity, is the new factor: same mass, mean and variance
    there, left = at + sd * shift, own * share
    of_both = 0.5 * (np.log(share) + there**2 / left - at**2 / own)
    return np.stack([there / left - at / own, 1.0 / left - 1.0 / own, size - of_both])


def _moments_within(
    low: np.ndarray, high: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the standard normal between two bounds with this log mass
    between them.
    """
    # with Z the mass: mean (phi(l) - phi(h)) / Z, variance 1 + (l phi(l) - h phi(h)) / Z - mean^2;
    # a bound at infinity adds nothing, though infinity times zero is no number
    log_root = 0.5 * math.log(2.0 * math.pi)
    at_low, at_high = (np.exp(-0.5 * x**2 - log_root - size) for x in (low, high))
    ends = [np.where(np.isfinite(x), x, 0.0) * at for x, at in ((low, at_low), (high, at_high))]
    mean, beyond, width = at_low - at_high, np.maximum(np.maximum(low, -high), 0.0), high - low
    least = 0.5 * np.minimum(
        1.0 / (7.0 + beyond**2), width**2 / 12.0
    )  # rounding leaves less of it far beyond a bound
    return mean, np.clip(1.0 + ends[0] - ends[1] - mean**2, least, 1.0)
