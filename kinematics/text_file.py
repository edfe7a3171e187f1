"""The bytes of a file that is meant to be text: bounded, and told what they are where they are none."""

from importlib.resources.abc import Traversable
from pathlib import Path

from kinematics.errors import Fault, FileError
from kinematics.registry import closest

_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""How UTF-16 begins, as a rule."""
_SHARE = 3
"""One NUL in so many bytes is no text with single bytes for its letters."""


def bytes_of(source: Path | Traversable, most: int) -> bytes:
    """All of a file of at most so many bytes. Raises FileError for one that is missing, unreadable or larger."""
    file = str(source)
    try:
        with source.open("rb") as stream:
            raw = stream.read(most + 1)
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        told = getattr(error, "strerror", None) or str(error)
        near = _beside(source) if isinstance(error, FileNotFoundError) and isinstance(source, Path) else ""
        raise FileError(file, [Fault("", f"{told}{near}")]) from None
    if len(raw) > most:
        raise FileError(file, [Fault("", f"larger than {most >> 20} MB")])
    return raw


def refuse_utf16(file: str, raw: bytes) -> None:
    """Raise FileError for text that has two bytes for every letter."""
    if raw[:2] in _MARKS or (len(raw) > 2 * _SHARE and raw.count(b"\0") * _SHARE >= len(raw)):
        raise FileError(file, [Fault("", "UTF-16 text: save it as UTF-8", 1)])


def not_utf8(raw: bytes, error: UnicodeDecodeError) -> Fault:
    """What is wrong with bytes that are some other text."""
    wrong = f"byte 0x{raw[error.start]:02x}"
    return Fault("", f"not UTF-8 text ({wrong}): save it as UTF-8", raw.count(b"\n", 0, error.start) + 1)


def _beside(path: Path) -> str:
    """The clause that names the nearest name in the folder of a file that is not there."""
    if not path.parent.is_dir():
        return f": there is no folder {path.parent}"
    there = {entry.stem: entry.name for entry in path.parent.iterdir() if entry.suffix == path.suffix}
    near = closest(path.stem, there)
    return f', nearest is "{there[near]}"' if near else ""
