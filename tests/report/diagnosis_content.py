"""A diagnosis.json as the contract has it, with something in every block."""

DECISIONS = [
    {"rule": "recorded", "passed": True, "statistic": None, "threshold": None, "because": ""},
    {
        "rule": "probable",
        "passed": False,
        "statistic": 0.31,
        "threshold": 0.9,
        "because": "parasitic drag explains these flights better",
    },
]
CONTENT = {
    "schema": 1,
    "verdict": "physics",
    "sentence": "Missing in the simulator: rotor drag.",
    "remark": "",
    "origin": {
        "vehicle": {"name": "quad", "file": "quad.yaml", "sha256": "a" * 64},
        "flights": [
            {
                "name": "one <b>",
                "seconds": 30.0,
                "seconds_used": 25.0,
                "part": "fitted",
                "sha256": "b" * 64,
            },
            {
                "name": "two",
                "seconds": 20.0,
                "seconds_used": 15.5,
                "part": "held_out",
                "sha256": "c" * 64,
            },
        ],
        "version": "0.1.0",
        "command": "ges diagnose flights --out report",
    },
    "findings": [
        {
            "name": "rotor_drag",
            "kind": "physics",
            "title": "rotor drag, linear in air speed",
            "probability": 0.97,
            "equation": "F_i = -k w_i (V + omega x r_i)_xy, M_i = l r_i x F_i",
            "parameters": {
                "k_kg": {"value": 1.1e-4, "ci95": [1.0e-4, 1.2e-4], "unit": "kg", "note": "a note"}
            },
            "size": {
                "value": 0.42,
                "unit": "N",
                "share_of_weight": 0.03,
                "channel": "force_x",
                "force_per_speed_N_s_m": 0.26,
            },
            "alternatives": [{"name": "wind", "log_odds": -9.1}],
            "open": False,
            "place": "",
        }
    ],
    "located": [
        {
            "channel": "force_x",
            "regime": {"forward_m_s": [1.5, 3.0]},
            "share_of_excess": 0.7,
            "q_value": 1e-5,
            "mean": -0.8,
        },
    ],
    "laws": [],
    "unexplained": [
        {"channel": "force_z", "regime": {"height_over_radius": [0.5, 2.0]}, "r2": 0.31},
    ],
    "fit": {
        "metric": "rms",
        "holdout_flights": ["two"],
        "channels": {
            "force_x_N": {
                "before": 0.51,
                "recalibrated": 0.44,
                "after": 0.11,
                "reduction_ci95": [0.71, 0.80],
            },
            "force_z_N": {
                "before": 1.5,
                "recalibrated": 0.4,
                "after": 0.4,
                "reduction_ci95": [-0.01, 0.01],
            },
        },
        "alternatives": {},
        "elsewhere": {},
        "rollout": {
            "horizon_s": 1.0,
            "channels": {
                "p_x_m": {"before": 0.20, "recalibrated": 0.15, "after": 0.04},
                "p_z_m": {"before": 0.004, "recalibrated": 0.003, "after": 0.002},
            },
        },
        "closed_loop": {},
    },
    "detectable": {
        "wind": {"parameter": "east_m_s", "smallest": 0.4, "unit": "m/s", "limited_by": ""},
        "tether": {"parameter": "weight_N_m", "smallest": None},
    },
    "next_flight": {},
    "data": {
        "flights": 2,
        "seconds_used": 40.5,
        "left_out": {"on_ground": 9.5},
        "channels_used": ["force_x", "force_z"],
        "channels_off": {
            "moment_x": "state inertia_kg_m2 in the vehicle file",
            "range": "log a rangefinder and the height (range_m, p_z_m)",
        },
        "delays": [],
        "instruments": [],
        "window_s": 0.2,
        "reference_scale": {"force": 14.0, "acc": 14.0},
        "warnings": ["one <b> has two clocks", "two has two clocks"],
    },
    "calibration": {
        "thrust_scale.scale": {
            "value": 0.01,
            "ci95": [0.0, 0.02],
            "declared_sd": 0.03,
            "prior_sd": 0.03,
        },
    },
    "considered": [
        {"name": "rotor_drag", "place": "", "probability": 0.97, "decisions": DECISIONS[:1]},
        {"name": "wind", "place": "", "probability": 0.31, "decisions": DECISIONS},
        {"name": "weak_rotor", "place": "rotor 2", "probability": 0.04, "decisions": DECISIONS},
    ],
    "not_tested": {"battery_sag": "needs a logged battery voltage (battery_V)"},
}


def without_empty(tree):
    """Return a tree of JSON without the keys that say nothing."""
    if isinstance(tree, dict):
        parts = {key: without_empty(part) for key, part in tree.items()}
        return {k: v for k, v in parts.items() if v not in (None, "", [], {}) and v is not False}
    return [without_empty(part) for part in tree] if isinstance(tree, list) else tree
