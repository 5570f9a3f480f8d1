"""Sentences of pages and docstrings, split the same way wherever their length is tested."""

import re

SECTION = re.compile(r"^\w[\w ]*\n-{3,}$", re.M)
# An entry of a section: a name and its text, or a line above an indented text.
ENTRY = re.compile(r"^(?=\S(?:.* : |.*\n {4}\S))", re.M)
# Of Python, or of a command: click leaves lines below a backspace as they are.
EXAMPLE = re.compile(r"^(?: *>>> |\x08).*\n?(?:.*\S.*\n?)*", re.M)


def sentences(text: str) -> list[str]:
    """Sentences of the prose of a page, without code, equations, tables and headings."""
    text = re.sub(r"^\s*(```|~~~).*?^\s*\1", "", text, flags=re.M | re.S)
    text = re.sub(r"(?<=\n\n)( {4}.*\n)+", "", text)
    text = re.sub(r"\$\$.*?\$\$|<!--.*?-->|<[^>]+>", "", text, flags=re.S)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(`+)[^`]*\1|\$[^$]*\$", "X", text)
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[-*+]|\d+\.) )", text)
    prose = [b for b in blocks if not b.lstrip().startswith(("|", "==", "#", "!!!", "???"))]
    return [
        s.strip()
        for block in prose
        for s in re.split(r"(?<=[.!?:;])[\"'*_)]*\s+", " ".join(block.split()))
        if s.strip()
    ]


def docstring_sentences(text: str) -> list[str]:
    """Sentences of a docstring, each entry of its numpydoc sections by itself, without examples."""
    before, *sections = SECTION.split(EXAMPLE.sub("", text))
    return sentences("\n\n".join([before, *(ENTRY.sub("\n", s) for s in sections)]))
