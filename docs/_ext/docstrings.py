"""Docstrings as pages: ours are plain text with mathematical signs, which reST would take for markup.

A paragraph stays one, with names in `quotes` set as code; lines that begin with a dash become a list; names with their
meaning two spaces or more behind them become definitions; whatever is set in by itself, as equations are, stays as it
stands. Sections in numpydoc form become tables: `sphinx.ext.napoleon` makes lists, and reads markup into signs.
"""

import re
from collections.abc import Iterator
from textwrap import dedent
from typing import Any

from sphinx.application import Sphinx

# What reST would read something into; names in single quotes are put back afterwards.
_MARKUP = re.compile(r"([\\*|_])")
_CODE = re.compile(r"`([^`]+)`")
_TERM = re.compile(r"([\w*][\w.*]*(?:,? [\w.*]+)*) {2,}(\S.*)")
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
TABLES = ("Parameters", "Other Parameters", "Attributes", "Returns", "Yields", "Raises")
"""Sections of numpydoc that name things: each is shown as a table. All others, as Notes, are prose."""
_LONGEST = re.compile(r"^(\w[\w, ]*\w) $")
# What signatures spell out, and how the code calls it.
_ALIASES = (
    (
        r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.float64\]\]",
        "Array",
    ),
    (
        r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.(\w+)\]\]",
        r"ndarray[\1]",
    ),
    (
        r"~?numpy\._typing\._array_like\._Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]",
        "ArrayLike",
    ),
    (r"~?scipy\.spatial\.transform\._rigid_transform\.RigidTransform", "~pulsepath.Pose"),
)
_ANNOTATED = re.compile(r"~?(?:typing\.)?Annotated\[")
_DEFAULT = re.compile(r"= <[^<>]*(?:<[^<>]*>[^<>]*)*>")
OPTIONS = {"members": True, "member-order": "bysource"}


def as_rest(text: str) -> str:
    """The reST that shows a docstring as it was written, its numpydoc sections as tables."""
    before, *sections = _SECTION.split(_join_code(dedent(text).strip("\n")))
    shown = [_prose(before)] if before.strip() else []
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        shown.append(
            f".. rubric:: {title}\n\n{_table(dedent(body)) if title in TABLES else _prose(dedent(body))}"
        )
    return "\n\n".join(shown)


def _join_code(text: str) -> str:
    """With names in quotes that a line end divides on one line."""
    return "\n\n".join(
        part
        if part.count("`") % 2
        else _CODE.sub(lambda found: f"`{' '.join(found[1].split())}`", part)
        for part in re.split(r"\n[ ]*\n", text)
    )


def _prose(text: str) -> str:
    return "\n\n".join("\n".join(_block(part)) for part in re.split(r"\n\s*\n", text.strip("\n")))


def _table(body: str) -> str:
    """Names, each with what is set in below it, as rows of two cells."""
    rows = [".. list-table::", "   :widths: 25 75", "   :class: arguments", ""]
    for name, meaning in re.findall(
        r"^(\S.*)\n((?:(?: .*)?\n)*)", body.strip("\n") + "\n", re.MULTILINE
    ):
        cell = _prose(dedent(meaning)).splitlines()
        rows += [
            f"   * - ``{name}``",
            f"     - {cell[0]}",
            *(f"       {line}".rstrip() for line in cell[1:]),
        ]
    return "\n".join(rows)


def _block(part: str) -> Iterator[str]:
    lines = part.splitlines()
    columns = {found.start(2) for line in lines if (found := _TERM.fullmatch(line))}
    if len(columns) == 1:  # the longest name has but one space behind it
        (column,) = columns
        lines = [_LONGEST.sub(r"\1  ", line[:column]) + line[column:] for line in lines]
    if all(line.startswith(" ") for line in lines):
        yield from ["::", "", *("   " + line for line in dedent(part).splitlines())]
    elif lines[0].startswith("- "):
        for line in lines:
            yield _escaped(line) if line.startswith("- ") else "  " + _escaped(line.strip())
    elif all(line.startswith(" ") or _TERM.fullmatch(line) for line in lines):
        for line in lines:
            found = None if line.startswith(" ") else _TERM.fullmatch(line)
            if found:
                yield from [_escaped(found[1]), "    " + _escaped(found[2])]
            else:
                yield "    " + _escaped(line.strip())
    elif any(map(_TERM.fullmatch, lines)):  # with a sentence right above or below
        told = [line.startswith(" ") or _TERM.fullmatch(line) is not None for line in lines]
        end = told.index(not told[0])
        yield from [*_block("\n".join(lines[:end])), "", *_block("\n".join(lines[end:]))]
    elif any(line.startswith(" ") for line in lines):
        yield from ["::", "", *("   " + line for line in lines)]
    else:
        yield from (_escaped(line) for line in lines)


def _escaped(line: str) -> str:
    """As markup; code needs an end of a word on either side, which an escaped space is and does not show."""
    shown = ""
    for n, part in enumerate(_CODE.split(line)):
        if n % 2:
            shown += ("\\ " if shown[-1:].isalnum() else "") + f"``{part}``"
        else:
            text = _MARKUP.sub(r"\\\1", part).replace("`", r"\`")
            shown += ("\\ " if n and part[:1].isalnum() else "") + text
    return shown


def _docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [*as_rest("\n".join(lines)).splitlines(), ""]


def _signature(
    app: Sphinx,
    what: str,
    name: str,
    obj: Any,
    options: Any,
    signature: str | None,
    returns: str | None,
) -> tuple[str | None, str | None]:
    return _plain(signature), _plain(returns)


def _plain(signature: str | None) -> str | None:
    """As the code calls things, without units that are checked, and with ... for defaults that are no literals.

    What is no Python would be shown as it is spelled, with every module's name.
    """
    if signature is None:
        return None
    for spelled, name in _ALIASES:
        signature = re.sub(spelled, name, signature)
    return _DEFAULT.sub("= ...", _strip_units(signature))


def _strip_units(signature: str) -> str:
    """The types in Annotated[type, Unit(…)], wherever they stand."""
    while found := _ANNOTATED.search(signature):
        depth, comma, end = 1, None, found.end()
        while depth:
            sign = signature[end]
            depth += (sign in "[(") - (sign in ")]")
            if sign == "," and depth == 1 and comma is None:
                comma = end
            end += 1
        kind = signature[found.end() : comma if comma is not None else end - 1]
        signature = signature[: found.start()] + kind + signature[end:]
    return signature


def setup(app: Sphinx) -> dict[str, Any]:
    """For conf.py: extensions = ["docstrings"], which brings autodoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.config.autodoc_default_options = OPTIONS
    app.config.autodoc_typehints_format = "short"
    app.config.python_maximum_signature_line_length = 100
    app.connect("autodoc-process-docstring", _docstring)
    app.connect("autodoc-process-signature", _signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
