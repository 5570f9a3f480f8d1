"""Fly many vehicles abreast and keep, for every effect, what it did along the way.

Newton and Euler about the true centre of mass: velocity Verlet at 1 kHz, attitude by quaternions.
The last axis of every array is the flight. Sensors sit at the geometric centre.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ges.blind.second import air, attached, drive, ground, rotor
from ges.blind.second.pilot import G_M_S2, Cascade

DT_S = 0.001
CONTROL = 4
RHO_KG_M3 = 1.225
TURN_PER_M = 5.0
BOX = np.array([[1.0], [1.25], [1.9]])
NEUTRAL: dict[str, float] = {
    "blade_s": 0.6,
    "drag_gain": 0.0,
    "axial": 0.0,
    "edgewise": 0.0,
    "area_m2": 0.0,
    "wind_m_s": 0.0,
    "wind_rad": 0.0,
    "gust_m_s": 0.0,
    "blocked": 0.0,
    "sweep": 0.0,
    "wake_delay": 0.0,
    "levelling": 0.0,
    "fountain": 0.0,
    "sags": 0.0,
    "resistance": 0.05,
    "drain_1_s": 0.0012,
    "lag_gain": 1.0,
    "coast": 1.0,
    "frame_s": 0.0,
    "bent": 0.0,
    "cap": 9.0,
    "weak_share": 0.0,
    "weak_index": 0.0,
    "cg_x_m": 0.0,
    "cg_y_m": 0.0,
    "tilt_x_rad": 0.0,
    "tilt_y_rad": 0.0,
    "propeller_kg_m2": 0.0,
    "load_share": 0.0,
    "cord_m": 0.4,
    "hose_N_m": 0.0,
    "density": 1.0,
    "inertia_error": 1.0,
    "torque_error": 1.0,
    "magnus_s": 0.0,
    "rubbing": 0.0,
    "slosh": 0.0,
}
DRIVES = ("battery_sag", "motor_lag", "esc_delay", "thrust_curve", "rotor_saturation")


@dataclass(frozen=True)
class SecondSortie:
    """One flight to be simulated.

    Attributes
    ----------
    true, nominal : numbers of the vehicle and of its file, in SI units.
    radius_m : rotor radius.
    rotor_m : (4, 3) hubs in the body frame.
    spin : (4,) +1 for a rotor that turns counter-clockwise seen from above, else -1.
    numbers : what is concealed, as numbers that differ from :data:`NEUTRAL`.
    names : effects that act.
    plan : (11, n) references at the control rate.
    turbulence : sd of the acceleration by turbulence (m/s^2).
    charge : state of charge at the start, 0 to 1.
    seed : of the flight's own random stream.
    """

    true: Mapping[str, float]
    nominal: Mapping[str, float]
    radius_m: float
    rotor_m: np.ndarray
    spin: np.ndarray
    numbers: Mapping[str, float]
    names: Sequence[str]
    plan: np.ndarray
    turbulence: float
    charge: float
    seed: int


def _column(values: Iterable[float]) -> np.ndarray:
    return np.array(list(values), dtype=float)


class SecondSimulation:
    """Sorties of one length that are flown together, at 1 kHz.

    Parameters
    ----------
    sorties : their plans have as many columns each.
    """

    def __init__(self, sorties: Sequence[SecondSortie]) -> None:
        self.sorties, count = sorties, len(sorties)
        self.n = sorties[0].plan.shape[1]
        self.hid = {k: _column({**NEUTRAL, **s.numbers}[k] for s in sorties) for k in NEUTRAL}
        self.true = {k: _column(s.true[k] for s in sorties) for k in sorties[0].true}
        self.nominal = {k: _column(s.nominal[k] for s in sorties) for k in sorties[0].nominal}
        self.radius = _column(s.radius_m for s in sorties)
        self.plain_hub = np.stack([s.rotor_m for s in sorties], axis=-1)
        self.spin = np.stack([s.spin for s in sorties], axis=-1).astype(float)
        self.centre = np.stack([self.hid["cg_x_m"], self.hid["cg_y_m"], np.zeros(count)])
        self.hub = self.plain_hub - self.centre[None]
        self.mass, self.weight = self.true["mass"], self.true["mass"] * G_M_S2
        plain = np.stack([self.true[k] for k in ("ixx", "iyy", "izz")])
        self.plain_inertia = plain
        self.inertia = plain * self.hid["inertia_error"] ** np.array([[1.0], [1.0], [0.5]])
        self.hover = np.sqrt(self.weight / (4.0 * self.true["thrust"]))
        # momentum theory in hover, sqrt(T / (2 rho A)), a quarter of the weight a rotor
        self.induced = np.sqrt(self.weight / (8.0 * RHO_KG_M3 * np.pi * self.radius**2))
        self.spacing = 2.0 * np.abs(self.plain_hub[0, 0])
        self._tables()
        self._names()
        self._start()

    def _tables(self) -> None:
        """One blade-element table a vehicle, shared by its flights."""
        disc = RHO_KG_M3 * np.pi * self.radius**4
        thrust, tables = self.true["thrust"] / disc, {}
        keys = list(zip(np.round(self.hid["blade_s"], 6), np.round(thrust, 9), strict=True))
        for key in keys:
            if key not in tables:
                tables[key] = rotor.table_of(*key)
        self.thrust_table = np.stack([tables[k].thrust for k in keys])
        self.inplane_table = np.stack([tables[k].inplane for k in keys])
        self.near_ground_table = np.stack([tables[k].near_ground for k in keys])

    def _names(self) -> None:
        having: dict[str, list[int]] = {}
        for f, sortie in enumerate(self.sorties):
            for name in sortie.names:
                having.setdefault(name, []).append(f)
        self.having = {name: np.array(f) for name, f in having.items()}
        self.blown = np.flatnonzero((self.hid["wind_m_s"] > 0.0) | (self.hid["gust_m_s"] > 0.0))
        self.near = np.flatnonzero((self.hid["blocked"] > 0.0) | (self.hid["fountain"] > 0.0))

    def _start(self) -> None:
        count = len(self.sorties)
        first = np.stack([s.plan[:, 0] for s in self.sorties], axis=-1)
        self.p, self.v = first[:3].copy(), np.zeros((3, count))
        nothing = np.zeros(count)
        self.q = np.stack([np.cos(first[9] / 2), nothing, nothing, np.sin(first[9] / 2)])
        self.omega = np.zeros((3, count))
        self.w = np.tile(self.hover / np.sqrt(self.hid["density"]), (4, 1))
        self.w_rate = np.zeros((4, count))
        self.plain_w, self.plain_rate = self.w.copy(), self.w_rate.copy()
        self.charge = _column(s.charge for s in self.sorties)
        self.relax = np.zeros((2, count))
        # a battery at rest: only the third of the resistance that acts at once is felt
        self.volt = drive.open_circuit(self.charge) - self.hid["resistance"] / 3.0
        self.load = self.p - np.stack([nothing, nothing, self.hid["cord_m"]])
        self.load_v = np.zeros((3, count))
        self.slosh, self.slosh_v = np.zeros((2, count)), np.zeros((2, count))
        self.held_command = np.zeros((4, count))
        self.history = np.zeros((512, 4, count))
        steps = self.n * CONTROL
        shaken, blown, seen = [], [], []
        for f, sortie in enumerate(self.sorties):
            rng = np.random.default_rng(sortie.seed)
            shaken.append(air.turbulence(self.n, CONTROL * DT_S, rng) * sortie.turbulence)
            gust = self.hid["gust_m_s"][f]
            unit = air.karman_gusts(self.n, CONTROL * DT_S, 2.5, rng) if gust else 0.0
            blown.append(gust * unit * np.array([[1.0], [1.0], [0.5]]) + np.zeros((3, self.n)))
            seen.append(rng.standard_normal((9, self.n)))
        self.shaken, self.gusts = np.stack(shaken, axis=-1), np.stack(blown, axis=-1)
        self.seen = np.stack(seen, axis=-1)
        self.steps = steps
        tuned = self.true["lag"] * self.hid["lag_gain"] + 0.5 * self.hid["frame_s"]
        places = self.plain_hub[:, :2]
        self.pilot = Cascade(self.nominal, places, self.spin, tuned, CONTROL * DT_S)
        # the pilot knows the load and the air of the flights before, as an integrator would
        share = np.sqrt((1.0 + self.hid["load_share"]) / self.hid["density"])
        self.pilot.trim(self._hover_command(self.hover * share), self._steady_moment())

    def _hover_command(self, speed: np.ndarray) -> np.ndarray:
        """Return the command (F,) that holds a rotor speed, by halving."""
        low, high = np.zeros_like(speed), np.ones_like(speed)
        # bent and capped, the command's map has no closed inverse, but it only rises
        for _ in range(40):
            u = 0.5 * (low + high)
            enough = self._asked(u) > speed
            low, high = np.where(enough, low, u), np.where(enough, u, high)
        return u

    def _asked(self, u: np.ndarray) -> np.ndarray:
        """Return the speed that a command comes to, with the battery as it is."""
        share = drive.capped(drive.bent(u, self.hid["bent"]), self.hid["cap"])
        return self.true["speed"] * share * drive.speed_of_voltage(self.volt, self.hid["sags"])

    def _steady_moment(self) -> np.ndarray:
        """Return the body moment (3, F) of a weak rotor and a centre of mass aside, in hover."""
        even = self.true["thrust"] * self.hover**2 * np.ones((4, 1))
        parts = self._rotor_parts(even, -self.spin * self.true["torque"] * self.hover**2)
        return parts["weak_rotor"][3:] + parts["cg_offset"][3:]

    def run(self) -> dict[str, np.ndarray]:
        """Fly all sorties.

        Returns
        -------
        Single-precision states at the sensors, (n, width, F) at 250 Hz. ``change/<name>`` is (n, 6,
        flights that have the name): force (N) and moment (N m) of the effect, body frame.
        """
        reference = np.stack([s.plan for s in self.sorties], axis=-1)
        book: dict[str, list[np.ndarray]] = {}
        for i in range(self.steps):
            k = i // CONTROL
            self.turn = _matrix(self.q)
            if i % CONTROL == 0:
                self._blow(k)
                self.u = self._command(reference[:, k], self.seen[:, k])
            self._motors(i)
            force, moment, parts = self._loads(i)
            a = np.einsum("ijf,jf->if", self.turn, force) / self.mass
            a[2] -= G_M_S2
            spin = self._spin(moment)
            if i % CONTROL == 0:
                for name, rows in self._rows(force, spin, parts).items():
                    book.setdefault(name, []).append(rows.astype(np.float32).copy())
            self.v, old = self.v + DT_S * a, self.v
            self.p = self.p + 0.5 * DT_S * (self.v + old)
            self.omega = self.omega + DT_S * spin
            self.q = _turned(self.q, self.omega, DT_S)
        return {name: np.stack(rows) for name, rows in book.items()}

    def _spin(self, moment: np.ndarray) -> np.ndarray:
        return (moment - np.cross(self.omega, self.inertia * self.omega, axis=0)) / self.inertia

    def _blow(self, k: int) -> None:
        speed = self.hid["wind_m_s"] * air.profile(self.p[2])
        angle = self.hid["wind_rad"]
        steady = np.stack([speed * np.cos(angle), speed * np.sin(angle), 0.0 * speed])
        self.wind = steady + self.gusts[:, k]
        self.shake = self.shaken[:, k]

    def _command(self, ref: np.ndarray, noise: np.ndarray) -> np.ndarray:
        # the pilot holds the geometric centre, where the sensors sit, not the centre of mass
        seat = np.einsum("ijf,jf->if", self.turn, self.centre)
        p = self.p - seat + 0.002 * noise[:3]
        v = self.v + 0.01 * noise[3:6]
        return self.pilot.commands(ref, p, v, self.q, self.omega + 0.008 * noise[6:])

    def _motors(self, i: int) -> None:
        """A motor controller reads its command once a frame; it holds it until the next."""
        hid, top = self.hid, self.true["speed"]
        frame = np.maximum(np.round(2.0 * hid["frame_s"] / DT_S), 1.0)
        self.held_command = np.where(i % frame == 0.0, self.u, self.held_command)
        current = (self.w**3).sum(axis=0) / (4.0 * self.hover**3)
        if i % CONTROL == 0:
            battery = (self.charge, self.relax, current, hid["resistance"], hid["drain_1_s"])
            self.charge, self.relax, self.volt = drive.step_battery(*battery, CONTROL * DT_S)
        asked = self._asked(self.held_command)
        lag = self.true["lag"] * hid["lag_gain"]
        self.w, self.w_rate = drive.step_motor(self.w, self.w_rate, asked, lag, hid["coast"], DT_S)
        plain = (self.plain_w, self.plain_rate, top * self.u, self.true["lag"])
        self.plain_w, self.plain_rate = drive.step_motor(*plain, 1.0, DT_S)

    def _wrench(self, thrust: np.ndarray) -> np.ndarray:
        """Return (6, F) of rotor thrusts (4, F) at the geometric hubs."""
        x, y = self.plain_hub[:, 0], self.plain_hub[:, 1]
        total = thrust.sum(axis=0)
        moments = [(y * thrust).sum(axis=0), -(x * thrust).sum(axis=0)]
        return np.stack([0.0 * total, 0.0 * total, total, *moments, 0.0 * total])

    def _loads(self, i: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return body force and moment of everything, and the parts (6, F) by name."""
        hid, w = self.hid, self.w
        thrust, torque = self.true["thrust"] * w * w, -self.spin * self.true["torque"] * w * w
        parts = self._rotor_parts(thrust, torque)
        still = np.einsum("jif,jf->if", self.turn, self.v)
        calm = self._air_parts(still, thrust)
        parts |= calm
        # wind is what moving air adds to the forces of still air; these stay with the drags' names
        if self.blown.size:
            moving = still - np.einsum("jif,jf->if", self.turn, self.wind)
            extra = sum(self._air_parts(moving, thrust).values()) - sum(calm.values())
            parts["wind"] = extra * (hid["wind_m_s"] > 0.0)
            parts["gusts"] = extra * ((hid["gust_m_s"] > 0.0) & (hid["wind_m_s"] == 0.0))
        if self.near.size:
            parts |= self._ground_parts(still, thrust, i)
        parts |= self._attached_parts(still)
        # the parts add up to all that the nominal law T = k w^2 does not explain
        plain = self._wrench(thrust)
        plain[5] = torque.sum(axis=0)
        whole = plain + sum(parts.values())
        force = whole[:3] + np.einsum("jif,jf->if", self.turn, self.shake[:3] * self.mass)
        moment = whole[3:] + self.shake[3:] * TURN_PER_M * self.inertia
        return force, moment, parts

    def _rotor_parts(self, thrust: np.ndarray, torque: np.ndarray) -> dict[str, np.ndarray]:
        hid, one = self.hid, np.zeros_like(thrust)
        flights = np.arange(thrust.shape[1])
        one[hid["weak_index"].astype(int), flights] = hid["weak_share"]
        # a shorter blade: thrust goes with R^4, torque with R^5
        weak = self._wrench(-one * thrust)
        weak[5] = (((1.0 - one) ** 1.25 - 1.0) * torque).sum(axis=0)
        dense = self._wrench((hid["density"] - 1.0) * thrust)
        dense[5] = ((hid["density"] - 1.0) * torque).sum(axis=0)
        twisted = self._wrench(0.0 * thrust)
        twisted[5] = ((hid["torque_error"] - 1.0) * torque).sum(axis=0)
        moved = self._wrench(0.0 * thrust)
        total = thrust.sum(axis=0)
        # the hubs stay, the centre of mass moves: M = -r_cg x T
        moved[3], moved[4] = -hid["cg_y_m"] * total, hid["cg_x_m"] * total
        # the arms of two motors are bent
        bent = thrust * np.array([[1.0], [0.0], [1.0], [0.0]]) * 2.0
        aside = np.stack([hid["tilt_x_rad"] * bent, hid["tilt_y_rad"] * bent])
        tilted = self._wrench(0.0 * thrust)
        tilted[:2] = aside.sum(axis=1)
        x, y, z = (self.plain_hub[:, k] for k in range(3))
        tilted[3] = -(z * aside[1]).sum(axis=0)
        tilted[4] = (z * aside[0]).sum(axis=0)
        tilted[5] = (x * aside[1] - y * aside[0]).sum(axis=0)
        # gyroscopic moment -omega x h of the propellers, and the reaction -dh/dt of their spin-up
        stored = hid["propeller_kg_m2"] * (self.spin * self.w).sum(axis=0)
        reacting = self._wrench(0.0 * thrust)
        reacting[3], reacting[4] = -self.omega[1] * stored, self.omega[0] * stored
        reacting[5] = -hid["propeller_kg_m2"] * (self.spin * self.w_rate).sum(axis=0)
        return {
            "weak_rotor": weak,
            "thrust_scale": dense,
            "torque_coefficient": twisted,
            "cg_offset": moved,
            "rotor_tilt": tilted,
            "rotor_inertia_reaction": reacting,
        }

    def _air_parts(self, air_body: np.ndarray, thrust: np.ndarray) -> dict[str, np.ndarray]:
        """Return what moving through the air does: at every hub its own speed, v + omega x r."""
        hid = self.hid
        ox, oy, oz = self.omega
        x, y, z = (self.hub[:, k] for k in range(3))
        ex = air_body[0] + oy * z - oz * y
        ey = air_body[1] + oz * x - ox * z
        climb = air_body[2] + ox * y - oy * x
        # bounded from below, where a standing rotor would make the ratios infinite
        edge, tip = np.hypot(ex, ey), np.maximum(self.w, 0.2 * self.hover) * self.radius
        mu, lam, none = edge / tip, climb / tip, 0.0 * edge
        # each with the other's motion at rest, so that each name has a part of its own
        axial_share = rotor.look_up(self.thrust_table, none, lam) - 1.0
        lifted = rotor.look_up(self.thrust_table, mu, none) - 1.0
        size = RHO_KG_M3 * np.pi * self.radius**2 * tip**2 * hid["drag_gain"]
        size = size * rotor.look_up(self.inplane_table, mu, lam) / np.maximum(edge, 1e-6)
        fx, fy = -size * ex, -size * ey
        drag = np.stack(
            [
                fx.sum(axis=0),
                fy.sum(axis=0),
                0.0 * ox,
                -(z * fy).sum(axis=0),
                (z * fx).sum(axis=0),
                (x * fy - y * fx).sum(axis=0),
            ]
        )
        box = np.zeros_like(drag)
        box[:3] = -0.5 * RHO_KG_M3 * hid["area_m2"] * BOX * np.abs(air_body) * air_body
        return {
            "rotor_drag": drag,
            "parasitic_drag": box,
            "axial_inflow": self._wrench(hid["axial"] * axial_share * thrust),
            "translational_lift": self._wrench(hid["edgewise"] * lifted * thrust),
        }

    def _ground_parts(self, still: np.ndarray, thrust: np.ndarray, i: int) -> dict[str, np.ndarray]:
        hid, radius = self.hid, self.radius
        hub = self.p[2] + np.einsum("jf,kjf->kf", self.turn[2], self.hub)
        edge = np.hypot(still[0], still[1])
        # five points stand for the disc: a tilted one is nearer to the ground on one side
        near, swept = np.zeros_like(edge), np.zeros_like(edge)
        for dx, dy in ground.DISC_POINTS:
            height = hub + radius * (self.turn[2, 0] * dx + self.turn[2, 1] * dy)
            way, cosine = ground.wake_path(height, edge, self.induced, hid["sweep"])
            near = near + ground.blocked_share(height / radius) / len(ground.DISC_POINTS)
            part = ground.blocked_share(way / radius) * cosine
            swept = swept + part / len(ground.DISC_POINTS)
        if i % CONTROL == 0:
            self.history = np.roll(self.history, 1, axis=0)
            self.history[0] = swept
            if i == 0:
                self.history[:] = swept
        # the wake needs this long down to the ground; what it met then acts now
        ago = hid["wake_delay"] * (np.maximum(self.p[2], 0.0) + radius) / self.induced
        index = np.minimum((ago / (CONTROL * DT_S)).astype(int), len(self.history) - 1)
        late = self.history[index, :, np.arange(len(index))].T
        late = np.where(hid["wake_delay"] > 0.0, late, swept)
        # near, then swept by the motion, then late: each name has what it adds to the one before
        gains = [
            rotor.near_ground_thrust(self.near_ground_table, 1.0 - hid["blocked"] * c) - 1.0
            for c in (near, swept, late)
        ]
        lift = hid["fountain"] * ground.fountain_share(self.p[2], self.spacing)
        fountain = self._wrench(0.0 * thrust)
        fountain[2] = lift * thrust.sum(axis=0) * np.clip(self.turn[2, 2], 0.0, 1.0) ** 4
        level = self._wrench(0.0 * thrust)
        lever = hid["levelling"] * self.weight * self.spacing
        level[3] = lever * ground.levelling(self.turn[2, 1], self.p[2], self.spacing)
        level[4] = lever * ground.levelling(-self.turn[2, 0], self.p[2], self.spacing)
        return {
            "ground_effect": self._wrench(gains[0] * thrust),
            "ground_effect_forward_flight": self._wrench((gains[1] - gains[0]) * thrust),
            "ground_effect_lag": self._wrench((gains[2] - gains[1]) * thrust),
            "ground_effect_moment": level,
            "fountain_lift": fountain,
        }

    def _attached_parts(self, still: np.ndarray) -> dict[str, np.ndarray]:
        hid = self.hid
        parts: dict[str, np.ndarray] = {}
        if (hid["load_share"] > 0.0).any():
            mass = hid["load_share"] * self.mass
            cord = (self.load, self.load_v, self.p, self.v, mass, hid["cord_m"], DT_S)
            pull, self.load, self.load_v = attached.step_cord(*cord)
            parts["slung_load"] = self._of_world(pull * (hid["load_share"] > 0.0))
        if (hid["hose_N_m"] > 0.0).any():
            parts["tether"] = self._of_world(attached.hose(self.p, hid["hose_N_m"]))
        if (hid["rubbing"] > 0.0).any():
            parts["dragged_cable"] = self._of_world(
                attached.rubbing(self.v, hid["rubbing"], self.weight)
            )
        if (hid["magnus_s"] > 0.0).any():
            aside = attached.side_force(self.omega, still, hid["magnus_s"], self.weight)
            parts["magnus"] = np.concatenate([aside, 0.0 * aside])
        if (hid["slosh"] > 0.0).any():
            tilt = G_M_S2 * np.stack([self.turn[2, 0], self.turn[2, 1]])
            self.slosh, self.slosh_v, back = attached.step_slosh(
                self.slosh, self.slosh_v, tilt, DT_S
            )
            level = hid["slosh"] * self.mass * back
            parts["slosh"] = np.concatenate([level, np.zeros((4, level.shape[1]))])
        return parts

    def _of_world(self, force: np.ndarray) -> np.ndarray:
        body = np.einsum("jif,jf->if", self.turn, force)
        return np.concatenate([body, 0.0 * body])

    def _rows(
        self, force: np.ndarray, spin: np.ndarray, parts: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return what is kept of a moment: the truth at the sensors, and the parts by name."""
        seat = -self.centre
        # acceleration at the sensors: a + omega' x r + omega x (omega x r)
        swing = np.cross(self.omega, seat, axis=0)
        felt = force / self.mass + np.cross(spin, seat, axis=0)
        felt = felt + np.cross(self.omega, swing, axis=0)
        rows = {
            "p": self.p + np.einsum("ijf,jf->if", self.turn, seat),
            "v": self.v + np.einsum("ijf,jf->if", self.turn, swing),
            "q": self.q,
            "omega": self.omega,
            "specific_force": felt,
            "rotor_speed": self.w,
            "plain_speed": self.plain_w,
            "u": self.u,
            "battery": self.volt[None],
        }
        for name, f in self.having.items():
            if name in parts:
                rows[f"change/{name}"] = parts[name][:, f]
            if name == "inertia":
                off = (self.plain_inertia - self.inertia) * spin
                rows[f"change/{name}"] = np.concatenate([0.0 * off, off])[:, f]
        return rows


def _matrix(q: np.ndarray) -> np.ndarray:
    """Return (3, 3, F) body to world."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _turned(q: np.ndarray, omega: np.ndarray, dt: float) -> np.ndarray:
    """Advance a quaternion by body rates, to second order, and keep it of unit length."""
    w, x, y, z = q
    a, b, c = 0.5 * dt * omega
    new = q + np.stack(
        [
            -x * a - y * b - z * c,
            w * a + y * c - z * b,
            w * b + z * a - x * c,
            w * c + x * b - y * a,
        ]
    )
    return new / np.sqrt((new * new).sum(axis=0))
