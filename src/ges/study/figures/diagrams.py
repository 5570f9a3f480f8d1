"""Diagrams drawn by code: boxes with words, joined by arrows. Their table lists the joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Path2D

from ges.study.figures import style

Place = tuple[float, float]


class _Board:
    """Boxes by name on a plane measured in inches."""

    def __init__(self, width: float, height: float) -> None:
        self.figure, self.axes = style.subplots(width=width, height=height)
        self._blank(self.axes, width, height)
        self.places: dict[str, tuple[Place, Place]] = {}
        self.joints: list[tuple[str, str, str]] = []

    @staticmethod
    def _blank(axes: Axes, width: float, height: float) -> None:
        axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
        axes.axis("off")

    def box(
        self,
        name: str,
        centre: Place,
        words: str,
        size: Place = (1.2, 0.42),
        fill: str = "#ffffff",
        round_: bool = True,
    ) -> None:
        """A box that is known by ``name``."""
        (x, y), (w, h) = centre, size
        shape = f"round,pad=0,rounding_size={0.06 if round_ else 0.001}"
        self.axes.add_patch(
            FancyBboxPatch(
                (x - w / 2, y - h / 2), w, h, boxstyle=shape, fc=fill, ec="#333333", lw=0.7
            )
        )
        self.axes.text(x, y, words, ha="center", va="center", fontsize=7.5, linespacing=1.15)
        self.places[name] = (centre, size)

    def _edge(self, name: str, side: str) -> Place:
        (x, y), (w, h) = self.places[name]
        dx, dy = {"l": (-1, 0), "r": (1, 0), "t": (0, 1), "b": (0, -1)}[side]
        return x + dx * w / 2, y + dy * h / 2

    def join(
        self,
        a: str,
        b: str,
        sides: str,
        words: str = "",
        at: Place | None = None,
        via: Sequence[Place] = (),
        end: Place | None = None,
    ) -> None:
        """Draw an arrow from one box to another.

        It goes from side ``sides[0]`` of a to side ``sides[1]`` of b (l, r, t, b) through points,
        with words ``at`` a place.
        """
        corners = [self._edge(a, sides[0]), *via, end or self._edge(b, sides[1])]
        look = {
            "arrowstyle": "-|>",
            "mutation_scale": 7,
            "lw": 0.8,
            "color": "#333333",
            "joinstyle": "round",
        }
        self.axes.add_patch(FancyArrowPatch(path=Path2D(corners), fc="none", **look))
        if words:
            x, y = at or (
                (corners[0][0] + corners[-1][0]) / 2,
                (corners[0][1] + corners[-1][1]) / 2 + 0.08,
            )
            self.axes.text(x, y, words, ha="center", va="center", fontsize=6.8)
        self.joints.append((a, b, words.replace("\n", " ")))

    def save(self, data: Path, pdf: Path, png: Path) -> None:
        style.save(
            self.figure, pd.DataFrame(self.joints, columns=["from", "to", "what"]), data, pdf, png
        )


PALE, BLUISH, GREENISH, REDDISH = "#f4f4f4", "#e3eef7", "#e2f2ec", "#fbe9df"


def system(data: Path, pdf: Path, png: Path) -> None:
    """Draw the closed loop: ground, vehicle, sensors, estimate, controller (the paper's figure 5).

    Parameters
    ----------
    data, pdf, png : to write: the joints, and the figure.
    """
    b = _Board(style.PAGE_IN, 2.35)
    b.box("ground", (0.75, 1.85), "ground from a seed\nheight, slope, curvature", (1.4, 0.5), PALE)
    b.box("effect", (2.45, 1.85), "ground effect\n$f$ of each rotor", (1.1, 0.5), PALE)
    b.box(
        "body", (4.2, 1.85), "rigid body, rotors\n$T_i = K_T\\,\\omega_i^2\\,f_i$", (1.3, 0.5), PALE
    )
    b.box(
        "sensors", (6.12, 1.85), "sensors: gyro, range,\nrotor speeds, currents", (1.5, 0.5), PALE
    )
    b.box("analytical", (4.35, 1.02), "analytical: flat-ground $f(z)$", (1.75, 0.3), BLUISH)
    b.box("ml", (4.35, 0.64), "network: 13 features", (1.75, 0.3), GREENISH)
    b.box("oracle", (4.35, 0.26), "oracle: true $f$, diagnostic only", (1.75, 0.3), REDDISH)
    b.box("select", (2.45, 0.64), "mode\ncutover, trust\nband, clamp", (0.95, 1.06), PALE)
    b.box(
        "control",
        (0.75, 0.64),
        "PID and mixer\n\ncommand $\\times\\,1/\\sqrt{\\hat f}$",
        (1.35, 0.62),
        PALE,
    )
    b.join("ground", "effect", "rl")
    b.join("effect", "body", "rl", "$f_i$")
    b.join("body", "sensors", "rl")
    b.join("sensors", "analytical", "br", via=[(6.12, 1.02)])
    b.join("sensors", "ml", "br", via=[(6.12, 0.64)])
    for source, y in (("analytical", 1.02), ("ml", 0.64), ("oracle", 0.26)):
        b.join(source, "select", "lr", r"$\hat f$", (3.2, y + 0.1), end=(2.925, y))
    b.join("select", "control", "lr", r"$\hat f$")
    b.join("control", "body", "tb", "rotor commands", (1.4, 1.32), via=[(0.75, 1.22), (4.2, 1.22)])
    b.join(
        "body",
        "ground",
        "tt",
        "position over the ground",
        (2.45, 2.23),
        via=[(4.2, 2.3), (0.75, 2.3)],
    )
    b.save(data, pdf, png)


def decision(data: Path, pdf: Path, png: Path) -> None:
    """Draw what the hybrid firmware does at every tick (the paper's figure 20).

    Parameters
    ----------
    data, pdf, png : to write: the joints, and the figure.
    """
    b = _Board(style.COLUMN_IN, 2.75)
    x, right = 1.12, 2.68
    b.box(
        "read",
        (x, 2.55),
        "range $z$, network $\\hat f_{ml}$,\nanalytical $\\hat f_a = f(z)$",
        (1.7, 0.36),
        PALE,
    )
    b.box("low", (x, 1.98), "$z$ below cutover?", (1.5, 0.3), BLUISH)
    b.box("band", (x, 1.43), "$|\\hat f_{ml}-\\hat f_a|$ outside band?", (1.7, 0.3), BLUISH)
    b.box(
        "clamp",
        (x, 0.88),
        "clamped mode:\n$\\min(\\hat f_{ml},\\ \\hat f_a + c)$",
        (1.5, 0.36),
        GREENISH,
    )
    b.box("out", (x, 0.25), "command $\\times\\,1/\\sqrt{\\hat f}$", (1.5, 0.3), PALE)
    b.box("analytical", (right, 1.7), "use $\\hat f_a$", (0.8, 0.3), REDDISH)
    b.join("read", "low", "bt")
    b.join("low", "band", "bt", "no", (x + 0.14, 1.72))
    b.join("band", "clamp", "bt", "no", (x + 0.14, 1.18))
    b.join("clamp", "out", "bt", r"$\hat f$", (x + 0.12, 0.56))
    b.join("low", "analytical", "rt", "yes", (2.2, 2.06), via=[(right, 1.98)])
    b.join("band", "analytical", "rb", "yes", (2.2, 1.51), via=[(right, 1.43)])
    b.join("analytical", "out", "rr", r"$\hat f_a$", (3.24, 0.95), via=[(3.13, 1.7), (3.13, 0.25)])
    b.save(data, pdf, png)


_STEPS: Sequence[tuple[str, str, str]] = (
    ("config", "configuration\nand its schema", PALE),
    ("flights", "flights\none file a seed", BLUISH),
    ("splits", "splits\nand leakage check", BLUISH),
    ("models", "models\ntrained, exported", GREENISH),
    ("loop", "closed loop\nall experiments", REDDISH),
    ("paper", "figures, claims,\npaper, manifest", PALE),
)


def pipeline(data: Path, pdf: Path, png: Path) -> None:
    """Draw the workflow from configuration to PDF.

    Parameters
    ----------
    data, pdf, png : to write: the joints, and the figure.
    """
    b = _Board(style.PAGE_IN, 0.95)
    for i, (name, words, fill) in enumerate(_STEPS):
        b.box(name, (0.56 + i * 1.162, 0.6), words, (1.0, 0.44), fill)
    for (a, *_), (c, *_) in zip(_STEPS, _STEPS[1:], strict=False):
        b.join(a, c, "rl")
    b.join(
        "config",
        "loop",
        "bb",
        "fresh seeds, flown with the trained network",
        (2.88, 0.22),
        via=[(0.56, 0.12), (5.208, 0.12)],
    )
    b.save(data, pdf, png)
