"""What killed runs leave beside the places of their results, and how it is removed.

The command line's first process loads this file alone, when it has ended the one that works: the package would take a
second to load. So it imports nothing but the standard library.
"""

import os
import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path

SUFFIX = ".staged"
NEW, OLD = "new", "old"
"""In a staged directory: what is made, and what stood in the place and is about to be replaced."""
MARK = ".pulsepath"
"""In a staged directory, a file that says whose it is: nothing without it is ever removed, unless it is empty."""
_NAME = re.compile(rf"\.(.+)-\w{{8}}{re.escape(SUFFIX)}")


def clear(folder: Path) -> None:
    """End what killed runs left in a folder: only what is marked as ours, and where a lock tells that they are dead."""
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
            end(left, folder / found[1])
        else:
            with suppress(OSError):
                left.rmdir()
        os.close(held)


def end(made: Path, place: Path) -> None:
    """Remove a staged directory; what stood in the place returns to it if nothing else has come there."""
    if (made / OLD).exists() and not os.path.lexists(place):
        (made / OLD).rename(place)
    for part in (NEW, OLD):  # before the mark: who is killed here leaves what the next run still knows for ours
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
