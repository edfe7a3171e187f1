"""What a command is about to write, so that an interrupted command can say whether it did."""

import os
import shlex
from pathlib import Path
from typing import Any

from pulsepath.process import supervisor
from pulsepath.process.exits import of_interruption, read_stamp

_INTENT, ARGUMENTS = "pulsepath.process.intent", "pulsepath.arguments"
"""Where a context keeps what is about to be written, and the words of the command line."""


def writes(*targets: Path, kept: str = "", checkpoint: Path | None = None) -> None:
    """From here on an interruption is told as whether these changed.

    kept: what stays of unfinished work; checkpoint: or the file that says so then, if it is there
    """
    import click

    intent = {
        "writes": [[str(target), os.path.realpath(target), read_stamp(target)] for target in targets],
        "kept": kept,
        "checkpoint": None if checkpoint is None else os.path.realpath(checkpoint),
        "resume": make_resume_command(),
        "folders": list(dict.fromkeys(str(Path(os.path.realpath(target)).parent) for target in targets)),
        "made": [str(above) for target in targets for above in _missing_folders(Path(os.path.realpath(target)))],
    }
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta[_INTENT] = intent
        supervisor.tell(**intent)


def make_resume_command() -> str:
    """The command line that goes on with what this one began."""
    import click

    context = click.get_current_context(silent=True)
    given = () if context is None else context.meta.get(ARGUMENTS, ())
    words = [word for word in given if word not in ("--resume", "--force")]
    return shlex.join(["pulsepath", *words, "--resume"])


def describe_interruption(context: Any) -> str:
    """The line for an interrupted command."""
    return of_interruption(context.meta.get(_INTENT, {}))


def _missing_folders(place: Path) -> list[Path]:
    """The folders above a place that are not there yet, the innermost first."""
    return [above for above in place.parents if not os.path.lexists(above)]
