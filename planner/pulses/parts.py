"""A schedule in parts that follow each other in time: joined, or compared without ever being whole."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from planner.pulses.schedule import PulseSchedule


def joined(parts: Iterable[PulseSchedule]) -> PulseSchedule:
    """The whole of one or more parts: what holds for all of it is the last's, start counts are the first's."""
    held = list(parts)
    axes = tuple(
        replace(
            each[0],
            ticks=np.concatenate([axis.ticks for axis in each]),
            direction=np.concatenate([axis.direction for axis in each]),
        )
        for each in zip(*(part.axes for part in held), strict=True)
    )
    return replace(held[-1], axes=axes)


def same(schedule: PulseSchedule, parts: Iterable[PulseSchedule]) -> bool:
    """The parts hold exactly the pulses of a schedule."""
    done = [0] * len(schedule.axes)
    for part in parts:
        for k, (got, axis) in enumerate(zip(part.axes, schedule.axes, strict=True)):
            here = slice(done[k], done[k] + len(got))
            if not np.array_equal(got.ticks, axis.ticks[here]):
                return False
            if not np.array_equal(got.direction, axis.direction[here]):
                return False
            done[k] += len(got)
    return done == [len(axis) for axis in schedule.axes]
