"""The text of docstrings, for lists that commands print."""

from inspect import getdoc


def first_paragraph(described: object) -> str:
    """Return the first paragraph of an object's docstring, on one line; "" without a docstring."""
    paragraph = (getdoc(described) or "").partition("\n\n")[0]
    return " ".join(paragraph.split())
