"""Describe an error as data: {"schema": 1, "error": {…}}, as `--json` prints it on stdout."""

from typing import TYPE_CHECKING, Any

import click

from pulsepath.process.exits import SCHEMA, classify_error
from pulsepath.progress import as_json

if TYPE_CHECKING:
    from kinematics.foundation.errors import Fault


def error_json(error: Exception, code: int) -> str:
    """Return an error as JSON text: code, message, faults of a file, excess of an infeasible plan.

    A fault has its file, line (from 1), key, written value, allowed values and nearest valid name;
    null: unknown.
    """
    if isinstance(error, click.ClickException):
        kind, message = "input", error.format_message()
    else:
        kind, message = classify_error(error)[1], str(error)
    described: dict[str, Any] = {"exit_code": code, "kind": kind, "message": message}
    if kind == "file":
        from kinematics.foundation.errors import FileError

        assert isinstance(error, FileError)
        described["faults"] = [_describe_fault(error.file, fault) for fault in error.faults]
    if kind == "infeasible":
        from planner import Infeasible
        from pulsepath.output.record import record_violation

        assert isinstance(error, Infeasible)
        described["violation"] = record_violation(error)
    return as_json({"schema": SCHEMA, "error": described})


def _describe_fault(file: str, fault: "Fault") -> dict[str, Any]:
    from kinematics.foundation.units import describe_value

    return {
        "file": file,
        "line": fault.line,
        "key": fault.key or None,
        "value": None if fault.value is None else describe_value(fault.value),
        "allowed": fault.allowed or None,
        "nearest": fault.nearest or None,
        "message": fault.message,
    }
