"""Docstrings of the API page. They have types in the signature and a text behind the colon, where
numpydoc has a type; griffe is told so.
"""

import re

import griffe

SECTION = re.compile(r"^(Parameters|Attributes)\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", re.M | re.S)
ITEM = re.compile(r"^(\w[\w, *]*) : (?=\S)", re.M)
RETURNS = re.compile(r"^Returns\n-+\n(?=\S)", re.M)


class TextBehindColon(griffe.Extension):
    """Move the text of a parameter below its name, and that of what is returned below a dash."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Called by griffe with everything that it has read."""
        if obj.docstring:
            text = SECTION.sub(lambda s: ITEM.sub(r"\1\n    ", s[0]), obj.docstring.value)
            obj.docstring.value = RETURNS.sub("Returns\n-------\n:\n    ", text)
