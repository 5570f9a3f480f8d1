"""Rotor speeds given their readings and the commands."""

import numpy as np
import pytest

from ges.diagnose.design.speeds import expected_speeds

NOISE_RAD_S, DT_S = 3.0, 0.005


def _made(rng, n=3000, rotors=4):
    steps = rng.normal(0.0, 20.0, (n, rotors))
    return 600.0 + np.stack(
        [np.convolve(s, np.exp(-np.arange(80) / 20.0), "same") for s in steps.T], axis=1
    )


def _lagged(made, rows):
    out, keep = np.empty_like(made), np.exp(-1.0 / rows)
    out[0] = made[0]
    for k in range(1, len(made)):
        out[k] = keep * out[k - 1] + (1.0 - keep) * made[k]
    return out


@pytest.mark.parametrize("late_rows", [0.1, 0.5, 1.0])
def test_noise_goes_and_a_wrong_lag_stays(late_rows):
    rng = np.random.default_rng(1)
    made = _made(rng)
    true = _lagged(made, late_rows) + 12.0
    found = expected_speeds(true + rng.normal(0.0, NOISE_RAD_S, made.shape), made, DT_S)
    inner = slice(50, -50)
    assert np.std((found - true)[inner]) < 0.4 * NOISE_RAD_S
    assert abs(np.mean((found - true)[inner])) < 0.1


def test_what_the_commands_do_not_say_is_taken_from_the_readings():
    rng = np.random.default_rng(2)
    made = _made(rng)
    true = made.copy()
    true[1000:2000, 2] *= 0.9
    found = expected_speeds(true + rng.normal(0.0, 1.0, made.shape), made, DT_S)
    assert np.sqrt(np.mean((found - true)[:, 2] ** 2)) < 1.0
    assert np.allclose(found[1200:1800, 2].mean(), true[1200:1800, 2].mean(), atol=0.5)


def test_readings_without_noise_are_what_was():
    made = _made(np.random.default_rng(3))
    true = _lagged(made, 4.0)
    assert np.std(expected_speeds(true, made, DT_S) - true) < 0.02 * np.std(true - made)
