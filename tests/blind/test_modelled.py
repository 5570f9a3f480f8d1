"""Score of what was modelled, against shares worked out by hand."""

import numpy as np
import pytest
from test_score_laws import HOVER_M_S, VEHICLE, WEIGHT_N

from ges.blind.score import modelled as score
from ges.blind.score.laws import true_laws
from ges.blind.score.modelled import modelled, modelled_scores
from ges.simulator import laws


def _found(**channels):
    """Diagnose with (recalibrated, after, interval of the reduction) by channel."""
    keys = ("recalibrated", "after", "reduction_ci95")
    return {"fit": {"channels": {n: dict(zip(keys, c, strict=True)) for n, c in channels.items()}}}


def test_the_share_is_of_what_the_truth_removes_in_the_channel_where_it_removes_most():
    found = _found(force_x_N=(1.0, 0.4, (0.5, 0.7)), moment_y_Nm=(0.1, 0.1, (0.0, 0.0)))
    one = modelled("a", "single", found, {"force_x_N": 0.2, "moment_y_Nm": 0.09})
    assert one.channel == "force_x_N"
    assert one.share == pytest.approx((1.0 - 0.4) / (1.0 - 0.2))


def test_what_is_worse_than_nothing_has_a_negative_share():
    found = _found(force_x_N=(1.0, 1.5, (-0.6, -0.4)))
    one = modelled("a", "single", found, {"force_x_N": 0.5})
    assert one.worse and one.share == pytest.approx(-1.0)


@pytest.mark.parametrize("of_truth", [{}, {"force_x_N": 0.995}, {"force_y_N": 0.1}])
def test_a_truth_that_the_flights_cannot_show_is_no_case(of_truth):
    assert modelled("a", "single", _found(force_x_N=(1.0, 0.5, (0.4, 0.6))), of_truth) is None


def test_a_null_is_worse_only_beyond_its_interval():
    worse, unsure = (_found(force_x_N=(1.0, 1.1, (-0.2, high))) for high in (-0.05, 0.05))
    outcomes = [modelled(n, "null", f, {}) for n, f in (("a", worse), ("b", unsure))]
    assert [m.worse for m in outcomes] == [True, False]
    scores = modelled_scores(outcomes)
    assert scores["nulls that get no worse"][0] == pytest.approx(0.5)
    assert np.isnan(scores["sets that are modelled"][0])


def test_the_median_and_the_share_of_sets_are_over_changed_sets():
    after = (0.1, 0.3, 1.0)
    outcomes = [
        modelled(str(a), "single", _found(force_x_N=(1.0, a, (0.0, 1.0))), {"force_x_N": 0.1})
        for a in after
    ]
    scores = modelled_scores(outcomes)
    median = scores["share of the error that the truth removes, median"]
    assert median[0] == pytest.approx(0.7 / 0.9) and median[3] == len(after)
    assert scores["sets that are modelled"][0] == pytest.approx(1 / 3)


def test_a_sealed_law_is_written_in_the_groups_of_a_vehicle_file():
    unit = 0.1 * WEIGHT_N / HOVER_M_S
    (law,) = true_laws(
        [{"channel": "force_y", "powers": {"V_x": 1}, "coefficient_SI": unit}], VEHICLE
    )
    (term,) = laws.parse("force_y", "1 m g (V_x/v_h)")
    assert law.terms()[term] == pytest.approx(0.1, rel=1e-3)


def test_names_that_are_true_are_fitted_and_channels_that_they_do_not_lower_are_left_out(
    monkeypatch, tmp_path
):
    given = []

    def diagnose(place, names):
        given.append((place, names))
        return _found(force_x_N=(1.0, 0.2, (0.7, 0.9)), force_y_N=(1.0, 0.9, (-0.1, 0.3)))

    monkeypatch.setattr(score, "diagnose_true_names", diagnose)
    errors = score.errors_of_truth(tmp_path, "a", {"findings": [{"name": "rotor_drag"}]})
    assert errors == {"force_x_N": 0.2}
    assert given == [(tmp_path / "cases" / "a", ["rotor_drag"])]
