"""Draw the frames of ``ges.vehicle.layouts`` for docs/vehicle.md: ``python docs/frames.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from ges.vehicle.layouts import LAYOUTS

COLUMNS, CELL_IN, RADIUS = 7, 1.5, 0.26
COLOUR = {"ccw": "#1b6ca8", "cw": "#c0561f"}


def main() -> None:
    """Draw every frame from above, the nose up, into docs/img/frames.png."""
    mpl.use("Agg")
    rows = -(-len(LAYOUTS) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(CELL_IN * COLUMNS, 1.15 * CELL_IN * rows))
    for ax in axes.flat:
        ax.axis("off")
    for ax, (name, mounts) in zip(axes.flat, LAYOUTS.items(), strict=False):
        reach = max(m.reach for m in mounts)
        for number, m in enumerate(mounts, 1):
            angle = np.radians(m.angle_deg)
            # the lower rotor of a pair is drawn beside the upper one, further out
            far = m.reach / reach + (0.5 if m.level < 0 else 0.0)
            x, y = far * np.sin(angle), far * np.cos(angle)
            ax.plot([0.0, x], [0.0, y], color="0.75", lw=1.0, zorder=0)
            dashed = "--" if m.level < 0 else "-"
            ax.add_patch(
                plt.Circle((x, y), RADIUS, fc="white", ec=COLOUR[m.spin], lw=1.4, ls=dashed)
            )
            ax.text(x, y, str(number), ha="center", va="center", fontsize=8, color=COLOUR[m.spin])
        ax.plot([0.0], [0.22], marker="^", color="0.4", ms=5)
        ax.set(xlim=(-1.9, 1.9), ylim=(-1.9, 1.9), aspect="equal")
        ax.set_title(name, fontsize=8, pad=1)
    figure.text(
        0.5,
        0.005,
        "seen from above, nose up; blue turns ccw, orange cw; dashed: the lower one of a pair",
        ha="center",
        fontsize=8,
    )
    figure.subplots_adjust(0.01, 0.03, 0.99, 0.97, 0.02, 0.12)
    figure.savefig(Path(__file__).with_name("img") / "frames.png", dpi=80)


if __name__ == "__main__":
    main()
