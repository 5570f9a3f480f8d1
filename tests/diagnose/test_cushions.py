"""A cushion that fades with speed or lags so much that no plain one is near: it is found, and
fitted, with what modifies it.
"""

import pytest

import ges
from ges.diagnose.library import grids
from ges.diagnose.library.candidates import modifiers_of
from ges.diagnose.library.grids import library
from ges.diagnose.types.model import from_vehicle
from ges.simulator import effects as effect_table
from ges.simulator import manoeuvres

CUSHION = {"form": 3.0, "amplitude": 1.0, "c_a": 0.28, "decay": 0.36, "low": 0.0, "high": 10.0}
LOW = (
    manoeuvres.straight_runs(30.0, 6.0, 0.3),
    manoeuvres.height_staircase(30.0, 0.25, 1.5),
    manoeuvres.climbs(20.0),
)
RATES = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")


@pytest.fixture(scope="module")
def diagnosed(flown, sheet):
    def made(effects):
        vehicle = sheet()
        return ges.diagnose(
            [flown(vehicle, effects, table, seed, RATES) for seed, table in enumerate(LOW, 1)],
            vehicle,
            holdout=["flight3"],
        )

    return made


@pytest.fixture(scope="module")
def fading():
    return {"ground_effect": CUSHION, "ground_effect_forward_flight": {"c": 6.0}}


@pytest.mark.slow
def test_a_cushion_that_fades_fast_is_found_with_its_fading(diagnosed, fading):
    """Its plain cushion alone does not stand: nothing at all was proven."""
    found = diagnosed(fading)
    told = {f.name: f for f in found.findings}
    assert found.verdict == "physics" and set(told) == set(fading)
    assert told["ground_effect_forward_flight"].parameters["c"].value == pytest.approx(6.0, rel=0.1)
    assert all(f.probability > 0.9 for f in told.values())


@pytest.mark.slow
def test_without_cushions_that_are_modified_nothing_is(diagnosed, fading, monkeypatch):
    def plain(search):
        return () if search.hints.modified else grids._grid(search)

    monkeypatch.setitem(grids.RULES, "", plain)
    assert not diagnosed(fading).findings


def test_a_plain_cushion_is_given_no_modifier(diagnosed):
    assert [f.name for f in diagnosed({"ground_effect": CUSHION}).findings] == ["ground_effect"]


def test_only_what_acts_through_a_variant_modifies_it(sheet):
    """A wind brings a usual drag along, through which it acts itself. Another moment of the same
    gain is no modifier: every variant has one.
    """
    listed = library(from_vehicle(sheet()))
    carried = {e.name for e in effect_table.table().values() if e.carried}
    assert {m for v in listed["ground_effect"].variants for m in modifiers_of(v)} == carried - {
        "ground_effect_moment"
    }
    assert all(v.moment_gain is not None for v in listed["ground_effect"].variants)
    assert any(v.given for v in listed["wind"].variants) and not any(
        modifiers_of(v) for v in listed["wind"].variants
    )


def test_what_the_vehicle_file_has_is_not_brought_along(sheet):
    known = sheet(effects={"ground_effect_forward_flight": {"c": 0.5}})
    brought = {
        m for v in library(from_vehicle(known))["ground_effect"].variants for m in modifiers_of(v)
    }
    assert brought == {"ground_effect_lag"}
