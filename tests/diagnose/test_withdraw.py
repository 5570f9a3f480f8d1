"""What is taken back of an answer, and what stands."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import withdraw
from ges.diagnose.types.decision import Record

MAIN = {"rotor_drag": "force_x", "weak_rotor": "moment_x"}


@pytest.mark.parametrize(
    ("channel", "stands"),
    [("moment_x", ("rotor_drag",)), ("acc_y", ("weak_rotor",)), ("range", tuple(MAIN))],
)
def test_a_misfit_counts_against_the_name_that_mainly_acts_there(channel, stands, monkeypatch):
    """An accelerometer shows a force, and one cause moves both axes; what no name mainly makes is
    told beside them.
    """
    left = [SimpleNamespace(channel=channel, regime=("height_over_radius",), r2=0.5)]
    accepted = SimpleNamespace(names=tuple(MAIN), rivals=())
    answer = withdraw.Answer(accepted, None, None, [], MAIN)
    for name, stub in {
        "borrowed": lambda found, model: left,
        "theirs": lambda *_: left,
        "size_of": lambda added, system: {"channel": added},
        "without": lambda a, name: SimpleNamespace(
            names=tuple(n for n in a.names if n != name), rivals=()
        ),
        "_answer": lambda a, *_: withdraw.Answer(a, None, None, [], {n: MAIN[n] for n in a.names}),
    }.items():
        monkeypatch.setattr(withdraw, name, stub)
    record = Record()
    start = SimpleNamespace(system=SimpleNamespace(model=None))
    told = withdraw._not_borrowed(answer, start, None, record)
    assert told.accepted.names == stands
    assert [d.passed for n in MAIN for d in record.of(n)] == [n in stands for n in MAIN]
