"""The vehicle file: what is known of a vehicle, and how well.

A plain number is exactly known. ``{value, sd}`` or ``{value, sd_rel}`` states a standard deviation,
absolute or relative to the value. A fitted value far outside it is a finding.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

import numpy as np
import pydantic
import yaml
from pydantic_core import ErrorDetails

from ges.conventions import FEWEST_ROTORS, GRAVITY_M_S2, MAX_ROTORS
from ges.errors import UsageError, unknown_name
from ges.files import write_text
from ges.simulator import effects as effect_table
from ges.simulator import laws
from ges.simulator.parameters import parameters
from ges.simulator.terrain import Terrain
from ges.vehicle.layouts import Spin


class _Strict(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Quantity(_Strict):
    """A number with its standard deviation.

    Attributes
    ----------
    value : nominal value.
    sd : standard deviation in the unit of the value; 0 means exactly known.
    """

    value: float
    sd: float = pydantic.Field(default=0.0, ge=0)

    @pydantic.model_validator(mode="before")
    @classmethod
    def _read(cls, given: Any) -> Any:
        if isinstance(given, int | float) and not isinstance(given, bool):
            return {"value": given}
        # pydantic would ask for a dictionary, which nobody has to write
        if isinstance(given, str | bool) or given is None:
            raise ValueError("must be a number, or {value, sd} or {value, sd_rel}")
        if isinstance(given, Mapping) and "sd_rel" in given:
            return _with_sd(given)
        return given

    def plain(self) -> float | dict[str, float]:
        """Give the number as in a vehicle file: plain, or ``{value, sd}`` where it has an sd."""
        return {"value": self.value, "sd": self.sd} if self.sd else self.value


def _is_number(x: object) -> TypeGuard[float]:
    # a whole number may be larger than any float
    largest = sys.float_info.max
    return isinstance(x, int | float) and not isinstance(x, bool) and -largest <= x <= largest


def _with_sd(given: Mapping[str, Any]) -> dict[str, Any]:
    """Replace ``sd_rel`` by ``sd``."""
    if "sd" in given:
        raise ValueError("give sd or sd_rel, not both")
    value, share = given.get("value"), given["sd_rel"]
    if not (_is_number(value) and _is_number(share)):
        raise ValueError("sd_rel needs a value, both numbers")
    if not share >= 0:
        raise ValueError(f"sd_rel is {share:g}; it must not be negative")
    return {**{k: v for k, v in given.items() if k != "sd_rel"}, "sd": abs(value) * share}


class Estimate(Quantity):
    """A parameter of an effect in a vehicle file.

    Attributes
    ----------
    ci95 : 95 % interval, (low, high), in the unit of the value; None if not stated.
    """

    ci95: tuple[float, float] | None = None

    @pydantic.model_validator(mode="after")
    def _ordered(self) -> Estimate:
        if self.ci95 and self.ci95[0] > self.ci95[1]:
            raise ValueError(f"ci95 is {list(self.ci95)}; the lower end comes first")
        return self

    def plain(self) -> float | dict[str, Any]:
        """Give the number as a vehicle file has it, with ``ci95`` where it is stated."""
        if self.ci95 is None:
            return super().plain()
        return {
            "value": self.value,
            **({"sd": self.sd} if self.sd else {}),
            "ci95": list(self.ci95),
        }


def _positive(quantity: Quantity) -> Quantity:
    if not quantity.value > 0:
        raise ValueError(f"is {quantity.value:g}; it must be positive")
    return quantity


Positive = Annotated[Quantity, pydantic.AfterValidator(_positive)]


class Rotor(_Strict):
    """One rotor of a vehicle.

    Attributes
    ----------
    x_m, y_m, z_m : hub in the body frame FLU, from the centre of mass, m.
    radius_m : over the tip, m.
    spin : ``ccw`` or ``cw``, seen from above. A ccw rotor turns the body cw: its reaction torque is
        negative about z.
    axis : direction of its thrust in the body frame, of any length; None for body z.
    thrust_coefficient_N_s2, torque_coefficient_Nm_s2, motor_time_constant_s : of this rotor; None
        for the vehicle's.
    """

    x_m: Quantity
    y_m: Quantity
    z_m: Quantity = Quantity(value=0.0)
    radius_m: Positive
    spin: Spin
    axis: tuple[float, float, float] | None = None
    thrust_coefficient_N_s2: Positive | None = None
    torque_coefficient_Nm_s2: Positive | None = None
    motor_time_constant_s: Positive | None = None

    @pydantic.field_validator("axis")
    @classmethod
    def _upwards(cls, axis: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if axis is not None and not axis[2] > 0.0:
            raise ValueError(f"is {list(axis)}; a rotor lifts: its third number is above zero")
        return axis

    @property
    def unit_axis(self) -> np.ndarray:
        """Direction of its thrust in the body frame, (3,), of length 1."""
        axis = np.array(self.axis or (0.0, 0.0, 1.0))
        return axis / np.linalg.norm(axis)


class Inertia(_Strict):
    """Moments of inertia about the body axes.

    Attributes
    ----------
    xx, yy, zz : kg m^2.
    sd_rel : standard deviation of each, relative to its value.
    """

    xx: pydantic.PositiveFloat
    yy: pydantic.PositiveFloat
    zz: pydantic.PositiveFloat
    sd_rel: float = pydantic.Field(default=0.0, ge=0)


class GroundFile(_Strict):
    """Ground under the flights.

    Attributes
    ----------
    kind : ``flat``, or ``grid`` for a height map.
    z_m : height of flat ground in the world, m.
    file : .npz file of the height map, beside the vehicle file; None for flat ground.
    """

    kind: Literal["flat", "grid"] = "flat"
    z_m: float = 0.0
    file: str | None = None

    @pydantic.model_validator(mode="after")
    def _complete(self) -> GroundFile:
        if (self.kind == "grid") != bool(self.file):
            raise ValueError("kind grid needs a file, kind flat takes none")
        # it is copied to where a diagnosis is written, and must not leave that folder
        if self.file and (Path(self.file).name != self.file or Path(self.file).suffix != ".npz"):
            raise ValueError(
                f"the height map '{self.file}' must lie beside the vehicle file; give its name"
                " alone, as in ground.npz"
            )
        return self


class Law(_Strict):
    """Force or moment on the body that no effect of the library has.

    Attributes
    ----------
    channel : one of :data:`ges.simulator.laws.CHANNELS`, body frame.
    form : sum of terms, as :mod:`ges.simulator.laws` writes it.
    sd : standard deviation of each coefficient; empty where they are exactly known.
    """

    channel: str
    form: str
    sd: tuple[Annotated[float, pydantic.Field(ge=0)], ...] = ()

    @pydantic.model_validator(mode="after")
    def _readable(self) -> Law:
        try:
            count = len(self.terms())
        except UsageError as error:
            # pydantic collects what is a ValueError
            raise ValueError(str(error)) from None
        if self.sd and len(self.sd) != count:
            raise ValueError(f"sd has {len(self.sd)} numbers, the form {count} terms; one for each")
        return self

    def terms(self) -> dict[laws.Term, float]:
        """Give the coefficients by term, as :func:`ges.simulator.laws.parse` reads them."""
        return laws.parse(self.channel, self.form)


class Vehicle(_Strict):
    """Content of a vehicle file: what the simulator takes a vehicle to be.

    A number is a :class:`Quantity`, which has its standard deviation.

    Attributes
    ----------
    name : for people.
    mass_kg : as flown.
    inertia_kg_m2 : about the body axes; None for the simulator's default.
    rotors : 3 to 16, in the order of the recorded columns.
    thrust_coefficient_N_s2 : k in T = k w^2 of a rotor, out of ground effect; it does not follow
        ``rho_kg_m3``.
    torque_coefficient_Nm_s2 : k_q in the reaction torque k_q w^2; None for the simulator's default.
    motor_time_constant_s : first-order lag of rotor speed behind its command; None for the default.
    max_rotor_speed_rad_s : at full command; None for the simulator's default.
    rho_kg_m3 : density of the air.
    terrain : ground under the flights.
    effects : effects that the simulator is to model, by name and parameter.
    laws : forces and moments beside the effects, at most one law a channel.
    left_unexplained : rms of the residual that the flights of a calibration leave, by channel:
        ``force_z`` in N, ``moment_y`` in N m. A key with ``_size`` is the largest that the residual
        gets anywhere.

    Examples
    --------
    >>> len(vehicle.rotors), vehicle.rotors[0].spin
    (4, 'cw')
    >>> round(vehicle.hover_speed_rad_s())
    469
    """

    name: str
    mass_kg: Positive
    inertia_kg_m2: Inertia | None = None
    rotors: tuple[Rotor, ...]
    thrust_coefficient_N_s2: Positive
    torque_coefficient_Nm_s2: Positive | None = None
    motor_time_constant_s: Positive | None = None
    max_rotor_speed_rad_s: Positive | None = None
    rho_kg_m3: Positive = Quantity(value=1.225)
    terrain: GroundFile = GroundFile()
    effects: dict[str, dict[str, Estimate]] = {}
    laws: tuple[Law, ...] = ()
    left_unexplained: dict[str, Annotated[float, pydantic.Field(ge=0)]] | None = None

    @pydantic.field_validator("rotors")
    @classmethod
    def _some(cls, rotors: tuple[Rotor, ...]) -> tuple[Rotor, ...]:
        if not FEWEST_ROTORS <= len(rotors) <= MAX_ROTORS:
            raise ValueError(
                f"{len(rotors)} are listed; a multirotor has {FEWEST_ROTORS} to {MAX_ROTORS}"
            )
        hubs = [(r.x_m.value, r.y_m.value, r.z_m.value) for r in rotors]
        for i, hub in enumerate(hubs):
            if hub in hubs[:i]:
                raise ValueError(
                    f"rotors {hubs.index(hub) + 1} and {i + 1} are in one place; coaxial ones"
                    " differ in z_m"
                )
        return rotors

    @pydantic.field_validator("laws")
    @classmethod
    def _once(cls, given: tuple[Law, ...]) -> tuple[Law, ...]:
        channels = [law.channel for law in given]
        for channel in channels:
            if channels.count(channel) > 1:
                raise ValueError(f"{channel} has more than one law; write their sum as one form")
        return given

    @pydantic.model_validator(mode="before")
    @classmethod
    def _empty_effects(cls, given: Any) -> Any:
        # an effect written without parameters reads as None
        if isinstance(given, Mapping) and isinstance(given.get("effects"), Mapping):
            return {
                **given,
                "effects": {name: values or {} for name, values in given["effects"].items()},
            }
        return given

    def rotor_arrays(self) -> dict[str, np.ndarray]:
        """Give the numbers of all rotors as arrays (n_rotors,).

        Returns
        -------
        - ``x_m``, ``y_m``, ``z_m``, ``radius_m``: hub in the body frame FLU and radius, m.
        - ``spin``: +1 ccw seen from above, -1 cw. The reaction torque about z is ``-spin k_q w^2``.
        - ``axis_x``, ``axis_y``, ``axis_z``: unit vector of the thrust, body frame.
        - ``thrust``, ``torque``, ``lag``: own coefficient or time constant over the vehicle's.
        """
        arrays = {
            name: np.array([getattr(r, name).value for r in self.rotors])
            for name in ("x_m", "y_m", "z_m", "radius_m")
        }
        axes = np.stack([r.unit_axis for r in self.rotors], axis=1)
        return {
            **arrays,
            "spin": np.array([1.0 if r.spin == "ccw" else -1.0 for r in self.rotors]),
            **{f"axis_{a}": axis for a, axis in zip("xyz", axes, strict=True)},
            **self._own_shares(),
        }

    def _own_shares(self) -> dict[str, np.ndarray]:
        """Divide each rotor's own coefficients and lag by the vehicle's, (n_rotors,)."""
        own = {
            "thrust": "thrust_coefficient_N_s2",
            "torque": "torque_coefficient_Nm_s2",
            "lag": "motor_time_constant_s",
        }
        return {
            short: np.array(
                [
                    given.value / usual.value
                    if (given := getattr(rotor, name)) and (usual := getattr(self, name))
                    else 1.0
                    for rotor in self.rotors
                ]
            )
            for short, name in own.items()
        }

    def hover_speed_rad_s(self) -> float:
        """Compute the rotor speed at hover, out of ground effect.

        Returns
        -------
        w = sqrt(m g / (n k)) in rad/s, with the vehicle's thrust coefficient k for all n rotors.
        """
        per_rotor = self.mass_kg.value * GRAVITY_M_S2 / len(self.rotors)
        return float(np.sqrt(per_rotor / self.thrust_coefficient_N_s2.value))

    def effect_values(self) -> dict[str, dict[str, float]]:
        """Give the effects as plain numbers.

        Returns
        -------
        Values by effect and parameter; laws stand under :data:`ges.simulator.laws.LAW`, by term.
        """
        values = {
            name: {key: q.value for key, q in values.items()}
            for name, values in self.effects.items()
        }
        terms = {t.key: c for law in self.laws for t, c in law.terms().items()}
        return {**values, laws.LAW: terms} if terms else values

    def parameters(self) -> dict[str, float]:
        """Give the numbers of the vehicle as parameters of the simulator.

        Returns
        -------
        Values by name of :func:`ges.simulator.parameters.parameters`; what the file leaves out is
        left out.
        """
        named = {
            "mass_kg": self.mass_kg,
            "thrust_coefficient_N_s2": self.thrust_coefficient_N_s2,
            "torque_coefficient_Nm_s2": self.torque_coefficient_Nm_s2,
            "motor_time_constant_s": self.motor_time_constant_s,
            "max_rotor_speed_rad_s": self.max_rotor_speed_rad_s,
            "rho_kg_m3": self.rho_kg_m3,
        }
        values = {key: q.value for key, q in named.items() if q is not None}
        if self.inertia_kg_m2:
            values |= {f"i{a}_kg_m2": getattr(self.inertia_kg_m2, a) for a in ("xx", "yy", "zz")}
        values["rotors"] = float(len(self.rotors))
        # where motors reach their limits, four are held one by one as the study's firmware does
        values["allocation"] = float(len(self.rotors) != 4)
        for key, array in self.rotor_arrays().items():
            values |= {f"rotor_{i}_{key}": float(v) for i, v in enumerate(array, 1)}
        return values

    def ground(self, folder: Path | str = ".") -> Terrain:
        """Load the ground.

        Parameters
        ----------
        folder : folder of the vehicle file, where a height map lies.

        Raises
        ------
        GesError
            When the height map cannot be read.
        """
        if self.terrain.file is None:
            return Terrain.flat(self.terrain.z_m)
        return Terrain.load(Path(folder) / self.terrain.file)


def _where(location: tuple) -> str:
    return ".".join(str(part) for part in location) or "the file"


def _known_keys(location: tuple) -> list[str]:
    # a key one level down may belong to any of the parts: the nearest name of all is offered
    models: list[Any] = {1: [Vehicle]}.get(
        len(location), [Inertia, Rotor, Quantity, GroundFile, Law]
    )
    return sorted(
        {name for model in models for name in model.model_fields}
        | ({"sd_rel"} if len(location) > 1 else set())
    )


def _sentence(path: str, problem: ErrorDetails) -> str:
    location = problem["loc"]
    if problem["type"] == "extra_forbidden":
        return f"{path}: {unknown_name('key', str(location[-1]), _known_keys(location))}"
    if problem["type"] == "missing":
        return f"{path}: {_where(location)} is missing; add it"
    message = problem["msg"].removeprefix("Value error, ")
    value = problem.get("input")
    met = f" (given: {value})" if isinstance(value, int | float | str) else ""
    return f"{path}: {_where(location)}: {message}{met}"


def _check_effects(vehicle: Vehicle, path: str) -> None:
    for name, values in vehicle.effects.items():
        try:
            effect_table.get(name).values({key: q.value for key, q in values.items()})
        except UsageError as error:
            raise UsageError(f"{path}: {error}") from None
        for key in values:
            if _rotor_of(name, key) > len(vehicle.rotors):
                raise UsageError(
                    f"{path}: effects.{name}.{key} is of a rotor that is not there; the vehicle has"
                    f" {len(vehicle.rotors)}"
                )


def _check_numbers(vehicle: Vehicle, path: str) -> None:
    known = parameters()
    for name, value in {**vehicle.parameters(), "terrain_z_m": vehicle.terrain.z_m}.items():
        p = known[name]
        if not p.low <= value <= p.high:
            raise UsageError(
                f"{path}: {name} is {value:g} {p.unit}; allowed is {p.low:g} to {p.high:g}"
            )


def parse_vehicle(content: Any, path: str = "vehicle") -> Vehicle:
    """Check the content of a vehicle file.

    Parameters
    ----------
    content : what YAML reads from the file.
    path : what to call the file in messages.

    Returns
    -------
    The vehicle.

    Raises
    ------
    UsageError
        One sentence: which key, the value met, what is allowed.
    """
    if not isinstance(content, Mapping):
        raise UsageError(f"{path} holds no table of keys; see docs for the vehicle file")
    try:
        vehicle = Vehicle.model_validate(content)
    except pydantic.ValidationError as error:
        # a misspelt key is told before the one that seems missing because of it
        problems = sorted(error.errors(), key=lambda p: p["type"] != "extra_forbidden")
        raise UsageError(_sentence(path, problems[0])) from None
    _check_effects(vehicle, path)
    _check_numbers(vehicle, path)
    return vehicle


def vehicle_content(vehicle: Vehicle) -> dict[str, Any]:
    """Give the content of a vehicle file: sds kept, keys in their standard order.

    Parameters
    ----------
    vehicle : the vehicle.

    Returns
    -------
    Mappings, lists and numbers that YAML can write, and :func:`parse_vehicle` can read.
    """
    content: dict[str, Any] = {}
    for key in Vehicle.model_fields:
        value = getattr(vehicle, key)
        if value is None:
            continue
        if isinstance(value, Quantity):
            content[key] = value.plain()
        elif key == "rotors":
            content[key] = [{k: _plain(v) for k, v in rotor if v is not None} for rotor in value]
        elif key == "effects":
            content[key] = {
                name: {
                    k: q.plain()
                    for k, q in values.items()
                    if _rotor_of(name, k) <= len(vehicle.rotors)
                }
                for name, values in value.items()
            }
        elif key == "laws":
            # a file without laws stays as it was before there were any
            content |= {key: [_law_content(law) for law in value]} if value else {}
        elif isinstance(value, pydantic.BaseModel):
            content[key] = value.model_dump(exclude_none=True)
        else:
            content[key] = value
    return content


def _plain(value: Any) -> Any:
    if isinstance(value, Quantity):
        return value.plain()
    return list(value) if isinstance(value, tuple) else value


def _rotor_of(effect: str, parameter: str) -> int:
    """Give the number of the rotor that a parameter of an effect belongs to, from 1; 0 for none."""
    return effect_table.get(effect).parameter(parameter).rotor


def _law_content(law: Law) -> dict[str, Any]:
    return {"channel": law.channel, "form": law.form, **({"sd": list(law.sd)} if law.sd else {})}


def save_vehicle(vehicle: Vehicle, path: str | Path) -> None:
    """Write a vehicle file, complete or not at all.

    Parameters
    ----------
    vehicle : the vehicle.
    path : file to write (YAML).

    Raises
    ------
    OSError
        When it cannot be written.

    Examples
    --------
    >>> from ges.vehicle.file import save_vehicle
    >>> save_vehicle(vehicle, "mine.yaml")
    >>> load_vehicle("mine.yaml") == vehicle
    True
    """
    write_text(path, yaml.safe_dump(vehicle_content(vehicle), sort_keys=False))
