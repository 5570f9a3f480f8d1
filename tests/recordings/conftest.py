"""Motion that the written logs hold: a slow roll on a winding path, and four motors that differ."""

import numpy as np
import pytest
import writers
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="session")
def motion():
    """A flight of 8 s, see :func:`writers.motion`."""
    return writers.motion()


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
