"""Random programs of lines and arcs, each from its seed alone, and machines of other ratios."""

from copy import copy
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.machine.machine import Machine
from planner import Arc, Blend, Dwell, Line, Program, Stop, Through

BOX = {
    "hexapod": ([0.0, 0.0, 0.025], [0.015, 0.015, 0.01]),
    "linkage": ([0.0, 0.0, 0.0], [0.05, 0.05, 0.0]),
}
"""Middle of the box in which a path stays, and half the lengths of its edges, m from home."""
MACHINES = tuple(BOX)

MAX_RATIO = 1e4
"""Largest ratio between two speeds, two lengths or two limits of a program of ratios."""
LARGEST_LENGTH = 0.5  # m
LARGEST_FEED = 0.5  # m/s
LARGEST_LIMITS = (1.0, 10.0, 1000.0)  # m/s, m/s², m/s³


def random_program(seed: int, machine: str) -> Program:
    """Draw 2 to 20 lines and arcs of 1e-7 to 0.1 m with tiny blends, some stops and dwells.

    A segment that would leave the box goes anywhere in it instead.
    """
    rng = np.random.default_rng([seed, MACHINES.index(machine)])
    middle, half = (np.array(values) for values in BOX[machine])
    here = middle.copy()
    segments: list[Line | Arc | Dwell] = []
    for _ in range(int(rng.integers(2, 21))):
        way = rng.normal(size=3) * (half > 0)
        way *= 10.0 ** rng.uniform(-7, -1) / np.linalg.norm(way)
        join = Stop() if rng.random() < 0.15 else Blend(10.0 ** rng.uniform(-9, -3))
        speed = 10.0 ** rng.uniform(-3, -1) if rng.random() < 0.2 else None
        there = here + way
        if (np.abs(there - middle) > half).any():
            there = middle + half * rng.uniform(-0.9, 0.9, 3)
        if rng.random() < 0.3 and np.linalg.norm(there - here) < half.max() / 4:
            segment = draw_half_turn(rng, here, there, flat=half[2] == 0)
        else:
            segment = Line(there)
        segments.append(replace(segment, join=join, speed=speed))
        here = there
        if rng.random() < 0.05:
            segments.append(Dwell(0.01))
    return Program(tuple(segments), start=RigidTransform.from_translation(middle))


def draw_half_turn(
    rng: np.random.Generator,
    here: Array,
    there: Array,
    *,
    flat: bool = False,
) -> Line | Arc:
    """Return half a circle between two points, in the plane z = 0 or in a random one."""
    normal = np.array([0.0, 0.0, 1.0]) if flat else np.cross(there - here, rng.normal(size=3))
    return Arc((here + there) / 2, normal / np.linalg.norm(normal), np.pi)


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
        segment = draw_half_turn(rng, here, there) if rng.random() < 0.3 else Line(there)
        segments.append(replace(segment, join=join, speed=speed))
        here = there
    return Program(tuple(segments), start=RigidTransform.identity())


def stop_everywhere(program: Program) -> Program:
    """Return the program with a stop at every join."""
    segments = []
    for segment in program.segments:
        stopping = segment if isinstance(segment, Dwell) else replace(segment, join=Stop())
        segments.append(stopping)
    return replace(program, segments=tuple(segments))
