"""A fit at its bounds: what is held there takes the others with it."""

import numpy as np
import pytest

from ges.diagnose.estimate.fit import _mean_within_bounds


def test_what_leaves_its_bounds_is_held_and_the_others_are_most_probable_beside_it():
    covariance, bounds = np.array([[4.0, 1.8], [1.8, 1.0]]), np.array([[-10.0, -10.0], [10.0, 0.0]])
    assert _mean_within_bounds(np.array([3.0, 1.0]), covariance, bounds) == pytest.approx(
        [3.0 - 1.8, 0.0]
    )


def test_nothing_moves_within_bounds():
    mean = np.array([3.0, -1.0])
    assert np.array_equal(
        _mean_within_bounds(mean, np.eye(2), np.array([[-10.0, -10.0], [10.0, 0.0]])), mean
    )


def test_several_held_at_once_are_at_their_bounds():
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.3], [0.5, 0.3, 1.0]])
    told = _mean_within_bounds(
        np.array([5.0, -5.0, 0.2]), covariance, np.array([[-1.0] * 3, [1.0] * 3])
    )
    assert told[:2] == pytest.approx([1.0, -1.0]) and -1.0 <= told[2] <= 1.0
