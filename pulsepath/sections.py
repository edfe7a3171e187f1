"""Read plans on disk, and write and describe their sections, for the commands."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from math import degrees
from pathlib import Path
from typing import Any

from kinematics.files.atomic_files import Destination
from kinematics.files.chunk_file import holds_chunks
from planner import Plan
from planner.export.format import write_export_to
from planner.interruption.section import Section, Whole
from pulsepath.output import record
from pulsepath.progress import say, step
from pulsepath.store.read import read

# Unit of errors of axes, and its number in an SI unit.
FINE_UNITS = {"m": ("µm", 1e6), "rad": ("m°", 1e3 * degrees(1))}


def read_whole(directory: Path, unverified: bool) -> tuple[Plan, Whole]:
    """Read a plan, prove it again, and return it with the parts that its sections are made from."""
    plan = read(directory, unverified)
    with read_pulses(plan) as report:
        return plan, plan.whole(report)


def read_pulses(plan: Plan) -> AbstractContextManager[Callable[[int, int], None]]:
    """Return the step that reads a plan's pulses, or generates them without a file."""
    file = plan.source.pulse_file
    if file is None or not holds_chunks(file):
        return step("generating pulses")
    return step(f"reading {file.name}")


def write_section(
    section: Section,
    name: str,
    destination: Destination,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Write a stop or the motion that continues in an export format; return its record."""
    exported = write_export_to(destination, section.export_source, name, options)
    return record.record_export(name, str(destination.path), exported)


def list_triggers(section: Section) -> list[dict[str, Any]]:
    """Return the records of the triggers that a section fires, at its own times (s) and counts."""
    names = [axis.name for axis in section.machine.axes]
    return [
        {
            "name": event.name,
            "where": event.where.record(),
            "counts": dict(zip(names, map(int, event.counts), strict=True)),
        }
        for event in section.triggers
    ]


def say_errors(files: Sequence[Mapping[str, Any]], plan: Plan) -> None:
    """Print the error of each file against its motion, and its notes. files: their records."""
    compensated = sorted({kind for axis in plan.machine.axes for kind in axis.compensate})
    for file in files:
        error = f"error {file['error_pulses']:.3g} pulses against {file['against']}"
        say(f"{file['file']}: {error}{_measure(plan, file['error_pulses_by_axis'])}")
        if compensated:
            say(f"  positions are the motors': {' and '.join(compensated)} made up for")
        for note in file["notes"]:
            say(f"  {note}")
        for doubt in plan.doubts:
            say(f"  NOT VERIFIED: {doubt}")


def _measure(plan: Plan, errors: Sequence[float]) -> str:
    """Return the largest error of axes in each unit, as text. errors: in pulses, by axis."""
    largest: dict[str, float] = {}
    for axis, pulses in zip(plan.machine.axes, errors, strict=True):
        if pulses > 0:
            largest[axis.unit] = max(largest.get(axis.unit, 0.0), pulses * axis.pulse)
    texts = []
    for unit, value in largest.items():
        name, factor = FINE_UNITS[unit]
        texts.append(f"{value * factor:.3g} {name}")
    return f" (at most {', '.join(texts)} of an axis)" if texts else ""
