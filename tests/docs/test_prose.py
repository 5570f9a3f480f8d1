"""Pages for a reader in a hurry: short sentences, links that lead somewhere, a short front page."""

import inspect
import re
from pathlib import Path

import pytest
from prose import docstring_sentences, sentences

ROOT = Path(__file__).parents[2]
# What the program writes, tables of scores and the record of what was found are no guides.
RECORDS = {"config.md", "effects.md", "settings.md", "history.md", "results.md", "real-logs.md"}
GUIDES = [
    ROOT / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if p.name not in RECORDS),
]
LONGEST_SENTENCE_WORDS = 30
LONGEST_README_LINES = 100


@pytest.mark.parametrize("page", GUIDES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_sentence_is_long(page):
    long = [s for s in sentences(page.read_text()) if len(s.split()) > LONGEST_SENTENCE_WORDS]
    assert not long, "\n".join(long)


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_links_to_pages_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text())
    local = [x for x in links if not re.match(r"[a-z]+:", x)]
    assert not [x for x in local if not (page.parent / x).exists()]


def test_the_front_page_is_short_and_has_no_seeds_or_hashes():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= LONGEST_README_LINES
    assert not re.search(r"\bseed \d|\b[0-9a-f]{7}\b", text)


def test_sentences_are_counted_as_a_reader_does():
    text = "# Title\n\nOne two.\nThree [four](x.md) `five six`: seven.\n\n- a b\n- c\n\n| t |\n"
    assert sentences(text) == ["One two.", "Three four X:", "seven.", "- a b", "- c"]


def test_entries_of_a_docstring_are_sentences_of_their_own():
    text = """Do it.

    Parameters
    ----------
    a, b : shares
        of ``x and y``, both. Never zero.

    Raises
    ------
    GesError
        Where it cannot.

    Examples
    --------
    >>> 1 + 1
    2
    """
    assert docstring_sentences(inspect.cleandoc(text)) == [
        "Do it.",
        "a, b :",
        "shares of X, both.",
        "Never zero.",
        "GesError Where it cannot.",
    ]
