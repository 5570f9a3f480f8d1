"""Which rotor turns the vehicle which way, seen from the flight itself.

A wrong order of motors makes every moment wrong and no force, so nothing else would show it.
Angular accelerations are regressed on what drives each rotor. The gains must have the direction
that the hubs and spins of the layout give.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ges.conventions import BODY_RATE, commands_in, rotor_speeds_in
from ges.vehicle.file import Rotor

AXES = ("roll", "pitch", "yaw")
# The gains are read where they explain a tenth of an axis; in between nothing is concluded.
LEAST_R2 = 0.12
AGREES, CONTRADICTS = 0.7, 0.3
FINEST_STEP_S, LONGEST_LAG_S, LONGEST_HOLD_S = 0.02, 0.12, 0.3
FEWEST_ROWS = 200


@dataclasses.dataclass(frozen=True)
class Turning:
    """Regression of the angular accelerations on what drives the rotors.

    Attributes
    ----------
    gains : (3, n_rotors) angular acceleration per drive about x, y, z, less their mean over rotors.
    r2 : (3,) share of the variance of fast angular acceleration that they explain.
    """

    gains: np.ndarray
    r2: np.ndarray

    def agreement(self, rotors: Sequence[Rotor]) -> np.ndarray:
        """Compare the gains with the moments that rotors make.

        Parameters
        ----------
        rotors : hubs and spins to test.

        Returns
        -------
        Cosines (3,) of gains and moments about x, y, z; NaN where the regression explains too
        little.
        """
        wanted = moments(rotors)
        # only directions are compared: how strongly an axis turns depends on the inertia, too
        product = np.sum(self.gains * wanted, axis=1)
        size = np.linalg.norm(self.gains, axis=1) * np.linalg.norm(wanted, axis=1)
        loud = (self.r2 >= LEAST_R2) & (size > 0)
        return np.divide(product, size, out=np.full(3, np.nan), where=loud)

    def contradicted(self, rotors: Sequence[Rotor]) -> list[str]:
        """List the axes that turn differently than these rotors would turn them.

        Parameters
        ----------
        rotors : hubs and spins to test.

        Returns
        -------
        Any of ``roll``, ``pitch``, ``yaw``: cosines below 0.3.
        """
        cosines = self.agreement(rotors)
        return [axis for axis, cosine in zip(AXES, cosines, strict=True) if cosine < CONTRADICTS]

    def confirmed(self, rotors: Sequence[Rotor]) -> list[str]:
        """List the axes that turn as these rotors would turn them.

        Parameters
        ----------
        rotors : hubs and spins to test.

        Returns
        -------
        Any of ``roll``, ``pitch``, ``yaw``: cosines above 0.7.
        """
        cosines = self.agreement(rotors)
        return [axis for axis, cosine in zip(AXES, cosines, strict=True) if cosine > AGREES]


def moments(rotors: Sequence[Rotor]) -> np.ndarray:
    """Compute the direction of the moment that each rotor's thrust makes.

    Parameters
    ----------
    rotors : n rotors with hubs and spins.

    Returns
    -------
    (y, -x, -spin) of each rotor, (3, n), less the mean over rotors; spin is +1 for ccw.
    """
    x, y = (np.array([getattr(r, k).value for r in rotors]) for k in ("x_m", "y_m"))
    spin = np.array([1.0 if r.spin == "ccw" else -1.0 for r in rotors])
    weights = np.stack([y, -x, -spin])
    return weights - weights.mean(axis=1, keepdims=True)


def turning(frame: pd.DataFrame) -> Turning | None:
    """Regress angular accelerations on what drives the rotors.

    Commands are preferred to rotor speeds, as they are logged faster. The drive may act up to 0.12
    s after its command; each axis takes the lag that explains most.

    Parameters
    ----------
    frame : table (n rows) of a flight in contract columns.

    Returns
    -------
    The regression; None where drives or body rates are missing or have too few rows.
    """
    asked, measured = commands_in(frame), rotor_speeds_in(frame)
    drives = asked if len(asked) >= len(measured) else measured
    if not drives or not set(BODY_RATE) <= set(frame):
        return None
    rows = frame[["t_s", *drives, *BODY_RATE]].copy()
    # a set-point is in force until the next one
    rows[list(drives)] = rows[list(drives)].ffill(limit=_rows(frame, LONGEST_HOLD_S))
    rows = rows.dropna()
    if len(rows) < FEWEST_ROWS:
        return None
    rows = _thinned(rows)
    t_s = rows["t_s"].to_numpy()
    # thrust goes about with the square, of speeds as of commands to speed
    drive = rows[list(drives)].to_numpy() ** 2
    turned = np.gradient(rows[list(BODY_RATE)].to_numpy(), t_s, axis=0)
    step_s = float(np.median(np.diff(t_s)))
    # on the ground no command turns anything
    total = drive.mean(axis=1)
    flying = total > 0.5 * np.quantile(total, 0.7)
    if flying.sum() < FEWEST_ROWS:
        return None
    # what all rotors do together turns no axis; slow parts hold a trim
    drive = _fast(drive - drive.mean(axis=1, keepdims=True), step_s)
    return _strongest(drive, _fast(turned, step_s), flying, int(LONGEST_LAG_S / step_s))


def _rows(frame: pd.DataFrame, seconds: float) -> int:
    return max(1, int(seconds / float(np.median(np.diff(frame["t_s"])))))


def _thinned(rows: pd.DataFrame) -> pd.DataFrame:
    """Average over a fiftieth of a second where rows come faster."""
    cells = np.floor(rows["t_s"] / FINEST_STEP_S)
    return rows.groupby(cells.to_numpy()).mean()


def _fast(values: np.ndarray, step_s: float) -> np.ndarray:
    """Take off the moving average over one second, (n, k)."""
    slow = pd.DataFrame(values).rolling(max(3, round(1.0 / step_s)), center=True, min_periods=1)
    return values - slow.mean().to_numpy()


def _strongest(drive: np.ndarray, turned: np.ndarray, flying: np.ndarray, lags: int) -> Turning:
    """Find the gains of each axis at the lag that explains most of it.

    A mixer asks three moments of all drives. So of more than four drives only the three strongest
    directions are used (principal component regression).
    """
    _, _, directions = np.linalg.svd(drive[flying], full_matrices=False)
    asked = directions[:3].T
    gains, r2 = np.zeros((3, drive.shape[1])), np.full(3, -np.inf)
    for lag in range(max(lags, 1) + 1):
        used = flying[: len(flying) - lag]
        x, y = drive[: len(drive) - lag][used], turned[lag:][used]
        fit = asked @ np.linalg.lstsq(x @ asked, y, rcond=None)[0]
        variance = np.var(y, axis=0)
        explained = 1.0 - np.var(y - x @ fit, axis=0) / np.where(variance > 0, variance, np.inf)
        # the least-squares fit at each lag, an axis by itself
        better = explained > r2
        r2 = np.where(better, explained, r2)
        gains[better] = fit.T[better]
    # drives add up to zero here, so that a common part of the gains is arbitrary
    return Turning(gains - gains.mean(axis=1, keepdims=True), r2)
