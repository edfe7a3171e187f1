"""What the thesis does not print, varied: the rig as stated, and rigs that differ from it by one assumption each.

Of its program [Sahbaz 2007, Appendix E] three things are printed whose meaning is not: `SetContinuousMove(axis, 1)` for
every axis before the first command, v(k − 1) read by `GetCurrentSpeed`, and `SDStop(axis, 0.001)` after the last
sample. The last is done as printed; the others have two readings each (`READINGS`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

from controllers.motions import along
from controllers.rig import Rig, disturbed, load_rig
from controllers.task import Task
from planner.actuation import MachinePath
from planner.trajectory import Trajectory

TASK = "line"
"""The thesis' reference."""
CLOSING_STOP = 1e-3
"""s: `Tacc` of [Sahbaz 2007, Appendix E], within which its program stops the axes after the last sample."""
QUEUED = "SetContinuousMove: commands queue behind a running move"
UNSIGNED = "GetCurrentSpeed: the card's rate without its sign"
BOTH = "both: commands queue, and the rate has no sign"
STATED = "as stated"
READINGS = (STATED, QUEUED, UNSIGNED, BOTH)
"""Assumptions that are readings of what the program prints: a command replaces the running move, or queues behind it;
the rate has the sign of its direction, or none."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """One reading of what is not printed: `rig` runs `task`."""

    name: str
    rig: Rig
    task: Task


def assumptions(rig: Rig | None = None) -> tuple[Assumption, ...]:
    """The rig as it is stated first, then one assumption changed at a time."""
    return tuple(_varied(printed(rig or load_rig("servo-rig"))))


def printed(rig: Rig) -> Rig:
    """The rig under a host that reads and ends as the printed program does."""
    return replace(rig, host=replace(rig.host, speed_from="card", closing_stop=CLOSING_STOP))


def _varied(rig: Rig) -> Iterator[Assumption]:
    task = rig.task(TASK)

    def other(name: str, changed: Rig, asked: Task = task) -> Assumption:
        return Assumption(name, changed, asked)

    queue = replace(rig.card, while_moving="queue")
    yield other(STATED, rig)
    yield other(QUEUED, replace(rig, card=queue))
    yield other(UNSIGNED, replace(rig, card=replace(rig.card, current_speed="magnitude")))
    yield other(BOTH, replace(rig, card=replace(queue, current_speed="magnitude")))
    encoders = replace(rig, host=replace(rig.host, speed_from="encoder"))
    yield other("the speed of the encoders instead of the card's rate", encoders)
    yield other("no closing stop: laws go on after the end", replace(rig, host=replace(rig.host, closing_stop=None)))
    going_on = replace(rig, card=replace(rig.card, start_from="current"))
    yield other("commands begin at the speed of the instant", going_on)
    in_time = replace(rig, card=replace(rig.card, short_moves="keep time"))
    yield other("moves too short for their ramps keep the ramps' time", in_time)
    yield other("speeds that are not rounded to registers", replace(rig, card=replace(rig.card, speed_range=None)))
    yield other("encoder behind the gear", _drives(rig, feedback=lambda drive: "output"))
    yield other("no play", _drives(rig, play=lambda drive: 0.0))
    yield other("play of 20 arcmin", _drives(rig, play=lambda drive: 10 * drive.play))
    yield other("no friction", disturbed(rig, friction=0.0))
    yield other("twice the friction", disturbed(rig, friction=2.0))
    yield other("true inertia 30 % less", disturbed(rig, inertia=0.7))
    yield other("true inertia 30 % more", disturbed(rig, inertia=1.3))
    yield other("drives without delay", _drives(rig, command_delay=lambda drive: 0))
    yield other("drives 5 ms late", _drives(rig, command_delay=lambda drive: 20))
    yield other("a timer of 1 ms instead of 10 ms", replace(rig, host=replace(rig.host, granularity=1e-3)))
    for share in (0.1, 0.5):
        yield other(f"ramps of {100 * share:.0f} % of the time", rig, _ramped(task, share))
    yield other("other motions of the joints: the circle", rig, rig.task("circle"))


def _drives(rig: Rig, **changes: Callable[[Any], object]) -> Rig:
    """The rig with fields of its drives made anew from each drive."""
    changed = (
        replace(drive, **cast(Any, {name: make(drive) for name, make in changes.items()})) for drive in rig.drives
    )
    return replace(rig, drives=tuple(changed))


def _ramped(task: Task, share: float) -> Task:
    """The task's path in the same time, by ramps of another share of it."""
    motion = cast(Trajectory, task.motion)
    return replace(task, motion=along(cast(MachinePath, motion.path), "quarter-sine", share, motion.duration))
