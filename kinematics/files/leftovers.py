"""Remove the files that killed runs leave next to the places of their results."""

import os
import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from zlib import crc32

SUFFIX = ".staged"
NEW, OLD = "new", "old"
"""In a staged directory: what is made, and what stood in the place and is about to be replaced."""
MARK = ".pulsepath"
"""In a staged directory, a file that says whose it is: nothing without it is ever removed, unless
it is empty.
"""
MAX_NAME = 255
"""Bytes of a file's name that file systems take."""
_NAME = re.compile(rf"\.(.+)-\w{{8}}{re.escape(SUFFIX)}")


def shorten_name(name: str, added: int) -> str:
    """Return a name with room for further bytes: the same if it is short, else its beginning and
    its checksum.
    """
    encoded = os.fsencode(name)
    if len(encoded) + added <= MAX_NAME:
        return name
    mark = f"~{crc32(encoded):08x}"
    head = encoded[: MAX_NAME - added - len(mark)]
    return head.decode(errors="ignore") + mark


def clear(folder: Path) -> None:
    """Remove the remains of killed runs in a folder: only marked ones, and where a lock shows that
    they are dead.
    """
    try:
        names = [entry.name for entry in folder.iterdir()]
    except OSError:
        return
    for found in filter(None, map(_NAME.fullmatch, names)):
        left = folder / found[0]
        try:
            held = lock(left)
        except OSError:
            continue
        if (left / MARK).exists():
            end(left, folder / (_read_place(left) or found[1]))
        else:
            with suppress(OSError):
                left.rmdir()
        os.close(held)


def write_mark(made: Path, place: Path) -> None:
    """Mark a staged directory as ours.

    The mark has the name of its place if the directory's own name shortens it.
    """
    mark = made / MARK
    mark.touch()
    if not made.name.startswith(f".{place.name}-"):
        with suppress(
            OSError
        ):  # on a full disk what stood in the place would return under the short name
            mark.write_bytes(os.fsencode(place.name))


def _read_place(made: Path) -> str:
    """Return the name in a mark; "" where it has none, or none of a file in the same folder."""
    try:
        name = os.fsdecode((made / MARK).read_bytes())
    except OSError:
        return ""
    return name if name == Path(name).name else ""


def end(made: Path, place: Path) -> None:
    """Remove a staged directory; what stood in the place returns to it if nothing else has come
    there.
    """
    if (made / OLD).exists() and not os.path.lexists(place):
        (made / OLD).rename(place)
    for part in (
        NEW,
        OLD,
    ):  # before the mark: who is killed here leaves what the next run still knows for ours
        shutil.rmtree(made / part, ignore_errors=True)
    shutil.rmtree(made, ignore_errors=True)


def lock(directory: Path) -> int:
    """A descriptor that locks a directory until it is closed, or the process ends.

    Raises BlockingIOError where another process holds it, another OSError where there are no locks.
    """
    if sys.platform == "win32":
        raise OSError("directories cannot be locked")
    import fcntl

    descriptor = os.open(directory, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        directory.stat()  # it may have been removed before it was locked
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
