"""The physical effects, read out of the compiled simulator, and their forces along recorded
flights.

There is no second copy of any physics in Python: :func:`table` lists what the library holds,
:func:`replay` asks the compiled functions, and :func:`evaluate` gives what one effect adds.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ges.errors import UsageError, unknown_name
from ges.simulator import _lib
from ges.simulator.terrain import Terrain

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("wrench", "actuator", "sensor", "wind", "parameter")
LAWS = {"mirror": 1, "dissipates": 2, "no_work": 4, "fades": 8, "free_air": 16}

Effects = Mapping[str, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of an effect: typical value, neutral value (NaN: cannot switch it off alone),
    fit bounds.
    """

    name: str
    unit: str
    doc: str
    default: float
    neutral: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Effect:
    """Descriptor of one compiled effect."""

    number: int
    name: str
    title: str
    equation: str
    reference: str
    modifies: str | None
    channels: tuple[str, ...]
    kind: str
    n_states: int
    laws: frozenset[str]
    parameters: tuple[Parameter, ...]

    @property
    def remembers_the_path(self) -> bool:
        """Whether its force depends on where the vehicle has been, and not on where it is alone."""
        return self.n_states > 0 and self.kind == "wrench"

    def parameter(self, name: str) -> Parameter:
        """One parameter by name."""
        return next(p for p in self.parameters if p.name == name)

    def defaults(self) -> dict[str, float]:
        """Typical parameters, at which the effect is switched on by name alone."""
        return {p.name: p.default for p in self.parameters}

    def neutral(self) -> dict[str, float]:
        """Parameters at which the effect vanishes."""
        return {p.name: p.default if math.isnan(p.neutral) else p.neutral for p in self.parameters}

    def values(self, given: Mapping[str, float]) -> list[float]:
        """Given parameters in the library's order, defaults where absent."""
        known = [p.name for p in self.parameters]
        for name in given:
            if name not in known:
                raise unknown_name(f"parameter of effect {self.name}", name, known)
        return [float(given.get(p.name, p.default)) for p in self.parameters]


def _effect(number: int, info: _lib.CEffectInfo) -> Effect:
    parameters = tuple(
        Parameter(
            p.name.decode(), p.unit.decode(), p.doc.decode(), p.value, p.neutral, p.low, p.high
        )
        for p in info.parameters[: info.n_parameters]
    )
    name, title, equation, reference, channels = (
        s.decode() for s in (info.name, info.title, info.equation, info.reference, info.channels)
    )
    laws = frozenset(law for law, bit in LAWS.items() if info.laws & bit)
    modifies = info.modifies.decode() if info.modifies else None
    return Effect(
        number,
        name,
        title,
        equation,
        reference,
        modifies,
        tuple(channels.split()),
        KINDS[info.kind],
        info.n_states,
        laws,
        parameters,
    )


@functools.lru_cache(maxsize=1)
def table() -> dict[str, Effect]:
    """Every compiled effect by name."""
    return {
        effect.name: effect
        for effect in map(_effect, *zip(*enumerate(_lib.effect_infos()), strict=True))
    }


def get(name: str) -> Effect:
    """One effect; an unknown name is a UsageError that names the nearest."""
    known = table()
    if name not in known:
        raise unknown_name("effect", name, known)
    return known[name]


def pack(effects: Effects) -> _lib.CEffects:
    """Effects as the library takes them."""
    return _lib.pack_effects(
        [(get(name).number, get(name).values(values or {})) for name, values in effects.items()]
    )


@dataclasses.dataclass(frozen=True)
class Samples:
    """Recorded samples as the library reads them: ``data`` has one row per column of ``columns()``,
    shape (k, n).
    """

    data: np.ndarray

    @staticmethod
    @functools.lru_cache(maxsize=1)
    def columns() -> dict[str, int]:
        """Row of each quantity."""
        return {name: i for i, (name, _, _) in enumerate(_lib.replay_tables()[0])}

    @classmethod
    def from_columns(cls, values: Mapping[str, np.ndarray]) -> Samples:
        """From contract columns; what is absent is 0, attitude level, battery NaN; other names are
        ignored.

        Parameters
        ----------
        values : mapping of column name to array of shape (n,); ``t_s`` is required.
        """
        if "t_s" not in values:
            raise UsageError("samples need a column t_s")
        rows = cls.columns()
        data = np.zeros((len(rows), len(values["t_s"])))
        data[rows["q_w"]] = 1.0
        data[rows["battery_V"]] = np.nan
        for name, row in rows.items():
            if name in values:
                data[row] = values[name]
        return cls(data)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Samples:
        """From a recording's table."""
        return cls.from_columns(
            {
                name: frame[name].to_numpy(dtype=float)
                for name in frame.columns
                if name in cls.columns()
            }
        )

    def __len__(self) -> int:
        return self.data.shape[1]


@dataclasses.dataclass(frozen=True)
class Replay:
    """The model along recorded samples: columns of shape (n,) by name, body frame, SI."""

    data: np.ndarray

    @staticmethod
    @functools.lru_cache(maxsize=1)
    def columns() -> dict[str, int]:
        """Row of each quantity."""
        return {name: i for i, (name, _, _) in enumerate(_lib.replay_tables()[1])}

    def __getitem__(self, name: str) -> np.ndarray:
        rows = self.columns()
        if name not in rows:
            raise unknown_name("replay column", name, rows)
        return self.data[rows[name]]

    def stack(self, *names: str) -> np.ndarray:
        """Several columns as an array of shape (n, k)."""
        return np.stack([self[name] for name in names], axis=1)

    @property
    def force_N(self) -> np.ndarray:
        """Force on the body without gravity, body frame, (n, 3)."""
        return self.stack("force_x_N", "force_y_N", "force_z_N")

    @property
    def moment_Nm(self) -> np.ndarray:
        """Moment on the body without the gyroscopic term, body frame, (n, 3)."""
        return self.stack("moment_x_Nm", "moment_y_Nm", "moment_z_Nm")

    @property
    def thrust_N(self) -> np.ndarray:
        """Thrust of each rotor, (n, 4)."""
        return self.stack(*(f"thrust_{i}_N" for i in range(1, 5)))

    @property
    def rotor_command_rad_s(self) -> np.ndarray:
        """Commanded rotor speeds before the motor lag, (n, 4)."""
        return self.stack(*(f"rotor_command_{i}_rad_s" for i in range(1, 5)))


def replay(
    parameters: Mapping[str, float],
    samples: Samples,
    effects: Effects | None = None,
    terrain: Terrain | None = None,
    lanes: int = 0,
) -> Replay:
    """Ask the compiled model for forces, drive and readings along recorded samples.

    Parameters
    ----------
    parameters : simulator parameters of the vehicle by name
        (``ges.simulator.flight.parameters()``); defaults elsewhere.
    samples : n recorded samples; in order of time where an effect has extra states.
    effects : effects that are switched on.
    terrain : ground; flat at 0 if not given.
    """
    return replay_each(parameters, samples, [effects or {}], terrain, lanes)[0]


def replay_each(
    parameters: Mapping[str, float],
    samples: Samples,
    sets: Sequence[Effects],
    terrain: Terrain | None = None,
    lanes: int = 0,
) -> list[Replay]:
    """:func:`replay` under each of several sets of effects; those with extra states fly side by
    side where they are alike.
    """
    from ges.simulator.flight import parameter_vector

    terrain = terrain or Terrain.flat()
    vector = parameter_vector({**terrain.parameters(), **parameters})
    grid = (
        _lib.pack_grid(terrain.x_m, terrain.y_m, terrain.heights_m)
        if terrain.kind == "grid"
        else None
    )
    told = _lib.replay(
        vector, [pack(e) for e in sets], grid, samples.data, len(Replay.columns()), lanes
    )
    return [Replay(data) for data in told]


def evaluate(
    name: str,
    values: Mapping[str, float],
    samples: Samples,
    parameters: Mapping[str, float],
    effects: Effects | None = None,
    terrain: Terrain | None = None,
) -> Replay:
    """What one effect adds to the model along recorded samples, beside the effects already switched
    on.

    The result's columns are differences: model with the effect less model without it.
    """
    base = dict(effects or {})
    if name in base:
        raise UsageError(
            f"effect {name} is already switched on; change its parameters instead of adding it"
            " again"
        )
    with_it = replay(parameters, samples, {**base, name: values}, terrain)
    without = replay(parameters, samples, base, terrain)
    return Replay(with_it.data - without.data)
