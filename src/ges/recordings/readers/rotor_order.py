"""Which speed reading belongs to which motor, where the log does not say: the commands know."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ges.recordings.readers.log import Stream

# Measured on a flight whose log states the order (4 Hz, 65 s): right order .53 a rotor, next best
# .33, the order of the columns -.07.
LEAST_CORRELATION, LEAST_AHEAD, FEWEST = 0.25, 0.1, 30


def agreement(command: Stream, speed: Stream) -> np.ndarray | None:
    """Correlations (n, n) of each motor's share of the commands with each reading's share of the
    speeds, while all turn; None where they cannot be compared.

    A share is what a rotor has over the mean of all: what a controller asks of one rotor alone.
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
    """The order whose pairs have the greatest mean correlation, and that (Kuhn 1955)."""
    rows, order = linear_sum_assignment(r, maximize=True)
    return tuple(int(k) for k in order), float(r[rows, order].mean())


def _without(r: np.ndarray, i: int, k: int) -> np.ndarray:
    """Correlations under which one pair is never taken."""
    changed = r.copy()
    changed[i, k] = -len(r)
    return changed


def doubt(command: Stream, speed: Stream) -> tuple[str, tuple[int, ...]]:
    """Why the readings may not be in the order of the motors ('' where the commands bear them
    out), and the order that the commands speak for, counted from 1.
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
