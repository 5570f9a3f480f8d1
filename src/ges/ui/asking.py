"""Conversion of the page's forms to words of the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from starlette.datastructures import FormData

from ges.errors import UsageError
from ges.recordings.readers.maps import preset_names
from ges.ui.folder import Logs
from ges.vehicle import library, parsing
from ges.vehicle.layouts import LAYOUTS

T = TypeVar("T")
UNREAD: Mapping[str, Any] = {
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
    """Check the form that says how logs are to be read.

    Parameters
    ----------
    logs : the logs, with the maps that came with them.
    form : fields ``pwm_low``, ``pwm_high``, ``rotor_order``, ``part`` and ``map``; all may be
        empty.

    Returns
    -------
    ``map``, ``pwm``, ``rotor_order`` and ``part``, for ``about.json`` of the logs.

    Raises
    ------
    UsageError
        When a number is none, or a map is neither shipped nor here.
    """
    # checked here, so that the answer is a sentence about the form and not about an option
    low = _parse_field(form, "pwm_low", "motor output that means 0", parsing.parse_number)
    high = _parse_field(form, "pwm_high", "motor output that means 1", parsing.parse_number)
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
    """Give the options that say how logs are to be read.

    Parameters
    ----------
    logs : the logs, with what :func:`checked_reading` kept.
    rotor_order : whether the command takes the order of rotors; ``ges doctor`` does not.

    Returns
    -------
    Words of the command line; empty where nothing is stated.
    """
    options, words = logs.about["reading"], []
    if options["map"]:
        words += ["--map", options["map"]]
    if options["pwm"]:
        words += ["--pwm", *map(str, options["pwm"])]
    if options["part"]:
        words += ["--part", str(options["part"])]
    if rotor_order and options["rotor_order"]:
        words += ["--rotor-order", ",".join(map(str, options["rotor_order"]))]
    return words


def vehicle_words(logs: Logs, form: FormData, examined: Sequence[Mapping[str, Any]]) -> list[str]:
    """Give the words of ``ges vehicle`` for what a form describes.

    Parameters
    ----------
    logs : the logs.
    form : ``source`` is ``made`` for a vehicle from the first log, with ``mass``, ``prop``,
        ``wheelbase`` and ``layout``; else ``vehicle`` is a name.
    examined : answers of ``ges doctor`` about the logs.

    Raises
    ------
    UsageError
        When a field has a wrong value, or mass and propellers are missing.
    """
    if _text(form, "source") != "made":
        return ["vehicle", "--", _named(logs, form)]
    first, *_ = chosen(form, examined)
    return ["vehicle", *_made(form), *reading(logs), "--", first]


def diagnose_words(
    logs: Logs, form: FormData, examined: Sequence[Mapping[str, Any]]
) -> tuple[list[str], list[str], str]:
    """Give the options of ``ges diagnose`` that a form asks for.

    Parameters
    ----------
    logs, form, examined : as of :func:`vehicle_words`; ``holdout`` of the form names a flight.

    Returns
    -------
    Options, names of the logs, and a name for the vehicle.

    Raises
    ------
    UsageError
        When a field has a wrong value, or no log is ticked.
    """
    files = chosen(form, examined)
    if _text(form, "source") == "made":
        words, vehicle = _made(form), "made from the log"
    else:
        vehicle = _named(logs, form)
        words = ["--vehicle", vehicle]
    # flights are called as their files without ending
    holdout = _one_of(form, "holdout", ["", *(Path(name).stem for name in files)])
    return [*words, *(["--holdout", holdout] if holdout else []), *reading(logs)], files, vehicle


def chosen(form: FormData, examined: Sequence[Mapping[str, Any]]) -> list[str]:
    """List the logs that are ticked and can be diagnosed.

    Parameters
    ----------
    form : field ``log``, once for each ticked log.
    examined : answers of ``ges doctor`` about the logs.

    Raises
    ------
    UsageError
        When there is none.
    """
    usable = [f["name"] for f in examined if f["usable"]]
    ticked = [name for name in usable if name in form.getlist("log")]
    if not ticked:
        raise UsageError(
            "no log is ticked; tick one" if usable else "none of these logs can be diagnosed"
        )
    return ticked


def _made(form: FormData) -> list[str]:
    # checked here, as the diagnosis may have to wait for others before it reads its options
    mass_kg = _parse_field(form, "mass", "mass", parsing.parse_mass_kg)
    prop = _parse_field(form, "prop", "propellers", parsing.require_propeller)
    wheelbase_m = _parse_field(form, "wheelbase", "wheelbase", parsing.parse_length_m)
    if mass_kg is None or prop is None:
        raise UsageError(
            "a log does not say what the vehicle weighs and which propellers it has; give both, as"
            " in 2.0 kg and 10in"
        )
    layout = _one_of(form, "layout", ["", *LAYOUTS])
    # with "=": what was typed cannot begin an option of its own
    words = [f"--mass={mass_kg}", f"--prop={prop}"]
    words += [] if wheelbase_m is None else [f"--wheelbase={wheelbase_m}"]
    return [*words, *([f"--frame={layout}"] if layout else [])]


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


def _parse_field(form: FormData, name: str, label: str, read: Callable[[str], T]) -> T | None:
    """Read a field as the command line does; None where it is empty, its label in an error."""
    given = _text(form, name)
    try:
        return read(given) if given else None
    except UsageError as error:
        raise UsageError(f"{label}: {error}") from None


def _whole(word: str) -> int:
    # decimal digits are those of many scripts, the command line's ASCII; int() takes no thousands
    if not word.isascii() or not word.isdecimal() or len(word) > 9:
        raise UsageError(f"'{word[:80]}' is no whole number")
    return int(word)
