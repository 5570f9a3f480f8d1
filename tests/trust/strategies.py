"""Damage for Hypothesis: values that no file should hold, trees with some of them in it, bytes that
are changed.
"""

from __future__ import annotations

import copy
import os
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

LONGER = float(os.environ.get("GES_FUZZ", "1"))
"""How many times the usual examples; beyond one they are other examples in every run."""


def examples(count: int) -> settings:
    """About thirty seconds of a test are so many examples."""
    return settings(
        max_examples=max(1, round(count * LONGER)),
        derandomize=LONGER <= 1,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


NUMBERS = st.one_of(
    st.sampled_from([0, -1, 1, 1e308, -1e308, 1e-308, 5e-324, 10**400, float("nan"), float("inf")]),
    st.floats(),
    st.integers(),
    st.floats(1e-4, 1e4),
)
LEAVES = st.one_of(
    NUMBERS,
    st.none(),
    st.booleans(),
    st.text(max_size=20),
    st.sampled_from(["<script>alert(1)</script>", "../../etc/passwd", "/dev/zero", "1e-3", "\x00"]),
    st.dates(),
)
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=12), inner, max_size=4)
    ),
    max_leaves=8,
)


def places(tree: Any, path: tuple = ()) -> list[tuple]:
    """Paths of all that a tree holds."""
    inner = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    return [p for key, value in inner for p in ((*path, key), *places(value, (*path, key)))]


@st.composite
def damaged_trees(draw: st.DrawFn, tree: Any) -> Any:
    """The tree with one to four parts of it replaced, removed, renamed or put elsewhere."""
    found = copy.deepcopy(tree)
    for _ in range(draw(st.integers(1, 4))):
        known = places(found)
        if not known:
            return draw(TREES)
        *above, key = draw(st.sampled_from(known))
        parent = found
        for step in above:
            parent = parent[step]
        what = draw(st.sampled_from(["number", "tree", "remove", "rename", "move"]))
        if what == "remove":
            del parent[key]
        elif what == "rename" and isinstance(parent, dict):
            parent[draw(st.text(max_size=12))] = parent.pop(key)
        elif what == "move":
            *above, other = draw(st.sampled_from(known))
            value = found
            for step in (*above, other):
                value = value[step]
            parent[key] = copy.deepcopy(value)
        else:
            parent[key] = draw(NUMBERS if what == "number" else TREES)
    return found


@st.composite
def damaged_bytes(draw: st.DrawFn, data: bytes, head: int = 4096) -> bytes:
    """The bytes with some changed, cut out, doubled, or an end missing; half of the damage near
    the beginning, where formats define themselves.
    """
    out = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        reach = len(out) if draw(st.booleans()) else min(len(out), head)
        at = draw(st.integers(0, max(0, reach - 1)))
        end = at + draw(st.integers(1, 32))
        what = draw(st.sampled_from(["replace", "fill", "cut", "double", "end"]))
        if what == "replace":
            out[at:end] = draw(st.binary(min_size=1, max_size=16))
        elif what == "fill":
            out[at:end] = bytes([draw(st.sampled_from([0, 255, 127, 128]))]) * (end - at)
        elif what == "cut":
            del out[at:end]
        elif what == "double":
            out[at:at] = out[at:end]
        else:
            del out[at:]
    return bytes(out)
