"""Faults of clocks and gyros that are settled before any physics: a late pose, a gyro offset."""

from __future__ import annotations

import numpy as np

from ges.diagnose.prepare.gate import Gate
from ges.diagnose.settings import settings
from ges.diagnose.types.diagnosis import Estimate, Finding, interval95


def settled_findings(gate: Gate) -> list[Finding]:
    """Sensor faults that the gate settled before any physics: a late pose, a gyro offset. They are
    as good as certain: measured directly, against no rival.
    """
    found = []
    if gate.pose:
        value = Estimate(
            gate.pose.delay_s,
            interval95(gate.pose.delay_s, gate.pose.sd_s),
            "s",
            "position, velocity and attitude late against gyro, accelerometer and drive",
        )
        found.append(
            _settled(
                "time_offset", {"delay_s": value}, {"value": abs(gate.pose.delay_s), "unit": "s"}
            )
        )
    if gate.gyro:
        told = {
            f"{a}_rad_s": Estimate(float(b), interval95(float(b), float(s)), "rad/s")
            for a, b, s in zip("xyz", *gate.gyro, strict=True)
        }
        found.append(
            _settled(
                "gyro_bias", told, {"value": float(np.linalg.norm(gate.gyro[0])), "unit": "rad/s"}
            )
        )
    return found


def _settled(name: str, parameters: dict[str, Estimate], size: dict) -> Finding:
    return Finding.of(
        name, settings.statistics.certain_probability, parameters, {**size, "share_of_weight": 0.0}
    )
