"""How a command ends: exit codes, and errors told in one place, on stderr and without a traceback.

With --json an error is told on stdout as well, as data: {"schema": 1, "error": {…}} (pulsepath.process.exits).

An error as data: what `--json` prints on stdout where a command refuses.
"""

from typing import Any

import click

from kinematics.foundation.errors import Fault, FileError, MotionError, OutOfReach
from kinematics.foundation.units import describe_value
from planner.place import Infeasible
from pulsepath.output.record import SCHEMA, as_json, violation_record

INFEASIBLE, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 3, 130
JSON = "pulsepath.json"
"""Where a context keeps whether JSON is asked for."""
TRACEBACK = "PULSEPATH_TRACEBACK"
"""Set to 1 in the environment, it lets the traceback of an error through."""


def told(error: Exception) -> tuple[int, str]:
    """The exit code that an error asks for, and what to say about it."""
    from kinematics.foundation.errors import FileError, MotionError, OutOfReach
    from planner.place import Infeasible
    from pulsepath.job import Defect

    match error:
        case Defect():
            return INTERNAL, f"internal error: {error}; please report it"
        case Infeasible() | OutOfReach():
            return INFEASIBLE, f"infeasible: {error}"
        case FileError():  # one fault a line, each with its file
            return BAD_INPUT, str(error)
        case MotionError():
            return BAD_INPUT, f"error: {error}"
        case OSError(strerror=str(reason)):
            return BAD_INPUT, f"error: {error.filename or 'a file'}: {reason}"
        case _:
            hint = f"please report it, with the traceback that {TRACEBACK}=1 shows"
            return INTERNAL, f"internal error: {type(error).__name__}: {error}; {hint}"


KINDS = {FileError: "file", Infeasible: "infeasible", OutOfReach: "reach", MotionError: "input", OSError: "input"}
"""What went wrong, the most special first."""


def error_json(error: Exception, code: int) -> str:
    """JSON text: the exit code, the message, the faults of a file, and what an infeasible plan breaks and would keep.

    A fault has its file, line (from 1) and key, the value as it is written, what is allowed there and the nearest valid
    name, null for what it has not.
    """
    known = (name for each, name in KINDS.items() if isinstance(error, each))
    kind = "internal" if code == INTERNAL else next(known, "input")
    told: dict[str, Any] = {"exit_code": code, "kind": kind, "message": _message(error)}
    match error:
        case FileError():
            told["faults"] = [{"file": error.file, **_fault(fault)} for fault in error.faults]
        case Infeasible():
            told["violation"] = violation_record(error)
    return as_json({"schema": SCHEMA, "error": told})


def _message(error: Exception) -> str:
    """As it is printed; of the command line's own errors, with the option."""
    return error.format_message() if isinstance(error, click.ClickException) else str(error)


def _fault(fault: Fault) -> dict[str, Any]:
    return {
        "line": fault.line,
        "key": fault.key or None,
        "value": None if fault.value is None else describe_value(fault.value),
        "allowed": fault.allowed or None,
        "nearest": fault.nearest or None,
        "message": fault.message,
    }
