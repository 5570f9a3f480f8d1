"""Parts of long flights that recalibration begins with."""

import numpy as np

from ges.diagnose.locate.stages import nested_parts
from ges.diagnose.settings import settings

from ..synthetic import hovering


def test_each_part_is_a_quarter_of_the_next_and_in_the_air():
    long = hovering(500.0)
    air = (long.t_s > 100.0) & (long.t_s < 450.0)
    found = nested_parts([long.replace(flying=air), hovering(40.0)])
    lengths = [[round(len(f.t_s) * f.dt_s) for f in some] for some in found]
    assert lengths == [[31, 30], [125, 30]]
    for first, second in found:
        assert first.flying.all() and second.flying.all()
        assert all(len(values) == len(first.t_s) for values in first.columns.values())
        # rows keep their times
        at = np.searchsorted(long.t_s, first.t_s[0])
        np.testing.assert_array_equal(first.t_s, long.t_s[at : at + len(first.t_s)])


def test_short_flights_have_no_parts():
    assert nested_parts([hovering(4.0 * settings.advise.duration_s - 1.0)]) == []
