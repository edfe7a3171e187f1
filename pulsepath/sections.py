"""Plans on disk and their sections, for the commands that write them to files: what is read, and what is said."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from math import degrees
from pathlib import Path
from typing import Any

from kinematics.files.atomic_files import Destination
from kinematics.files.chunk_file import holds_chunks
from planner.export.format import write_export_to
from planner.interruption.section import Section, Whole
from pulsepath.output import plan_directory, record
from pulsepath.output.stored_plan import StoredPlan
from pulsepath.progress import say, step

FINE = {"m": ("µm", 1e6), "rad": ("m°", 1e3 * degrees(1))}
"""What errors of axes are told in, and how many of it make an SI unit."""


def _measure(planned: StoredPlan, by_axis: Sequence[float]) -> str:
    """Convert the errors of axes in pulses to their units, and return the largest of each unit."""
    largest = dict[str, float]()
    for axis, pulses in zip(planned.machine.axes, by_axis, strict=True):
        if pulses > 0:
            largest[axis.unit] = max(largest.get(axis.unit, 0.0), pulses * axis.pulse)
    if not largest:
        return ""
    shown = [f"{value * factor:.3g} {name}" for unit, value in largest.items() for name, factor in [FINE[unit]]]
    return f" (at most {', '.join(shown)} of an axis)"


def read_whole(directory: Path, unverified: bool) -> tuple[StoredPlan, Whole]:
    """A plan that is proved again, and what its sections are made of, with its pulses."""
    planned = plan_directory.read(directory, unverified)
    with read_pulses(planned) as tell:
        return planned, planned.whole(tell)


def read_pulses(planned: StoredPlan) -> AbstractContextManager[Callable[[int, int], None]]:
    """The step in which a plan's pulses are read, or made again where there is no file of them."""
    file = planned.pulse_file
    return step("generating pulses" if file is None or not holds_chunks(file) else f"reading {file.name}")


def write_section(made: Section, name: str, destination: Destination, options: Mapping[str, Any]) -> dict[str, Any]:
    """Write a stop, the way on or a slowed motion in an export format; return its record."""
    exported = write_export_to(destination, made.export_source, name, options)
    return record.of_export(name, str(destination.path), exported)


def list_triggers(made: Section) -> list[dict[str, Any]]:
    """The triggers that a section fires, at its own times (s), with the counts of its axes."""
    axes = made.machine.axes
    return [
        {
            "name": event.name,
            "where": record.place_record(event.where),
            "counts": {axis.name: int(count) for axis, count in zip(axes, event.counts, strict=True)},
        }
        for event in made.triggers
    ]


def say_errors(files: Sequence[Mapping[str, Any]], planned: StoredPlan) -> None:
    """How far what each file holds is from its motion, and what its user has to know, of files by their records."""
    made_up = sorted({kind for axis in planned.machine.axes for kind in axis.compensate})
    for file in files:
        off = _measure(planned, file["error_pulses_by_axis"])
        say(f"{file['file']}: error {file['error_pulses']:.3g} pulses against {file['against']}{off}")
        if made_up:
            say(f"  positions are the motors': {' and '.join(made_up)} made up for")
        for note in (*file["notes"], *(f"NOT VERIFIED: {doubt}" for doubt in planned.doubts)):
            say(f"  {note}")
