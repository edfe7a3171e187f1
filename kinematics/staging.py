"""Where a result is made before it takes its place, and what killed runs have left there.

A run makes a result beside its place, under a hidden name, and holds a lock on it that ends with the process. So a
later run that writes into the same folder knows what no one works on any more, and removes it.
"""

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp

from kinematics.held import held

SUFFIX = ".staged"
NEW, OLD = "new", "old"
"""In a staged directory: what is made, and what stood in the place and is about to be replaced."""
MARK = ".pulsepath"
"""In a staged directory, a file that says whose it is: nothing without it is ever removed, unless it is empty."""
_NAME = re.compile(rf"\.(.+)-\w{{8}}{re.escape(SUFFIX)}")


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
            lock = _lock(made)
        except (BlockingIOError, FileNotFoundError):
            continue  # another run took it for a dead one's before it was locked
        except OSError:
            lock = None
        (made / MARK).touch()
        return made, lock


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there complete or as it was before; text in UTF-8, its line ends as they are."""
    with staged(path) as file:
        file.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def staged(path: Path) -> Iterator[Path]:
    """A file to write beside another, which takes its place when the block ends well, and is gone when it does not.

    For what is this program's own, since it replaces whatever is there: `kinematics.destination` has the results.
    """
    place = path.absolute()
    clear(place.parent)
    with staging(place) as made:
        yield new_file(made, place)
        new_file(made, place).replace(place)


def new_file(made: Path, place: Path) -> Path:
    """Where in a staged directory the file for a place is written."""
    (made / NEW).mkdir(exist_ok=True)
    return made / NEW / place.name


def clear(folder: Path) -> None:
    """End what killed runs left in a folder: only what is marked as ours, and where a lock tells that they are dead."""
    try:
        names = [entry.name for entry in folder.iterdir()]
    except OSError:
        return
    for found in filter(None, map(_NAME.fullmatch, names)):
        left = folder / found[0]
        try:
            lock = _lock(left)
        except OSError:
            continue
        if (left / MARK).exists():
            _end(left, folder / found[1])
        else:
            with suppress(OSError):
                left.rmdir()
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
