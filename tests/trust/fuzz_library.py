"""Flights, replays and grounds that nobody would ask for, given to the compiled simulator: each is
flown or refused in a sentence. Run by test_fuzz_library.py with a library that has sanitizers; the
last thing that was tried is in the file that is named.

    GES_LIBRARY=build/libges.so python tests/trust/fuzz_library.py last.txt
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import NUMBERS, examples

from ges.conventions import MAX_ROTORS
from ges.errors import GesError
from ges.simulator import _lib, effects, flight, laws
from ges.simulator.parameters import parameter_vector, parameters
from ges.simulator.terrain import Terrain

LAST = Path(sys.argv[1])
LONGEST = {"duration_s": 0.05, "record_every": 1e6, "terrain_length_m": 2500.0}
"""Bounds on what takes long by right, below those of the library."""


@st.composite
def numbers(draw: st.DrawFn) -> dict[str, float]:
    """Some parameters at and beyond their bounds, or of no size at all."""
    known = parameters()
    given: dict[str, float] = {"duration_s": draw(st.sampled_from([1e-6, 0.003, 0.05]))}
    for name in draw(st.lists(st.sampled_from(sorted(known)), max_size=8)):
        p = known[name]
        allowed = st.floats(p.low, min(p.high, LONGEST.get(name, p.high)))
        ends = st.sampled_from([p.low, min(p.high, LONGEST.get(name, p.high)), p.default])
        wild = NUMBERS.filter(lambda x, p=p: not p.low <= x <= p.high)
        # one that is wrong is refused, and hides all others
        value = draw(wild if draw(st.integers(0, 30)) == 0 else st.one_of(allowed, ends))
        given[name] = float("inf") if isinstance(value, int) and abs(value) > 2**60 else value
    return given


@st.composite
def switched_on(draw: st.DrawFn) -> dict[str, dict[str, float]]:
    """Effects and terms of laws, by no means those that go together."""
    found = {}
    for name in draw(st.lists(st.sampled_from(sorted(effects.table())), max_size=6, unique=True)):
        some = draw(st.lists(st.sampled_from(effects.get(name).parameters), max_size=4))
        wild = st.floats() if draw(st.integers(0, 9)) == 0 else st.nothing()
        found[name] = {p.name: draw(st.one_of(st.floats(p.low, p.high), wild)) for p in some}
    if draw(st.booleans()):
        form = draw(st.sampled_from(["0.1 V_x/v_h", "1e300 (R/h)^9", "-3 |V_z/v_h| (V_x/v_h)"]))
        channel = draw(st.sampled_from(["force_z", "moment_x"]))
        with contextlib.suppress(GesError):
            found[laws.LAW] = {t.key: c for t, c in laws.parse(channel, form).items()}
    return found


GROUNDS = st.one_of(
    st.floats(-1e4, 1e4).map(Terrain.flat),
    st.integers(0, 2**40).map(Terrain.procedural),
    st.lists(st.floats(-1e6, 1e6), min_size=4, max_size=4).map(
        lambda z: Terrain.grid([0.0, 1.0], [-1e-9, 1e9], np.reshape(z, (2, 2)))
    ),
    st.just(Terrain("grid")),
)
TABLES = st.one_of(
    st.none(),
    st.tuples(st.integers(0, 40), st.integers(1, 30), st.floats()).map(
        lambda shape: np.full(shape[:2], shape[2])
    ),
)


@examples(3000)
@given(
    st.lists(st.tuples(numbers(), switched_on(), GROUNDS, TABLES), min_size=1, max_size=5),
    st.lists(st.sampled_from(sorted(flight.columns(16))), max_size=6),
    st.sampled_from([0, 1, 2, 3, 4, 8, -1, 1000]),
)
def fly(asked, wanted, lanes) -> None:
    LAST.write_text(f"fly {asked!r} {wanted!r} {lanes}")
    try:
        with np.errstate(all="ignore"):
            flight.fly([flight.Flight(*one) for one in asked], wanted or None, lanes=lanes)
    except (GesError, MemoryError):
        pass


@examples(2000)
@given(numbers(), st.lists(switched_on(), min_size=1, max_size=9), st.data())
def replay(asked, sets, data) -> None:
    """Below the checks of Python: what it would refuse goes to the library as it is."""
    # as many as the largest vehicle has
    inputs, outputs = (
        sum(MAX_ROTORS if rotor == -1 else 1 for *_, rotor in table)
        for table in _lib.replay_tables()
    )
    rows = data.draw(st.integers(0, 20))
    value = data.draw(st.floats())
    samples = np.full((inputs, rows), value)
    for row in data.draw(st.lists(st.integers(0, inputs - 1), max_size=5)):
        samples[row] = data.draw(st.floats())
    ids = data.draw(st.lists(st.integers(-3, 60), max_size=4))
    LAST.write_text(f"replay {asked!r} {sets!r} {ids} {samples!r}")
    packed = _lib.pack_effects([(number, [value]) for number in ids])
    packed.n = data.draw(st.sampled_from([packed.n, -1, 41, 2**31 - 1]))
    packed.n_terms = data.draw(st.sampled_from([0, 1, -1, 25]))
    lanes = data.draw(st.sampled_from([0, 1, 2, 3, 4, 8, -1, 1000]))
    columns = data.draw(st.lists(st.integers(-1, outputs), max_size=5))
    try:
        vector = parameter_vector(asked)
        _lib.replay(vector, [packed] * len(sets), None, samples, columns, lanes)
    except (GesError, MemoryError):
        pass


@examples(1000)
@given(numbers(), st.lists(st.floats(), max_size=9), st.lists(st.floats(-1e6, 1e6), min_size=9))
def ground(asked, places, heights) -> None:
    LAST.write_text(f"ground {asked!r} {places!r} {heights!r}")
    x = np.array(places, dtype=float)
    grid = _lib.pack_grid(np.arange(3.0), np.arange(3.0), np.reshape(heights[:9], (3, 3)))
    with contextlib.suppress(GesError, MemoryError):
        _lib.terrain(parameter_vector(asked), grid, x, x[::-1].copy())


if __name__ == "__main__":
    for target in (fly, replay, ground):
        target()
    print("done")
