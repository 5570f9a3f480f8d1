"""The nominal vehicle as the compiled simulator takes it, with prior sds of its numbers."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ges.simulator import effects as effect_table
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Quantity, Vehicle

SPEED = "vehicle.max_rotor_speed_rad_s"


@functools.cache
def block_of(channel: str) -> str:
    """Return the block that a channel belongs to.

    Parameters
    ----------
    channel : ``force_x``, ``drive_3`` or ``range``.

    Returns
    -------
    ``force``, ``acc``, ``moment``, ``drive`` or ``range``.
    """
    return channel.split("_")[0]


@dataclasses.dataclass(frozen=True)
class Model:
    """The simulator's model of a vehicle, with prior sds of its nominal parameters.

    Attributes
    ----------
    parameters : numbers of the simulator by name.
    effects : effects that are switched on.
    terrain : the ground.
    prior_sds : prior standard deviations by ``effect.parameter``. A nominal parameter stands as the
        effect that corrects it: ``thrust_scale.scale`` for mass and thrust coefficient,
        ``inertia.xx``. Trims of a calibrated vehicle have the sd that its file states
        (``cg_offset.x_m``).
    stated_parts : optional parts that the file states: ``moments_of_inertia``, ``torque``,
        ``motor``, ``speed``.
    plane_sd_m : prior sd of the height of the rotor plane.
    left_unexplained : rms of structure by channel that the calibration flights show as well.
    corrections : corrections of nominal parameters by ``effect.parameter`` that the model has
        already. All is linearised there; the priors stay centred on the vehicle file.
    flight_sds : further nuisances by ``effect.parameter``, a mean wind of gusts: sds of what the
        flights share, and of what each has of its own.
    act_through : effects that these act through, with their values.
    """

    parameters: Mapping[str, float]
    effects: effect_table.Effects = dataclasses.field(default_factory=dict)
    terrain: Terrain = dataclasses.field(default_factory=Terrain.flat)
    prior_sds: Mapping[str, float] = dataclasses.field(default_factory=dict)
    stated_parts: frozenset[str] = frozenset({"moments_of_inertia", "torque", "motor", "speed"})
    plane_sd_m: float = 0.0
    left_unexplained: Mapping[str, float] = dataclasses.field(default_factory=dict)
    corrections: Mapping[str, float] = dataclasses.field(default_factory=dict)
    flight_sds: Mapping[str, float] = dataclasses.field(default_factory=dict)
    act_through: effect_table.Effects = dataclasses.field(default_factory=dict)

    def number(self, name: str) -> float:
        """Return a parameter of the simulator.

        Parameters
        ----------
        name : of the parameter, ``mass_kg``.

        Returns
        -------
        Its value, or the simulator's default where the file has none.
        """
        from ges.simulator.parameters import parameters

        return float(self.parameters.get(name, parameters()[name].default))

    @property
    def weight_N(self) -> float:
        """Mass times gravity."""
        return self.number("mass_kg") * self.number("gravity_m_s2")

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return int(self.number("rotors"))

    def of_rotors(self, quantity: str) -> np.ndarray:
        """Return one quantity of every rotor.

        Parameters
        ----------
        quantity : ``x_m``, ``radius_m``, ``spin``: a name without the number of the rotor.

        Returns
        -------
        Values (n_rotors,) in the quantity's unit, body frame.
        """
        return np.array([self.number(f"rotor_{i + 1}_{quantity}") for i in range(self.n_rotors)])

    @property
    def hover_rad_s(self) -> float:
        """Rotor speed at which all rotors together carry the weight."""
        # m g = sum_i k_i a_zi Omega^2, a_z the upward part of a rotor's axis
        lifting = float((self.of_rotors("thrust") * self.of_rotors("axis_z")).sum())
        return math.sqrt(self.weight_N / (lifting * self.number("thrust_coefficient_N_s2")))

    @property
    def arm_m(self) -> float:
        """Mean distance of the hubs from the body origin, in the plane of the rotors."""
        # summed one by one: the sums of arrays round otherwise
        hubs = zip(self.of_rotors("x_m"), self.of_rotors("y_m"), strict=True)
        return float(sum((x * x + y * y) ** 0.5 for x, y in hubs)) / self.n_rotors

    @property
    def coaxial(self) -> bool:
        """Whether the disc of a rotor lies over the hub of another."""
        hubs = self.of_rotors("x_m") + 1j * self.of_rotors("y_m")
        return bool((np.abs(hubs[:, None] - hubs) < self.radius_m).sum() > self.n_rotors)

    @property
    def radius_m(self) -> float:
        """Mean rotor radius."""
        return float(sum(self.of_rotors("radius_m"))) / self.n_rotors

    @property
    def hull_m(self) -> float:
        """Distance of the farthest rotor tip from the origin; a place on the body is nearer."""
        hubs = self.of_rotors("x_m") + 1j * self.of_rotors("y_m")
        return float(np.max(np.abs(hubs) + self.of_rotors("radius_m")))

    def reference_scale(self, channel: str) -> float:
        """Return what sizes in a channel are expressed as a share of.

        Parameters
        ----------
        channel : name of a channel.

        Returns
        -------
        Weight (N), weight times arm (N m), full rotor speed (rad/s) or a rotor radius (m).
        """
        # an accelerometer's channel is m a, a force as well
        kind = block_of(channel)
        if kind in ("force", "acc"):
            return self.weight_N
        if kind == "moment":
            return self.weight_N * self.arm_m
        return self.number("max_rotor_speed_rad_s") if kind == "drive" else self.radius_m

    def with_number(self, name: str, value: float) -> Model:
        """Return a copy with one parameter of the simulator replaced.

        Parameters
        ----------
        name : of the parameter, ``mass_kg``.
        value : in the unit of the name.
        """
        return dataclasses.replace(self, parameters={**self.parameters, name: value})

    def values_of(self, effect: str) -> dict[str, float]:
        """Return the parameters of an effect, neutral where it is off.

        Parameters
        ----------
        effect : name of the effect.
        """
        return {**effect_table.get(effect).neutral(), **self.effects.get(effect, {})}

    def with_effects(self, more: effect_table.Effects) -> Model:
        """Return a copy with effects added.

        Parameters
        ----------
        more : effects with their parameters. Parameters given here replace those of effects that
            are on.
        """
        merged = {name: dict(values) for name, values in self.effects.items()}
        for name, values in more.items():
            merged[name] = {**merged.get(name, {}), **values}
        return dataclasses.replace(self, effects=merged)

    def with_effect_of(self, name: str, other: Model) -> Model:
        """Return a copy with one effect as another model has it, off where that has none.

        Parameters
        ----------
        name : of the effect.
        other : the model whose parameters it takes.
        """
        effects = {n: values for n, values in self.effects.items() if n != name}
        effects |= {name: other.effects[name]} if name in other.effects else {}
        return dataclasses.replace(self, effects=effects)


def _number(vehicle: Vehicle, path: str) -> tuple[float, float] | None:
    """Return the value and sd of a number of the vehicle file, None where the file has none.

    The path is ``mass_kg`` or ``inertia_kg_m2.xx``.
    """
    name, _, axis = path.partition(".")
    nominal = getattr(vehicle, name)
    if nominal is None:
        return None
    if isinstance(nominal, Quantity):
        return nominal.value, nominal.sd
    return getattr(nominal, axis), nominal.sd_rel * getattr(nominal, axis)


def _prior_sds_of_file(vehicle: Vehicle) -> dict[str, float]:
    """Return prior sds by ``effect.parameter`` of the effects that correct numbers of the file.

    They are relative where the correction has no unit.
    """
    prior_sds = {}
    for effect in effect_table.table().values():
        for p in (p for p in effect.parameters if p.corrects and p.role == "amplitude"):
            nominal = [n for path in p.corrects if (n := _number(vehicle, path))]
            # a scale corrects a quotient of several numbers, as k_T / m: their relative sds,
            # which are independent, add in squares
            sds = [sd / abs(value) if p.unit == "1" else sd for value, sd in nominal]
            prior_sds[f"{effect.name}.{p.name}"] = math.hypot(*sds)
    if vehicle.max_rotor_speed_rad_s:
        prior_sds[SPEED] = vehicle.max_rotor_speed_rad_s.sd
    # a calibrated file states the sd of its own trims; it goes before that of nominal parameters
    given = {
        f"{name}.{key}": quantity.sd
        for name, values in vehicle.effects.items()
        for key, quantity in values.items()
    }
    return {name: sd for name, sd in prior_sds.items() if sd > 0} | given


def from_vehicle(vehicle: Vehicle, folder: Path | str = ".") -> Model:
    """Build the model of a vehicle file.

    Parameters
    ----------
    vehicle : content of the file.
    folder : where a height map that it names lies.

    Notes
    -----
    Random effects are left out: no file knows which gusts blew.
    """
    optional_parts = {
        "moments_of_inertia": vehicle.inertia_kg_m2,
        "torque": vehicle.torque_coefficient_Nm_s2,
        "motor": vehicle.motor_time_constant_s,
        "speed": vehicle.max_rotor_speed_rad_s,
    }
    return Model(
        vehicle.parameters(),
        effect_table.only(vehicle.effect_values(), lambda e: "random" not in e.hints),
        vehicle.ground(folder),
        _prior_sds_of_file(vehicle),
        # what the file does not state is the simulator's default, which no channel may stand on
        frozenset(name for name, given in optional_parts.items() if given is not None),
        # effects know one plane of all rotors: the widest of their sds
        max(rotor.z_m.sd for rotor in vehicle.rotors),
        vehicle.left_unexplained or {},
    )
