"""Verdict and sentence: what an engineer is told first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .result import Finding

REGIMES = {
    "height_over_radius": "height over rotor radius",
    "airspeed_m_s": "speed (m/s)",
    "climb_m_s": "climb (m/s)",
    "battery_V": "battery voltage (V)",
    "time_s": "time in flight (s)",
}
CHANNELS = {
    "force": "force",
    "acc": "accelerometer",
    "moment": "moment",
    "drive": "drive",
    "range": "rangefinder",
}


def verdict_of(findings: Sequence[Finding], rivals: Sequence[Sequence[str]], unexplained: Sequence[Mapping]) -> str:
    """One word of the contract."""
    if rivals:
        return "ambiguous"
    kinds = {f.kind for f in findings}
    for kind in ("physics", "sensor", "parameter"):
        if kind in kinds:
            return kind
    return "unknown" if unexplained else "nothing_proven"


def channel_words(channel: str) -> str:
    """``force_z`` as ``vertical force``."""
    kind, _, axis = channel.partition("_")
    word = CHANNELS.get(kind, kind)
    if kind == "drive":
        return f"drive of rotor {axis}"
    where = {"x": f"{word} along x", "y": f"{word} along y", "z": f"vertical {word}"}
    return ("yaw moment" if channel == "moment_z" else where[axis]) if axis else word


def where_words(item: Mapping) -> str:
    """A located entry in words."""
    name, (low, high) = next(iter(item["regime"].items()))
    return f"{channel_words(item['channel'])} at {REGIMES.get(name, name)} {low:.2g} to {high:.2g}"


def _finding_words(f: Finding) -> str:
    size = (
        f"{f.size['value']:.2g} {f.size['unit']} rms in the {channel_words(f.size['channel'])}" if f.size.get("channel") else ""
    )
    return f"{f.name} ({f.title}; P {f.probability:.2f}{'; ' + size if size else ''})"


def _gain(fit: Mapping) -> str:
    """The channel that gains most on flights never seen, against recalibration alone."""
    gains = {
        name: 1.0 - told["after"] / told["recalibrated"] for name, told in fit.get("channels", {}).items() if told["recalibrated"]
    }
    if not gains:
        return ""
    name = max(gains, key=gains.get)
    told = fit["channels"][name]
    unit = name.rpartition("_")[2]
    return (
        f" On flights that took no part the error in {name} is {told['before']:.3g} {unit} as given,"
        f" {told['recalibrated']:.3g} recalibrated and {told['after']:.3g} with it."
    )


def sentence_of(
    verdict: str, findings: Sequence[Finding], located: Sequence[Mapping], unexplained: Sequence[Mapping], fit: Mapping
) -> str:
    """One or two sentences: where, what, how much, how sure."""
    where = f"The simulator is wrong first in the {where_words(located[0])}." if located else ""
    named = "; ".join(_finding_words(f) for f in findings)
    left = f" Something is left unexplained in the {channel_words(unexplained[0]['channel'])}." if unexplained else ""
    if verdict == "nothing_proven":
        return (
            "Nothing proven: within the declared doubts these flights do not contradict the simulator by more than the "
            "smallest effects listed as detectable."
        )
    if verdict == "unknown":
        return f"{where} No effect of the library explains it: it stays unknown, rather than under the nearest name.".strip()
    if verdict == "ambiguous":
        return f"{where} One of these is needed and these flights cannot tell which: {named}.{left}".strip()
    return f"{where} What is missing: {named}.{_gain(fit)}{left}".strip()
