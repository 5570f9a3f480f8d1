"""Which speed reading belongs to which motor, by the commands, where the log does not say."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ges.recordings.readers.log import Stream

# Measured on a flight whose log states the order (4 Hz, 65 s): right order .53 a rotor, next best
# .33, the order of the columns -.07.
LEAST_CORRELATION, LEAST_AHEAD, FEWEST = 0.25, 0.1, 30


def agreement(command: Stream, speed: Stream) -> np.ndarray | None:
    """Correlate each motor's commands with each reading of speed.

    Only shares over the mean of all rotors are compared: what a controller asks of one rotor alone.

    Parameters
    ----------
    command, speed : streams of n motors and n readings.

    Returns
    -------
    Correlations (n, n), motors along rows, while all rotors turn; None where they cannot be
    compared.
    """
    u, w = (np.stack(list(s.columns.values())) for s in (command, speed))
    if len(u) != len(w) or len(command.t_s) < 2:
        return None
    # at the times of telemetry, which is the slower
    at_speed = np.stack([np.interp(speed.t_s, command.t_s, row) for row in u])
    mean = w.mean(axis=0)
    turning = (w > 0).all(axis=0) & np.isfinite(at_speed).all(axis=0)
    # idling rotors have no share that a controller asked for
    turning &= mean > 0.5 * np.nanquantile(mean, 0.9)
    if turning.sum() < FEWEST:
        return None
    shares = [(x - x.mean(axis=0))[:, turning] for x in (at_speed, w)]
    if any(np.std(row) == 0 for x in shares for row in x):
        return None
    return np.corrcoef(np.vstack(shares))[: len(u), len(u) :]


def _best(r: np.ndarray) -> tuple[tuple[int, ...], float]:
    """Find the order whose pairs have the greatest mean correlation, and that correlation.

    References
    ----------
    Kuhn, Naval Research Logistics Quarterly 2, 1955 (assignment).
    """
    rows, order = linear_sum_assignment(r, maximize=True)
    return tuple(int(k) for k in order), float(r[rows, order].mean())


def _without(r: np.ndarray, i: int, k: int) -> np.ndarray:
    """Change correlations so that one pair is never taken."""
    changed = r.copy()
    changed[i, k] = -len(r)
    return changed


def check_order(command: Stream, speed: Stream) -> tuple[str, tuple[int, ...]]:
    """Check whether the commands confirm the order of the speed readings.

    Parameters
    ----------
    command, speed : streams of n motors and n readings.

    Returns
    -------
    Why the order is uncertain ('' if the commands confirm it), and the order that the commands
    indicate, counted from 1 (empty if none).
    """
    r = agreement(command, speed)
    if r is None:
        return "the commands cannot show which reading is whose", ()
    best, score = _best(r)
    order = tuple(i + 1 for i in best)
    # the next best order does without one of the best one's pairs
    second = max(_best(_without(r, i, k))[1] for i, k in enumerate(best))
    if score < LEAST_CORRELATION or score - second < LEAST_AHEAD:
        return "the commands agree with no order of the readings clearly", ()
    if best == tuple(range(len(r))):
        return "", order
    return f"the commands speak for the order {' '.join(map(str, order))}", order
