"""The paper: origins of its tables and figures, LaTeX fragments, a check of its text, the PDF."""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path

import yaml

from ges.errors import GesError
from ges.files import replacing, sha256, write_json, write_text
from ges.provenance.runs import Code
from ges.study.config import Study

# Of a Typst source: comments, code and maths, which may hold digits because they print none of a
# result.
_NOT_PROSE = re.compile(
    r"//[^\n]*|/\*.*?\*/"  # comments
    r"|```.*?```|`[^`\n]*`"  # raw text
    r"|\$[^$]*\$"  # maths
    # statements with indented rest
    r"|#(?:import|include|let|set|show)\b[^\n]*(?:\n[ \t]+[^\n]*|\n[)\]}][^\n]*)*"
    r"|<[\w:-]+>|@[\w:-]+",  # labels and references
    re.DOTALL,
)
_CALL = re.compile(r"#[a-z][\w.-]*\([^()\[\]]*\)")
_NUMBER = re.compile(r"(?<![\w-])[-+\u2212]?\d[\d.,]*")


def _blanked(pattern: re.Pattern[str], text: str) -> str:
    # blanks in place of words, line breaks kept: numbers of lines stay those of the source
    return pattern.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def naked_numbers(text: str) -> list[tuple[int, str]]:
    """Find numbers that are typed into the prose of a Typst source, not read from results.

    Numbers in comments, maths, labels, raw text, statements and arguments of calls are no prose.

    Parameters
    ----------
    text : the source.

    Returns
    -------
    (line, number as typed) of each; lines are counted from 1.
    """
    # calls last: brackets within maths or text, blanked by now, would end their arguments
    prose = _blanked(_CALL, _blanked(_NOT_PROSE, text))
    return [
        (n, match[0])
        for n, line in enumerate(prose.splitlines(), start=1)
        for match in _NUMBER.finditer(line)
    ]


def check_source(sources: list[Path], checked: Path) -> None:
    """Refuse Typst sources with typed numbers.

    Parameters
    ----------
    sources : the files.
    checked : JSON file to write, with the SHA-256 of each source by its name.

    Raises
    ------
    GesError
        Where a number is typed; it names files, lines and numbers.
    """
    wrong = [
        f"{s.name} line {n}: '{number}'"
        for s in sources
        for n, number in naked_numbers(s.read_text(encoding="utf-8"))
    ]
    if wrong:
        raise GesError(
            f'numbers typed into the paper: {"; ".join(wrong)}; read them with #num("name") from'
            " numbers.json"
        )
    write_json(checked, {source.name: sha256(source) for source in sources})


def write_facts(made: list[Path], makers: dict[str, str], code: Code, facts: Path) -> None:
    """Write the origin of every table and figure.

    Parameters
    ----------
    made : data files of tables and figures; a figure's lies beside its picture.
    makers : rule that made each file, by its path.
    code : commit of the code, and whether it was modified.
    facts : JSON file to write: rule, first 12 digits of the SHA-256, and commit, by file stem.
    """
    state = code.commit + (" with changes" if code.modified else "")
    write_json(
        facts,
        {f.stem: {"rule": makers[str(f)], "data": sha256(f)[:12], "commit": state} for f in made},
    )


def write_settings(study: Study, settings: Path) -> None:
    """Write the configuration as JSON, from which the text quotes settings.

    Parameters
    ----------
    study : the configuration.
    settings : JSON file to write.
    """
    write_json(settings, study.model_dump(mode="json"))


# what LaTeX reads as its own
_ESCAPED = str.maketrans({"\\": r"\textbackslash{}", **{c: f"\\{c}" for c in "&%$#_{}"}})


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "--" if math.isnan(value) else f"{value:.4g}"
    return str(value).translate(_ESCAPED)


def write_latex(table: Path, facts: Path, fragment: Path) -> None:
    """Write a table as a LaTeX tabular of the package booktabs.

    Parameters
    ----------
    table : CSV file.
    facts : origins, as :func:`write_facts` writes them.
    fragment : file to write; its last line is a comment with the origin.
    """
    import pandas as pd

    frame = pd.read_csv(table)
    origin = json.loads(facts.read_text())[table.stem]
    head = " & ".join(_cell(c.replace("_", " ")) for c in frame.columns)
    rows = [" & ".join(map(_cell, row)) + r" \\" for row in frame.itertuples(index=False)]
    foot = f"% rule {origin['rule']}, data {origin['data']}, commit {origin['commit']}"
    columns = "".join("r" if kind.kind in "fi" else "l" for kind in frame.dtypes)
    body = [
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        head + r" \\",
        r"\midrule",
        *rows,
        r"\bottomrule",
        r"\end{tabular}",
    ]
    write_text(fragment, "\n".join([*body, foot]) + "\n")


def authors(citation: Path) -> str:
    """Read the authors of a citation file.

    Parameters
    ----------
    citation : file in the Citation File Format (CFF, YAML).

    Returns
    -------
    Names in the order of the file, separated by commas.
    """
    listed = yaml.safe_load(citation.read_text())["authors"]
    return ", ".join(a.get("name") or f"{a['given-names']} {a['family-names']}" for a in listed)


def render(main: Path, results: Path, citation: Path, pdf: Path) -> None:
    """Compile the paper to a PDF.

    Equal results give equal bytes: fonts are those of the compiler, and no date is written.

    Parameters
    ----------
    main : Typst source.
    results : folder from which the source reads tables, figures and numbers.
    citation : file with the authors, see :func:`authors`.
    pdf : file to write.

    Raises
    ------
    GesError
        Where the source does not compile; it names the place.
    """
    import typst

    # Typst reads nothing outside of its root
    root = os.path.commonpath([main.resolve(), results.resolve()])
    inside = "/" + str(results.resolve().relative_to(root))
    try:
        content = typst.compile(
            str(main.resolve()),
            root=root,
            ignore_system_fonts=True,
            sys_inputs={"results": inside, "authors": authors(citation)},
        )
    except typst.TypstError as error:
        where = re.search(r"┌─ (\S+)", error.diagnostic)
        raise GesError(
            f"the paper cannot be rendered: {where[1] + ': ' if where else ''}{error}"
        ) from None
    with replacing(pdf) as new:
        new.write_bytes(content)
