"""Poles of the height loop, linearised about hover at every published ground effect factor.

The linear model takes the simulator's own numbers. Factor and estimate against height are read off
one-row flights, so that no equation of the ground effect is written here a second time. T is the
thrust, c the command of the height loop and e the estimate. About trim

    dT/T = G(s) [dc/c - n de/e] + df/f,      G(s) = 1/(tau s + 1),   n = 1 for 1/sqrt(f), 2 for 1/f

    dc = -m (kp + ki/s + kd s/(T_f s + 1)) D(s) dz,   de = e'(z) D(s) dz,   m z'' = m g dT/T

D(s) is the delay of sampling and hold (Pade, order 1): half the period of the rangefinder, of the
firmware for the oracle. A second set of poles takes the factor as a constant gain (no slopes). That
is what a linearisation of actuator and controller alone amounts to. Factors above 1 are met over
flat ground. Those below 1 are met over the top of a hill. It is so round that the curvature
correction turns the sign of f - 1 (1 + gain kappa = -1).
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import control
import numpy as np
import pandas as pd

from ges.errors import GesError
from ges.files import write_csv
from ges.simulator import flight as sim
from ges.simulator.parameters import parameters
from ges.simulator.terrain import ProceduralShape, Terrain
from ges.study.config import Simulator
from ges.study.fly.flights import MAPPINGS

MODES = ("none", "analytical", "oracle")
FACTOR_IS = ("of height", "constant")
HEIGHTS_M = np.geomspace(0.02, 2.0, 150)
SLOPE_STEP = 0.005
S = control.tf("s")
HILL_M = 10.0


def gravity() -> float:
    """Return the acceleration of gravity that the simulator flies with (m/s^2)."""
    return parameters()["gravity_m_s2"].default


@dataclasses.dataclass(frozen=True)
class Trim:
    """Hover at one height.

    Attributes
    ----------
    height_m : over the ground.
    factor, factor_slope_1_m : true ground effect factor, and its slope against height.
    estimate, estimate_slope_1_m : the same of the firmware's estimate.
    """

    height_m: float
    factor: float
    factor_slope_1_m: float
    estimate: float
    estimate_slope_1_m: float


FAR = Trim(math.inf, 1.0, 0.0, 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Site:
    """A place to hover.

    Attributes
    ----------
    ground : terrain.
    x_m : where on it, at y = 0.
    """

    ground: Terrain
    x_m: float = 0.0

    def flight(
        self, simulator: Simulator, height_m: float, **parameters: float | str
    ) -> sim.Flight:
        """Return a quiet hover that begins at rest over this place.

        Parameters
        ----------
        simulator : what is flown; its rangefinder and gyro have no noise here.
        height_m : over the ground.
        **parameters : further numbers of the flight.
        """
        # four rotors out of ground effect carry the weight: m g = 4 k w^2
        speed = math.sqrt(
            simulator.vehicle.mass_kg
            * gravity()
            / (4.0 * simulator.vehicle.thrust_coefficient_N_s2)
        )
        start = {f"start_rotor_speed_{i}_rad_s": speed for i in range(1, 5)}
        z = height_m + float(self.ground.at(np.array([self.x_m]), np.zeros(1)).height_m[0])
        # a sensor without noise, and a vehicle that is not pulled back to x = 0
        quiet = {
            "range_noise_m": 0.0,
            "gyro_noise_rad_s": 0.0,
            "cruise_m_s": 0.0,
            "position_kp": 0.0,
            "agl_ref_m": height_m,
        }
        where = {"start": 1.0, "start_p_x_m": self.x_m, "start_p_z_m": z, **start}
        # numbers of a flight go before those of its ground, and would lay out another one
        own = {
            name: value
            for name, value in simulator.parameters().items()
            if not name.startswith("terrain_")
        }
        return sim.Flight({**own, **quiet, **where, **parameters}, simulator.effects(), self.ground)


def _hill(seed: int, amplitude_m: float) -> Terrain:
    """Ground with a single wide feature of the given height, without roughness."""
    one = {
        "terrain_features_min": 1.0,
        "terrain_features_max": 1.0,
        "terrain_length_m": HILL_M,
        "terrain_roughness_m": 0.0,
    }
    size = {"terrain_amplitude_min_m": amplitude_m, "terrain_amplitude_max_m": amplitude_m}
    wide = {"terrain_width_min_m": 100.0 * HILL_M, "terrain_width_max_m": 100.0 * HILL_M}
    return Terrain.procedural(seed, ProceduralShape(**one, **size, **wide))


@functools.lru_cache(maxsize=8)
def crest(curvature_1_m: float) -> Site:
    """Return the top of a round hill.

    Parameters
    ----------
    curvature_1_m : Laplacian of the ground there, negative.
    """
    x = np.arange(0.0, HILL_M, 0.001)
    # a feature may be a dip: seeds are tried until one stands up
    seed, ground = next(
        (s, g)
        for s in itertools.count(1)
        if (g := _hill(s, 1.0).at(x, np.zeros_like(x))).height_m.max() > 0.5
    )
    # curvature is in proportion to height, so the hill of a metre tells how high the wanted one is
    top = int(np.argmax(ground.height_m))
    return Site(_hill(seed, curvature_1_m / float(ground.curvature_1_m[top])), float(x[top]))


def site(simulator: Simulator, factor: float) -> Site:
    """Return ground over which hovering low makes a factor on one side of 1.

    Parameters
    ----------
    simulator : its curvature gain shapes the hill.
    factor : flat ground from 1 on, the top of a hill below.

    Raises
    ------
    GesError
        When the factor is below 1 and the curvature gain is not positive.
    """
    if factor >= 1.0:
        return Site(Terrain.flat(0.0))
    gain = simulator.ground_effect.curvature_gain_m
    if gain <= 0.0:
        raise GesError(
            f"poles: factor {factor:g} is below 1, which no ground makes with a curvature gain of"
            f" {gain:g} m"
        )
    # 1 + gain kappa = -1: over such a top f - 1 is that of flat ground with its sign turned
    return crest(-2.0 / gain)


def _readings(simulator: Simulator, place: Site, mode: str, heights_m: np.ndarray) -> np.ndarray:
    """(n, 2): true factor and estimate while hovering at every height."""
    # one row at the start, before anything has moved: factor and estimate at exactly this height
    once: dict[str, float | str] = {"duration_s": simulator.dt_s, "record_every": 1.0, "mode": mode}
    records = sim.fly(
        [place.flight(simulator, z, **once) for z in heights_m], ("ge_factor", "ge_estimate")
    )
    return np.array([(r["ge_factor"][0], r["ge_estimate"][0]) for r in records])


def _height_of(factor: float, heights_m: np.ndarray, factors: np.ndarray) -> float:
    """Greatest height at which the factors, given against rising heights, cross ``factor``."""
    # heights at which the factor is as far from 1 or farther, on the same side
    beyond = np.flatnonzero(
        np.abs(factors - 1.0) * (np.sign(factors - 1.0) == np.sign(factor - 1.0))
        >= abs(factor - 1.0)
    )
    if len(beyond) == 0 or beyond[-1] == len(heights_m) - 1:
        raise GesError(
            f"poles: no height makes factor {factor:g}; this ground makes {factors.min():.3g} to"
            f" {factors.max():.3g}"
        )
    # linear between the last of them and the next, which is nearer to 1
    i = beyond[-1]
    share = (factor - factors[i]) / (factors[i + 1] - factors[i])
    return float(heights_m[i] + share * (heights_m[i + 1] - heights_m[i]))


def trim(simulator: Simulator, factor: float, mode: str) -> Trim:
    """Return the hover at which the true factor has a value.

    Parameters
    ----------
    simulator : what is flown.
    factor : true ground effect factor; 1 is far from the ground.
    mode : feedforward mode, which decides the estimate.

    Raises
    ------
    GesError
        When no height makes the factor.
    """
    if factor == 1.0:
        return FAR
    place = site(simulator, factor)
    height = _height_of(factor, HEIGHTS_M, _readings(simulator, place, mode, HEIGHTS_M)[:, 0])
    # central differences; the step goes with the height, over which the factor changes
    step = SLOPE_STEP * height
    low, here, high = _readings(
        simulator, place, mode, np.array([height - step, height, height + step])
    )
    slope = (high - low) / (2.0 * step)
    return Trim(height, float(here[0]), float(slope[0]), float(here[1]), float(slope[1]))


def _delay(seconds: float) -> control.TransferFunction:
    return control.tf(*control.pade(seconds, 1))


def _periods(simulator: Simulator) -> tuple[float, float]:
    """Return the periods of the firmware and of the rangefinder that it gets to see (s)."""
    # sensors are read when the firmware runs, so a new range comes at multiples of both periods
    read_every = math.lcm(simulator.control_every, int(parameters()["telemetry_every"].default))
    return simulator.control_every * simulator.dt_s, read_every * simulator.dt_s


def _motor(simulator: Simulator) -> control.TransferFunction:
    return 1 / (simulator.vehicle.motor_time_constant_s * S + 1)


def restoring(simulator: Simulator, at: Trim, mode: str, power: int) -> control.TransferFunction:
    """Return the upward acceleration per height lost (1/s^2).

    Parameters
    ----------
    simulator : what is flown.
    at : the hover.
    mode : feedforward mode.
    power : n of the module's equations.

    Returns
    -------
    Transfer function of controller, feedforward and the ground effect itself.
    """
    c, (run_s, read_s) = simulator.controller, _periods(simulator)
    # the firmware's discrete filter has its pole at T / (T + dt); tau of equal decay over a run:
    # exp(-dt / tau) = T / (T + dt)
    filter_s = run_s / math.log1p(run_s / c.altitude_filter_s) if c.altitude_filter_s > 0 else run_s
    reading, running = _delay(read_s / 2), _delay(run_s / 2)
    pid = c.altitude_kp + c.altitude_ki / S + c.altitude_kd * S / (filter_s * S + 1)
    # the command is scaled by e^-n and thrust by f, and both together carry the weight:
    # c f / e^n = m g, so that dc/c = da / (g e^n / f)
    trim_m_s2 = gravity() * at.estimate**power / at.factor
    # height lost is -dz: -n de/e turns into +n e'/e, and df/f below into -f'/f
    cancelled = (
        power * at.estimate_slope_1_m / at.estimate * (running if mode == "oracle" else reading)
    )
    return gravity() * (
        _motor(simulator) * (pid * reading / trim_m_s2 + cancelled)
        - at.factor_slope_1_m / at.factor
    )


def estimate_response(
    simulator: Simulator, at: Trim, mode: str, power: int
) -> control.TransferFunction:
    """Return the height (m) per error of the estimate that the feedforward uses.

    Parameters
    ----------
    simulator : what is flown.
    at : the hover.
    mode : feedforward mode.
    power : n of the module's equations.
    """
    # z = (push de - restoring z) / s^2, solved for z / de
    push = -gravity() * power / at.estimate * _motor(simulator) * _delay(_periods(simulator)[0] / 2)
    return push * control.feedback(1 / S**2, restoring(simulator, at, mode, power))


def closed_loop_poles(simulator: Simulator, at: Trim, mode: str, power: int) -> np.ndarray:
    """Return the poles (n,) of the closed height loop about a hover (1/s).

    Parameters
    ----------
    simulator : what is flown.
    at : the hover.
    mode : feedforward mode.
    power : n of the module's equations.
    """
    return control.feedback(1 / S**2, restoring(simulator, at, mode, power)).poles()


def phase_margin_deg(simulator: Simulator) -> float:
    """Return the phase margin of the height loop far from the ground.

    Returns
    -------
    Degrees; 0 where the loop is unstable.
    """
    # the sign of a margin at one crossing does not prove a loop stable: poles are asked first
    if closed_loop_poles(simulator, FAR, "none", 1).real.max() >= 0:
        return 0.0
    return float(control.margin(restoring(simulator, FAR, "none", 1) / S**2)[1])


def _pole_rows(
    simulator: Simulator, at: Trim, factor: float, mode: str, power: int, slopes: str
) -> Iterator[dict]:
    if slopes == "constant":
        # f and e stay in the trim, their answer to height goes
        at = dataclasses.replace(at, factor_slope_1_m=0.0, estimate_slope_1_m=0.0)
    loop = restoring(simulator, at, mode, power)
    poles = closed_loop_poles(simulator, at, mode, power)
    gain, phase, _, _ = control.margin(loop / S**2)
    # rounded, so that the last bits do not part or turn round a conjugate pair
    for number, pole in enumerate(
        sorted(poles, key=lambda p: (-round(p.real, 9), -p.imag)), start=1
    ):
        yield {
            "mode": mode,
            "mapping": MAPPINGS[power - 1],
            "factor_is": slopes,
            "factor": factor,
            "height_m": at.height_m,
            "factor_slope_1_m": at.factor_slope_1_m,
            "pole": number,
            "real_1_s": pole.real,
            "imaginary_1_s": pole.imag,
            "damping_ratio": -pole.real / abs(pole),
            "gain_margin": gain,
            "phase_margin_deg": phase,
        }


def _dominant(pairs: pd.DataFrame) -> dict[str, float]:
    """The oscillating pair of greatest real part; NaN where no pole oscillates."""
    first = next(pairs.itertuples(), None)
    if first is None:
        return dict.fromkeys(
            ("pair_real_1_s", "pair_frequency_rad_s", "pair_damping_ratio"), math.nan
        )
    return {
        "pair_real_1_s": first.real_1_s,
        "pair_frequency_rad_s": abs(complex(first.real_1_s, first.imaginary_1_s)),
        "pair_damping_ratio": first.damping_ratio,
    }


def _verdict(poles: pd.DataFrame) -> pd.DataFrame:
    """Greatest real part and dominant oscillating pair of every case."""
    rows = []
    for (mode, mapping, slopes, factor), group in poles.groupby(
        ["mode", "mapping", "factor_is", "factor"], sort=False
    ):
        # one of each conjugate pair; the greatest real part dies out last
        pairs = group[group["imaginary_1_s"] > 0]
        greatest = float(group["real_1_s"].max())
        rows.append(
            {
                "mode": mode,
                "mapping": mapping,
                "factor_is": slopes,
                "factor": factor,
                "height_m": group["height_m"].iloc[0],
                "stable": greatest < 0,
                "greatest_real_1_s": greatest,
                "dominant_oscillates": float((pairs["real_1_s"] >= greatest).any()),
                **_dominant(pairs),
                "gain_margin": group["gain_margin"].iloc[0],
                "phase_margin_deg": group["phase_margin_deg"].iloc[0],
            }
        )
    return pd.DataFrame(rows)


def write_poles(
    simulator: Simulator, pole_factors: list[float], poles: Path, summary: Path
) -> None:
    """Write the poles of every mode, mapping and factor.

    Parameters
    ----------
    simulator : what is flown.
    pole_factors : ground effect factors.
    poles : to write: a row a pole.
    summary : to write: stability, dominant pair and margins, a row a mode, mapping, kind of slope
        and factor.
    """
    rows: list[dict[str, Any]] = []
    for mode, factor in itertools.product(MODES, pole_factors):
        at = trim(simulator, factor, mode)
        for power, slopes in itertools.product((1, 2), FACTOR_IS):
            rows += _pole_rows(simulator, at, factor, mode, power, slopes)
    table = pd.DataFrame(rows)
    write_csv(poles, table)
    write_csv(summary, _verdict(table))
