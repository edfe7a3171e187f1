"""The tables that the commands print."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import ceil, degrees, inf, isfinite
from typing import Any

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from controllers import Metrics
from kinematics import Axis, Machine
from kinematics.axis import Magnitude, sides
from kinematics.calibration import Calibration
from kinematics.calibration.result import GROUPS
from planner import Place, Standing, Triggered
from planner.option import options
from planner.path.join import Blended
from planner.pulses import RULES, PulseSchedule
from planner.sources.position_list import PositionList
from pulsepath.job import Job
from pulsepath.talk import dressed

WIDTH = 110
"""Columns where the output is no terminal, which would say."""
MICRO = {"m": "µm", "rad": "µrad"}
HUMAN = {"m": ("mm", 1e3), "rad": ("°", degrees(1))}


def show(tables: Iterable[Table]) -> None:
    """Print tables. Names in them come from files, so nothing is taken for markup."""
    console = Console(
        width=None if sys.stdout.isatty() else WIDTH,
        markup=False,
        emoji=False,
        highlight=False,
        force_terminal=dressed(sys.stdout),
    )
    with console.capture() as printed:
        console.print(*tables)
    click.echo("\n".join(line.rstrip() for line in printed.get().splitlines()))


def of_plan(job: Job) -> list[Table]:
    """Duration and saving, the worst proven ratio of each limit and where, and the pulses of each axis."""
    plan, certificate = job.plan, job.plan.certificate
    percent = 100 * job.saved / job.classical.duration
    note = "has no jerk limit" if plan.order == 3 else ""
    times = _table(f"{plan.program.name} on {plan.machine.name}, order {plan.order}", "", "time (s)#", "")
    least = f"as stated; the fastest takes about {plan.lower_estimate:.6f} s or more"
    times.add_row("duration", f"{plan.trajectory.duration:.6f}", "" if plan.stated_duration is None else least)
    times.add_row("classical timing", f"{job.classical.duration:.6f}", note)
    times.add_row("time saved", f"{job.saved:.6f}", f"{percent:.2f} %")
    if job.others:
        times.add_section()
    for other in job.others:
        off = None if other.deviation is None else f"off the path by up to {1e3 * other.deviation.distance:.3f} mm"
        times.add_row(other.kind, f"{other.duration:.6f}", off or ("" if other.order == 3 else note))
    limits = _table("limits, proved over continuous time", "limit", "ratio ≤#", "at", "segment#", "mm#", "s#")
    for name, worst in certificate.worst.items():
        limits.add_row(name, _up(worst), *_where(certificate.where[name]))
    pulses = _table(f"pulses by the rule {plan.pulses.rule}, checked", "axis", "pulses#", "net count#", "error ≤#")
    for axis in plan.pulses.axes:
        pulses.add_row(axis.name, f"{len(axis)}", f"{axis.final - axis.start}", _up(axis.bound, 3))
    pulses.add_row("all", f"{plan.pulses.total}")
    made = [pulses, *_moves(plan.pulses, plan.machine.axes)]
    return [times, limits, *of_blends(plan.path.blends), *made, *_triggers(plan.triggers)]


def _moves(schedule: PulseSchedule, axes: Sequence[Axis]) -> Iterator[Table]:
    """What the drives' timing and compensation cost; no tables where they cost nothing."""
    units = {axis.name: axis.unit for axis in axes}
    if schedule.moves:
        moved = _table("moved for the drives", "axis", "pulses#", "by at most (µs)#", "error (pulses)#", "(µm, µrad)#")
        for one in schedule.moves:
            moved.add_row(
                one.axis, f"{one.pulses}", f"{1e6 * one.time:.3f}", _up(one.error, 4), _up(1e6 * one.length, 4)
            )
        yield moved
    costs = [cost for cost in schedule.compensations if cost.kinds]
    if costs:
        title = "made up for: the motors while they cross the play, beside what is certified"
        made = _table(title, "axis", "", "reversals#", "off by ≤#", "speed#", "acceleration#", "jerk#")
        for cost in costs:
            unit, scale = HUMAN[units[cost.axis]]
            made.add_row(
                cost.axis,
                " and ".join(cost.kinds),
                f"{cost.crossings}",
                f"{1e6 * cost.off:.3f} {MICRO[units[cost.axis]]}",
                _of_limit(scale * cost.speed, cost.max_speed, scale, f"{unit}/s"),
                _of_limit(scale * cost.acceleration, cost.max_acceleration, scale, f"{unit}/s²"),
                f"{scale * cost.jerk:.3g} {unit}/s³",
            )
        yield made


def _of_limit(value: float, limit: float | None, scale: float, unit: str) -> str:
    return f"{value:.3f} {unit}" if limit is None else f"{value:.3f} of {scale * limit:.3f} {unit}"


def of_list(title: str, listed: Sequence[Mapping[str, Any]]) -> Table:
    """Records of the same keys, a row each."""
    table = _table(title, *(f"{key}!" if key in ("name", "number") else key for key in listed[0]))
    for record in listed:
        cells = (", ".join(value) if isinstance(value, list | dict) else value for value in record.values())
        table.add_row(*("" if cell is None else str(cell) for cell in cells))
    return table


def of_rules() -> list[Table]:
    """The firing rules, each with its options and their defaults."""
    rules = _table("firing rules", "rule", "option", "default#", "")
    for name, rule in RULES.items():
        rules.add_row(name, "", "", (rule.__doc__ or "").splitlines()[0])
        for field in options(rule).values():
            default = f"{field.default:g} {field.metadata['unit']}".rstrip()
            rules.add_row("", field.name, default, field.metadata["help"])
    return [rules]


def of_blends(blends: Sequence[Blended]) -> list[Table]:
    """How far each blend leaves the corner, and what it could not have; no table where there is none."""
    if not blends:
        return []
    table = _table("blends", "after segment#", "tolerance (µm)#", "deviation (µm)#", "angle (µrad)#", "reach (mm)#", "")
    for blend in blends:
        if blend.stop:
            table.add_row(f"{blend.segment}", f"{1e6 * blend.tolerance:.4g}", "", "", "", f"stops: {blend.stop}")
            continue
        figures = (1e6 * blend.tolerance, 1e6 * blend.deviation, 1e6 * blend.turned, 1e3 * blend.reach)
        halves = " and ".join(map(str, blend.half_of))
        short = f"half of segment {halves}" if blend.half_of else ""
        table.add_row(f"{blend.segment}", *(f"{figure:.4g}" for figure in figures), short)
    return [table]


def _triggers(events: Sequence[Triggered]) -> list[Table]:
    if not events:
        return []
    table = _table("triggers", "name", "segment#", "mm#", "s#", "counts")
    for event in events:
        _, segment, distance, _ = _where(event.where)
        table.add_row(event.name, segment, distance, f"{event.time:.7f}", " ".join(map(str, event.counts)))
    return [table]


def of_check(found: Standing) -> list[Table]:
    """How near a path comes to each limit, and its blends."""
    table = _table("largest use of each limit, proved along the path", "limit", "ratio ≤#", "at", "segment#", "mm#")
    for name, (use, place) in found.largest.items():
        table.add_row(name, _up(use), *_where(place)[:3])
    return [table, *of_blends(found.blends)]


def of_tracking(metrics: Iterable[Metrics]) -> list[Table]:
    """Errors of each axis and in space, one table per law."""
    tables = []
    for law in metrics:
        table = _table(law.law, "error", "RMS#", "P95#", "max#", "unit", "segment#", "mm#", "s#")
        for series in law.series:
            figures = (f"{1e6 * value:.3f}" for value in (series.rms, series.p95, series.max))
            table.add_row(series.name, *figures, MICRO[series.unit], *_where(series.where)[1:])
        tables.append(table)
    return tables


def of_calibration(found: Calibration) -> list[Table]:
    """Errors before and after, the parameters with their standard errors, and the observability."""
    errors = _table("RMS per component at the fitted poses", "error", "before#", "after#", "left out#", "unit")
    for group in GROUPS:
        figures = [1e6 * found.rms(stage, group) for stage in (found.before, found.after, found.left_out)]
        if isfinite(figures[0]):
            shown = (f"{figure:.3f}" if isfinite(figure) else "not fitted" for figure in figures)
            errors.add_row(group, *shown, MICRO["m" if group == "position" else "rad"])
    parameters = _table("parameters", "", "nominal#", "identified#", "standard error#", "unit")
    for one in found.parameters:
        unit, scale = HUMAN[one.unit] if one.unit else ("", 1.0)
        values = (f"{scale * value:.6f}" for value in (one.nominal, one.value))
        error = (
            f"{scale * one.error:.6f}" if isfinite(one.error) else "not seen apart" if one.error == inf else "unknown"
        )
        parameters.add_row(one.name, *values, error, unit)
    observed = found.observability
    title = f"{observed.rank} of {len(found.parameters)} combinations of parameters seen"
    seen = _table(title, *(f"{name}#" for name in observed.indices))
    seen.add_row(*(f"{value:.4g}" for value in observed.indices.values()))
    return [errors, parameters, seen]


def of_machines(machines: Iterable[Machine]) -> list[Table]:
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
    unit, scale = HUMAN[axis.unit]
    low, high = axis.travel
    travel = "unlimited" if high == inf else f"{scale * low:g} … {scale * high:g} {unit}"
    pulse = f"{1e6 * axis.pulse:g} µm" if axis.unit == "m" else f"{scale * axis.pulse:.4g} {unit}"
    bounds = ((axis.max_speed, "/s"), (axis.max_acceleration, "/s²"), (axis.max_jerk, "/s³"))
    return travel, pulse, *(_bound(bound, scale, f"{unit}{per}") for bound, per in bounds)


def _bound(bound: Magnitude | None, scale: float, unit: str) -> str:
    """A bound; both ways where they differ, towards smaller positions first."""
    if bound is None:
        return "unlimited"
    return f"{' / '.join(f'{scale * side:g}' for side in dict.fromkeys(sides(bound)))} {unit}"


def of_positions(listed: PositionList, file: str) -> list[Table]:
    """Each pose by its number."""
    meaning = "·".join(f"R{axis}" for axis in listed.order)
    table = _table(
        f"{file}: {len(listed)} poses from {listed.frame}, {meaning}",
        "pose#", *(f"{name} (mm)#" for name in "xyz"), *(f"θ{name} (°)#" for name in "xyz"),
    )  # fmt: skip
    for number, pose in enumerate(listed.poses.tolist(), 1):
        table.add_row(
            str(number), *(f"{1e3 * value:.6g}" for value in pose[:3]), *(f"{degrees(angle):.6g}" for angle in pose[3:])
        )
    return [table]


def _table(title: str, *columns: str) -> Table:
    """A table; a column whose name ends in # holds numbers, one that ends in ! is never broken."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        table.add_column(
            name.rstrip("#!"), justify="right" if name.endswith("#") else "left", no_wrap=name.endswith("!")
        )
    return table


def _where(place: Place) -> Sequence[str]:
    """Axis, segment, distance (mm) and time (s) of a place."""
    again = "" if place.repetition is None else f" (rep. {place.repetition})"
    segment = "" if place.segment is None else f"{place.segment}{again}"
    return place.axis, segment, f"{1e3 * place.s:.3f}", "" if place.t is None else f"{place.t:.4f}"


def _up(ratio: float, digits: int = 7) -> str:
    """A bound, rounded up, so that the text is a bound too."""
    return f"{ceil(ratio * 10**digits) / 10**digits:.{digits}f}" if ratio < inf else "∞"
