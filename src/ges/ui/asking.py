"""From the forms of the page to the words of the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starlette.datastructures import FormData

from ges.errors import UsageError
from ges.recordings.readers.maps import preset_names
from ges.ui.folder import Logs
from ges.vehicle import library
from ges.vehicle.layouts import LAYOUTS

NOTHING_FOUND: Mapping[str, Any] = {
    "format": "",
    "autopilot": "",
    "seconds": 0.0,
    "usable": False,
    "problem": "",
    "streams": [],
    "agreement": [],
    "fault": "",
    "can_tell": [],
    "cannot_tell": {},
    "switch_on": {},
    "notes": [],
}
"""An answer of ``ges doctor`` about a log that cannot be read."""


def checked_reading(logs: Logs, form: FormData) -> dict[str, Any]:
    """How logs are to be read, as the form says it.

    Raises
    ------
    UsageError
        Where a number is none, or a map is neither shipped nor here.
    """
    # checked here, so that the answer is a sentence about the form and not about an option
    low, high = _number(form, "pwm_low"), _number(form, "pwm_high")
    if (low is None) != (high is None):
        raise UsageError("motor outputs need both: what means 0 and what means 1")
    order = [_whole(word) for word in _text(form, "rotor_order").replace(",", " ").split()]
    if order and sorted(order) != list(range(1, len(order) + 1)):
        raise UsageError("the order of speed readings names each from 1 on once, as in 2 4 1 3")
    part = _text(form, "part")
    mapping = _one_of(form, "map", ["", *preset_names(), *logs.yaml_names()])
    pwm = None if low is None else [low, high]
    return {
        "map": mapping,
        "pwm": pwm,
        "rotor_order": order,
        "part": _whole(part) if part else None,
    }


def reading(logs: Logs, rotor_order: bool = True) -> list[str]:
    """The same as options; ``ges doctor`` knows no order of rotors."""
    said, words = logs.about["reading"], []
    if said["map"]:
        words += ["--map", said["map"]]
    if said["pwm"]:
        words += ["--pwm", *map(str, said["pwm"])]
    if said["part"]:
        words += ["--part", str(said["part"])]
    if rotor_order and said["rotor_order"]:
        words += ["--rotor-order", ",".join(map(str, said["rotor_order"]))]
    return words


def vehicle_words(logs: Logs, form: FormData, found: Sequence[Mapping[str, Any]]) -> list[str]:
    """``ges vehicle`` for what the form describes."""
    if _text(form, "source") != "made":
        return ["vehicle", "--", _named(logs, form)]
    first, *_ = chosen(form, found)
    return ["vehicle", *_made(form), *reading(logs), "--", first]


def diagnose_words(
    logs: Logs, form: FormData, found: Sequence[Mapping[str, Any]]
) -> tuple[list[str], list[str], str]:
    """Options of ``ges diagnose`` that the form asks for, the logs, and a name for the vehicle."""
    files = chosen(form, found)
    if _text(form, "source") == "made":
        words, vehicle = _made(form), "made from the log"
    else:
        vehicle = _named(logs, form)
        words = ["--vehicle", vehicle]
    # flights are called as their files without ending
    held = _one_of(form, "holdout", ["", *(Path(name).stem for name in files)])
    return [*words, *(["--holdout", held] if held else []), *reading(logs)], files, vehicle


def chosen(form: FormData, found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Logs that are ticked; one that cannot serve is none."""
    usable = [f["name"] for f in found if f["usable"]]
    ticked = [name for name in usable if name in form.getlist("log")]
    if not ticked:
        raise UsageError(
            "no log is ticked; tick one" if usable else "none of these logs can be diagnosed"
        )
    return ticked


def _made(form: FormData) -> list[str]:
    mass_kg, prop = _number(form, "mass"), _text(form, "prop")
    if mass_kg is None or not prop:
        raise UsageError(
            "a log does not say what the vehicle weighs and which propellers it has; give both, as"
            " in 2.0 kg and 10in"
        )
    layout = _one_of(form, "layout", ["", *LAYOUTS])
    # with "=": what was typed cannot begin an option of its own
    return [f"--mass={mass_kg}", f"--prop={prop}", *([f"--frame={layout}"] if layout else [])]


def _named(logs: Logs, form: FormData) -> str:
    return _one_of(form, "vehicle", [*library.names(), *logs.yaml_names()])


def _text(form: FormData, name: str) -> str:
    given = form.get(name, "")
    return given.strip() if isinstance(given, str) else ""


def _one_of(form: FormData, name: str, allowed: Sequence[str]) -> str:
    given = _text(form, name)
    # only words of a list reach the command line
    if given not in allowed:
        raise UsageError(f"{name} '{given[:80]}' is not here; choose one of the list")
    return given


def _number(form: FormData, name: str) -> float | None:
    # many keyboards have a decimal comma
    given = _text(form, name).replace(",", ".")
    if not given:
        return None
    try:
        return float(given)
    except ValueError:
        raise UsageError(f"{name.replace('_', ' ')} '{given[:80]}' is no number") from None


def _whole(word: str) -> int:
    # decimal digits are those of many scripts, the command line's are ASCII
    if not word.isascii() or not word.isdecimal():
        raise UsageError(f"'{word[:80]}' is no whole number")
    return int(word)
