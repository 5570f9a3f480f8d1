"""``ges vehicle`` from the shell: one file on stdout, everything else on stderr."""

import pytest
import yaml

from ges import cli
from ges.vehicle import library
from ges.vehicle.file import parse_vehicle
from ges.vehicle.load import load_vehicle

from . import models


@pytest.fixture
def ges(capsys, monkeypatch):
    """Runs the command line; its exit code, stdout and stderr."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["ges", "vehicle", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        told = capsys.readouterr()
        return ended.value.code or 0, told.out, told.err

    return run


def test_a_model_becomes_a_vehicle_file(ges, tmp_path):
    path = tmp_path / "iris.sdf"
    path.write_text(models.iris())
    code, out, err = ges(path, "--name", "mine")
    assert code == 0 and err.startswith("note: ")
    vehicle = parse_vehicle(yaml.safe_load(out))
    assert vehicle.name == "mine"
    assert vehicle.mass_kg.value == pytest.approx(load_vehicle(path).mass_kg.value)


def test_a_vehicle_of_the_library_goes_to_every_simulator(ges):
    for kind, word in (
        ("sdf", "<sdf"),
        ("rotorpy", "quad_params"),
        ("urdf", "<robot"),
        ("sih", "SIH_MASS"),
    ):
        code, out, err = ges("crazyflie-2.1", "--to", kind)
        assert code == 0 and word in out
        assert all(line.startswith("note: ") for line in err.splitlines())


def test_a_vehicle_file_is_printed_with_its_comments(ges):
    code, out, _ = ges("hummingbird")
    assert code == 0 and out == library.path_of("hummingbird").read_text()


def test_the_library_is_listed(ges):
    code, out, _ = ges("--list")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == library.names()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hummingbrid"], "did you mean 'hummingbird'"),
        (["nowhere/drone.yaml"], "there is no file"),
        (["nowhere/flight.ulg"], "there is no file"),
        (["x500", "--mass", "2"], "--mass is not for this source"),
        (["x500", "--prop", "ten"], "no size"),
        (["x500", "--to", "mujoco"], "Invalid value"),
    ],
)
def test_wrong_use_is_told_in_a_sentence(ges, arguments, words):
    code, out, err = ges(*arguments)
    assert code in (1, 2) and out == "" and words in err and "Traceback" not in err


def test_a_model_refuses_what_it_says_itself(ges, tmp_path):
    path = tmp_path / "cf2x.urdf"
    path.write_text(models.cf2x())
    code, _, err = ges(path, "--mass", "0.03")
    assert code == 2 and "--mass" in err
