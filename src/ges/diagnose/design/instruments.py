"""Instruments: the part of a controller's action that the references alone explain.

A controller responds to turbulence, so commands and rotor speeds correlate with the disturbance in
a residual. A direct fit then invents motor lag and wrong inertia. The nominal simulator follows the
logged references without noise, and its action cannot depend on the disturbance. The part of a
column that it explains counts in full (two-stage least squares). In the rest the response may be as
large as the disturbances themselves. It counts as little as that bound allows: nothing, without
references and strong motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.linalg import svd
from scipy.sparse import csr_array

from ges.conventions import BODY_RATE, POSITION, QUATERNION, VELOCITY, rotor_speed
from ges.diagnose.design.residual import without_actuators
from ges.diagnose.design.weak import Windows
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import drive
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import MarkedChannel
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator import flight as sim
from ges.simulator.parameters import parameters

MOMENTS = ("moment_x", "moment_y", "moment_z")


def _reference_table(flight: Prepared) -> np.ndarray:
    """Return the references as the simulator's firmware takes them, on the flight's grid."""
    t, ref = flight.t_s, flight.stack("reference")
    # the firmware also takes the reference's acceleration, made here from its velocity
    acceleration = np.gradient(ref[:, 3:6], flight.dt_s, axis=0)
    yaw = np.unwrap(ref[:, 6])[:, None]
    excitation = flight.stack("excitation") if flight.has("excitation") else np.zeros((len(t), 4))
    return np.column_stack([ref[:, :6], acceleration, yaw, excitation])


def replay_references(
    flight: Prepared, model: Model, more: Sequence[str] = ()
) -> dict[str, np.ndarray] | None:
    """Fly the nominal vehicle along the references, without noise or disturbance.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    more : further columns of the simulator.

    Returns
    -------
    Motion, rotor speeds and ``more`` on the flight's grid, (n,) each in the units of their names.
    None where there are no references, or it cannot follow them.
    """
    if not flight.has("reference"):
        return None
    table, every = _reference_table(flight), flight.steps(settings.numerics.step_s)
    start = {f"start_{name}": float(table[0, k]) for k, name in enumerate(POSITION + VELOCITY)}
    # the replay's controller would respond to the noise of sensors, and the references know none
    quiet = {
        name: 0.0
        for name in parameters()
        if name.endswith(("_noise_rad_s", "_noise_m_s2", "_noise_m", "_noise_m_s"))
    }
    # references give no more of the attitude than the yaw: level, and rotors as in a hover
    half = 0.5 * table[0, 9]
    start |= {
        "start_q_w": float(np.cos(half)),
        "start_q_z": float(np.sin(half)),
        **{f"start_{n}": model.hover_rad_s for n in rotor_speed(model.n_rotors)},
    }
    numbers: dict[str, float | str] = {
        **model.parameters,
        **quiet,
        **start,
        "start": 1,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": flight.dt_s,
        "dt_s": flight.dt_s / every,
        "record_every": every,
        "control_every": 1,
        "telemetry_every": every,
        "duration_s": (len(table) - 1) * flight.dt_s,
    }
    numbers |= {"gear_height_m": 0.0, "gear_stiffness_N_m": 0.0}
    speeds = rotor_speed(model.n_rotors)
    columns = ("t_s", *POSITION, *VELOCITY, *QUATERNION, *BODY_RATE, *speeds, *more)
    record = sim.fly([sim.Flight(numbers, model.effects, model.terrain, table)], columns)[0]
    if record.status != "ok":
        return None
    return {
        name: np.interp(flight.t_s - flight.t_s[0], record["t_s"], record[name])
        for name in columns[1:]
    }


def instruments(
    flight: Prepared, windows: Windows, model: Model, names: Sequence[str]
) -> dict[str, np.ndarray]:
    """Compute the instruments of one flight: lagged changes of the replayed thrust or moment.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : of the vehicle.
    names : of the channels.

    Returns
    -------
    By channel, (m, k). A rotor's speed has all of these, and its commands a window and more away.

    Notes
    -----
    Means are no instruments: a trim moment has other causes than what a column would make of it.
    """
    functions, reference_flight = windows.functions, replay_references(flight, model)
    # one ahead: a window that is averaged sees what begins within it
    near = range(-1, settings.design.response_windows + 1)
    by_channel: dict[str, list[np.ndarray]] = {}
    if reference_flight is not None:
        signals = _thrust_and_moments(flight, model, reference_flight)
        by_channel = {
            base: _delayed_copies(values, flight, windows, near) for base, values in signals.items()
        }
        # velocity and accelerometer show one thrust
        by_channel["acc_z"] = by_channel["force_z"]
    if flight.has("command"):
        of_references = [
            signal for base in ("force_z", *MOMENTS) for signal in by_channel.get(base, ())
        ]
        # value, slope and curvature on either side, a window away and more
        apart = (*range(-4, -1), *range(2, 5))
        commands = zip(drive(model.n_rotors), flight.stack("command").T, strict=True)
        by_channel |= {
            name: [*_delayed_copies(u, flight, windows, apart), *of_references]
            for name, u in commands
        }
    columns = {
        name: _centred_means(by_channel[channel], functions[mark][0])
        for name in names
        for channel, mark in [MarkedChannel.of(name)]
        if channel in by_channel and mark in functions
    }
    return {name: columns.get(name, np.zeros((len(windows), 1))) for name in names}


def rotor_signals(
    flight: Prepared, windows: Windows, model: Model, speeds: np.ndarray, names: Sequence[str]
) -> dict[str, np.ndarray]:
    """Compute the rotors' thrust or moment, or a drive's command, by channel and window.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : of the vehicle.
    speeds : (n, rotors) acting rotor speeds, rad/s.
    names : of the channels.

    Returns
    -------
    By channel, (m,): the moment, N m, or the command of that name, and the thrust along body z, N,
    for every other channel. Channels of test functions that the windows lack are left out.
    """
    speeds_by_name = dict(zip(rotor_speed(model.n_rotors), speeds.T, strict=True))
    # without effects: the rotors' own thrust and moment
    signals = _thrust_and_moments(flight, model, speeds_by_name, {})
    if flight.has("command"):
        signals |= zip(drive(model.n_rotors), flight.stack("command").T, strict=True)
    functions = windows.functions
    return {
        name: functions[mark][0] @ signals.get(channel, signals["force_z"])
        for name in names
        for channel, mark in [MarkedChannel.of(name)]
        if mark in functions
    }


def _thrust_and_moments(
    flight: Prepared,
    model: Model,
    signals: Mapping[str, np.ndarray],
    effects: effect_table.Effects | None = None,
) -> dict[str, np.ndarray]:
    """Return thrust and moments along signals (n,) of the contract's names, by channel, (n,).

    Without ``effects`` those of the model but actuators are on.
    """
    samples = effect_table.Samples.from_columns({"t_s": flight.t_s - flight.t_s[0], **signals})
    on = without_actuators(model.effects) if effects is None else effects
    terrain = model.terrain if effects is None else None
    wanted = (*effect_table.FORCE_N, *effect_table.MOMENT_NM)
    replay = effect_table.replay(model.parameters, samples, on, terrain, wanted=wanted)
    moments = zip(MOMENTS, replay.moment_Nm.T, strict=True)
    return {"force_z": replay.force_N[:, 2], **dict(moments)}


def _delayed_copies(
    values: np.ndarray, flight: Prepared, windows: Windows, lags: Iterable[int]
) -> list[np.ndarray]:
    """Return a signal delayed by multiples of half a window."""
    step, t = 0.5 * windows.length_s, flight.t_s
    return [np.interp(t - lag * step, t, values) for lag in lags]


def _centred_means(signals: Sequence[np.ndarray], mean: csr_array) -> np.ndarray:
    """Return window averages (m, k) of signals by the weights ``mean``, less their mean."""
    averages = mean @ np.column_stack(signals)
    return averages - averages.mean(axis=0)


def directions(z: np.ndarray) -> np.ndarray:
    """Return what instruments span.

    Parameters
    ----------
    z : (m, j) instruments.

    Returns
    -------
    (m, r) orthonormal directions.
    """
    norm = np.sqrt((z**2).sum(axis=0))
    z = z[:, norm > 0] / norm[norm > 0]
    # lags of one slow signal are nearly alike: directions that are but rounding are left out
    try:
        u, s, _ = np.linalg.svd(z, full_matrices=False)
    except np.linalg.LinAlgError:
        # LAPACK's divide and conquer may not converge on finite columns; the QR iteration does
        u, s, _ = svd(z, full_matrices=False, lapack_driver="gesvd")
    return u[:, s > settings.numerics.small * s.max(initial=0.0)]


def project(x: np.ndarray, spanned: np.ndarray) -> np.ndarray:
    """Project columns on instruments.

    Parameters
    ----------
    x : (m, k) columns.
    spanned : (m, r) of :func:`directions`.

    Returns
    -------
    (m, k).
    """
    return spanned @ (spanned.T @ x)


def instrument_strength(signal: np.ndarray, z: np.ndarray, block: np.ndarray) -> float:
    """Return the share of a signal's variance that instruments predict, on blocks of time left out.

    Parameters
    ----------
    signal : (m,).
    z : (m, j) instruments.
    block : (m,) index of the block of time.

    Notes
    -----
    Instruments that explain no more than chance would let two-stage least squares err as plain
    regression does (Bound, Jaeger and Baker 1995). What they predict of unseen time is no chance.
    """
    centred = signal - signal.mean()
    total = float(centred @ centred)
    rms = np.sqrt((z**2).mean(axis=0))
    z, missed = z[:, rms > 0] / rms[rms > 0], np.zeros_like(signal)
    # whole blocks are left out, as windows close in time predict each other;
    # columns have unit rms, so a ridge counts in windows
    fold, ridge = block % settings.statistics.folds, settings.statistics.ridge_windows
    for f in np.unique(fold):
        out = fold == f
        gram = z[~out].T @ z[~out] + ridge * np.eye(z.shape[1])
        missed[out] = centred[out] - z[out] @ np.linalg.solve(gram, z[~out].T @ centred[~out])
    return max(0.0, 1.0 - float(missed @ missed) / total) if total > 0 else 0.0
