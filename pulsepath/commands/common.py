"""Steps that several commands share: the files that they write, and the results that they print."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pulsepath.progress import as_json, say

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kinematics.foundation.table import Table
    from planner import Plan, PulseSchedule

FIGURE_SUFFIXES = (".png", ".svg", ".pdf")


def refuse_suffix(file: Path, what: str, suffixes: Sequence[str] = FIGURE_SUFFIXES) -> None:
    """Raise MotionError for a file to write whose suffix is another. what: "a figure is"."""
    from kinematics.foundation.errors import MotionError

    if file.suffix.lower() not in suffixes:
        known = ", ".join(suffixes)
        raise MotionError(f"{file}: {what} one of {known}; give a name that ends so")


def read_plan_with_pulses(directory: Path, unverified: bool) -> "tuple[Plan, PulseSchedule]":
    """Read a plan, prove it again, and read or generate its pulses."""
    from pulsepath.sections import read_pulses
    from pulsepath.store.read import read

    plan = read(directory, unverified)
    with read_pulses(plan) as progress:
        return plan, plan.source.read_pulses(progress)


def print_json(record: object) -> None:
    """Print a result as JSON."""
    click.echo(as_json(record), nl=False)


def print_result(record: object, tables: "Iterable[Table]", json: bool) -> None:
    """Print a result as JSON or as tables."""
    if json:
        print_json(record)
        return
    from pulsepath.output.tables import show

    show(tables)


def say_doubts(doubts: Sequence[str], err: bool = False) -> None:
    """Print why a plan is not verified."""
    for doubt in doubts:
        say(f"NOT VERIFIED: {doubt}", err=err)
