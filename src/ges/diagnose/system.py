"""The linear system behind a diagnosis: residuals, nuisance columns and candidate columns of every flight, whitened."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from .. import effects as effect_table
from .align import Prepared
from .candidates import Variant
from .model import Model
from .residual import channels, residual, speeds_at_work
from .weak import SHORTEST_WINDOW_S, UPDATES_PER_WINDOW, Windows, make_windows

AR_ORDER = 3


@dataclasses.dataclass(frozen=True)
class Nuisance:
    """A number that every hypothesis may adjust: sd over vehicles (declared doubt) and from flight to flight."""

    effect: str
    parameter: str
    step: float
    sd: float
    flight_sd: float

    @property
    def key(self) -> str:
        """``effect.parameter``."""
        return f"{self.effect}.{self.parameter}"


@dataclasses.dataclass(frozen=True)
class Column:
    """One column: a nuisance, or one amplitude of one variant of a candidate."""

    label: str
    nuisance: Nuisance | None = None
    variant: Variant | None = None
    amplitude: int = 0


@dataclasses.dataclass(frozen=True)
class Rows:
    """One flight: residuals ``y`` (m, C), columns ``x`` (m, C, K), NaN where a channel is not there."""

    flight: Prepared
    windows: Windows
    y: np.ndarray
    x: np.ndarray
    noise: np.ndarray

    @property
    def follows(self) -> np.ndarray:
        """(m,) True where a window directly follows the one before."""
        half = np.diff(self.windows.center)
        return np.r_[False, half == half.min()] if len(half) else np.zeros(len(self.windows), bool)


@dataclasses.dataclass(frozen=True)
class System:
    """All flights with the same channels and columns."""

    model: Model
    names: tuple[str, ...]
    columns: tuple[Column, ...]
    flights: tuple[Rows, ...]


def nuisances(model: Model, names: Iterable[str]) -> tuple[Nuisance, ...]:
    """Numbers that are always free: declared doubts, trims, and biases of sensors, each within its tolerance."""
    names, doubt, arm = set(names), model.doubts, model.arm_m
    force, moment, acc = "force_x" in names, "moment_x" in names, bool({"acc_x", "acc_y", "acc_z"} & names)
    found = [Nuisance("thrust_scale", "scale", 0.01, doubt.get("thrust_scale.scale", 0.0), 0.01)]
    if force:
        found += [Nuisance("attitude_bias", f"{a}_rad", 0.002, doubt.get(f"attitude_bias.{a}_rad", 0.01), 0.004) for a in "xy"]
    if acc:
        found += [Nuisance("accelerometer_bias", f"{a}_m_s2", 0.02, 0.1, 0.03) for a in "xyz" if f"acc_{a}" in names]
    if moment:
        found += [Nuisance("weak_rotor", f"loss_{i}", 0.005, doubt.get(f"weak_rotor.loss_{i}", 0.01), 0.003) for i in range(1, 5)]
        found += [
            Nuisance("cg_offset", f"{a}_m", 0.01 * arm, doubt.get(f"cg_offset.{a}_m", 0.01 * arm), 0.004 * arm) for a in "xy"
        ]
        found += [
            Nuisance("inertia", a + a, 0.02, doubt.get(f"inertia.{a}{a}", 0.0), 0.0) for a in "xyz" if f"moment_{a}" in names
        ]
    if "moment_z" in names:
        found.append(Nuisance("torque_coefficient", "scale", 0.02, doubt.get("torque_coefficient.scale", 0.0), 0.0))
    if "drive_1" in names or moment:
        found += [Nuisance("motor_lag", f"{w}_s", 0.002, doubt.get(f"motor_lag.{w}_s", 0.0), 0.0) for w in ("up", "down")]
    if "range" in names:
        found.append(Nuisance("rangefinder_bias", "bias_m", 0.005, 0.01, 0.003))
    return tuple(n for n in found if n.sd > 0 or n.flight_sd > 0)


def window_length_s(flights: Sequence[Prepared]) -> float:
    """Support of the test functions: 0.2 s, longer where a stream speaks more seldom."""
    used = ("velocity", "attitude", "gyro", "rotor_speed", "command")
    slowest = max((f.update_s[s] for f in flights for s in used if np.isfinite(f.update_s.get(s, np.nan))), default=0.0)
    return max(SHORTEST_WINDOW_S, UPDATES_PER_WINDOW * slowest)


def common_channels(flights: Sequence[Prepared], model: Model) -> tuple[str, ...]:
    """Channels that at least one flight can speak about, in the order of the first flight that has most of them."""
    listed = [channels(flight, model) for flight in flights]
    return tuple(dict.fromkeys(name for names in sorted(listed, key=len, reverse=True) for name in names))


def _stepped(model: Model, effect: str, values: Mapping[str, float], parameter: str, step: float) -> dict:
    now = {**effect_table.get(effect).neutral(), **model.effects.get(effect, {}), **values}
    return {effect: {**now, parameter: now[parameter] + step}}


def _reference(model: Model, column: Column) -> dict:
    """Effects that must be on already for the column's shape, with the amplitude still neutral."""
    if column.nuisance is not None or column.variant.effect in model.effects:
        return {}
    return {column.variant.effect: column.variant.parameters({})}


def _shift(model: Model, column: Column) -> tuple[dict, float]:
    if column.nuisance is not None:
        n = column.nuisance
        return _stepped(model, n.effect, {}, n.parameter, n.step), n.step
    variant, a = column.variant, column.variant.amplitudes[column.amplitude]
    return _stepped(
        model, variant.effect, variant.parameters({}) if variant.effect not in model.effects else {}, a.parameter, a.step
    ), a.step


def _drives(effects: Mapping[str, Mapping]) -> bool:
    return any(effect_table.get(name).kind == "actuator" for name in effects)


def rows(flight: Prepared, model: Model, names: Sequence[str], columns: Sequence[Column], length_s: float) -> Rows:
    """Residuals and columns of one flight; a column is minus the residual's change per unit of its coefficient."""
    windows = make_windows(flight.t_s, flight.flying, length_s)
    here = channels(flight, model)
    speeds = speeds_at_work(flight, model, model.effects)

    def at(effects: dict) -> np.ndarray:
        full = np.full((len(windows), len(names)), np.nan)
        told = residual(flight, windows, model, here, effects, None if _drives(effects) else speeds)
        full[:, [names.index(name) for name in here]] = told
        return full

    y = at({})
    x = np.empty((*y.shape, len(columns)))
    for k, column in enumerate(columns):
        shifted, step = _shift(model, column)
        reference = _reference(model, column)
        x[:, :, k] = ((at(reference) if reference and _drives(reference) else y) - at(shifted)) / step
    return Rows(flight, windows, y, x, restless(flight, windows, model, speeds))


def restless(flight: Prepared, windows: Windows, model: Model, speeds: np.ndarray) -> np.ndarray:
    """Change of thrust between two readings of the rotor speeds, over weight, (m,): how much a slow stream may hide."""
    every = flight.update_s.get("rotor_speed" if flight.has("rotor_speed") else "command", flight.dt_s)
    thrust = model.number("thrust_coefficient_N_s2") * (speeds**2).sum(axis=1)
    rate = np.abs(np.gradient(thrust, flight.dt_s)) / model.weight_N
    return windows.mean @ rate * (every if np.isfinite(every) else flight.dt_s)


def build(flights: Sequence[Prepared], model: Model, variants: Sequence[Variant], length_s: float | None = None,
          run: Callable = map) -> System:  # fmt: skip
    """Assemble the system: nuisance columns first, then every amplitude of every variant.

    Parameters
    ----------
    run : a ``map`` over flights; pass a pool's to use more cores.
    """
    names = common_channels(flights, model)
    length_s = length_s or window_length_s(flights)
    columns = [Column(n.key, nuisance=n) for n in nuisances(model, names)]
    columns += [Column(v.key, variant=v, amplitude=j) for v in variants for j in range(len(v.amplitudes))]
    made = list(run(lambda flight: rows(flight, model, names, columns, length_s), flights))
    return System(model, names, tuple(columns), tuple(made))
