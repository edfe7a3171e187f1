"""The text of a file from elsewhere: bounded, and with whatever bytes it has."""

from pathlib import Path

from kinematics import text_file

MAX_BYTES = 64 * 2**20
"""Size of the largest file that is read."""


def bytes_of(path: Path) -> bytes:
    """All of a file. Raises FileError for one that is missing, unreadable or too large."""
    return text_file.bytes_of(path, MAX_BYTES)


def text_of(path: Path) -> str:
    """The text, line ends as \\n; bytes that are not UTF-8 stand in it as lone surrogates, for its reader to refuse.

    Raises FileError for a file that is missing, unreadable, too large or UTF-16.
    """
    raw = bytes_of(path)
    text_file.refuse_utf16(str(path), raw)
    text = raw.decode("utf-8", "surrogateescape").removeprefix("\ufeff")
    return text.replace("\r\n", "\n").replace("\r", "\n")
