"""How a log may have to be read otherwise than its columns say: order, sign, frame and unit.

Kinematics ties the streams of a rigid body to one another, whatever flies. Body rates are the
turning of the attitude. The accelerometer turned into the world is the acceleration. Velocity is
the derivative of position. Unlike rotors turn the vehicle about the axes of its mixer. Every fault
of :func:`faults` is a hypothesis on the columns, judged by how well the corrected columns fit one
another.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence

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
from ges.recordings.consistency import PairFit, Reading, kinematic_fits, mixer_fits
from ges.vehicle.file import Vehicle

PRIOR_ODDS = 1e-3
"""Of any fault against the log as it is told."""
MOST_PERMUTED = 4
"""Motors whose every order is tried: 8 would have 40,320."""
ALIKE_NATS = 3.0
"""Within which two faults explain the log alike."""
AGREED_MISFIT = 0.3
"""Below which two streams say the same; a factor of two between them is beyond."""
REFUTED_NATS = 20.0
"""By which a fault has to be worse than the log as it is told, so that no flight is asked more."""
LARGEST_MISFIT = 0.8
"""Of what a fault mends: beyond it the mended columns do not fit each other either."""
MOST_FLIGHTS, LONGEST_S, FEWEST_ROWS = 6, 60.0, 3000
"""That are looked at: all of a set are told alike, from beginning to end."""


Fits = Mapping[tuple[int, str], PairFit]


@dataclasses.dataclass(frozen=True)
class Fault:
    """A way in which the columns are not what their names say.

    Attributes
    ----------
    name : name of the option that corrects it; '' where the vehicle file is to be corrected.
    what : the fault in words.
    mend : function from the table (n rows) to the table as it should have been.
    motors : of a fault of the motors alone, the rotor of each column and the factor on the vehicle
        file's senses of rotation; else None.
    """

    name: str
    what: str
    mend: Callable[[pd.DataFrame], pd.DataFrame]
    motors: Reading | None = None


def _scaled(columns: Sequence[str], factor: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def mend(frame: pd.DataFrame) -> pd.DataFrame:
        return frame.assign(**{c: factor * frame[c] for c in columns if c in frame})

    return mend


def _renamed(
    columns: Sequence[str], names: Sequence[str]
) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Read the column ``columns[i]`` as ``names[i]``."""

    def mend(frame: pd.DataFrame) -> pd.DataFrame:
        pairs = zip(columns, names, strict=True)
        return frame.assign(**{there: frame[c] for c, there in pairs if c in frame})

    return mend


def _axes(columns: Sequence[str], axes: str) -> tuple[str, ...]:
    return tuple(c for c, a in zip(columns, "xyz", strict=True) if a in axes)


def _signs() -> Iterator[Fault]:
    # single axes are turned over by hand, the others by a change of frame or of convention
    streams = {
        "gyro": (BODY_RATE, ("x", "y", "z", "yz", "xyz")),
        "accelerometer": (SPECIFIC_FORCE, ("yz", "xyz")),
        "velocity": (VELOCITY, ("z", "yz")),
        "position": (POSITION, ("z", "yz")),
    }
    for stream, (columns, turned_over) in streams.items():
        for axes in turned_over:
            part = _axes(columns, axes)
            yield Fault(
                f"{stream}-minus-{axes}",
                f"{' and '.join(part)} {'has' if len(part) == 1 else 'have'} the other sign",
                _scaled(part, -1.0),
            )
    world = (POSITION, VELOCITY, POSITION_REF, VELOCITY_REF)
    for axes, frame in (("yz", "forward-right-down or north-east-down"), ("z", "down")):
        turned = [c for stream in world for c in _axes(stream, axes)]
        yield Fault(
            f"world-minus-{axes}",
            f"{' and '.join(axes)} of position, velocity and their references have the other sign,"
            f" as in a log that was half converted from {frame}",
            _scaled(turned, -1.0),
        )


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
    }
    for name, (columns, what, factor) in scales.items():
        yield Fault(name, what, _scaled(columns, factor))


def _attitudes() -> Iterator[Fault]:
    yield Fault(
        "quaternion-xyzw",
        "the quaternion stands in the order x, y, z, w",
        _renamed(QUATERNION, (*QUATERNION[1:], QUATERNION[0])),
    )
    yield Fault(
        "quaternion-inverse",
        "the quaternion turns from the world into the body",
        _scaled(QUATERNION[1:], -1.0),
    )
    yield Fault(
        "quaternion-ned",
        "the attitude is of forward-right-down axes in north-east-down",
        _scaled(QUATERNION[2:], -1.0),
    )


def _motors(n_rotors: int) -> Iterator[Fault]:
    stated = tuple(range(n_rotors))
    wrong_way = "the vehicle file has the senses of all rotors the wrong way round"
    yield Fault("", wrong_way, lambda frame: frame, (stated, -1.0))
    orders = itertools.permutations(stated) if n_rotors <= MOST_PERMUTED else ()
    for order in orders:
        if order == stated:
            continue
        motors = [str(i + 1) for i in order]
        yield Fault(
            f"motors-{''.join(motors)}",
            "commands and rotor speeds are in another order, columns 1 to"
            f" {n_rotors} of the vehicle file's rotors {' '.join(motors)}",
            _reordered(order),
            (order, 1.0),
        )


def _reordered(order: Sequence[int]) -> Callable[[pd.DataFrame], pd.DataFrame]:
    n = len(order)
    streams = [(each, [each[i] for i in order]) for each in (rotor_speed(n), command(n))]

    def mend(frame: pd.DataFrame) -> pd.DataFrame:
        for columns, names in streams:
            frame = _renamed(columns, names)(frame)
        return frame

    return mend


def faults(n_rotors: int = 4) -> dict[str, Fault]:
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
    every = (*_attitudes(), *_units(), *_signs(), *_motors(n_rotors))
    return {f.name: f for f in every}


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
    The likelihood of a reading is that of the misfits of its pairs, each of unknown noise: log p =
    -sum_k (n_k / 2) log m_k. n_k is the number of independent windows of pair k, m_k the share of
    its power that does not agree.
    """
    if not frames:
        return [], 0.0
    frames = [_middle(frame) for frame in frames[:MOST_FLIGHTS]]
    n_rotors, rotors = (len(vehicle.rotors), vehicle.rotor_arrays()) if vehicle else (0, {})
    every = faults(n_rotors).values()
    as_logged: Reading = (range(n_rotors), 1.0)
    of_motors = [f for f in every if f.motors]
    readings = [as_logged, *(f.motors for f in of_motors if f.motors)]
    mixer, *reordered = _together(lambda f: mixer_fits(f, rotors, readings), frames)
    (kinematic,) = _together(lambda f: [kinematic_fits(f)], frames)
    scores = [
        (_gain(mixer, mended), fault) for fault, mended in zip(of_motors, reordered, strict=True)
    ]
    # kinematics is exact, so that streams which agree with one another need no other reading
    agreed = bool(kinematic) and all(f.misfit < AGREED_MISFIT for f in kinematic.values())
    whole = kinematic | mixer
    for fault in () if agreed else every:
        if not fault.motors:
            mended = _mended(fault, frames, whole, lambda f: mixer_fits(f, rotors, [as_logged])[0])
            scores.append((_gain(whole, mended), fault))
    best = max((gain for gain, _ in scores), default=0.0)
    if best + np.log(PRIOR_ODDS) <= 0.0:
        return [], 0.0
    alike = [pair for pair in scores if pair[0] > best - ALIKE_NATS]
    # of two that are as likely the one that changes less
    alike.sort(key=lambda pair: (-round(pair[0], 1), len(pair[1].what)))
    return [f for _, f in alike], best + np.log(PRIOR_ODDS)


def _mended(
    fault: Fault,
    frames: Sequence[pd.DataFrame],
    as_logged: Fits,
    mixer: Callable[[pd.DataFrame], dict[str, PairFit]],
) -> Fits:
    """Compute fits of corrected flights, by flight and pair, up to one that refutes the fault."""
    mended: dict[tuple[int, str], PairFit] = {}
    for k, frame in enumerate(frames):
        better = fault.mend(frame)
        pairs = kinematic_fits(better) | mixer(better)
        mended |= {(k, what): fit for what, fit in pairs.items()}
        so_far = {key: fit for key, fit in as_logged.items() if key[0] <= k}
        if _log_likelihood(mended) < _log_likelihood(so_far) - REFUTED_NATS:
            break
    return mended


def _log_likelihood(fits: Fits) -> float:
    return sum(fit.log_likelihood for fit in fits.values())


def _middle(frame: pd.DataFrame) -> pd.DataFrame:
    """Cut the middle minute out of a long flight, with at least 3000 rows."""
    t_s = frame["t_s"].to_numpy(dtype=float)
    rows = max(FEWEST_ROWS, int(LONGEST_S / np.median(np.diff(t_s))))
    start = max(0, (len(frame) - rows) // 2)
    return frame.iloc[start : start + rows]


def _together(
    fits: Callable[[pd.DataFrame], list[dict[str, PairFit]]], frames: Sequence[pd.DataFrame]
) -> list[dict[tuple[int, str], PairFit]]:
    """Collect the fits of every reading over all flights, by flight and pair."""
    by_flight = [fits(frame) for frame in frames]
    return [
        {(k, what): fit for k, pairs in enumerate(of) for what, fit in pairs.items()}
        for of in zip(*by_flight, strict=True)
    ]


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


def _gain(as_logged: Fits, mended: Fits) -> float:
    """Compute the log likelihood that a corrected log has over the log as it is.

    It is none where what is corrected does not fit either.
    """
    changed = [fit for what, fit in mended.items() if fit != as_logged.get(what)]
    if not changed or np.mean([fit.misfit for fit in changed]) > LARGEST_MISFIT:
        return 0.0
    return _log_likelihood(mended) - _log_likelihood(as_logged)
