"""What flights cannot speak about, each with what it lacks."""

from ges.diagnose.design.system import build
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.report.content import not_tested

from ..synthetic import MODEL, manoeuvre


def test_what_was_named_was_tested():
    """Without references a controller's answer looks like an inertia, unless that was named."""
    inertia = Variant("inertia", {}, (amplitude_of("inertia", "zz"),))
    system = build([manoeuvre()], MODEL, [inertia])
    assert "references" in not_tested(system, MODEL)["inertia"]
    named = MODEL.with_effects({"inertia": {"xx": 0.0, "yy": 0.0, "zz": 0.2}})
    assert "inertia" not in not_tested(system, named)
