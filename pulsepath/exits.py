"""How a command ends: exit codes, and errors told in one place, on stderr and without a traceback.

With --json an error is told on stdout as well, as data: {"schema": 1, "error": {…}} (pulsepath.error_record).
"""

import os
import sys
from typing import Any

import click

INFEASIBLE, BAD_INPUT, INTERNAL, INTERRUPTED = 1, 2, 3, 130
JSON = "pulsepath.json"
"""Where a context keeps whether JSON is asked for."""
TRACEBACK = "PULSEPATH_TRACEBACK"
"""Set to 1 in the environment, it lets the traceback of an error through."""


class Commands(click.Group):
    """A group of commands whose errors become exit codes; click's own usage errors exit with 2."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[JSON] = ctx.meta.get(JSON, False) or "--json" in args
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        _replace_what_the_terminal_cannot_show()
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except (click.exceptions.Exit, click.ClickException):
            raise
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except BrokenPipeError:
            # the reader has seen enough; what is still buffered must not fail when the interpreter ends
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(0)
        except Exception as error:  # every kind of failure ends here
            if os.environ.get(TRACEBACK) == "1":
                raise
            code, message = told(error)
            if ctx.meta[JSON]:
                from pulsepath.error_record import of_error

                click.echo(of_error(error, code), nl=False)
            click.echo(message, err=True)
            ctx.exit(code)


def told(error: Exception) -> tuple[int, str]:
    """The exit code that an error asks for, and what to say about it."""
    from kinematics.errors import FileError, MotionError, OutOfReach
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


def _replace_what_the_terminal_cannot_show() -> None:
    """≤ and µ must not end a command on a terminal that has no such letters."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
