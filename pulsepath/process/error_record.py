"""An error as data, which `--json` prints on stdout when a command fails."""

from typing import TYPE_CHECKING, Any

import click

from pulsepath.process.exits import ERRORS, INTERNAL, SCHEMA, is_of
from pulsepath.progress import as_json

if TYPE_CHECKING:
    from kinematics.foundation.errors import Fault

KINDS = {
    "file": (ERRORS, "FileError"),
    "infeasible": ("planner.place", "Infeasible"),
    "reach": (ERRORS, "OutOfReach"),
    "input": (ERRORS, "MotionError"),
}
"""Kind of an error, by the module and name of its class, the most special first."""


def error_json(error: Exception, code: int) -> str:
    """Return an error as JSON text: exit code, message, faults of a file, and the excess of an infeasible plan.

    A fault has its file, line (from 1), key, written value, allowed values and nearest valid name; null:
    unknown.
    """
    known = (name for name, each in KINDS.items() if is_of(error, *each))
    kind = "internal" if code == INTERNAL else next(known, "input")
    told: dict[str, Any] = {"exit_code": code, "kind": kind, "message": _message(error)}
    if kind == "file":
        from kinematics.foundation.errors import FileError

        assert isinstance(error, FileError)
        told["faults"] = [{"file": error.file, **_fault(fault)} for fault in error.faults]
    if kind == "infeasible":
        from planner import Infeasible
        from pulsepath.output.record import violation_record

        assert isinstance(error, Infeasible)
        told["violation"] = violation_record(error)
    return as_json({"schema": SCHEMA, "error": told})


def _message(error: Exception) -> str:
    """Return the printed message; for errors of the command line with the option."""
    return error.format_message() if isinstance(error, click.ClickException) else str(error)


def _fault(fault: "Fault") -> dict[str, Any]:
    from kinematics.foundation.units import describe_value

    return {
        "line": fault.line,
        "key": fault.key or None,
        "value": None if fault.value is None else describe_value(fault.value),
        "allowed": fault.allowed or None,
        "nearest": fault.nearest or None,
        "message": fault.message,
    }
