"""What flights cannot tell apart, by what both would do in them."""

import numpy as np
import pytest

from ges.diagnose.library.candidates import Candidate
from ges.diagnose.select.alike import alike_of
from ges.diagnose.select.evidence import make_regression
from ges.diagnose.select.scorer import entries
from ges.diagnose.select.search import search
from ges.diagnose.settings import settings

from ..synthetic import amplitude, nuisance, rows_of, system_of

ROWS = 400
NAMES = ("weak_rotor.loss_1", "weak_rotor.loss_2", "thrust_scale.scale", "rotor_tilt.x_rad")


def _searched(angle, size=0.2, more=()):
    """A search on flights where the first of NAMES acts, the others at an angle to it in rad."""
    rng = np.random.default_rng(3)
    made = []
    for _ in range(2):
        one, other = rng.standard_normal((2, ROWS))
        turned = np.cos(angle) * one + np.sin(angle) * other
        x = [one, turned, turned, rng.standard_normal(ROWS)]
        rows = 0.1 * rng.standard_normal(ROWS) + size * one
        made.append(rows_of(rows[:, None], [{0: c} for c in (*x, *(x[0] for _ in more))]))
    columns = [*map(amplitude, NAMES), *more]
    regression = make_regression(system_of(("force_z",), columns, made))
    variants = [c.variant for c in columns if c.variant is not None]
    listed = [
        Candidate(n, "physics", tuple(v for v in variants if v.effect == n))
        for n in dict.fromkeys(v.effect for v in variants)
    ]
    found = search(regression, listed)
    return regression, found.best_with("weak_rotor"), tuple(entries(regression, listed))


def test_what_does_the_same_is_alike_and_what_does_otherwise_is_not():
    found = alike_of(*_arguments(_searched(angle=1e-3)))
    assert {(a.name, a.place) for a in found} == {("weak_rotor", "rotor 2"), ("thrust_scale", "")}
    assert not alike_of(*_arguments(_searched(angle=0.5)))


def _arguments(searched):
    regression, h, listed = searched
    return regression, h, "weak_rotor", listed


def test_the_odds_to_be_expected_grow_with_what_a_rival_leaves():
    """Half the square of what it leaves over the noise, every row counted by its share."""
    angle = 0.05
    regression, h, listed = _searched(angle)
    (place,) = (a for a in alike_of(regression, h, "weak_rotor", listed) if a.place)
    own = [h.posterior.columns[0]]
    whole = regression.pool().xx[own[0], own[0]] * h.posterior.mean[0] ** 2
    assert place.expected_log_odds == pytest.approx(0.5 * whole * np.sin(angle) ** 2, rel=0.3)
    assert place.expected_log_odds < settings.statistics.acceptance_log_odds


def test_of_a_name_that_hardly_shows_nothing_is_a_rival():
    """Nothing at all would do as well, which is another question."""
    assert not alike_of(*_arguments(_searched(angle=1e-3, size=0.001)))


def test_what_a_nuisance_takes_up_tells_nothing_apart():
    """Beside a trim that is free, the two are told by what it leaves of them."""
    trim = nuisance("cg_offset.x_m", sd=10.0)
    assert not alike_of(*_arguments(_searched(angle=1e-3, more=(trim,))))
