"""A sparse form for what no effect explains: a hypothesis for an engineer to think about, never a
finding.

Terms are products of physical quantities: m g weight, T thrust, L arm of the rotors, v_h induced
speed of hover, R radius, h height over the ground, V_x, V_y and V_z speed forward, left and along
thrust, V_h horizontal, v_z climb. A term takes part in a channel only where its dimension is the
channel's, so that every coefficient is a plain number. Few of them are chosen by orthogonal
matching (Pati et al. 1993), each kept only while it predicts blocks of time that it was not fitted
to.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import FORCE, LENGTH, MOMENT, NUMBER, SPEED, Dimension
from ges.diagnose.design.instruments import own_signal
from ges.diagnose.design.residual import speeds_at_work
from ges.diagnose.design.system import System
from ges.diagnose.design.weak import Windows
from ges.diagnose.locate.structure import Regimes
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


@dataclasses.dataclass(frozen=True)
class Factor:
    """A physical quantity along the flights: how it is written, its dimension, its values (n,)."""

    text: str
    dimension: Dimension
    values: np.ndarray

    def __mul__(self, other: Factor) -> Factor:
        text = " ".join(t for t in (self.text, other.text) if t)
        return Factor(text, _plus(self.dimension, other.dimension), self.values * other.values)

    def over(self, other: Factor) -> Factor:
        """The ratio of two quantities."""
        minus = _plus(self.dimension, other.dimension, -1)
        return Factor(f"({self.text}/{other.text})", minus, self.values / other.values)

    def power(self, n: int) -> Factor:
        """The n-th power."""
        return Factor(
            f"{self.text}^{n}" if n > 1 else self.text,
            tuple(n * d for d in self.dimension),
            self.values**n,
        )

    def squared(self) -> Factor:
        """The square with the sign of the quantity, as drag has it."""
        dimension = tuple(2 * d for d in self.dimension)
        return Factor(
            f"{self.text}|{self.text[1:-1]}|", dimension, self.values * np.abs(self.values)
        )


def _plus(a: Dimension, b: Dimension, sign: int = 1) -> Dimension:
    return tuple(x + sign * y for x, y in zip(a, b, strict=True))


@dataclasses.dataclass(frozen=True)
class Form:
    """A sum of terms for one channel: their coefficients with standard deviations, and R^2 on
    blocks of time left out.
    """

    channel: str
    terms: tuple[str, ...]
    coefficients: tuple[float, ...]
    sd: tuple[float, ...]
    r2: float

    def content(self) -> dict:
        """``hypothesis`` of an unexplained entry."""
        terms = [
            {"term": t, "coefficient": c, "sd": s, "unit": "1"}
            for t, c, s in zip(self.terms, self.coefficients, self.sd, strict=True)
        ]
        written = " ".join(
            f"{'-' if c < 0 else '+'} {abs(c):.3g} {t}"
            for t, c in zip(self.terms, self.coefficients, strict=True)
        )
        return {
            "form": f"{self.channel} = {written.removeprefix('+ ')}",
            "terms": terms,
            "r2": self.r2,
        }


def _scales(system: System) -> list[Factor]:
    """What a force or a moment may be a share of: weight and thrust, each alone and with the
    rotors' arm.
    """
    model = system.model
    count = sum(len(r.windows) for r in system.flights)
    weight = Factor("m g", FORCE, np.full(count, model.weight_N))
    arm = Factor("L", LENGTH, np.full(count, model.arm_m))
    thrust = Factor(
        "T", FORCE, np.concatenate([_thrust(r.flight, r.windows, model) for r in system.flights])
    )
    return [weight, thrust, weight * arm, thrust * arm]


def _thrust(flight: Prepared, windows: Windows, model: Model) -> np.ndarray:
    return own_signal(
        flight, windows, model, speeds_at_work(flight, model, model.effects), ("force_z",)
    )["force_z"]


def _shapes(system: System, regimes: Regimes) -> list[Factor]:
    """Numbers: powers of speeds over the induced speed of hover, of radius over height, and their
    products.
    """
    model = system.model
    values = {
        name: np.concatenate([t[name] for t in regimes])
        for name in regimes[0]
        if all(name in t for t in regimes)
    }
    # momentum theory: v_h = sqrt(W / (2 rho A)) over the discs of four rotors
    disc = 4.0 * np.pi * model.radius_m**2
    hover = Factor(
        "v_h",
        SPEED,
        np.full(
            len(values["time_s"]),
            np.sqrt(model.weight_N / (2.0 * model.number("rho_kg_m3") * disc)),
        ),
    )
    speeds = {
        "forward_m_s": "V_x",
        "left_m_s": "V_y",
        "along_thrust_m_s": "V_z",
        "airspeed_m_s": "V_h",
        "climb_m_s": "v_z",
    }
    ratios = [
        Factor(text, SPEED, values[name]).over(hover)
        for name, text in speeds.items()
        if name in values
    ]
    moving = [*ratios, *(r.squared() for r in ratios)]
    if "height_over_radius" not in values:
        return moving
    # a height near zero, or wrong by noise, would make R/h run away
    near = Factor("(R/h)", NUMBER, 1.0 / np.maximum(values["height_over_radius"], 0.5))
    cushions = [near.power(n) for n in (1, 2, 3)]
    return [*moving, *cushions, *(a * b for a, b in itertools.product(ratios, cushions[:2]))]


def library(system: System, regimes: Regimes, dimension: Dimension) -> list[Factor]:
    """All terms of this dimension."""
    # a term that does not vary is the constant, which every design has already
    terms = [scale * shape for scale in _scales(system) for shape in _shapes(system, regimes)]
    return [t for t in terms if t.dimension == dimension and np.std(t.values) > 0]


def _design(terms: Sequence[Factor], good: np.ndarray) -> np.ndarray:
    """Columns (n, k + 1), the last a constant: what recalibration takes up is none of the form's
    business.
    """
    return np.column_stack([*(t.values[good] for t in terms), np.ones(int(good.sum()))])


def _fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(x, y, rcond=None)[0]


def _r2(x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> float:
    """Share of the variance of ``y`` that fits on the other folds predict."""
    left = [y[fold == f] - x[fold == f] @ _fit(x[fold != f], y[fold != f]) for f in np.unique(fold)]
    return 1.0 - float(np.concatenate(left).var() / max(y.var(), settings.numerics.tiny))


def sparse_form(
    channel: str, e: np.ndarray, terms: Sequence[Factor], block: np.ndarray
) -> Form | None:
    """Few terms that together explain a residual; None where not even one does.

    Parameters
    ----------
    e : (n,) residual in the channel's unit, NaN where it is absent.
    terms : of the channel's dimension, :func:`library`.
    block : (n,) number of the block of time.
    """
    good = np.isfinite(e)
    # blocks are dealt out in turn, so that every fold spans all flights
    y, fold = e[good], block[good] % settings.statistics.folds
    chosen: list[Factor] = []
    best = 0.0
    while len(chosen) < settings.report.terms:
        # orthogonal matching: all chosen terms are fitted again before the next is matched
        left = y - _design(chosen, good) @ _fit(_design(chosen, good), y)
        match = [
            abs(np.corrcoef(t.values[good], left)[0, 1]) if np.std(t.values[good]) > 0 else 0.0
            for t in terms
        ]
        tried = [*chosen, terms[int(np.argmax(match))]]
        r2 = _r2(_design(tried, good), y, fold)
        if r2 < best + settings.statistics.least_gain:
            break
        chosen, best = tried, r2
    if best < settings.locate.r2_least:
        return None
    x = _design(chosen, good)
    beta = _fit(x, y)
    sd = _sandwich(x, y - x @ beta, block[good])
    k = len(chosen)
    return Form(
        channel,
        tuple(t.text for t in chosen),
        tuple(map(float, beta[:k])),
        tuple(map(float, sd[:k])),
        best,
    )


def _sandwich(x: np.ndarray, e: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Standard deviations of the coefficients when blocks of time are independent and windows are
    not.
    """
    inverse = np.linalg.pinv(x.T @ x)
    # scores by block, the meat of the sandwich
    sums = np.stack([np.bincount(block, column * e) for column in x.T], axis=1)
    return np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse))


def hypotheses(
    system: System,
    left: Sequence[np.ndarray],
    regimes: Regimes,
    channels: Sequence[str],
    length_s: float,
) -> Mapping[str, Form]:
    """A form for each of these channels, where one is found.

    Parameters
    ----------
    left : by flight, (m, C) residuals in the channels' units.
    regimes : by flight, regime variables of every window, (m,) each.
    length_s : of a block of time.
    """
    dimension = {"force": FORCE, "acc": FORCE, "moment": MOMENT}
    block = np.concatenate(system.blocks(length_s))
    found = {}
    for name in (c for c in channels if c.split("_")[0] in dimension):
        e = np.concatenate([row[:, system.main.index(name)] for row in left])
        form = sparse_form(name, e, library(system, regimes, dimension[name.split("_")[0]]), block)
        if form:
            found[name] = form
    return found
