"""The declared vehicle as the compiled simulator takes it, with the user's doubts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ges.simulator import effects as effect_table
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Quantity, Vehicle

SPEED = "vehicle.max_rotor_speed_rad_s"


def block_of(channel: str) -> str:
    """``force``, ``acc``, ``moment``, ``drive`` or ``range``."""
    return channel.split("_")[0]


@dataclasses.dataclass(frozen=True)
class Model:
    """What the engine knows of the vehicle.

    Attributes
    ----------
    parameters : numbers of the simulator by name.
    effects : effects that the vehicle file already switches on.
    terrain : the ground.
    doubts : standard deviations by ``effect.parameter``: how far the declared numbers may honestly
        be off, put as the effect that would correct them (``thrust_scale.scale`` for mass and
        thrust coefficient together, ``inertia.xx``), or the user's own doubt on a trim of a
        calibrated vehicle (``cg_offset.x_m``).
    known : parts that the file declares: ``moments_of_inertia``, ``torque``, ``motor``, ``speed``.
    plane_sd_m : doubt on the height of the rotor plane.
    left_unexplained : by channel, rms of structure that the flights it was calibrated on show too.
    moved : corrections of declared numbers, by ``effect.parameter``, that are in it already: it is
        where all is linearised, and the doubts stay about the vehicle file.
    """

    parameters: Mapping[str, float]
    effects: effect_table.Effects = dataclasses.field(default_factory=dict)
    terrain: Terrain = dataclasses.field(default_factory=Terrain.flat)
    doubts: Mapping[str, float] = dataclasses.field(default_factory=dict)
    known: frozenset[str] = frozenset({"moments_of_inertia", "torque", "motor", "speed"})
    plane_sd_m: float = 0.0
    left_unexplained: Mapping[str, float] = dataclasses.field(default_factory=dict)
    moved: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def number(self, name: str) -> float:
        """A simulator parameter, default where not declared."""
        from ges.simulator.flight import parameters

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
        """One number of every rotor, ``x_m`` or ``spin`` say, (n_rotors,) in its unit."""
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

    def whole(self, channel: str) -> float:
        """What sizes in a channel are shares of: weight, weight times arm, full rotor speed, a
        rotor radius.
        """
        # an accelerometer's channel is m a, a force as well
        kind = block_of(channel)
        if kind in ("force", "acc"):
            return self.weight_N
        if kind == "moment":
            return self.weight_N * self.arm_m
        return self.number("max_rotor_speed_rad_s") if kind == "drive" else self.radius_m

    def with_number(self, name: str, value: float) -> Model:
        """The same vehicle with one declared number replaced."""
        return dataclasses.replace(self, parameters={**self.parameters, name: value})

    def with_effects(self, more: effect_table.Effects) -> Model:
        """The same vehicle with effects added; parameters given replace those that were on."""
        merged = {name: dict(values) for name, values in self.effects.items()}
        for name, values in more.items():
            merged[name] = {**merged.get(name, {}), **values}
        return dataclasses.replace(self, effects=merged)


def _relative(quantity: Quantity | None) -> float:
    return quantity.sd / abs(quantity.value) if quantity else 0.0


def _number(vehicle: Vehicle, path: str) -> tuple[float, float] | None:
    """Value and sd of a declared number, ``inertia_kg_m2.xx``; None where it is not declared."""
    name, _, axis = path.partition(".")
    held = getattr(vehicle, name)
    if held is None:
        return None
    if isinstance(held, Quantity):
        return held.value, held.sd
    return getattr(held, axis), held.sd_rel * getattr(held, axis)


def _doubts(vehicle: Vehicle) -> dict[str, float]:
    """Doubts on what is declared, as those on the effects that correct it: as a share of it, where
    the correction has no unit.
    """
    doubts = {}
    for effect in effect_table.table().values():
        for p in (p for p in effect.parameters if p.corrects and p.role == "amplitude"):
            known = [n for path in p.corrects if (n := _number(vehicle, path))]
            # a scale corrects a quotient of several numbers, as k_T / m: their relative doubts,
            # which are independent, add in squares
            sds = [sd / abs(value) if p.unit == "1" else sd for value, sd in known]
            doubts[f"{effect.name}.{p.name}"] = math.hypot(*sds)
    if vehicle.max_rotor_speed_rad_s:
        doubts[SPEED] = vehicle.max_rotor_speed_rad_s.sd
    # a calibrated file states the doubt of its own trims; it goes before that of declared numbers
    given = {
        f"{name}.{key}": quantity.sd
        for name, values in vehicle.effects.items()
        for key, quantity in values.items()
    }
    return {name: sd for name, sd in doubts.items() if sd > 0} | given


def from_vehicle(vehicle: Vehicle, folder: Path | str = ".") -> Model:
    """Read a vehicle file's content as a model; ``folder`` is where a height map lies.

    Random effects are left out: which gusts blew, no file knows.
    """
    known = {
        "moments_of_inertia": vehicle.inertia_kg_m2,
        "torque": vehicle.torque_coefficient_Nm_s2,
        "motor": vehicle.motor_time_constant_s,
        "speed": vehicle.max_rotor_speed_rad_s,
    }
    return Model(
        vehicle.parameters(),
        {
            name: values
            for name, values in vehicle.effect_values().items()
            if "random" not in effect_table.get(name).hints
        },
        vehicle.ground(folder),
        _doubts(vehicle),
        # what the file does not state is the simulator's default, which no channel may stand on
        frozenset(name for name, given in known.items() if given is not None),
        # effects know one plane of all rotors: the widest of their doubts
        max(rotor.z_m.sd for rotor in vehicle.rotors),
        vehicle.left_unexplained or {},
    )
