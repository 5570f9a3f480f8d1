"""What published flights near the ground show: thrust ratio in hover, fitted forms, dispersion.

A hovering vehicle needs the same thrust everywhere, and near the ground slower rotors give it. With
T = k sum(w^2) from the measured speeds, the ratio is

    m (g + a_z) / (T cos(tilt)).

It is the ground effect factor times the error of m/k, one number a flight that is fitted with the
form. The recordings are not part of the project: without them every table has headings only.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from ges.conventions import GRAVITY_M_S2, rotor_speed
from ges.files import write_csv
from ges.recordings import published
from ges.recordings.readers import Options, open_log
from ges.simulator.terrain import Terrain
from ges.study.config import Flights, GroundEffect, Simulator
from ges.study.figures.ground import flat_factor
from ges.study.fly.flights import flown, mode
from ges.vehicle.file import Vehicle
from ges.vehicle.load import load_vehicle

FORMS = get_args(GroundEffect.model_fields["form"].annotation)
BLOCK_S = 2.0
STEADY_M = 0.02
"""Greatest standard deviation of height within a block of hover."""
AIRBORNE_M = 0.07
"""Height of the tracked point below which a leg may touch the ground: the vehicle stands at 0.05 m.
"""
DRIFT_M_S = 0.05
"""Greatest mean horizontal speed of a block whose dispersion counts."""
FAR = 8.0
"""Heights in rotor radii from which the ground effect is taken as gone (Cheeseman-Bennett:
0.1 %).
"""
LOW, HIGH = 1.0, FAR
"""Hover counts as low below, as high above so many rotor radii."""

BLOCK_COLUMNS = ("flight", "block", "t_s", "z_over_r", "ratio", "factor")
DISPERSION_COLUMNS = ("source", "height", "block", "t_s", "dx_m", "dy_m", "dz_m")
FORM_COLUMNS = (
    "form",
    "offset_m",
    "offset_low_m",
    "offset_high_m",
    "c_a",
    "decay",
    "rmse",
    "aicc",
    "blocks",
    "rank",
)


def _samples(frame: pd.DataFrame, vehicle: Vehicle) -> pd.DataFrame:
    """Rows in the air with thrust ratio, height in radii and number of the block."""
    thrust = vehicle.thrust_coefficient_N_s2.value * (frame[list(rotor_speed(4))] ** 2).sum(axis=1)
    weight = vehicle.mass_kg.value * GRAVITY_M_S2
    # cosine of the tilt: the part of body z that points up
    upright = 1 - 2 * (frame["q_x"] ** 2 + frame["q_y"] ** 2)
    # upward acceleration: what is weighed is m (g + a_z)
    climb = np.gradient(frame["v_z_m_s"], frame["t_s"])
    radius = vehicle.rotors[0].radius_m.value
    rows = pd.DataFrame(
        {
            "t_s": frame["t_s"],
            "block": (frame["t_s"] // BLOCK_S).astype(int),
            "z_over_r": frame["p_z_m"] / radius,
            "z_m": frame["p_z_m"],
            "load": weight * (1 + climb / GRAVITY_M_S2),
            "thrust": thrust * upright,
            "weight": weight,
            "speed_m_s": np.hypot(frame["v_x_m_s"], frame["v_y_m_s"]),
            **{f"d{a}_m": frame[f"p_{a}_m"] for a in "xyz"},
        }
    )
    return rows[np.isfinite(rows["z_m"])]


def _steady(rows: pd.DataFrame) -> Iterator[tuple[int, pd.DataFrame]]:
    """Yield blocks that hover.

    Height is held, rotors carry the vehicle all the time, and no sample is missing.
    """
    for number, block in rows.groupby("block"):
        whole = block["t_s"].max() - block["t_s"].min() > 0.9 * BLOCK_S
        airborne = (block["thrust"] > 0.7 * block["weight"]).all() and (
            block["z_m"] > AIRBORNE_M
        ).all()
        if whole and airborne and block["z_m"].std() < STEADY_M:
            yield int(number), block


def _read(path: Path, mapping: Path) -> pd.DataFrame:
    """A published recording, refused where its bytes are not those that were published."""
    name = f"{path.parent.name}/{path.name}"
    digests = {
        local: sha
        for source in published.sources().values()
        for local, (_, sha) in source.files.items()
    }
    published.check(path.read_bytes(), digests.get(name, "not published"), name)
    return open_log(path, Options(mapping)).frame()


def _blocks(name: str, rows: pd.DataFrame) -> pd.DataFrame:
    blocks = [
        (name, number, b["t_s"].mean(), b["z_over_r"].mean(), b["load"].sum() / b["thrust"].sum())
        for number, b in _steady(rows)
    ]
    table = pd.DataFrame(blocks, columns=BLOCK_COLUMNS[:-1])
    # the flight's own error of m / k stands in every block alike and goes out
    table["factor"] = table["ratio"] / table.loc[table["z_over_r"] > FAR, "ratio"].mean()
    return table


def thrust_blocks(recordings: list[Path], vehicle: Path, mapping: Path, blocks: Path) -> None:
    """Write the thrust ratio of every block of steady hover.

    Parameters
    ----------
    recordings : published flights; none give a table of headings only.
    vehicle, mapping : vehicle file, and mapping of the columns.
    blocks : to write; ``factor`` is ``ratio`` over the mean of the same flight's high blocks.

    Raises
    ------
    GesError
        When a recording is not as it was published.
    """
    airframe = load_vehicle(vehicle)
    tables = [_blocks(path.stem, _samples(_read(path, mapping), airframe)) for path in recordings]
    shown = pd.concat(tables) if tables else pd.DataFrame(columns=BLOCK_COLUMNS)
    write_csv(blocks, shown, digits=9)


def _effect(form: str, x: np.ndarray) -> dict[str, float]:
    # the clamp is the study's own heuristic and no part of a form: out of reach at 10
    own = dict(zip(("c_a", "decay"), x[1:], strict=False))
    return {"form": float(FORMS.index(form)), "high": 10.0, "rotor_plane_offset_m": x[0], **own}


def form_curve(form: str, fitted: pd.Series, z_over_r: np.ndarray, vehicle: Vehicle) -> np.ndarray:
    """Return the factor of a fitted form.

    Parameters
    ----------
    form : one of :data:`FORMS`.
    fitted : row of :func:`fit_forms`.
    z_over_r : (n,) heights of the tracked point in rotor radii.
    vehicle : the vehicle.

    Returns
    -------
    (n,).
    """
    x = np.array([fitted["offset_m"], fitted["c_a"], fitted["decay"]])
    return flat_factor(
        z_over_r * vehicle.rotors[0].radius_m.value,
        vehicle.parameters(),
        _effect(form, x[np.isfinite(x)]),
    )


def _fit(form: str, blocks: pd.DataFrame, vehicle: Vehicle) -> dict[str, float | str]:
    radius, height_sd = vehicle.rotors[0].radius_m.value, vehicle.rotors[0].z_m.sd
    height, ratio = blocks["z_over_r"].to_numpy() * radius, blocks["ratio"].to_numpy()
    flights = pd.get_dummies(blocks["flight"]).to_numpy(dtype=float)
    # far from the ground only noise moves the ratio
    noise = blocks[blocks["z_over_r"] > FAR].groupby("flight")["ratio"].std().mean()

    def misfit(x: np.ndarray) -> np.ndarray:
        shape = flat_factor(height, vehicle.parameters(), _effect(form, x))
        # variable projection: given the shape, the best scale of a flight is linear least squares
        scale = (flights.T @ (ratio * shape)) / (flights.T @ shape**2)
        # the last row is the offset's prior: mean 0, deviation as the vehicle file states it
        return np.append((ratio - (flights @ scale) * shape) / noise, x[0] / height_sd)

    own = form == "exponential"
    bounds = ([-0.1, 0.01, 0.3], [0.2, 2.0, 5.0]) if own else ([-0.04], [0.2])
    start = [0.02, 0.3, 1.5] if own else [0.02]
    solution = least_squares(misfit, start, bounds=bounds, diff_step=1e-4)
    # offset and own constants, a scale a flight, and the noise, which was estimated too
    n, k = len(ratio), len(solution.x) + flights.shape[1] + 1
    squares = float(np.sum(solution.fun[:-1] ** 2))
    # rows have unit variance and the scales are projected out: (J'J)^-1 is the covariance
    half = 1.96 * np.sqrt(np.linalg.inv(solution.jac.T @ solution.jac)[0, 0])
    offset = float(solution.x[0])
    return {
        "form": form,
        "offset_m": offset,
        "offset_low_m": offset - half,
        "offset_high_m": offset + half,
        "c_a": solution.x[1] if own else np.nan,
        "decay": solution.x[2] if own else np.nan,
        "rmse": noise * np.sqrt(squares / n),
        # at a noise that is held: chi-squared stands where -2 log-likelihood does
        "aicc": squares + 2 * k + 2 * k * (k + 1) / (n - k - 1),
        "blocks": n,
    }


def fit_forms(blocks: Path, vehicle: Path, forms: Path) -> None:
    """Fit every form of the ground effect to blocks of hover.

    Free are the height of the rotor plane over the tracked point, one scale a flight, and own
    constants. The vehicle file's uncertainty of the height is its prior.

    Parameters
    ----------
    blocks : of :func:`thrust_blocks`.
    vehicle : vehicle file.
    forms : to write: a row a form. ``aicc`` takes the spread of the high blocks as noise; ``rank``
        1 has the least.
    """
    table, airframe = pd.read_csv(blocks), load_vehicle(vehicle)
    rows = [_fit(form, table, airframe) for form in FORMS] if len(table) else []
    fitted = pd.DataFrame(rows, columns=FORM_COLUMNS[:-1])
    fitted["rank"] = fitted["aicc"].rank().astype(int)
    write_csv(forms, fitted, digits=9)


def _scatter(source: str, height: str, rows: pd.DataFrame) -> pd.DataFrame:
    """Displacement of each row from the mean of its block."""
    moved = rows.copy()
    axes = ["dx_m", "dy_m", "dz_m"]
    moved[axes] = rows[axes] - rows.groupby("block")[axes].transform("mean")
    return moved.assign(source=source, height=height)[list(DISPERSION_COLUMNS)]


def _real_scatter(path: Path, vehicle: Vehicle, mapping: Path) -> list[pd.DataFrame]:
    rows = _samples(_read(path, mapping), vehicle)
    # drift is no dispersion
    steady = pd.concat(
        [block for _, block in _steady(rows) if block["speed_m_s"].mean() < DRIFT_M_S]
    )
    chosen = {"low": steady["z_over_r"] < LOW, "high": steady["z_over_r"] > HIGH}
    return [_scatter("real", height, steady[where]) for height, where in chosen.items()]


def _simulated_scatter(
    simulator: Simulator, plan: Flights, heights: dict[str, float], seed: int
) -> list[pd.DataFrame]:
    hover = mode("none", cruise_m_s=0.0, duration_s=22.0)
    flights = [
        hover.but(name, agl_ref_m=z).flight(simulator, plan, seed) for name, z in heights.items()
    ]
    # the real vehicle hovered over a level floor
    level = [type(f)(f.parameters, f.effects, Terrain.flat()) for f in flights]
    tables = []
    for height, record in zip(
        heights, flown(level, ("t_s", "p_x_m", "p_y_m", "p_z_m")), strict=True
    ):
        rows = pd.DataFrame(
            {
                "t_s": record["t_s"],
                "dx_m": record["p_x_m"],
                "dy_m": record["p_y_m"],
                "dz_m": record["p_z_m"],
            }
        )
        # without the first seconds, in which the height settles
        rows = rows[rows["t_s"] >= 10.0].assign(block=lambda r: (r["t_s"] // BLOCK_S).astype(int))
        tables.append(_scatter("simulated", height, rows))
    return tables


def hover_dispersion(
    recordings: list[Path],
    vehicle: Path,
    mapping: Path,
    simulator: Simulator,
    plan: Flights,
    seed: int,
    scatter: Path,
) -> None:
    """Write displacements in low and high hover, real and simulated.

    Parameters
    ----------
    recordings : published flights, of which ``HOVERING`` is read.
    vehicle, mapping : vehicle file, and mapping of the columns.
    simulator, plan : what is simulated, and how.
    seed : of the simulated flights.
    scatter : to write: displacement of each sample from the mean of its block (m).
    """
    radius = simulator.vehicle.rotor_radius_m
    tables = _simulated_scatter(simulator, plan, {"low": 0.8 * radius, "high": 12.0 * radius}, seed)
    for path in (p for p in recordings if p.stem == "HOVERING"):
        tables = _real_scatter(path, load_vehicle(vehicle), mapping) + tables
    write_csv(scatter, pd.concat(tables), digits=9)
