"""A log, a vehicle file or a page elsewhere may be hostile. What ``ges ui`` refuses stands in
tests/ui/test_guard.py, what a diagnosis of the proof cannot read in tests/blind/test_blindness.py.
"""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import yaml
from command_line import EXAMPLE, one_sentence, run
from diagnosis_content import CONTENT

from ges.diagnose.report import compare, page
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError
from ges.files import write_json
from ges.plain_yaml import LARGEST_BYTES, read_yaml
from ges.recordings.readers.maps import load_map
from ges.recordings.readers.ros import TopicMap
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = "\"'></script><script>alert(1)</script><img src=x onerror=alert(2)>&lt;{{7*7}}"


# The page.

WORDS_OF_OURS = {"verdict", "kind", "part", "metric", "limited_by", "channel", "rule"}


def hostile(tree: Any, key: str = "") -> Any:
    """The same with every text that is not ours replaced, keys of flights among them."""
    if isinstance(tree, dict):
        return {k: hostile(v, k) for k, v in tree.items()}
    if isinstance(tree, list):
        return [hostile(v, key) for v in tree]
    return HOSTILE if isinstance(tree, str) and key not in WORDS_OF_OURS else tree


def markup(text: str) -> str:
    """What a browser takes for markup: tags with what is in them."""
    return " ".join(re.findall(r"<[a-zA-Z/!][^>]*>", text))


@pytest.mark.parametrize("kept", ["channels_used", "name"])
def test_no_word_of_a_diagnosis_is_markup(kept):
    """Names of channels and effects are looked up, so one test leaves each of them."""
    content = hostile(CONTENT)
    for block in ("findings", "considered"):
        for mine, known in zip(content[block], CONTENT[block], strict=True):
            mine |= {"name": known["name"]}
    content["data"]["channels_used"] = CONTENT["data"]["channels_used"]
    text = page.render(content)
    assert "alert(1)" in text and "<script>alert" not in text and "<img src=x" not in text
    assert "onerror" not in markup(text)


def test_no_word_of_a_comparison_is_markup(tmp_path):
    other = copy.deepcopy(CONTENT) | {"sentence": HOSTILE}
    other["origin"]["vehicle"]["name"] = HOSTILE
    write_json(tmp_path / "diagnosis.json", other)
    content = load_diagnosis(tmp_path)
    text = compare.as_html(compare.compare(content, content, [HOSTILE, "b"]))
    assert "alert(1)" in text and "<script>" not in text and "onerror" not in markup(text)


def test_a_page_loads_nothing_and_sends_nothing():
    policy = re.search(
        r'http-equiv="Content-Security-Policy" content="([^"]*)"', page.render(CONTENT)
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].split(";"))
    assert rules["default-src"] == "'none'" and rules["img-src"] == "data:"
    assert not {"connect-src", "form-action", "frame-src"} & set(rules)
    assert rules["script-src"] == "'none'"


def test_no_word_of_a_log_is_a_command_to_a_terminal(tmp_path):
    t_us = np.arange(0, 8_000_000, 20_000)
    topics = [
        ("vehicle_attitude", 0, {"timestamp": t_us, "q[0]": 1.0 + 0.0 * t_us}),
        ("actuator_motors", 0, {"timestamp": t_us, "control[0]": 0.5 + 0.0 * t_us}),
    ]
    log = writers.ulog(tmp_path / "f.ulg", topics, info={"ver_hw": "\x1b[2J\nBOARD"})
    told = run("doctor", log)
    assert "BOARD" in told.stdout and "\x1b" not in told.stdout + told.stderr


# Files that lead elsewhere, or grow.


@pytest.mark.parametrize("place", ["../ground.npz", "/etc/a.npz", "a/b.npz", "..", "a.json"])
def test_a_height_map_lies_beside_its_vehicle(tmp_path, place):
    """It is copied to where a diagnosis is written."""
    content = yaml.safe_load((EXAMPLE / "vehicle.yaml").read_text())
    content["terrain"] = {"kind": "grid", "file": place}
    (tmp_path / "vehicle.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(GesError, match="must lie beside the vehicle file"):
        load_vehicle(tmp_path / "vehicle.yaml")


@pytest.mark.parametrize("place", ["../messages", "/usr/share"])
def test_definitions_lie_beside_their_map(tmp_path, place):
    content = {"topics": [{"topic": "/a"}], "definitions": place}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(GesError, match="must lie beside the map"):
        load_map(tmp_path / "map.yaml", TopicMap)


BOMB = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (BOMB, "an alias in what has an anchor"),
        ("a: &a [*a]", "an alias in what has an anchor"),
        ("[" * 5000, "nests too deep"),
        ("mass_kg: " + "9" * 5000, "not YAML of plain data"),
        ("day: 2026-02-31", "not YAML of plain data"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: b: c", "mapping values are not allowed here, in line 1"),
        ("\xff\xfe\x00", "not YAML"),
        ("x" * (LARGEST_BYTES + 1), "at most"),
    ],
    ids=range(9),
)
def test_yaml_of_plain_data_alone(tmp_path, text, sentence):
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(GesError, match=sentence) as told:
        read_yaml(path, "file")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("number", ["1e-6", "1E3", "-2e+4", "1.e2", "1.5e-3"])
def test_numbers_are_what_they_look_like(tmp_path, number):
    path = tmp_path / "file.yaml"
    path.write_text(f"a: {number}\nb: &b [1]\nc: *b\n")
    assert read_yaml(path, "file") == {"a": float(number), "b": [1], "c": [1]}


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        ("mass_kg: 1.0e+308", "mass_kg is 1e+308 kg; allowed is 0.001 to 100"),
        ("rho_kg_m3: 1.0e-9", "rho_kg_m3 is 1e-09 kg/m^3; allowed is 0.001 to 100"),
        ("terrain: {z_m: 1.0e+9}", "terrain_z_m is 1e+09 m; allowed is -10000 to 10000"),
    ],
)
def test_a_number_beyond_all_bounds_is_told_where_it_stands(tmp_path, number, sentence):
    known = yaml.safe_load((EXAMPLE / "vehicle.yaml").read_text())
    content = known | yaml.safe_load(number)
    path = tmp_path / "vehicle.yaml"
    path.write_text(yaml.safe_dump(content))
    assert one_sentence(run("vehicle", path), 2) == f"ges: vehicle.yaml: {sentence}"


# What the public workflows may do.


def test_actions_are_pinned_and_may_read_alone():
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        text = path.read_text()
        for used in re.findall(r"uses: *(\S+)", text):
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", used), (path.name, used)
        workflow = yaml.safe_load(text)
        assert workflow["permissions"] == {"contents": "read"}
        for job in workflow["jobs"].values():
            # what makes a release of a tag has to write it, and runs nothing of the repository
            if job.get("permissions", {}):
                assert job["permissions"] == {"contents": "write"}
                assert job["if"] == "startsWith(github.ref, 'refs/tags/v')"
                assert not [s for s in job["steps"] if "checkout" in s.get("uses", "")]
            for step in job["steps"]:
                if step.get("uses", "").startswith("actions/checkout@"):
                    assert step["with"]["persist-credentials"] is False
