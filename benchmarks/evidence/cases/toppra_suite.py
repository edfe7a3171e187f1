"""toppra's own suite of hard problems by us and by toppra.

`--suite` is `tests/tests/retime/robustness/problem_suite_1.yaml` of toppra's sources: cubic splines
through waypoints, at rest in the parameter at both ends (q′ = 0), tiny ways under huge limits, some
with a stated duration. Ours are certified. toppra solves each by those of the suite's solvers that
are installed, on all of its grids; durations are those of the finest. Uses are of q̇ and q̈ at
20 001 instants. The last column is what toppra's authors recorded next to the suite.
"""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.evidence.peers.toppra_ import PARAMETRIZERS, find_trajectory, installed_solvers
from benchmarks.evidence.table import Table
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner import Solution, time_optimal
from planner.timing.goals.stated_duration import solve_stated

INSTANTS = 20_001
COLUMNS = (
    "problem",
    "duration",
    "ours (s)",
    "largest use",
    "toppra: answers",
    "toppra (s)",
    "use, spline",
    "use, pieces",
    "recorded by toppra (s)",
)
Curve = tuple[Array, Array]
Limits = tuple[Array, Array]


def measure(suite: Path) -> Iterator[Table]:
    """Yield the table."""
    yield Table("", COLUMNS, solve_suite(suite))


def solve_suite(suite: Path) -> Iterator[list[str]]:
    """Yield a row for each problem and stated duration."""
    import yaml

    record = read_record(suite.with_name("test_robustness_main.py.result"))
    for name, problem in yaml.safe_load(suite.read_text(encoding="utf-8")).items():
        waypoints = np.array(problem["waypoints"], float)
        begin, end = problem["ss_waypoints"]
        curve = np.linspace(begin, end, len(waypoints)), waypoints
        limits = np.array(problem["vlim"], float), np.array(problem["alim"], float)
        for duration in map(float, problem["desired_duration"]):
            stated = f"{duration:g}" if duration > 0 else "least"
            ours = describe_ours(curve, limits, duration)
            theirs = describe_theirs(problem, curve, limits, duration)
            yield [name, stated, *ours, *theirs, record.get((name, duration), "")]


def solve_ours(curve: Curve, limits: Limits, duration: float) -> Solution:
    """Find our certified motion. Raises MotionError if no motion exists."""
    speed, acceleration = limits
    fastest = time_optimal(
        CubicSpline(*curve, bc_type="clamped"),
        max_speed=speed,
        max_acceleration=acceleration,
    )
    if duration == 0:
        return fastest
    bounds = zip(fastest.trajectory.path.names, speed.tolist(), acceleration.tolist(), strict=True)
    axes = [Axis(name, max_speed=v, max_acceleration=a) for name, v, a in bounds]
    return solve_stated(fastest, axes, duration)


def describe_ours(curve: Curve, limits: Limits, duration: float) -> list[str]:
    """Return our duration and the largest use of a limit."""
    try:
        solution = solve_ours(curve, limits, duration)
    except MotionError as error:
        return [f"no answer: {error}", ""]
    state = solution.trajectory.at(np.linspace(0, solution.trajectory.duration, INSTANTS))
    proved = "" if solution.certificate.holds else ", not certified"
    return [f"{solution.trajectory.duration:.9f}{proved}", largest_use(state.qd, state.qdd, limits)]


def describe_theirs(
    problem: dict[str, Any],
    curve: Curve,
    limits: Limits,
    duration: float,
) -> list[str]:
    """Return how many grids toppra has an answer on, and duration and uses on the finest."""
    try:
        solvers = [name for name in problem["solver_wrapper"] if name in installed_solvers()]
    except ImportError:
        solvers = []
    if not solvers:
        return [""] * 4
    answers = [
        [find_trajectory(curve, limits, duration, (solver, points), kind) for kind in PARAMETRIZERS]
        for solver in solvers
        for points in problem["nb_gridpoints"]
    ]
    count = f"{sum(one is not None for one, _ in answers)} of {len(answers)}"
    if answers[-1][0] is None:
        return [count, "", "", ""]
    uses = []
    for trajectory in answers[-1]:
        t = np.linspace(0.0, trajectory.duration, INSTANTS)
        uses.append(largest_use(trajectory(t, 1), trajectory(t, 2), limits))
    return [count, f"{answers[-1][0].duration:.9f}", *uses]


def largest_use(qd: Array, qdd: Array, limits: Limits) -> str:
    """Return the largest use of a limit."""
    speed, acceleration = limits
    return f"{max(np.abs(qd / speed).max(), np.abs(qdd / acceleration).max()):.6f}"


def read_record(path: Path) -> dict[tuple[str, float], str]:
    """Return what toppra's authors recorded on the finest grid, by problem and duration."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {
            (
                row["name"],
                float(row["desired_duration"]),
            ): f"{float(row['duration']):.9f}, {row['solver_wrapper']}"
            for row in csv.DictReader(file)
            if row["status"] == "SUCCESS"
        }
