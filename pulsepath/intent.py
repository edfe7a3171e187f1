"""What a command is about to write, so that it can say truly, when it is interrupted, whether it did."""

import os
from pathlib import Path

import click

Stamp = tuple[int, int] | None
_INTENT = "pulsepath.intent"


def writes(*targets: Path, kept: str = "") -> None:
    """From here on an interruption is told as whether these changed; kept: what stays of unfinished work."""
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta[_INTENT] = [(target, _stamp(target)) for target in targets], kept


def interrupted(context: click.Context) -> str:
    """The line for an interrupted command."""
    before, kept = context.meta.get(_INTENT, ((), ""))
    if not before:
        return "interrupted"
    written = [str(target) for target, stamp in before if _stamp(target) != stamp]
    if written:
        return f"interrupted, after {' and '.join(written)} had been written"
    told = " or ".join(f"{target}, which is as it was" if stamp else str(target) for target, stamp in before)
    return f"interrupted: nothing was written to {told}{kept and f'; {kept}'}"


def _stamp(path: Path) -> Stamp:
    """Tells a file or directory from another that takes its place; None: there is none."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns
