"""Where the rotors sit and which way they turn, from what an autopilot states of its vehicle.

Autopilots number motors and count their axes in their own ways. Here everything is in the body
frame of the vehicle file: x forward, y left, spin seen from above.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import FEWEST_ROTORS, MAX_ROTORS
from ges.errors import GesError, UsageError
from ges.vehicle import layouts, scaling
from ges.vehicle.file import Quantity, Rotor
from ges.vehicle.layouts import LAYOUTS, Spin
from ges.vehicle.propeller import Propeller

# Airframe numbers of PX4 before it logged CA_ROTOR*: its quadrotors, X but for those of layouts.py.
PX4_QUADS = (range(1001, 1002), range(4000, 5000), range(10015, 10021))
# Hubs that a propeller's diameter contradicts: rotors would touch, or the arms are only nominal.
TOUCHING, NOMINAL = 0.98, 2.6
ENTERED_SD_REL = 0.05
PLANE_SD = 0.15
# The upper rotor of a coaxial pair over the plane between both, in radii: a motor's height.
HALF_PAIR_RADII = 0.3
# Below this a rotor stands upright, and its axis is no direction of its own.
UPRIGHT = math.cos(math.radians(0.5))


@dataclasses.dataclass(frozen=True)
class Airframe:
    """Rotors of a multirotor, in the order of its motors.

    Attributes
    ----------
    rotors : hubs, radii and spins.
    source : where they come from, in a sentence.
    remarks : what looks wrong with them, one sentence each.
    """

    rotors: tuple[Rotor, ...]
    source: str
    remarks: tuple[str, ...] = ()

    @property
    def yaw_by_servo(self) -> bool:
        """Whether a servo turns the vehicle about yaw, as three rotors alone cannot."""
        return len(self.rotors) == 3

    @property
    def arm_m(self) -> float:
        """Root mean square distance of the hubs from the centre, m."""
        return scaling.arm_m(*(np.array([getattr(r, k).value for r in self.rotors]) for k in XY))


XY = ("x_m", "y_m")


def from_layout(frame: str, propeller: Propeller, wheelbase_m: float | None) -> Airframe:
    """Place rotors as a layout does.

    Parameters
    ----------
    frame : see :func:`ges.vehicle.layouts.layout_of`.
    propeller : its radius; without a wheelbase also the length of the arms.
    wheelbase_m : distance of opposite hubs, m; None if not known.

    Returns
    -------
    Rotors with an sd of 2 % of the arm, or 10 % where only the propeller gives it.

    Raises
    ------
    GesError
        When the layout is not known.
    """
    layout = layouts.layout_of(frame)
    plan = _plan(layout.mounts)
    if wheelbase_m is None:
        gaps = np.linalg.norm(plan[:, None] - plan[None, :], axis=2)
        # one over the other is no neighbour
        arm_m = scaling.SPACING * propeller.diameter_m / float(gaps[gaps > 1e-6].min())
        sd_rel = scaling.SPACING_SD_REL
        source = (
            f"{layout.source}; arms as long as propellers of"
            f" {propeller} usually have, to {sd_rel:.0%} (--wheelbase tells them)."
        )
    else:
        arm_m, sd_rel = 0.5 * wheelbase_m, 0.02
        source = f"{layout.source}; wheelbase as given, to {sd_rel:.0%}."
    half_pair_m = HALF_PAIR_RADII * propeller.radius_m
    levels = np.array([half_pair_m * mount.level for mount in layout.mounts])
    hubs = np.column_stack([arm_m * plan, levels])
    rotors = _rotors(hubs, [mount.spin for mount in layout.mounts], propeller, sd_rel)
    return Airframe(rotors, source)


def _plan(mounts: Sequence[layouts.Mount]) -> np.ndarray:
    """Compute the hubs in the plane, forward and left over the arm, (n, 2)."""
    angles = np.radians([mount.angle_deg for mount in mounts])
    reach = np.array([mount.reach for mount in mounts])
    return reach[:, None] * np.stack([np.cos(angles), -np.sin(angles)], axis=1)


def _rotors(
    hubs: np.ndarray,
    spins: Sequence[Spin],
    propeller: Propeller,
    sd_rel: float,
    axes: np.ndarray | None = None,
) -> tuple[Rotor, ...]:
    """Make rotors from hubs (n, 3), with axes (n, 3) where they are canted.

    No log tells well how high they lie over the centre of mass; ``z_m`` has a wide sd.
    """
    axes = np.tile([0.0, 0.0, 1.0], (len(hubs), 1)) if axes is None else axes
    plane_sd = PLANE_SD * float(np.linalg.norm(hubs[:, :2], axis=1).mean())
    return tuple(
        Rotor(
            x_m=_doubtful(x, sd_rel),
            y_m=_doubtful(y, sd_rel),
            z_m=Quantity(value=float(z) + 0.0, sd=plane_sd),
            radius_m=Quantity(value=propeller.radius_m),
            spin=spin,
            axis=None if axis[2] > UPRIGHT else tuple(axis.round(6).tolist()),
        )
        for (x, y, z), spin, axis in zip(hubs, spins, axes, strict=True)
    )


def _doubtful(value: float, sd_rel: float) -> Quantity:
    # adding 0 takes the sign off a -0
    value = float(round(value, 6)) + 0.0
    return Quantity(value=value, sd=abs(value) * sd_rel)


def from_parameters(
    kind: str, parameters: Mapping[str, float], propeller: Propeller, wheelbase_m: float | None
) -> Airframe:
    """Place rotors as an autopilot's parameters describe.

    Parameters
    ----------
    kind : ``px4``, ``ardupilot``, ``betaflight`` or ``crazyflie``.
    parameters : the autopilot's own, by their own names.
    propeller, wheelbase_m : see :func:`from_layout`.

    Returns
    -------
    Rotors in the order of the autopilot's motors.

    Raises
    ------
    GesError
        When the vehicle is no multirotor.
    UsageError
        When the layout is not known, or a parameter is missing.
    """
    if kind == "px4":
        return _px4(parameters, propeller, wheelbase_m)
    if kind == "ardupilot":
        return from_layout(_ardupilot_layout(parameters), propeller, wheelbase_m)
    if kind == "betaflight":
        count = int(parameters.get("motors", 4))
        if count != 4:
            raise UsageError(
                f"the log has {count} motors and does not say how they are arranged; give --frame,"
                f" one of {', '.join(layouts.of_rotors(count)) or 'none that is known'}"
            )
        reversed_ = parameters.get("yaw_motors_reversed", 0) == 1
        name = "betaflight-x-reversed" if reversed_ else "betaflight-x"
        return from_layout(name, propeller, wheelbase_m)
    if kind == "crazyflie":
        return from_layout("clockwise-x", propeller, wheelbase_m)
    raise UsageError(
        "the log does not say how the motors are arranged; give --frame, one of"
        f" {', '.join(LAYOUTS)}"
    )


def number_of(parameters: Mapping[str, float], key: str, default: float | None) -> float:
    """Look up a parameter of an autopilot.

    Parameters
    ----------
    parameters : the autopilot's own, by their own names.
    key : name of the parameter.
    default : value where it was not logged; None for an error.

    Raises
    ------
    UsageError
        When it is not finite, or was not logged and has no default.
    """
    value = parameters.get(key, default)
    if value is None or not math.isfinite(value):
        raise UsageError(f"the log's parameter {key} is {value}; give --frame, as in --frame x")
    return float(value)


def _ardupilot_layout(parameters: Mapping[str, float]) -> str:
    """Find the layout of FRAME_CLASS and FRAME_TYPE, or of FRAME before version 3.5."""
    group = int(number_of(parameters, "FRAME_CLASS", 1))
    if group not in layouts.ARDUPILOT:
        what = layouts.NO_MULTIROTORS.get(group, f"FRAME_CLASS {group}")
        raise GesError(f"the log is of a {what}; ges simulates multirotors")
    key = "FRAME_TYPE" if "FRAME_TYPE" in parameters else "FRAME"
    number, listed = int(number_of(parameters, key, None)), layouts.ARDUPILOT[group]
    if number not in listed:
        raise UsageError(
            f"{key} {number} is not one of {sorted(listed)} of FRAME_CLASS {group}, whose motors"
            " all point up; give --frame"
        )
    return listed[number]


def _px4(
    parameters: Mapping[str, float], propeller: Propeller, wheelbase_m: float | None
) -> Airframe:
    kind = int(number_of(parameters, "CA_AIRFRAME", 0))
    if kind != 0:
        raise GesError(
            f"the log is of no multirotor (CA_AIRFRAME {kind}); ges simulates multirotors"
            " (CA_AIRFRAME 0)"
        )
    count = int(number_of(parameters, "CA_ROTOR_COUNT", 0))
    if count == 0:
        return from_layout(_px4_airframe(parameters), propeller, wheelbase_m)
    if not FEWEST_ROTORS <= count <= MAX_ROTORS:
        raise GesError(
            f"the vehicle has {count} rotors (CA_ROTOR_COUNT); ges simulates {FEWEST_ROTORS} to"
            f" {MAX_ROTORS}"
        )
    return _control_allocation(count, parameters, propeller, wheelbase_m)


def _px4_airframe(parameters: Mapping[str, float]) -> str:
    number = int(number_of(parameters, "SYS_AUTOSTART", None))
    listed = layouts.PX4_AIRFRAMES
    if not any(number in numbers for numbers in PX4_QUADS) and number not in listed:
        raise UsageError(
            f"airframe {number} (SYS_AUTOSTART) is not known to be a multirotor; give --frame, as"
            " in --frame x, if it is one"
        )
    return listed.get(number, "x")


def _control_allocation(
    count: int, parameters: Mapping[str, float], propeller: Propeller, wheelbase_m: float | None
) -> Airframe:
    """Read rotors from CA_ROTORn_PX, PY, PZ (forward, right, down), AX, AY, AZ and KM.

    The axis is along the thrust; KM is positive for ccw.
    """
    names = [f"CA_ROTOR{i}" for i in range(count)]
    # upright by default: PX4's z points down, and so does -1 of it up
    usual = {"X": 0.0, "Y": 0.0, "Z": -1.0}
    axes = np.array([[number_of(parameters, f"{n}_A{a}", usual[a]) for a in "XYZ"] for n in names])
    axes = axes * (1.0, -1.0, -1.0)
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if not (lengths > 0).all() or not (axes[:, 2] > 0).all():
        raise GesError(
            "a rotor's axis (CA_ROTOR*_AX, AY, AZ) does not point up; ges simulates rotors that"
            " lift"
        )
    axes = axes / lengths
    frd = np.array([[number_of(parameters, f"{n}_P{a}", 0.0) for a in "XYZ"] for n in names])
    # forward-right-down to forward-left-up
    hubs = frd * (1.0, -1.0, -1.0)
    turns = [number_of(parameters, f"{n}_KM", 0.05) for n in names]
    spins: list[Spin] = ["ccw" if km > 0 else "cw" for km in turns]
    arm_m = scaling.arm_m(hubs[:, 0], hubs[:, 1])
    if not arm_m > 0 or not all(turns):
        raise UsageError(
            "CA_ROTOR* puts all rotors into one place or gives one no spin; give --frame, as in"
            " --frame x"
        )
    return _sized(hubs, spins, axes, propeller, wheelbase_m, arm_m)


def _sized(
    hubs: np.ndarray,
    spins: Sequence[Spin],
    axes: np.ndarray,
    propeller: Propeller,
    wheelbase_m: float | None,
    arm_m: float,
) -> Airframe:
    """Place rotors at the autopilot's hubs, scaled where user or propeller is more precise."""
    # published quadrotors have neighbours 1.2 to 1.5 diameters apart, which checks the lengths
    gaps = np.linalg.norm(hubs[:, None, :2] - hubs[None, :, :2], axis=2)
    # one over the other is no neighbour
    spacing = float(gaps[gaps > 0.1 * arm_m].min()) / propeller.diameter_m
    source = "Hubs and spins of CA_ROTOR*_PX, PY, PZ and KM"
    scale, sd_rel = 1.0, ENTERED_SD_REL
    remarks: tuple[str, ...] = ()
    if wheelbase_m is not None:
        scale, sd_rel = 0.5 * wheelbase_m / arm_m, 0.02
        source += f", scaled to the wheelbase as given, to {sd_rel:.0%}."
    elif spacing > NOMINAL:
        scale, sd_rel = scaling.SPACING / spacing, scaling.SPACING_SD_REL
        source += (
            f", whose lengths are nominal ({spacing:.1f} diameters apart): scaled to what"
            f" propellers of {propeller} usually have, to {sd_rel:.0%} (--wheelbase tells it)."
        )
    else:
        source += f" as entered, to {sd_rel:.0%}."
        if spacing < TOUCHING:
            remarks = (
                f"Neighbouring hubs lie {spacing * propeller.diameter_m:.3g} m apart (CA_ROTOR*),"
                f" where propellers of {propeller} would touch: check --prop, or give"
                " --wheelbase.",
            )
    return Airframe(_rotors(scale * hubs, spins, propeller, sd_rel, axes), source, remarks)
