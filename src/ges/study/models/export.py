"""The firmware's network as a C header of hexadecimal floats, so that no bit is lost on the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import joblib
import numpy as np

from ges.errors import GesError
from ges.files import write_text
from ges.study.datasets.columns import FEATURES

if TYPE_CHECKING:
    from ges.study.models.networks import MlpRegressor

HIDDEN = (64, 32)
# places of the linear layers in the network's Sequential
LAYERS = ("1", "3", "5")


def _c_float(value: float) -> str:
    digits, exponent = float(np.float32(value)).hex().split("p")
    return f"{digits.rstrip('0').rstrip('.')}p{exponent}f"


def _array(name: str, values: np.ndarray) -> str:
    flat = [_c_float(v) for v in np.ravel(values)]
    lines = ",\n  ".join(", ".join(flat[i : i + 6]) for i in range(0, len(flat), 6))
    return f"static const float ges_mlp_{name}[{len(flat)}] = {{\n  {lines}}};"


def header(model: MlpRegressor, origin: str) -> str:
    """Return the C header of a fitted network.

    Parameters
    ----------
    model : network from the 13 features of the firmware.
    origin : a sentence for the header's comment.

    Raises
    ------
    GesError
        When the network is not 13-64-32-1.
    """
    shapes = [model.weights_[f"{n}.weight"].shape for n in LAYERS]
    if shapes != [(HIDDEN[0], len(FEATURES)), (HIDDEN[1], HIDDEN[0]), (1, HIDDEN[1])]:
        raise GesError(
            f"network to export: layers are {shapes}; the firmware flies"
            f" {len(FEATURES)}-{HIDDEN[0]}-{HIDDEN[1]}-1"
        )
    # every standardised input is 1/2: none is zero and hides its weights from the check
    sample = (model.mean_ + 0.5 * model.scale_).astype(np.float32)
    arrays = {"mean": model.mean_, "scale": model.scale_}
    for i, layer in enumerate(LAYERS, start=1):
        arrays |= {
            f"w{i}": model.weights_[f"{layer}.weight"],
            f"b{i}": model.weights_[f"{layer}.bias"],
        }
    numbers = {
        "out_mean": model.out_mean_,
        "out_scale": model.out_scale_,
        "sample_out": model.predict(sample[None])[0],
    }
    return "\n".join(
        [
            (
                f"/* {origin}\n * Inputs: {', '.join(FEATURES)}.\n * Weights are row-major, one row"
                " an output; the sample lets the firmware check itself. */"
            ),
            f"#define GES_MLP_IN {len(FEATURES)}",
            *(f"#define GES_MLP_HIDDEN{i} {n}" for i, n in enumerate(HIDDEN, start=1)),
            *(_array(name, values) for name, values in {**arrays, "sample_in": sample}.items()),
            *(
                f"static const float ges_mlp_{name} = {_c_float(value)};"
                for name, value in numbers.items()
            ),
            "",
        ]
    )


def export_mlps(models: list[Path], plan: str, headers: list[Path]) -> None:
    """Write the header of each trained network of a flight plan.

    Parameters
    ----------
    models : fitted networks (joblib).
    plan : name of the flight plan, for the header's comment.
    headers : to write, one a network.

    Raises
    ------
    GesError
        When a network is not 13-64-32-1.
    """
    origin = f"MLP trained by this study on the {plan} flight plan, seed-wise split."
    for model, path in zip(models, headers, strict=True):
        write_text(path, header(joblib.load(model), origin))
