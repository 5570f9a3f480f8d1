"""What is missing is installed by its own name: on PyPI the name of this package is another's."""

import importlib.metadata
import re
from email.message import Message
from pathlib import Path
from types import SimpleNamespace

import pytest

from ges.extras import install_command, install_command_for

ROOT = Path(__file__).resolve().parents[2]
TEXTS = [
    *ROOT.glob("*.md"),
    *(p for folder in ("docs", "src", "examples") for p in (ROOT / folder).rglob("*")),
]
EXTRAS = {
    "ardupilot": ("pymavlink",),
    "study": ("scikit-learn", "torch"),
    "ui": ("starlette>=1.10", "uvicorn"),
}


@pytest.fixture
def installed(monkeypatch):
    """Name the distributions that are there, of a package with :data:`EXTRAS`."""

    def become(*names):
        about = Message()
        for extra in EXTRAS:
            about["Provides-Extra"] = extra
        stated = [f'{name}; extra == "{e}"' for e, names in EXTRAS.items() for name in names]
        there = {name: SimpleNamespace() for name in names}
        there["ges"] = SimpleNamespace(metadata=about, requires=["click", *stated])

        def distribution(name):
            if name not in there:
                raise importlib.metadata.PackageNotFoundError(name)
            return there[name]

        monkeypatch.setattr(importlib.metadata, "distribution", distribution)

    return become


def test_what_is_missing_of_an_extra_is_named(installed):
    installed("click", "uvicorn")
    assert install_command("ardupilot") == "pip install pymavlink"
    assert install_command("ui") == "pip install 'starlette>=1.10'"
    installed("pymavlink")
    assert install_command("ardupilot") == "pip install pymavlink"


def test_a_module_is_found_in_its_extra(installed):
    installed("torch")
    assert install_command_for("sklearn") == "pip install scikit-learn"
    assert install_command_for("click") == "pip install click"


def test_without_metadata_the_checkout_is_installed(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    assert install_command("ui") == "pip install '.[ui]'"
    assert install_command_for("uvicorn") == "pip install uvicorn"


def test_no_page_and_no_message_installs_the_package_of_that_name_on_pypi():
    wrong = re.compile(r"pip install ['\"]?ges\b|['`\"]ges\[")
    read = [p for p in TEXTS if p.suffix in (".md", ".py", ".j2", ".yml")]
    assert len(read) > 100
    found = [f"{p.name}: {m[0]}" for p in read if (m := wrong.search(p.read_text()))]
    assert not found, found
