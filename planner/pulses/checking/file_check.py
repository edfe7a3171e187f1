"""The check of a written file of pulses: read back, proved against the motion, and timed against the drives."""

from collections.abc import Iterator
from dataclasses import replace
from os import PathLike
from typing import Protocol

from kinematics.foundation.units import apart
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.parallel import Progress, ignore_progress
from planner.pulses.checking import check_parts
from planner.pulses.checking.edge_reader import parts
from planner.pulses.checking.verdict import LineTimes, PulseCheck, PulseFault
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import PulseSchedule

ROUNDING = 1e-12  # s by which decimal fractions may seem shorter than they are


class PlannedPulses(Protocol):
    """What a file of pulses stands for: a plan."""

    @property
    def machine(self) -> Machine: ...
    @property
    def counted(self) -> AxesMotion: ...
    @property
    def pulses(self) -> PulseSchedule: ...


def check_file(path: str | PathLike[str], plan: PlannedPulses, progress: Progress = ignore_progress) -> PulseCheck:
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
        short = tuple(_find_short_times(times, axis))
        axes.append(replace(one, lines=times, faults=one.faults + short, fault_count=one.fault_count + len(short)))
    return PulseCheck(tuple(axes))


def _find_short_times(times: LineTimes, axis: Axis) -> Iterator[PulseFault]:
    """What a drive would not see."""
    asked = axis.timing
    if asked is None:
        return
    for name in ("high", "low", "setup", "hold"):
        least, needed = getattr(times, name), getattr(asked, name)
        if least < needed - ROUNDING:
            seen, wanted = apart(1e6 * least, 1e6 * needed, digits=4)
            yield PulseFault(axis.name, 0, f"{name}: {seen} us, and its drive needs {wanted}")
