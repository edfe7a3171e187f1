"""Exit codes and error messages of the commands: on stderr, without a traceback.

With --json an error is printed on stdout too, as data: {"schema": 1, "error": {…}}
(pulsepath.process.error_record). An interrupted command reports on the files that it was writing.
Standard library only: see `supervisor`.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

INFEASIBLE, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 3, 130
SCHEMA = 1
"""Version of the data that --json prints."""
JSON = "pulsepath.json"
"""Key of a context under which the request for JSON is stored."""
TRACEBACK = "PULSEPATH_TRACEBACK"
"""Set to 1 in the environment, it lets the traceback of an error through."""


def describe_error(error: Exception) -> tuple[int, str]:
    """Return the exit code and the message of an error."""
    if is_of(error, "pulsepath.job", "Defect"):
        return INTERNAL, f"internal error: {error}; please report it"
    if is_of(error, "planner.place", "Infeasible") or is_of(error, ERRORS, "OutOfReach"):
        return INFEASIBLE, f"infeasible: {error}"
    if is_of(error, ERRORS, "FileError"):  # one fault a line, each with its file
        return BAD_INPUT, str(error)
    if is_of(error, ERRORS, "MotionError"):
        return BAD_INPUT, f"error: {error}"
    if isinstance(error, OSError) and isinstance(error.strerror, str):
        return BAD_INPUT, f"error: {find_file(error) or 'a file or an output stream'}: {error.strerror}"
    hint = f"please report it, with the traceback that {TRACEBACK}=1 shows"
    return INTERNAL, f"internal error: {type(error).__name__}: {error}; {hint}"


def find_file(error: BaseException | None) -> str | None:
    """Return the file that an error of the system names, or an error that led to it; None: none does."""
    while error is not None:
        if isinstance(error, OSError) and error.filename:
            return str(error.filename)
        error = error.__cause__ or error.__context__
    return None


ERRORS = "kinematics.foundation.errors"


def is_of(error: Exception, module: str, name: str) -> bool:
    """Return whether an error is of a class, without loading the module of the class."""
    return isinstance(error, getattr(sys.modules.get(module), name, ()))


Stamp = list[int] | None


def of_interruption(intent: Mapping[str, Any]) -> str:
    """Return the line for an interrupted command, about the files that it was writing (`intent.writes`)."""
    before, kept = intent.get("writes", ()), intent.get("kept", "")
    if not before:
        return "interrupted"
    written = [target for target, place, stamp in before if read_stamp(place) != stamp]
    if written:
        return f"interrupted, after {' and '.join(written)} had been written"
    message = " or ".join(f"{target}, which is unchanged" if stamp else target for target, _, stamp in before)
    return f"interrupted: nothing was written to {message}{kept and f'; {kept}'}"


def read_stamp(path: str | Path) -> Stamp:
    """Return the identity of a file or directory. None: it does not exist."""
    try:
        file_name = os.lstat(path)
    except OSError:
        return None
    return [file_name.st_ino, file_name.st_mtime_ns]
