"""Write a directory completely or not at all, and never over files of another program."""

import errno
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from kinematics.files.atomic_files import (
    DISK_ERRNOS,
    OCCUPIED_ERRNOS,
    Destination,
    Stamp,
    conflict_error,
    defer_signals,
    move_aside,
    stage_directory,
    stage_files,
    stamp,
    write_named,
)
from kinematics.files.leftovers import NEW, OLD, clear
from kinematics.foundation.errors import BadValue, MotionError
from pulsepath.options import read_percent, read_quantity
from pulsepath.process.exits import find_file

# Record of each kind of result, and the kind that it states.
RECORD, KIND = "plan.json", "pulsepath plan"
CALIBRATION, CALIBRATION_KIND = "calibration.json", "pulsepath calibrate"
COMPARISON, COMPARISON_KIND = "compare.json", "pulsepath compare"
RECORDS = {KIND: RECORD, CALIBRATION_KIND: CALIBRATION, COMPARISON_KIND: COMPARISON}
# Folder of runs, as in benchmarks.sweep.result, which takes long to load.
CELLS = "cells"
# Page of a result.
REPORT = "report.html"

# All files in a directory, by path, each with its stamp.
Content = frozenset[tuple[str, Stamp]]

PLAIN_NUMBER = re.compile(r"\s*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*", re.ASCII)


def list_replaceable(target: Path, force: bool, kind: str = KIND) -> Content:
    """Return the content of a target that a result may replace. The work begins after this.

    Raises MotionError unless the target is absent, or an empty directory, or with `force` a
    directory of the same kind.
    """
    clear(target.resolve().parent)
    content = list_content(target)
    _refuse_file_above(target)
    if not os.path.lexists(target):
        return content
    if not target.is_dir():
        raise MotionError(f"{target} exists and is not a directory; give another --out")
    if any(target.iterdir()):
        if not force:
            raise MotionError(
                f"{target} exists and is not empty; give another --out, or --force to replace it"
            )
        if not is_ours(target, kind):
            raise MotionError(
                f"{target} was not written by {kind}, so --force does not replace it; give another"
            )
    return content


def _refuse_file_above(target: Path) -> None:
    """Raise MotionError if one of the folders in a path is a file."""
    above = next((parent for parent in target.parents if os.path.lexists(parent)), None)
    if above is not None and not above.is_dir():
        raise MotionError(f"{target}: {above} is a file, not a directory; give another")


def list_content(target: Path) -> Content:
    """Return all files below a directory with their stamps; none if it is empty or missing."""
    place = target.resolve()
    return frozenset((str(path.relative_to(place)), stamp(path)) for path in place.rglob("*"))


def is_ours(directory: Path, kind: str = KIND) -> bool:
    """Return whether the command of a kind, by default `plan`, wrote a directory."""
    return _read_record(directory, RECORDS[kind]).get("kind") == kind


def _read_record(directory: Path, name: str) -> Mapping[str, object]:
    """Return the record in a directory, or an empty one if it cannot be read."""
    try:
        record = json.loads((directory / name).read_bytes())
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def refuse_no_plan(folder: Path) -> None:
    """Raise MotionError if `plan` did not write a directory."""
    if not is_ours(folder):
        raise MotionError(
            f"{folder} holds no plan: make one with pulsepath plan PROGRAM --out {folder}"
        )


def read_instant(folder: Path, text: str) -> float:
    """Return the time (s) of --at: within the motion of a plan, or a share of its duration, as "40
    %".

    Raises BadValue for another text, and MotionError for a time after the duration that the record
    states. A record without a duration is refused later, when the plan is read.
    """
    if PLAIN_NUMBER.fullmatch(text):
        plain = text.strip()
        raise BadValue(
            f'option --at: "{plain}": a number without a unit: write "{plain} s", or "{plain} %" of the motion'
        )
    stated = _read_record(folder, RECORD).get("duration_s")
    duration = stated if isinstance(stated, float) else None
    if text.rstrip().endswith("%"):
        share = read_percent("--at", text, from_zero=True)
        if duration is None:
            raise MotionError(
                f'{folder / RECORD} states no duration: give --at as a time, as "1.2 s"'
            )
        t = share * duration
    else:
        t = read_quantity("--at", text, "s", least=0.0)
    if duration is not None and t > duration:
        raise MotionError(
            f"t = {t:.6g} s is not within the motion, which lasts from 0 to {duration:.6g} s; give an instant of it"
        )
    return t


@contextmanager
def _create_folders(folder: Path) -> Iterator[None]:
    """Create a folder and those above it. An error or an interruption removes the new ones."""
    new = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        raise


def write_files(folder: Path, files: Mapping[str, bytes], force: bool) -> None:
    """Write all files into a new or an existing directory, or none.

    Raises MotionError for an existing file, unless `force` replaces it.
    """
    _refuse_file_above(folder / "any")
    remedy = "give --force to replace it, or another directory"
    destinations = [Destination(folder / name, force=force, remedy=remedy) for name in files]
    with _create_folders(folder.absolute()), stage_files(destinations) as staged:
        for file, content in zip(staged, files.values(), strict=True):
            write_named(file, content)


@contextmanager
def replace_directory(
    target: Path,
    force: bool,
    kind: str = KIND,
    before: Content | None = None,
) -> Iterator[Path]:
    """Create a directory to fill, which becomes `target` at the end of the block.

    After an error or an interruption the previous content is unchanged. After a kill the target is
    complete or absent, and the next run there removes the rest (`kinematics.files.atomic_files`).
    If another program changes the target during the block, its files stay: MotionError is raised,
    and the new directory is kept under a name that the error states.

    before: content that may be replaced, from `list_replaceable`; None: the present one
    """
    if before is None:
        before = list_replaceable(target, force, kind)
    place = target.resolve()
    with _create_folders(place.parent), stage_directory(place) as staged:
        new = staged / NEW
        new.mkdir()
        with _name_files_in(target, new):
            yield new
        with defer_signals():
            _put_in_place(new, staged / OLD, target, place, before)


@contextmanager
def _name_files_in(target: Path, folder: Path) -> Iterator[None]:
    """Let disk errors name files by their place in the target, instead of in the folder.

    A file that cannot be closed on a full disk is named by the preceding error.
    """
    try:
        yield
    except OSError as error:
        file = Path(find_file(error) or "")
        if error.errno not in DISK_ERRNOS or not file.is_relative_to(folder):
            raise
        named = target / file.relative_to(folder)
        raise OSError(error.errno, error.strerror, str(named)) from error


def _put_in_place(new: Path, old: Path, target: Path, place: Path, before: Content) -> None:
    """Move a new directory to its place, if the content there did not change.

    Otherwise raise MotionError, and keep the new directory under a name that the error states.

    old: place for the replaced directory. target: the place as the user names it.
    """
    replaces = bool(before) and os.path.lexists(place)
    if replaces:
        if list_content(place) != before:
            raise conflict_error(target, True, [move_aside(new, place)])
        place.rename(old)  # for a moment; an error brings it back
    try:
        new.rename(place)  # replaces only an empty directory
    except OSError as error:
        if error.errno not in (*OCCUPIED_ERRNOS, errno.EACCES) or not os.path.lexists(place):
            raise
        results = [move_aside(each, place) for each in (new, old) if each.exists()]
        raise conflict_error(target, bool(before), results) from None
    if replaces and list_content(old) != before:  # it changed between the two looks
        place.rename(new)
        old.rename(place)
        raise conflict_error(target, True, [move_aside(new, place)])
