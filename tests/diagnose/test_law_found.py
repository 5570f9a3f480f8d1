"""A law that no effect has: found in flights of the project's own simulator, proven on one that
took no part, flown by the fitted vehicle, and told.
"""

import numpy as np
import pytest

import ges
from ges.diagnose.report.page import render
from ges.simulator import manoeuvres
from ges.simulator.laws import LAW
from ges.vehicle.file import parse_vehicle, vehicle_content

SIDE = {"force_y: m g (V_x/v_h)": 0.08}
PLANS = (
    manoeuvres.straight_runs(30.0),
    manoeuvres.multisine(25.0),
    manoeuvres.straight_runs(30.0, 2.0),
    manoeuvres.climbs(20.0),
)


@pytest.fixture(scope="module")
def found(sheet, flown, with_rates):
    vehicle = sheet()
    flights = [
        flown(vehicle, {LAW: SIDE}, plan, 20 + k, with_rates) for k, plan in enumerate(PLANS)
    ]
    frames = {f"f{k}": f for k, f in enumerate(flights)}
    return ges.diagnose(frames, vehicle, holdout=("f2",))


def test_the_law_is_found_and_no_name_is_told(found):
    assert found.verdict == "law" and not found.findings and not found.unexplained
    (law,) = found.laws
    (term,) = law["terms"]
    assert (law["channel"], term["term"]) == ("force_y", "m g (V_x/v_h)")
    assert term["ci95"][0] < 0.08 < term["ci95"][1]
    assert term["coefficient"] == pytest.approx(0.08, rel=0.05)


def test_it_is_proven_on_the_flight_that_took_no_part(found):
    row = found.fit["channels"]["force_y_N"]
    assert row["names_only"] == pytest.approx(row["recalibrated"], rel=0.02)
    # the rest is noise of the velocity
    assert row["after"] < 0.7 * row["recalibrated"] and row["reduction_ci95"][0] > 0.2
    rolled = found.fit["rollout"]["channels"]["p_y_m"]
    assert rolled["after"] < 0.3 * rolled["names_only"]


def test_no_other_channel_gets_worse(found):
    """By more than one in a hundred of what recalibration leaves."""
    rows = found.fit["channels"].values()
    assert all(row["after"] < 1.01 * row["recalibrated"] for row in rows)


def test_the_fitted_vehicle_flies_it(found):
    again = parse_vehicle(vehicle_content(found.vehicle))
    (law,) = again.laws
    assert law.channel == "force_y" and len(law.sd) == 1 and law.sd[0] > 0.0
    assert list(again.effect_values()[LAW]) == list(SIDE)


def test_the_sentence_and_the_page_have_the_law_and_its_gain(found):
    form = found.laws[0]["form"]
    assert form in found.sentence and "not" in found.sentence
    page = render(found.content())
    assert form in page and "names alone" in page and "asymmetric frame" in page


def test_a_vehicle_that_has_the_law_already_gets_none(found, sheet, flown, with_rates):
    flights = {
        f"f{k}": flown(sheet(), {LAW: SIDE}, plan, 20 + k, with_rates)
        for k, plan in enumerate(PLANS)
    }
    having = sheet().model_copy(update={"laws": found.vehicle.laws})
    again = ges.diagnose(flights, having, holdout=("f2",))
    assert again.verdict == "nothing_proven" and not again.laws


def test_healthy_flights_have_no_law(sheet, flown, with_rates):
    for seed in range(3):
        flights = {
            f"f{k}": flown(sheet(), {}, plan, 100 * seed + k, with_rates)
            for k, plan in enumerate(PLANS)
        }
        healthy = ges.diagnose(flights, sheet(), holdout=("f2",))
        assert not healthy.laws and "names_only" not in healthy.fit["channels"]["force_y_N"]


def test_names_that_are_given_have_no_law_beside_them(sheet, flown, with_rates):
    flights = {
        f"f{k}": flown(sheet(), {LAW: SIDE}, plan, 20 + k, with_rates)
        for k, plan in enumerate(PLANS[:3])
    }
    only = ges.diagnose(flights, sheet(), holdout=("f2",), names=("rotor_drag",))
    assert not only.laws
    assert np.isfinite(only.fit["channels"]["force_y_N"]["after"])


DAMPING = {"moment_z: m g L (r/w_g)": -0.03}


def _turning(duration_s, period_s):
    """Turns to and fro by a radian and a half while hovering."""
    plan = manoeuvres.hover(duration_s)
    t_s = manoeuvres.STEP_S * np.arange(len(plan))
    plan[:, 9] = 1.5 * np.sin(2.0 * np.pi * t_s / period_s)
    return plan


def test_damping_of_yaw_is_seen_over_the_yaw_rate_and_no_number_stands_for_it(
    sheet, flown, with_rates
):
    """Recalibration takes a torque coefficient for it, which goes back once the law is there."""
    plans = [_turning(25.0, period_s) for period_s in (6.0, 8.0, 5.0, 7.0)]
    flights = {
        f"f{k}": flown(sheet(), {LAW: DAMPING}, plan, 40 + k, with_rates)
        for k, plan in enumerate(plans)
    }
    found = ges.diagnose(flights, sheet(), holdout=("f3",))
    assert found.verdict == "law" and not found.findings
    (law,) = found.laws
    assert [t["term"] for t in law["terms"]] == ["m g L (r/w_g)"]
    assert law["terms"][0]["coefficient"] == pytest.approx(-0.03, rel=0.15)
    row = found.fit["channels"]["moment_z_Nm"]
    assert row["after"] < 0.7 * row["recalibrated"]
    for key in ("torque_coefficient.scale", "thrust_scale.scale"):
        number = found.calibration[key]
        assert abs(number["value"]) < 2.0 * number["prior_sd"]


def test_a_law_is_as_uncertain_as_the_inertia_that_scales_it(sheet, flown, with_rates):
    """Flights show what a moment is over the inertia; both are a tenth larger in the file."""
    plans = [_turning(25.0, period_s) for period_s in (6.0, 8.0, 5.0)]
    flights = {
        f"f{k}": flown(sheet(), {LAW: DAMPING}, plan, 40 + k, with_rates)
        for k, plan in enumerate(plans)
    }
    larger = sheet(
        inertia_kg_m2={"xx": 0.01, "yy": 0.01, "zz": 0.0198, "sd_rel": 0.1},
        torque_coefficient_Nm_s2={"value": 1.1e-7, "sd_rel": 0.1},
    )
    (law,) = ges.diagnose(flights, larger).laws
    (term,) = law["terms"]
    low, high = term["ci95"]
    assert term["term"] == "m g L (r/w_g)" and low < -0.03 < high
    assert (high - low) / 2.0 > 0.1 * abs(term["coefficient"])
