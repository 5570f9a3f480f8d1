"""A small set of concealed cases, made once."""

from __future__ import annotations

import dataclasses

import pytest

from ges.blind.generator import grid, make
from ges.blind.generator.grid import Spec
from ges.blind.protocol import seal


@pytest.fixture(scope="session")
def flown():
    """Two cases in the same circumstances, one with something concealed: (specs, cases, their
    flights at 250 Hz).
    """
    from ges.blind.generator.flight import Simulation

    specs = [Spec(0, "single", ("rotor_drag",), (2,), "650g"), Spec(0, "null", (), (), "650g")]
    cases = [make.draw_case(s, "tiny", 5) for s in specs]
    cases = [dataclasses.replace(c, sorties=c.sorties[:2]) for c in cases]
    book = Simulation([s for c in cases for s in c.sorties]).run()
    parts = [
        [
            {n: v[: s.plan.reference.shape[1], :, 2 * k + f] for n, v in book.items()}
            for f, s in enumerate(c.sorties)
        ]
        for k, c in enumerate(cases)
    ]
    return specs, cases, parts


@pytest.fixture(scope="session")
def proof(tmp_path_factory, flown):
    """A sealed folder of two cases of two flights each."""
    folder = tmp_path_factory.mktemp("proof")
    for part in ("cases", "sealed"):
        (folder / part).mkdir()
    _, cases, parts = flown
    limits = make.detectable_of(cases, parts)
    for number, (case, flights, limit) in enumerate(zip(cases, parts, limits, strict=True)):
        around = dataclasses.replace(case.around, identity=f"{number:012x}")
        make._write_case(dataclasses.replace(case, around=around), flights, limit, folder, 5)
    seal.close(folder)
    return folder


@pytest.fixture(scope="session")
def every_spec():
    """All cases of the full grid."""
    return grid.specs("full", 3)
