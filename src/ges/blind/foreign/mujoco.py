"""MuJoCo (Todorov, Erez and Tassa 2012): actuators, fluid forces, wind and tendons as its XML has
them, flown by the concealed cases' own controller.

MuJoCo has neither rotors nor motors: an actuator is a thrust with a torque about it, and its filter
lags the thrust. A rotor speed is what such a thrust would need, sqrt(T / k). The limit follows from
MuJoCo's own generalised forces (``qfrc_fluid``, ``qfrc_constraint``, ``qfrc_spring``) along the
flown path, and from the actuators' numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ges.blind.foreign.paths import Scale, references
from ges.blind.foreign.piloted import change_by_shift, noisy_command, require_on_path
from ges.blind.foreign.sets import Concealed, Design, Place, one_by_one, untrimmed
from ges.blind.generator.airframe import TrueVehicle, draw_nominal
from ges.blind.generator.detectable import TrueFlight, body_of, driven

WORLD = "mujoco"
NEEDS = ("mujoco",)
SECONDS = 15.0
STEP_S, STEPS_A_COMMAND = 0.002, 2
GRAVITY_M_S2 = 9.81
QUAD = ((1, -1, 0, 1), (-1, 1, 0, 1), (1, 1, 0, -1), (-1, -1, 0, -1))
"""Place (x, y over the lever, z over the radius) and spin of each rotor, seen from above,
counter-clockwise positive."""
HALF = 0.5 * 3.0**0.5
HEXA = (
    (0, -1, 0, -1),
    (HALF, -0.5, 0, 1),
    (HALF, 0.5, 0, -1),
    (0, 1, 0, 1),
    (-HALF, 0.5, 0, -1),
    (-HALF, -0.5, 0, 1),
)
X8 = (*((x, y, 0.3, s) for x, y, _, s in QUAD), *((x, y, -0.3, -s) for x, y, _, s in QUAD))
# mass kg, rotor radius m, lever m, inertia kg m^2, thrust over weight, hover speed rad/s, lag s,
# semi-axes of the body m, speed m/s
VEHICLES = {
    "x1100": (1.1, 0.12, 0.16, (0.011, 0.012, 0.021), 2.2, 540.0, 0.04, (0.13, 0.11, 0.05), 3.0),
    "x150": (0.15, 0.038, 0.05, (1.6e-4, 1.7e-4, 3.0e-4), 2.6, 1500.0, 0.03, (0.05, 0.04, 0.02), 2),
    "hexa": (1.6, 0.11, 0.26, (0.026, 0.028, 0.047), 2.3, 560.0, 0.04, (0.15, 0.13, 0.06), 3.0),
    "x8": (2.2, 0.12, 0.17, (0.029, 0.031, 0.044), 2.3, 540.0, 0.045, (0.15, 0.13, 0.08), 3.0),
}
FRAMES = {"x1100": QUAD, "x150": QUAD, "hexa": HEXA, "x8": X8}
MORE_ROTORS = ("hexa", "x8")
METHOD = "force along the path, MuJoCo's own generalised forces and the actuators' numbers"


@dataclass(frozen=True)
class MujocoDesign(Design):
    """A set to fly with MuJoCo: numbers of the XML that differ from a plain vehicle in a vacuum.

    Attributes
    ----------
    drag : blunt drag coefficient of the ellipsoid; 0 leaves a vacuum.
    box : density over that of air, for the fluid model of the equivalent inertia box.
    viscosity : of the fluid, Pa s.
    wind_m_s : speed of a steady wind.
    weak : share of thrust and torque that rotor 2 loses.
    tilt_rad : tilt of all rotors towards body x; towards -y it is 0.6 of that.
    shift : shift of all rotors towards body -x over the arm; towards y it is half of that.
    curve : share of thrust that is quadratic in the command, the rest is linear.
    ceiling : greatest command, 0 to 1.
    delay_s : delay of the actuators.
    load : mass on a tendon over that of the vehicle.
    spring : stiffness of a tether, N/m.
    """

    drag: float = 0.0
    box: float = 0.0
    viscosity: float = 0.0
    wind_m_s: float = 0.0
    weak: float = 0.0
    tilt_rad: float = 0.0
    shift: float = 0.0
    curve: float = 1.0
    ceiling: float = 1.0
    delay_s: float = 0.0
    load: float = 0.0
    spring: float = 0.0

    def _effects(self) -> list[str]:
        """Return the effects that act, by the library's names."""
        names = ["parasitic_drag"] if self.drag or self.box else []
        # Stokes' drag is the same along and across the thrust, and linear
        names += ["rotor_drag", "axial_inflow"] if self.viscosity else []
        names += ["wind"] if self.wind_m_s else []
        names += ["weak_rotor"] if self.weak else []
        names += ["rotor_tilt"] if self.tilt_rad else []
        names += ["cg_offset"] if self.shift else []
        names += ["thrust_curve"] if self.curve != 1.0 else []
        names += ["rotor_saturation"] if self.ceiling < 1.0 else []
        names += ["esc_delay"] if self.delay_s else []
        names += ["slung_load"] if self.load else []
        names += ["tether"] if self.spring else []
        return names

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        Wind may be named without the drag that it acts through, and viscous drag as ``rotor_drag``
        alone. With a load ``thrust_scale`` is optional.
        """
        names = self._effects()
        moved = self.wind_m_s or self.viscosity
        instead: tuple[tuple[str, ...], ...] = ()
        if self.wind_m_s:
            instead = (tuple(n for n in names if n != "parasitic_drag"),)
        if self.viscosity:
            instead = (("rotor_drag",),)
        return self._concealed(
            names,
            "medium",
            # a weight on a rope shifts neither thrust nor balance, but its mass is lifted
            optional=("thrust_scale",) if self.load else (),
            instead=instead,
            category="single" if moved and len(names) + len(self.wrong) == 2 else "",
            places={"weak_rotor": ("rotor 2",)} if self.weak else {},
        )


def designs(half: str) -> list[MujocoDesign]:
    """Return the sets of a half: the same effects in both, a quarter larger for evaluation."""
    more = {"development": 1.0, "evaluation": 1.25}[half]
    quads = [v for v in VEHICLES if v not in MORE_ROTORS]
    listed = [MujocoDesign(v, copy=k) for v in quads for k in range(3)]
    for v in quads:
        listed += [
            MujocoDesign(v, drag=1.5 * more),
            MujocoDesign(v, drag=4.0 * more),
            MujocoDesign(v, box=12.0 * more),
            MujocoDesign(v, viscosity=0.02 * more if v == "x150" else 0.05 * more),
            MujocoDesign(v, drag=3.0, wind_m_s=3.0 * more),
            MujocoDesign(v, weak=0.08 * more),
            MujocoDesign(v, tilt_rad=0.03 * more),
            MujocoDesign(v, shift=0.04 * more),
            MujocoDesign(v, curve=1.0 - 0.4 * more),
            MujocoDesign(v, ceiling=0.8 / more**0.5),
            MujocoDesign(v, delay_s=0.016 * more),
            MujocoDesign(v, load=0.1 * more),
            MujocoDesign(v, wrong={"lag": 1.0 / (2.2 * more)}),
            MujocoDesign(v, wrong={"mass": 1.0 + (0.12 if v == "x150" else -0.12) * more}),
            MujocoDesign(v, drag=3.0 * more, weak=0.1),
            # a twentieth of that: what the limit says can hardly be told
            MujocoDesign(v, drag=0.1 * more),
            MujocoDesign(v, weak=0.006 * more),
            MujocoDesign(v, tilt_rad=0.002 * more),
        ]
    for v in MORE_ROTORS:
        listed += [MujocoDesign(v, copy=k) for k in range(2)]
        listed += [
            MujocoDesign(v, drag=4.0 * more),
            MujocoDesign(v, weak=0.12 * more),
            MujocoDesign(v, shift=0.04 * more),
            MujocoDesign(v, load=0.1 * more),
            MujocoDesign(v, wrong={"mass": 1.0 - 0.12 * more}),
            MujocoDesign(v, drag=3.0 * more, weak=0.15),
        ]
    return listed + [
        MujocoDesign("x1100", spring=2.0 * more),
        MujocoDesign("x1100", wrong={"torque": 1.0 + 0.35 * more}),
        MujocoDesign("x150", wrong={"inertia": 1.0 - 0.3 * more}),
        MujocoDesign("x1100", drag=3.0, shift=0.05 * more),
        MujocoDesign("x150", drag=3.0, load=0.1 * more),
        MujocoDesign("x1100", weak=0.1, wrong={"lag": 0.5 / more}),
        MujocoDesign("x1100", drag=3.0 * more, wrong={"mass": 0.87}),
    ]


def _fly_design(
    design: MujocoDesign, place: Place, rate_hz: float
) -> tuple[TrueVehicle, list[TrueFlight]]:
    craft = _airframe(design, place.rng("file"))
    rng = place.rng("paths")
    lag, speed = craft.true["lag"], VEHICLES[design.vehicle][-1]
    # room for a load below the lowest path
    low = 1.4 * craft.radius_m + (1.6 * LOAD_ROPE_M if design.load else 0.0)
    scale = Scale(low, craft.radius_m, speed, 0.18 + 2.0 * lag)
    plans = references(place.half, SECONDS, STEP_S, scale, rng)
    heading = rng.uniform(0.0, 2.0 * np.pi)
    return craft, [_fly(design, craft, plan, heading, rng) for plan in plans]


make = one_by_one(_fly_design, METHOD)


def _airframe(design: MujocoDesign, rng: np.random.Generator) -> TrueVehicle:
    mass, radius, lever, inertia, lift, hover, lag, _, _ = VEHICLES[design.vehicle]
    frame = FRAMES[design.vehicle]
    thrust = mass * GRAVITY_M_S2 / (len(frame) * hover**2)
    true = dict(zip(("ixx", "iyy", "izz"), inertia, strict=True))
    true |= {"mass": mass, "thrust": thrust, "torque": thrust * 0.16 * radius}
    true |= {"lag": lag, "speed": hover * float(np.sqrt(lift))}
    x, y, z = (tuple(s[k] for s in frame) for k in range(3))
    return TrueVehicle(
        design.vehicle,
        radius,
        tuple(lever * k for k in x),
        tuple(lever * k for k in y),
        0.0,
        tuple(int(s[3]) for s in frame),
        12.0,
        draw_nominal(true, rng),
        true,
        tuple(radius * k for k in z),
    )


LOAD_ROPE_M = 0.35
LEASH_M = 0.3


def _xml(design: MujocoDesign, craft: TrueVehicle, heading: float) -> str:
    """Return the model: a free body with its thrusters at sites, a fluid, a tendon."""
    true, size = craft.true, VEHICLES[design.vehicle][7]
    # MuJoCo's fluid acts by density and viscosity: without either it is a vacuum
    dense = 1.2 * design.box if design.box else 1.2 if design.drag else 0.0
    wind = design.wind_m_s * np.array([np.cos(heading), np.sin(heading)])
    shape = f'fluidshape="ellipsoid" fluidcoef="{design.drag} 0.25 1.5 0 0"' if design.drag else ""
    top, yaw = true["thrust"] * true["speed"] ** 2, true["torque"] / true["thrust"]
    sites, thrusters = [], []
    for k in range(craft.n_rotors):
        x = craft.rotor_x_m[k] - design.shift * craft.arm_m
        y = craft.rotor_y_m[k] + 0.5 * design.shift * craft.arm_m
        sites.append(f'<site name="r{k}" pos="{x} {y} {craft.hubs_m[k, 2]}"/>')
        gain = top * (1.0 - design.weak * (k == 1))
        late = f'delay="{design.delay_s}" nsample="32" interp="zoh"' if design.delay_s else ""
        thrusters.append(
            f'<general site="r{k}" gear="{design.tilt_rad} {-0.6 * design.tilt_rad} 1'
            f' 0 0 {-craft.spin[k] * yaw}" dyntype="filterexact" dynprm="{true["lag"]}"'
            f' gainprm="{gain}" ctrllimited="true" ctrlrange="0 {design.ceiling**2}" {late}/>'
        )
    body = f"""
      <body name="vehicle" pos="0 0 0"><freejoint/>
        <inertial pos="0 0 0" mass="{true["mass"]}"
          diaginertia="{true["ixx"]} {true["iyy"]} {true["izz"]}"/>
        <geom type="ellipsoid" size="{size[0]} {size[1]} {size[2]}" contype="0" conaffinity="0"
          mass="0" {shape}/>
        <site name="hook" pos="0 0 0"/>{"".join(sites)}
      </body>"""
    more, tendon = "", ""
    if design.load:
        more = f"""<body name="load" pos="0 0 -{LOAD_ROPE_M}"><freejoint/>
          <geom type="sphere" size="0.01" contype="0" conaffinity="0"
            mass="{design.load * true["mass"]}"/><site name="weight"/></body>"""
        tendon = f"""<spatial limited="true" range="0 {LOAD_ROPE_M}" solreflimit="0.006 1">
          <site site="hook"/><site site="weight"/></spatial>"""
    if design.spring:
        more = '<site name="anchor" pos="0 0 0"/>'
        tendon = f"""<spatial stiffness="{design.spring}" springlength="0 {LEASH_M}">
          <site site="hook"/><site site="anchor"/></spatial>"""
    return f"""<mujoco><option timestep="{STEP_S}" integrator="implicitfast"
        gravity="0 0 -{GRAVITY_M_S2}" density="{dense}" viscosity="{design.viscosity}"
        wind="{wind[0]} {wind[1]} 0"/>
      <worldbody>{body}{more}</worldbody><tendon>{tendon}</tendon>
      <actuator>{"".join(thrusters)}</actuator></mujoco>"""


def _fly(
    design: MujocoDesign,
    craft: TrueVehicle,
    plan: np.ndarray,
    heading: float,
    rng: np.random.Generator,
) -> TrueFlight:
    import mujoco

    model = mujoco.MjModel.from_xml_string(_xml(design, craft, heading))
    data = mujoco.MjData(model)
    lag_s = craft.true["lag"] + design.delay_s
    pilot = untrimmed(craft, design.wrong, lag_s, STEP_S * STEPS_A_COMMAND)
    # it starts in hover: rotors at rest would let it fall first
    hover = np.sqrt(craft.true["mass"] * (1.0 + design.load) * GRAVITY_M_S2 / craft.n_rotors)
    hover /= np.sqrt(craft.true["thrust"]) * craft.true["speed"]
    data.qpos[:3] = plan[:3, 0]
    data.qpos[3:7] = [np.cos(0.5 * plan[9, 0]), 0.0, 0.0, np.sin(0.5 * plan[9, 0])]
    if design.load:
        data.qpos[7:10] = plan[:3, 0] - np.array([0.0, 0.0, LOAD_ROPE_M])
        data.qpos[10] = 1.0
    data.act[:] = hover**2
    rows = []
    u = np.full(craft.n_rotors, hover)
    for k in range(plan.shape[1]):
        if k % STEPS_A_COMMAND == 0:
            turn, v, omega = _rotation(data), data.qvel[:3], data.qvel[3:6]
            u = noisy_command(pilot, plan[:, k], data.qpos[:3], v, turn, omega, rng)
        # a firmware that wants thrust in proportion to the square of its command; where the drive
        # is not what it believes the square is not what comes out
        data.ctrl[:] = (1.0 - design.curve) * u + design.curve * u**2
        mujoco.mj_forward(model, data)
        rows.append(_row(model, data, design, craft, u, plan[:, k]))
        mujoco.mj_step(model, data)
        require_on_path(design.key, data.qpos[:3], plan[:3, k], k * STEP_S)
    states = {n: np.stack([r[n] for r in rows]) for n in rows[0]}
    forces = {n: states.pop(n) for n in list(states) if n.startswith("of_")}
    return TrueFlight(STEP_S, states, _changes(design, craft, states, forces))


def _rotation(data: Any) -> np.ndarray:
    return data.xmat[1].reshape(3, 3).copy()


def _row(
    model: Any, data: Any, design: MujocoDesign, craft: TrueVehicle, u: np.ndarray, ref: np.ndarray
) -> dict[str, np.ndarray]:
    import mujoco

    turn = _rotation(data)
    top = craft.true["thrust"] * craft.true["speed"] ** 2
    row = {
        "p": data.qpos[:3],
        "v": data.qvel[:3],
        "q": data.qpos[3:7],
        "omega": data.qvel[3:6],
        "rotor_speed": np.sqrt(np.maximum(data.act * top, 0.0) / craft.true["thrust"]),
        "u": u,
        "specific_force": turn.T @ (data.qacc[:3] + np.array([0.0, 0.0, GRAVITY_M_S2])),
        "p_ref": ref[:3],
        "v_ref": ref[3:6],
        "yaw_ref": ref[9:10],
    }
    if design.load:
        # of a free joint the forces are in the world's axes, the moments in the body's
        row["of_load"] = np.concatenate([turn.T @ data.qfrc_constraint[:3], np.zeros(3)])
    if design.spring:
        row["of_tether"] = np.concatenate([turn.T @ data.qfrc_spring[:3], data.qfrc_spring[3:6]])
    if design.drag or design.box or design.viscosity:
        row["of_fluid"] = np.concatenate([turn.T @ data.qfrc_fluid[:3], data.qfrc_fluid[3:6]])
    if design.wind_m_s:
        # the drag acts in the air at rest, the wind is what moving air adds to it
        blowing = model.opt.wind.copy()
        model.opt.wind[:] = 0.0
        mujoco.mj_passive(model, data)
        calm = np.concatenate([turn.T @ data.qfrc_fluid[:3], data.qfrc_fluid[3:6]])
        model.opt.wind[:] = blowing
        mujoco.mj_passive(model, data)
        row |= {"of_wind": row["of_fluid"] - calm, "of_fluid": calm}
    return {name: np.array(value, dtype=float) for name, value in row.items()}


def _changes(
    design: MujocoDesign,
    craft: TrueVehicle,
    states: Mapping[str, np.ndarray],
    forces: Mapping[str, np.ndarray],
) -> dict[str, Any]:
    """Return what each concealed thing changed along the path."""
    changes: dict[str, Any] = {}
    for source, names in (
        ("of_load", ("slung_load",)),
        ("of_tether", ("tether",)),
        ("of_wind", ("wind",)),
    ):
        if source in forces:
            changes[names[0]] = _wrench(forces[source])
    if design.drag or design.box:
        changes["parasitic_drag"] = _wrench(forces["of_fluid"])
    if design.viscosity:
        across = forces["of_fluid"] * np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
        changes["rotor_drag"] = _wrench(across)
        changes["axial_inflow"] = _wrench(forces["of_fluid"] - across)
    body, true = body_of(craft), craft.true
    thrust = true["thrust"] * states["rotor_speed"] ** 2
    if design.weak:
        second = np.eye(craft.n_rotors)[1]
        changes["weak_rotor"] = body.wrench(-design.weak * thrust * second)
    if design.tilt_rad:
        # F = tilt T (1, -0.6, 0), M_z = sum x F_y - y F_x
        aside = design.tilt_rad * thrust * (1.0 - design.weak * np.eye(craft.n_rotors)[1])
        level = aside.sum(axis=1)
        yaw = aside @ (-0.6 * body.rotor_m[:, 0] - body.rotor_m[:, 1])
        changes["rotor_tilt"] = {
            "force_N": np.stack([level, -0.6 * level, 0.0 * level], axis=1),
            "moment_Nm": np.stack([0.0 * yaw, 0.0 * yaw, yaw], axis=1),
        }
    if design.shift:
        changes["cg_offset"] = change_by_shift(design.shift * craft.arm_m, thrust)
    drives = {
        "thrust_curve": design.curve != 1.0,
        "rotor_saturation": design.ceiling < 1.0,
        "esc_delay": design.delay_s > 0.0,
    }
    for name in [n for n, on in drives.items() if on]:
        # the only thing concealed in the drive: what a plain one makes of the same commands
        off = states["rotor_speed"] - _plain_speed(craft, states)
        changes[name] = driven(body, true, states["rotor_speed"], off)
    return changes


def _wrench(rows: np.ndarray) -> dict[str, np.ndarray]:
    return {"force_N": rows[:, :3], "moment_Nm": rows[:, 3:]}


def _plain_speed(craft: TrueVehicle, states: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the rotor speeds that the nominal kind of drive makes of the commands."""
    from scipy.signal import lfilter

    # MuJoCo's exact filter of first order on the squared command, which acts one step later
    keep, top = np.exp(-STEP_S / craft.true["lag"]), craft.true["speed"]
    start = (states["rotor_speed"][:1] / top) ** 2
    act = lfilter([0.0, 1.0 - keep], [1.0, -keep], states["u"] ** 2, axis=0, zi=start)[0]
    return np.sqrt(np.maximum(act, 0.0)) * top
