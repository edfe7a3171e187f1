"""Random programs of short segments and tiny blends, all certified: `python -m
benchmarks.evidence.trials.robust_programs`.

`--programs 200` per machine is an hour or two on two cores. Every program follows from its seed alone: 2 to 20 lines
and arcs of 1e-7 to 1e-1 m, joined by stops and by blends with tolerances of 1e-9 to 1e-3 m, some with speed caps, some
with dwells between, on the hexapod and on the linkage. What the geometry refuses (out of reach) is no fault; a motion
that is not certified is, and so is one that takes longer than stopping at every join.

Programs of ratios run on slides whose limits differ by up to 10 000, with lengths and feeds that differ as much within
one program. Each of these must also be as quick as the classical timing.
"""

from argparse import ArgumentParser
from collections import Counter
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.trials.robustness import tell_shares
from kinematics import load_machine
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.machine.machine import Machine
from planner import Arc, Blend, Dwell, Infeasible, Line, Program, Stop, Through, classical, plan

MACHINES = ("hexapod", "linkage")
# Half the edges of the box in which the path stays, about a point in the workspace, m: x, y, z from home.
BOX = {"hexapod": ([0.0, 0.0, 0.025], [0.015, 0.015, 0.01]), "linkage": ([0.0, 0.0, 0.0], [0.05, 0.05, 0.0])}
LENGTHS, TOLERANCES = (-7.0, -1.0), (-9.0, -3.0)


# Share by which a plan may take longer than one that stops at every join: what order-3 grids leave open.
MAX_EXCESS_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class ProgramAnswer:
    """What became of a program: why it failed or "", the methods of its runs, the seconds of processor time."""

    fault: str
    methods: tuple[str, ...]
    seconds: float


def random_program(seed: int, machine: str) -> Program:
    """Segments from a point in the box; one that would leave it goes anywhere in it instead."""
    rng = np.random.default_rng([seed, MACHINES.index(machine)])
    middle, half = (np.array(values) for values in BOX[machine])
    here, segments = middle.copy(), list[Line | Arc | Dwell]()
    for _ in range(int(rng.integers(2, 21))):
        way = rng.normal(size=3) * (half > 0)
        way *= 10.0 ** rng.uniform(*LENGTHS) / np.linalg.norm(way)
        join = Stop() if rng.random() < 0.15 else Blend(10.0 ** rng.uniform(*TOLERANCES))
        speed = 10.0 ** rng.uniform(-3, -1) if rng.random() < 0.2 else None
        there = here + way
        if (np.abs(there - middle) > half).any():
            there = middle + half * rng.uniform(-0.9, 0.9, 3)
        if rng.random() < 0.3 and np.linalg.norm(there - here) < half.max() / 4:  # half a turn about the middle
            centre = (here + there) / 2
            normal = np.cross(there - here, rng.normal(size=3)) if half[2] > 0 else np.array([0.0, 0.0, 1.0])
            segments.append(Arc(centre, normal / np.linalg.norm(normal), np.pi, join=join, speed=speed))
        else:
            segments.append(Line(there, join=join, speed=speed))
        here = there
        if rng.random() < 0.05:
            segments.append(Dwell(0.01))
    return Program(tuple(segments), start=RigidTransform.from_translation(middle))


# Largest ratio between two speeds, two lengths or two limits of a program.
MAX_RATIO = 1e4
# The largest of each: m; m/s of a feed; m/s, m/s² and m/s³ of an axis.
LARGEST_LENGTH, LARGEST_FEED, LARGEST_LIMITS = 0.5, 0.5, (1.0, 10.0, 1000.0)
BASELINES = {2: "trapezoid", 3: "s-curve"}


def ratio_machine(seed: int) -> Machine:
    """Return three slides whose limits differ by up to MAX_RATIO."""
    rng = np.random.default_rng([seed, 41])
    machine = copy(load_machine("cartesian"))
    shares = MAX_RATIO ** -rng.uniform(0, 1, (len(machine.axes), len(LARGEST_LIMITS)))
    axes = []
    for axis, share in zip(machine.axes, shares, strict=True):
        speed, acceleration, jerk = share * LARGEST_LIMITS
        limits = {"max_speed": speed, "max_acceleration": acceleration, "max_jerk": jerk}
        axes.append(replace(axis, travel=(-np.inf, np.inf), **limits))
    machine.axes = tuple(axes)
    return machine


def ratio_program(seed: int) -> Program:
    """Return lines and half circles whose lengths and feeds differ by up to MAX_RATIO."""
    rng = np.random.default_rng([seed, 42])
    here = np.zeros(3)
    segments: list[Line | Arc] = []
    for _ in range(int(rng.integers(3, 9))):
        length = LARGEST_LENGTH * MAX_RATIO ** -rng.uniform(0, 1)
        feed = LARGEST_FEED * MAX_RATIO ** -rng.uniform(0, 1)
        speed = feed if rng.random() < 0.7 else None
        # the tolerance of a blend is a share of the length
        join = (Stop(), Through(), Blend(length * 10.0 ** rng.uniform(-3, -1)))[rng.integers(3)]
        way = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
        there = here + length * way / np.linalg.norm(way)
        if rng.random() < 0.3:
            normal = np.cross(there - here, rng.normal(size=3))
            normal /= np.linalg.norm(normal)
            segments.append(Arc((here + there) / 2, normal, np.pi, join=join, speed=speed))
        else:
            segments.append(Line(there, join=join, speed=speed))
        here = there
    return Program(tuple(segments), start=RigidTransform.identity())


def plan_ratios(seed: int, order: int) -> ProgramAnswer:
    """Plan a program of ratios, and compare it with stops at every join and the classical timing."""
    machine, program = ratio_machine(seed), ratio_program(seed)
    answer = plan_program(program, machine, order)
    if answer.fault:
        return answer
    made = plan(program, machine, order=order)
    baseline = classical(made, BASELINES[order])
    duration = made.trajectory.duration
    if duration <= baseline.duration:
        return answer
    fault = f"takes {duration:.9g} s, and {baseline.duration:.9g} s as {baseline.kind}"
    return replace(answer, fault=fault)


def stop_everywhere(program: Program) -> Program:
    segments = (one if isinstance(one, Dwell) else replace(one, join=Stop()) for one in program.segments)
    return replace(program, segments=tuple(segments))


def plan_program(program: Program, machine: Machine, order: int) -> ProgramAnswer:
    """Planned, and held against stopping at every join; geometry's refusals are answers too."""
    begin = process_time()
    try:
        made = plan(program, machine, order=order)
    except (OutOfReach, Infeasible) as no:
        return ProgramAnswer("", (f"refused: {type(no).__name__}",), process_time() - begin)
    except MotionError as no:
        return ProgramAnswer(f"{type(no).__name__}: {no}", (), process_time() - begin)
    seconds, fault = process_time() - begin, "" if made.certificate.holds else "not certified"
    own, stopping = (one.trajectory.duration for one in (made, plan(stop_everywhere(program), machine, order=order)))
    if own > stopping * (1 + MAX_EXCESS_SHARE):
        fault = f"takes {own:.6g} s, and {stopping:.6g} s with stops at every join"
    return ProgramAnswer(fault, made.methods, seconds)


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.trials.robust_programs", description=__doc__)
    parser.add_argument("--programs", type=int, default=10, help="how many on each machine")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.programs)
    for name in MACHINES:
        machine = load_machine(name)
        for order in (2, 3):
            answers = ((seed, plan_program(random_program(seed, name), machine, order)) for seed in seeds)
            report_answers(f"{name}, order {order}", answers)
    for order in (2, 3):
        report_answers(f"ratios, order {order}", ((seed, plan_ratios(seed, order)) for seed in seeds))


def report_answers(title: str, answers: Iterable[tuple[int, ProgramAnswer]]) -> None:
    """Print the faults as they come, and a summary of the programs' runs."""
    methods, faults, count, longest = Counter[str](), 0, 0, 0.0
    for seed, answer in answers:
        count += 1
        longest = max(longest, answer.seconds)
        methods.update(answer.methods)
        if answer.fault:
            faults += 1
            print(f"{title}, seed {seed}: {answer.fault}", flush=True)
    print(
        f"{title}: {faults} of {count} at fault; {tell_shares(methods)}; "
        f"runs by method {dict(methods)}; the longest took {longest:.1f} s of processor time",
        flush=True,
    )


if __name__ == "__main__":
    main()
