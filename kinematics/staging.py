"""Where a result is made before it takes its place, and what killed runs have left there.

A run makes a result beside its place, under a hidden name, and holds a lock on it that ends with the process. So a
later run for the same place knows what no one works on any more, and removes it.
"""

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from kinematics.held import held

SUFFIX = ".staged"
OLD = "old"
"""In a staged directory, what stood in the place and is about to be replaced."""


@contextmanager
def staging(place: Path) -> Iterator[Path]:
    """A hidden directory beside a place, of this process alone; nothing of it remains when the block ends."""
    made, lock = None, None
    try:
        with held():
            made, lock = _made(place)
        yield made
    finally:
        with held():
            if made is not None:
                _end(made, place)
            if lock is not None:
                os.close(lock)


def _made(place: Path) -> tuple[Path, int | None]:
    """A new hidden directory beside a place, and its lock; None where this system has none: no run will clear it."""
    while True:
        try:
            made = Path(mkdtemp(prefix=f".{place.name}-", suffix=SUFFIX, dir=place.parent))
        except OSError as error:  # told of the place that was asked for
            raise OSError(error.errno, error.strerror, str(place)) from None
        try:
            return made, _lock(made)
        except (BlockingIOError, FileNotFoundError):
            continue  # another run took it for a dead one's before it was locked
        except OSError:
            return made, None


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there complete or as it was before; text in UTF-8, its line ends as they are."""
    with staged(path) as file:
        file.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def staged(path: Path) -> Iterator[Path]:
    """A file to write beside another, which takes its place when the block ends well, and is gone when it does not."""
    place = path.absolute()
    clear(place)
    with staging(place) as made:
        yield made / place.name
        (made / place.name).replace(place)


def clear(place: Path) -> None:
    """End what killed runs left for a place: only where a lock tells that they are dead."""
    ours = re.compile(rf"\.{re.escape(place.name)}-\w{{8}}{re.escape(SUFFIX)}")
    for left in [entry for entry in place.parent.glob(".*") if ours.fullmatch(entry.name)]:
        try:
            lock = _lock(left)
        except OSError:
            continue
        _end(left, place)
        os.close(lock)


def _end(made: Path, place: Path) -> None:
    """Remove a staged directory; what stood in the place returns to it if nothing else has come there."""
    if (made / OLD).exists() and not os.path.lexists(place):
        (made / OLD).rename(place)
    shutil.rmtree(made, ignore_errors=True)


def _lock(directory: Path) -> int:
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
