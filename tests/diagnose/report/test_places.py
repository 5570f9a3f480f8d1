"""Where an effect of several places acts."""

from types import SimpleNamespace

import pytest

from ges.diagnose.report.content import places_of

FIRST_SEARCH = SimpleNamespace(
    inclusion={"weak_rotor": 1.0},
    best_with=lambda name: SimpleNamespace(posterior=SimpleNamespace(columns=(0,))),
)
COLUMN = SimpleNamespace(variant=SimpleNamespace(effect="weak_rotor", places=("rotor 2",)))


@pytest.mark.parametrize(
    ("free", "alternative", "place"),
    [
        ((("weak_rotor", "loss_4"),), None, "rotor 4"),
        ((("rotor_drag", "k_kg"),), None, "rotor 2"),
        ((), (("weak_rotor", "loss_1"), ("weak_rotor", "loss_3")), "rotor 1 and rotor 3"),
    ],
)
def test_an_effect_acts_where_it_was_fitted(free, alternative, place):
    """A later round of the search may accept it elsewhere than the first one had it."""
    accepted = SimpleNamespace(
        fitted=SimpleNamespace(free=free),
        alternatives={"weak_rotor": SimpleNamespace(free=alternative)} if alternative else {},
        result=FIRST_SEARCH,
        regression=SimpleNamespace(system=SimpleNamespace(columns=[COLUMN])),
    )
    assert places_of(accepted, "weak_rotor") == place
