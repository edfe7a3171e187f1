"""The tables of a pulse schedule: its pulses, what the drives' timing moved, and what is made up for."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from kinematics.table import Column, Table

if TYPE_CHECKING:
    from planner.pulses.schedule import PulseSchedule

EITHER = "m or rad"
BESIDE = "of the counts at all times, and what the axis moves in one tick of the clock beside"


def tables(schedule: "PulseSchedule", units: Mapping[str, str]) -> Iterator[Table]:
    """units: m or rad by axis, where it is known. What costs nothing has no table."""
    axes = schedule.axes
    yield Table(
        f"pulses by the rule {schedule.rule}, on a clock of {schedule.clock_hz / 1e6:g} MHz",
        (
            Column("axis", [axis.name for axis in axes]),
            Column("pulses", [len(axis) for axis in axes]),
            Column("net count", [axis.final - axis.start for axis in axes]),
            Column("error ≤", [axis.bound for axis in axes], "pulses", form=".3f", up=True),
        ),
        (f"{schedule.total} pulses of all axes", f"error: {BESIDE}"),
    )
    if moved := schedule.moves:
        yield Table(
            "moved apart, as the axes take them",
            (
                Column("axis", [one.axis for one in moved]),
                Column("pulses", [one.pulses for one in moved]),
                Column("by at most", [one.time for one in moved], "s", "micro", ".3f"),
                Column("error ≤", [one.error for one in moved], "pulses", form=".4f", up=True),
                Column(
                    "length ≤",
                    [one.length for one in moved],
                    [units.get(one.axis, EITHER) for one in moved],
                    "micro",
                    ".4f",
                    up=True,
                ),
            ),
        )
    if costs := [cost for cost in schedule.compensations if cost.kinds]:
        own = [units.get(cost.axis, EITHER) for cost in costs]
        rates = {
            "speed": ([cost.speed for cost in costs], [cost.max_speed for cost in costs], "/s"),
            "acceleration": ([cost.acceleration for cost in costs], [cost.max_acceleration for cost in costs], "/s^2"),
        }
        yield Table(
            "made up for",
            (
                Column("axis", [cost.axis for cost in costs]),
                Column("kinds", [" and ".join(cost.kinds) for cost in costs]),
                Column("reversals", [cost.crossings for cost in costs]),
                Column("off by ≤", [cost.off for cost in costs], own, "micro", ".3f", up=True),
            ),
        )
        yield Table(
            "the motors while they cross the play, beside what is certified",
            (
                Column("axis", [cost.axis for cost in costs]),
                *(
                    Column(f"{name}{of}", values, [f"{unit}{per}" for unit in own], "human", ".3f")
                    for name, (reached, limits, per) in rates.items()
                    for of, values in (("", reached), (" limit", limits))
                ),
                Column("jerk", [cost.jerk for cost in costs], [f"{unit}/s^3" for unit in own], "human", ".3g"),
            ),
        )


def every_pulse(schedule: "PulseSchedule") -> Table:
    """A row for each pulse, in the order of time: its tick and time, which axis, which way in q, and its count then."""
    axes = schedule.axes
    ticks = np.concatenate([axis.ticks for axis in axes])
    whose = np.repeat(np.arange(len(axes)), [len(axis) for axis in axes])
    counts = np.concatenate([axis.start + np.cumsum(axis.direction, dtype=np.int64) for axis in axes])
    order = np.lexsort((whose, ticks))
    return Table(
        f"pulses by the rule {schedule.rule}",
        (
            Column("tick", ticks[order]),
            Column("t", ticks[order] / schedule.clock_hz, "s"),
            Column("axis", np.array([axis.name for axis in axes], dtype=object)[whose[order]]),
            Column("direction", np.concatenate([axis.direction for axis in axes])[order]),
            Column("count", counts[order]),
        ),
    )
