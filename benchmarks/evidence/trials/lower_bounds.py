"""Proven lower bounds beside durations: `python -m benchmarks.evidence.trials.lower_bounds CASE`.

CASE: paths (the circle, both orders, and the spline through 50 waypoints), splines (COPP's random ones, `--count`),
straight (random moves of one axis from rest to rest, `--count`, beside the shortest duration by ruckig, or by our
closed form where that is not installed) or zoo (random problems of one run, `--count`, beside what others find:
toppra's motion at order 2, FATROP's and IPOPT's at order 3 on a grid twice as fine, each slowed until it is seen to
hold).
"""

from argparse import ArgumentParser
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from itertools import islice
from time import process_time
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.evidence.peers.casadi_ import Solver, solve_by_casadi
from benchmarks.evidence.peers.problems import spline
from benchmarks.evidence.peers.random_splines import Suite
from benchmarks.evidence.trials.robustness import RandomProblem, random_problem, try_problem
from kinematics import Axis, load_machine
from kinematics.foundation.errors import MotionError, attempt
from planner import load_program, time_optimal
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.path.polynomial import PolynomialPath
from planner.path.stands import count_zero_derivatives
from planner.timing.certified_run import required_slowness
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.discretization import jerk_problem
from planner.timing.problem import Run
from planner.timing.profile import sample_limit_use


def solve_paths() -> Iterator[tuple[str, Solution, float]]:
    """The circle at both orders and the spline, solved twice: what, the solution and the time of the second."""
    machine = load_machine("hexapod")
    circle, case = actuate(load_program("bare-circle"), machine), spline()
    problems = [(f"circle, order {order}", circle, machine.axes, order) for order in (2, 3)]
    for what, path, axes, order in [*problems, ("spline, order 3", case.path, case.axes, 3)]:
        limits = limits_of(path, axes, order)
        certified_solve(path, limits, order)
        began = process_time()
        found = certified_solve(path, limits, order)
        yield what, found, process_time() - began


def solve_splines(count: int) -> Iterator[tuple[str, Solution, float]]:
    """COPP's random splines."""
    for n, (path, (speed, acceleration, jerk)) in enumerate(islice(_suite(), count)):
        began = process_time()
        found = time_optimal(path, max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        yield f"spline {n}", found, process_time() - began


def _suite() -> Iterator[tuple[Any, Any]]:
    for path, bounds in Suite().problems():
        yield path, np.asarray(bounds).transpose(0, 2, 1)


def solve_straight(count: int, seed: int = 0) -> Iterator[tuple[float, Solution]]:
    """Random moves from rest to rest: the shortest duration (s), by ruckig where it is there, and the solution."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        length = float(10 ** rng.uniform(-3, 2))
        limits = [float(limit) for limit in 10 ** rng.uniform(-1, 1.5, 3)]
        path = PPoly(np.array([[[length]], [[0.0]]]), np.array([0.0, 1.0]))
        found = time_optimal(path, **dict(zip(("max_speed", "max_acceleration", "max_jerk"), limits, strict=True)))
        yield _shortest(length, limits, found), found


def _shortest(length: float, limits: list[float], found: Solution) -> float:
    if find_spec("ruckig") is None:
        return found.trajectory.duration
    from ruckig import InputParameter, Ruckig, Trajectory

    asked, answer = InputParameter(1), Trajectory(1)
    asked.current_position, asked.target_position = [0.0], [length]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = ([limit] for limit in limits)
    Ruckig(1).calculate(asked, answer)
    return float(answer.duration)


def find_others(problem: RandomProblem, order: int) -> Iterator[tuple[str, float]]:
    """What other solvers find for a problem of one run, and the duration (s) of theirs that holds."""
    bare = PolynomialPath(problem.path.x, problem.path.c, [f"q{n}" for n in range(problem.path.c.shape[2])])
    axes = [
        Axis(name, max_speed=v, max_acceleration=a, max_jerk=None if problem.jerk is None else problem.jerk[n])
        for n, (name, v, a) in enumerate(zip(bare.names, problem.speed, problem.acceleration, strict=True))
    ]
    limits = limits_of(bare, axes, order)
    if bare.stops(order)[1:-1].any():
        return
    if order == 2:
        theirs = attempt(partial(certified_solve, bare, limits, 2, solver="toppra"))
        if not isinstance(theirs, MotionError):
            yield "toppra", theirs.trajectory.duration
        return
    still = count_zero_derivatives(bare) % 3
    run = Run(0, len(bare.breaks) - 2, stands=(int(still[0, 0]), int(still[1, -1])), fineness=2)
    posed = jerk_problem(bare, limits, run)
    if isinstance(posed, MotionError):
        return
    fine, start = posed
    solvers: tuple[Solver, ...] = ("fatrop", "ipopt")
    for solver in solvers:
        found = solve_by_casadi(fine, start.on(fine.s), solver)
        if found.solved:
            slowness = required_slowness(limits, sample_limit_use(bare, limits, found.profile))
            yield solver, found.duration * max(slowness, 1.0)


def solve_zoo(count: int) -> Iterator[tuple[str, float, float, float]]:
    """What, the bound, our duration and another's, of random problems at both orders."""
    for order in (2, 3):
        for seed in range(count):
            problem = random_problem(seed, order)
            ours, _ = try_problem(problem)
            if ours is not None:
                for name, duration in find_others(problem, order):
                    yield f"{problem.what}, {name}", ours.lower_bound, ours.trajectory.duration, duration


def describe(what: str, found: Solution, solving: float) -> str:
    """One line: how near, and in how much of the time that solving took."""
    began = process_time()
    bound = found.bound
    took = process_time() - began
    share = f"{100 * bound.gap:.4f} %, {len(bound.s)} cells, {took:.2f} s, {took / solving:.1f} of solving"
    return f"{what}: {bound.duration:.6f} s, at least {bound.value:.6f} s: {share}"


def _print_quantiles(what: str, values: list[float]) -> None:
    low, middle, most, high = np.quantile(values, [0.0, 0.5, 0.9, 1.0])
    print(f"{what} of {len(values)}: least {low:.3g}, median {middle:.3g}, nine in ten {most:.3g}, largest {high:.3g}")


def main() -> None:
    """Print the case that is asked for."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("case", choices=("paths", "splines", "straight", "zoo"))
    parser.add_argument("--count", type=int, default=100)
    asked = parser.parse_args()
    if asked.case == "straight":
        pairs = [(exact, found.lower_bound) for exact, found in solve_straight(asked.count)]
        _print_quantiles("1 - bound/shortest", [1 - bound / exact for exact, bound in pairs])
        print(f"bounds above the shortest duration: {sum(bound > exact for exact, bound in pairs)}")
        return
    if asked.case == "zoo":
        ratios = []
        for what, bound, ours, theirs in solve_zoo(asked.count):
            ratios.append(1 - bound / min(ours, theirs))
            if bound > min(ours, theirs):
                print(f"{what}: bound {bound!r} above {ours!r} or {theirs!r}", flush=True)
        _print_quantiles("1 - bound/the shorter of ours and theirs", ratios)
        print(f"bounds above a duration: {sum(ratio < 0 for ratio in ratios)}")
        return
    gaps = []
    for what, found, solving in solve_paths() if asked.case == "paths" else solve_splines(asked.count):
        print(describe(what, found, solving), flush=True)
        gaps.append(found.gap)
    _print_quantiles("gap", gaps)


if __name__ == "__main__":
    main()
