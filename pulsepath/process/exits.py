"""Exit codes and messages of errors: on stderr, without a traceback.

With --json an error is printed on stdout too, as data: {"schema": 1, "error": {…}}.
"""

import sys
from typing import TYPE_CHECKING, Any

import click

from pulsepath.progress import as_json

if TYPE_CHECKING:
    from kinematics.foundation.errors import Fault

INFEASIBLE, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 3, 130
# Version of the data that --json prints.
SCHEMA = 1
# Key of a context under which the request for JSON is stored.
JSON = "pulsepath.json"
# Set to 1 in the environment, it lets the traceback of an error through.
TRACEBACK = "PULSEPATH_TRACEBACK"

_FOUNDATION = "kinematics.foundation.errors"
# Exit code, kind in JSON and message of an error, by the module and name of its class; subclasses first.
_ERRORS = (
    ("pulsepath.job", "Defect", INTERNAL, "internal", "internal error: {}; please report it"),
    ("planner.place", "Infeasible", INFEASIBLE, "infeasible", "infeasible: {}"),
    (_FOUNDATION, "OutOfReach", INFEASIBLE, "reach", "infeasible: {}"),
    (_FOUNDATION, "FileError", BAD_INPUT, "file", "{}"),  # one fault a line, each with its file
    (_FOUNDATION, "MotionError", BAD_INPUT, "input", "error: {}"),
)


def describe_error(error: Exception) -> tuple[int, str]:
    """Return the exit code and the message of an error."""
    code, _, message = _classify(error)
    return code, message


def _classify(error: Exception) -> tuple[int, str, str]:
    """Return the exit code of an error, its kind, and its message."""
    for module, name, code, kind, pattern in _ERRORS:
        # An error can only be of a class whose module is loaded.
        if isinstance(error, getattr(sys.modules.get(module), name, ())):
            return code, kind, pattern.format(error)
    if isinstance(error, OSError) and isinstance(error.strerror, str):
        file = find_file(error) or "a file or an output stream"
        return BAD_INPUT, "input", f"error: {file}: {error.strerror}"
    hint = f"please report it, with the traceback that {TRACEBACK}=1 shows"
    return INTERNAL, "internal", f"internal error: {type(error).__name__}: {error}; {hint}"


def find_file(error: BaseException | None) -> str | None:
    """Return the file that an error of the system names, or an error that led to it; None: none does."""
    while error is not None:
        if isinstance(error, OSError) and error.filename:
            return str(error.filename)
        error = error.__cause__ or error.__context__
    return None


def error_json(error: Exception, code: int) -> str:
    """Return an error as JSON text: exit code, message, faults of a file, and the excess of an infeasible plan.

    A fault has its file, line (from 1), key, written value, allowed values and nearest valid name; null: unknown.
    """
    if isinstance(error, click.ClickException):
        kind, message = "input", error.format_message()
    else:
        kind, message = _classify(error)[1], str(error)
    described: dict[str, Any] = {"exit_code": code, "kind": kind, "message": message}
    if kind == "file":
        from kinematics.foundation.errors import FileError

        assert isinstance(error, FileError)
        described["faults"] = [{"file": error.file, **_describe_fault(fault)} for fault in error.faults]
    if kind == "infeasible":
        from planner import Infeasible
        from pulsepath.output.record import violation_record

        assert isinstance(error, Infeasible)
        described["violation"] = violation_record(error)
    return as_json({"schema": SCHEMA, "error": described})


def _describe_fault(fault: "Fault") -> dict[str, Any]:
    from kinematics.foundation.units import describe_value

    return {
        "line": fault.line,
        "key": fault.key or None,
        "value": None if fault.value is None else describe_value(fault.value),
        "allowed": fault.allowed or None,
        "nearest": fault.nearest or None,
        "message": fault.message,
    }
