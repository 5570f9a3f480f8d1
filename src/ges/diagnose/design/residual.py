"""Residuals in weak form: recorded minus modelled, by window and channel.

Blocks are ``force_*`` (from velocity), ``acc_*`` (from the accelerometer, as a force), ``moment_*``
(from the gyro), ``drive_*`` (rotor speeds against commands) and ``range``. A force shows in the
first two alike; a fault of one sensor shows in one of them only. The model side is always the
compiled library's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse import csr_array

from ges.conventions import rotor_columns, rotor_speed
from ges.diagnose.design.drives import Drive, acting_speeds, affects_drive, fly_drives
from ges.diagnose.design.motion import Motion, motion_of, turning_faults
from ges.diagnose.design.weak import Windows
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import ACC, FORCE, MOMENT
from ges.diagnose.prepare.channels import drive as drive_channels
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table

FINE = ("moment", "drive")
"""Blocks that are also compared under faster test functions: what acts within a few hundredths of a
second shows there.
"""


def with_higher_orders(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Append the channels of faster test functions.

    Parameters
    ----------
    names : channels.
    count : number of faster test functions.

    Returns
    -------
    ``moment_x/1`` is ``moment_x`` under the first of them.
    """
    fine = [name for name in names if block_of(name) in FINE]
    return (*names, *(f"{name}/{k}" for k in range(1, count + 1) for name in fine))


def flown_columns(
    flight: Prepared, model: Model, effects: effect_table.Effects
) -> dict[str, np.ndarray]:
    """Return all that the library reads of every sample, with the acting rotor speeds.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : that are on. Actuators have made the speeds.

    Returns
    -------
    State columns (n,) in the units of their names, with sensor faults undone.
    """
    motion = motion_of(flight, model, effects)
    return _with_rotors(flight, motion, acting_speeds(flight, model, effects))


def replay_model(
    flight: Prepared, model: Model, effects: effect_table.Effects
) -> tuple[dict[str, np.ndarray], effect_table.Replay]:
    """Evaluate the compiled model along the recorded state.

    Parameters
    ----------
    flight, model, effects : as for :func:`flown_columns`.

    Returns
    -------
    The columns (n,) of :func:`flown_columns`, and the model's output.
    """
    columns = flown_columns(flight, model, effects)
    samples, modelled = effect_table.Samples.from_columns(columns), without_actuators(effects)
    return columns, effect_table.replay(model.parameters, samples, modelled, model.terrain)


def _samples(flight: Prepared, motion: Motion, speeds: np.ndarray) -> effect_table.Samples:
    """Return what the library reads, with these rotor speeds (n, rotors)."""
    return effect_table.Samples.from_columns(_with_rotors(flight, motion, speeds))


def _with_rotors(flight: Prepared, motion: Motion, speeds: np.ndarray) -> dict[str, np.ndarray]:
    n, rate = speeds.shape[1], np.gradient(speeds, flight.dt_s, axis=0)
    return {
        **motion.columns,
        **flight.path,
        **dict(zip(rotor_speed(n), speeds.T, strict=True)),
        **dict(zip(rotor_columns("rotor_acceleration_{}_rad_s2", n), rate.T, strict=True)),
    }


def without_actuators(effects: effect_table.Effects) -> dict:
    """Return the effects on what given rotor speeds do.

    Parameters
    ----------
    effects : of which actuators and :func:`range_lags` are left out.
    """
    return effect_table.only(effects, lambda e: e.kind != "actuator" and not _is_range_lag(e))


def range_lags(effects: effect_table.Effects) -> dict:
    """Return the effects with memory on a rangefinder alone.

    Parameters
    ----------
    effects : that are on.

    Notes
    -----
    With them samples depend on one another, which forces need not wait for.
    """
    return effect_table.only(effects, _is_range_lag)


def _is_range_lag(effect: effect_table.Effect) -> bool:
    return effect.n_states > 0 and effect.channels == ("range",)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """One evaluation of a flight, which the next one reuses where nothing changed.

    Attributes
    ----------
    drive, motion : of the flight.
    samples : of both, as the library reads them.
    effects : that were on.
    output : the model's, along the flight.
    range_output : the model's for a rangefinder, see :func:`_range_output`; None where its
        residual was taken over.
    measured : by channel, (m,) averages of the measured rates of change.
    residuals : by channel, (m,).
    """

    drive: Drive
    motion: Motion
    samples: effect_table.Samples
    effects: effect_table.Effects
    output: effect_table.Replay
    range_output: effect_table.Replay | None
    measured: Mapping[str, np.ndarray]
    residuals: Mapping[str, np.ndarray]

    def flies_the_same(self, drive: Drive, motion: Motion) -> bool:
        """Return whether rotor speeds and motion are those of this evaluation.

        Parameters
        ----------
        drive, motion : of another evaluation.
        """
        return motion is self.motion and (
            drive is self.drive or np.array_equal(drive.acting_speeds, self.drive.acting_speeds)
        )

    def stack(self, names: Sequence[str]) -> np.ndarray:
        """Return residuals side by side.

        Parameters
        ----------
        names : k channels.

        Returns
        -------
        (m, k).
        """
        return np.stack([self.residuals[name] for name in names], axis=1)

    def has_same_output(self, output: effect_table.Replay, motion: Motion, block: str) -> bool:
        """Return whether the model output that a block of channels depends on is the same.

        Parameters
        ----------
        output, motion : of another evaluation.
        block : of channels.
        """
        return motion is self.motion and all(
            np.array_equal(output[name], self.output[name]) for name in _OUTPUTS_OF_BLOCK[block]
        )


def residual(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    extra_effects: effect_table.Effects | None = None,
) -> np.ndarray:
    """Compute residuals, recorded minus modelled.

    Parameters
    ----------
    flight, windows, model, names, extra_effects : as for :func:`evaluate`.

    Returns
    -------
    (windows, channels) in N, N m, rad/s and m.
    """
    return evaluate(flight, windows, model, names, extra_effects).stack(names)


def evaluate(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    extra_effects: effect_table.Effects | None = None,
    reuse: Evaluation | None = None,
    drive: Drive | None = None,
    output: effect_table.Replay | None = None,
) -> Evaluation:
    """Compute the residuals of one flight, recorded minus modelled, by window and channel.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : that is evaluated.
    names : channels, those of faster test functions included (see :func:`with_higher_orders`).
    extra_effects : effects added to those of the model, for this evaluation.
    reuse : evaluation without ``extra_effects``, whose unchanged parts are shared.
    drive, output : with ``extra_effects``, where they are known.
    """
    effects = model.with_effects(extra_effects).effects if extra_effects else model.effects
    if drive is None:
        drive = (
            reuse.drive
            if reuse and not affects_drive(extra_effects or {}, model.effects)
            else fly_drives(flight, model, [effects], names)[0]
        )
    motion = (
        reuse.motion
        if reuse and not turning_faults(extra_effects or {})
        else motion_of(flight, model, effects, reuse.motion if reuse else None)
    )
    same = reuse if reuse and reuse.flies_the_same(drive, motion) else None
    samples = same.samples if same else _samples(flight, motion, drive.acting_speeds)
    modelled = without_actuators(effects)
    if output is None:
        output = (
            same.output
            if same and modelled == without_actuators(same.effects)
            else effect_table.replay(
                model.parameters, samples, modelled, model.terrain, wanted=_outputs_of(names)
            )
        )
    measured = (
        reuse.measured
        if reuse and motion is reuse.motion
        else _measured_rates(windows, names, motion)
    )
    range_output = None
    same_lags = reuse is not None and range_lags(effects) == range_lags(reuse.effects)
    residuals: dict[str, np.ndarray] = {}
    for block in dict.fromkeys(block_of(name) for name in names):
        # the effect of a column reaches few blocks: the others are those of the evaluation before
        if (
            reuse
            and (
                drive is reuse.drive
                if block == "drive"
                else reuse.has_same_output(output, motion, block)
            )
            and (block != "range" or same_lags)
        ):
            residuals.update(
                {name: value for name, value in reuse.residuals.items() if block_of(name) == block}
            )
        else:
            block_output = output
            if block == "range":
                block_output = range_output = _range_output(
                    flight, model, effects, drive, motion, output, reuse
                )
            parts = _Parts(flight, windows, model, names, drive, motion, measured, block_output)
            residuals.update(_BLOCKS[block](parts))
    return Evaluation(drive, motion, samples, effects, output, range_output, measured, residuals)


def _range_output(
    flight: Prepared,
    model: Model,
    effects: effect_table.Effects,
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
    reuse: Evaluation | None,
) -> effect_table.Replay:
    """Return the model output from which the rangefinder's residual is made.

    Range effects with memory are on here and nowhere else (see :func:`range_lags`). The attitude is
    the one that was read: on uneven ground the beam shows a patch. Its place says nothing of an
    attitude error. It is ``output`` itself without either, and that of ``reuse`` where the range
    effects are the same.
    """
    if not turning_faults(effects) and not range_lags(effects):
        return output
    range_effects = _of_the_range(effects)
    if reuse and reuse.range_output and range_effects == _of_the_range(reuse.effects):
        return reuse.range_output
    samples = _samples(flight, motion_of(flight, model, {}, motion), drive.acting_speeds)
    wanted = _outputs_of(["range"])
    return effect_table.replay(
        model.parameters, samples, range_effects, model.terrain, wanted=wanted
    )


def _of_the_range(effects: effect_table.Effects) -> dict:
    """Return the effects that a rangefinder shows, its memory included: no force is among them."""
    return effect_table.only(effects, lambda e: "range" in e.channels)


def replay_with_each(
    flight: Prepared, model: Model, base: Evaluation, sets: Sequence[effect_table.Effects]
) -> list:
    """Replay the model with each of several additions, in one batch.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    base : evaluation without additions.
    sets : additions that change neither drive nor motion.
    """
    merged = [without_actuators(model.with_effects(extra).effects) for extra in sets]
    return effect_table.replay_each(
        model.parameters, base.samples, merged, model.terrain, wanted=base.output.names
    )


def depend_on_path_alone(effects: effect_table.Effects, on: effect_table.Effects) -> bool:
    """Return whether effects have memory of the path, and change neither drive nor motion.

    Parameters
    ----------
    effects : that are added.
    on : effects that are on.
    """
    remembers = any(effect_table.get(name).remembers_the_path for name in effects)
    return remembers and not turning_faults(effects) and not affects_drive(effects, on)


def _test_functions_of(
    windows: Windows, channel: str, names: Sequence[str]
) -> list[tuple[str, csr_array, csr_array]]:
    """Return every test function of one channel: mark of its name, weights, rate weights."""
    return [(mark, *pair) for mark, pair in windows.functions.items() if channel + mark in names]


def _measured_rates(
    windows: Windows, names: Sequence[str], motion: Motion
) -> dict[str, np.ndarray]:
    """Return averages of dv_b/dt and dOmega/dt by channels of forces and moments, (m,).

    The derivative is in the test function.
    """
    rates: dict[str, np.ndarray] = {}
    if not {*FORCE}.isdisjoint(names):
        rates.update(zip(FORCE, (windows.rate @ motion.velocity_terms[0]).T, strict=True))
    for mark, _, rate in _test_functions_of(windows, MOMENT[0], names):
        rates.update(zip((n + mark for n in MOMENT), (rate @ motion.omega).T, strict=True))
    return rates


@dataclasses.dataclass(frozen=True)
class _Parts:
    """What the residual of a block of channels is made of, see :func:`evaluate`."""

    flight: Prepared
    windows: Windows
    model: Model
    names: Sequence[str]
    drive: Drive
    motion: Motion
    measured: Mapping[str, np.ndarray]
    output: effect_table.Replay


def _force(parts: _Parts) -> dict[str, np.ndarray]:
    """Return the residual m (a - g) - F in the body frame, with the nominal mass.

    In that unit a payload scales the model and not the measurement, noise and all.
    """
    apparent = parts.motion.velocity_terms[1]
    nominal_mass = parts.model.number("mass_kg")
    modelled = (nominal_mass / float(parts.output["mass_kg"][0])) * parts.output.force_N
    rest = parts.windows.mean @ (nominal_mass * apparent - modelled)
    return {n: nominal_mass * parts.measured[n] + r for n, r in zip(FORCE, rest.T, strict=True)}


def _moment(parts: _Parts) -> dict[str, np.ndarray]:
    """Return the residual I dOmega + Omega x I Omega - M in the body frame.

    It is scaled by nominal over modelled inertia. In that unit a wrong inertia scales the model and
    not the measurement. Otherwise the best fit would shrink both to nothing.
    """
    inertia = parts.output.stack("ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2")
    nominal = np.array([parts.model.number(f"i{a}_kg_m2") for a in ("xx", "yy", "zz")])
    # Omega x I Omega along principal axes: products of rates times differences of inertia
    differences = np.roll(inertia, 1, axis=1) - np.roll(inertia, -1, axis=1)
    # (1) of docs/method.md over the modelled inertia, then times the nominal one
    modelled = (parts.motion.rate_products * differences - parts.output.moment_Nm) / inertia
    rests = [
        (mark, mean @ modelled)
        for mark, mean, _ in _test_functions_of(parts.windows, MOMENT[0], parts.names)
    ]
    return {
        name + mark: inertia * (parts.measured[name + mark] + column)
        for mark, rest in rests
        for name, inertia, column in zip(MOMENT, nominal, rest.T, strict=True)
    }


def _acc(parts: _Parts) -> dict[str, np.ndarray]:
    """Return the residual of the accelerometer, as a force with the nominal mass."""
    columns = {name: f"{name}_m_s2" for name in ACC if name in parts.names}
    # as the acceleration of a force: with the nominal mass
    nominal_mass = parts.model.number("mass_kg")
    return {
        n: parts.windows.mean @ (nominal_mass * (parts.flight.columns[c] - parts.output[c]))
        for n, c in columns.items()
    }


def _drive(parts: _Parts) -> dict[str, np.ndarray]:
    """Return the residual of the rotor speeds against those that the commands make."""
    if parts.drive.commanded is None:
        raise ValueError("the drive was not flown from the commands; ask for its channels too")
    residual = parts.flight.stack("rotor_speed") - parts.drive.commanded
    residuals = [
        (mark, mean @ residual)
        for mark, mean, _ in _test_functions_of(parts.windows, "drive_1", parts.names)
    ]
    return {
        name + mark: column
        for mark, each in residuals
        for name, column in zip(drive_channels(each.shape[1]), each.T, strict=True)
    }


def _range(parts: _Parts) -> dict[str, np.ndarray]:
    """Return the residual of the rangefinder."""
    return {
        "range": parts.windows.mean @ (parts.flight.columns["range_m"] - parts.output["range_m"])
    }


_BLOCKS = {"force": _force, "moment": _moment, "acc": _acc, "drive": _drive, "range": _range}
# What of the model each block rests on; the drive rests on its speeds alone.
_OUTPUTS_OF_BLOCK = {
    "force": ("mass_kg", "force_x_N", "force_y_N", "force_z_N"),
    "moment": ("moment_x_Nm", "moment_y_Nm", "moment_z_Nm", "ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"),
    "acc": ("mass_kg", "acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"),
    "range": ("range_m",),
    "drive": (),
}


def _outputs_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return what of the model's output channels rest on."""
    blocks = dict.fromkeys(block_of(name) for name in names)
    return tuple(dict.fromkeys(o for block in blocks for o in _OUTPUTS_OF_BLOCK[block]))
