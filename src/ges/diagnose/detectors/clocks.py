"""Faults of clocks and gyros that are settled before any physics: a late pose, a gyro offset."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ges.diagnose.prepare.delays import Delay
from ges.diagnose.prepare.gate import Gate
from ges.diagnose.settings import settings
from ges.diagnose.types.diagnosis import Estimate, Finding, interval95
from ges.simulator import effects as effect_table


def settled_findings(gate: Gate, doubts: Mapping[str, float]) -> list[Finding]:
    """Sensor faults that the gate settled before any physics: a late pose, a gyro offset. They are
    as good as certain: measured directly, against no rival. A delay that clocks usually have is
    settled, and is no fault.

    Parameters
    ----------
    doubts : of the vehicle file, by ``effect.parameter``.
    """
    found = []
    if gate.pose and abs(gate.pose.delay_s) > _beyond_doubt_s(gate.pose, doubts):
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


def _beyond_doubt_s(pose: Delay, doubts: Mapping[str, float]) -> float:
    """Delay from which a pose is late beyond doubt, as any declared number has to be, s."""
    usual = effect_table.get("time_offset").parameter("delay_s").doubt
    doubt_s = doubts.get("time_offset.delay_s", usual.sd if usual else 0.0)
    return settings.statistics.certain_sds * math.hypot(pose.sd_s, doubt_s)


def _settled(name: str, parameters: dict[str, Estimate], size: dict) -> Finding:
    return Finding.of(
        name, settings.statistics.certain_probability, parameters, {**size, "share_of_weight": 0.0}
    )
