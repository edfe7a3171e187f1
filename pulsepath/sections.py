"""Sections of a plan on disk, for the commands that make and write them: its whole, and their files."""

from pathlib import Path
from typing import Any

from planner.interruption.section import Section, Whole
from pulsepath.output import plan_directory, record
from pulsepath.output.plan_directory import StoredPlan
from pulsepath.progress import say, step


def read_whole(directory: Path, unverified: bool) -> tuple[StoredPlan, Whole]:
    """A plan that is proved again, and what its sections are made of, with its pulses."""
    planned = plan_directory.read(directory, unverified)
    with step("generating pulses") as tell:
        return planned, planned.whole(tell)


def write_section(made: Section, name: str, target: Path, force: bool, options: dict[str, Any]) -> dict[str, Any]:
    """A stop, the way on or a slowed motion in an export format: its record."""
    return record.of_export(name, str(target), made.export(name, target, force=force, **options))


def say_errors(files: list[dict[str, Any]]) -> None:
    """How far what each file holds is from its motion."""
    for file in files:
        say(f"{file['file']}: error {file['error_pulses']:.3g} pulses against {file['against']}")
