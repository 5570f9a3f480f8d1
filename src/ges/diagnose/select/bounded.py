"""Mass of a Gaussian between bounds of its coefficients, whatever their correlation."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import log_ndtr

from ges.diagnose.settings import settings


def log_mass(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the log mass of the standard normal between bounds, exact in both tails.

    Parameters
    ----------
    low, high : (s, k), in sds.

    Returns
    -------
    (s, k).
    """
    # mirrored into the lower tail, where the logarithm of the distribution keeps its digits
    low, high = np.where(low > 0, -high, low), np.where(low > 0, -low, high)
    with np.errstate(divide="ignore"):
        below_high = log_ndtr(high)
        return below_high + np.log1p(-np.exp(log_ndtr(low) - below_high))


def log_mass_within(
    low: np.ndarray, high: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Return the log mass of Gaussians between bounds, by expectation propagation.

    Parameters
    ----------
    low, high, mean : (s, k), in the units of the coefficients.
    covariance : (s, k, k).

    Returns
    -------
    (s,), exact where no coefficients are correlated. Hundreds of sds beyond bounds rounding leaves
    no factors; there correlations are ignored.

    Notes
    -----
    Every bounded coefficient stands as a Gaussian factor. It has the mass, mean and variance of the
    coefficient within its bounds, given the factors of the others.

    References
    ----------
    Cunningham, Hennig and Lacoste-Julien 2011, "Gaussian Probabilities and Expectation
    Propagation".
    """
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    separately = log_mass((low - mean) / sd, (high - mean) / sd)
    with np.errstate(all="ignore"):
        jointly = _log_mass_jointly(low, high, mean, covariance)
    # all bounds together leave no more than any one of them
    return np.where(
        np.isfinite(jointly), np.minimum(jointly, separately.min(axis=1)), separately.sum(axis=1)
    )


def _log_mass_jointly(
    low: np.ndarray, high: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    factors, m, s = np.zeros((3, *mean.shape)), mean.copy(), covariance.copy()
    bounded = np.flatnonzero((np.isfinite(low) | np.isfinite(high)).any(axis=0))
    for i in np.tile(bounded, settings.numerics.bound_sweeps):
        column = s[:, i].copy()
        new = _factor(m[:, i], s[:, i, i], low[:, i], high[:, i], *factors[:2, :, i])
        tilt, weight, _ = new - factors[:, :, i]
        factors[:, :, i] = new
        # Sherman-Morrison: covariance and mean as the factor of one coefficient changes
        gain = column / (1.0 + weight * s[:, i, i])[:, None]
        m += gain * (tilt - weight * m[:, i])[:, None]
        s -= gain[:, :, None] * (column * weight[:, None])[:, None, :]
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
    """Return new factor exp(size + tilt x - weight x^2 / 2) of one coefficient's bounds.

    Returns tilt, weight and size (3, s), in place of the present tilt and weight.
    """
    # cavity: the coefficient's Gaussian without what stood for its bounds
    own = 1.0 / np.maximum(1.0 / variance - weight, settings.numerics.small / variance)
    at, sd = own * (mean / variance - tilt), np.sqrt(own)
    low, high = (low - at) / sd, (high - at) / sd
    size = log_mass(low, high)
    shift, share = _moments_within(low, high, size)
    # what is within the bounds, over the cavity, is the new factor: same mass, mean and variance
    there, variance_within = at + sd * shift, own * share
    of_both = 0.5 * (np.log(share) + there**2 / variance_within - at**2 / own)
    return np.stack(
        [there / variance_within - at / own, 1.0 / variance_within - 1.0 / own, size - of_both]
    )


def _moments_within(
    low: np.ndarray, high: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and variance of the standard normal between two bounds with this log mass."""
    # with Z the mass: mean (phi(l) - phi(h)) / Z, variance 1 + (l phi(l) - h phi(h)) / Z - mean^2;
    # a bound at infinity adds nothing, though infinity times zero is no number
    log_root = 0.5 * math.log(2.0 * math.pi)
    at_low, at_high = (np.exp(-0.5 * x**2 - log_root - size) for x in (low, high))
    ends = [np.where(np.isfinite(x), x, 0.0) * at for x, at in ((low, at_low), (high, at_high))]
    mean, beyond, width = at_low - at_high, np.maximum(np.maximum(low, -high), 0.0), high - low
    # rounding leaves less of it far beyond a bound
    least = 0.5 * np.minimum(1.0 / (7.0 + beyond**2), width**2 / 12.0)
    return mean, np.clip(1.0 + ends[0] - ends[1] - mean**2, least, 1.0)
