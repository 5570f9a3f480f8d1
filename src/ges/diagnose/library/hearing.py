"""What a recording cannot speak about: effects and channels, each with what would have to be
logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ges.conventions import SPECIFIC_FORCE
from ges.diagnose.design.residual import channels
from ges.diagnose.library.candidates import NEEDS_ATTITUDE
from ges.diagnose.prepare.align import Prepared, attitude_measured
from ges.diagnose.types.model import Model

NEEDS_HEIGHT = frozenset(
    {
        "ground_effect",
        "ground_effect_forward_flight",
        "partial_ground_effect",
        "ground_effect_lag",
        "ground_effect_moment",
        "fountain_lift",
        "ceiling_effect",
        "wall_effect",
        "tether",
        "downwash",
        "slung_load",
    }
)
NEEDS_VELOCITY = frozenset(
    {
        "rotor_drag",
        "parasitic_drag",
        "axial_inflow",
        "translational_lift",
        "wind",
        "gusts",
        "slung_load",
        "ground_effect_forward_flight",
    }
)
NEEDS_RANGE = frozenset({"rangefinder_bias", "rangefinder_lag"})
LIKE_SAG = frozenset({"battery_sag", "thrust_curve", "thrust_scale"})
NEEDS_COMMANDS = frozenset({"motor_lag", "esc_delay"})


EDGE_SLOPE = 0.4


def lacking(name: str, flights: Sequence[Prepared], model: Model) -> str:
    """What some of these flights lack to speak about an effect, as ``needs ...``; '' where nothing
    is missing.
    """
    if name in NEEDS_ATTITUDE and not attitude_measured(flights):
        return "needs a measured attitude"
    if name in NEEDS_HEIGHT and not all("p_z_m" in f.columns or f.has("range") for f in flights):
        return "needs a logged height (p_z_m or range_m)"
    if name in NEEDS_RANGE and not any(f.has("range") and "p_z_m" in f.columns for f in flights):
        return "needs a rangefinder and a logged height (range_m, p_z_m)"
    if name == "rangefinder_lag" and any(_flown_over_an_edge(f, model) for f in flights):
        return (
            "needs ground without edges: the cone of a rangefinder rounds them off as a lag would"
        )
    if name == "accelerometer_bias" and not any(
        n in f.columns for f in flights for n in SPECIFIC_FORCE
    ):
        return "needs a logged accelerometer (acc_x_m_s2 ...)"
    if name in LIKE_SAG and not all(
        f.has("battery") or name == "thrust_scale" and f.has("rotor_speed") for f in flights
    ):
        return (
            "needs a logged battery voltage (battery_V); without it a sagging battery cannot be"
            " told apart"
        )
    if name in NEEDS_VELOCITY and not all(f.has("velocity") for f in flights):
        return "needs a logged velocity (v_x_m_s, v_y_m_s, v_z_m_s)"
    if name in NEEDS_COMMANDS and not all(f.has("command") for f in flights):
        return "needs logged motor commands (u_1 ...)"
    if name in NEEDS_COMMANDS and not any(
        f.has(stream) for f in flights for stream in ("rotor_speed", "reference", "excitation")
    ):
        return (
            "needs rotor speeds or the controller's references: its answers to disturbances look"
            " like this effect"
        )
    return ""


def _flown_over_an_edge(flight: Prepared, model: Model) -> bool:
    if model.terrain.kind == "flat" or not flight.has("position"):
        return False
    return bool(
        model.terrain.at(flight.columns["p_x_m"], flight.columns["p_y_m"]).slope.max() > EDGE_SLOPE
    )


def silent_channels(flights: Sequence[Prepared], model: Model) -> dict[str, str]:
    """Channels that no flight speaks about, each with what to log, or to state, to hear it."""
    heard = {name for f in flights for name in channels(f, model)}
    pose, gyro = (
        "log velocity and attitude (v_x_m_s ..., q_w ...)",
        "log the gyro (omega_x_rad_s ...)",
    )
    reasons = {
        "force_x": "log the attitude (q_w ...)" if "force_z" in heard else pose,
        "force_z": pose,
        "acc_x": "log the accelerometer (acc_x_m_s2 ...)",
        "moment_x": gyro if "inertia" in model.known else "state inertia_kg_m2 in the vehicle file",
        "moment_z": (
            gyro
            if "torque" in model.known
            else "state torque_coefficient_Nm_s2 in the vehicle file"
        ),
        "drive_1": "log rotor speeds and motor commands, both (rotor_speed_1_rad_s ..., u_1 ...)",
        "range": "log a rangefinder and the height (range_m, p_z_m)",
    }
    return {name: why for name, why in reasons.items() if name not in heard}


def unheard(off: Mapping[str, str]) -> str:
    """A sentence on what a verdict of nothing proven does not speak about, from
    :func:`silent_channels`; '' for full logs.
    """
    told = []
    if "force_z" in off:
        told.append(f"nothing of drag, inflow, loads and the ground ({off['force_z']})")
    elif "force_x" in off:
        told.append(f"nothing of drag and wind ({off['force_x']})")
    if "moment_x" in off:
        told.append(f"nothing of moments ({off['moment_x']})")
    return f" They say {' and '.join(told)}." if told else ""
