"""Plans, comparisons and calibrations below a folder, each with the main facts of its record."""

import errno
import json
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from kinematics.foundation.units import floor_percent
from pulsepath.output.directory import KIND, RECORDS, REPORT
from pulsepath.output.drive_tables import find_drive_margin

MAX_DEPTH = 4
"""Folders between the one that is looked through and one with a plan, at most."""
MAX_LISTED = 500
MAX_RECORD_SIZE = 1 << 26
"""Bytes of a record that is read: one of a program of a million blends has as many."""
MAX_FIGURE = 1e18
"""Largest figure: a larger one is damage, and differences and shares of it would overflow."""


@dataclass(frozen=True, slots=True)
class Listed:
    """A folder with a report, by its name below the listed folder.

    stamp    time (ns) and size of its record; it changes when the record is written again
    figures  of a plan, in SI units; None: the plan has no such figure
    facts    of a plan, in words: its inputs and options
    """

    name: str
    folder: Path
    kind: str
    stamp: str
    title: str
    figures: Mapping[str, float | None] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name on the page: the folder's own name if it is the listed folder itself."""
        return self.name if self.name != "." else find_folder_name(self.folder)

    @property
    def report(self) -> Path:
        return self.folder / REPORT


class PlanList:
    """The results below a folder. A record is read once, and again when it has changed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._known: dict[tuple[str, str], Listed] = {}

    def find(self) -> list[Listed]:
        """All that is there now, by name; folders that cannot be read are left out."""
        known: dict[tuple[str, str], Listed] = {}
        for folder, kind, stamp in _look(self.root):
            name = folder.relative_to(self.root).as_posix()
            listed = self._known.get((name, stamp)) or self._read(name, folder, kind, stamp)
            if listed is not None:
                known[name, stamp] = listed
            if len(known) == MAX_LISTED:
                break
        self._known = known
        return sorted(known.values(), key=lambda one: one.name)

    def _read(self, name: str, folder: Path, kind: str, stamp: str) -> Listed | None:
        """Read the record of a folder.

        Return None for a damaged record, and for one of another command.
        """
        try:
            record = json.loads(read_below(self.root, folder / RECORDS[kind]))
            if record["kind"] != kind:
                return None
            plan = kind == KIND
            figures, facts = (_figures(record), _facts(record)) if plan else ({}, {})
            return Listed(name, folder, kind, stamp, _title(record), figures, facts)
        except (
            OSError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            ArithmeticError,
            RecursionError,
        ):
            return None


def read_below(root: Path, file: Path) -> bytes:
    """Return the content of a regular file below a folder.

    Raises OSError for a link out of the folder, and for a pipe or a device.
    """
    place = os.path.realpath(file, strict=True)
    if not Path(place).is_relative_to(os.path.realpath(root)):
        raise OSError(errno.EACCES, "leads out of the folder", str(file))

    # The last part of the path is no link any more, and opening a pipe must not wait for its
    # writer.
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with open(
        place, "rb", opener=lambda path, _: os.open(path, flags | getattr(os, "O_BINARY", 0))
    ) as opened:
        if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
            raise OSError(errno.EINVAL, "is no regular file", str(file))
        return opened.read()


def find_folder_name(folder: Path) -> str:
    """The name of a folder, that of the current one too."""
    whole = folder.resolve()
    return whole.name or str(whole)


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
                    status = (folder / file).stat()
                except OSError:  # it is just being replaced
                    break
                if status.st_size <= MAX_RECORD_SIZE:
                    yield folder, kind, f"{status.st_mtime_ns}-{status.st_size}"
                below.clear()
                break


def _title(record: Mapping[str, Any]) -> str:
    program, machine = record.get("program"), record.get("machine")
    if program is None:
        return str(record.get("rig") or machine or "")
    return f"{program} on {machine}"


def _facts(record: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts of a plan in words, by which two plans are compared."""
    pulses, shaping = record["pulses"], record.get("shaping") or {}
    digests = record["provenance"]["sha256"]
    request = record["request"]
    stated = request["duration_s"]
    fit = record["inputs"]["fit_m"]
    cost = shaping.get("cost") or {}
    return {
        **{of: f"{record[of]} (file {str(digests[of])[:8]})" for of in ("program", "machine")},
        "objective": str(request["objective"]) if stated is None else f"a duration of {stated:g} s",
        "order": str(record["order"]),
        "input shapers": _describe_shapers(shaping.get("axes") or {}),
        "limits lowered for them": _describe_lowered(cost.get("lowered") or []),
        "limits not kept": ", ".join(map(str, record["stated_but_not_kept"])) or "none",
        "fit": "none" if fit is None else f"{1e3 * fit:g} mm",
        "firing rule": f"{pulses['rule']}, clock {pulses['clock_hz'] / 1e6:g} MHz",
        "ends": "with its program" if not record.get("ends_before") else "before its program",
    }


def _describe_shapers(axes: Mapping[str, Mapping[str, Any]]) -> str:
    """Each shaper, and the axes that have it: "zv 25 Hz, damping 0.05 (x, y)"."""
    whose: dict[str, list[str]] = {}
    for name, axis in axes.items():
        for part in axis["shapers"]:
            whose.setdefault(
                f"{part['kind']} {part['frequency']:g} Hz, damping {part['damping']:g}", []
            ).append(name)
    return "; ".join(f"{shaper} ({', '.join(names)})" for shaper, names in whose.items()) or "none"


def _describe_lowered(stretches: Sequence[Mapping[str, Any]]) -> str:
    """Describe the least share of each lowered limit."""
    least: dict[str, float] = {}
    for each in stretches:
        least[each["limit"]] = min(each["share"], least.get(each["limit"], 1.0))
    return (
        ", ".join(f"{name} to {floor_percent(share)} %" for name, share in least.items()) or "none"
    )


def _figures(record: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the figures of a plan in SI units, by which two plans are compared.

    None: not in the plan.
    """
    limits, shaping, pulses = (
        record["certificate"]["limits"],
        record.get("shaping") or {},
        record["pulses"],
    )
    errors = (record.get("realised") or {}).get("errors") or {}
    laws = (record.get("tracking") or {}).get("laws") or {}
    figures: dict[str, float | None] = {
        "duration_s": record["duration_s"],
        "before_shapers_s": shaping.get("duration_before_s"),
        "cost_of_shapers_s": (shaping.get("cost") or {}).get("total_s"),
        "lower_bound_s": (record.get("lower_bound") or {}).get("duration_s"),
        "gap": (record.get("lower_bound") or {}).get("gap"),
        "baseline_s": (record.get("classical") or {}).get("duration_s"),
        "path_length_m": record["path_length_m"],
        "blends": len(record["blends"])
        if "blends" in record
        else (record.get("joins") or {}).get("blends"),
        "pulses": pulses["total"],
        "highest_rate_hz": (pulses["check"] or {}).get("highest_rate_hz"),
        "drive_margin": find_drive_margin(pulses),
        "quantization_m": (errors.get("position") or {}).get("max"),
    }
    figures |= {f"use of {name}": entry["attained_ratio"] for name, entry in limits.items()}
    shaped = shaping.get("limits") or {}
    figures |= {
        f"use of {name}, behind the shapers": entry["worst_ratio"] for name, entry in shaped.items()
    }
    contours = {law: of.get("contour") or {} for law, of in laws.items()}
    figures |= {
        f"contour error RMS, {law}": one["rms"]
        for law, one in contours.items()
        if one.get("unit") == "m"
    }
    for name, value in figures.items():
        if value is not None and not (isfinite(value) and abs(value) <= MAX_FIGURE):
            raise ValueError(f"{name} is {value}")
    return figures
