"""Files take their places whole, and never that of something that came meanwhile.

A run makes a result beside its place, under a hidden name, and holds a lock on it that ends with
the process. So a later run that writes into the same folder knows what no one works on any more,
and removes it. Signals (Ctrl-C, the system's request to end, a hang-up) are held back while what
they would break off must not be.
"""

import errno
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from tempfile import mkdtemp
from threading import RLock, current_thread, main_thread
from types import FrameType
from typing import Any

from kinematics.files.leftovers import NEW, OLD, SUFFIX, clear, end, lock, shorten_name, write_mark
from kinematics.foundation.errors import MotionError

RANDOM_CHARACTERS = 8
"""Characters that mkdtemp adds to a name."""
SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a program in good order, of which a system may not know all."""
# Held by a thread in `defer_signals`.
_DEFERRING = RLock()
# s that `remove_staged` waits for such a thread.
MAX_WAIT = 0.3
# Hidden directories of this process, and the places of their results.
_STAGED: dict[Path, Path] = {}


class HeldSignals:
    """came: the number of the last signal that came meanwhile; None: none did."""

    __slots__ = ("came",)

    def __init__(self) -> None:
        self.came: int | None = None

    def note(self, number: int, _: FrameType | None) -> None:
        self.came = number


@contextmanager
def defer_signals() -> Iterator[HeldSignals]:
    """Delay signals that have a handler in Python to the end of the block.

    Signals that are ignored, or left to the system, are not delayed. Python handles signals in the
    main thread only. `remove_staged` in another thread waits for the end of the block.
    """
    kept: dict[int, Any] = {}
    waiting = HeldSignals()
    _DEFERRING.acquire()
    try:
        if current_thread() is main_thread():
            for number in (getattr(signal, name) for name in SIGNAL_NAMES if hasattr(signal, name)):
                if callable(before := signal.getsignal(number)):
                    kept[number] = before
                    signal.signal(number, waiting.note)
        yield waiting
    finally:
        _DEFERRING.release()
        for number, before in kept.items():
            signal.signal(number, before)
        if waiting.came is not None:
            signal.raise_signal(waiting.came)


@contextmanager
def stage_directory(place: Path) -> Iterator[Path]:
    """A hidden directory beside a place, of this process alone; nothing of it remains when the
    block ends.
    """
    made, descriptor = None, None
    try:
        with defer_signals():
            made, descriptor = _make_directory(place)
            _STAGED[made] = place
        yield made
    finally:
        with defer_signals():
            if made is not None:
                end(made, place)
                _STAGED.pop(made, None)
            if descriptor is not None:
                os.close(descriptor)


def remove_staged() -> None:
    """Remove the hidden directories of this process, which a thread does before it ends a process
    that hangs.
    """
    _DEFERRING.acquire(timeout=MAX_WAIT)
    for made, place in [*_STAGED.items()]:
        end(made, place)


def _make_directory(place: Path) -> tuple[Path, int | None]:
    """A new hidden directory beside a place, and its lock; None where this system has none: no run
    will clear it.
    """
    while True:
        try:
            name = shorten_name(place.name, RANDOM_CHARACTERS + len(f".-{SUFFIX}"))
            made = Path(mkdtemp(prefix=f".{name}-", suffix=SUFFIX, dir=place.parent))
        except OSError as error:  # told of the place that was asked for
            raise OSError(error.errno, error.strerror, str(place)) from None
        try:
            descriptor = lock(made)
        except (BlockingIOError, FileNotFoundError):
            continue  # another run took it for a dead one's before it was locked
        except OSError:
            descriptor = None
        write_mark(made, place)
        return made, descriptor


DISK_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""Numbers of the errors of a disk that takes no more."""


@contextmanager
def name_file(path: Path, *staged: Path) -> Iterator[None]:
    """Within, an error of the disk that names no file, or a staged one, names this one.

    The system says nothing about the file when a write fails, and a library that then cannot finish
    its file may raise an error of its own over that of the system.
    """
    try:
        yield
    except MotionError:
        raise
    except Exception as error:  # a library's own, raised over that of the disk
        failure = _find_disk_error(error)
        if failure is None or failure.filename not in (None, *map(str, staged)):
            raise
        raise OSError(failure.errno, failure.strerror, str(path)) from error


def _find_disk_error(error: BaseException | None) -> OSError | None:
    """Return the first error of the disk among an error and what led to it."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in DISK_ERRNOS:
            return error
        error = error.__cause__ or error.__context__
    return None


def write_named(path: Path, content: str | bytes) -> None:
    """Write a file; text in UTF-8. An error of the disk names the file."""
    with name_file(path):
        path.write_bytes(content.encode() if isinstance(content, str) else content)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there complete or as it was before; text in UTF-8, its line ends
    as they are.
    """
    with stage_file(path) as file:
        write_named(file, content)


@contextmanager
def stage_file(path: Path) -> Iterator[Path]:
    """A file to write beside another, which takes its place when the block ends well, and is gone
    when it does not.

    For what is this program's own, since it replaces whatever is there:
    `kinematics.files.atomic_files` has the results.
    """
    place = path.absolute()
    clear(place.parent)
    with stage_directory(place) as made:
        file = staged_path(made, place)
        with name_file(path, file):
            yield file
        file.replace(place)


def staged_path(made: Path, place: Path) -> Path:
    """Where in a staged directory the file for a place is written."""
    (made / NEW).mkdir(exist_ok=True)
    return made / NEW / place.name


def require_folder(what: str, place: Path) -> None:
    """Raise MotionError for a file to write whose folder is not there, or of a name that no file
    can have.
    """
    if "\0" in str(place):
        raise MotionError(f"{what}: the path has a NUL in it; give another")
    if not place.parent.is_dir():
        raise MotionError(f"{what}: there is no folder {place.parent}; make it first")
    if place.is_dir():
        raise MotionError(f"{what}: it is a folder; give the name of a file")


Stamp = tuple[int, int, int, int] | None
"""Tells a file from another, and from itself after a change; None: there is none."""
OCCUPIED_ERRNOS = (errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR, errno.EISDIR)
"""What a rename fails with where something has come."""


class Destination:
    """A file to write, and what stood in its place when this was made, which is before the work
    begins.

    Raises MotionError where something stands there, unless `force` lets it be replaced; remedy:
    how, for that message.
    """

    __slots__ = ("before", "path", "place")

    def __init__(
        self, path: Path, *, force: bool = False, remedy: str = "give --force to replace it"
    ) -> None:
        self.path, self.place = path, path.absolute()
        self.before = stamp(self.place)
        if self.before is not None and not force:
            raise MotionError(f"{path} exists; {remedy}")
        if self.place.is_dir():
            raise MotionError(f"{path} is a directory; give the name of a file")

    @contextmanager
    def stage(self) -> Iterator[Path]:
        """A file to write beside the place, which it takes when the block ends well.

        Raises as `stage_files`.
        """
        with stage_files([self]) as (file,):
            yield file

    def write(self, content: str | bytes) -> None:
        """Write all of it; text in UTF-8, its line ends as they are. Raises as `stage_files`."""
        with self.stage() as file:
            write_named(file, content)


@contextmanager
def stage_files(destinations: Sequence[Destination]) -> Iterator[list[Path]]:
    """Files to write beside their places, which all of them take when the block ends well, and none
    when it does not.

    Raises MotionError where a place is no longer as it was when its destination was made. Nothing
    is replaced then, and what was made is kept beside, under names that the error tells.
    """
    with ExitStack() as stack:
        for folder in {
            above for destination in destinations for above in destination.place.parents[:2]
        }:
            clear(folder)  # also where a directory of results stands, in which this one is
        made = [
            stack.enter_context(stage_directory(destination.place)) for destination in destinations
        ]
        files = [
            staged_path(each, destination.place)
            for each, destination in zip(made, destinations, strict=True)
        ]
        with ExitStack() as naming:
            for destination, file in zip(destinations, files, strict=True):
                naming.enter_context(name_file(destination.path, file))
            yield files
        with defer_signals():
            _put_all(destinations, made, files)


def _put_all(
    destinations: Sequence[Destination], made: Sequence[Path], files: Sequence[Path]
) -> None:
    done: list[tuple[Destination, Path, Path]] = []
    try:
        for each in zip(destinations, made, files, strict=True):
            _put(*each)
            done.append(each)
    except OSError as error:
        for destination, aside, file in reversed(done):
            _take_back(destination, aside, file)
        if not isinstance(error, FileExistsError):
            raise
        taken = destinations[len(done)]
        kept = [
            move_aside(file, each.place) for each, file in zip(destinations, files, strict=True)
        ]
        raise conflict_error(taken.path, taken.before is not None, kept) from None


def _put(destination: Destination, made: Path, file: Path) -> None:
    """Raises FileExistsError where the place is not as it was."""
    now = stamp(destination.place)
    if now is None:
        put_new(file, destination.place)
    elif now != destination.before:
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(destination.place))
    else:
        with suppress(OSError):  # not every file system has links; it is for `_take_back` alone
            os.link(destination.place, made / OLD, follow_symlinks=False)
        file.replace(destination.place)


def _take_back(destination: Destination, made: Path, file: Path) -> None:
    os.link(destination.place, file)
    if (made / OLD).exists():
        (made / OLD).replace(destination.place)
    elif destination.before is None:
        destination.place.unlink()


def put_new(file: Path, place: Path) -> None:
    """Move a file to a place where nothing is.

    Raises FileExistsError where something is, and leaves both.
    """
    if sys.platform == "win32":
        file.rename(place)  # which replaces nothing there
        return
    try:
        os.link(file, place)
    except FileExistsError:
        raise
    except OSError:  # a file system without links: a place held by an empty file of ours
        os.close(os.open(place, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        file.replace(place)
    else:
        file.unlink()


def move_aside(made: Path, place: Path) -> Path:
    """Move a file or directory that cannot take its place to a free name beside it, which is
    returned.
    """
    for n in count():
        added = f".kept{n or ''}{place.suffix}"
        aside = place.with_name(shorten_name(place.stem, len(os.fsencode(added))) + added)
        if os.path.lexists(aside):
            continue
        try:
            if made.is_dir():
                made.rename(aside)
            else:
                put_new(made, aside)
        except OSError as error:
            if error.errno not in OCCUPIED_ERRNOS:
                raise
            continue
        return aside
    raise AssertionError  # no end of numbers


def conflict_error(path: Path, changed: bool, kept: Sequence[Path]) -> MotionError:
    """The error where something came, or changed, in the place of a result."""
    how = "was changed or replaced" if changed else "was put there by something else"
    where = " and ".join(map(str, kept))
    return MotionError(
        f"{path} {how} while this ran, and is left as it is; the result is kept in {where}"
    )


def stamp(path: Path) -> Stamp:
    """Of a file, directory or link, whatever it points to."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size
