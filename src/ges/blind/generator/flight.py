"""Fly many flights abreast: rigid body, blade-element rotors, motors, battery, air, ground; 1 kHz.

Arrays carry the flight on the last axis. The rigid body takes symplectic Euler steps, with the mean
velocity for the position and the exact rotation of a constant rate. Motors and inflow are implicit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ges.blind.generator import air, attached, drive, ground, rotor
from ges.blind.generator.airframe import RHO_KG_M3, TrueVehicle
from ges.blind.generator.concealed import NEUTRAL
from ges.blind.generator.pilot import Pilot
from ges.blind.generator.plan import CONTROL_DT_S, Plan
from ges.conventions import GRAVITY_M_S2

DT_S = 0.001
SLOW = 8
TURN_PER_M = 6.0
"""The air's angular acceleration over its acceleration."""
CONTROL = 4
ROTORS = 0
"""Width of what every rotor has one of."""
CHANNELS = {
    "p": 3,
    "v": 3,
    "q": 4,
    "omega": 3,
    **dict.fromkeys(("rotor_speed", "plain_speed", "u", "current"), ROTORS),
    "battery": 1,
    "specific_force": 3,
    "ground": 1,
    "level": 1,
    "extra_force": 3,
    "extra_moment": 3,
}


@dataclass(frozen=True)
class Sortie:
    """One flight to be simulated.

    Attributes
    ----------
    craft : the vehicle.
    numbers : what is concealed, as numbers that differ from :data:`NEUTRAL`.
    plan : references.
    grid : heights of the terrain, z[y, x] (m).
    charge : state of charge at the start, 0 to 1.
    turbulence : sd of the acceleration by turbulence (m/s^2).
    seed : of the flight's own random stream.
    weather : time scales and level of the turbulence.
    """

    craft: TrueVehicle
    numbers: dict[str, float]
    plan: Plan
    grid: np.ndarray
    charge: float
    turbulence: float
    seed: int
    weather: air.Weather = field(default_factory=air.Weather)


class _RandomInputs:
    """Random inputs of all sorties: turbulence, gust shocks and noise of the controller's state."""

    def __init__(self, sorties: list[Sortie], steps: int) -> None:
        n = steps // SLOW + 2
        parts = [self._one(s, n) for s in sorties]
        self.turbulence = np.stack([p[0] for p in parts], axis=-1)
        self.shock = np.stack([p[1] for p in parts], axis=-1)
        self.control = np.stack([p[2] for p in parts], axis=-1)
        self.level = np.stack([p[3] for p in parts], axis=-1)

    @staticmethod
    def _one(sortie: Sortie, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        rng = np.random.default_rng(sortie.seed)
        rows, level = air.turbulence(sortie.weather, n, SLOW * DT_S, rng)
        return (
            rows * sortie.turbulence,
            rng.standard_normal((3, n)),
            rng.standard_normal((9, n)),
            level,
        )


def _column(values: Iterable[float]) -> np.ndarray:
    return np.array(list(values), dtype=float)


class Bench:
    """Constants of all sorties, (F,) or (n_rotors, F).

    Parameters
    ----------
    sorties : of vehicles that have as many rotors.
    """

    def __init__(self, sorties: list[Sortie]) -> None:
        crafts = [s.craft for s in sorties]
        self.hid = {k: _column({**NEUTRAL, **s.numbers}[k] for s in sorties) for k in NEUTRAL}
        self.true = {k: _column(c.true[k] for c in crafts) for k in crafts[0].true}
        self.nominal = {k: _column(c.nominal[k] for c in crafts) for k in crafts[0].nominal}
        self.radius = _column(c.radius_m for c in crafts)
        self.arm = _column(c.arm_m for c in crafts)
        self.rx = np.array([c.rotor_x_m for c in crafts]).T
        self.ry = np.array([c.rotor_y_m for c in crafts]).T
        self.rz = np.array([c.hubs_m[:, 2] for c in crafts]).T
        self.spacing = _column(c.spacing_m for c in crafts)
        # of every rotor the one over it, itself where there is none
        above = np.array([c.upper for c in crafts]).T
        self.is_lower = (above >= 0).astype(float)
        self.upper = np.where(above >= 0, above, np.arange(len(above))[:, None])
        self.n_rotors = len(self.rx)
        self.spin = np.array([c.spin for c in crafts], dtype=float).T
        self._rotors()
        self._drive()

    def _rotors(self) -> None:
        hid, true = self.hid, self.true
        carried, x, y = hid["payload_share"], hid["payload_x_m"], hid["payload_y_m"]
        self.mass = true["mass"] * (1.0 + carried)
        # two bodies turn about their common centre with the reduced mass at their distance (Koenig)
        reduced = true["mass"] * carried / (1.0 + carried)
        self.inertia = np.stack([true[k] for k in ("ixx", "iyy", "izz")]) * hid["inertia_error"]
        self.inertia = self.inertia + reduced * np.stack([y * y, x * x, x * x + y * y])
        self.cg_x = hid["cg_x_m"] + x * carried / (1.0 + carried)
        self.cg_y = hid["cg_y_m"] + y * carried / (1.0 + carried)
        self.thrust = true["thrust"] * hid["thrust_error"]
        # a weak rotor has lost thrust and torque alike
        health = np.ones_like(self.rx)
        health[hid["weak_index"].astype(int), np.arange(len(self.mass))] -= hid["weak_share"]
        self.k = self.thrust * health
        self.kq = true["torque"] * hid["torque_error"] * health
        self.weight = self.mass * GRAVITY_M_S2
        self.hover = np.sqrt(self.weight / (self.n_rotors * self.thrust))
        self.disc = np.pi * self.radius**2
        self.ct = self.thrust / (RHO_KG_M3 * self.disc * self.radius**2)
        self.theta = rotor.blade_pitch(self.ct, hid["blade_s"])
        # momentum theory in hover, v_h = sqrt(T / (2 rho A)), of every rotor's share of the weight
        self.v_h = np.sqrt(self.weight / (2.0 * self.n_rotors * RHO_KG_M3 * self.disc))
        # a vehicle in which no effect reads the inflow keeps the plain law T = k w^2
        inflow = hid["axial"] + hid["edgewise"] + hid["image_gain"] + hid["coaxial"]
        self.breathes = (inflow > 0.0).astype(float)
        self.near = np.flatnonzero((hid["image_gain"] > 0.0) | (hid["fountain"] > 0.0))

    def _drive(self) -> None:
        hid, true = self.hid, self.true
        curve = hid["curve_droop"] > 0.0
        self.linear = ~curve
        self.droop = np.where(curve, hid["curve_droop"], drive.DROOP)
        self.lag = true["lag"] * hid["lag_gain"]
        carried = self.weight * (1.0 + hid["load_share"]) / self.k.sum(axis=0)
        hover_x = np.clip(np.sqrt(carried) / true["speed"], 0.1, 0.95)
        self.hover_x = hover_x
        # motor and ESC filter share the lag nine to one: together they have the nominal one
        self.rate = drive.rate_of_lag(self.lag * 0.9, hover_x, self.droop)
        self.filter = 0.1 * self.lag
        self.plain_rate = drive.rate_of_lag(true["lag"] * 0.9, hover_x, drive.DROOP)
        self.delay = np.round(hid["delay_s"] / DT_S).astype(int)
        self.hover_current = self.n_rotors * self.droop * hover_x**2

    def hover_command(self, volt: np.ndarray) -> np.ndarray:
        """Return the command that holds the rotor speed of hover.

        Parameters
        ----------
        volt : (F,) voltage over its full value.

        Returns
        -------
        (F,) 0 to 1.
        """
        duty = drive.linear_duty(self.hover_x, self.droop) / self.felt(volt)
        # a speed-linear ESC's map the other way round: r u^2 + (1 - r) u = duty
        bend = 1.0 - self.droop
        linear = (np.sqrt(bend**2 + 4.0 * self.droop * duty) - bend) / (2.0 * self.droop)
        return np.where(self.linear, linear, duty)

    def felt(self, volt: np.ndarray) -> np.ndarray:
        """Return the voltage over its nominal value as the motors feel it.

        Parameters
        ----------
        volt : (F,) voltage over its full value.

        Returns
        -------
        (F,) 1 where speed controllers make up for the voltage.
        """
        return 1.0 + self.hid["sags"] * (volt / drive.NOMINAL - 1.0)

    def steady_moment(self) -> np.ndarray:
        """Return the moment of an offset centre of mass and a weak rotor in hover.

        Returns
        -------
        (3, F) N m, body frame, at equal rotor speeds.
        """
        share = self.k / self.k.sum(axis=0) * self.weight
        x, y = self.rx - self.cg_x, self.ry - self.cg_y
        torque = -self.spin * self.kq / self.k * share
        return np.stack([(y * share).sum(axis=0), -(x * share).sum(axis=0), torque.sum(axis=0)])


class State:
    """Everything that moves, at the start of all sorties.

    Parameters
    ----------
    bench : constants of the vehicles.
    sorties : the flights; one whose plan waits on the ground starts there with rotors at rest.
    terrain : heights (m) under points (x, y) whose last axis is the flight.
    """

    def __init__(
        self,
        bench: Bench,
        sorties: list[Sortie],
        terrain: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ) -> None:
        flights = len(sorties)
        first = np.stack([s.plan.reference[:, 0] for s in sorties], axis=-1)
        parked = np.array([s.plan.ground_s > 0.0 for s in sorties])
        self.p, self.v = first[0:3].copy(), np.zeros((3, flights))
        self.p[2] = np.where(parked, terrain(self.p[0], self.p[1]) + 0.5 * bench.radius, self.p[2])
        self.q = np.stack(
            [np.cos(first[9] / 2), np.zeros(flights), np.zeros(flights), np.sin(first[9] / 2)]
        )
        self.omega = np.zeros((3, flights))
        self.x = np.where(parked, 0.0, bench.hover_x) * np.ones((bench.n_rotors, 1))
        self.v_i = bench.v_h * np.ones((bench.n_rotors, 1))
        self.speed_rate = np.zeros((bench.n_rotors, flights))
        self.charge = _column(s.charge for s in sorties)
        self.polar = bench.hid["polar_resistance"].copy() * ~parked
        self.volt = drive.open_circuit(self.charge) - bench.hid["resistance"] - self.polar
        self.esc = np.where(parked, 0.0, bench.hover_command(self.volt)) * np.ones(
            (bench.n_rotors, 1)
        )
        self.gust = np.zeros((5, flights))
        self.image, self.fountain = np.zeros((bench.n_rotors, flights)), np.zeros(flights)
        self.load = self.p.copy()
        self.load[2] -= bench.hid["rope_m"]
        self.load_v = np.zeros((3, flights))


def _stay(rows: np.ndarray, n: int) -> np.ndarray:
    """Repeat the last column of (k, m) rows up to n columns."""
    return np.concatenate([rows, np.repeat(rows[:, -1:], n - rows.shape[1], axis=1)], axis=1)


def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """Return rotation matrices from the body frame to the world.

    Parameters
    ----------
    q : (4, F) unit quaternions, scalar first.

    Returns
    -------
    (3, 3, F).
    """
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def to_world(r: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rotate vectors from the body frame to the world.

    Parameters
    ----------
    r : (3, 3, F) from the body frame to the world.
    a : (3, F) vectors.
    """
    return r[:, 0] * a[0] + r[:, 1] * a[1] + r[:, 2] * a[2]


def _to_body(r: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Rotate world vectors (3, F) into the body."""
    return (r * a[:, None]).sum(axis=0)


def _turn(q: np.ndarray, omega: np.ndarray, dt: float) -> np.ndarray:
    """Rotate attitudes by a constant body rate for dt, exactly, and keep them of unit length."""
    angle = 0.5 * dt * np.sqrt((omega * omega).sum(axis=0))
    c = np.cos(angle)
    x, y, z = omega * (0.5 * dt * np.sinc(angle / np.pi))
    w0, x0, y0, z0 = q
    out = np.stack(
        [
            c * w0 - x0 * x - y0 * y - z0 * z,
            c * x0 + w0 * x + y0 * z - z0 * y,
            c * y0 + w0 * y + z0 * x - x0 * z,
            c * z0 + w0 * z + x0 * y - y0 * x,
        ]
    )
    return out / np.sqrt((out * out).sum(axis=0))


class Simulation:
    """Sorties that are flown together, at 1 kHz.

    Parameters
    ----------
    sorties : of vehicles that have as many rotors.
    n : rows at the control rate; by default as many as the longest plan has. All random inputs
        follow from it.
    """

    def __init__(self, sorties: list[Sortie], n: int | None = None) -> None:
        self.sorties, self.b = sorties, Bench(sorties)
        self.steps = (n or max(s.plan.reference.shape[1] for s in sorties)) * CONTROL
        self.air = _RandomInputs(sorties, self.steps)
        self.flights = np.arange(len(sorties))
        self._load_terrain()
        self.s = State(self.b, sorties, self.terrain)
        tuned = self.b.lag + self.b.hid["delay_s"]
        self.pilot = Pilot(self.b.nominal, self.b.rx, self.b.ry, self.b.spin, tuned, CONTROL_DT_S)
        self._trim()
        # a ring of past commands, as long as the longest delay
        longest = int(self.b.delay.max()) + 1
        self.queue = np.repeat(self.s.esc[None].copy(), longest, axis=0)
        self.u = self.s.esc.copy()
        self.current = self.b.droop * self.s.x**2
        self.plain_x, self.plain_esc = self.s.x.copy(), self.s.esc.copy()

    def _trim(self) -> None:
        """Begin with the rotors and integrators of a vehicle that was trimmed on flights before."""
        moment, flying = self.b.steady_moment(), self.s.x > 0.0
        self.pilot.trim(moment, self.b.hover_command(self.s.volt), self.b.nominal["thrust"])
        asked = np.concatenate([self.b.weight[None], -moment])
        # squared speeds over that of hover, as the mixer asks for weight and trim moment
        square = (
            np.einsum("ijf,jf->if", self.pilot.mixer, asked)
            / (self.b.weight / self.b.n_rotors)
            * self.b.nominal["thrust"]
        )
        share = np.sqrt(np.maximum(square, 0.1))
        self.s.x, self.s.esc = self.s.x * share, np.where(flying, self.s.esc * share, 0.0)

    def _load_terrain(self) -> None:
        unique: dict[int, int] = {}
        order = [unique.setdefault(id(s.grid), len(unique)) for s in self.sorties]
        grids = {id(s.grid): s.grid for s in self.sorties}
        self.grids = np.stack([grids[k] for k in unique])
        self.which = np.array(order, dtype=np.intp)

    def terrain(
        self, x: np.ndarray, y: np.ndarray, flights: np.ndarray | slice = slice(None)
    ) -> np.ndarray:
        """Return heights of the terrain.

        Parameters
        ----------
        x, y : points (m), (F,) or with further axes before the flight.
        flights : which flights these are; by default all.

        Returns
        -------
        Heights (m) in the shape of ``x``.
        """
        return ground.height_at(self.grids, self.which[flights], x, y)

    def run(self) -> dict[str, np.ndarray]:
        """Fly all sorties.

        Returns
        -------
        Each of :data:`CHANNELS` as (n, width, F) at 250 Hz. The extra force and moment (N, N m,
        body frame) are those beyond T = k w^2 and the nominal torque, without turbulence.
        """
        n, flights = self.steps // CONTROL, len(self.sorties)
        book = {k: np.empty((n, w or self.b.n_rotors, flights)) for k, w in CHANNELS.items()}
        reference = np.stack([_stay(s.plan.reference, n) for s in self.sorties], axis=-1)
        # a flight that is over waits for the others: position and yaw stay, rates are zero
        reference[3:9] = self._while_planned(reference[3:9])
        reference[10] = self._while_planned(reference[10:])[0]
        excite = self._while_planned(
            np.stack([_stay(s.plan.excite, n) for s in self.sorties], axis=-1)
        )
        start = _column(s.plan.ground_s for s in self.sorties)
        for i in range(self.steps):
            self.r = rotation_matrix(self.s.q)
            if i % SLOW == 0:
                self._slow(i // SLOW)
            if i % CONTROL == 0:
                k = i // CONTROL
                self._control(
                    reference[:, k], excite[:, k], (i * DT_S >= start).astype(float), i // SLOW
                )
            self._motors(i)
            force, moment, extra = self._loads()
            if i % CONTROL == 0:
                self._write(book, i // CONTROL, force, extra)
            self._advance(force, moment)
        return book

    def _while_planned(self, rows: np.ndarray) -> np.ndarray:
        """Zero rows (k, n, F) after each flight's own plan has ended."""
        ends = np.array([s.plan.reference.shape[1] for s in self.sorties])
        return rows * (np.arange(rows.shape[1])[:, None] < ends)

    def _control(self, ref: np.ndarray, excite: np.ndarray, flying: np.ndarray, k: int) -> None:
        s, noise = self.s, self.air.control[:, k]
        self.u = self.pilot.command(
            ref,
            excite,
            s.p + 0.002 * noise[0:3],
            s.v + 0.01 * noise[3:6],
            self.r,
            s.omega + 0.01 * noise[6:9],
            flying,
        )

    def _slow(self, k: int) -> None:
        s, b = self.s, self.b
        self.under = self.terrain(s.p[0], s.p[1])
        height = s.p[2] - self.under
        speed = b.hid["wind_m_s"] * air.log_profile(height)
        wind = speed * np.stack(
            [np.cos(b.hid["wind_direction_rad"]), np.sin(b.hid["wind_direction_rad"])]
        )
        airspeed = np.sqrt(((s.v[:2] - wind) ** 2).sum(axis=0))
        s.gust = air.step_gusts(
            s.gust, b.hid["gust_m_s"], airspeed, height, self.air.shock[:, k], SLOW * DT_S
        )
        self.wind = np.stack([wind[0] + s.gust[0], wind[1] + s.gust[1], s.gust[3]])
        self.shake, self.level = self.air.turbulence[:, k], self.air.level[k]
        self.buffet = self.air.shock[0, k]
        current = np.maximum(self.current.sum(axis=0) / b.hover_current, 0.0)
        s.charge, s.polar, s.volt = drive.step_battery(
            s.charge,
            s.polar,
            current,
            b.hid["resistance"],
            b.hid["polar_resistance"],
            b.hid["drain_1_s"],
            SLOW * DT_S,
        )
        if b.near.size:
            self._ground(b.near)

    def _ground(self, f: np.ndarray) -> None:
        s, b = self.s, self.b
        arms = np.stack([b.rx[:, f], b.ry[:, f], b.rz[:, f]])
        rotors = s.p[:, None, f] + np.einsum("ijf,jkf->ikf", self.r[:, :, f], arms)
        drift = s.v[:2, f] - self.wind[:2, f]
        # a moving rotor leaves its wake behind: the rays reach the ground against the drift
        sweep = -b.hid["image_sweep"][f] * drift / b.v_h[f]
        fraction = ground.image_fraction(
            rotors, b.radius[f], lambda x, y: self.terrain(x, y, f), sweep
        )
        # contrast makes a moment: differences between rotors grow, their mean stays
        mean = fraction.mean(axis=0)
        fraction = mean + (fraction - mean) * (1.0 + b.hid["image_contrast"][f])
        target = ground.saturate(b.hid["image_gain"][f] * np.maximum(fraction, 0.0))
        # the lag is the time that the wake takes down to the ground at the induced velocity
        time = b.hid["image_lag"][f] * (rotors[2] - self.under[f] + b.radius[f]) / b.v_h[f]
        keep = np.where(time > 0.0, np.exp(-SLOW * DT_S / np.maximum(time, 1e-3)), 0.0)
        s.image[:, f] = keep * s.image[:, f] + (1.0 - keep) * target
        s.fountain[f] = attached.fountain_share(
            s.p[2, f] - self.under[f], b.spacing[f], self.r[2, 2, f]
        )

    def _motors(self, i: int) -> None:
        s, b = self.s, self.b
        slot = i % len(self.queue)
        self.queue[slot] = self.u
        asked = self.queue[(i - b.delay) % len(self.queue), :, self.flights].T
        asked = np.minimum(asked, b.hid["ceiling_u"])
        # thrust goes with w^2, so that a mapping of 1/2 takes the ground's whole gain out again
        if self.b.hid["mapping"].any():
            asked = asked * (1.0 + self._gain_of_ground()) ** -b.hid["mapping"]
        s.esc = s.esc + (DT_S / (b.filter + DT_S)) * (asked - s.esc)
        duty = np.where(b.linear, drive.linear_duty(s.esc, b.droop), s.esc)
        x, self.current = drive.step_motor(
            s.x, duty, b.felt(s.volt), b.droop, b.rate, b.hid["coast"], 1.5, DT_S
        )
        s.speed_rate = (x - s.x) * b.true["speed"] / DT_S
        s.x = np.maximum(x, 0.0)
        self._plain_motors()

    def _plain_motors(self) -> None:
        """Advance motors with nothing concealed on the same commands.

        What the drive alone does is the difference.
        """
        b = self.b
        slow = 0.1 * b.true["lag"]
        self.plain_esc = self.plain_esc + (DT_S / (slow + DT_S)) * (self.u - self.plain_esc)
        duty = drive.linear_duty(self.plain_esc, drive.DROOP)
        self.plain_x = np.maximum(
            drive.step_motor(self.plain_x, duty, 1.0, drive.DROOP, b.plain_rate, 1.0, 1.5, DT_S)[0],
            0.0,
        )

    def _gain_of_ground(self) -> np.ndarray:
        b = self.b
        lam = np.sqrt(b.ct / 2.0)
        full = rotor.thrust_coefficient(b.theta, b.hid["blade_s"], lam * (1.0 - self.s.image), 0.0)
        return full / b.ct - 1.0

    def _loads(self) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return body force without gravity, moment, and the extra load.

        The latter is what exceeds the nominal kind of vehicle.
        """
        s, b = self.s, self.b
        w = s.x * b.true["speed"]
        air_body = _to_body(self.r, s.v - self.wind)
        drag_xy, thrust = self._rotors(w, air_body)
        force, moment = self._sum_rotors(w, drag_xy, thrust)
        more, twist = self._extras(w, thrust, air_body)
        force, moment = force + more, moment + twist
        # what exceeds T = k w^2 is taken before the turbulence, which is no effect's doing
        plain = b.true["thrust"] * w * w
        extra = (
            force - np.stack([0.0 * plain[0], 0.0 * plain[0], plain.sum(axis=0)]),
            moment - self._moment_of(plain, -b.spin * b.true["torque"] * w * w),
        )
        shake = self.shake
        force = force + _to_body(self.r, shake[:3] * b.mass)
        moment = moment + shake[3:] * TURN_PER_M * self.b.inertia
        return force, moment, extra

    def _moment_of(self, thrust: np.ndarray, torque: np.ndarray) -> np.ndarray:
        b = self.b
        return np.stack(
            [(b.ry * thrust).sum(axis=0), -(b.rx * thrust).sum(axis=0), torque.sum(axis=0)]
        )

    def _rotors(self, w: np.ndarray, air_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s, b = self.s, self.b
        # air speed at each hub, v + omega x r
        ex = air_body[0] - s.omega[2] * b.ry
        ey = air_body[1] + s.omega[2] * b.rx
        climb = air_body[2] + s.omega[0] * b.ry - s.omega[1] * b.rx
        edge = np.sqrt(ex * ex + ey * ey)
        tip = np.maximum(w, 0.05 * b.hover) * b.radius
        active_edge, active_climb = edge * b.hid["edgewise"], climb * b.hid["axial"]
        lam = (s.v_i * (1.0 - s.image) + active_climb + self._wake(edge)) / tip
        ct = rotor.thrust_coefficient(b.theta, b.hid["blade_s"], lam, active_edge / tip)
        # the blade element gives only the ratio to hover; the size is the true thrust coefficient's
        ratio = 1.0 + b.breathes * (np.clip(ct / b.ct, 0.0, 3.0) - 1.0)
        thrust = b.k * w * w * ratio
        s.v_i = rotor.step_inflow(
            s.v_i, thrust, active_edge, active_climb, b.radius, RHO_KG_M3, DT_S
        )
        mu = np.maximum(edge, 1e-6) / tip
        ch = rotor.inplane_coefficient(b.theta, b.hid["blade_s"], s.v_i / tip, mu)
        # over the edgewise speed, so that times (ex, ey) it is a vector against the air
        size = b.hid["drag_gain"] * RHO_KG_M3 * b.disc * tip * tip * ch / np.maximum(edge, 1e-6)
        return np.stack([-size * ex, -size * ey]), thrust

    def _wake(self, edge: np.ndarray) -> np.ndarray:
        """Return what the wake of the rotor above adds to the inflow of a lower one, (n, F).

        A contracting wake carries what its disc takes in, so that averaged over a disc of the same
        size the flow is that disc's own. Across the flight it slants by the edgewise speed over
        that of the wake, and covers less of the disc below.
        """
        b = self.b
        if not b.hid["coaxial"].any():
            return np.zeros_like(edge)
        flights = np.arange(edge.shape[1])
        above = np.maximum(self.s.v_i[b.upper, flights], 1e-3)
        drop = b.rz[b.upper, flights] - b.rz
        missed = drop * edge / (1.5 * above) / (1.4 * b.radius)
        return b.hid["coaxial"] * b.is_lower * above * np.clip(1.0 - missed, 0.0, 1.0)

    def _sum_rotors(
        self, w: np.ndarray, drag: np.ndarray, thrust: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        b = self.b
        fx = drag[0] + b.hid["tilt_x_rad"] * thrust
        fy = drag[1] + b.hid["tilt_y_rad"] * thrust
        x, y = b.rx - b.cg_x, b.ry - b.cg_y
        torque = -b.spin * (b.kq * w * w + b.hid["rotor_inertia_kg_m2"] * self.s.speed_rate)
        force = np.stack([fx.sum(axis=0), fy.sum(axis=0), thrust.sum(axis=0)])
        moment = np.stack(
            [
                (y * thrust - b.rz * fy).sum(axis=0),
                (b.rz * fx - x * thrust).sum(axis=0),
                (x * fy - y * fx + torque).sum(axis=0),
            ]
        )
        return force, moment

    def _extras(
        self, w: np.ndarray, thrust: np.ndarray, air_body: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return body force and moment of all that is not the rotors."""
        s, b = self.s, self.b
        speed = np.sqrt((air_body * air_body).sum(axis=0))
        force = (
            -0.5 * RHO_KG_M3 * b.hid["area_m2"] * speed * air_body * np.array([[1.0], [1.1], [1.5]])
        )
        total = thrust.sum(axis=0)
        force[2] += b.hid["fountain"] * s.fountain * total
        pull = attached.tether(s.p, self.under, b.hid["tether_N_m"], b.hid["tether_sag_m"])
        pull = pull + attached.patches(s.p, b.hid)
        rope, s.load, s.load_v = attached.slung_load(
            s.load, s.load_v, s.p, s.v, b.mass, b.hid, DT_S
        )
        force += _to_body(self.r, pull + rope)
        more, moment = attached.unlisted_loads(air_body, thrust, b, self.buffet)
        return force + more, moment

    def _advance(self, force: np.ndarray, moment: np.ndarray) -> None:
        s, b = self.s, self.b
        push, level = attached.contact(s, self.r, self.under, b)
        v = s.v + DT_S * (
            (to_world(self.r, force) + push) / b.mass - np.array([[0.0], [0.0], [GRAVITY_M_S2]])
        )
        s.p = s.p + 0.5 * DT_S * (s.v + v)
        s.v = v
        # Euler: J omega' = M - omega x J omega; ``level`` is an acceleration already
        h = b.inertia * s.omega
        cross = np.stack(
            [
                s.omega[1] * h[2] - s.omega[2] * h[1],
                s.omega[2] * h[0] - s.omega[0] * h[2],
                s.omega[0] * h[1] - s.omega[1] * h[0],
            ]
        )
        s.omega = s.omega + DT_S * ((moment - cross) / b.inertia + level)
        s.q = _turn(s.q, s.omega, DT_S)

    def _write(
        self,
        book: Mapping[str, np.ndarray],
        k: int,
        force: np.ndarray,
        extra: tuple[np.ndarray, np.ndarray],
    ) -> None:
        s, b = self.s, self.b
        push, _ = attached.contact(s, self.r, self.under, b)
        # an accelerometer reads all but gravity
        felt = (force + _to_body(self.r, push)) / b.mass
        rows = {
            "p": s.p,
            "v": s.v,
            "q": s.q,
            "omega": s.omega,
            "rotor_speed": s.x * b.true["speed"],
            "plain_speed": self.plain_x * b.true["speed"],
            "u": self.u,
            "current": self.current,
            "battery": s.volt,
            "specific_force": felt,
            "ground": self.under,
            "level": self.level,
            "extra_force": extra[0],
            "extra_moment": extra[1],
        }
        for name, value in rows.items():
            book[name][k] = value
