"""Text from files and from users as it is shown: nothing in it that a terminal or a browser would
obey.
"""

import re
from math import isfinite

_OBEYED = (
    "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff"
)
"""C0 but tab and line feed, DEL, C1, marks and overrides of direction, separators of lines, halves
of characters.
"""
_IN_TEXT, _IN_LINE = re.compile(f"[{_OBEYED}]"), re.compile(f"[{_OBEYED}\t\n]")


def plain(text: str) -> str:
    r"""A text of one or more lines, with what would be obeyed as \x1b or \u202e."""
    return _IN_TEXT.sub(_escape, text)


def plain_line(text: str) -> str:
    r"""The same of one line: a tab and a line feed are \t and \n too."""
    return _IN_LINE.sub(_escape, text)


def finite_or_none(value: float) -> float | None:
    """A number as JSON can have it, which knows no infinity and no NaN."""
    return value if isfinite(value) else None


def plain_json(text: str) -> str:
    r"""JSON text with the same characters as \u001b, which reads back as they were."""
    return _IN_TEXT.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def describe_control_character(text: str) -> str | None:
    """What to say of a text with a character that would be obeyed, of the first; None where there
    is none.
    """
    found = _IN_TEXT.search(text)
    if found is None:
        return None
    return f"holds {_escape(found)}, which is no letter but controls how text is shown; take it out"


def _escape(found: re.Match[str]) -> str:
    short = {"\t": "\\t", "\n": "\\n", "\r": "\\r"}
    code = ord(found[0])
    return short.get(found[0]) or (f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}")
