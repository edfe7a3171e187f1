"""Rigs that differ by one assumption each about what [Sahbaz 2007] does not print.

Its program [Sahbaz 2007, Appendix E] contains three calls whose meaning is not printed:
`SetContinuousMove(axis, 1)` for every axis before the first command, `GetCurrentSpeed`, which reads
v(k − 1), and `SDStop(axis, 0.001)` after the last sample. The last is done as printed; the others
have two readings each (`READINGS`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

from controllers.rig import Rig, Task, disturb_rig, time_path
from controllers.rig_file import load_rig
from planner.path.actuation import MachinePath
from planner.trajectory import Trajectory

TASK = "line"
"""The thesis' reference."""
CLOSING_STOP = 1e-3
"""s: `Tacc` of [Sahbaz 2007, Appendix E], within which its program stops the axes after the last
sample.
"""

STATED = "as stated"
QUEUED = "SetContinuousMove: commands queue behind a running move"
UNSIGNED = "GetCurrentSpeed: the card's rate without its sign"
BOTH = "both: commands queue, and the rate has no sign"
READINGS = (STATED, QUEUED, UNSIGNED, BOTH)
"""Assumptions that are readings of the printed program: a command replaces the running move, or
queues behind it; the rate has the sign of its direction, or none.
"""


@dataclass(frozen=True, slots=True)
class Assumption:
    """An assumption about the rig or its task: `rig` runs `task`."""

    name: str
    rig: Rig
    task: Task


def assumptions() -> list[Assumption]:
    """Return the rig as stated first, then one assumption changed at a time."""
    stated = load_rig("servo-rig")
    # the printed program reads the card's speed, and stops the axes at the end
    host = replace(stated.host, speed_from="card", closing_stop=CLOSING_STOP)
    rig = replace(stated, host=host)
    task = rig.task(TASK)
    motion = cast(Trajectory, task.motion)
    path = cast(MachinePath, motion.path)
    changed = [Assumption(name, other, task) for name, other in vary_rig(rig)]
    for share in (0.1, 0.5):
        ramps = time_path(path, "quarter-sine", share, motion.duration)
        name = f"ramps of {100 * share:.0f} % of the time"
        changed.append(Assumption(name, rig, replace(task, motion=ramps)))
    circle = Assumption("other motions of the joints: the circle", rig, rig.task("circle"))
    return [*changed, circle]


def vary_rig(rig: Rig) -> Iterator[tuple[str, Rig]]:
    """Yield the names and rigs of the assumptions about card, host and drives."""

    def card(**changes: Any) -> Rig:
        return replace(rig, card=replace(rig.card, **changes))

    def host(**changes: Any) -> Rig:
        return replace(rig, host=replace(rig.host, **changes))

    def drives(change: Callable[[Any], Any]) -> Rig:
        return replace(rig, drives=tuple(map(change, rig.drives)))

    yield STATED, rig
    yield QUEUED, card(while_moving="queue")
    yield UNSIGNED, card(current_speed="magnitude")
    yield BOTH, card(while_moving="queue", current_speed="magnitude")
    yield "the speed of the encoders instead of the card's rate", host(speed_from="encoder")
    yield "no closing stop: laws go on after the end", host(closing_stop=None)
    yield "commands begin at the speed of the instant", card(start_from="current")
    yield "moves too short for their ramps keep the ramps' time", card(short_moves="keep time")
    yield "speeds that are not rounded to registers", card(speed_range=None)
    yield "encoder behind the gear", drives(lambda drive: replace(drive, feedback="output"))
    yield "no play", drives(lambda drive: replace(drive, play=0.0))
    yield "play of 20 arcmin", drives(lambda drive: replace(drive, play=10 * drive.play))
    yield "no friction", disturb_rig(rig, friction=0.0)
    yield "twice the friction", disturb_rig(rig, friction=2.0)
    yield "true inertia 30 % less", disturb_rig(rig, inertia=0.7)
    yield "true inertia 30 % more", disturb_rig(rig, inertia=1.3)
    yield "drives without delay", drives(lambda drive: replace(drive, command_delay=0))
    yield "drives 5 ms late", drives(lambda drive: replace(drive, command_delay=20))
    yield "a timer of 1 ms instead of 10 ms", host(granularity=1e-3)
