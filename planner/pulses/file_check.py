"""The check of a written file of pulses: read back, proved against the motion, and timed against the drives."""

from collections.abc import Iterator
from dataclasses import replace
from os import PathLike
from typing import Protocol

from kinematics.axis import Axis
from kinematics.machine import Machine
from kinematics.units import apart
from planner.parallel import Progress, silent
from planner.pulses.check import check_parts
from planner.pulses.lines import parts
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule
from planner.pulses.verdict import LineTimes, PulseCheck, PulseFault

ROUNDING = 1e-12  # s by which decimal fractions may seem shorter than they are


class Planned(Protocol):
    """What a file of pulses stands for: a plan."""

    @property
    def machine(self) -> Machine: ...
    @property
    def counted(self) -> Motion: ...
    @property
    def pulses(self) -> PulseSchedule: ...


def check_file(path: str | PathLike[str], plan: Planned, progress: Progress = silent) -> PulseCheck:
    """Prove a pulse CSV: its pulses as `check` does, and the times on its lines against what each drive asks.

    Only the edges come from the file, part by part; start counts, duration, rule and bounds, which it cannot hold, from
    the plan. progress is told how much of the file is done. Raises FileError where it cannot be read.
    """
    stated, machine = plan.pulses, plan.machine
    lined: tuple[LineTimes, ...] = ()

    def pulses() -> Iterator[PulseSchedule]:
        nonlocal lined
        for part in parts(path, stated.clock_hz, machine.axes, machine.home_q, tell=progress):
            lined = part.times
            yield part.schedule

    found = check_parts(stated, pulses(), plan.counted, machine.axes, machine.home_q)
    axes = []
    for one, times, axis in zip(found.axes, lined, machine.axes, strict=True):
        short = tuple(_short(times, axis))
        axes.append(replace(one, lines=times, faults=one.faults + short, fault_count=one.fault_count + len(short)))
    return PulseCheck(tuple(axes))


def _short(times: LineTimes, axis: Axis) -> Iterator[PulseFault]:
    """What a drive would not see."""
    asked = axis.timing
    if asked is None:
        return
    for name in ("high", "low", "setup", "hold"):
        least, needed = getattr(times, name), getattr(asked, name)
        if least < needed - ROUNDING:
            seen, wanted = apart(1e6 * least, 1e6 * needed, digits=4)
            yield PulseFault(axis.name, 0, f"{name}: {seen} us, and its drive needs {wanted}")
