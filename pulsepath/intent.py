"""What a command is about to write, so that it can say truly, when it is interrupted, whether it did."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pulsepath import supervisor

Stamp = list[int] | None
_INTENT = "pulsepath.intent"


def writes(*targets: Path, kept: str = "") -> None:
    """From here on an interruption is told as whether these changed; kept: what stays of unfinished work."""
    import click

    intent = {
        "writes": [[str(target), os.path.realpath(target), _stamp(target)] for target in targets],
        "kept": kept,
        "folders": list(dict.fromkeys(str(Path(os.path.realpath(target)).parent) for target in targets)),
        "made": [str(above) for target in targets for above in _absent(Path(os.path.realpath(target)))],
    }
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta[_INTENT] = intent
        supervisor.tell(**intent)


def interrupted(context: Any) -> str:
    """The line for an interrupted command."""
    return of_interruption(context.meta.get(_INTENT, {}))


def of_interruption(intent: Mapping[str, Any]) -> str:
    """The same by what the command was about to write, as `writes` states it."""
    before, kept = intent.get("writes", ()), intent.get("kept", "")
    if not before:
        return "interrupted"
    written = [target for target, place, stamp in before if _stamp(place) != stamp]
    if written:
        return f"interrupted, after {' and '.join(written)} had been written"
    told = " or ".join(f"{target}, which is as it was" if stamp else target for target, _, stamp in before)
    return f"interrupted: nothing was written to {told}{kept and f'; {kept}'}"


def _absent(place: Path) -> list[Path]:
    """The folders above a place that are not there yet, the innermost first."""
    return [above for above in place.parents if not os.path.lexists(above)]


def _stamp(path: str | Path) -> Stamp:
    """Tells a file or directory from another that takes its place; None: there is none."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return [found.st_ino, found.st_mtime_ns]
