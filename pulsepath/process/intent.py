"""The files that a command is about to write, so that an interrupted command can report on them."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

# Inode, and time of the last change (ns). None: the file does not exist.
Stamp = tuple[int, int] | None


@dataclass(frozen=True)
class Intent:
    """Files that a command is about to write.

    targets: files or directories as the user names them, their places and stamps before the work
    new_folders: folders that the command creates above them, the innermost first
    note: on unfinished work that stays
    """

    targets: tuple[tuple[Path, Path, Stamp], ...] = ()
    new_folders: tuple[Path, ...] = ()
    note: str = ""


_intent = Intent()


def writes(*targets: Path, kept: str = "") -> None:
    """State the files that the command writes. kept: note on unfinished work that stays."""
    global _intent
    places = [Path(os.path.realpath(target)) for target in targets]
    stamps = [_read_stamp(place) for place in places]
    above = [folder for place in places for folder in place.parents]
    missing = [folder for folder in above if not os.path.lexists(folder)]
    _intent = Intent(tuple(zip(targets, places, stamps, strict=True)), tuple(missing), kept)


def describe_interruption() -> str:
    """Return the message of an interrupted command."""
    if not _intent.targets:
        return "interrupted"
    written = [
        str(target) for target, place, before in _intent.targets if _read_stamp(place) != before
    ]
    if written:
        return f"interrupted, after {' and '.join(written)} had been written"
    names = [
        f"{target}, which is unchanged" if before else str(target)
        for target, _, before in _intent.targets
    ]
    note = f"; {_intent.note}" if _intent.note else ""
    return f"interrupted: nothing was written to {' or '.join(names)}{note}"


def remove_new_folders() -> None:
    """Remove the folders that the command created, if they are empty."""
    for folder in _intent.new_folders:
        with suppress(OSError):
            folder.rmdir()


def _read_stamp(place: Path) -> Stamp:
    try:
        status = os.lstat(place)
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns
