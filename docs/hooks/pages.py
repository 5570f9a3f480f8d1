"""What the site does to a page: equations become MathML, which a browser sets without a script or
another host, and roles of docstrings become plain code.
"""

import html
import re

from latex2mathml.converter import convert

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.S)
ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):<code>~?([\w.]+)</code>")


def on_page_content(content: str, **_: object) -> str:
    """Called by mkdocs with the HTML of each page."""
    content = EQUATION.sub(_equation, content)
    return ROLE.sub(lambda role: f"<code>{role[1]}</code>", content)


def _equation(found: re.Match) -> str:
    tag, latex = found.groups()
    shown = "block" if tag == "div" else "inline"
    return convert(html.unescape(latex), display=shown)
