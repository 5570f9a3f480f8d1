"""Laws: force and moment on the body as sums of products of dimensionless groups.

A law writes what no effect of the library has::

    force_y = 0.0975 m g (V_x/v_h)

A term is a coefficient, a scale and groups. The scale is ``m g``, the weight, or ``T``, the thrust
of all rotors out of ground effect. In a moment either is multiplied by ``L``, the arm of the
rotors. A group is a quantity over its reference: ``(V_x/v_h)``, ``(R/h)^2``,
``(V_x/v_h)|V_x/v_h|``. The compiled simulator lists the groups (``sim_c/effects/groups.def``) and
evaluates them (``law.h``). A term may act about one place on the map, ``near(1.2 m, -0.5 m, 0.4
m)``. It is then multiplied by exp(-((x - 1.2 m)^2 + (y + 0.5 m)^2) / (2 (0.4 m)^2)).

Among the effects of a flight, laws stand under :data:`LAW`, with coefficients by channel and term:
``{"law": {"force_y: m g (V_x/v_h)": 0.0975}}``.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Mapping

import numpy as np

from ges.errors import UsageError, unknown_name
from ges.simulator import _lib

LAW = "law"
CHANNELS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
SCALES = ("m g", "T")

_NUMBER = r"[+-]?\s*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_TERM = re.compile(
    rf"\s*(?P<number>{_NUMBER})\s*(?P<scale>m\s+g|T)(?P<arm>\s+L)?\b"
    r"(?P<factors>(?:\s*(?:\([^()|]*\)|\|[^()|]*\|)(?:\^\d+)?)*)\s*"
    rf"(?:near\(\s*(?P<x>{_NUMBER})\s*m\s*,\s*(?P<y>{_NUMBER})\s*m\s*,"
    rf"\s*(?P<width>{_NUMBER})\s*m\s*\)\s*)?"
)
_FACTOR = re.compile(r"(?P<open>[(|])\s*(?P<group>[^()|]*?)\s*[)|](?:\^(?P<power>\d+))?")


@dataclasses.dataclass(frozen=True)
class Group:
    """A dimensionless group: a quantity of the flight over its reference.

    Attributes
    ----------
    quantity, reference : their symbols.
    unit : of quantity and reference.
    needs : streams that must be recorded to know it, as the ``needs`` of effects.
    doc : the quantity in words.
    """

    quantity: str
    reference: str
    unit: str
    needs: tuple[str, ...]
    doc: str

    @property
    def text(self) -> str:
        """The group as it is written, without brackets: ``V_x/v_h``."""
        return f"{self.quantity}/{self.reference}"

    @property
    def latex(self) -> str:
        """The group in LaTeX, without brackets."""
        return rf"\frac{{{self.quantity}}}{{{self.reference}}}"


@functools.lru_cache(maxsize=1)
def groups() -> dict[str, Group]:
    """List every group that laws may use.

    Returns
    -------
    Groups by their text, in the order of exponents of :class:`Term`.
    """
    listed = (Group(q, r, unit, tuple(n.split()), doc) for q, r, unit, n, doc in _lib.group_table())
    return {group.text: group for group in listed}


@dataclasses.dataclass(frozen=True)
class Term:
    """A term of a law without its coefficient.

    Attributes
    ----------
    channel : where it acts, one of :data:`CHANNELS`, body frame.
    scale : one of :data:`SCALES`; in a moment times the arm.
    power, magnitude : exponents in ``g^power |g|^magnitude`` for each group g, in the order of
        :func:`groups`.
    near_m : x, y and width of the place about which it acts, world, m; width 0 for everywhere.
    """

    channel: str
    scale: str
    power: tuple[int, ...]
    magnitude: tuple[int, ...]
    near_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(
        cls,
        channel: str,
        scale: str,
        power: Mapping[str, int],
        magnitude: Mapping[str, int] | None = None,
        near_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Term:
        """Make a term from exponents by group.

        Parameters
        ----------
        channel, scale, near_m : as the attributes.
        power, magnitude : exponents by the text of the group; 0 elsewhere.
        """
        names, more = groups(), magnitude or {}
        return cls(
            channel,
            scale,
            tuple(power.get(g, 0) for g in names),
            tuple(more.get(g, 0) for g in names),
            near_m,
        )

    @property
    def text(self) -> str:
        """The term as it is written: ``m g (V_x/v_h)``."""
        factors = [f"{self.scale} L" if self.channel.startswith("moment") else self.scale]
        for group, n, m in zip(groups(), self.power, self.magnitude, strict=True):
            signed = f"({group})" + (f"^{n}" if n > 1 else "") if n else ""
            unsigned = f"|{group}|" + (f"^{m}" if m > 1 else "") if m else ""
            factors += [signed + unsigned] if n or m else []
        if self.local:
            x, y, width = map(repr, self.near_m)
            factors.append(f"near({x} m, {y} m, {width} m)")
        return " ".join(factors)

    @property
    def latex(self) -> str:
        r"""The term in LaTeX: ``m g \left(\frac{V_x}{v_h}\right)``."""
        factors = [f"{self.scale} L" if self.channel.startswith("moment") else self.scale]
        for group, n, m in zip(groups().values(), self.power, self.magnitude, strict=True):
            signed = rf"\left({group.latex}\right)" if n else ""
            unsigned = rf"\left|{group.latex}\right|" if m else ""
            factors.append(
                signed + (f"^{n}" if n > 1 else "") + unsigned + (f"^{m}" if m > 1 else "")
            )
        if self.local:
            place = r", ".join(rf"{number:g}\,\text{{m}}" for number in self.near_m)
            factors.append(rf"\,\text{{near}}({place})")
        return r" ".join(filter(None, factors))

    @property
    def varies(self) -> bool:
        """Whether it is more than a constant share of weight or thrust."""
        return self.local or any((*self.power, *self.magnitude))

    @property
    def local(self) -> bool:
        """Whether it acts about one place only."""
        return self.near_m[2] > 0.0

    @property
    def key(self) -> str:
        """Its name among the parameters of :data:`LAW`: ``force_y: m g (V_x/v_h)``."""
        return f"{self.channel}: {self.text}"

    @property
    def needs(self) -> frozenset[str]:
        """Streams that must be recorded to know its groups."""
        used = np.add(self.power, self.magnitude) > 0
        own = frozenset({"position"}) if self.local else frozenset()
        return own | {
            n for g, on in zip(groups().values(), used, strict=True) if on for n in g.needs
        }

    def product(self, of_group: Mapping[str, np.ndarray], p_m: np.ndarray) -> np.ndarray:
        """Multiply its groups, and the weight of its place.

        Parameters
        ----------
        of_group : values (n,) of each group by its text.
        p_m : horizontal position (n, 2) in the world.

        Returns
        -------
        Product (n,), without scale and coefficient.
        """
        x, y, width = self.near_m
        away = ((p_m - (x, y)) ** 2).sum(axis=1) / (2.0 * width**2) if self.local else np.zeros(1)
        product = np.exp(-away)
        for group, n, m in zip(groups(), self.power, self.magnitude, strict=True):
            if n or m:
                product = product * of_group[group] ** n * np.abs(of_group[group]) ** m
        return product


def parse(channel: str, text: str) -> dict[Term, float]:
    """Read the terms of a law with their coefficients.

    Parameters
    ----------
    channel : one of :data:`CHANNELS`.
    text : as ``0.0975 m g (V_x/v_h) - 0.02 T (R/h)^2``.

    Returns
    -------
    Coefficients by term, in the order of the text.

    Raises
    ------
    UsageError
        When the channel, a group or a dimension is wrong; it says which, and what is allowed.

    Examples
    --------
    >>> {term.text: c for term, c in parse("force_y", "0.1 m g (V_x/v_h)").items()}
    {'m g (V_x/v_h)': 0.1}
    """
    if channel not in CHANNELS:
        raise unknown_name("channel of a law", channel, CHANNELS)
    terms: dict[Term, float] = {}
    at = 0
    while at < len(text) or not terms:
        met = _TERM.match(text, at)
        # the sign of every term but the first stands before its number
        if not met or (terms and met["number"].lstrip()[0] not in "+-"):
            raise UsageError(
                f"the law of {channel} cannot be read at '{text[at:].strip()}'; a term is a number,"
                " then 'm g' or 'T', of a moment 'm g L' or 'T L', then groups such as (V_x/v_h),"
                " (R/h)^2 or (V_x/v_h)|V_x/v_h|, then a place, near(1 m, 2 m, 0.5 m)"
            )
        term, at = _term(channel, met), met.end()
        if term in terms:
            raise UsageError(f"the law of {channel} has the term '{term.text}' twice; add them up")
        terms[term] = float(re.sub(r"\s", "", met["number"]))
    return terms


def _term(channel: str, met: re.Match[str]) -> Term:
    """Convert a match to a term, and check its dimension."""
    is_moment = channel.startswith("moment")
    if bool(met["arm"]) != is_moment:
        kinds = ("a moment", "m g L or T L") if is_moment else ("a force", "m g or T")
        raise UsageError(
            f"the law of {channel}: '{met[0].strip()}' is not {kinds[0]}; it needs a share of"
            f" {kinds[1]}"
        )
    power: dict[str, int] = {}
    magnitude: dict[str, int] = {}
    for factor in _FACTOR.finditer(met["factors"]):
        group = re.sub(r"\s", "", factor["group"])
        if group not in groups():
            raise unknown_name(f"group in the law of {channel}", group, groups())
        of = power if factor["open"] == "(" else magnitude
        of[group] = of.get(group, 0) + int(factor["power"] or 1)
    x, y, width = (float(re.sub(r"\s", "", met[k] or "0")) for k in ("x", "y", "width"))
    if met["width"] and not width > 0.0:
        raise UsageError(
            f"the law of {channel}: near({x:g} m, {y:g} m, {width:g} m) has no width; it must be"
            " above 0 m"
        )
    return Term.of(channel, re.sub(r"\s+", " ", met["scale"]), power, magnitude, (x, y, width))


def written(coefficients: Mapping[Term, float], digits: int | None = None) -> str:
    """Write the terms of one law, as :func:`parse` reads them.

    Parameters
    ----------
    coefficients : by term; one at least.
    digits : significant digits of the coefficients; all that they have by default.

    Examples
    --------
    >>> written(parse("force_y", "0.12345 m g (V_x/v_h) - 0.02 T"), digits=2)
    '0.12 m g (V_x/v_h) - 0.02 T'
    """
    form = "" if digits is None else f".{digits}g"
    (first, c), *more = coefficients.items()
    parts = [f"{c:{form}} {first.text}"]
    parts += [f"{'-' if c < 0 else '+'} {abs(c):{form}} {term.text}" for term, c in more]
    return " ".join(parts)


def latex(channel: str, coefficients: Mapping[Term, float]) -> str:
    r"""Write a law in LaTeX.

    Parameters
    ----------
    channel : one of :data:`CHANNELS`.
    coefficients : by term; none for a law that is zero.

    Examples
    --------
    >>> latex("force_y", parse("force_y", "1.2e-5 T - 0.02 m g (R/h)^2"))
    'F_y = 1.2 \\times 10^{-5}\\, T - 0.02\\, m g \\left(\\frac{R}{h}\\right)^2'
    """
    kind, axis = channel.split("_")
    terms = [rf"{_latex_number(c)}\, {term.latex}" for term, c in coefficients.items()] or ["0"]
    right = " + ".join(terms).replace("+ -", "- ")
    return f"{kind[0].upper()}_{axis} = {right}"


def _latex_number(value: float) -> str:
    mantissa, _, exponent = f"{value:g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa


@functools.lru_cache(maxsize=1024)
def term_of(key: str) -> Term:
    """Read the :attr:`Term.key` of a term.

    Parameters
    ----------
    key : as ``force_y: m g (V_x/v_h)``.

    Raises
    ------
    UsageError
        When it is none.
    """
    channel, _, text = key.partition(": ")
    (term,) = parse(channel, f"1 {text}")
    return term


def packed(coefficients: Mapping[str, float]) -> list[tuple]:
    """Convert the terms of laws to what the compiled simulator takes.

    Parameters
    ----------
    coefficients : by :attr:`Term.key`.

    Returns
    -------
    Tuples of channel, scale, powers, powers of magnitudes, place and width (m), and coefficient.
    """
    return [
        (CHANNELS.index(t.channel), SCALES.index(t.scale), t.power, t.magnitude, t.near_m, float(c))
        for t, c in ((term_of(key), c) for key, c in coefficients.items())
    ]
