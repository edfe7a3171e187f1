"""toppra's own suite of hard problems, ours beside toppra: `python -m benchmarks.evidence.peers.toppra_suite FILE`.

FILE is `tests/tests/retime/robustness/problem_suite_1.yaml` of toppra's sources: cubic splines through waypoints that
stand still at both ends (q′ = 0), tiny ways under huge limits on speed and acceleration, some with a duration that is
to be met. Each is solved by ours once, certified, and by toppra with all of the suite's solvers that are installed and
all its numbers of grid points; of these the last, the finest, is shown. Uses of the limits are those of the axes' own q̇
and q̈ at 20 001 instants: of toppra's trajectory as its user gets it by default, a spline, and of the pieces of constant
acceleration that it makes on request. Last stands what toppra's authors recorded of their own run, beside the suite.
"""

import csv
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.evidence.peers.case import is_installed
from benchmarks.evidence.published.compared import markdown
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner import Solution, time_optimal
from planner.timing.stated_duration import solve_stated

INSTANTS = 20_001
KINDS = {"spline": "ParametrizeSpline", "pieces": "ParametrizeConstAccel"}
RECORD = "test_robustness_main.py.result"


@dataclass(frozen=True, slots=True)
class HardProblem:
    """Waypoints (N, n) over a parameter from begin to end; duration: s that it shall take, 0: the least."""

    name: str
    waypoints: Array
    begin: float
    end: float
    speed: Array
    acceleration: Array
    duration: float
    points: tuple[int, ...] = ()
    solvers: tuple[str, ...] = ()

    @property
    def parameter(self) -> Array:
        return np.linspace(self.begin, self.end, len(self.waypoints))

    def use(self, qd: Array, qdd: Array) -> float:
        return float(max(np.abs(qd / self.speed).max(), np.abs(qdd / self.acceleration).max()))


def read_problems(path: Path) -> list[HardProblem]:
    import yaml

    return [
        HardProblem(
            name,
            np.array(stated["waypoints"], float),
            float(stated["ss_waypoints"][0]),
            float(stated["ss_waypoints"][1]),
            np.array(stated["vlim"], float),
            np.array(stated["alim"], float),
            float(duration),
            tuple(stated["nb_gridpoints"]),
            tuple(stated["solver_wrapper"]),
        )
        for name, stated in yaml.safe_load(path.read_text(encoding="utf-8")).items()
        for duration in stated["desired_duration"]
    ]


def solve_ours(problem: HardProblem) -> Solution:
    """Certified; raises MotionError where it cannot be."""
    curve = CubicSpline(problem.parameter, problem.waypoints, bc_type="clamped")
    found = time_optimal(curve, max_speed=problem.speed, max_acceleration=problem.acceleration)
    if problem.duration == 0:
        return found
    path, bounds = found.trajectory.path, zip(problem.speed.tolist(), problem.acceleration.tolist(), strict=True)
    axes = [
        Axis(name, max_speed=speed, max_acceleration=acceleration)
        for name, (speed, acceleration) in zip(path.names, bounds, strict=True)
    ]
    return solve_stated(path, found.limits, axes, 2, problem.duration)


def tell_ours(problem: HardProblem) -> dict[str, str]:
    try:
        found = solve_ours(problem)
    except MotionError as no:
        return {"ours (s)": f"no answer: {no}", "largest use": ""}
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, INSTANTS))
    proved = "" if found.certificate.holds else ", not certified"
    return {
        "ours (s)": f"{found.trajectory.duration:.9f}{proved}",
        "largest use": f"{problem.use(state.qd, state.qdd):.6f}",
    }


def tell_theirs(problem: HardProblem) -> dict[str, str]:
    """Of each of the suite's solvers that is installed: how many grids it answers, and the finest of them."""
    import toppra

    toppra.setup_logging("CRITICAL")
    there = {name for name, installed in toppra.solverwrapper.available_solvers(output_msg=False) if installed}
    found = dict[str, str]()
    for solver in problem.solvers:
        if solver in there:
            answers = [[solve_by_toppra(problem, solver, points, kind) for kind in KINDS] for points in problem.points]
            found[f"{solver}: answers"] = f"{sum(one[0] is not None for one in answers)} of {len(answers)}"
            found[f"{solver} (s)"] = "" if answers[-1][0] is None else f"{answers[-1][0].duration:.9f}"
            for kind, trajectory in zip(KINDS, answers[-1], strict=True):
                found[f"use, {kind}"] = "" if trajectory is None else f"{_use(problem, trajectory):.6f}"
    return found


def solve_by_toppra(problem: HardProblem, solver: str, points: int, kind: str) -> Any:
    """toppra's trajectory, None where it finds none."""
    import toppra
    from toppra import algorithm, constraint

    limits = [
        constraint.JointVelocityConstraint(np.stack([-problem.speed, problem.speed], 1)),
        constraint.JointAccelerationConstraint(
            np.stack([-problem.acceleration, problem.acceleration], 1),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    path = toppra.SplineInterpolator(problem.parameter, problem.waypoints, bc_type="clamped")
    grid = np.linspace(problem.begin, problem.end, points)
    method = algorithm.TOPPRAsd if problem.duration > 0 else algorithm.TOPPRA
    instance = method(limits, path, gridpoints=grid, solver_wrapper=solver, parametrizer=KINDS[kind])
    if problem.duration > 0:
        instance.set_desired_duration(problem.duration)
    return instance.compute_trajectory(0, 0)


def _use(problem: HardProblem, trajectory: Any) -> float:
    t = np.linspace(0.0, trajectory.duration, INSTANTS)
    return problem.use(trajectory(t, 1), trajectory(t, 2))


def read_record(path: Path) -> dict[tuple[str, float], str]:
    """What toppra's authors found on the finest grid, by problem and duration."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(file)
        return {
            (row["name"], float(row["desired_duration"])): f"{float(row['duration']):.9f}, {row['solver_wrapper']}"
            for row in rows
            if row["status"] == "SUCCESS"
        }


def compare(problems: Sequence[HardProblem], record: dict[tuple[str, float], str]) -> list[dict[str, str]]:
    """A row for each problem."""
    rows = []
    for problem in problems:
        asked = f"{problem.duration:g}" if problem.duration > 0 else "least"
        row = {"problem": problem.name, "duration": asked} | tell_ours(problem)
        if is_installed("toppra"):
            row |= tell_theirs(problem)
        if record:
            row["recorded by toppra (s)"] = record.get((problem.name, problem.duration), "")
        rows.append(row)
    return rows


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.toppra_suite", description=__doc__)
    parser.add_argument("suite", type=Path, help="problem_suite_1.yaml of toppra's sources")
    suite = parser.parse_args().suite
    rows = compare(read_problems(suite), read_record(suite.with_name(RECORD)))
    print(markdown(list(rows[0]), [list(row.values()) for row in rows]))


if __name__ == "__main__":
    main()
