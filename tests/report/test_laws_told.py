"""What a law reads as, in an engineer's words."""

import pytest

from ges.diagnose.report.laws import reads_as
from ges.simulator.laws import parse


@pytest.mark.parametrize(
    ("channel", "form", "words"),
    [
        ("force_y", "0.1 m g (V_x/v_h)", "an asymmetric frame"),
        (
            "force_z",
            "0.1 m g near(1 m, -2.5 m, 0.4 m)",
            "near x 1 m, y -2.5 m, within 0.4 m: something",
        ),
        ("moment_z", "0.1 m g L - 0.02 m g L (r/w_g)", "always there: a trim"),
    ],
)
def test_the_largest_term_says_what_it_looks_like(channel, form, words):
    assert words in reads_as(channel, parse(channel, form), {})
