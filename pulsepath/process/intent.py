"""The files that a command is about to write, so that an interrupted command can report on them."""

import os
from pathlib import Path
from typing import Any

from pulsepath.process import supervisor
from pulsepath.process.exits import of_interruption, read_stamp

_INTENT = "pulsepath.process.intent"
"""Key of a context under which the files to be written are stored."""


def writes(*targets: Path, kept: str = "") -> None:
    """Let the message of an interrupted command say whether these files changed. kept: unfinished work that stays."""
    import click

    intent = {
        "writes": [[str(target), os.path.realpath(target), read_stamp(target)] for target in targets],
        "kept": kept,
        "folders": list(dict.fromkeys(str(Path(os.path.realpath(target)).parent) for target in targets)),
        "made": [str(above) for target in targets for above in _missing_folders(Path(os.path.realpath(target)))],
    }
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta[_INTENT] = intent
        supervisor.tell(**intent)


def describe_interruption(context: Any) -> str:
    """The line for an interrupted command."""
    return of_interruption(context.meta.get(_INTENT, {}))


def _missing_folders(place: Path) -> list[Path]:
    """The folders above a place that are not there yet, the innermost first."""
    return [above for above in place.parents if not os.path.lexists(above)]
