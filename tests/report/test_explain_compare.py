"""``ges explain`` and ``ges compare``, run as a user runs them."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from ges.commands import compare, explain
from ges.errors import GesError


@pytest.fixture
def written(content, tmp_path):
    """Writes a diagnosis into a folder, and says which."""

    def write(name: str = "out", **changes) -> str:
        (tmp_path / name).mkdir()
        (tmp_path / name / "diagnosis.json").write_text(json.dumps({**content, **changes}))
        return str(tmp_path / name)

    return write


def run(command, *words: str) -> str:
    result = CliRunner().invoke(command, words)
    if result.exception:
        raise result.exception
    return re.sub(r"\s+", " ", result.output)


def test_all_that_was_considered_is_listed(written):
    text = run(explain.command, written())
    assert "named effect probability rotor drag 0.97" in text
    assert "wind 0.31 probable 0.310 0.900 parasitic drag explains these flights better" in text
    assert "weak rotor, rotor 2 0.04 probable" in text
    assert "battery sag needs a logged battery voltage" in text


@pytest.mark.parametrize("name", ["wind", "weak rotor", "weak_rotor"])
def test_a_name_has_every_rule(written, name):
    text = run(explain.command, written(), name)
    assert "considered and not named, probability" in text
    assert "recorded passed" in text and "probable failed 0.310 0.900 parasitic drag" in text


def test_a_name_that_was_given_has_its_rules_and_rivals(written):
    text = run(explain.command, written(), "rotor_drag")
    assert "rotor drag: named, probability 0.97" in text and "recorded passed" in text
    assert "instead of it: wind 8955 times less likely" in text and "not named" not in text


def test_a_name_that_could_not_be_tested_says_what_it_needs(written):
    assert "not tested: needs a logged battery voltage" in run(
        explain.command, written(), "battery_sag"
    )


def test_the_smallest_that_would_have_been_seen_is_told(written):
    assert "east_m_s 0.400 m/s" in run(explain.command, written(), "wind")


def test_unknown_and_unrecorded_names_are_sentences(written):
    with pytest.raises(GesError, match="did you mean 'rotor_drag'"):
        run(explain.command, written(), "rotor_drg")
    with pytest.raises(GesError, match="keeps no record of inertia"):
        run(explain.command, written("two"), "inertia")


def test_an_older_diagnosis_says_that_it_has_no_record(written, content):
    folder = written()
    del content["considered"]
    (Path(folder) / "diagnosis.json").write_text(json.dumps(content))
    assert "keeps no record of its decisions" in run(explain.command, folder)


@pytest.mark.parametrize("key", ["calibration", "considered", "not_tested", "origin"])
def test_an_older_diagnosis_is_compared_without_what_it_lacks(written, content, key):
    folder = written()
    del content[key]
    (Path(folder) / "diagnosis.json").write_text(json.dumps(content))
    assert content["sentence"].split()[0] in run(compare.command, folder, written("other"))
    assert run(explain.command, folder)


def test_two_diagnoses_side_by_side(written, content, tmp_path):
    drag = content["findings"][0]
    far = {"k_kg": {"value": 2.0e-4, "ci95": [1.8e-4, 2.2e-4], "unit": "kg"}}
    sag = {**drag, "name": "battery_sag", "parameters": {}, "alternatives": []}
    fit = json.loads(json.dumps(content["fit"]))
    fit["channels"]["force_x_N"]["after"] = 0.22
    second = written("second", findings=[{**drag, "parameters": far}, sag], fit=fit)
    page = tmp_path / "both.html"
    text = run(compare.command, written("first"), second, "--html", str(page))
    assert re.search(r"rotor drag both 0.26 N per m/s; probability 0.97", text)
    assert "1.20·10⁻⁴) 2.00·10⁻⁴ (1.80·10⁻⁴ to 2.20·10⁻⁴) apart" in text
    assert "battery sag second only not named" in text
    assert "thrust scale 0.0100 (0 to 0.0200) 0.0100 (0 to 0.0200) overlap" in text
    assert "force forward, N 0.440 → 0.110 0.440 → 0.220 100 %" in text
    assert "2 of the flights are in both" in text
    html = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page.read_text()))
    for part in ("apart", "battery sag", "second only", "0.440 → 0.220", "missing physics"):
        assert part in html


def test_a_name_that_one_of_them_only_considered_has_its_probability(written, content):
    wind = {**content["findings"][0], "name": "wind", "parameters": {}}
    text = run(compare.command, written("a"), written("b", findings=[wind]))
    assert "wind second only not named (0.31)" in text


def test_other_vehicles_and_other_flights_are_remarked_on(written, content):
    origin = {"vehicle": {"name": "hexa"}, "flights": []}
    fit = {**content["fit"], "holdout_flights": ["other"]}
    text = run(compare.command, written("a"), written("b", origin=origin, fit=fit))
    assert "The vehicles are not the same: quad and hexa" in text
    assert "The errors are those of different flights" in text


def test_laws_of_one_channel_stand_beside_each_other(written):
    def law(value: float) -> dict:
        term = {"term": "m g (V_x/v_h)", "coefficient": value, "ci95": [value - 0.01, value + 0.01]}
        return {
            "channel": "force_y",
            "form": f"{value} m g (V_x/v_h)",
            "terms": [term],
            "regime": {},
            "size": {},
            "reads_as": "",
        }

    one, two = written("a", laws=[law(0.1)]), written("b", laws=[law(0.15)])
    text = run(compare.command, one, two)
    assert "law in the force to the left both 0.1 m g (V_x/v_h) 0.15 m g (V_x/v_h)" in text
    assert re.search(r"m g \(V_x/v_h\) 0.100 \(.*\) 0.150 \(.*\) apart", text)
    assert "second only none" in run(compare.command, written("c"), two)
