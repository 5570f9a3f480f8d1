"""How a log may have to be read otherwise than its columns say: order, sign, frame and unit.

Kinematics ties the streams of a rigid body to one another, whatever flies. Body rates are the
turning of the attitude. The accelerometer turned into the world is the acceleration. Velocity is
the derivative of position. Rotor speeds follow their commands. Unlike rotors turn the vehicle about
the axes of its mixer. Every fault of :func:`faults` is a hypothesis on the columns, judged by how
well the corrected columns fit one another.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ges.conventions import (
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
    command,
    rotor_speed,
)
from ges.recordings.consistency import SENSES, Columns, OnGrids, PairFit, pair_fits
from ges.vehicle.file import Vehicle

PRIOR_ODDS = 1e-3
"""Of a fault at all against the log as logged; all faults have the same share."""
MOST_PERMUTED = 4
"""Motors whose every order is tried: 8 would have 40,320; of more any two are exchanged."""
ALIKE_NATS = 3.0
"""Within which two faults explain the log alike."""
REFUTED_NATS = 20.0
"""By which a fault has to be worse than the log as logged, so that no flight is asked more."""
AGREED_MISFIT = 0.3
"""Below which streams say the same, and that a fault may leave of the misfit of such streams."""
LARGEST_MISFIT = 0.8
"""That a fault may leave of the misfit of other streams: more does not explain it."""
MOST_FLIGHTS, LONGEST_S, FEWEST_ROWS = 6, 60.0, 3000
"""That are looked at: all of a set are logged alike, from beginning to end."""


Fits = dict[tuple[int, str], PairFit]
Reading = Mapping[str, tuple[str, float]]
"""Of a column: the one that holds it, and a factor."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """A way in which the columns are not what their names say.

    Attributes
    ----------
    name : name of the option that corrects it; '' where the vehicle file is to be corrected.
    what : the fault in words.
    reading : columns that have to be read otherwise.
    senses : factor on the vehicle file's senses of rotation.
    """

    name: str
    what: str
    reading: Reading
    senses: float = 1.0

    def mend(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Correct a table.

        Parameters
        ----------
        frame : table (n rows) of a flight.

        Returns
        -------
        The table as it should have been.
        """
        return frame.assign(**self.read(frame))

    def read(self, as_logged: Mapping[str, Any] | pd.DataFrame) -> dict[str, Any]:
        """Compute the columns that have to be read otherwise.

        Parameters
        ----------
        as_logged : columns by name, as they were logged.

        Returns
        -------
        These columns as they should have been.
        """
        return {
            c: by * as_logged[held] for c, (held, by) in self.reading.items() if held in as_logged
        }

    def changes(self, logged: Collection[str]) -> Reading:
        """List what is read otherwise in a log, with the senses of rotation as one of its columns.

        Parameters
        ----------
        logged : names of its columns.

        Returns
        -------
        Of each column that changes: the one that holds it, and a factor.
        """
        every = {**self.reading, SENSES: (SENSES, self.senses)}
        seen = {*logged, SENSES}
        return {c: of for c, of in every.items() if of[0] in seen and of != (c, 1.0)}


def _scaled(columns: Sequence[str], factor: float) -> Reading:
    return {c: (c, factor) for c in columns}


def _ordered(
    streams: Sequence[Sequence[str]], order: Sequence[int], minus: Collection[int] = ()
) -> Reading:
    """Read column i of each stream as ``order[i]``; those of ``minus`` have the other sign."""
    return {
        columns[k]: (held, -1.0 if k in minus else 1.0)
        for columns in streams
        for k, held in zip(order, columns, strict=True)
    }


_VECTORS = {
    "gyro": ("the body rates stand", (BODY_RATE,)),
    "accelerometer": ("the accelerometer stands", (SPECIFIC_FORCE,)),
    "velocity": ("the velocity stands", (VELOCITY,)),
    "position": ("the position stands", (POSITION,)),
    "imu": ("gyro and accelerometer stand", (BODY_RATE, SPECIFIC_FORCE)),
    "world": (
        "position, velocity and their references stand",
        (POSITION, VELOCITY, POSITION_REF, VELOCITY_REF),
    ),
}
# what a reading is when its cause is known: the name of its option, and words
_CAUSES = {
    "world-minus-yz": (
        "world-minus-yz",
        "y and z of position, velocity and their references have the other sign, as in a log that"
        " was half converted from forward-right-down or north-east-down",
    ),
    "world-minus-z": (
        "world-minus-z",
        "z of position, velocity and their references has the other sign, as in a log that was half"
        " converted from down",
    ),
    "quaternion-minus-xyz": (
        "quaternion-inverse",
        "the quaternion turns from the world into the body",
    ),
    "quaternion-minus-yz": (
        "quaternion-ned",
        "the attitude is of forward-right-down axes in north-east-down",
    ),
}


def _axes() -> Iterator[Fault]:
    """List every order of a stream's axes with every sign of each."""
    for name, (stand, streams) in _VECTORS.items():
        for order in itertools.permutations(range(3)):
            for minus in _subsets(range(3)):
                yield from _reoriented(name, stand, streams, "xyz", order, minus)
    # an order with signs is a quaternion of another frame; the sign of the whole says nothing
    stated, stand = (0, 1, 2, 3), "the quaternion stands"
    orders = [(order, ()) for order in itertools.permutations(stated)]
    signs = [(stated, minus) for minus in _subsets(stated[1:])]
    for order, minus in (*orders, *signs):
        yield from _reoriented("quaternion", stand, (QUATERNION,), "wxyz", order, minus)


def _subsets(of: Sequence[int]) -> Iterator[tuple[int, ...]]:
    for count in range(len(of) + 1):
        yield from itertools.combinations(of, count)


def _reoriented(
    name: str,
    stand: str,
    streams: Sequence[Sequence[str]],
    axes: str,
    order: Sequence[int],
    minus: Sequence[int],
) -> Iterator[Fault]:
    """Make the fault that axes stand in another order or have another sign; none if neither."""
    what = []
    if list(order) != sorted(order):
        held = [axes[k] for k in order]
        name = f"{name}-{''.join(held)}"
        what.append(f"{stand} in the order {', '.join(held)}")
    if minus:
        turned = [axes[k] for k in minus]
        name = f"{name}-minus-{''.join(turned)}"
        alone = len(streams) == 1
        parts = " and ".join(streams[0][k] for k in minus) if alone else " and ".join(turned)
        of = "" if alone else f" of {stand.rsplit(' ', 1)[0]}"
        what.append(f"{parts}{of} {'has' if len(minus) == 1 else 'have'} the other sign")
    if what:
        yield Fault(*_CAUSES.get(name, (name, " and ".join(what))), _ordered(streams, order, minus))


def _units() -> Iterator[Fault]:
    scales = {
        "gyro-deg": (BODY_RATE, "the body rates are in deg/s", np.pi / 180.0),
        "position-ft": (POSITION, "the position is in feet", 0.3048),
        "position-cm": (POSITION, "the position is in centimetres", 0.01),
        "position-mm": (POSITION, "the position is in millimetres", 0.001),
        "velocity-ft": (VELOCITY, "the velocity is in feet per second", 0.3048),
        "velocity-cm": (VELOCITY, "the velocity is in centimetres per second", 0.01),
        "velocity-kmh": (VELOCITY, "the velocity is in kilometres per hour", 1.0 / 3.6),
        "time-ms": (("t_s",), "the time is in milliseconds", 1e-3),
        "time-us": (("t_s",), "the time is in microseconds", 1e-6),
        "time-ns": (("t_s",), "the time is in nanoseconds", 1e-9),
    }
    for name, (columns, what, factor) in scales.items():
        yield Fault(name, what, _scaled(columns, factor))


def _motors(n_rotors: int) -> Iterator[Fault]:
    yield Fault("", "the vehicle file has the senses of all rotors the wrong way round", {}, -1.0)
    speeds, commands = rotor_speed(n_rotors), command(n_rotors)
    families = {
        "motors": ("commands and rotor speeds are", (speeds, commands)),
        "commands": ("the commands are", (commands,)),
        "rotor-speeds": ("the rotor speeds are", (speeds,)),
    }
    for order in _orders(n_rotors):
        motors = [str(i + 1) for i in order]
        for name, (they_are, streams) in families.items():
            yield Fault(
                f"{name}-{('' if n_rotors < 10 else '-').join(motors)}",
                f"{they_are} in another order, columns 1 to {n_rotors} of the vehicle file's rotors"
                f" {' '.join(motors)}",
                _ordered(streams, order),
            )


def _orders(n_rotors: int) -> Iterator[tuple[int, ...]]:
    """List orders but the stated one: all of few rotors, of more those with two exchanged."""
    stated = tuple(range(n_rotors))
    if n_rotors <= MOST_PERMUTED:
        yield from itertools.islice(itertools.permutations(stated), 1, None)
        return
    for i, k in itertools.combinations(stated, 2):
        swapped = {i: k, k: i}
        yield tuple(swapped.get(j, j) for j in stated)


@functools.cache
def faults(n_rotors: int = 4) -> Mapping[str, Fault]:
    """List the faults that a log can have.

    Parameters
    ----------
    n_rotors : number of rotors of the vehicle.

    Returns
    -------
    Faults by the name of the option that corrects them.

    Examples
    --------
    >>> faults()["gyro-deg"].what
    'the body rates are in deg/s'
    """
    every = (*_axes(), *_units(), *_motors(n_rotors))
    return {f.name: f for f in every}


@dataclasses.dataclass(frozen=True)
class _Flight:
    """The middle minute of a flight, of at least 3000 rows.

    Attributes
    ----------
    rows : its columns as they were logged.
    on_grids : these at even times.
    """

    rows: Columns
    on_grids: OnGrids

    @classmethod
    def of(cls, frame: pd.DataFrame) -> _Flight:
        t_s = frame["t_s"].to_numpy(dtype=float)
        rows = max(FEWEST_ROWS, int(LONGEST_S / np.median(np.diff(t_s))))
        start = max(0, (len(frame) - rows) // 2)
        known = frame.iloc[start : start + rows]
        columns = {str(c): known[c].to_numpy() for c in known}
        return cls(columns, OnGrids.of(columns))

    def read(self, fault: Fault, changed: Collection[str]) -> OnGrids:
        """Correct the columns; what stands at other times is put on a grid of its own."""
        if "t_s" in changed:
            return OnGrids.of({**self.rows, **fault.read(self.rows)})
        return self.on_grids.read(fault.read)


def find_faults(
    frames: Sequence[pd.DataFrame], vehicle: Vehicle | None = None
) -> tuple[list[Fault], float]:
    """Find the faults that explain how the streams of flights differ.

    Parameters
    ----------
    frames : contract columns of each flight; all are read in the same way.
    vehicle : has the places and senses of the rotors; without it the motors are not judged.

    Returns
    -------
    The faults that explain the log equally well, most likely first; empty where the log is believed
    as it is. Then the log odds (natural) of the likeliest against the log as it is.

    Notes
    -----
    All faults compete in one model, whichever streams they concern. The likelihood of a reading is
    that of the misfits of its pairs, each of unknown noise: log p = -sum_k (n_k / 2) log m_k. n_k
    is the number of independent windows of pair k, m_k the share of its power that does not agree.
    """
    n_rotors, rotors = (len(vehicle.rotors), vehicle.rotor_arrays()) if vehicle else (0, {})
    read = [_Flight.of(frame) for frame in frames[:MOST_FLIGHTS]]
    fitted = [(flight, dict(pair_fits(flight.on_grids, rotors))) for flight in read]
    # those that show much come first, as they refute most
    fitted.sort(key=lambda pair: -_log_likelihood(pair[1]))
    flights = [flight for flight, _ in fitted]
    as_logged = {(k, what): fit for k, (_, fits) in enumerate(fitted) for what, fit in fits.items()}
    every = _distinct(frozenset(c for flight in flights for c in flight.rows), n_rotors)
    prior = float(np.log(PRIOR_ODDS / max(len(every), 1)))
    likely = []
    for fault, changed in every:
        mended = _mended(fault, changed, flights, rotors, as_logged)
        if mended is not None and (gain := _gain(mended, as_logged)) + prior > 0.0:
            likely.append((gain, fault, changed))
    # what changes more than another has to explain as much more as a fault does at all
    needed = [
        one for one in likely if all(one[0] - o[0] + prior > 0.0 for o in likely if o[2] < one[2])
    ]
    if not needed:
        return [], 0.0
    best = max(gain for gain, *_ in needed)
    alike = [one for one in needed if one[0] > best - ALIKE_NATS]
    # of two that are as likely the one that changes less
    alike.sort(key=lambda one: (-round(one[0], 1), len(one[1].what)))
    return [fault for _, fault, _ in alike], best + prior


@functools.cache
def _distinct(logged: frozenset[str], n_rotors: int) -> tuple[tuple[Fault, frozenset[str]], ...]:
    """List faults that read a log otherwise, each reading once, with what they change."""
    distinct: dict[frozenset[tuple[str, tuple[str, float]]], Fault] = {}
    for fault in faults(n_rotors).values():
        if changes := fault.changes(logged):
            distinct.setdefault(frozenset(changes.items()), fault)
    return tuple((fault, frozenset(c for c, _ in of)) for of, fault in distinct.items())


def _mended(
    fault: Fault,
    changed: Collection[str],
    flights: Sequence[_Flight],
    rotors: Mapping[str, np.ndarray],
    as_logged: Fits,
) -> Fits | None:
    """Compute fits of corrected flights, by flight and pair; None where one refutes the fault."""
    mended = {key: fit for key, fit in as_logged.items() if fit.columns.isdisjoint(changed)}
    turned = {**rotors, "spin": fault.senses * rotors["spin"]} if rotors else rotors
    so_far = 0.0
    for k, flight in enumerate(flights):
        for what, fit in pair_fits(flight.read(fault, changed), turned, changed):
            mended[k, what] = fit
            so_far += fit.log_likelihood
            if (k, what) in as_logged:
                so_far -= as_logged[k, what].log_likelihood
            if so_far < -REFUTED_NATS:
                return None
    return mended


def _gain(mended: Fits, as_logged: Fits) -> float:
    """Compute the log likelihood that corrected flights have over flights as logged.

    It is none where they leave too much of the misfit.
    """
    differ = [key for key in mended | as_logged if mended.get(key) != as_logged.get(key)]
    after, before = ({key: of[key] for key in differ if key in of} for of in (mended, as_logged))
    gain = _log_likelihood(after) - _log_likelihood(before)
    windows = sum((after | before)[key].windows for key in differ)
    if windows == 0.0:
        return 0.0
    # geometric means over these windows
    misfit, left = (np.exp(-2.0 * nats / windows) for nats in (_log_likelihood(before), gain))
    largest = AGREED_MISFIT if misfit < AGREED_MISFIT else LARGEST_MISFIT
    return gain if left <= largest else 0.0


def _log_likelihood(fits: Mapping[Any, PairFit]) -> float:
    return sum(fit.log_likelihood for fit in fits.values())


def sentence(alike: Sequence[Fault], log_odds: float) -> str:
    """Say what is most likely wrong with a log, and how to have it read otherwise.

    Parameters
    ----------
    alike, log_odds : what :func:`find_faults` returns, with one fault at least.
    """
    odds = (
        f"10^{log_odds / np.log(10.0):.0f}" if log_odds > np.log(1e6) else f"{np.exp(log_odds):.0f}"
    )
    what = "; or ".join(f.what for f in alike[:3])
    options = [f"--mend {f.name}" for f in alike[:3] if f.name]
    mend = f"; {' or '.join(options)} reads it so" if options else "; mend it"
    return f"its streams do not fit one another as they are told: {what} (odds {odds} : 1){mend}"
