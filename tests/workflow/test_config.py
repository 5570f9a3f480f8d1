"""A wrong configuration is refused before anything runs, with the key, the value and what is
allowed.
"""

import json
from pathlib import Path

import pytest

from ges.commands.config import INTRO, command
from ges.errors import GesError, UsageError
from ges.simulator import flight as sim
from ges.simulator.parameters import parameters
from ges.study import config

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = config.read(ROOT / "config/default.yaml")


def changed(path: str, value: object) -> dict:
    tree = value
    for key in reversed(path.split(".")):
        tree = {key: tree}
    return config.merged(DEFAULT, tree)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("models.sedd", 1, ["models.sedd", "did you mean 'seed'"]),
        ("simulatr", {}, ["simulatr", "did you mean 'simulator'"]),
        (
            "data.plans.published.crise_m_s",
            1,
            ["data.plans.published.crise_m_s", "did you mean 'cruise_m_s'"],
        ),
        ("data.plans.publishd", {}, ["publishd", "'published'"]),
        (
            "simulator.vehicle.mass_kg",
            -1.2,
            ["simulator.vehicle.mass_kg", "-1.2", "greater than 0"],
        ),
        ("simulator.vehicle.mass_kg", float("nan"), ["simulator.vehicle.mass_kg", "finite"]),
        ("models.seed", "one", ["models.seed", "'one'", "integer"]),
        ("models.names", ["mpl"], ["models.names", "'mpl'", "'mlp'"]),
        ("models.names", [], ["models.names", "at least 1"]),
        ("seeds.test.first", 200, ["seed 200", "'train'", "'test'"]),
        ("seeds.closed_loop.first", 300, ["seed 300", "'test'", "'closed_loop'"]),
        (
            "simulator.terrain.terrain_width_min_m",
            9.0,
            ["terrain_width_min_m = 9", "terrain_width_max_m"],
        ),
        (
            "data.plans.published.descent_duration_s",
            1e4,
            ["descent_duration_s = 10000", "descent_period_s"],
        ),
        (
            "data.plans.consistent.start_max_m",
            3200.0,
            ["data.plans.consistent", "start_max_m = 3200", "terrain_length_m"],
        ),
        (
            "closed_loop.clamp_thresholds",
            [-0.01, 0.0],
            ["'closed_loop.clamp_thresholds.0' is -0.01", "greater than or equal to 0"],
        ),
    ],
)
def test_wrong_value_is_named(path, value, words):
    with pytest.raises(UsageError) as caught:
        config.validate(changed(path, value))
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_missing_key_is_named():
    tree = {**DEFAULT, "models": {k: v for k, v in DEFAULT["models"].items() if k != "horizon_s"}}
    with pytest.raises(UsageError, match=r"'models.horizon_s' is missing"):
        config.validate(tree)


def test_file_that_is_no_configuration(tmp_path):
    (tmp_path / "a.yaml").write_text("- 1\n- 2\n")
    (tmp_path / "b.yaml").write_text("a: [1\n")
    for name in ("a.yaml", "b.yaml", "absent.yaml"):
        with pytest.raises(GesError, match=name):
            config.load(tmp_path / name)


def test_tiny_is_a_part_of_default():
    """tiny.yaml replaces values only: it names no key that default.yaml lacks, and the two together
    are right.
    """
    tiny = config.load(ROOT / "config/default.yaml", ROOT / "config/tiny.yaml")
    assert len(tiny.seeds.data()) < len(config.validate(DEFAULT).seeds.data())


def test_simulator_knows_every_number():
    """Names are the simulator's, values within its bounds, so no flight of the study is refused for
    them.
    """
    known = parameters()
    for name, value in config.validate(DEFAULT).simulator.parameters().items():
        assert known[name].low <= value <= known[name].high, name


def test_study_flies():
    study = config.validate(DEFAULT).simulator
    record = sim.fly([sim.Flight({**study.parameters(), "duration_s": 2.0}, study.effects())])[0]
    assert record.status == "ok"
    assert abs(record["agl_m"][-1] - study.controller.agl_ref_m) < 0.15


def test_schema_file_is_the_models():
    """config/schema.json is what 'make docs' writes from the model today."""
    assert json.loads((ROOT / "config/schema.json").read_text()) == json.loads(
        json.dumps(config.schema())
    )


def test_schema_agrees_with_the_model():
    import jsonschema

    jsonschema.validate(DEFAULT, config.schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(changed("models.sedd", 1), config.schema())


def test_docs_page_names_every_key(runner):
    page = runner.invoke(command, ["--markdown"]).output
    assert page.startswith(INTRO)
    assert (ROOT / "docs/config.md").read_text() == page
    assert all(f"`{key}`" in page for key, _, _ in config.rows())
