"""The plans, comparisons and calibrations below a folder, with what their records say on one line each."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pulsepath.output.directory import KIND, RECORDS, REPORT

MAX_DEPTH = 4
"""Folders between the one that is looked through and one with a plan, at most."""
MAX_LISTED = 500
MAX_RECORD_SIZE = 1 << 26
"""Bytes of a record that is read: one of a program of a million blends has as many."""


@dataclass(frozen=True, slots=True)
class Listed:
    """A folder with a report: its name below the folder that was looked through, and what its record says.

    stamp  when its record was written (ns) and its size: another one where it is written again
    """

    name: str
    folder: Path
    kind: str
    stamp: str
    title: str
    figures: Mapping[str, float | None]

    @property
    def report(self) -> Path:
        return self.folder / REPORT


class PlanList:
    """What is below a folder; a record is read once, and again when it has changed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._known: dict[tuple[str, str], Listed] = {}

    def find(self) -> list[Listed]:
        """All that is there now, by name; folders that cannot be read are left out."""
        known: dict[tuple[str, str], Listed] = {}
        for folder, kind, stamp in _look(self.root):
            name = folder.relative_to(self.root).as_posix()
            listed = self._known.get((name, stamp)) or _read(name, folder, kind, stamp)
            if listed is not None:
                known[name, stamp] = listed
            if len(known) == MAX_LISTED:
                break
        self._known = known
        return sorted(known.values(), key=lambda one: one.name)


def _look(root: Path) -> Iterator[tuple[Path, str, str]]:
    """Folders with a record and a report, of which kind, and the stamp of the record."""
    for place, below, files in os.walk(root):
        folder = Path(place)
        below[:] = sorted(name for name in below if not name.startswith(".") and name.isprintable())
        if len(folder.relative_to(root).parts) == MAX_DEPTH:
            below.clear()
        if REPORT not in files:
            continue
        for kind, file in RECORDS.items():
            if file in files:
                try:
                    seen = (folder / file).stat()
                except OSError:  # it is just being replaced
                    break
                if seen.st_size <= MAX_RECORD_SIZE:
                    yield folder, kind, f"{seen.st_mtime_ns}-{seen.st_size}"
                below.clear()
                break


def _read(name: str, folder: Path, kind: str, stamp: str) -> Listed | None:
    """None: it is damaged, or of something else."""
    try:
        record = json.loads((folder / RECORDS[kind]).read_bytes())
        if record["kind"] != kind:
            return None
        return Listed(name, folder, kind, stamp, _title(record), _figures(record) if kind == KIND else {})
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _title(record: Mapping[str, Any]) -> str:
    program, machine = record.get("program"), record.get("machine")
    if program is None:
        return str(record.get("rig") or machine or "")
    return f"{program} on {machine}"


def _figures(record: Mapping[str, Any]) -> dict[str, float | None]:
    """What two plans are compared by, in SI units; None where a plan does not have it."""
    limits = record["certificate"]["limits"]
    figures: dict[str, float | None] = {
        "order": record["order"],
        "duration_s": record["duration_s"],
        "path_length_m": record["path_length_m"],
        "gap": (record.get("lower_bound") or {}).get("gap"),
        "baseline_s": (record.get("classical") or {}).get("duration_s"),
        "pulses": record["pulses"]["total"],
    }
    figures |= {f"use of {name}": entry["attained_ratio"] for name, entry in limits.items()}
    if not all(isinstance(value, int | float | None) for value in figures.values()):
        raise TypeError("a figure that is no number")
    return figures
