"""The exported header: the C network gives what the trained one gives, and a wrong header is not
flown.
"""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ges.errors import GesError
from ges.simulator import flight as sim
from ges.study.datasets.columns import FEATURES
from ges.study.models.export import header
from ges.study.models.networks import MlpRegressor

ROOT = Path(__file__).resolve().parents[2]
RNG = np.random.default_rng(3)
CENTRE = np.array([0, 0, 0, 0.2, *[440.0] * 4, *[4.9] * 4, 0.49])
SPREAD = np.array([0.1, 0.1, 0.1, 0.05, *[40.0] * 4, *[0.8] * 4, 0.04])


@pytest.fixture(scope="module")
def network() -> MlpRegressor:
    x = CENTRE + SPREAD * RNG.normal(size=(2000, len(FEATURES)))
    y = 1.0 + 0.002 / x[:, 3].clip(0.05) + 0.01 * x[:, 0]
    return MlpRegressor(epochs=3).fit(x, y)


def compiled(text: str, folder):
    """The firmware's network of a header, as a function of 13 floats, and its own check."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (folder / "ge_ff_mlp_weights.h").write_text(text)
    source = ROOT / "sim_c/firmware/ge_ff.c"
    subprocess.run(
        [
            "cc",
            "-std=gnu11",
            "-O2",
            "-fPIC",
            "-shared",
            "-ffp-contract=off",
            f"-I{folder}",
            source,
            "-o",
            folder / "ff.so",
            "-lm",
        ],
        check=True,
    )
    library = ctypes.CDLL(str(folder / "ff.so"))
    library.ge_ff_network.restype = ctypes.c_float
    return library


def test_c_agrees_to_float_rounding(network, tmp_path):
    library = compiled(header(network, "test"), tmp_path)
    rows = (CENTRE + 2 * SPREAD * RNG.normal(size=(500, len(FEATURES)))).astype(np.float32)
    found = [
        library.ge_ff_network(row.ctypes.data_as(ctypes.POINTER(ctypes.c_float))) for row in rows
    ]
    assert np.abs(np.array(found) - network.predict(rows)).max() < 2e-6
    assert library.ge_ff_network_is_sound() == 1


def test_a_changed_weight_is_noticed(network, tmp_path):
    text = header(network, "test")
    start = text.index("ges_mlp_b2[32] = {")
    first = text[start:].split("{")[1].split(",")[0]
    assert (
        compiled(
            text[:start] + text[start:].replace(first, " 0x1.8p+2f", 1), tmp_path
        ).ge_ff_network_is_sound()
        == 0
    )


def test_header_keeps_every_bit(network):
    text = header(network, "test")
    block = text.split("ges_mlp_w1[832] = {")[1].split("}")[0]
    found = np.array(
        [float.fromhex(word.strip().rstrip("f")) for word in block.split(",")], np.float32
    )
    assert np.array_equal(found, network.weights_["1.weight"].ravel())


def test_other_shapes_are_refused():
    other = MlpRegressor(epochs=1).fit(RNG.normal(size=(50, 5)), RNG.normal(size=50))
    with pytest.raises(GesError, match="13-64-32-1"):
        header(other, "test")


def test_committed_header_is_a_trained_network(tmp_path):
    """Not the empty one: it passes its own check and answers differently to different
    clearances.
    """
    library = compiled((ROOT / "sim_c/firmware/ge_ff_mlp_weights.h").read_text(), tmp_path)
    assert library.ge_ff_network_is_sound() == 1
    near, far = (np.where(np.arange(13) == 3, h, CENTRE).astype(np.float32) for h in (0.08, 0.6))
    f = [
        library.ge_ff_network(row.ctypes.data_as(ctypes.POINTER(ctypes.c_float)))
        for row in (near, far)
    ]
    assert 1.0 < f[0] < 1.8 and abs(f[1] - 1.0) < 0.05 and f[0] > f[1]


def _network_of(text: str):
    """The network of a header in numpy, float by float."""

    def array(name: str) -> np.ndarray:
        words = text.split(f"ges_mlp_{name}[")[1].split("{")[1].split("}")[0].split(",")
        return np.array([float.fromhex(w.strip().rstrip("f")) for w in words], np.float32)

    def scalar(name: str) -> float:
        return float.fromhex(text.split(f"ges_mlp_{name} = ")[1].split(";")[0].rstrip("f"))

    def predict(x: np.ndarray) -> np.ndarray:
        hidden = np.maximum(
            (x - array("mean")) / array("scale") @ array("w1").reshape(64, 13).T + array("b1"), 0
        )
        hidden = np.maximum(hidden @ array("w2").reshape(32, 64).T + array("b2"), 0)
        return (hidden @ array("w3") + array("b3")) * scalar("out_scale") + scalar("out_mean")

    return predict


def test_flown_network_reads_the_features_of_the_data_set():
    """The shadow prediction of a flight is the committed network of the columns that models are
    trained on.
    """
    record = sim.fly(
        [
            sim.Flight(
                {"mode": "ml", "duration_s": 5.0, "seed": 5.0, "cruise_m_s": 1.0},
                {"ground_effect": {}},
            )
        ]
    )[0]
    x = np.stack([record[name] for name in FEATURES], axis=1).astype(np.float32)
    expected = _network_of((ROOT / "sim_c/firmware/ge_ff_mlp_weights.h").read_text())(x)
    assert record.status == "ok" and np.ptp(expected) > 1e-3
    assert np.abs(expected - record["ge_shadow"]).max() < 1e-5
