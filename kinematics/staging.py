"""Where a result is made before it takes its place, and what killed runs have left there.

A run makes a result beside its place, under a hidden name, and holds a lock on it that ends with the process. So a
later run that writes into the same folder knows what no one works on any more, and removes it.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from kinematics.held import held
from kinematics.leftovers import MARK, NEW, SUFFIX, clear, end, lock


@contextmanager
def staging(place: Path) -> Iterator[Path]:
    """A hidden directory beside a place, of this process alone; nothing of it remains when the block ends."""
    made, descriptor = None, None
    try:
        with held():
            made, descriptor = _made(place)
        yield made
    finally:
        with held():
            if made is not None:
                end(made, place)
            if descriptor is not None:
                os.close(descriptor)


def _made(place: Path) -> tuple[Path, int | None]:
    """A new hidden directory beside a place, and its lock; None where this system has none: no run will clear it."""
    while True:
        try:
            made = Path(mkdtemp(prefix=f".{place.name}-", suffix=SUFFIX, dir=place.parent))
        except OSError as error:  # told of the place that was asked for
            raise OSError(error.errno, error.strerror, str(place)) from None
        try:
            descriptor = lock(made)
        except (BlockingIOError, FileNotFoundError):
            continue  # another run took it for a dead one's before it was locked
        except OSError:
            descriptor = None
        (made / MARK).touch()
        return made, descriptor


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
