"""Fit of the simulator's unpublished numbers to published figures.

Its seeds serve nothing else. The paper leaves mass, gains, lag and the terrain's amplitudes out.
Five of its published figures set the operating point. Two are AGL RMS without feedforward and with
the analytical one, each the mean of the 8- and 30-seed comparisons by number of seeds. Two are gyro
RMS and the first response to the bias pulse. The last is the mean clearance lost between bias -0.02
and +0.02, which the integral gain alone decides. What is left of its claims (oracle, network,
clearances under bias, grid, intervals) is not looked at here. It can come out either way.

The curvature gain is one of the free numbers. The paper gives 0.6 without a unit, and its finite
differences without a step. Over a rotor's radius they are the exact Laplacian to a few per cent.
Only the gain in metres is left to find.

Six figures do not settle eleven numbers. Of all that fit, a weak pull takes those nearest the
middle of the bounds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from ges import files
from ges.simulator import flight as sim
from ges.study.config import Flights, GroundEffect, Pulse, SeedRange, Simulator
from ges.study.fly.flights import Condition
from ges.study.fly.metrics import GYRO, gyro_rms
from ges.study.stats.target import distances, ends, misfit_of, place_of, record_of

PUBLISHED = {
    "none_m": 0.0680,
    "analytical_m": 0.0611,
    "gyro_rad_s": 0.02537,
    "pulse_m": -0.003113,
    "bias_m": -0.001512,
    # not published: hills and gains that bring the feet to the ground are no answer
    "contact_share": 0.0,
}
TOLERANCE = {
    "none_m": 0.001,
    "analytical_m": 0.0005,
    "gyro_rad_s": 0.001,
    "pulse_m": 0.0003,
    "bias_m": 0.0003,
    "contact_share": 0.001,
}
BIAS = 0.02
EVALUATIONS = 12  # of the search, each with its derivatives
PULL = 0.3  # tolerances that a number at its bound counts
STEP = 0.02  # of the derivatives, as a share of the bounds
FREE = {
    "cruise_m_s": (0.8, 1.6),
    "terrain_amplitude_max_m": (0.08, 0.2),
    "terrain_length_m": (2000.0, 5000.0),
    "altitude_kp": (2.0, 12.0),
    "altitude_ki": (0.1, 6.0),
    "altitude_kd": (0.3, 4.0),
    "attitude_kp": (30.0, 150.0),
    "attitude_kd": (6.0, 30.0),
    "motor_time_constant_s": (0.015, 0.08),
    "gyro_noise_rad_s": (0.002, 0.014),
    "curvature_gain_m": (0.0, 0.6),
}
# least over greatest height of a feature, as in the simulator's defaults
AMPLITUDE_RATIO = 0.03 / 0.17
_COLUMNS = ("t_s", "range_m", "agl_m", "contact", *GYRO)


def free_parameters(x: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Return the numbers of a flight at a point of the search.

    Parameters
    ----------
    x : (n,) values in the order of :data:`FREE`.

    Returns
    -------
    The least height of a feature keeps its ratio to the greatest.
    """
    numbers = dict(zip(FREE, map(float, x), strict=True))
    return {
        **numbers,
        "terrain_amplitude_min_m": AMPLITUDE_RATIO * numbers["terrain_amplitude_max_m"],
    }


Arms = dict[str, list[sim.Record]]


def fly_arms(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    numbers: dict[str, float],
    seeds: Sequence[int],
) -> Arms:
    """Fly every arm that the fit looks at.

    Parameters
    ----------
    simulator, plan, pulse : what is not free.
    numbers : free numbers.
    seeds : of every arm.

    Returns
    -------
    Records by arm: ``none``, ``analytical``, ``oracle``, and the oracle ``pulsed``, biased ``over``
    and biased ``under``.
    """
    kick = {
        "pulse": pulse.bias,
        "pulse_start_s": pulse.start_s,
        "pulse_duration_s": pulse.duration_s,
    }
    arms: dict[str, dict[str, float | str]] = {
        "none": {"mode": "none"},
        "analytical": {"mode": "analytical"},
        "oracle": {"mode": "oracle"},
    }
    arms |= {"pulsed": {"mode": "oracle", **kick}}
    arms |= {"over": {"mode": "oracle", "bias": BIAS}, "under": {"mode": "oracle", "bias": -BIAS}}
    # the curvature gain is a number of the effect, the rest are numbers of the flight
    truth = {k: v for k, v in numbers.items() if k in GroundEffect.model_fields}
    own = {k: v for k, v in numbers.items() if k not in truth}
    flights = [
        Condition(name, {**own, **a}, truth).flight(simulator, plan, s)
        for name, a in arms.items()
        for s in seeds
    ]
    records = sim.fly(flights, _COLUMNS)
    return {name: records[i * len(seeds) : (i + 1) * len(seeds)] for i, name in enumerate(arms)}


def operating_point(simulator: Simulator, pulse: Pulse, arms: Arms) -> dict[str, float]:
    """Return the quantities of :data:`PUBLISHED` as they were flown.

    Parameters
    ----------
    simulator, pulse : of the flights.
    arms : records of :func:`fly_arms`.

    Returns
    -------
    By figure; NaN where a flight did not end well.
    """
    reference = simulator.controller.agl_ref_m
    return {
        "none_m": mean_rms(arms["none"], reference),
        "analytical_m": mean_rms(arms["analytical"], reference),
        "gyro_rad_s": float(np.mean([gyro_rms(r) for r in arms["none"]])),
        "pulse_m": _pulse_response(arms["oracle"], arms["pulsed"], pulse),
        # over less under seed by seed: equal ground and noise on both sides
        "bias_m": float(
            np.mean(
                [
                    a["agl_m"].mean() - b["agl_m"].mean()
                    for a, b in zip(arms["over"], arms["under"], strict=True)
                ]
            )
        ),
        "contact_share": float(np.mean([r["contact"].mean() for r in arms["analytical"]])),
    }


def mean_rms(records: Sequence[sim.Record], reference: float) -> float:
    """Return the mean over flights of the RMS tracking error of the height over ground (m).

    Parameters
    ----------
    records : flights with ``range_m``; readings beyond the rangefinder's reach are left out.
    reference : height to hold (m).
    """
    # the rangefinder reads nothing beyond its reach
    return float(np.mean([np.sqrt(np.nanmean((r["range_m"] - reference) ** 2)) for r in records]))


def _pulse_response(
    oracle: Sequence[sim.Record], pulsed: Sequence[sim.Record], pulse: Pulse
) -> float:
    # the published window: half a second from the end of the pulse on
    end = pulse.start_s + pulse.duration_s
    window = (oracle[0]["t_s"] >= end) & (oracle[0]["t_s"] < end + 0.5)
    return float(
        np.mean(
            [(b["agl_m"] - a["agl_m"])[window].mean() for a, b in zip(oracle, pulsed, strict=True)]
        )
    )


def misfit(flown: Mapping[str, float]) -> float:
    """Return the sum of squared distances from :data:`PUBLISHED`, each over its tolerance.

    Parameters
    ----------
    flown : figures of :func:`operating_point`.
    """
    return misfit_of(flown, PUBLISHED, TOLERANCE)


@dataclasses.dataclass(frozen=True)
class GainSearch:
    """What a search of the free numbers looks at.

    Points are places within the bounds from 1 to 2, (n,), so that relative steps of derivatives are
    shares of the bounds.

    Attributes
    ----------
    simulator, plan, pulse : what is not free.
    seeds : flights behind each figure.
    """

    simulator: Simulator
    plan: Flights
    pulse: Pulse
    seeds: Sequence[int]

    def arms(self, numbers: dict[str, float]) -> Arms:
        """Return the flights of every arm with these free numbers."""
        return fly_arms(self.simulator, self.plan, self.pulse, numbers, self.seeds)

    def flown(self, arms: Arms) -> dict[str, float]:
        """Return the quantities of :data:`PUBLISHED` of the flights."""
        return operating_point(self.simulator, self.pulse, arms)

    def point(self, numbers: Mapping[str, float]) -> np.ndarray:
        """Return the place of free numbers.

        Returns
        -------
        (n,) 1 at the lower bound, 2 at the upper.
        """
        return 1.0 + place_of(numbers, FREE)

    def numbers(self, point: np.ndarray) -> dict[str, float]:
        """Return the free numbers at a place.

        Parameters
        ----------
        point : (n,) 1 at the lower bound, 2 at the upper.
        """
        low, high = ends(FREE)
        return free_parameters(low + (point - 1.0) * (high - low))

    def _pulled(self, point: np.ndarray, flown: Mapping[str, float]) -> np.ndarray:
        """Return distances from the published figures, then the pull to the middle, (k + n,)."""
        # -PULL at a lower bound, 0 in the middle, PULL at an upper one: a ridge, without which
        # fewer figures than numbers leave whole directions open
        far = distances(flown, PUBLISHED, TOLERANCE)
        return np.concatenate([far, PULL * (2.0 * point - 3.0)])

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Fly a point, and return its distances from the published figures.

        Parameters
        ----------
        point : (n,) 1 at the lower bound, 2 at the upper.

        Returns
        -------
        (figures + n,) distances over tolerances, then the pull of each number towards the middle.
        """
        return self._pulled(point, self.flown(self.arms(self.numbers(point))))


def calibrate(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    calibration_seeds: SeedRange,
    calibration: Path,
) -> None:
    """Search the free numbers by least squares, starting from those of the configuration.

    Parameters
    ----------
    simulator, plan, pulse : what is not free, and where the search starts.
    calibration_seeds : seeds that serve nothing else.
    calibration : to write (JSON): free numbers, published and flown figures, bounds and seeds.
    """
    search = GainSearch(simulator, plan, pulse, calibration_seeds.list())
    start = search.point(
        {
            **simulator.parameters(),
            **simulator.ground_effect.parameters(),
            "cruise_m_s": plan.cruise_m_s,
        }
    )
    # a start outside of its bounds would be refused; a step within them, it can move either way
    solution = least_squares(
        search.residuals,
        np.clip(start, 1.0 + STEP, 2.0 - STEP),
        bounds=(1.0, 2.0),
        diff_step=STEP,
        max_nfev=EVALUATIONS,
    )
    numbers = search.numbers(solution.x)
    flown = search.flown(search.arms(numbers))
    report = record_of(numbers, flown, PUBLISHED, TOLERANCE, FREE, search.seeds, int(solution.nfev))
    files.write_json(calibration, report)
