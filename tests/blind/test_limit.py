"""The Neyman-Pearson limit, against dense covariances and against sums that can be done by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from ges.blind.limit import Body, Path, log_likelihood_ratios, power
from ges.blind.noise import Air, Noise

BODY = Body(
    0.8,
    np.array([4e-3, 5e-3, 8e-3]),
    np.array([[0.1, -0.1, 0.0], [-0.1, 0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]]),
    np.array([-0.016, -0.016, 0.016, 0.016]),
)
DEAF = Noise(
    position_m=1e6,
    position_drift=(0.0, 1.0),
    velocity_m_s=1e6,
    velocity_drift=(0.0, 1.0),
    attitude_rad=1e-6,
    attitude_drift=(0.0, 1.0),
    attitude_bias_rad=0.0,
    rate_bias_rad_s=0.0,
    acceleration_bias_m_s2=0.0,
    speed_share=np.inf,
)
"""Only the accelerometer and the gyro can be heard."""


def _path(n: int = 200, step_s: float = 0.01, **more) -> Path:
    weight = 0.8 * 9.80665 / 4.0
    still = {
        "step_s": step_s,
        "rotation": np.tile(np.eye(3), (n, 1, 1)),
        "thrust_N": np.full((n, 4), weight),
        "speed_rad_s": np.full((n, 4), 700.0),
        "speed_error_rad_s": 0.0,
        "changes": {},
        "priors": {},
    }
    return Path(**(still | more))


def _push(n: int, newton: float, axis: int = 2) -> dict:
    return {"force_N": newton * np.eye(3)[axis] * np.ones((n, 1))}


def test_white_noise_alone_is_a_matched_filter():
    """J = n (F / m sigma)^2, and half of it is the expected log likelihood ratio."""
    path = _path(changes={"a": _push(200, 0.02)})
    found = log_likelihood_ratios([path, path], BODY, DEAF)
    expected = 0.5 * 400 * (0.02 / (0.8 * 0.15)) ** 2
    assert found["whole"] == pytest.approx(expected, rel=1e-3)
    assert found["without"]["a"] == pytest.approx(expected, rel=1e-3)


def test_filter_agrees_with_dense_covariance():
    """Velocity and accelerometer under an Ornstein-Uhlenbeck air: s' C^-1 s by brute force."""
    n, step, sd, time = 60, 0.02, 0.3, 0.2
    noise = dataclasses.replace(DEAF, velocity_m_s=0.05)
    rng = np.random.default_rng(0)
    push = np.zeros((n, 3))
    push[:, 0] = rng.standard_normal(n).cumsum() * 0.02
    path = _path(n, step, changes={"a": {"force_N": push}}, air=Air(((sd, time),)))
    found = log_likelihood_ratios([path], BODY, noise)["whole"]
    keep = np.exp(-step / time)
    lag = np.abs(np.arange(n)[:, None] - np.arange(n))
    air = sd**2 * keep**lag
    # velocity after the sums of what acted before; its start is unknown
    summed = step * np.tril(np.ones((n, n)), -1)
    both = np.vstack([summed, np.eye(n)])
    covariance = both @ air @ both.T
    covariance[:n, :n] += 1e3 + 0.05**2 * np.eye(n)
    covariance[n:, n:] += 0.15**2 * np.eye(n)
    signal = both @ push[:, 0] / 0.8
    assert found == pytest.approx(0.5 * signal @ np.linalg.solve(covariance, signal), rel=1e-4)


def test_a_declared_doubt_bounds_what_can_be_told():
    """A number that is four of its prior sds off is never more than 4^2 / 2 nats, however long the
    flight; without the doubt it is.
    """
    n = 4000
    column = _push(n, 8.0)
    truth = {"a": {"force_N": 0.1 * column["force_N"]}}
    sure = log_likelihood_ratios([_path(n, changes=truth)], BODY, DEAF)["whole"]
    doubted = _path(n, changes=truth, priors={"thrust": (0.025, column)})
    assert sure > 1000.0
    assert log_likelihood_ratios([doubted], BODY, DEAF)["whole"] == pytest.approx(8.0, rel=0.01)


def test_what_looks_alike_cannot_be_told_apart():
    """Of two equal pushes each is nothing without the other's doubt, the whole stays plain."""
    push = _push(500, 0.05)
    found = log_likelihood_ratios([_path(500, changes={"a": push, "b": push})], BODY, DEAF)
    # the other is as doubtful as it is large: one of its own sizes
    assert found["without"]["a"] == pytest.approx(0.5, rel=0.05)
    assert found["whole"] > 20.0


def test_an_attitude_bias_hides_a_level_push_but_no_other():
    """A tilt of the readings by 10 mrad is worth 0.1 m/s^2 of level velocity, and nothing upwards;
    with the accelerometer deaf the level push goes under.
    """
    noise = dataclasses.replace(
        DEAF, velocity_m_s=0.01, acceleration_m_s2=1e6, attitude_bias_rad=0.01
    )
    level, upward = (
        log_likelihood_ratios([_path(400, changes={"a": _push(400, 0.05, axis)})], BODY, noise)
        for axis in (0, 2)
    )
    assert level["whole"] < 0.5 * (0.05 / 0.8 / (9.81 * 0.01)) ** 2 * 1.01
    assert upward["whole"] > 100.0 * level["whole"]


def test_slow_poses_tell_less():
    noise = dataclasses.replace(DEAF, velocity_m_s=0.02, acceleration_m_s2=1e6)
    path = _path(400, changes={"a": _push(400, 0.02)})
    every = log_likelihood_ratios([path], BODY, noise)["whole"]
    fifth = log_likelihood_ratios([path], BODY, dataclasses.replace(noise, pose_every=5))["whole"]
    assert 0.1 * every < fifth < 0.35 * every


def test_gusty_seconds_count_less():
    """Where the level of the air is known to be high, readings weigh less."""
    n = 400
    level = np.where(np.arange(n) < n // 2, 0.2, 3.0)
    air = Air(((0.3, 0.3),), level=level)
    early, late = (
        log_likelihood_ratios(
            [_path(n, changes={"a": {"force_N": _push(n, 0.05)["force_N"] * part}}, air=air)],
            BODY,
            DEAF,
        )["whole"]
        for part in ((level < 1.0)[:, None], (level > 1.0)[:, None])
    )
    assert early > 5.0 * late


def test_power_is_that_of_the_best_test():
    assert power(np.array([0.0]), 0.02) == pytest.approx(0.02)
    assert power(np.array([2.0]), 0.05) == pytest.approx(norm.cdf(2.0 - norm.isf(0.05)))


def test_thinned_noise_tells_as_much():
    noise = dataclasses.replace(DEAF, velocity_m_s=0.05, velocity_drift=(0.004, 0.3))
    whole = log_likelihood_ratios(
        [_path(1200, 0.005, changes={"a": _push(1200, 0.03)})], BODY, noise
    )["whole"]
    thin = log_likelihood_ratios(
        [_path(300, 0.02, changes={"a": _push(300, 0.03)})], BODY, noise.thinned(4)
    )["whole"]
    assert thin == pytest.approx(whole, rel=0.05)


def test_nothing_concealed_is_nothing_to_tell():
    assert log_likelihood_ratios([_path()], BODY, Noise()) == {"whole": 0.0, "without": {}}
