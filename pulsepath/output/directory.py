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

RECORD, KIND = "plan.json", "pulsepath plan"
"""The file by which a directory that `plan` wrote is known, and what it says it is."""
CALIBRATION, CALIBRATION_KIND = "calibration.json", "pulsepath calibrate"
"""The same of `calibrate`."""
COMPARISON, COMPARISON_KIND = "compare.json", "pulsepath compare"
"""The same of `compare`."""
RECORDS = {KIND: RECORD, CALIBRATION_KIND: CALIBRATION, COMPARISON_KIND: COMPARISON}
CELLS = "cells"
"""As in benchmarks.sweep.result, which takes long to load."""
MOTION = "motion.bin"
"""The motion of a plan."""
REPORT = "report.html"
"""Of each of them the page for its reader."""
TRIGGERS = "triggers.csv"
"""Only where the program of a plan has triggers."""


Content = frozenset[tuple[str, Stamp]]
"""All that is in a directory, by path, with the stamp of each."""

PLAIN_NUMBER = re.compile(r"\s*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*", re.ASCII)


def refuse_overwrite(target: Path, force: bool, kind: str = KIND) -> None:
    """Raise MotionError unless the target can be made: absent, or an empty directory; with `force`, one of its kind."""
    _refuse_file_above(target)
    if not os.path.lexists(target):
        return
    if not target.is_dir():
        raise MotionError(f"{target} exists and is not a directory; give another --out")
    if not any(target.iterdir()):
        return
    if not force:
        raise MotionError(f"{target} exists and is not empty; give another --out, or --force to replace it")
    if not is_ours(target, kind):
        raise MotionError(f"{target} was not written by {kind}, so --force does not replace it; give another")


def list_replaceable(target: Path, force: bool, kind: str = KIND) -> Content:
    """Return the content of a target that a result may replace, before the work on that result begins.

    Raises as `refuse_overwrite`.
    """
    clear(target.resolve().parent)
    content = list_content(target)
    refuse_overwrite(target, force, kind)
    return content


def _refuse_file_above(target: Path) -> None:
    """Raise MotionError where one of the folders that a path leads through is a file."""
    above = next((parent for parent in target.parents if os.path.lexists(parent)), None)
    if above is not None and not above.is_dir():
        raise MotionError(f"{target}: {above} is a file, not a directory; give another")


def is_ours(directory: Path, kind: str = KIND) -> bool:
    """Whether the command of a kind, by default `plan`, wrote a directory."""
    try:
        record = json.loads((directory / RECORDS[kind]).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and record.get("kind") == kind


def refuse_no_plan(folder: Path) -> None:
    """Raise MotionError for a directory that `plan` did not write."""
    if not is_ours(folder):
        raise MotionError(f"{folder} holds no plan: make one with pulsepath plan PROGRAM --out {folder}")


def read_instant(folder: Path, text: str) -> float:
    """t (s) of --at: a time within the motion of the plan in a folder, or a share of its duration, as "40 %".

    Raises BadValue, and MotionError for a time at which the motion has ended, by what the plan's record states. What
    the record does not state is told when the plan is read.
    """
    duration = None
    with suppress(OSError, ValueError, AttributeError):
        duration = json.loads((folder / RECORD).read_bytes()).get("duration_s")
    if PLAIN_NUMBER.fullmatch(text):
        plain = text.strip()
        raise BadValue(
            f'option --at: "{plain}": a number without a unit: write "{plain} s", or "{plain} %" of the motion'
        )
    if text.rstrip().endswith("%"):
        share = read_percent("--at", text, from_zero=True)
        if not isinstance(duration, float):
            raise MotionError(f'{folder / RECORD} states no duration: give --at as a time, as "1.2 s"')
        t = share * duration
    else:
        t = read_quantity("--at", text, "s", least=0.0)
    if isinstance(duration, float) and t > duration:
        raise MotionError(
            f"t = {t:.6g} s is not within the motion, which lasts from 0 to {duration:.6g} s; give an instant of it"
        )
    return t


def write_files(folder: Path, files: Mapping[str, bytes], force: bool) -> None:
    """Write files into a directory, which may be there already: all of them, or none.

    Raises MotionError where one is there already, unless `force` replaces it.
    """
    _refuse_file_above(folder / "any")
    remedy = "give --force to replace it, or another directory"
    destinations = [Destination(folder / name, force=force, remedy=remedy) for name in files]
    created = [each for each in (folder.absolute(), *folder.absolute().parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with stage_files(destinations) as staged:
            for file, content in zip(staged, files.values(), strict=True):
                write_named(file, content)
    except BaseException:
        for each in created:
            with suppress(OSError):
                each.rmdir()
        raise


@contextmanager
def replace_directory(target: Path, force: bool, kind: str = KIND, before: Content | None = None) -> Iterator[Path]:
    """A new directory to fill, which becomes `target` when the block ends well.

    Whatever else happens, an interruption included, nothing of it remains and what stood there before still does. Where
    the process is killed, the target is whole or absent, and the next run there clears what is left beside it
    (`kinematics.files.atomic_files`). What comes to the target while the block runs, or changes there, is left as it
    is: raises MotionError then, and the new directory is kept under a name that the error states.

    before: the content of the target that may be replaced, from `list_replaceable`; None: its content now.
    """
    place = target.resolve()
    if before is None:
        before = list_replaceable(target, force, kind)
    created = [parent for parent in place.parents if not parent.exists()]
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        with stage_directory(place) as made:
            new = made / NEW
            new.mkdir()
            with _name_files_in(target, new):
                yield new
            with defer_signals():
                _put_in_place(new, made / OLD, target, place, before)
    except BaseException:
        for parent in created:
            with suppress(OSError):
                parent.rmdir()
        raise


@contextmanager
def _name_files_in(target: Path, folder: Path) -> Iterator[None]:
    """Within, an error of the disk that names a file of a folder names its place in the target.

    A file that cannot be closed, because its disk is full, is named by the error before that.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in DISK_ERRNOS:
            raise
        file = Path(find_file(error) or "")
        if not file.is_relative_to(folder):
            raise
        raise OSError(error.errno, error.strerror, str(target / file.relative_to(folder))) from error


def list_content(target: Path) -> Content:
    """Return all files below a directory with their stamps; none for an empty or a missing directory."""
    place = target.resolve()
    return frozenset((str(path.relative_to(place)), stamp(path)) for path in place.rglob("*"))


def _put_in_place(new: Path, old: Path, target: Path, place: Path, before: Content) -> None:
    """Move a new directory to its place, if the content of that is as it was before.

    Else raise MotionError, and keep the new directory under a name that the error states.
    old: where the replaced directory goes. target: the place as the user names it.
    """
    changed = bool(before)
    stood = changed and os.path.lexists(place)
    if stood:
        if list_content(place) != before:
            raise conflict_error(target, changed, [move_aside(new, place)])
        place.rename(old)  # until the new one is there, a moment: else it returns
    try:
        new.rename(place)  # which replaces no file, and no directory but an empty one
    except OSError as error:
        if error.errno not in (*OCCUPIED_ERRNOS, errno.EACCES) or not os.path.lexists(place):
            raise
        results = [move_aside(new, place)]
        if old.exists():
            results.append(move_aside(old, place))
        raise conflict_error(target, changed, results) from None
    if stood and list_content(old) != before:  # changed in the last moment
        place.rename(new)
        old.rename(place)
        raise conflict_error(target, changed, [move_aside(new, place)])
