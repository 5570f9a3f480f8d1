"""What a notebook shows: the packages to complete, and a diagnosis at a glance."""

import subprocess
import sys

import pytest

import ges
from ges.diagnose.types.diagnosis import Diagnosis, Estimate, Finding


@pytest.fixture
def found():
    loss = {"loss_3": Estimate(0.1234, (0.1, 0.15), "1")}
    finding = Finding.of("weak_rotor", 0.98, loss, place="rotor <3>")
    empty = dict.fromkeys(("located", "unexplained", "considered"), ())
    rest = dict.fromkeys(
        ("origin", "fit", "detectable", "next_flight", "data", "calibration", "not_tested"), {}
    )
    return Diagnosis(
        verdict="physics",
        remark="",
        findings=(finding,),
        laws=({"form": "0.1 m g (V_x/v_h)"},),
        vehicle=None,
        sentence="Missing: weak rotor & more.",
        **empty,
        **rest,
    )


def test_a_diagnosis_prints_in_a_line(found):
    assert repr(found) == "Diagnosis(physics: weak_rotor rotor <3>, 0.1 m g (V_x/v_h))"


def test_a_notebook_shows_verdict_sentence_and_findings(found):
    shown = found._repr_html_()
    assert "<b>physics</b>: Missing: weak rotor &amp; more." in shown
    assert "rotor &lt;3&gt;" in shown and "<3>" not in shown
    assert "<td>0.98</td><td>loss_3 0.123 [0.1, 0.15]</td>" in shown


def test_the_packages_complete_and_none_is_imported_for_that():
    assert {"diagnose", "recordings", "vehicle", "simulator"} <= set(dir(ges))
    assert not {"importlib", "types", "pkgutil"} & set(dir(ges))
    asked = (
        "import sys, ges; dir(ges); print(sorted(m for m in sys.modules if m.startswith('ges.')))"
    )
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True)
    assert done.stdout == "[]\n"
