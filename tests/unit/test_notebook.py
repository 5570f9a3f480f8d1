"""What a notebook shows: the packages to complete, and a diagnosis at a glance."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

import ges
from ges.diagnose.report.diagnosis import Diagnosis
from ges.diagnose.report.page import CAPTIONS
from ges.diagnose.types.finding import Finding, FittedParameter
from ges.errors import UsageError
from ges.recordings.recording import load_set


@pytest.fixture
def found():
    loss = {"loss_3": FittedParameter(0.1234, (0.1, 0.15), "1")}
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


def test_a_picture_without_data_says_so(found, example):
    quiet = dataclasses.replace(example, located=())
    with pytest.raises(UsageError, match="nothing is located on a held-out flight"):
        quiet.plot.located()
    assert "<img" not in quiet._repr_html_() and "<img" not in found._repr_html_()


@pytest.fixture(scope="module")
def example():
    folder = Path(ges.__file__).parent / "recordings" / "example"
    return ges.diagnose(load_set(folder), names=["rotor_drag"])


@pytest.mark.parametrize(
    "name, arguments",
    [
        ("located", {}),
        ("where", {"regime": "forward_m_s"}),
        ("parameters", {}),
        ("held_out", {}),
        ("rollout", {"channel": "p_x_m"}),
        ("over_time", {"channel": "force_x_N"}),
    ],
)
def test_a_picture_of_the_page_is_drawn_on_given_axes(example, name, arguments):
    assert set(CAPTIONS) == {m for m in dir(example.plot) if not m.startswith("_")}
    figure, (left, right) = plt.subplots(1, 2)
    assert getattr(example.plot, name)(**arguments, ax=right) is right
    assert right.has_data() and not left.has_data()
    plt.close(figure)


def test_a_name_that_a_picture_lacks_is_told(example):
    with pytest.raises(UsageError, match="unknown channel 'p_w_m'"):
        example.plot.rollout("p_w_m")


def test_a_notebook_shows_the_best_picture_and_saves(example, tmp_path):
    shown = example._repr_html_()
    assert shown.index(example.sentence) < shown.index("<table>") < shown.index("<img src=")
    example.save(tmp_path / "out", page=False)
    assert (tmp_path / "out" / "diagnosis.json").exists()


def test_the_packages_complete_and_none_is_imported_for_that():
    assert {"diagnose", "recordings", "vehicle", "simulator"} <= set(dir(ges))
    assert not {"importlib", "types", "pkgutil"} & set(dir(ges))
    asked = (
        "import sys, ges; dir(ges); print(sorted(m for m in sys.modules if m.startswith('ges.')))"
    )
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True)
    assert done.stdout == "[]\n"
