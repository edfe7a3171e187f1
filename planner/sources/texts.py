"""The text of a file from elsewhere: bounded, and with whatever bytes it has."""

from pathlib import Path

from kinematics.errors import Fault, FileError

MAX_BYTES = 64 * 2**20
"""Size of the largest file that is read."""


def bytes_of(path: Path) -> bytes:
    """All of a file. Raises FileError for one that is missing, unreadable or too large."""
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        raise FileError(str(path), [Fault("", getattr(error, "strerror", None) or str(error))]) from None
    if len(raw) > MAX_BYTES:
        raise FileError(str(path), [Fault("", f"larger than {MAX_BYTES >> 20} MB")])
    return raw


def text_of(path: Path) -> str:
    """The text, line ends as \\n; bytes that are not UTF-8 stand in it as lone surrogates, for its reader to refuse.

    Raises FileError for a file that is missing, unreadable or too large.
    """
    text = bytes_of(path).decode("utf-8", "surrogateescape").removeprefix("\ufeff")
    return text.replace("\r\n", "\n").replace("\r", "\n")
