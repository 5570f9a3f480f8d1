"""Candidates are laid out from where flights went: above the top, beyond the sides, over what was
visited.
"""

import math

import numpy as np
import pytest

from ges.diagnose.library.candidates import flight_envelope
from ges.diagnose.library.grids import library
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model

RADIUS_M = 0.1
MODEL = Model({f"rotor_{i}_radius_m": RADIUS_M for i in range(1, 5)})


@pytest.fixture
def flight():
    """A slow figure over 6 x 3 m between 1 and 2 m, the first tenth on the ground at
    another place.
    """
    t = np.arange(0.0, 60.0, 0.01)
    phase = 2.0 * np.pi * t / 60.0
    columns = {
        "p_x_m": 3.0 * np.sin(phase),
        "p_y_m": 1.5 * np.sin(2.0 * phase),
        "p_z_m": 1.5 + 0.5 * np.cos(phase),
    }
    columns |= {f"u_{i}": np.linspace(0.4, 0.8, len(t)) for i in range(1, 5)}
    flying = t >= 6.0
    columns["p_x_m"][~flying] = 50.0
    return Prepared(t, columns, flying, {}, {})


def test_only_what_was_flown_counts(flight):
    envelope = flight_envelope([flight], RADIUS_M)
    assert envelope.low_m == pytest.approx((-3.0, -1.5, 1.0), abs=0.01)
    assert envelope.high_m[0] == pytest.approx(3.0, abs=0.01)
    assert 1 < len(envelope.places_m) <= settings.library.places_most
    assert max(x for x, _ in envelope.places_m) < 3.0 + envelope.square_m
    assert min(envelope.commands) > 0.4 and max(envelope.commands) <= 0.8


def test_a_ceiling_is_above_and_walls_are_beyond(flight):
    envelope = flight_envelope([flight], RADIUS_M)
    found = library(MODEL, envelope)
    ceilings = [v.shape["ceiling_z_m"] for v in found["ceiling_effect"].variants]
    assert min(ceilings) > envelope.high_m[2] and len(set(ceilings)) == len(ceilings)
    for wall in found["wall_effect"].variants:
        c, s = math.cos(wall.shape["bearing_rad"]), math.sin(wall.shape["bearing_rad"])
        reach = (flight.columns["p_x_m"] * c + flight.columns["p_y_m"] * s)[flight.flying].max()
        assert wall.shape["distance_m"] == pytest.approx(reach + RADIUS_M, abs=1e-9)
    assert all(v.shape["other_z_m"] > envelope.high_m[2] for v in found["downwash"].variants)


def test_each_variant_has_a_name_of_its_own(flight):
    keys = [
        v.key
        for c in library(MODEL, flight_envelope([flight], RADIUS_M)).values()
        for v in c.variants
    ]
    assert len(set(keys)) == len(keys)


def test_what_was_not_logged_is_not_laid_out(flight):
    blind = flight.replace(columns={})
    assert not {"ceiling_effect", "wall_effect", "downwash", "rotor_saturation"} & set(
        library(MODEL, flight_envelope([blind], RADIUS_M))
    )
