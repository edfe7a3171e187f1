"""Random programs of short segments and tiny blends, all certified: `python -m
benchmarks.evidence.trials.robust_programs`.

`--programs 200` per machine is an hour or two on two cores. Every program follows from its seed alone: 2 to 20 lines
and arcs of 1e-7 to 1e-1 m, joined by stops and by blends with tolerances of 1e-9 to 1e-3 m, some with speed caps, some
with dwells between, on the hexapod and on the linkage. What the geometry refuses (out of reach) is no fault; a motion
that is not certified is, and so is one that takes longer than stopping at every join.
"""

from argparse import ArgumentParser
from collections import Counter
from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.trials.robustness import tell_shares
from kinematics import load_machine
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.machine.machine import Machine
from planner import Arc, Blend, Dwell, Infeasible, Line, Program, Stop, plan

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
    for name in MACHINES:
        machine = load_machine(name)
        for order in (2, 3):
            methods, faults, longest = Counter[str](), 0, 0.0
            for seed in range(asked.first, asked.first + asked.programs):
                found = plan_program(random_program(seed, name), machine, order)
                longest = max(longest, found.seconds)
                methods.update(found.methods)
                if found.fault:
                    faults += 1
                    print(f"{name}, order {order}, seed {seed}: {found.fault}", flush=True)
            print(
                f"{name}, order {order}: {faults} of {asked.programs} at fault; {tell_shares(methods)}; "
                f"runs by method {dict(methods)}; "
                f"the longest took {longest:.1f} s of processor time",
                flush=True,
            )


if __name__ == "__main__":
    main()
