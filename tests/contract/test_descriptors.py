"""Descriptors name only what there is, and say of every parameter what a search must know."""

import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from ges.commands.effects import command as effects_command
from ges.diagnose.library.grids import RULES
from ges.diagnose.library.requirements import REQUIREMENTS
from ges.diagnose.report.equations import typeset
from ges.simulator import effects
from ges.vehicle.file import Vehicle

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"
EFFECTS = list(effects.table().values())
each = pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)


@each
def test_what_it_refers_to_exists(effect):
    names = set(effects.table())
    others = (effect.modifies,)
    assert {*filter(None, others), *effect.requires_one_of} <= names
    assert set(effect.needs) <= set(REQUIREMENTS)
    assert {s.rule for s in effect.searches} <= set(RULES)
    assert 0.0 < effect.rarity <= 1.0


@each
def test_its_searches_name_its_own_parameters(effect):
    own = {p.name for p in effect.parameters}
    for search in effect.searches:
        assert set(search.amplitudes) <= set(effect.amplitudes) and search.amplitudes
        assert {*search.fixed, *search.axis, *filter(None, [search.across])} <= own


@each
def test_every_parameter_has_a_role_that_fits(effect):
    assert effect.amplitudes
    for p in effect.parameters:
        assert p.low <= p.default <= p.high and p.low <= p.fit_low < p.fit_high <= p.high
        assert math.isnan(p.neutral) or p.role == "amplitude"
        assert not p.fitted or p.role == "shape"
        assert not p.reach or p.reach_over in (
            "radius",
            "hull",
            *(q.name for q in effect.parameters),
        )


@each
def test_what_it_corrects_is_in_a_vehicle_file(effect):
    fields = set(Vehicle.model_fields)
    for p in effect.parameters:
        assert {path.partition(".")[0] for path in p.corrects} <= fields


@each
def test_what_carries_an_effect_has_a_usual_size(effect):
    """Else a wind could not be weighed from the start, through a drag that is not on yet."""
    if effect.requires_one_of:
        prerequisite = effects.get(effect.requires_one_of[0])
        assert sum(p.usual_share > 0.0 for p in prerequisite.parameters) == 1


@each
def test_both_forms_of_its_equation_have_the_same_symbols(effect):
    latex = re.sub(r"\\(text|frac|left|right|quad|le|dot|ddot)(?![a-z])", "", effect.latex)
    latex = re.sub(r"\\Delta ?", "d", latex).replace(r"\Omega", "w").replace(r"\times", "x")
    letters = (sorted(re.findall("[A-Za-z0-9]", form)) for form in (latex, effect.equation))
    assert next(letters) == next(letters)
    assert "\\" not in "".join(map(typeset, effect.latex_lines)), (
        "a command that MathML does not know"
    )


def test_the_page_of_the_documentation_is_up_to_date():
    """``make docs`` writes it."""
    done = CliRunner().invoke(effects_command, ["--markdown"])
    assert PAGE.read_text() == done.output
