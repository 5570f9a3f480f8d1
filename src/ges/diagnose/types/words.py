"""Channels, regime variables and numbers in a reader's words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from ges.diagnose.types.keys import ParameterKey

_CHANNELS = {
    "force_x": "force forward",
    "force_y": "force to the left",
    "force_z": "force along thrust",
    "moment_x": "moment in roll",
    "moment_y": "moment in pitch",
    "moment_z": "moment in yaw",
    "acc_x": "accelerometer forward",
    "acc_y": "accelerometer left",
    "acc_z": "accelerometer along thrust",
    "range": "rangefinder",
    "p_x_m": "position x",
    "p_y_m": "position y",
    "p_z_m": "height",
    "v_x_m_s": "velocity x",
    "v_y_m_s": "velocity y",
    "v_z_m_s": "vertical velocity",
}
_QUANTITIES = {
    "height_over_radius": ("height over rotor radius", ""),
    "airspeed_m_s": ("horizontal speed", "m/s"),
    "climb_m_s": ("climb rate", "m/s"),
    "thrust_over_weight": ("thrust over weight", ""),
    "battery_V": ("battery voltage", "V"),
    "forward_m_s": ("speed forward", "m/s"),
    "left_m_s": ("speed to the left", "m/s"),
    "along_thrust_m_s": ("speed along thrust", "m/s"),
    "yaw_rate_rad_s": ("yaw rate", "rad/s"),
    "east_m": ("position east", "m"),
    "north_m": ("position north", "m"),
    "time_s": ("time since start", "s"),
}
_SUFFIXES = {
    "rad_s": "rad/s",
    "m_s": "m/s",
    "m_s2": "m/s²",
    "rad": "rad",
    "Nm": "N m",
    "N": "N",
    "m": "m",
    "V": "V",
    "s": "s",
}
_STAGES = {
    "before": "vehicle file as given",
    "recalibrated": "recalibrated only",
    "names_only": "with the names alone",
    "after": "with the findings",
}
_WHOLES = {
    "N": "weight",
    "N m": "weight times arm",
    "rad/s": "full rotor speed",
    "m": "a rotor radius",
}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MOST_ODDS = 23.0
"""Log odds of 10 to the ninth: beyond, a number means no more."""


def _split(name: str) -> tuple[str, str]:
    """Split a contract name into name and unit."""
    # the longest first: v_x_m_s ends in _s as well
    for suffix in sorted(_SUFFIXES, key=len, reverse=True):
        if name.endswith(f"_{suffix}"):
            return name.removesuffix(f"_{suffix}"), _SUFFIXES[suffix]
    return name, ""


def without_unit(name: str) -> str:
    """Return a contract name without its unit.

    Parameters
    ----------
    name : ``force_z_N``, which becomes ``force_z``.
    """
    return _split(name)[0]


def channel_words(name: str) -> str:
    """Return a channel in words, without its unit.

    Parameters
    ----------
    name : ``force_z``, ``force_z_N`` or ``drive_3``.

    Returns
    -------
    *force along thrust*, *speed of rotor 3*; the name itself for what is not listed.
    """
    listed = _CHANNELS.get(name) or _CHANNELS.get(_split(name)[0])
    words = _split(name)[0].replace("_", " ")
    return listed or re.sub(r"^drive (\d+)$", r"speed of rotor \1", words)


def quantity_words(name: str) -> str:
    """Return a regime variable in words, with its unit.

    Parameters
    ----------
    name : ``airspeed_m_s``, which becomes *horizontal speed, m/s*.
    """
    words, unit = _QUANTITIES.get(name) or (_split(name)[0].replace("_", " "), _split(name)[1])
    return f"{words}, {unit}" if unit else words


def unit_words(channel: str) -> str:
    """Return the unit of a channel of the fit.

    Parameters
    ----------
    channel : with its unit, ``force_z_N`` or ``p_z_m``.
    """
    return _split(channel)[1]


def size_unit(channel: str) -> str:
    """Return the unit of sizes in a channel.

    Parameters
    ----------
    channel : without a unit, ``force_z``.

    Returns
    -------
    *N*, *N m*, *rad/s* or *m*; '' for others.
    """
    return {"force": "N", "acc": "N", "moment": "N m", "drive": "rad/s", "range": "m"}.get(
        channel.split("_")[0], ""
    )


def whole_words(unit: str) -> str:
    """Return what a size is expressed as a share of.

    Parameters
    ----------
    unit : of the size; *N* gives *weight*.
    """
    return _WHOLES.get(unit, "the whole")


def plain(name: str) -> str:
    """Return a contract name as words.

    Parameters
    ----------
    name : ``cg_offset+thrust_scale``, which becomes *cg offset with thrust scale*.
    """
    return str(name).replace("_", " ").replace("+", " with ")


def key_words(key: str) -> str:
    """Return a number of the calibration in words.

    Parameters
    ----------
    key : ``thrust_scale.scale``, which gives *thrust scale*.
    """
    effect, parameter = ParameterKey.of(key)
    words = plain(without_unit(parameter))
    if effect == "vehicle":
        return words
    return plain(effect) if words == "scale" else f"{plain(effect)} {words}"


def correction_words(parameter: str, value: float) -> str:
    """Return a correction with its sign: a share in percent, else in its own unit.

    Parameters
    ----------
    parameter : name of the parameter, without that of its effect.
    value : in the unit that the name carries.
    """
    unit = unit_words(parameter)
    sign = "+" if value > 0 else ""
    return f"{sign}{number_words(value, 2)} {unit}" if unit else f"{sign}{percent_words(value)}"


def list_words(items: Sequence[str], last: str = "and") -> str:
    """Join items as an enumeration: *a, b and c*.

    Parameters
    ----------
    items : at least one.
    last : word before the last item.
    """
    *some, end = items
    return f"{', '.join(some)} {last} {end}" if some else end


def percent_words(share: float | None) -> str:
    """Format a share in percent, with one decimal below ten.

    Parameters
    ----------
    share : 0.05 for *5.0 %*; None for *not known*.
    """
    if share is None:
        return "not known"
    # from 0.0995 on it would be written 10.0; adding zero turns -0.0 into 0.0
    return f"{round(100.0 * share, 1) + 0.0:.{0 if abs(share) >= 0.0995 else 1}f} %".replace(
        "-", "−"
    )


def probability_words(p: float | None) -> str:
    """Format a probability to two decimals, to three above 0.99.

    Parameters
    ----------
    p : 0 to 1; None for *not known*.
    """
    if p is None:
        return "not known"
    # rounded, it would read as certainty
    return "> 0.999" if p > 0.999 else f"{p:.3f}" if p > 0.99 else f"{p:.2f}"


def regime_words(regime: Mapping[str, Sequence[float]]) -> str:
    """Return bounds of a regime in words.

    Parameters
    ----------
    regime : lower and upper bound by variable.

    Returns
    -------
    *height over rotor radius 0.50 to 2.00*; *everywhere* for no variable.
    """
    parts = []
    for name, (low, high) in regime.items():
        words, _, unit = quantity_words(name).partition(", ")
        parts.append(f"{words} {_bounds_words(low, high, 3)}{' ' + unit if unit else ''}")
    return ", ".join(parts) or "everywhere"


def stage_words(stage: str) -> str:
    """Return a stage of the proof in words.

    Parameters
    ----------
    stage : ``before``, ``recalibrated``, ``names_only`` or ``after``.
    """
    return _STAGES[stage]


def number_words(value: float | None, digits: int = 3) -> str:
    """Format a number, without an exponent between 0.001 and a million.

    Parameters
    ----------
    value : None and what is not finite give *not known*.
    digits : significant digits.
    """
    if value is None or not math.isfinite(value):
        return "not known"
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        # as 1.20·10⁻⁵, not as programs write it
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        superscript = str(int(exponent)).translate(_SUPERSCRIPTS)
        return f"{mantissa}·10{superscript}".replace("-", "−")
    # significant digits: every place before the point costs a decimal
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{value:.{decimals}f}".replace("-", "−")


def _bounds_words(low: float, high: float, digits: int = 2) -> str:
    """Format two bounds to the same decimals.

    Parameters
    ----------
    low, high : the bounds.
    digits : significant digits of the larger bound; the other may round to zero.
    """
    largest = max(abs(low), abs(high))
    if not largest or not 1e-3 <= largest < 1e6:
        return f"{number_words(low, digits)} to {number_words(high, digits)}"
    # of the larger: 0.0031 to 12.4 would tell of a precision that the range does not have
    decimals = max(0, digits - 1 - math.floor(math.log10(largest)))
    return " to ".join(
        f"{round(b, decimals) + 0.0:.{decimals}f}".replace("-", "−") for b in (low, high)
    )


def chance_words(q: float | None) -> str:
    """Format a small probability.

    Parameters
    ----------
    q : 0 to 1; None for *not known*.
    """
    if q is None:
        return "not known"
    return "< 0.0001" if q < 1e-4 else f"{q:.2g}"


def odds_words(log_odds: float | None) -> str:
    """Format the odds of an alternative against what was accepted.

    Parameters
    ----------
    log_odds : natural logarithm; None where they were not computed.

    Returns
    -------
    *12 times less likely*.
    """
    if log_odds is None:
        return "not weighed"
    times = (
        "more than 10⁹" if abs(log_odds) > MOST_ODDS else number_words(math.exp(abs(log_odds)), 2)
    )
    return f"{times} times {'less' if log_odds < 0 else 'more'} likely"
