"""What is said of an interrupted command, by what it was about to write. Standard library only: see `supervisor`."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Stamp = list[int] | None


def of_interruption(intent: Mapping[str, Any]) -> str:
    """The same by what the command was about to write, as `writes` states it."""
    before, kept = intent.get("writes", ()), intent.get("kept", "")
    if not before:
        return "interrupted"
    written = [target for target, place, stamp in before if read_stamp(place) != stamp]
    if written:
        return f"interrupted, after {' and '.join(written)} had been written"
    told = " or ".join(f"{target}, which is unchanged" if stamp else target for target, _, stamp in before)
    return f"interrupted: nothing was written to {told}{kept and f'; {kept}'}"


def read_stamp(path: str | Path) -> Stamp:
    """Tells a file or directory from another that takes its place; None: there is none."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return [found.st_ino, found.st_mtime_ns]
