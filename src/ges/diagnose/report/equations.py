"""Equations of the page as MathML, which a browser sets without a script or another host."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from latex2mathml.converter import convert
from markupsafe import Markup

from ges.simulator import effects as effect_table
from ges.simulator import laws


def typeset(latex: str, display: str = "block") -> Markup:
    """Convert an equation to MathML.

    Parameters
    ----------
    latex : the equation.
    display : ``block`` for a line of its own, ``inline`` within a line.
    """
    return Markup(convert(latex, display=display))


def effect_equation(finding: Mapping[str, Any]) -> Markup:
    """Typeset the equation of a finding.

    Parameters
    ----------
    finding : entry of diagnosis.json. One that another version made keeps its plain text.
    """
    effect = effect_table.table().get(finding["name"])
    if effect is None or effect.equation != finding["equation"]:
        return Markup("<code>{}</code>").format(finding["equation"])
    return Markup("").join(map(typeset, effect.latex_lines))


def law_equation(law: Mapping[str, Any], display: str = "block") -> Markup:
    """Typeset a law.

    Parameters
    ----------
    law : has ``channel`` and ``form``, which is ``0`` for a law without terms.
    display : as of :func:`typeset`.
    """
    channel, form = law["channel"], law["form"]
    terms = {} if form == "0" else laws.parse(channel, form)
    return typeset(laws.latex(channel, terms), display)


def term_equation(channel: str, term: str) -> Markup:
    """Typeset a term of a law, without its coefficient.

    Parameters
    ----------
    channel, term : as in diagnosis.json.
    """
    return typeset(laws.term_of(f"{channel}: {term}").latex, "inline")
