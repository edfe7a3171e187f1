"""Exit codes and messages of errors: on stderr, without a traceback."""

import sys

INFEASIBLE, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 3, 130
# Version of the data that --json prints.
SCHEMA = 1
# Key of a context under which the request for JSON is stored.
JSON = "pulsepath.json"
# Set to 1 in the environment, it lets the traceback of an error through.
TRACEBACK = "PULSEPATH_TRACEBACK"

_FOUNDATION = "kinematics.foundation.errors"
# Module and name of a class of errors, exit code, kind in JSON, message. Subclasses come first.
_ERRORS = (
    ("pulsepath.job", "Defect", INTERNAL, "internal", "internal error: {}; please report it"),
    ("planner.place", "Infeasible", INFEASIBLE, "infeasible", "infeasible: {}"),
    (_FOUNDATION, "OutOfReach", INFEASIBLE, "reach", "infeasible: {}"),
    (_FOUNDATION, "FileError", BAD_INPUT, "file", "{}"),  # one fault a line, each with its file
    (_FOUNDATION, "MotionError", BAD_INPUT, "input", "error: {}"),
)


def describe_error(error: Exception) -> tuple[int, str]:
    """Return the exit code and the message of an error."""
    code, _, message = classify_error(error)
    return code, message


def classify_error(error: Exception) -> tuple[int, str, str]:
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
    """Return the file that an error of the system, or one of its causes, names; None: none does."""
    while error is not None:
        if isinstance(error, OSError) and error.filename:
            return str(error.filename)
        error = error.__cause__ or error.__context__
    return None
