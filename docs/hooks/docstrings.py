"""Docstrings of the API page. They have types in the signature and a text behind the colon, where
numpydoc has a type; griffe is told so.
"""

import re
import textwrap

import griffe

_REST = r"\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)"
SECTION = re.compile(rf"^(Parameters|Attributes){_REST}", re.M | re.S)
ITEM = re.compile(r"^(\w[\w, *]*) : (?=\S)", re.M)
GIVEN = re.compile(rf"^(Returns|Yields){_REST}", re.M | re.S)


class TextBehindColon(griffe.Extension):
    """Move the text of a parameter below its name, and that of what is returned below a dash."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Called by griffe with everything that it has read."""
        if obj.docstring:
            text = SECTION.sub(lambda s: ITEM.sub(r"\1\n    ", s[0]), obj.docstring.value)
            obj.docstring.value = GIVEN.sub(_below_a_dash, text)


def _below_a_dash(section: re.Match) -> str:
    return f"{section[1]}\n-------\n:\n{textwrap.indent(section[2], '    ')}"
