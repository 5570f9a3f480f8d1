"""Faults of clocks and gyros that were removed before any physics: a late pose, a gyro offset."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ges.diagnose.prepare.delays import Delay
from ges.diagnose.prepare.gate import Gate
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter
from ges.simulator import effects as effect_table


def gate_findings(gate: Gate, prior_sds: Mapping[str, float]) -> list[Finding]:
    """Return the sensor faults that the gate removed, as findings.

    Parameters
    ----------
    gate : recordings after all checks.
    prior_sds : of the vehicle file, by ``effect.parameter``.

    Notes
    -----
    They are as good as certain: measured directly, without rivals. A delay that clocks usually have
    is no fault.
    """
    findings = []
    if gate.pose and abs(gate.pose.delay_s) > _clear_delay_s(gate.pose, prior_sds):
        note = "position, velocity and attitude late against gyro, accelerometer and drive"
        delay = FittedParameter.of("time_offset.delay_s", gate.pose.delay_s, gate.pose.sd_s, note)
        size = {"value": abs(gate.pose.delay_s), "unit": "s"}
        findings.append(_certain_finding("time_offset", {"delay_s": delay}, size))
    if gate.gyro:
        estimates = {
            f"{a}_rad_s": FittedParameter.of(f"gyro_bias.{a}_rad_s", float(b), float(s))
            for a, b, s in zip("xyz", *gate.gyro, strict=True)
        }
        size = {"value": float(np.linalg.norm(gate.gyro[0])), "unit": "rad/s"}
        findings.append(_certain_finding("gyro_bias", estimates, size))
    return findings


def _clear_delay_s(pose: Delay, prior_sds: Mapping[str, float]) -> float:
    """Return the delay from which a pose is certainly later than its prior allows."""
    usual = effect_table.get("time_offset").parameter("delay_s").prior
    prior_sd_s = prior_sds.get("time_offset.delay_s", usual.sd if usual else 0.0)
    return settings.statistics.certain_sds * math.hypot(pose.sd_s, prior_sd_s)


def _certain_finding(name: str, parameters: dict[str, FittedParameter], size: dict) -> Finding:
    return Finding.of(
        name, settings.statistics.certain_probability, parameters, {**size, "share_of_weight": 0.0}
    )
