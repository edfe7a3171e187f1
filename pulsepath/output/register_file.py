"""The file of the console's registers, written before and after every motion."""

import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from controllers.console import SavedSession
from kinematics.files.atomic_files import write_whole
from kinematics.foundation.errors import MotionError

KIND = "pulsepath console"
SCHEMA = 2
# Schema of files whose registers counted from the travel's zero.
EARLIER_SCHEMA = 1
# Remedies for a file that cannot be read or written, and for one with wrong content.
GIVE_STATE = "give a file for the registers with --state FILE"
REPLACE = "remove the file, or give another --state"
# Digits of a wrong value in a message.
MAX_DIGITS = 40
# Largest count in a file. No axis comes near it, and sums and floats are exact up to there.
MAX_REGISTER = 2**53
# Types of the values of each table, which has a value for every axis.
TABLES: dict[str, tuple[type, ...]] = {
    "pulses": (int, float),
    "registers": (int,),
    "homed": (bool,),
    "moving": (bool,),
    "counters": (int,),
}


def usual_place(machine: str) -> Path:
    """Return the file of a machine in the user's directory for such things.

    Raises MotionError where the system knows no such directory.
    """
    name = f"{re.sub(r'[^A-Za-z0-9_-]', '_', machine)}.registers.json"
    try:
        if sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Application Support"
        else:
            base = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    except RuntimeError as error:  # no HOME, and a user that the system does not know
        raise MotionError(f"position registers: {error}; {GIVE_STATE}") from None
    return base / "pulsepath" / name


@contextmanager
def lock_file(path: Path) -> Iterator[None]:
    """Reserve the file for this process.

    Raises MotionError while another console has it, and if it cannot be written.
    """
    import fcntl

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        opened = path.with_name(f"{path.name}.lock").open("w")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise MotionError(
            f"{path}: position registers cannot be kept there: {reason}; {GIVE_STATE}",
        ) from None
    with opened as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise MotionError(
                f"{path} is in use by another console; end it, or give another --state",
            ) from None
        yield


def write(path: Path, saved: SavedSession) -> None:
    """Write a file completely, or leave the one before. Its directory exists while it is locked."""
    record = {"kind": KIND, "schema": SCHEMA, **asdict(saved)}
    write_whole(path, json.dumps(record, indent=2) + "\n")


class Keeper:
    """Saves registers, and continues without saving after an error.

    The error and its end are reported once each.

    is_saved  True if the file has the latest registers
    """

    __slots__ = ("_path", "_tell", "is_saved")

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        self._path = path
        self._tell = tell
        self.is_saved = True

    @property
    def describe(self) -> str:
        """Text that says whether the file has the registers."""
        if self.is_saved:
            return f"saved in {self._path}"
        return f"not saved: {self._path} could not be written"

    def save(self, saved: SavedSession) -> None:
        """Write the registers. If that fails, remove the file, which would offer earlier ones."""
        try:
            write(self._path, saved)
        except OSError as error:
            try:
                self._path.unlink(missing_ok=True)
                left = "home the axes next time"
            except OSError:
                left = "it holds old positions: do not ACCEPT them next time"
            if self.is_saved:
                self._tell(f"registers are no longer saved: {self._path}: {error.strerror}; {left}")
            self.is_saved = False
        else:
            if not self.is_saved:
                self._tell(f"registers are saved again in {self._path}")
            self.is_saved = True


def read(path: Path) -> SavedSession | None:
    """Return the saved registers. None: nothing was saved.

    Raises MotionError for a damaged or foreign file.
    """
    try:
        record = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise MotionError(f"{path}: {error.strerror}; {GIVE_STATE}") from None
    except ValueError as error:
        remedy = "remove it (positions are then unknown), or give another --state"
        raise MotionError(f"{path}: {error}; {remedy}") from None
    is_ours = isinstance(record, dict) and record.pop("kind", None) == KIND
    schema = record.pop("schema", None) if is_ours else None
    if schema not in (SCHEMA, EARLIER_SCHEMA):
        raise MotionError(f"{path} is not a register file of schema {SCHEMA}; give another --state")
    tables = dict(TABLES)
    if schema == EARLIER_SCHEMA:
        del tables["counters"]
    for key, kinds in tables.items():
        if fault := _find_fault(record.get(key), record.get("pulses"), kinds):
            raise MotionError(f"{path}: {key}: {fault}; {REPLACE}")
    if set(record) != {"machine", *tables} or not isinstance(record["machine"], str):
        keys = ", ".join(sorted(record))
        raise MotionError(f"{path}: keys {keys} are not those of a register file")
    if schema == EARLIER_SCHEMA:
        record["counters"] = {
            name: count if record["pulses"][name] > 0 else -count
            for name, count in record["registers"].items()
        }
    return SavedSession(**record)


def _find_fault(table: Any, axes: Any, kinds: tuple[type, ...]) -> str:
    """Describe the first fault of a table of values by axis. "": no fault"""
    if not isinstance(table, dict) or not isinstance(axes, dict) or table.keys() != axes.keys():
        return "give a value for every axis"
    if any(type(value) not in kinds for value in table.values()):
        return f"{table} has wrong values"
    for name, value in table.items():
        if not abs(value) <= MAX_REGISTER:  # true for NaN as well
            return f"{name} is {str(value)[:MAX_DIGITS]}, limit {MAX_REGISTER}"
    return ""
