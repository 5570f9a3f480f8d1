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
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ges.conventions import (
    BODY_RATE,
    GRAVITY_M_S2,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
    command,
    rotor_speed,
)
from ges.recordings.consistency import (
    FULL_SPEED,
    INERTIA,
    MASS,
    Columns,
    OnGrids,
    PairFit,
    numbers_of,
    of_rotors,
    pair_fits,
    size_log_likelihood,
    turned_into,
)
from ges.vehicle.file import Quantity, Vehicle

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
FOOT_M = 0.3048
BETWEEN_AXES_DEG = (45.0, -45.0, 135.0, -135.0)
"""Of turns about z that are no order of axes, and that autopilots are mounted with."""
SPEED_UNITS = {
    "rpm": ("revolutions per minute", np.pi / 30.0),
    "rev": ("revolutions per second", 2.0 * np.pi),
    "krpm": ("thousands of revolutions per minute", 1e3 * np.pi / 30.0),
    "erpm": ("electrical revolutions per minute of 14 poles", np.pi / 30.0 / 7.0),
}
"""Of rotor speeds, in words, and how many rad/s each is."""
ROUNDING_NATS = 1e-6
"""By which a misfit changes that does not."""
MOST_FLIGHTS, LONGEST_S, FEWEST_ROWS = 6, 60.0, 3000
"""That are looked at: all of a set are logged alike, from beginning to end."""


Fits = dict[tuple[int, str], PairFit]
Reading = Mapping[str, Mapping[str, float]]
"""Of a column: those that it is the sum of, each with its factor."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """A way in which the columns are not what their names say.

    Attributes
    ----------
    name : name of the option that corrects it.
    what : the fault in words.
    reading : columns, or numbers of the vehicle file, that have to be read otherwise.
    turned : columns of a vector that stands in the other frame, three; empty if none does.
    frame : ``body`` or ``world``: into which it has to be turned by the attitude.
    """

    name: str
    what: str
    reading: Reading
    turned: tuple[str, ...] = ()
    frame: str = ""

    @property
    def in_file(self) -> bool:
        """Whether the vehicle file is wrong, and no option reads the log otherwise."""
        return self.name.startswith("file-")

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
        as_logged : columns by name, as they were logged, and numbers of the vehicle file.

        Returns
        -------
        These as they should have been.
        """
        sums = {
            c: sum(by * as_logged[source] for source, by in of.items())
            for c, of in self.reading.items()
            if all(source in as_logged for source in of)
        }
        if not self.changes_frame(as_logged):
            return sums
        vectors, q = (
            np.stack([np.asarray(as_logged[c], dtype=float) for c in of], axis=1)
            for of in (self.turned, QUATERNION)
        )
        return sums | dict(zip(self.turned, turned_into(self.frame, vectors, q).T, strict=True))

    def changes_frame(self, logged: Collection[str] | pd.DataFrame) -> bool:
        """Whether a vector of these columns has to be turned, and an attitude says how."""
        return bool(self.turned) and all(c in logged for c in (*self.turned, *QUATERNION))

    def changes(self, logged: Collection[str]) -> Reading:
        """List what is read otherwise in a log.

        Parameters
        ----------
        logged : names of its columns, and of the numbers of the vehicle file.

        Returns
        -------
        Of each column that changes: what it is the sum of.
        """
        changed = {
            c: of
            for c, of in self.reading.items()
            if all(source in logged for source in of) and of != {c: 1.0}
        }
        if self.changes_frame(logged):
            changed |= {c: {f"{c}, not in the {self.frame} frame": 1.0} for c in self.turned}
        return changed


def _scaled(columns: Sequence[str], factor: float) -> Reading:
    return {c: {c: factor} for c in columns}


def _yawed(streams: Iterable[Sequence[str]], degrees: float) -> Reading:
    """Read x and y of each stream as turned about z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return {
        name: of for x, y, *_ in streams for name, of in ((x, {x: c, y: -s}), (y, {x: s, y: c}))
    }


def _ordered(
    streams: Sequence[Sequence[str]], order: Sequence[int], minus: Collection[int] = ()
) -> Reading:
    """Read column i of each stream as ``order[i]``; those of ``minus`` have the other sign."""
    return {
        columns[k]: {source: -1.0 if k in minus else 1.0}
        for columns in streams
        for k, source in zip(order, columns, strict=True)
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
    """List every order of a stream's axes with every sign of each, and mounts between them."""
    for name, (stand, streams) in _VECTORS.items():
        for order in itertools.permutations(range(3)):
            for minus in _subsets(range(3)):
                yield from _reoriented(name, stand, streams, "xyz", order, minus)
    for name in ("gyro", "accelerometer", "imu"):
        stand, streams = _VECTORS[name]
        for degrees in BETWEEN_AXES_DEG:
            what = f"{stand} turned by {-degrees:+.0f} degrees about z"
            yield Fault(f"{name}-yaw{-degrees:+.0f}", what, _yawed(streams, degrees))
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
        sources = [axes[k] for k in order]
        name = f"{name}-{''.join(sources)}"
        what.append(f"{stand} in the order {', '.join(sources)}")
    if minus:
        turned = [axes[k] for k in minus]
        name = f"{name}-minus-{''.join(turned)}"
        alone = len(streams) == 1
        parts = " and ".join(streams[0][k] for k in minus) if alone else " and ".join(turned)
        of = "" if alone else f" of {stand.rsplit(' ', 1)[0]}"
        what.append(f"{parts}{of} {'has' if len(minus) == 1 else 'have'} the other sign")
    if what:
        yield Fault(*_CAUSES.get(name, (name, " and ".join(what))), _ordered(streams, order, minus))


def _frames() -> Iterator[Fault]:
    frames = {
        "gyro-world": (BODY_RATE, "the body rates are", "body"),
        "accelerometer-world": (SPECIFIC_FORCE, "the accelerometer is", "body"),
        "velocity-body": (VELOCITY, "the velocity is", "world"),
    }
    for name, (columns, is_in, into) in frames.items():
        other = "world" if into == "body" else "body"
        yield Fault(name, f"{is_in} in the {other} frame", {}, columns, into)


def _units(n_rotors: int) -> Iterator[Fault]:
    length = (*POSITION, *VELOCITY, *POSITION_REF, *VELOCITY_REF)
    scales = {
        "gyro-deg": (BODY_RATE, "the body rates are in deg/s", np.pi / 180.0),
        "gyro-rev": (BODY_RATE, "the body rates are in revolutions per second", 2.0 * np.pi),
        "accelerometer-g": (SPECIFIC_FORCE, "the accelerometer is in g", GRAVITY_M_S2),
        "accelerometer-ft": (SPECIFIC_FORCE, "the accelerometer is in feet per second^2", FOOT_M),
        "position-ft": (POSITION, "the position is in feet", FOOT_M),
        "position-cm": (POSITION, "the position is in centimetres", 0.01),
        "position-mm": (POSITION, "the position is in millimetres", 0.001),
        "velocity-ft": (VELOCITY, "the velocity is in feet per second", FOOT_M),
        "velocity-cm": (VELOCITY, "the velocity is in centimetres per second", 0.01),
        "velocity-kmh": (VELOCITY, "the velocity is in kilometres per hour", 1.0 / 3.6),
        "world-ft": (length, "position, velocity and their references are in feet", FOOT_M),
        "world-cm": (length, "position, velocity and their references are in centimetres", 0.01),
        "time-ms": (("t_s",), "the time is in milliseconds", 1e-3),
        "time-us": (("t_s",), "the time is in microseconds", 1e-6),
        "time-ns": (("t_s",), "the time is in nanoseconds", 1e-9),
    }
    speeds = rotor_speed(n_rotors)
    scales["rotor-speeds-double"] = (speeds, "the rotor speeds are twice what they were", 0.5)
    for unit, (words, factor) in SPEED_UNITS.items():
        scales[f"rotor-speeds-{unit}"] = (speeds, f"the rotor speeds are in {words}", factor)
    for name, (columns, what, factor) in scales.items():
        yield Fault(name, what, _scaled(columns, factor))


def _numbers(n_rotors: int) -> Iterator[Fault]:
    """List units that a vehicle file can have, and senses of rotation."""
    thrusts, torques, x_m, y_m, spins = (
        of_rotors(name, n_rotors) for name in ("thrust_N_s2", "torque_Nm_s2", "x_m", "y_m", "spin")
    )
    scales = {
        "mass-g": ((MASS,), "the mass is in grams", 1e-3),
        "mass-lb": ((MASS,), "the mass is in pounds", 0.45359237),
        "mass-oz": ((MASS,), "the mass is in ounces", 0.028349523),
        "mass-N": ((MASS,), "the mass is a weight in newtons", 1.0 / GRAVITY_M_S2),
        "inertia-gm2": (INERTIA, "the inertia is in g m^2", 1e-3),
        "inertia-kgcm2": (INERTIA, "the inertia is in kg cm^2", 1e-4),
        "inertia-gcm2": (INERTIA, "the inertia is in g cm^2", 1e-7),
        "arms-mm": ((*x_m, *y_m), "the places of the rotors are in millimetres", 1e-3),
        "arms-cm": ((*x_m, *y_m), "the places of the rotors are in centimetres", 1e-2),
        "arms-in": ((*x_m, *y_m), "the places of the rotors are in inches", 0.0254),
        "thrust-all": (thrusts, "the thrust coefficient is that of all rotors", 1.0 / n_rotors),
        "thrust-g": (thrusts, "the thrust coefficient is in grams-force", 1e-3 * GRAVITY_M_S2),
        "full-speed-rpm": ((FULL_SPEED,), "the full rotor speed is in rpm", np.pi / 30.0),
    }
    for unit, (words, factor) in SPEED_UNITS.items():
        per = f"coefficient is per square of {words}"
        scales[f"thrust-{unit}"] = (thrusts, f"the thrust {per}", factor**-2)
        scales[f"torque-{unit}"] = (torques, f"the torque {per}", factor**-2)
        both = f"thrust and torque {per.replace(' is ', 's are ')}"
        scales[f"thrust-torque-{unit}"] = ((*thrusts, *torques), both, factor**-2)
    for name, (columns, what, factor) in scales.items():
        yield Fault(f"file-{name}", f"{what} in the vehicle file", _scaled(columns, factor))
    for degrees in BETWEEN_AXES_DEG[:2]:
        what = f"the places of the rotors are turned by {-degrees:+.0f} degrees, as of + for x,"
        places = _yawed(zip(x_m, y_m, strict=True), degrees)
        yield Fault(f"file-arms-yaw{-degrees:+.0f}", f"{what} in the vehicle file", places)
    for axis, hubs in {"x": x_m, "y": y_m}.items():
        what = f"{axis} of the places of the rotors has the other sign in the vehicle file"
        yield Fault(f"file-arms-minus-{axis}", what, _scaled(hubs, -1.0))
    turning = "the senses of all rotors are the wrong way round in the vehicle file"
    yield Fault("file-spins", turning, _scaled(spins, -1.0))


def _motors(n_rotors: int) -> Iterator[Fault]:
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
    every = (
        *_axes(),
        *_frames(),
        *_units(n_rotors),
        *(_numbers(n_rotors) if n_rotors else ()),
        *_motors(n_rotors),
    )
    return {f.name: f for f in every}


@dataclasses.dataclass(frozen=True)
class _Flight:
    """The middle minute of a flight, of at least 3000 rows.

    Attributes
    ----------
    rows : its columns as they were logged.
    numbers : of the vehicle file; empty where it is not known.
    on_grids : both at even times.
    """

    rows: Columns
    numbers: Mapping[str, Quantity]
    on_grids: OnGrids

    @classmethod
    def of(cls, frame: pd.DataFrame, numbers: Mapping[str, Quantity]) -> _Flight:
        t_s = frame["t_s"].to_numpy(dtype=float)
        rows = max(FEWEST_ROWS, int(LONGEST_S / np.median(np.diff(t_s))))
        start = max(0, (len(frame) - rows) // 2)
        known = frame.iloc[start : start + rows]
        columns = {str(c): known[c].to_numpy() for c in known}
        return cls(columns, numbers, OnGrids.of(columns, numbers))

    @property
    def names(self) -> frozenset[str]:
        """Names of its columns, and of the numbers."""
        return frozenset((*self.rows, *self.numbers))

    def read(self, fault: Fault, changed: Collection[str]) -> OnGrids:
        """Correct the columns; what stands at other times is put on a grid of its own."""
        if "t_s" in changed:
            return OnGrids.of({**self.rows, **fault.read(self.rows)}, self.numbers)
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
    Beside it stands that of the numbers of the vehicle file, whose logs have a standard deviation.
    """
    n_rotors, numbers = (len(vehicle.rotors), numbers_of(vehicle)) if vehicle else (0, {})
    read = [_Flight.of(frame, numbers) for frame in frames[:MOST_FLIGHTS]]
    fitted = [(flight, dict(pair_fits(flight.on_grids))) for flight in read]
    # those that show much come first, as they refute most
    fitted.sort(key=lambda pair: -_log_likelihood(pair[1]))
    flights = [flight for flight, _ in fitted]
    as_logged = {(k, what): fit for k, (_, fits) in enumerate(fitted) for what, fit in fits.items()}
    every = _distinct(frozenset().union(*(flight.names for flight in flights)), n_rotors)
    prior = float(np.log(PRIOR_ODDS / max(len(every), 1)))
    likely = []
    for fault, changed in every:
        mended = _mended(fault, changed, flights, as_logged)
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
    distinct: dict[frozenset[tuple[str, frozenset[tuple[str, float]]]], Fault] = {}
    for fault in faults(n_rotors).values():
        if changes := fault.changes(logged):
            key = frozenset((c, frozenset(of.items())) for c, of in changes.items())
            distinct.setdefault(key, fault)
    return tuple((fault, frozenset(c for c, _ in key)) for key, fault in distinct.items())


def _mended(
    fault: Fault,
    changed: Collection[str],
    flights: Sequence[_Flight],
    as_logged: Fits,
) -> Fits | None:
    """Compute fits of corrected flights, by flight and pair; None where one refutes the fault."""
    mended = {key: fit for key, fit in as_logged.items() if fit.columns.isdisjoint(changed)}
    so_far = 0.0
    for k, flight in enumerate(flights):
        for what, fit in pair_fits(flight.read(fault, changed), changed):
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
    # a size that is no longer there speaks for nothing
    sized, stated = _by_pair(mended), _by_pair(as_logged)
    sizes = sum(
        size_log_likelihood(sized[what]) - size_log_likelihood(stated[what])
        for what in sorted(sized.keys() & stated.keys())
    )
    # what only changes in size has the misfit that it had, but for rounding
    same = {
        key
        for key in mended.keys() & as_logged.keys()
        if abs(mended[key].log_likelihood - as_logged[key].log_likelihood) < ROUNDING_NATS
    }
    after, before = (
        {key: fit for key, fit in of.items() if key not in same} for of in (mended, as_logged)
    )
    gain = _log_likelihood(after) - _log_likelihood(before)
    windows = sum(fit.windows for fit in (after | before).values())
    if windows == 0.0:
        return sizes
    # geometric means over these windows
    misfit, left = (np.exp(-2.0 * nats / windows) for nats in (_log_likelihood(before), gain))
    largest = AGREED_MISFIT if misfit < AGREED_MISFIT else LARGEST_MISFIT
    return gain + sizes if left <= largest else 0.0


def _log_likelihood(fits: Mapping[Any, PairFit]) -> float:
    return sum(fit.log_likelihood for fit in fits.values())


def _by_pair(fits: Fits) -> dict[str, list[PairFit]]:
    of_pair: dict[str, list[PairFit]] = {}
    for (_, what), fit in fits.items():
        if fit.log_size is not None:
            of_pair.setdefault(what, []).append(fit)
    return of_pair


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
    options = [f"--mend {f.name}" for f in alike[:3] if not f.in_file]
    mend = f"; {' or '.join(options)} reads it so" if options else "; correct the vehicle file"
    return f"its streams do not fit one another as they are told: {what} (odds {odds} : 1){mend}"
