"""Columns of the data set, their types, and which of them a model may see."""

from __future__ import annotations

from ges.conventions import AXES, motor_current, rotor_columns

FEATURES = (
    *(f"gyro_{a}_rad_s" for a in AXES),
    "range_m",
    *rotor_columns("rpm_{}_rad_s", 4),
    *motor_current(4),
    "thrust_command",
)
"""What the firmware gives its network, in its order."""

TARGET = "ge_factor"
WHEREABOUTS = ("p_x_m", "p_y_m", "ground_z_m", "agl_m")
"""True places, for analysis alone: no model sees them."""

CONTACT = "contact"
"""1 where the feet touch the ground: no flight, so models neither learn from such rows nor answer
for them.
"""

TYPES = {
    "t_s": "float64",
    **dict.fromkeys(FEATURES, "float32"),
    TARGET: "float32",
    **dict.fromkeys(WHEREABOUTS, "float64"),
    CONTACT: "float32",
}
