"""What sets are weighed on: shares of variants, and nuisances that a candidate of their own
frees.
"""

import dataclasses

import numpy as np
import pytest
from scipy.special import logsumexp

from ges.diagnose.library.candidates import Candidate
from ges.diagnose.select.evidence import make_regression, posterior
from ges.diagnose.select.scorer import entries, set_scorer
from ges.diagnose.settings import settings, using

from ..synthetic import amplitude, nuisance, rows_of, system_of

ROWS = 300


def _regression(columns, seed=0, flights=2, planted=()):
    """A regression on noise, with coefficients planted by column."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(flights):
        x = rng.standard_normal((len(columns), ROWS))
        y = 0.1 * rng.standard_normal(ROWS) + sum(size * x[k] for k, size in planted)
        made.append(rows_of(y[:, None], [{0: row} for row in x]))
    return make_regression(system_of(("force_z",), columns, made))


def _candidates(regression):
    """Candidates by name, of the variants of the regression."""
    by_name: dict = {}
    for c in regression.system.columns:
        if c.variant is not None:
            by_name.setdefault(c.variant.effect, {})[c.variant.key] = c.variant
    return [Candidate(n, "physics", tuple(v.values())) for n, v in by_name.items()]


def _shaped(key, **shape):
    column = amplitude(key)
    return dataclasses.replace(column, variant=dataclasses.replace(column.variant, shape=shape))


def test_shares_of_the_variants_of_a_name_add_up_to_one():
    columns = [
        *(_shaped("parasitic_drag.area_m2", vertical_ratio=r) for r in (1.0, 1.7, 2.0)),
        amplitude("rotor_drag.k_kg"),
    ]
    regression = _regression(columns)
    listed = entries(regression, _candidates(regression))
    for name, count in (("parasitic_drag", 3), ("rotor_drag", 1)):
        shares = [e.log_share for e in listed if e.name == name]
        assert len(shares) == count and logsumexp(shares) == pytest.approx(0.0, abs=1e-12)


def test_two_places_of_one_name_are_as_much_rarer_as_two_causes_are():
    one, other = amplitude("weak_rotor.loss_1"), amplitude("weak_rotor.loss_2")
    both = dataclasses.replace(
        one.variant, amplitudes=(*one.variant.amplitudes, *other.variant.amplitudes)
    )
    pair = [dataclasses.replace(one, variant=both, amplitude=j) for j in (0, 1)]
    regression = _regression([one, other, *pair])
    listed = {e.columns: e for e in entries(regression, _candidates(regression))}
    assert set(listed) == {(0,), (1,), (2, 3)}
    sizes = settings.search.size_probabilities
    # two variants of one place share the weight of one cause, the one of two that of two
    weight = np.array([0.5, 0.5, sizes[2] / sizes[1]])
    expected = np.log(weight / np.array([1.0, 1.0, 1.0]) / (1.0 + sizes[2] / sizes[1]))
    found = [listed[k].log_share for k in ((0,), (1,), (2, 3))]
    np.testing.assert_allclose(found, expected)


def test_only_what_is_asked_for_is_listed():
    regression = _regression([amplitude("rotor_drag.k_kg"), amplitude("tether.weight_N_m")])
    drag = [c for c in _candidates(regression) if c.name == "rotor_drag"]
    (entry,) = entries(regression, drag)
    assert entry.name == "rotor_drag" and entry.columns == (0,)
    assert entry.keys == ("rotor_drag.k_kg",)


def test_sets_are_weighed_by_their_own_columns_whatever_else_is_listed():
    columns = [amplitude(k) for k in ("rotor_drag.k_kg", "tether.weight_N_m", "axial_inflow.k_kg")]
    regression = _regression([*columns, nuisance("thrust_scale.scale", 0.2)], planted=[(0, 0.3)])
    listed = entries(regression, _candidates(regression))
    on = set_scorer(regression, listed)
    sets = [(listed[0],), (listed[1], listed[2]), (listed[2], listed[0])]
    gram = regression.pool()
    told = on.log_evidences(sets)
    for chosen, value, found in zip(sets, told, on.posteriors(sets), strict=True):
        own = [k for e in chosen for k in e.columns]
        assert value == pytest.approx(posterior(gram, own, regression.prior).log_evidence)
        assert found.columns == tuple(own) and found.log_evidence == pytest.approx(value)
    assert on.best(sets) == sets[int(np.argmax(told))]


def test_few_sets_at_once_are_weighed_as_many():
    regression = _regression([amplitude("rotor_drag.k_kg"), amplitude("tether.weight_N_m")])
    listed = entries(regression, _candidates(regression))
    sets = [(e,) for e in listed] * 3
    many = set_scorer(regression, listed).log_evidences(sets)
    with using({"numerics.sets_at_once": 2}):
        np.testing.assert_allclose(set_scorer(regression, listed).log_evidences(sets), many)


@pytest.mark.parametrize("mean", [0.0, 0.1])
def test_a_candidate_of_a_declared_number_takes_the_place_of_its_doubt(mean):
    """Beside it the doubt is known to be zero: never the sum of both. Against the normal equations
    from which the doubt was left out before.
    """
    doubt = nuisance("thrust_scale.scale", 0.05, mean=mean)
    columns = [amplitude("thrust_scale.scale"), amplitude("tether.weight_N_m"), doubt]
    regression = _regression(columns, planted=[(0, 0.2)])
    listed = {e.name: e for e in entries(regression, _candidates(regression))}
    on = set_scorer(regression, list(listed.values()))
    without = regression.pool((2,))
    null = posterior(without, [2], regression.prior)
    for names in (("thrust_scale",), ("thrust_scale", "tether")):
        chosen = [listed[n] for n in names]
        own = [k for e in chosen for k in e.columns]
        alone = posterior(without, own, regression.prior)
        (told,) = on.posteriors([chosen])
        assert told.log_evidence == pytest.approx(alone.log_evidence - null.log_evidence)
        np.testing.assert_allclose(told.mean, alone.mean, rtol=1e-6)
        np.testing.assert_allclose(told.covariance, alone.covariance, rtol=1e-6)
    (beside,) = on.posteriors([(listed["tether"],)])
    kept = posterior(regression.pool(), listed["tether"].columns, regression.prior)
    assert beside.log_evidence == pytest.approx(kept.log_evidence), "the doubt takes part"
