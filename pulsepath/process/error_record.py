"""An error as data: what `--json` prints on stdout when a command fails."""

from typing import Any

import click

from kinematics.foundation.errors import Fault, FileError, MotionError, OutOfReach
from kinematics.foundation.units import describe_value
from planner.place import Infeasible
from pulsepath.output.record import SCHEMA, as_json, violation_record
from pulsepath.process.exits import INTERNAL

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
