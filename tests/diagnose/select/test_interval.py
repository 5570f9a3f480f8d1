"""What a number's prior allows is no finding, and gives no evidence for one."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from ges.diagnose.select.evidence import make_regression, posterior
from ges.diagnose.select.interval import interval_null
from ges.diagnose.select.scorer import Entry, set_scorer
from ges.diagnose.settings import settings

from ..synthetic import amplitude, nuisance, rows_of, system_of

KEYS = ("inertia.xx", "inertia.yy", "rotor_drag.k_kg", "inertia.xx")
SD = 0.07
COLUMNS = [
    amplitude(KEYS[0]),
    amplitude(KEYS[1]),
    amplitude(KEYS[2]),
    dataclasses.replace(amplitude(KEYS[0]), part="moment"),
    nuisance(KEYS[0], SD),
    nuisance(KEYS[1], SD),
]


@pytest.fixture(scope="module")
def regression():
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((len(COLUMNS), 300))
    return make_regression(
        system_of(
            ("force_z",), COLUMNS, [rows_of(rng.standard_normal((300, 1)), [{0: r} for r in rows])]
        )
    )


def _log_evidence(regression, own, mean, sd):
    null = interval_null(regression.system, regression.prior)
    return null.log_evidence(*(np.array([x]) for x in (own, mean, sd)))[0]


def _beyond(mean, sd):
    reach = settings.statistics.certain_sds * SD
    return norm.sf(reach, mean, sd) + norm.cdf(-reach, mean, sd)


@pytest.mark.parametrize("mean", [0.0, 0.2, 0.3, -0.6])
def test_evidence_is_the_mass_beyond_the_interval_over_that_of_the_prior(regression, mean):
    prior = _beyond(regression.prior.mean[0], regression.prior.sd[0])
    gain = _log_evidence(regression, (0,), (mean,), (0.05,))
    assert gain == pytest.approx(np.log(_beyond(mean, 0.05) / prior), abs=1e-9)


def test_one_of_two_coefficients_beyond_is_enough(regression):
    """Neither in the prior nor in the posterior do they depend on each other here."""
    priors = [_beyond(regression.prior.mean[k], regression.prior.sd[k]) for k in (0, 1)]
    some = [
        1.0 - (1.0 - a) * (1.0 - b) for a, b in (priors, (_beyond(0.5, 0.1), _beyond(0.0, 0.1)))
    ]
    gain = _log_evidence(regression, (0, 1), (0.5, 0.0), (0.1, 0.1))
    assert gain == pytest.approx(np.log(some[1] / some[0]), abs=1e-9)


def test_each_of_several_places_has_to_be_beyond():
    """A rotor that lost thrust is a cause, and so is another."""
    one, other = amplitude("weak_rotor.loss_1"), amplitude("weak_rotor.loss_2")
    pair = dataclasses.replace(
        one.variant, amplitudes=(*one.variant.amplitudes, *other.variant.amplitudes)
    )
    columns = [dataclasses.replace(one, variant=pair, amplitude=j) for j in (0, 1)]
    columns += [nuisance("weak_rotor.loss_1", SD), nuisance("weak_rotor.loss_2", SD)]
    rows = np.random.default_rng(1).standard_normal((5, 300))
    made = rows_of(rows[4][:, None], [{0: r} for r in rows[:4]])
    regression = make_regression(system_of(("force_z",), columns, [made]))
    gains = [_log_evidence(regression, (0, 1), (0.5, mean), (0.05, 0.05)) for mean in (0.5, 0.1)]
    assert gains[0] > 0.0 > gains[1] + 5.0


def test_what_has_no_prior_is_beyond_it_and_a_moment_alone_is_not(regression):
    assert _log_evidence(regression, (2,), (0.0,), (1e-5,)) == 0.0
    alone = _log_evidence(regression, (0,), (0.2,), (0.05,))
    beside = _log_evidence(regression, (0, 2, 3), (0.2, 1e-3, 9.0), (0.05, 1e-5, 0.1))
    assert beside == pytest.approx(alone, abs=1e-9)


def test_where_a_bound_is_nothing_is_beyond_on_that_side(regression):
    bounded = dataclasses.replace(regression.prior, low=np.full(len(COLUMNS), -0.1))
    null = interval_null(regression.system, bounded)
    own, sd = np.array([[0]]), np.array([[0.05]])
    far = [null.log_evidence(own, np.array([[mean]]), sd)[0] for mean in (-9.0, 9.0)]
    assert far[0] < -100.0 and far[1] > 0.0


def test_a_set_is_scored_with_it(regression):
    entries = [
        Entry("inertia", 0, (0,), KEYS[:1], 0.0),
        Entry("rotor_drag", 1, (2,), KEYS[2:3], 0.0),
    ]
    scorer = set_scorer(regression, entries)
    of_drag = posterior(scorer.gram, (2,), scorer.prior)
    assert scorer.posteriors([entries[1:]])[0].log_evidence == pytest.approx(of_drag.log_evidence)
    one = scorer.posteriors([entries[:1]])[0]
    without = dataclasses.replace(
        scorer, null=dataclasses.replace(scorer.null, low=np.full(len(COLUMNS), np.nan))
    )
    plain = without.posteriors([entries[:1]])[0]
    assert one.log_evidence == pytest.approx(
        plain.log_evidence + _log_evidence(regression, (0,), plain.mean, plain.sd)
    )
    assert one.log_evidence < plain.log_evidence, "noise is within the prior"
