"""The tables that the commands print, rendered by rich."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Literal

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Drawn

from controllers import Metrics
from kinematics import Axis, Machine
from kinematics.foundation.options import options
from kinematics.foundation.result import Result
from kinematics.foundation.table import SCALES, Column, Table
from kinematics.machine.axis import Magnitude, directional_bounds
from planner import Classical, Plan
from planner.baselines import describe_differences, missing_limits
from planner.pulses import RULES
from planner.sources.position_list import PositionList
from pulsepath.job import Job
from pulsepath.progress import is_styled

WIDTH = 110
"""Columns where the output is no terminal, which would say."""


def show(tables: Iterable[Drawn]) -> None:
    """Print tables. Names in them come from files, so nothing is taken for markup."""
    console = Console(
        width=None if sys.stdout.isatty() else WIDTH,
        markup=False,
        emoji=False,
        highlight=False,
        force_terminal=is_styled(sys.stdout),
    )
    with console.capture() as printed:
        for table in tables:  # rich would break what stands over and under a table to the table's width
            over, under = table.title, table.caption
            table.title = table.caption = None
            console.print(over, style="table.title")
            console.print(table)
            if under:
                console.print(under, style="table.caption")
    click.echo("\n".join(line.rstrip() for line in printed.get().splitlines()))


def of_results(*results: Result) -> list[Drawn]:
    """What results tell of themselves."""
    return [drawn for result in results for table in result.tables() for drawn in _rich_tables(table)]


def of_plan(job: Job) -> list[Drawn]:
    """Duration and saving, and what the plan tells of itself."""
    plan = job.plan
    percent = 100 * job.saved / job.classical.duration
    missing = missing_limits(plan, job.classical)
    unlike = f"; the baseline timing is without {', '.join(missing)}" if missing else ""
    least = f"as stated; the fastest motion takes about {plan.lower_estimate:.6f} s or more"
    rows = [
        ("duration", plan.trajectory.duration, "" if plan.stated_duration is None else least),
        ("baseline timing", job.classical.duration, _describe_timing(plan, job.classical, job.classical.kind)),
        ("time saved", job.saved, f"{percent:.2f} %{unlike}"),
    ]
    rows += [(other.kind, other.duration, _describe_timing(plan, other)) for other in job.others]
    what, times, notes = zip(*rows, strict=True)
    first, *rest = plan.tables()
    timed = (Column("what", what), Column("time", times, "s", form=".6f"), Column("note", notes))
    crossed = () if job.crossed is None else job.crossed.tables()
    return [drawn for table in (replace(first, columns=timed), *rest, *crossed) for drawn in _rich_tables(table)]


def _describe_timing(plan: Plan, timing: Classical, *first: str) -> str:
    """What a baseline timing is, and does otherwise than the plan."""
    return "; ".join([*first, *describe_differences(plan, timing)])


def of_list(title: str, listed: Sequence[Mapping[str, Any]]) -> list[Drawn]:
    """Records of the same keys, a row each."""
    columns = {key: [record[key] for record in listed] for key in listed[0]}
    texts = {
        key: [", ".join(value) if isinstance(value, list | dict) else value for value in values]
        for key, values in columns.items()
    }
    return [*_rich_tables(Table(title, tuple(Column(key, values) for key, values in texts.items())))]


def of_rules() -> list[Drawn]:
    """The firing rules, each with its options and their defaults."""
    rules = _table("firing rules", "rule", "option", "default#", "")
    for name, rule in RULES.items():
        rules.add_row(name, "", "", (rule.__doc__ or "").splitlines()[0])
        for field in options(rule).values():
            default = "" if field.default is None else f"{field.default:g} {field.metadata['unit']}".rstrip()
            rules.add_row("", field.name, default, field.metadata["help"])
    return [rules]


def of_tracking(metrics: Iterable[Metrics]) -> list[Drawn]:
    """Errors of each axis and in space, one table per law."""
    return [drawn for law in metrics for drawn in _rich_tables(law.tables()[0])]


def of_positions(listed: PositionList, file: str) -> list[Drawn]:
    """Each pose by its number."""
    (table,) = listed.tables()
    return list(_rich_tables(replace(table, title=f"{file}: {table.title}")))


def of_machines(machines: Iterable[Machine]) -> list[Drawn]:
    """Axes, travel and limits of each machine; axes that share them share a row."""
    head = ("machine!", "axes", "freedom", "travel!", "pulse!", "speed!", "acceleration!", "jerk!")
    table = _table("bundled machines", *head)
    for machine in machines:
        alike: dict[tuple[str, ...], list[str]] = {}
        for axis in machine.axes:
            alike.setdefault(_limits(axis), []).append(axis.name)
        for n, (limits, names) in enumerate(alike.items()):
            some = ", ".join(names) if len(names) <= 3 else f"{names[0]} … {names[-1]}"
            table.add_row(machine.name if n == 0 else "", some, " ".join(machine.freedom) if n == 0 else "", *limits)
    return [table]


def _limits(axis: Axis) -> tuple[str, ...]:
    unit, scale = SCALES["human"][axis.unit]
    low, high = axis.travel
    travel = "unlimited" if high == inf else f"{scale * low:g} … {scale * high:g} {unit}"
    pulse = f"{1e6 * axis.pulse:g} µm" if axis.unit == "m" else f"{scale * axis.pulse:.4g} {unit}"
    bounds = ((axis.max_speed, "/s"), (axis.max_acceleration, "/s²"), (axis.max_jerk, "/s³"))
    return travel, pulse, *(_bound(bound, scale, f"{unit}{per}") for bound, per in bounds)


def _bound(bound: Magnitude | None, scale: float, unit: str) -> str:
    """A bound; both ways where they differ, towards smaller positions first."""
    if bound is None:
        return "unlimited"
    return f"{' / '.join(f'{scale * side:g}' for side in dict.fromkeys(directional_bounds(bound)))} {unit}"


def _table(title: str, *columns: str) -> Drawn:
    """A table; a column whose name ends in # holds numbers, one that ends in ! is never broken."""
    table = Drawn(title=title, box=SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        side: Literal["left", "right"] = "right" if name.endswith("#") else "left"
        table.add_column(name.rstrip("#!"), justify=side, no_wrap=name.endswith("!"), overflow="fold")
    return table


def _rich_tables(table: Table) -> Iterable[Drawn]:
    """A table with its notes below."""
    made = _table(table.title, *(f"{column.title}{'#' if column.numeric else ''}" for column in table.read))
    for row in table.cells():
        made.add_row(*row)
    made.caption = "\n".join(table.notes) or None
    yield made
