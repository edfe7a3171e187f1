"""Order 3: duration against intervals, on our grids and on even ones.

The circle and a blended polyline of 60 lines on the hexapod, and the spline through 50 waypoints.
Ours: as every run is solved, with a part or a multiple of the intervals. Even: as many along the
path, and the breaks between its pieces. All are solved until no limit is exceeded between grid
points either, so that each duration is possible.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.peers.problems import PathProblem, circle, spline
from benchmarks.evidence.table import Row, Table
from kinematics import load_machine
from kinematics.foundation.errors import require
from planner import Blend, Line, Program
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing.certified_run import tighten_until_kept
from planner.timing.discretization import (
    ROUGH_GRID,
    THIRD_ORDER,
    Rule,
    coarse_jerk_problem,
    jerk_problem,
)
from planner.timing.jerk_limited import look_along, place_by_loss
from planner.timing.problem import Run, make_grid, pose_problem
from planner.timing.solvers.third_order import solve_jerk_limited

# Multiples of the intervals that a run is solved on.
SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)
OURS, EVEN = "ours", "even"
# m: length and height of a polyline's lines, tolerance of its blends; rad: largest turn of a line.
STEP, HEIGHT, BLEND, TURN = 4e-4, 25e-3, 2e-5, 0.6


@dataclass(frozen=True, slots=True)
class GridAnswer:
    """Duration (s) of a motion on a grid; method: how it was solved, and whether it was slowed."""

    grid: str
    intervals: int
    duration: float
    method: str


def walk(lines: int) -> Program:
    """Return a random walk of blended lines, each turned a little from the line before."""
    angle = np.cumsum(np.random.default_rng(0).uniform(-TURN, TURN, lines))
    x, y = STEP * np.cumsum([np.cos(angle), np.sin(angle)], axis=1)
    ends = np.column_stack([x, y, np.full(lines, HEIGHT)])
    segments = [Line(end, join=Blend(BLEND)) for end in ends[:-1]]
    start = RigidTransform.from_translation([0.0, 0.0, HEIGHT])
    return Program((*segments, Line(ends[-1])), start=start)


def polyline(lines: int = 60) -> PathProblem:
    """Return the walk on the hexapod."""
    machine = load_machine("hexapod")
    return PathProblem(f"blended polyline, {lines} lines", actuate(walk(lines), machine), machine.axes)


def compare(case: PathProblem, shares: Sequence[float] = SHARES) -> Iterator[GridAnswer]:
    """Yield the answers of both grids for each share of the intervals that has a grid of ours."""
    path = case.path
    limits = limits_of(path, case.axes, 3)
    run = Run(0, len(path.breaks) - 2)
    look = look_along(path, limits)
    coarse = coarse_jerk_problem(path, limits, run)
    _, start = require(jerk_problem(path, limits, run, coarse))
    for share in shares:
        rough, fine = scale_rule(ROUGH_GRID, share), scale_rule(THIRD_ORDER, share)
        placed = require(place_by_loss(path, limits, run, coarse, rough, fine))
        # the rough answer says too little about what a finer grid would gain
        if placed is None:
            continue
        ours, motion = placed
        grid = make_grid(path, run, ours.intervals)
        even = pose_problem(path, limits, *grid, run.speeds, run.stands)
        for name, problem, guess in (
            (OURS, ours, motion.on(ours.s)),
            (EVEN, even, start.on(even.s)),
        ):
            kind: Literal["finer", "far"] = "finer" if name == OURS else "far"
            solution = solve_jerk_limited(problem, guess, kind, look)
            solution = tighten_until_kept(path, limits, solution)
            solution.require_profile()
            yield GridAnswer(name, problem.intervals, solution.duration, solution.method)


def scale_rule(rule: Rule, share: float) -> Rule:
    least, per_piece, per_radian = (max(1, round(share * count)) for count in rule)
    return least, per_piece, per_radian


def measure() -> Iterator[Table]:
    """Yield the table of each path."""
    columns = ("grid", "intervals", "duration (s)", "above the shortest (%)", "method")
    for case in (circle(), spline(), polyline()):
        motions = list(compare(case))
        shortest = min(motion.duration for motion in motions)
        rows: list[Row] = []
        for motion in motions:
            excess = 100 * (motion.duration / shortest - 1)
            rows.append([motion.grid, motion.intervals, motion.duration, excess, motion.method])
        yield Table(case.name, columns, rows)
