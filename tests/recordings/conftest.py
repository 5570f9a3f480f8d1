"""Motion that the written logs hold: a slow roll on a winding path, and four motors that differ."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="session")
def motion():
    """Times and quantities of a flight of 8 s, in the contract's frames (ENU, FLU)."""
    t = np.arange(0.0, 8.0, 0.02)
    roll, yaw = 0.2 * np.sin(2.0 * t), 0.3 + 0.1 * t
    turned = Rotation.from_euler("ZYX", np.column_stack([yaw, 0 * t, roll]))
    step = (turned[:-1].inv() * turned[1:]).as_rotvec() / 0.02
    omega = np.vstack([step, step[-1:]])
    p = np.column_stack([np.sin(t), 0.5 * np.cos(t), 1.0 + 0.1 * np.sin(1.5 * t)])
    v = np.gradient(p, 0.02, axis=0)
    force = turned.inv().apply(np.gradient(v, 0.02, axis=0) + [0, 0, 9.80665])
    rng = np.random.default_rng(3)
    u = 0.5 + 0.1 * np.cumsum(rng.normal(0, 0.05, (len(t), 4)), axis=0)
    return {
        "t": t,
        "q": turned.as_quat(scalar_first=True),
        "omega": omega,
        "p": p,
        "v": v,
        "acc": force,
        "u": np.clip(u, 0.05, 0.95),
        "rotation": turned,
    }


@pytest.fixture(scope="session")
def ned(motion):
    """The same motion as an aviation autopilot logs it: north-east-down, forward-right-down."""
    swap = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    flip = np.diag([1.0, -1.0, -1.0])
    turned = Rotation.from_matrix(swap @ motion["rotation"].as_matrix() @ flip)
    return {
        "q": turned.as_quat(scalar_first=True),
        "euler": turned.as_euler("ZYX")[:, ::-1],
        "omega": motion["omega"] @ flip,
        "acc": motion["acc"] @ flip,
        "p": motion["p"] @ swap,
        "v": motion["v"] @ swap,
    }
