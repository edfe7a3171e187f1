"""Pulses across the seams of stops: `python -m benchmarks.evidence.trials.seams [--instants 20]`.

Of three plans, one of a machine that makes up for its play and its screws, with drives whose DIR line is set up at
once and 50 µs ahead, by every rule: stops at random instants, changes of speed on the way into them, and the way on.
The pulses that were sent before a section and its own are joined, and checked against the joined motion as those of one
plan are (`planner.pulses.checking`): each at its crossing, none too soon after another or after DIR, every count within
its bound. Rules that need the whole of a motion are checked for spacing alone: their sections begin anew.
"""

from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import ceil

import numpy as np

from kinematics import load_machine
from kinematics.foundation.errors import MotionError, attempt
from kinematics.machine.axis import DRIVES
from kinematics.machine.machine import Machine
from planner import Blend, Dwell, Line, Plan, Program, load_program, plan
from planner.interruption.section import Section
from planner.pulses import AxesMotion, PulseSchedule, generate
from planner.pulses.checking import check
from planner.pulses.checking.verdict import PulseCheck
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan
from planner.pulses.schedule import AxisPulses

RULES = (
    "nearest",
    "nearest:hysteresis=0.3",
    "floor",
    "timer",
    "sampled:period=10us",
    "dda:pulses_per_count=1,spacing=1ms",
)
WHOLE_RULES = ("sampled", "dda")
TIMINGS = (None, "DRV8825", "Pacific-6410")
PERIOD = 1e-6
"""s, of which instants are whole multiples: so that the timer's own clock goes on."""
SHARES = (0.4, 1.0)
"""Of the plan's speed, that stops are left with."""
SAME_PLACE = 1e-12
"""m by which a section may end beside where it says."""
PLAY, SCREW = 2e-5, ((0.0, 0.0), (0.02, 1e-5), (0.04, -1e-5), (0.09, 2e-5))
"""m of the worn machine's axes."""
CORNERS = ((0.045, 0.03), (0.02, 0.045), (0.01, 0.01), (0.03, 0.0), (0.0, 0.0))


def list_cases() -> Iterator[tuple[str, Program, Machine]]:
    """A circle on a hexapod, blended lines on a CoreXY, lines with rests where that makes up for play and screws."""
    yield "circle on a hexapod", load_program("circle"), load_machine("hexapod")
    corners = [np.array([*corner, 0.0]) for corner in CORNERS]
    lines = [Line(to=corner, join=Blend(5e-4)) for corner in corners]
    yield "blends on a CoreXY", Program((*lines[:-1], Line(to=np.zeros(3)))), load_machine("corexy")
    worn = load_machine("corexy")
    worn.axes = tuple(
        replace(axis, backlash=PLAY, lead_error=SCREW, compensate=("lead", "backlash")) for axis in worn.axes
    )
    rests = [part for corner in corners for part in (Line(to=corner), Dwell(0.05))]
    yield "a worn CoreXY", Program(tuple(rests)), worn


Run = tuple[AxesMotion, PulseSchedule, float]
"""What is counted, its pulses, and until when (s) it runs."""


def join(*runs: Run) -> tuple[PulseSchedule, AxesMotion]:
    """Motions that each go on from the midst of the one before, and what was sent of them, as those of one motion."""
    clock = runs[0][1].clock_hz
    last, begin = runs[-1][1], 0
    ticks: list[list[np.ndarray]] = [[] for _ in last.axes]
    directions: list[list[np.ndarray]] = [[] for _ in last.axes]
    for _, pulses, until in runs:
        end = round(until * clock) if pulses is not last else np.iinfo(np.int64).max
        for k, axis in enumerate(pulses.axes):
            sent = axis.ticks < end
            ticks[k].append(axis.ticks[sent] + begin)
            directions[k].append(axis.direction[sent])
        begin += end if pulses is not last else 0
    moves = [move for _, pulses, _ in runs for move in pulses.moves]
    axes = []
    for k, axis in enumerate(runs[0][1].axes):
        own = [move for move in moves if move.axis == axis.name]
        bounds = [pulses.axes[k].bound - max((m.error for m in pulses.moves if m.axis == axis.name), default=0.0)
                  for _, pulses, _ in runs]  # fmt: skip
        bound = min(bounds) + max((move.error for move in own), default=0.0)
        axes.append(AxisPulses(axis.name, np.concatenate(ticks[k]), np.concatenate(directions[k]), axis.start,
                               axis.pulse, axis.home, bound))  # fmt: skip
    merged = []
    for name in {move.axis: None for move in moves}:
        own = [move for move in moves if move.axis == name]
        worst = max(own, key=lambda move: move.error)
        many, longest = sum(move.pulses for move in own), max(move.time for move in own)
        merged.append(replace(worst, pulses=many, time=longest))
    motion = JoinedMotion.of(*(MotionSpan(motion, 0.0, until) for motion, _, until in runs))
    return PulseSchedule(clock, tuple(axes), motion.duration, runs[0][1].rule, tuple(merged)), motion


@dataclass
class SeamTally:
    """What became of the sections of a case: how many there are, were refused, and are at fault."""

    sections: int = 0
    refused: int = 0
    faulty: int = 0

    def add(self, made: Plan, section: Section | MotionError, *before: Run) -> Section | None:
        if isinstance(section, MotionError):
            if "rests there" not in str(section) and "path ends there" not in str(section):
                self.refused += 1
                print(f"  refused: {section}", flush=True)
            return None
        self.sections += 1
        faults = find_faults(made, section, *before)
        if faults:
            self.faulty += 1
            print(f"  {section.what} at {section.at} s: {faults[0]}", flush=True)
        return section


def find_faults(made: Plan, section: Section, *before: Run) -> list[str]:
    """What is wrong of the pulses that were sent before a section and its own, joined."""
    pulses, machine = section.pulses, made.machine
    sent = [int(axis.counts([round(before[-1][2] * pulses.clock_hz) - 1])[0]) for axis in before[-1][1].axes]
    if [axis.start for axis in pulses.axes] != sent:
        return [f"starts at {[axis.start for axis in pulses.axes]}, sent were {sent}"]
    end = section.since + float(section.trajectory.at(section.trajectory.duration).along[0])
    if abs(end - section.until) > SAME_PLACE:
        return [f"ends at {end} m, not at {section.until}"]
    own = (section.counted, pulses, section.duration)
    found: PulseCheck = check(*join(*before, own), machine.axes, machine.home_q)
    faults = [fault for axis in found.axes for fault in axis.faults]
    if pulses.rule.startswith(WHOLE_RULES):
        faults = [fault for fault in faults if "spacing" in fault.what or "set-up" in fault.what]
    return [f"{fault.axis} at tick {fault.tick}: {fault.what}" for fault in faults]


def try_seams(made: Plan, instants: int, rng: np.random.Generator) -> SeamTally:
    """Stops at random instants; on the way into each a change of speed; the way on behind each."""
    tally = SeamTally()
    for t in np.round(rng.uniform(0, made.duration, instants) / PERIOD) * PERIOD:
        before = (made.counted, made.pulses, float(t))
        held = tally.add(made, attempt(partial(made.hold, float(t))), before)
        if held is None:
            continue
        later = round(float(rng.uniform(0, held.duration)) / PERIOD) * PERIOD
        if 0 < later < held.duration:
            changed = attempt(partial(made.override, float(rng.choice(SHARES)), later, held))
            tally.add(made, changed, before, (held.counted, held.pulses, later))
        end = ceil(held.duration / PERIOD + 1) * PERIOD  # it rests until then
        tally.add(made, attempt(partial(made.resume, held)), before, (held.counted, held.pulses, end))
    return tally


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=20)
    asked, whole = parser.parse_args(), SeamTally()
    for name, program, machine in list_cases():
        for timing in TIMINGS:
            drive = None if timing is None else DRIVES[timing]
            machine.axes = tuple(replace(axis, timing=drive) for axis in machine.axes)
            made = plan(program, machine)
            for rule in RULES:
                pulses = generate(made.counted, machine.axes, machine.home_q, made.pulses.clock_hz, rule)
                tally = try_seams(replace(made, pulses=pulses), asked.instants, np.random.default_rng(19))
                print(f"{name}, {timing}, {rule}: {tally}", flush=True)
                whole.sections += tally.sections
                whole.refused += tally.refused
                whole.faulty += tally.faulty
    print(f"{whole.sections} sections, {whole.refused} refused, {whole.faulty} whose pulses are at fault")


if __name__ == "__main__":
    main()
